"""The rank map of a vehicle, against the time that copying the same bytes takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swathe.rank import RankMap
    from swathe.vehicle import Vehicle

# Far larger than any cache, so that both sides pay for memory.
SIDE = 8000
# Elevation (4 bytes) and soil (1) are read, the rank (1) is written.
BYTES_PER_CELL = 6


def prepare_ours() -> tuple[NDArray[np.float32], NDArray[np.uint8], Vehicle]:
    import swathe.rank
    from swathe.vehicle import load_vehicle

    small = terrain_fields.elevation(64)
    vehicle = load_vehicle("pioneer-3at")
    swathe.rank.rank_metric(small, None, 10.0, vehicle)  # starts the threads
    return terrain_fields.elevation(SIDE), terrain_fields.soil_codes(SIDE), vehicle


def run_ours(prepared: tuple[NDArray[np.float32], NDArray[np.uint8], Vehicle]) -> RankMap:
    import swathe.rank

    elevation_m, soil, vehicle = prepared
    return swathe.rank.rank_metric(elevation_m, soil, 10.0, vehicle)


def facts_of_ours(_prepared: object, result: RankMap) -> dict[str, float]:
    return {"cells_no_go": int((result.rank == 1).sum()), "cells_ranked": int((result.rank > 1).sum())}


def prepare_copy() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    # A copy reads and writes every byte, so half of the traffic is the size of what is copied.
    source = np.ones(SIDE * SIDE * BYTES_PER_CELL // 2, np.uint8)
    return source, np.zeros_like(source)


def run_copy(prepared: tuple[NDArray[np.uint8], NDArray[np.uint8]]) -> None:
    source, target = prepared
    np.copyto(target, source)


BENCHMARKS = [
    Benchmark(
        "rank",
        ours=Contender("swathe.rank.rank_metric", prepare_ours, run_ours, facts_of_ours),
        peer=Contender("one-thread copy", prepare_copy, run_copy, lambda _prepared, _result: {}),
        must=0.15,
        goal=0.30,
        agree_relative=None,
        repeats=5,
    )
]
