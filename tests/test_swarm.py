"""The swarm ends with the exact nests, is inside them before, and does not depend on the number of threads."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError, UsageError
from swathe.nest import NestParams, exact_nests
from swathe.rank import RankParams, Region, rank_map
from swathe.swarm import Swarm, SwarmParams, run_swarm, run_swarm_on_ranks
from worlds import region_of, region_of_mask, smooth_hills

if TYPE_CHECKING:
    from numpy.typing import NDArray


def hills(seed: int, rows: int = 40, columns: int = 50) -> Region:
    """Return ground of which the tractor can use about two thirds."""
    return region_of(smooth_hills(seed, rows, columns, height_m=70, cell_size_m=30, wave_m=500), 30.0)


def exact(region: Region, nest: NestParams) -> NDArray[np.uint32]:
    return exact_nests(
        rank_map(region).rank,
        rank_min=nest.rank_min,
        vicinity=nest.vicinity,
        contact=nest.contact,
        border=nest.border,
    ).labels


#: One table against every way to explore.
SWARMS = [
    SwarmParams(),
    SwarmParams(agents=10, pellet_max=3),
    SwarmParams(agents=7, explore="uniform", pellet_max=2),
    SwarmParams(agents=64, explore="permute"),
    SwarmParams(agents=64, explore="permute", pellet_max=3),
    SwarmParams(agents=50, attract=4.0),
    SwarmParams(agents=5000, teleport=1.0),
]
NESTS = [
    NestParams(),
    NestParams(contact="corner"),
    NestParams(contact="overlap"),
    NestParams(vicinity="cell"),
    NestParams(vicinity="von_neumann1", border="suitable"),
    NestParams(vicinity="disk:2", rank_min=8),
]


@pytest.mark.parametrize("nest", NESTS, ids=str)
@pytest.mark.parametrize("params", SWARMS, ids=str)
def test_a_finished_swarm_has_the_exact_nests(params: SwarmParams, nest: NestParams) -> None:
    ground = hills(3, 25, 30)
    found = run_swarm(ground, replace(params, nest=nest))
    assert found.ending == "finished"
    assert found.nests.count > 0
    assert np.array_equal(found.nests.labels, exact(ground, nest))


@settings(max_examples=40)
@given(seed=st.integers(0, 2**64 - 1), ticks=st.integers(0, 60), params=st.sampled_from(SWARMS))
def test_at_every_tick_the_nests_lie_inside_the_exact_ones(seed: int, ticks: int, params: SwarmParams) -> None:
    ground = hills(4)
    nest = NestParams(contact="corner")
    early = run_swarm(ground, replace(params, seed=seed, nest=nest), ticks=ticks)
    whole = exact(ground, nest)
    assert early.tally.ticks <= ticks
    assert (whole[early.nests.labels > 0] > 0).all()
    for label in range(1, early.nests.count + 1):
        assert len(np.unique(whole[early.nests.labels == label])) == 1
    assert early.tally.cells_evaluated <= ground.geometry.cell_count
    later = run_swarm(ground, replace(params, seed=seed, nest=nest), ticks=ticks + 20)
    assert (later.nests.labels[early.nests.labels > 0] > 0).all()


def facts(found: Swarm) -> tuple[Any, ...]:
    return (found.ending, found.tally, found.nests.labels.tobytes(), found.nests.sizes.tobytes())


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_way() -> None:
    ground = hills(5)
    params = SwarmParams(agents=100)
    first, again, other = (run_swarm(ground, replace(params, seed=seed), ticks=5) for seed in (1, 1, 2**64 - 1))
    assert facts(first) == facts(again)
    assert facts(first) != facts(other)


THREADS = """
import hashlib, sys
from swathe.swarm import SwarmParams, run_swarm
from worlds import region_of, smooth_hills
ground = region_of(smooth_hills(6, 300, 300, height_m=70, cell_size_m=30, wave_m=500), 30.0)
for agents in (10, 5000, 100_000):
    for explore in ("walk", "uniform", "permute"):
        params = SwarmParams(agents=agents, explore=explore, pellet_max=2, attract=1.0)
        found = run_swarm(ground, params, ticks=int(sys.argv[1]))
        print(agents, explore, found.tally, hashlib.sha256(found.nests.labels.tobytes()).hexdigest())
