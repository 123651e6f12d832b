"""The rank map of a vehicle, against the time that copying the same bytes takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swathe.rank import RankMap, Region

# Far larger than any cache, so that both sides pay for memory.
SIDE = 8000
# Elevation (4 bytes) and soil (1) are read, the rank (1) is written.
BYTES_PER_CELL = 6


def region(side: int) -> Region:
    """Return the benchmark's ground with soil and a vehicle, ready to be ranked."""
    from swathe.grid import GridGeometry
    from swathe.rank import Region
    from swathe.vehicle import load_vehicle

    ground = Region(
        GridGeometry(side, side, 10.0),
        terrain_fields.elevation(side),
        load_vehicle("pioneer-3at"),
        terrain_fields.soil_codes(side),
    )
    _ = ground.core  # Python's checks and conversions are not the job
    return ground


def prepare_ours() -> tuple[Region, NDArray[np.uint8]]:
    # Both sides write to memory that has been written before: getting pages from the system is not the job.
    prepared = region(SIDE), np.ones((SIDE, SIDE), np.uint8)
    run_ours(prepared)  # starts the threads, too
    return prepared


def run_ours(prepared: tuple[Region, NDArray[np.uint8]]) -> RankMap:
    import swathe.rank

    ground, out = prepared
    return swathe.rank.rank_map(ground, out=out)


def facts_of_ours(_prepared: object, result: RankMap) -> dict[str, float]:
    return {"cells_no_go": int((result.rank == 1).sum()), "cells_ranked": int((result.rank > 1).sum())}


def prepare_copy() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    # A copy reads and writes every byte, so half of the traffic is the size of what is copied.
    source = np.ones(SIDE * SIDE * BYTES_PER_CELL // 2, np.uint8)
    prepared = source, np.full_like(source, 2)
    run_copy(prepared)
    return prepared


def run_copy(prepared: tuple[NDArray[np.uint8], NDArray[np.uint8]]) -> None:
    source, target = prepared
    np.copyto(target, source)


BENCHMARKS = [
    Benchmark(
        "rank",
        ours=Contender("swathe.rank.rank_map", prepare_ours, run_ours, facts_of_ours),
        peer=Contender("one-thread copy", prepare_copy, run_copy, lambda _prepared, _result: {}),
        must=0.15,
        goal=0.30,
        agree_relative=None,
        repeats=5,
    )
]
