"""The optimal route from corner to corner, against scikit-image's minimum cost path.

Both charge an edge its metres times the mean of the two cells, and the cost of both paths is worked out by the same
few lines here, not by either contender. Every cell is passable, so that cutting corners makes no difference.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from swathe.planner import Path


def path_cost(costs: NDArray[np.float64], path: ArrayLike) -> float:
    """Return the cost of a path of (row, column) steps to neighbours, for cells of 1 m."""
    rows, columns = np.asarray(path, np.int64).T
    steps = np.hypot(np.diff(rows), np.diff(columns))
    if np.any(steps > 1.5) or np.any(steps == 0):
        raise ValueError("The path jumps or stands still.")
    along = costs[rows, columns]
    return float(np.sum(steps * (along[1:] + along[:-1]) / 2))


def facts(costs: NDArray[np.float64], path: ArrayLike) -> dict[str, float]:
    """Return the cost, and whether the path leads from corner to corner."""
    ends = np.asarray(path)[[0, -1]].tolist()
    return {"cost": path_cost(costs, path), "corner_to_corner": float(ends == [[0, 0], [len(costs) - 1] * 2])}


def run_ours(costs: NDArray[np.float64]) -> Path:
    import swathe.planner

    found = swathe.planner.shortest_path(costs, (0, 0), (costs.shape[0] - 1, costs.shape[1] - 1))
    if isinstance(found, swathe.planner.NoRoute):
        raise TypeError(found.reason)
    return found


def facts_of_ours(costs: NDArray[np.float64], path: Path) -> dict[str, float]:
    return facts(costs, path.cells)


def run_skimage(costs: NDArray[np.float64]) -> list[tuple[int, int]]:
    from skimage.graph import MCP_Geometric

    goal = (costs.shape[0] - 1, costs.shape[1] - 1)
    search = MCP_Geometric(costs, fully_connected=True)
    search.find_costs([(0, 0)], [goal])
    path: list[tuple[int, int]] = search.traceback(goal)
    return path


def prepare(side: int, run: Callable[[NDArray[np.float64]], Any]) -> Callable[[], NDArray[np.float64]]:
    def prepared() -> NDArray[np.float64]:
        run(terrain_fields.costs(100))  # imports and threads are not the job
        return terrain_fields.costs(side)

    return prepared


BENCHMARKS = [
    Benchmark(
        f"route-{side}",
        ours=Contender("swathe.planner.shortest_path", prepare(side, run_ours), run_ours, facts_of_ours),
        peer=Contender("skimage.graph.MCP_Geometric", prepare(side, run_skimage), run_skimage, facts),
        must=8,
        goal=12,
        agree_relative=1e-6,
    )
    for side in (1000, 2000, 4000)
]