"""


@pytest.mark.parametrize("ticks", [3, 17])
def test_the_number_of_threads_changes_no_byte(ticks: int) -> None:
    said = {}
    for threads in ("1", "2", "8"):
        done = subprocess.run(
            [sys.executable, "-c", THREADS, str(ticks)],
            env={**os.environ, "RAYON_NUM_THREADS": threads, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            capture_output=True,
            text=True,
            check=True,
        )
        said[threads] = done.stdout
    assert said["1"] == said["2"] == said["8"]
    assert "permute" in said["1"]


def test_uniform_visits_settle_cores_as_often_as_theory_says() -> None:
    # Algorithms, expected visits: with λ visits per cell a core is full with F = 1 - exp(-λ) Σ_{j<K} λ^j / j!.
    level = region_of_mask(np.ones((100, 100), dtype=np.bool_))
    for pellet_max, ticks in ((1, 50), (1, 100), (3, 200), (3, 300)):
        params = SwarmParams(agents=100, explore="uniform", pellet_max=pellet_max, seed=ticks)
        found = run_swarm(level, params, ticks=ticks)
        visits_per_cell = found.tally.visits / 10_000
        assert visits_per_cell == ticks / 100
        terms = sum(visits_per_cell**j / math.factorial(j) for j in range(pellet_max))
        recall = 1 - math.exp(-visits_per_cell) * terms
        cores = 98 * 98
        # Five standard deviations of independent cells.
        slack = 5 * math.sqrt(cores * recall * (1 - recall))
        assert abs(found.tally.cores - cores * recall) < slack
        # A nest cell deep inside lies in the vicinity of nine cores.
        deep = found.nests.labels[2:-2, 2:-2] > 0
        assert deep.mean() == pytest.approx(1 - (1 - recall) ** 9, abs=0.02)


def test_all_cores_are_found_after_about_the_visits_that_theory_says() -> None:
    # Mean visits per cell until each of m cores was hit once: the harmonic number of m, spread about 1.28.
    level = region_of_mask(np.ones((60, 60), dtype=np.bool_))
    cores = 58 * 58
    expected = sum(1 / i for i in range(1, cores + 1))
    seen = []
    for seed in range(12):
        found = run_swarm(level, SwarmParams(agents=16, explore="uniform", seed=seed))
        assert found.tally.cores == cores
        seen.append(found.tally.visits / 3600)
    assert np.mean(seen) == pytest.approx(expected, abs=5 * 1.28 / math.sqrt(12))


@pytest.mark.parametrize("pellet_max", [1, 3])
def test_a_permutation_is_finished_after_as_many_epochs_as_pellets(pellet_max: int) -> None:
    level = region_of_mask(np.ones((37, 41), dtype=np.bool_))
    found = run_swarm(level, SwarmParams(agents=10, explore="permute", pellet_max=pellet_max))
    assert found.ending == "finished"
    assert found.tally.ticks <= math.ceil(37 * 41 * pellet_max / 10)
    assert found.tally.cells_evaluated == 37 * 41


@pytest.mark.parametrize("params", SWARMS, ids=str)
def test_inside_a_mask_the_swarm_ends_with_the_nests_of_the_masked_ranks(params: SwarmParams) -> None:
    ground = hills(7, 25, 30)
    row, column = np.indices(ground.geometry.shape)
    inside = np.hypot(row - 12, column - 15) < 11
    found = run_swarm(ground, params, inside=inside)
    masked = np.where(inside, rank_map(ground).rank, 1)
    assert np.array_equal(found.nests.labels, exact_nests(masked).labels)
    assert found.tally.cells_evaluated <= inside.sum()


def test_beyond_the_mask_can_count_as_suitable_but_is_no_nest() -> None:
    level = region_of_mask(np.ones((9, 9), dtype=np.bool_))
    inside = np.zeros((9, 9), dtype=np.bool_)
    inside[3:5, 2:7] = True
    closed = run_swarm(level, inside=inside)
    assert (closed.ending, closed.nests.count) == ("finished", 0)
    opened = run_swarm(level, SwarmParams(nest=NestParams(border="suitable")), inside=inside)
    assert np.array_equal(opened.nests.labels > 0, inside)


def test_a_mask_without_cells_and_no_ticks_build_nothing() -> None:
    ground = hills(8)
    nowhere = run_swarm(ground, inside=np.zeros(ground.geometry.shape, dtype=np.bool_))
    assert (nowhere.ending, nowhere.nests.count, nowhere.tally.visits) == ("finished", 0, 0)
    at_once = run_swarm(ground, ticks=0)
    assert (at_once.ending, at_once.nests.count) == ("ticks_spent", 0)
    assert (at_once.tally.ticks, at_once.tally.visits, at_once.tally.cells_evaluated) == (0, 0, 0)


def test_a_report_is_told_of_progress_and_stops_the_swarm() -> None:
    ground = hills(9, 80, 80)
    told: list[tuple[str, int, int]] = []

    def twice(stage: str, done: int, total: int) -> bool:
        told.append((stage, done, total))
        return len(told) < 3

    stopped = run_swarm(ground, SwarmParams(agents=4), on_progress=twice)
    assert stopped.ending == "stopped"
    assert len(told) == 3
    assert {stage for stage, _, _ in told} == {"regions"}
    assert all(0 <= done <= total for _, done, total in told)
    assert [done for _, done, _ in told] == sorted(done for _, done, _ in told)
    assert (exact(ground, NestParams())[stopped.nests.labels > 0] > 0).all()


def test_what_a_report_raises_comes_through() -> None:
    def broken(_stage: str, _done: int, _total: int) -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_swarm(hills(9), on_progress=broken)


def test_the_profile_chooses_the_lowest_rank_where_no_parameters_are_given() -> None:
    elevation = np.zeros((9, 9), dtype=np.float32)
    grey = np.full((9, 9), 20.0, dtype=np.float32)
    rock = np.full((9, 9), 5, dtype=np.uint8)
    for profile, count in (("paper", 1), ("literal", 0)):
        params = RankParams(profile=profile)  # type: ignore[arg-type]
        assert run_swarm(region_of(elevation, 30.0, soil=rock, grey=grey, params=params)).nests.count == count


def test_the_core_s_defaults_are_those_of_the_mirrors() -> None:
    rank, swarm = RankParams(), SwarmParams()
    assert _core.defaults() == {
        "moisture_percent": rank.moisture_percent,
        "paper_grade": rank.paper_grade,
        "agents": swarm.agents,
        "pellet_max": swarm.pellet_max,
        "teleport": swarm.teleport,
        "attract": swarm.attract,
        "seed": swarm.seed,
        "rank_min": swarm.nest.rank_min,
        "rank_min_literal": RankParams(profile="literal").rank_min,
        "sagitta_share": 0.1,
    }
    assert swarm.nest.rank_min == rank.rank_min


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"agents": 0}, "agents of 0"),
        ({"agents": 1_000_001}, "agents of 1000001"),
        ({"pellet_max": 0}, "pellet limit of 0"),
        ({"pellet_max": 256}, "pellet limit of 256"),
        ({"seed": -1}, "seed of -1"),
        ({"seed": 2**64}, "seed"),
        ({"teleport": 1.5}, "deployment"),
        ({"teleport": math.nan}, "deployment"),
        ({"attract": -1.0}, "attraction"),
        ({"attract": math.inf}, "attraction"),
        ({"explore": "fly"}, "exploration"),
        ({"nest": NestParams(rank_min=11)}, "rank of 11"),
        ({"nest": NestParams(vicinity="disk:60")}, "vicinity"),
    ],
)
def test_parameters_outside_their_range_are_refused(arguments: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidParameterError, match=named):
        run_swarm(hills(1, 5, 5), SwarmParams(**arguments), ticks=1)


@pytest.mark.parametrize("explore", ["walk", "uniform", "permute"])
@pytest.mark.parametrize("seed", [0, 2**64 - 1])
@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 4)])
def test_more_agents_than_cells_and_seeds_at_the_ends_of_the_range_end_as_usual(
    shape: tuple[int, int], seed: int, explore: Any
) -> None:
    level = region_of_mask(np.ones(shape, dtype=np.bool_))
    nest = NestParams(vicinity="cell")
    found = run_swarm(level, SwarmParams(agents=100_000, seed=seed, explore=explore, nest=nest))
    assert (found.ending, found.nests.count) == ("finished", 1)
    assert found.tally.cells_evaluated == found.tally.cores == shape[0] * shape[1]


def test_a_map_without_a_suitable_cell_has_no_nest() -> None:
    closed = region_of_mask(np.zeros((6, 7), dtype=np.bool_))
    found = run_swarm(closed, SwarmParams(agents=3))
    assert (found.ending, found.nests.count, found.tally.cores) == ("finished", 0, 0)


@pytest.mark.parametrize("ticks", [-1, 2**64])
def test_ticks_that_cannot_be_spent_are_refused(ticks: int) -> None:
    with pytest.raises(UsageError, match="ticks"):
        run_swarm(hills(1, 5, 5), ticks=ticks)


@pytest.mark.parametrize("shape", [(6, 5), (5, 7), (30,)])
def test_a_mask_of_another_shape_is_refused_even_with_as_many_cells(shape: tuple[int, ...]) -> None:
    with pytest.raises(ShapeMismatchError, match="mask"):
        run_swarm(hills(1, 5, 6), inside=np.ones(shape, dtype=np.bool_))


def test_small_masks_are_connected_as_scipy_says() -> None:
    draw = np.random.default_rng(11)
    suitable = draw.random((40, 40)) < 0.85
    found = run_swarm(region_of_mask(suitable), SwarmParams(agents=300, explore="permute"))
    assert found.nests.count == scipy.ndimage.label(scipy.ndimage.binary_opening(suitable, np.ones((3, 3))))[1]


@pytest.mark.parametrize("explore", ["walk", "permute"])
@pytest.mark.parametrize("ticks", [None, 0, 7])
def test_ranks_at_hand_give_the_swarm_of_the_ground_they_came_from(explore: Any, ticks: int | None) -> None:
    ground = hills(4, 130, 150)
    inside = smooth_hills(9, 130, 150, height_m=1, cell_size_m=30, wave_m=900) > 0.2
    params = SwarmParams(agents=700, explore=explore)
    of_ground = run_swarm(ground, params, inside=inside, ticks=ticks)
    of_ranks = run_swarm_on_ranks(rank_map(ground).rank, params, inside=inside, ticks=ticks)
    assert (of_ranks.ending, of_ranks.tally) == (of_ground.ending, of_ground.tally)
    np.testing.assert_array_equal(of_ranks.nests.labels, of_ground.nests.labels)
    np.testing.assert_array_equal(of_ranks.nests.sizes, of_ground.nests.sizes)


def test_ranks_that_are_none_and_masks_of_another_shape_are_refused() -> None:
    with pytest.raises(UsageError, match="11"):
        run_swarm_on_ranks(np.full((3, 3), 11, np.uint8))
    with pytest.raises(ShapeMismatchError):
        run_swarm_on_ranks(np.full((3, 3), 8, np.uint8), inside=np.ones((3, 4), np.bool_))


def test_a_permuting_swarm_of_many_tiles_ends_with_scipys_opening() -> None:
    rank = (2 + np.random.default_rng(5).integers(0, 40, (250, 333)).clip(0, 7)).astype(np.uint8)
    found = run_swarm_on_ranks(rank, SwarmParams(explore="permute"))
    opened = scipy.ndimage.binary_opening(rank >= 6, np.ones((3, 3), dtype=bool))
    labels, count = scipy.ndimage.label(opened)
    assert (found.ending, found.nests.count) == ("finished", count)
    np.testing.assert_array_equal(found.nests.labels, labels)
    # The tick in which the swarm is finished is a whole one.
    assert found.tally.visits < rank.size + 1024
    assert found.tally.cells_evaluated <= rank.size
