"""Exact navigable regions, against the same three steps of scipy.ndimage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.nest import Nests

RANK_MIN = 6


def prepare(side: int, run: Callable[[NDArray[np.uint8]], Any]) -> Callable[[], NDArray[np.uint8]]:
    def prepared() -> NDArray[np.uint8]:
        run(terrain_fields.ranks(128))  # imports and threads are not the job
        return terrain_fields.ranks(side)

    return prepared


def run_ours(rank: NDArray[np.uint8]) -> Nests:
    import swathe.nest

    return swathe.nest.exact_nests(rank, rank_min=RANK_MIN, vicinity="moore1", contact="edge")


def facts_of_ours(_rank: object, nests: Nests) -> dict[str, float]:
    return {"nests": nests.count, "cells_in_nests": int(np.count_nonzero(nests.labels))}


def run_scipy(rank: NDArray[np.uint8]) -> tuple[NDArray[np.int32], int]:
    from scipy import ndimage

    opened = ndimage.binary_opening(rank >= RANK_MIN, np.ones((3, 3), bool))
    labels, count = ndimage.label(opened)
    return labels, count


def facts_of_scipy(_rank: object, result: tuple[NDArray[np.int32], int]) -> dict[str, float]:
    labels, count = result
    return {"nests": count, "cells_in_nests": int(np.count_nonzero(labels))}


BENCHMARKS = [
    Benchmark(
        f"regions-{side}",
        ours=Contender("swathe.nest.exact_nests", prepare(side, run_ours), run_ours, facts_of_ours),
        peer=Contender("scipy.ndimage opening and label", prepare(side, run_scipy), run_scipy, facts_of_scipy),
        must=6,
        goal=12,
        repeats=3,
    )
    for side in (1000, 4000)
]
