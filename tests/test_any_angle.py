"""Paths at any angle and the eikonal field: laws, outside truths, and the errors that the documents print."""

from __future__ import annotations

import itertools
import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import shapely
import skfmm
from hypothesis import given, settings
from hypothesis import strategies as st

import any_angle_errors as errors
import commands
import raster_files
from swathe.errors import (
    InterruptedBySignalError,
    InvalidParameterError,
    OutsideGridError,
    ShapeMismatchError,
)
from swathe.planner import AnyAnglePath, NoRoute, any_angle_path, eikonal_field, plan, shortest_path
from worlds import drawn, ends_of, random_world, steep_hills

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

PATHS: tuple[Any, ...] = ("grid8", "grid16", "any-angle")
METHODS: tuple[Any, ...] = ("auto", "theta", "eikonal")


@cache
def cells() -> dict[str, dict[str, list[float]]]:
    return {name: of for name, _, of in errors.cell_rows()}


@cache
def routes() -> dict[str, dict[str, list[float]]]:
    return {name: of for name, _, of in errors.route_rows()}


def integrals(path: AnyAnglePath, costs: NDArray[np.float64], cell_size_m: float) -> tuple[float, float]:
    """Return what samples along a path add up to: with the cheapest of both sides a hair beside it, and as they lie.

    The cost lies between them: on the border of two cells the cheaper one counts.
    """
    padded = np.pad(np.where(np.isnan(costs), np.inf, costs), 1, constant_values=np.inf)
    least = most = 0.0
    for start, end in itertools.pairwise(path.points):
        share = (np.arange(40_000) + 0.5) / 40_000
        across = 1e-6 * np.array([start[1] - end[1], end[0] - start[0]]) / math.dist(start, end)
        found = []
        for side in (-across, 0 * across, across):
            row, column = np.floor(start + share[:, None] * (end - start) + side + 1.5).astype(int).T
            found.append(padded[row, column])
        metres = math.dist(start, end) * cell_size_m
        least += float(np.min(found, axis=0).mean() * metres)
        most += float(found[1].mean() * metres)
    return least, most


# --- what the documents print


def test_the_errors_in_the_documents_are_those_of_the_code() -> None:
    page = errors.PAGE.read_text(encoding="utf-8")
    found = {
        "cells": errors.table(errors.CELL_COLUMNS, errors.cell_rows()),
        "routes": errors.table(errors.ROUTE_COLUMNS, errors.route_rows()),
    }
    for name, text in found.items():
        printed = page.split(f"<!-- {name} -->")[1].split(f"<!-- end of {name} -->")[0].strip()
        number = re.compile(r"-?\d+\.\d{3}")
        assert number.sub("x", printed) == number.sub("x", text)
        old, new = (np.array([float(one) for one in number.findall(part)]) for part in (printed, text))
        # Another processor may round the last digit otherwise.
        np.testing.assert_allclose(new, old, rtol=0, atol=0.0021)


def test_any_angle_is_within_one_per_cent_and_never_below_the_cheapest() -> None:
    for name in ("free ground, every heading", "blocks, visibility graph", "two media, Snell's law"):
        found = np.array(cells()[name]["any angle"])
        assert found.mean() < 0.01, name
        # The bound on the least is the rounding of the sum; that of Snell's law its minimiser's.
        assert found.min() > -1e-9, name
    for name in ("plane, directed cost", "plane too steep straight up", "ridge, unfolded", "cone, unfolded"):
        found = np.array(routes()[name]["any-angle"])
        assert found.mean() < 1e-3, name
        # Heights are stored in single precision, and the cone is not linear between its cells.
        assert found.min() > (-1e-4 if name.startswith("cone") else -2e-6), name


def test_free_ground_is_crossed_straight_at_every_heading() -> None:
    free = cells()["free ground, every heading"]
    assert max(free["any angle"]) < 1e-9
    assert max(free["8 neighbours"]) > 0.08
    assert max(free["16 neighbours"]) > 0.027
    assert max(map(abs, free["eikonal field"])) < 0.001


def test_tacking_up_a_plane_too_steep_straight_up_is_found_to_the_best_heading() -> None:
    steep = routes()["plane too steep straight up"]
    assert max(steep["grid16"]) > 0.01
    assert max(steep["any-angle"]) < 1e-4


