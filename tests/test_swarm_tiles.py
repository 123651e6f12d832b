"""Tiles of any size, run by anybody, merge into the exact nests."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_all_start_methods, get_context
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swathe.errors import InvalidParameterError, UsageError
from swathe.nest import NestParams, exact_nests
from swathe.rank import RankParams, Region, grey_levels, rank_map
from swathe.swarm import Swarm, SwarmParams, run_swarm, run_tiles
from worlds import region_of, region_of_mask, smooth_hills


def hills(seed: int, rows: int = 60, columns: int = 70, *, params: RankParams | None = None) -> Region:
    """Return ground with soil, zones and unknown heights."""
    heights = smooth_hills(seed, rows, columns, height_m=70, cell_size_m=30, wave_m=500)
    draw = np.random.default_rng(seed)
    heights[draw.random(heights.shape) < 0.005] = np.nan
    soil = np.repeat(np.repeat(draw.integers(1, 6, (rows // 10, columns // 10)), 10, 0), 10, 1).astype(np.uint8)
    zones = draw.random(heights.shape) < 0.005
    return region_of(heights, 30.0, soil=soil, zones=zones, grey=grey_levels(heights, "none"), params=params)


def exact(region: Region, nest: NestParams) -> bytes:
    words: dict[str, Any] = {"vicinity": nest.vicinity, "contact": nest.contact, "border": nest.border}
    return exact_nests(rank_map(region).rank, rank_min=nest.rank_min, **words).labels.tobytes()


def facts(found: Swarm) -> tuple[Any, ...]:
    return (found.ending, found.tally, found.nests.labels.tobytes(), found.nests.sizes.tobytes())


@settings(max_examples=40, deadline=None)
@given(
    tile_cells=st.integers(1, 80),
    seed=st.integers(0, 2**64 - 1),
    vicinity=st.sampled_from(["cell", "von_neumann1", "moore1", "disk:3"]),
    contact=st.sampled_from(["edge", "corner", "overlap"]),
    border=st.sampled_from(["suitable", "unsuitable"]),
    profile=st.sampled_from(["metric", "paper", "literal"]),
)
def test_tiles_of_any_size_are_the_exact_nests(
    tile_cells: int, seed: int, vicinity: str, contact: Any, border: Any, profile: Any
) -> None:
    ground = hills(seed % 5, 30, 40, params=RankParams(profile=profile))
    nest = NestParams(vicinity=vicinity, contact=contact, border=border)
    found = run_tiles(ground, SwarmParams(agents=20, nest=nest, seed=seed, explore="permute"), tile_cells=tile_cells)
    assert found.ending == "finished"
    assert found.nests.labels.tobytes() == exact(ground, nest)


def test_the_cores_of_all_tiles_are_those_of_one_swarm() -> None:
    ground = hills(2)
    whole = run_swarm(ground)
    tiles = run_tiles(ground, tile_cells=16)
    assert tiles.tally.cores == whole.tally.cores
    assert tiles.tally.cells_evaluated >= whole.tally.cells_evaluated
    assert tiles.nests.sizes.tobytes() == whole.nests.sizes.tobytes()


@pytest.mark.parametrize("start", get_all_start_methods())
def test_worker_processes_give_the_same_bytes(start: str) -> None:
    ground = hills(3)
    # The core's threads are at work before the processes start.
    alone = run_tiles(ground, tile_cells=30)
    assert rank_map(ground).rank.shape == ground.geometry.shape
    with ProcessPoolExecutor(2, mp_context=get_context(start)) as executor:
        assert facts(run_tiles(ground, tile_cells=30, executor=executor)) == facts(alone)


def test_worker_threads_give_the_same_bytes() -> None:
    ground = hills(4)
    with ThreadPoolExecutor(3) as executor:
        assert facts(run_tiles(ground, tile_cells=13, executor=executor)) == facts(run_tiles(ground, tile_cells=13))


def test_tiles_draw_seeds_of_their_own() -> None:
    ground = hills(5)
    params = SwarmParams(agents=10)
    first, again, other = (
        run_tiles(ground, replace(params, seed=seed), tile_cells=25, ticks=9) for seed in (0, 0, 2**64 - 1)
    )
    assert facts(first) == facts(again)
    assert facts(first) != facts(other)


def test_a_budget_leaves_ground_out_and_never_in() -> None:
    ground = hills(6)
    at_once = run_tiles(ground, tile_cells=20, ticks=0)
    assert (at_once.ending, at_once.nests.count, at_once.tally.visits) == ("ticks_spent", 0, 0)
    early = run_tiles(ground, SwarmParams(agents=20), tile_cells=20, ticks=20)
    whole = run_swarm(ground).nests.labels
    assert early.nests.count > 0
    assert (whole[early.nests.labels > 0] > 0).all()


def test_a_report_counts_tiles_and_stops_with_what_is_done() -> None:
    ground = hills(7)
    told: list[tuple[str, int, int]] = []

    def thrice(stage: str, done: int, total: int) -> bool:
        told.append((stage, done, total))
        return done < 2

    stopped = run_tiles(ground, tile_cells=35, on_progress=thrice)
    assert told == [("regions", 0, 4), ("regions", 1, 4), ("regions", 2, 4)]
    assert stopped.ending == "stopped"
    whole = run_swarm(ground).nests.labels
    assert (whole[stopped.nests.labels > 0] > 0).all()
    assert not stopped.nests.labels[40:].any()
    with ThreadPoolExecutor(1) as executor:
        again = run_tiles(ground, tile_cells=35, executor=executor, on_progress=lambda _stage, done, _total: done < 2)
    assert facts(again) == facts(stopped)


def test_one_cell_more_agents_than_cells_and_closed_ground() -> None:
    nest = NestParams(vicinity="cell")
    one = run_tiles(region_of_mask(np.ones((1, 1), dtype=np.bool_)), SwarmParams(agents=100_000, nest=nest))
    assert (one.ending, one.nests.count, one.tally.cores) == ("finished", 1, 1)
    closed = run_tiles(region_of_mask(np.zeros((5, 5), dtype=np.bool_)), tile_cells=2)
    assert (closed.ending, closed.nests.count) == ("finished", 0)


@pytest.mark.parametrize("tile_cells", [0, -3, 2**40])
def test_tiles_that_cannot_be_laid_are_refused(tile_cells: int) -> None:
    with pytest.raises(InvalidParameterError, match="Tiles of"):
        run_tiles(hills(1, 10, 10), tile_cells=tile_cells)


def test_bad_parameters_are_refused_before_a_tile_runs() -> None:
    ground = hills(1, 10, 10)
    with pytest.raises(UsageError, match="agents of 0"):
        run_tiles(ground, SwarmParams(agents=0))
    with pytest.raises(UsageError, match="ticks"):
        run_tiles(ground, ticks=-1)
    with pytest.raises(UsageError, match="vicinity"):
        run_tiles(ground, SwarmParams(nest=NestParams(vicinity="disk:60")))
