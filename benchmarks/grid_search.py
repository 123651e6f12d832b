"""The grid search by method: CPU seconds, cells settled and memory, for long and short queries.

    .venv/bin/python benchmarks/grid_search.py --side 4000 --distance 100 --method auto
    .venv/bin/python benchmarks/grid_search.py --side 10000

Without ``--distance`` the query leads from corner to corner. One query a process, so that memory is the query's own.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np

import terrain_fields
from swathe.planner import NoRoute, shortest_path


def peak_bytes() -> int:
    """Return the most memory that this process held at any one time since the peak was forgotten."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=4000)
    parser.add_argument("--distance", type=int, help="cells between start and goal, about the middle of the map")
    parser.add_argument("--method", choices=["auto", "dijkstra", "astar"], default="auto")
    parser.add_argument("--neighbours", type=int, choices=[8, 16], default=8)
    parser.add_argument("--dtype", default="float32", help="kind of number of the costs")
    given = parser.parse_args()
    bare = peak_bytes()
    # Drawn in strips, so that the field's own making does not count.
    tile = terrain_fields.costs(min(given.side, 2000)).astype(np.float32)
    times = -(-given.side // len(tile))
    mirrored = np.block([[tile, tile[:, ::-1]], [tile[::-1], tile[::-1, ::-1]]]) if times > 1 else tile
    costs = np.empty((given.side, given.side), given.dtype)
    for row in range(0, given.side, len(mirrored)):
        for column in range(0, given.side, len(mirrored)):
            part = costs[row : row + len(mirrored), column : column + len(mirrored)]
            part[:] = mirrored[: part.shape[0], : part.shape[1]]
    del mirrored, tile
    last = given.side - 1
    start, goal = (0, 0), (last, last)
    if given.distance is not None:
        reach = round(given.distance / 2 / np.sqrt(2))
        start, goal = (last // 2 - reach,) * 2, (last // 2 + reach,) * 2
    settled = 0

    def count(_stage: str, done: int, _total: int) -> bool:
        nonlocal settled
        settled = done
        return True

    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before = resource.getrusage(resource.RUSAGE_SELF)
    wall_s = time.perf_counter()
    path = shortest_path(costs, start, goal, method=given.method, neighbours=given.neighbours, on_progress=count)
    wall_s = time.perf_counter() - wall_s
    after = resource.getrusage(resource.RUSAGE_SELF)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if isinstance(path, NoRoute):
        raise SystemExit(path.reason)
    print(
        f"{given.method} {given.side}^2 {given.dtype}: {cpu_s:.3f} CPU s ({wall_s:.3f} s), {settled:,} cells settled, "
        f"{(peak_bytes() - bare) / costs.size:.2f} bytes a cell with the costs, cost {path.cost!r}"
    )


if __name__ == "__main__":
    main()
