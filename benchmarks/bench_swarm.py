"""The finished swarm, against scipy.ndimage's pass over the same ranks and against our own exact pass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

import bench_regions
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.swarm import Swarm

SIDE = 4000


def run_ours(explore: Literal["walk", "permute"]) -> Callable[[NDArray[np.uint8]], Swarm]:
    def run(rank: NDArray[np.uint8]) -> Swarm:
        import swathe.swarm

        return swathe.swarm.run_swarm_on_ranks(rank, swathe.swarm.SwarmParams(explore=explore, pellet_max=1))

    return run


def facts_of_ours(_rank: object, swarm: Swarm) -> dict[str, float]:
    return {"nests": swarm.nests.count, "cells_in_nests": int(np.count_nonzero(swarm.nests.labels))}


def contender(explore: Literal["walk", "permute"]) -> Contender:
    run = run_ours(explore)
    return Contender(f"swathe.swarm, {explore}, finished", bench_regions.prepare(SIDE, run), run, facts_of_ours)


SCIPY = Contender(
    "scipy.ndimage opening and label",
    bench_regions.prepare(SIDE, bench_regions.run_scipy),
    bench_regions.run_scipy,
    bench_regions.facts_of_scipy,
)
EXACT = Contender(
    "swathe.nest.exact_nests",
    bench_regions.prepare(SIDE, bench_regions.run_ours),
    bench_regions.run_ours,
    bench_regions.facts_of_ours,
)

# Beside the exact pass, and for the walk, the bars only guard what has been reached: the swarm cannot win there.
BENCHMARKS = [
    Benchmark("swarm", ours=contender("permute"), peer=SCIPY, must=1.0, goal=1 / 0.75, repeats=3),
    Benchmark("swarm-exact", ours=contender("permute"), peer=EXACT, must=0.05, goal=0.1, repeats=3),
    Benchmark("swarm-walk", ours=contender("walk"), peer=SCIPY, must=0.01, goal=0.02),
]
