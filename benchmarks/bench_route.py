"""The optimal route from corner to corner, against scikit-image's minimum cost path.

Both charge an edge its metres times the mean of the two cells, and the cost of both paths is worked out by the same
few lines here, not by either contender. Every cell is passable, so that cutting corners makes no difference. Both get
the same costs in the kind of number that they read without a copy: ours float32, scikit-image float64.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, DTypeLike, NDArray

    from swathe.planner import Path

    Costs = NDArray[np.floating[Any]]


def path_cost(costs: Costs, path: ArrayLike) -> float:
    """Return the cost of a path of (row, column) steps to neighbours, for cells of 1 m."""
    rows, columns = np.asarray(path, np.int64).T
    steps = np.hypot(np.diff(rows), np.diff(columns))
    if np.any(steps > 1.5) or np.any(steps == 0):
        raise ValueError("The path jumps or stands still.")
    along = costs[rows, columns].astype(np.float64)
    return float(np.sum(steps * (along[1:] + along[:-1]) / 2))


def facts(costs: Costs, path: ArrayLike) -> dict[str, float]:
    """Return the cost, and whether the path leads from corner to corner."""
    ends = np.asarray(path)[[0, -1]].tolist()
    return {"cost": path_cost(costs, path), "corner_to_corner": float(ends == [[0, 0], [len(costs) - 1] * 2])}


def run_ours(costs: Costs) -> Path:
    import swathe.planner

    found = swathe.planner.shortest_path(costs, (0, 0), (costs.shape[0] - 1, costs.shape[1] - 1))
    if isinstance(found, swathe.planner.NoRoute):
        raise TypeError(found.reason)
    return found


def facts_of_ours(costs: Costs, path: Path) -> dict[str, float]:
    return facts(costs, path.cells)


def run_skimage(costs: Costs) -> list[tuple[int, int]]:
    from skimage.graph import MCP_Geometric

    goal = (costs.shape[0] - 1, costs.shape[1] - 1)
    search = MCP_Geometric(costs, fully_connected=True)
    search.find_costs([(0, 0)], [goal])
    path: list[tuple[int, int]] = search.traceback(goal)
    return path


def prepare(side: int, dtype: DTypeLike, run: Callable[[Costs], Any]) -> Callable[[], Costs]:
    def costs(side: int) -> Costs:
        return terrain_fields.costs(side).astype(np.float32).astype(dtype)

    def prepared() -> Costs:
        run(costs(100))  # imports and threads are not the job
        return costs(side)

    return prepared


BENCHMARKS = [
    Benchmark(
        f"route-{side}",
        ours=Contender("swathe.planner.shortest_path", prepare(side, np.float32, run_ours), run_ours, facts_of_ours),
        peer=Contender("skimage.graph.MCP_Geometric", prepare(side, np.float64, run_skimage), run_skimage, facts),
        must=8,
        goal=12,
        agree_relative=1e-6,
    )
    for side in (1000, 2000, 4000)
]
