"""Swarm, exact pass and lazy A* beside each other: what is measured, and that the figures are right."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.ndimage
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

import commands
from commands import GOAL, START
from swathe import comparison, planner
from swathe.comparison import Measured, compare, cores, student_interval, student_quantile
from swathe.corridor import CorridorParams
from swathe.errors import InvalidParameterError, OutsideGridError
from swathe.grid import Cell
from swathe.nest import NestParams, exact_nests
from swathe.swarm import SwarmParams
from worlds import region_of, region_of_mask, smooth_hills

if TYPE_CHECKING:
    from pathlib import Path

    from swathe.grid import Position
    from swathe.rank import Region

FIGURES = set(asdict(Measured())) | {"median", "interval_95"}


def hills(seed: int = 3) -> Region:
    return region_of(smooth_hills(seed, 60, 70, height_m=60, cell_size_m=30, wave_m=600), 30.0)


def ends_of(region: Region) -> tuple[Position, Position]:
    """Two far cells of the largest nest."""
    from swathe.rank import rank_map

    nests = exact_nests(rank_map(region).rank)
    cells = np.argwhere(nests.labels == 1 + int(np.argmax(nests.sizes)))
    first, last = (cells[number] for number in (0, -1))
    return region.geometry.position_of(Cell(*map(int, first))), region.geometry.position_of(Cell(*map(int, last)))


@pytest.fixture(scope="module")
def both_ways() -> tuple[comparison.Comparison, comparison.Comparison]:
    region = hills()
    params = SwarmParams(agents=200, seed=7)
    return (
        compare(region, params, CorridorParams(), seeds=3),
        compare(region, params, CorridorParams(), ends=ends_of(region), seeds=3),
    )


def test_without_ends_nests_are_compared_and_with_ends_ways_too(
    both_ways: tuple[comparison.Comparison, comparison.Comparison],
) -> None:
    whole, between = (found.as_dict() for found in both_ways)
    assert set(whole["comparison"]) == {"swarm", "exact"}
    assert set(between["comparison"]) == {"swarm", "exact", "lazy_astar", "lazy_astar_1.25"}
    for answer in (whole, between):
        assert answer["seeds"] == [7, 8, 9]
        assert all(set(figures) == FIGURES for figures in answer["comparison"].values())
        assert answer["precision"] == 1
    assert (whole["recall"], whole["recall_cores"]) == (1, 1)
    # Between two ends the swarm leaves alone what it does not need.
    assert 0 < between["recall"] < 1
    assert 0 < between["recall_cores"] < 1
    assert whole["comparison"]["swarm"]["cost"] is None
    assert whole["comparison"]["swarm"]["connected_at"] is None
    swarm, exact, lazy, weighted = between["comparison"].values()
    assert swarm["connected_at"] > 0
    assert lazy["cost"] == pytest.approx(exact["cost"], rel=1e-9)
    assert lazy["cost_excess"] == pytest.approx(0, abs=1e-9)
    assert -1e-9 <= weighted["cost_excess"] <= 0.25
    assert swarm["cost_excess"] >= -1e-9
    assert weighted["cells_evaluated"] <= lazy["cells_evaluated"] < exact["cells_evaluated"]


def test_the_figures_of_an_unfinished_swarm_show_what_it_missed() -> None:
    region = hills()
    exact, _ = comparison.find(region, "exact", SwarmParams(), CorridorParams(), None)
    half = replace(exact.nests, labels=np.where(np.arange(70) < 35, exact.nests.labels, 0).astype(np.uint32))
    found = replace(exact, nests=half)
    measured = comparison._measured(
        region, SwarmParams(), found, exact.nests, exact.nests, plan=None, best=None, seconds=0.0
    )
    wanted = exact.nests.labels > 0
    assert measured.recall == pytest.approx((half.labels > 0).sum() / wanted.sum())
    assert measured.recall is not None
    assert 0 < measured.recall < 1
    assert measured.precision == 1
    other = comparison._measured(region, SwarmParams(), exact, half, exact.nests, plan=None, best=None, seconds=0.0)
    assert other.precision is not None
    assert other.precision < 1


@settings(max_examples=30)
@given(
    seed=st.integers(0, 1000),
    vicinity=st.sampled_from(["moore1", "von_neumann1", "cell", "disk:2"]),
    border=st.sampled_from(["unsuitable", "suitable"]),
)
def test_cores_are_the_erosion_of_the_suitable_cells(seed: int, vicinity: str, border: str) -> None:
    suitable = np.random.default_rng(seed).random((20, 25)) < 0.85
    nest = NestParams(vicinity=vicinity, border=border)  # type: ignore[arg-type]
    reach, offsets = comparison._vicinity(vicinity)
    element = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=bool)
    for row, column in offsets:
        element[reach + row, reach + column] = True
    eroded = scipy.ndimage.binary_erosion(suitable, element, border_value=border == "suitable")
    nests = exact_nests(np.where(suitable, 8, 2), vicinity=vicinity, border=border)  # type: ignore[arg-type]
    assert np.array_equal(cores(nests, SwarmParams(nest=nest)), eroded)


@pytest.mark.parametrize("degrees", [*range(1, 31), 60, 1000])
def test_the_quantile_is_students(degrees: int) -> None:
    assert student_quantile(degrees) == pytest.approx(scipy.stats.t.ppf(0.975, degrees), rel=2e-4)


@given(values=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=25))
def test_the_interval_lies_around_the_mean_and_one_value_has_none(values: list[float]) -> None:
    interval = student_interval(values)
    assert interval is not None
    mean = float(np.mean(values))
    slack = 1e-9 * (1 + max(map(abs, values)))
    assert interval[0] - slack <= mean <= interval[1] + slack
    error = float(np.std(values, ddof=1)) / len(values) ** 0.5
    assert interval[1] - mean == pytest.approx(scipy.stats.t.ppf(0.975, len(values) - 1) * error, rel=1e-3, abs=slack)
    assert student_interval(values[:1]) is None


@pytest.mark.parametrize("seeds", [0, -1, 10_001])
def test_a_number_of_seeds_that_cannot_be_is_refused(seeds: int) -> None:
    with pytest.raises(InvalidParameterError, match="seeds"):
        compare(hills(), SwarmParams(), CorridorParams(), seeds=seeds)


def test_lazy_astar_finds_the_way_of_the_exact_plan_and_says_where_there_is_none() -> None:
    region = hills()
    start, goal = ends_of(region)
    exact = planner.plan(region, start, goal, method="exact")
    lazy = planner.lazy_astar(region, exact.path[0], exact.path[-1])
    assert lazy.cost == pytest.approx(exact.path_cost, rel=1e-9)
    assert lazy.cells is not None
    assert (lazy.cells[0], lazy.cells[-1]) == (exact.path[0], exact.path[-1])
    assert 0 < lazy.cells_expanded < lazy.cells_evaluated < region.geometry.cell_count
    walled = np.ones((9, 20), dtype=bool)
    walled[:, 10] = False
    none = planner.lazy_astar(region_of_mask(walled), (4, 4), (4, 16))
    assert (none.cells, none.cost) == (None, None)
    with pytest.raises(InvalidParameterError, match="weight"):
        planner.lazy_astar(region, (1, 1), (2, 2), weight=0.9)
    with pytest.raises(OutsideGridError):
        planner.lazy_astar(region, (1, 1), (200, 2))


def test_the_command_compares_inside_a_swathe_with_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = (
        "nests",
        "--dem",
        str(commands.hills(tmp_path)),
        "--points-crs",
        "native",
        "--start",
        START,
        "--goal",
        GOAL,
    )
    finished = commands.run_here(capsys, *words, "--compare", "--seeds", "3")
    assert finished.code == 0, finished.err
    for text in ("lazy A* 1.25", "above the optimum", "ticks to connection", "±", "means over 3 seeds"):
        assert text in finished.out
    summary = json.loads((tmp_path / "swathe-nests/summary.json").read_text())
    assert {"precision", "recall", "recall_cores", "cells_evaluated", "comparison"} <= set(summary)
    assert "visits" in summary["comparison"]["swarm"]["interval_95"]
    assert summary["cells_evaluated"] <= summary["cells_total"] + 200
    alone = commands.run_here(capsys, *words[:-2], "--json")
    assert (alone.code, alone.answer["kind"]) == (2, "usage")
    outside = commands.run_here(capsys, *words[:-1], "1,1", "--json")
    assert outside.code == 2
    assert "outside the map" in outside.answer["message"]
