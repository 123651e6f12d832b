"""The optimal route and the cost field against other peers than scikit-image, and against itself on a larger map.

All but dijkstra3d charge an edge its metres times the mean of its two cells, as we do; dijkstra3d charges the cell that
is entered. Whatever a contender minimises, the cost of its path is worked out by the same few lines of ``bench_route``,
and ours must be no dearer.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import bench_route
import grass_peer
import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.planner import Path as CellPath

    Costs = NDArray[np.float32]

CELL_SIZE_M = 1.0


def costs(side: int) -> Costs:
    return terrain_fields.costs(side).astype(np.float32)


def real_costs(_: int = 0) -> Costs:
    """Return costs of 1 to about 12 from the slopes of a real map (SRTM, White Mountains), cells as squares."""
    data = os.environ.get("SWATHE_DATA")
    if data is None:
        raise RuntimeError("This needs real terrain: set SWATHE_DATA to the folder that holds dem/N44W072.hgt.")
    heights = grass_peer.read_geotiff(Path(data) / "dem" / "N44W072.hgt").astype(np.float32)
    down, right = np.gradient(heights, 90.0)
    slopes: Costs = np.hypot(down, right).astype(np.float32)
    return 1 + 10 * slopes


def route_of_ours(field: Costs) -> CellPath:
    import swathe.planner

    found = swathe.planner.shortest_path(field, (0, 0), (field.shape[0] - 1, field.shape[1] - 1))
    if isinstance(found, swathe.planner.NoRoute):
        raise TypeError(found.reason)
    return found


def facts_of_ours(field: Costs, path: CellPath) -> dict[str, float]:
    return bench_route.facts(field.astype(np.float64), path.cells)


def facts(field: Costs, path: NDArray[np.int64]) -> dict[str, float]:
    return bench_route.facts(field.astype(np.float64), path)


def route_of_dijkstra3d(field: Costs) -> NDArray[np.int64]:
    import dijkstra3d

    goal = (field.shape[0] - 1, field.shape[1] - 1)
    path: NDArray[np.int64] = dijkstra3d.dijkstra(field, (0, 0), goal, connectivity=8, anisotropy=(1.0, 1.0, 1.0))
    return path


def graph_of(field: Costs) -> Any:  # noqa: ANN401 - a scipy sparse array
    """Return the 8-neighbour graph that scipy searches."""
    from scipy.sparse import coo_array

    numbers = np.arange(field.size, dtype=np.int32).reshape(field.shape)
    sources, targets, weights = [], [], []
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
        to = (slice(rows, None), slice(max(columns, 0), field.shape[1] + min(columns, 0)))
        near = (slice(0, field.shape[0] - rows), slice(max(-columns, 0), field.shape[1] - max(columns, 0)))
        sources.append(numbers[near].ravel())
        targets.append(numbers[to].ravel())
        weights.append((np.hypot(rows, columns) * (field[near].astype(np.float64) + field[to]) / 2).ravel())
    ends = (np.concatenate(sources), np.concatenate(targets))
    return coo_array((np.concatenate(weights), ends), shape=(field.size, field.size)).tocsr()


def route_of_scipy(field: Costs) -> NDArray[np.int64]:
    from scipy.sparse.csgraph import dijkstra

    before = dijkstra(graph_of(field), directed=False, indices=0, return_predecessors=True)[1]
    cells = [field.size - 1]
    while cells[-1] != 0:
        cells.append(int(before[cells[-1]]))
    return np.column_stack(np.unravel_index(np.array(cells[::-1]), field.shape))


def field_of_ours(field: Costs) -> NDArray[np.float64]:
    import swathe.planner

    found: NDArray[np.float64] = swathe.planner.cost_field(field, (0, 0))
    return found


def field_of_xarray_spatial(field: Costs) -> NDArray[np.float32]:
    import xarray
    from xrspatial import cost_distance

    place = {"y": np.arange(field.shape[0], 0.0, -1.0), "x": np.arange(float(field.shape[1]))}
    source = np.zeros(field.shape, np.float32)
    source[0, 0] = 1
    maps = [xarray.DataArray(values, dims=("y", "x"), coords=place) for values in (source, field)]
    found: NDArray[np.float32] = cost_distance(*maps).to_numpy()
    return found


def facts_of_field(_: Costs, found: NDArray[np.floating[Any]]) -> dict[str, float]:
    return {"farthest": float(found.max()), "mean": float(found.mean(dtype=np.float64))}


class Files:
    """Costs as a file, and GRASS's location that is linked to it."""

    def __init__(self, side: int) -> None:
        self.costs = costs(side)
        self.ends = grass_peer.corner_points(side, CELL_SIZE_M)
        self.location = grass_peer.Location({"costs": self.costs}, CELL_SIZE_M)

    @property
    def folder(self) -> Path:
        """Where the files are."""
        return self.location.folder


