"""A route under costs that depend on the direction, 16 neighbours, against GRASS r.walk with the knight's move.

Both charge seconds that depend on the grade of every step, up and down; the vehicle's formula and the walker's are not
the same, so that only the work is compared, not the result. Ours does more: it ranks the ground, finds the nests,
keeps the vehicle's limits, shortens the route and works out every leg.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import grass_peer
import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.planner import Plan
    from swathe.rank import Region

CELL_SIZE_M = 10.0


def elevation(side: int) -> NDArray[np.float32]:
    """Return hills that a tractor can cross nearly everywhere."""
    return terrain_fields.elevation(side) * np.float32(min(1.0, side / 4000))


def barred(side: int) -> NDArray[np.float32]:
    """Return the same hills without the ground along the other diagonal, but for a gap in the south-west corner.

    The way round is so long that the search settles most of the map, as r.walk does anyhow.
    """
    heights = elevation(side)
    row, column = np.indices(heights.shape, np.int32)
    heights[(np.abs(row + column - side) < side // 80) & (column > 0.03 * side)] = np.nan
    return heights


def region(heights_m: NDArray[np.float32]) -> Region:
    import swathe

    rows, columns = heights_m.shape
    geometry = swathe.grid.GridGeometry(rows, columns, CELL_SIZE_M, 0.0, rows * CELL_SIZE_M)
    return swathe.rank.Region(geometry, heights_m, swathe.vehicle.load_vehicle("tractor"))


def plan(ground: Region) -> Plan:
    from swathe import planner
    from swathe.grid import Cell

    far = ground.geometry.rows - 3
    # Nests keep a cell from the border of the map.
    ends = [ground.geometry.position_of(Cell(row, row)) for row in (2, far)]
    return planner.plan(ground, *ends, method="exact")


def facts_of_plan(_: Region, answer: Plan) -> dict[str, float]:
    if answer.route is None:
        raise RuntimeError(f"No route: {answer.reason}")
    return {"length_m": answer.route.length_m}


class Walk:
    """Elevation as a file, no friction, and GRASS's location."""

    def __init__(self, heights_m: NDArray[np.float32]) -> None:
        self.ends = grass_peer.corner_points(len(heights_m), CELL_SIZE_M)
        maps = {"elevation": heights_m, "friction": np.zeros_like(heights_m)}
        self.location = grass_peer.Location(maps, CELL_SIZE_M)


def walk(files: Walk) -> NDArray[np.int64]:
    output = files.location.folder / "path.txt"
    return files.location.route("r.walk -k elevation=elevation friction=friction", *files.ends, output)


def facts_of_walk(_: Walk, path: NDArray[np.int64]) -> dict[str, float]:
    return {"length_m": float(np.hypot(*np.diff(path, axis=0).T).sum() * CELL_SIZE_M)}


def prepare(
    make: Callable[[NDArray[np.float32]], Any],
    heights: Callable[[int], NDArray[np.float32]],
    side: int,
    run: Callable[[Any], Any],
) -> Callable[[], Any]:
    def prepared() -> Any:  # noqa: ANN401 - whatever the contender needs
        run(make(heights(200)))
        return make(heights(side))

    return prepared


BENCHMARKS = [
    Benchmark(
        name,
        ours=Contender("swathe.planner.plan, exact", prepare(region, heights, side, plan), plan, facts_of_plan),
        peer=Contender("GRASS r.walk -k and r.path", prepare(Walk, heights, side, walk), walk, facts_of_walk),
        must=6,
        goal=10,
        agree_relative=None,
    )
    for name, heights, side in (
        ("walk-1000", elevation, 1000),
        ("walk-2000", elevation, 2000),
        ("walk-barred-1000", barred, 1000),
        ("walk-barred-2000", barred, 2000),
    )
]