# --- laws


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    rows=st.integers(1, 14),
    columns=st.integers(1, 14),
    corners=st.sampled_from(["keep", "cut"]),
    cell_size_m=st.sampled_from([1.0, 0.3, 25.0]),
)
def test_a_path_is_open_ends_where_asked_and_costs_no_more_than_steps(
    seed: int, rows: int, columns: int, corners: Any, cell_size_m: float
) -> None:
    costs, start, goal = random_world(seed, rows, columns)
    options: dict[str, Any] = {"cell_size_m": cell_size_m, "corners": corners}
    steps = [shortest_path(costs, start, goal, neighbours=n, **options) for n in (8, 16)]
    for method in METHODS:
        path = any_angle_path(costs, start, goal, method=method, **options)
        if isinstance(path, NoRoute):
            if method == "eikonal" and corners == "cut":
                continue  # it finds only ways that share sides of cells
            assert not any(steps)
            continue
        assert all(steps)
        assert tuple(path.points[0]) == start
        assert tuple(path.points[-1]) == goal
        straight_m = math.dist(start, goal) * cell_size_m
        assert path.length_m >= straight_m * (1 - 1e-9)
        assert path.cost >= np.nanmin(costs) * straight_m * (1 - 1e-9)
        if method != "eikonal":
            assert path.cost <= min(step.cost for step in steps if not isinstance(step, NoRoute)) * (1 + 1e-9) + 1e-12
        if corners == "keep" and len(path.points) > 1:
            least, most = integrals(path, costs, cell_size_m)
            assert least * (1 - 2e-3) - 1e-6 <= path.cost <= most * (1 + 2e-3) + 1e-6
            closed = shapely.union_all(
                [shapely.box(c - 0.5, r - 0.5, c + 0.5, r + 0.5) for r, c in np.argwhere(~np.isfinite(costs))]
            )
            assert not shapely.LineString(path.points[:, ::-1]).intersects(closed)


def test_the_best_of_all_is_taken() -> None:
    for seed in range(6):
        costs, start, goal = random_world(seed, 30, 30)
        found = [any_angle_path(costs, start, goal, method=method) for method in METHODS]
        costs_found = [path.cost for path in found if isinstance(path, AnyAnglePath)]
        if costs_found:
            assert costs_found[0] == min(costs_found)


def test_start_may_equal_goal_and_maps_may_be_single_rows() -> None:
    here = any_angle_path(np.ones((3, 3)), (1, 1), (1, 1))
    assert isinstance(here, AnyAnglePath)
    assert (here.cost, here.length_m, here.points.tolist()) == (0.0, 0.0, [[1.0, 1.0]])
    for shape in ((1, 6), (6, 1)):
        line = any_angle_path(np.ones(shape, dtype=bool), (0, 0), (shape[0] - 1, shape[1] - 1), cell_size_m=4)
        assert isinstance(line, AnyAnglePath)
        assert line.cost == pytest.approx(20.0)
        assert len(line.points) == 2
    assert any_angle_path(np.zeros((4, 4)), (0, 0), (3, 3)).cost == 0.0  # type: ignore[union-attr]


@pytest.mark.parametrize("closed", [math.nan, math.inf])
def test_no_way_is_falsy_with_a_reason(closed: float) -> None:
    costs = np.ones((3, 5))
    costs[:, 2] = closed
    for method in METHODS:
        assert any_angle_path(costs, (0, 0), (2, 4), method=method) == NoRoute(
            "no_route", "Closed cells separate start and goal."
        )
    costs[0, 0] = closed
    for ends, status in ((((0, 0), (2, 4)), "start_blocked"), (((2, 4), (0, 0)), "goal_blocked")):
        answer = any_angle_path(costs, *ends)
        assert isinstance(answer, NoRoute)
        assert answer.status == status
    field = eikonal_field(costs, (1, 0))
    assert np.isinf(field[:, 2:]).all()
    assert np.isfinite(field[1:, :2]).all()
    assert np.isinf(eikonal_field(costs, (0, 0))).all()


def test_what_is_not_usable_is_named() -> None:
    ones = np.ones((3, 3))
    wrong: list[tuple[type[Exception], dict[str, Any]]] = [
        (InvalidParameterError, {"method": "guess"}),
        (InvalidParameterError, {"corners": "round"}),
        (InvalidParameterError, {"cell_size_m": 0.0}),
        (InvalidParameterError, {"cells": -ones}),
        (ShapeMismatchError, {"cells": ones[0]}),
        (OutsideGridError, {"goal": (3, 0)}),
        (OutsideGridError, {"start": (0, -1)}),
    ]
    for kind, given_wrong in wrong:
        with pytest.raises(kind):
            any_angle_path(**{"cells": ones, "start": (0, 0), "goal": (2, 2), **given_wrong})
    for kind, given_wrong in wrong[2:5] + wrong[6:]:
        with pytest.raises(kind):
            eikonal_field(**{"cells": ones, "start": (0, 0), **given_wrong})


def test_a_report_is_told_and_can_stop() -> None:
    told: list[str] = []

    def go_on(stage: str, _done: int, _total: int) -> bool:
        told.append(stage)
        return True

    assert any_angle_path(np.ones((40, 40)), (0, 0), (39, 20), on_progress=go_on)
    assert set(told) == {"route"}
    for asked in (
        lambda: any_angle_path(np.ones((40, 40)), (0, 0), (39, 20), on_progress=lambda *_: False),
        lambda: eikonal_field(np.ones((40, 40)), (0, 0), on_progress=lambda *_: False),
    ):
        with pytest.raises(InterruptedBySignalError):
            asked()