def file_to_file(files: Files) -> CellPath:
    """Read the costs from a GeoTIFF, search, and write the route as a GeoJSON line."""
    import json

    path = route_of_ours(grass_peer.read_geotiff(files.folder / "costs.tif"))
    rows, columns = np.asarray(path.cells).T
    north_m = grass_peer.SOUTH_M + len(files.costs) * CELL_SIZE_M
    xy = np.column_stack([grass_peer.WEST_M + columns + 0.5, north_m - rows - 0.5])
    line = {"type": "LineString", "coordinates": xy.tolist()}
    (files.folder / "route.geojson").write_text(json.dumps(line), encoding="utf-8")
    return path


def route_of_grass(files: Files) -> NDArray[np.int64]:
    return files.location.route("r.cost input=costs", *files.ends, files.folder / "path.txt")


def prepare(make: Callable[[int], Any], side: int, run: Callable[[Any], Any]) -> Callable[[], Any]:
    def prepared() -> Any:  # noqa: ANN401 - whatever the contender needs
        run(make(100))  # imports, compilation and threads are not the job
        return make(side)

    return prepared


def ours(name: str, make: Callable[[int], Any], side: int) -> Contender:
    return Contender(name, prepare(make, side, route_of_ours), route_of_ours, facts_of_ours)


def against_grass(side: int) -> Benchmark:
    return Benchmark(
        f"route-{side}-files",
        ours=Contender(
            "swathe.planner.shortest_path, file to file",
            prepare(Files, side, file_to_file),
            file_to_file,
            lambda files, path: facts_of_ours(files.costs, path),
        ),
        peer=Contender(
            "GRASS r.cost and r.path",
            prepare(Files, side, route_of_grass),
            route_of_grass,
            lambda files, path: facts(files.costs, path),
        ),
        must=10,
        goal=15,
        agree_relative=1e-6,
    )


def against_itself(side: int, small: int) -> Benchmark:
    """CPU per cell on a small map over CPU per cell on a large one: 1 is linear."""
    times = (side // small) ** 2

    def again(field: Costs) -> CellPath:
        for _ in range(times - 1):
            route_of_ours(field)
        return route_of_ours(field)

    return Benchmark(
        f"route-{side}-per-cell",
        ours=ours(f"shortest_path on {side} x {side}", costs, side),
        peer=Contender(
            f"shortest_path on {small} x {small}, {times} times", lambda: costs(small), again, facts_of_ours
        ),
        must=1 / 1.6,
        goal=1 / 1.35,
        agree_relative=None,
    )


BENCHMARKS = [
    *(
        Benchmark(
            f"route-{side}-dijkstra3d",
            ours=ours("swathe.planner.shortest_path", costs, side),
            peer=Contender("dijkstra3d", prepare(costs, side, route_of_dijkstra3d), route_of_dijkstra3d, facts),
            must=3,
            goal=5,
            agree_relative=None,
            no_dearer=True,
        )
        for side in (1000, 4000)
    ),
    Benchmark(
        "route-1000-scipy",
        ours=ours("swathe.planner.shortest_path", costs, 1000),
        peer=Contender(
            "scipy.sparse.csgraph.dijkstra, graph built", prepare(costs, 1000, route_of_scipy), route_of_scipy, facts
        ),
        must=8,
        goal=12,
        agree_relative=1e-6,
    ),
    Benchmark(
        "route-srtm",
        ours=ours("swathe.planner.shortest_path, 1201 x 1201 SRTM", real_costs, 0),
        peer=Contender(
            "skimage.graph.MCP_Geometric",
            prepare(real_costs, 0, bench_route.run_skimage),
            bench_route.run_skimage,
            lambda field, path: facts(field, np.asarray(path)),
        ),
        must=8,
        goal=12,
        agree_relative=1e-6,
    ),
    Benchmark(
        "field-2000",
        ours=Contender("swathe.planner.cost_field", prepare(costs, 2000, field_of_ours), field_of_ours, facts_of_field),
        peer=Contender(
            "xrspatial.cost_distance",
            prepare(costs, 2000, field_of_xarray_spatial),
            field_of_xarray_spatial,
            facts_of_field,
        ),
        must=3,
        goal=5,
        agree_relative=1e-5,
    ),
    against_grass(1000),
    against_grass(4000),
    against_itself(8000, 1000),
]