def test_a_path_refracts_and_does_not_follow_the_grid() -> None:
    world = drawn(["s....", ".....", "55555", "55555", "....g"])
    path = any_angle_path(world.costs, world.start, world.goal)
    assert isinstance(path, AnyAnglePath)
    assert len(path.points) == 4
    into, under, out = np.diff(path.points, axis=0)
    sines = [step[1] / math.hypot(*step) for step in (into, under, out)]
    assert sines[0] == pytest.approx(5 * sines[1], rel=1e-2)
    assert sines[2] == pytest.approx(sines[0], rel=1e-2)


# --- the eikonal field beside scikit-fmm


@pytest.mark.parametrize("walls", [False, True])
def test_the_field_is_that_of_scikit_fmm_on_five_times_finer_cells(walls: bool) -> None:
    size, finer, radius = 90, 5, 6.0

    def world(parts: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return distance from the start, costs and closed cells, with so many cells to a side of ours."""
        row, column = (np.mgrid[0 : size * parts, 0 : size * parts] + 0.5) / parts - 0.5
        away = np.hypot(row - 30, column - 25)
        costs = 1.5 + 0.5 * (1 - np.exp(-((away / 20) ** 4))) * np.sin(row / 17) * np.cos(column / 13)
        closed = np.zeros((size, size), dtype=bool)
        if walls:
            closed[45:48, 10:70] = closed[0:60, 60:62] = True
        return away, costs, np.kron(closed, np.ones((parts, parts), dtype=bool))

    away, costs, closed = world(1)
    fine_away, fine_costs, fine_closed = world(finer)
    # It starts from a circle, so that its field has no kink; inside, the cost is nearly constant.
    circle = np.ma.MaskedArray(fine_away - radius, fine_closed)
    fine = skfmm.travel_time(circle, 1 / fine_costs, dx=1 / finer, order=2) + radius * costs[30, 25]
    theirs = np.ma.filled(fine, np.inf)[2::finer, 2::finer]
    ours = eikonal_field(np.where(closed, np.inf, costs), (30, 25))
    assert np.array_equal(np.isinf(ours), closed)
    far = ~closed & (away > radius + 2)
    difference = ours[far] / theirs[far] - 1
    # Past corners the order is the first, and our cells are the coarser ones.
    assert np.abs(difference).max() < (0.06 if walls else 0.005)
    assert abs(difference.mean()) < (0.015 if walls else 0.002)


# --- planned routes


@pytest.mark.parametrize("method", ["swarm", "exact"])
@pytest.mark.parametrize("seed", range(3))
def test_a_route_at_any_angle_keeps_the_limits_and_costs_no_more(seed: int, method: Any) -> None:
    region = steep_hills(seed)
    start, goal = ends_of(region, seed)
    by_path, grid_cost = {}, {}
    for path in PATHS:
        found = plan(region, start, goal, method=method, path=path)
        assert found.route is not None
        assert found.path_cost is not None
        assert found.cost_lower_bound is not None
        assert found.cost_lower_bound <= found.route.cost * (1 + 1e-9)
        assert found.route.grade_max <= region.vehicle.grade_up * (1 + 1e-6)
        assert -found.route.grade_min <= region.vehicle.grade_down * (1 + 1e-6)
        assert found.route.side_slope_max <= region.vehicle.side_slope * (1 + 1e-6)
        assert tuple(found.route.xy_m[0]) == tuple(start)
        assert tuple(found.route.xy_m[-1]) == tuple(goal)
        by_path[path], grid_cost[path] = found.route, found.path_cost
    eight, sixteen, any_angle = (by_path[path] for path in PATHS)
    # Straight runs are told as one leg, whose heights are linear through the centres that it passes.
    assert eight.cost == pytest.approx(grid_cost["grid8"], rel=5e-3)
    steps = np.diff(eight.xy_m, axis=0)
    turns = np.degrees(np.arctan2(steps[:, 1], steps[:, 0])) / 45
    assert np.allclose(turns, np.round(turns), atol=1e-9)
    if method == "exact":
        assert any_angle.cost <= sixteen.cost * (1 + 1e-9)
        assert grid_cost["any-angle"] == grid_cost["grid16"] <= grid_cost["grid8"] * (1 + 1e-9)
    assert any_angle.cost < grid_cost["any-angle"]


def test_a_path_kind_that_is_not_known_is_refused() -> None:
    region = steep_hills(0)
    start, goal = ends_of(region, 0)
    with pytest.raises(InvalidParameterError, match="any-angle"):
        plan(region, start, goal, path="curvy")  # type: ignore[arg-type]


def test_the_command_plans_each_kind_of_path(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dem = str(tmp_path / "hills.tif")
    raster_files.write(tmp_path / "hills.tif", raster_files.hills(80, 90))
    costs = {}
    for path in PATHS:
        words = ["plan", "--dem", dem, "--points-crs", "native", "--start", commands.START, "--goal", commands.GOAL]
        words += ["--vehicle", "tractor", "--method", "exact", "--out", str(tmp_path / path), "--path", path, "--json"]
        finished = commands.run_here(capsys, *words)
        assert finished.code == 0
        assert finished.answer["path"] == path
        costs[path] = finished.answer["cost"]
    assert costs["any-angle"] <= costs["grid16"] <= costs["grid8"]
