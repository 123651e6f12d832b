"""Repaired ways against fresh ones, on any sequence of changes and moves."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import swathe.planner
from swathe.errors import (
    InterruptedBySignalError,
    InvalidParameterError,
    OutsideGridError,
    ShapeMismatchError,
)
from swathe.planner import NoRoute, Path, Replanner, shortest_path
from swathe.report.repair_film import Patch, write_repair_gif
from worlds import drawn, graph_of, random_world, smooth_hills

if TYPE_CHECKING:
    from pathlib import Path as Path_

    from numpy.typing import NDArray

    from worlds import World

worlds = st.builds(random_world, st.integers(0, 2**32 - 1), st.integers(2, 14), st.integers(2, 14))


def patched(costs: NDArray[np.float64], seed: int) -> tuple[slice, slice, NDArray[np.float64]]:
    """Return a rectangle and new values for it, some closed and some free."""
    draw = np.random.default_rng(seed)
    (top, bottom), (west, east) = (sorted(draw.integers(0, size + 1, 2)) for size in costs.shape)
    values = draw.uniform(0.5, 9, (bottom - top, east - west))
    values[draw.random(values.shape) < 0.2] = draw.choice([np.inf, np.nan, 0.0])
    return slice(top, bottom), slice(west, east), values


def cost_of(answer: Path | NoRoute) -> float:
    return answer.cost if isinstance(answer, Path) else math.inf


@given(
    world=worlds,
    neighbours=st.sampled_from([8, 16]),
    corners=st.sampled_from(["keep", "cut"]),
    share=st.sampled_from([0.0, 0.2, math.inf]),
    seeds=st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=6),
)
def test_any_sequence_costs_what_a_fresh_plan_costs(
    world: World, neighbours: int, corners: Any, share: float, seeds: list[int]
) -> None:
    costs, start, goal = world
    costs = costs.copy()
    options: dict[str, Any] = {"neighbours": neighbours, "corners": corners}
    replanner = Replanner(costs, start, goal, repair_share=share, **options)
    for seed in seeds:
        way = replanner.path()
        if isinstance(way, Path) and seed % 3 == 0:
            replanner.move_to(way.cells[min(2, len(way.cells) - 1)])
        rows, columns, values = patched(costs, seed)
        if seed % 2:
            changed = replanner.update(rows, columns, values)
            assert changed <= values.size
        else:
            row, column = np.mgrid[rows, columns]
            replanner.update(row, column, values)
        costs[rows, columns] = values
        found = replanner.path()
        fresh = Replanner(costs, replanner.start, goal, **options).path()
        plain = shortest_path(costs, replanner.start, goal, **options)
        assert cost_of(found) == cost_of(fresh)
        assert cost_of(found) == pytest.approx(cost_of(plain), rel=1e-12, abs=1e-290)
        if isinstance(found, NoRoute):
            assert found == plain
            continue
        assert (found.cells[0], found.cells[-1]) == (replanner.start, goal)
        assert len(set(found.cells)) == len(found.cells)


def test_a_patch_beside_the_robot_costs_scipys_dijkstra_and_little_work() -> None:
    hills = smooth_hills(3, 90, 110, height_m=6.0, cell_size_m=1.0, wave_m=30.0)
    costs = 1 + np.abs(hills - 500).astype(np.float64)
    replanner = Replanner(costs, (4, 5), (80, 100), keep_expanded=True)
    way = replanner.path()
    assert isinstance(way, Path)
    first = replanner.tally
    assert first.afresh
    assert replanner.expanded.shape == (first.expanded, 2)
    robot = way.cells[len(way.cells) // 2]
    replanner.move_to(robot)
    replanner.path()
    assert replanner.tally.expanded == 0
    rows, columns = slice(robot.row - 3, robot.row + 4), slice(robot.column + 2, robot.column + 9)
    replanner.update(rows, columns, costs[rows, columns] * 2)
    costs[rows, columns] *= 2
    found = replanner.path()
    assert isinstance(found, Path)
    graph = graph_of(costs, 1.0, 8, "keep")
    number = [cell.row * 110 + cell.column for cell in (robot, replanner.goal)]
    expected = scipy.sparse.csgraph.dijkstra(graph, indices=number[0])[number[1]]
    assert found.cost == pytest.approx(expected, rel=1e-12)
    tally = replanner.tally
    assert (tally.afresh, tally.fresh_plans) == (False, 1)
    assert 0 < tally.expanded < tally.looked_at < first.looked_at / 4
    assert replanner.expanded.shape == (tally.expanded, 2)


def test_the_cells_given_are_copied_and_booleans_mean_passable() -> None:
    cells = np.ones((3, 3), dtype=np.bool_)
    replanner = Replanner(cells, (0, 0), (0, 2), cell_size_m=2.0)
    cells[:] = False
    first = replanner.path()
    assert isinstance(first, Path)
    assert (first.cost, first.length_m) == (4.0, 4.0)
    assert replanner.update([0, 1], 1, False) == 2
    second = replanner.path()
    assert isinstance(second, Path)
    assert second.cells == [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2)]
    assert replanner.update(np.array([], dtype=np.float64), [], 5.0) == 0
    assert replanner.update(slice(2, 1), slice(None), 5.0) == 0
    assert replanner.update(slice(None), slice(None), True) == 2
    assert replanner.path() == first


@pytest.mark.parametrize("closed", [math.nan, math.inf])
def test_closed_ends_are_answers_that_say_where_and_can_open_again(closed: float) -> None:
    costs, start, goal = drawn(["s..", "..g"])
    replanner = Replanner(costs, start, goal)
    open_ = replanner.path()
    for name, cell in (("goal", goal), ("start", start)):
        replanner.update(cell.row, cell.column, closed)
        refused = replanner.path()
        assert isinstance(refused, NoRoute)
        assert refused.status == f"{name}_blocked"
        assert f"({cell.row}, {cell.column})" in refused.reason
    replanner.move_to(goal)
    assert replanner.path().status == "start_blocked"  # type: ignore[union-attr]
    replanner.update([start.row, goal.row], [start.column, goal.column], 1)
    assert replanner.path() == Path([goal], 0.0, 0.0)
    replanner.move_to(start)
    assert cost_of(replanner.path()) == cost_of(open_)


def test_walls_separate_and_a_door_connects() -> None:
    costs, start, goal = drawn(["s.#..", "..#..", "..#.g"])
    replanner = Replanner(costs, start, goal)
    assert replanner.path() == NoRoute("no_route", "Closed cells separate start and goal.")
    replanner.update(1, 2, 1.0)
    assert cost_of(replanner.path()) == pytest.approx(2 * math.sqrt(2) + 2)


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda r: r.update(0, 0, -1.0), InvalidParameterError, "negative"),
        (lambda r: r.update([0, 0], [0, 1], [5.0, -2.0]), InvalidParameterError, r"\(0, 1\)"),
        (lambda r: r.update(slice(None), slice(None), np.full((3, 4), -0.5)), InvalidParameterError, r"\(0, 0\)"),
        (lambda r: r.update([0, -1], 0, 2.0), OutsideGridError, r"\(-1, 0\)"),
        (lambda r: r.update(3, 0, 2.0), OutsideGridError, r"\(3, 0\)"),
        (lambda r: r.update([0, 1], [0, 1, 2], 2.0), ShapeMismatchError, "Rows"),
        (lambda r: r.update([0, 1], 0, [1.0, 2.0, 3.0]), ShapeMismatchError, "Values"),
        (lambda r: r.update(slice(0, 2), slice(0, 2), np.ones((3, 3))), ShapeMismatchError, "Values"),
        (lambda r: r.update(slice(0, 2), 1, 1.0), InvalidParameterError, "kind"),
        (lambda r: r.update(slice(0, 3, 2), slice(0, 2), 1.0), InvalidParameterError, "gaps"),
        (lambda r: r.update(0.5, 0, 1.0), InvalidParameterError, "whole numbers"),
        (lambda r: r.update(0, 0, "dear"), InvalidParameterError, "numbers"),
        (lambda r: r.move_to((0, 4)), OutsideGridError, r"\(0, 4\)"),
        (lambda r: r.move_to("ab"), InvalidParameterError, "not a cell"),
    ],
)
def test_what_is_not_usable_is_refused_and_changes_nothing(call: Any, error: Any, named: str) -> None:
    replanner = Replanner(np.ones((3, 4)), (0, 0), (2, 3))
    before = replanner.path()
    with pytest.raises(error, match=named):
        call(replanner)
    assert replanner.start == (0, 0)
    assert replanner.path() == before


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"neighbours": 4}, "neighbours"),
        ({"corners": "round"}, "corners"),
        ({"repair_share": -0.1}, "share"),
        ({"repair_share": math.nan}, "share"),
        ({"cell_size_m": 0.0}, "cell"),
        ({"start": (9, 9)}, "outside"),
        ({"cells": np.full((3, 4), -1.0)}, "negative"),
        ({"cells": np.zeros((0, 3))}, "shape"),
    ],
)
def test_replanners_that_make_no_sense_are_refused(options: dict[str, Any], named: str) -> None:
    request: dict[str, Any] = {"cells": np.ones((3, 4)), "start": (0, 0), "goal": (2, 3), **options}
    with pytest.raises((InvalidParameterError, OutsideGridError, ShapeMismatchError), match=named):
        Replanner(request.pop("cells"), request.pop("start"), request.pop("goal"), **request)


def go_on(answer: bool, seen: list[int], _stage: str, done: int, _total: int) -> bool:
    seen.append(done)
    return answer


def test_a_report_stops_and_the_next_call_goes_on() -> None:
    costs = np.random.default_rng(2).uniform(1, 3, (300, 300))
    replanner = Replanner(costs, (0, 0), (299, 299))
    seen: list[int] = []
    with pytest.raises(InterruptedBySignalError, match="stopped"):
        replanner.path(on_progress=partial(go_on, False, seen))
    found = replanner.path(on_progress=partial(go_on, True, seen))
    assert cost_of(found) == cost_of(Replanner(costs, (0, 0), (299, 299)).path())
    assert len(seen) > 2


def test_the_example_of_the_documentation_holds() -> None:
    import doctest

    finder = doctest.DocTestFinder(recurse=False)
    (example,) = finder.find(Replanner, "Replanner", globs=vars(swathe.planner))
    assert doctest.DocTestRunner().run(example).failed == 0


def test_the_film_shows_both_searches_and_is_the_same_every_time(tmp_path: Path_) -> None:
    costs = 1 + np.abs(smooth_hills(5, 60, 70, height_m=4.0, cell_size_m=1.0, wave_m=25.0) - 500).astype(np.float64)
    patches = [
        Patch(12, 9, 7, "dearer"),
        Patch(10, 8, 6, "closed"),
        Patch(9, 8, 6, "cheaper"),
        Patch(500, 1, 3, "closed"),
    ]
    for name in ("a", "b"):
        write_repair_gif(tmp_path / f"{name}.gif", costs, (4, 5), (52, 60), patches)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    with Image.open(tmp_path / "a.gif") as gif:
        frames = []
        for number in range(gif.n_frames):  # type: ignore[attr-defined]
            gif.seek(number)
            frames.append(np.asarray(gif.convert("RGB"), dtype=np.int16))
    teal = [(np.abs(frame[80:-80] - (16, 150, 140)).sum(axis=2) < 150) for frame in frames]
    # The fresh plan looks at much that the repair leaves alone.
    assert max(np.count_nonzero(seen[:, 450:890]) - np.count_nonzero(seen[:, :430]) for seen in teal) > 10_000
    closed = [np.count_nonzero(np.abs(frame[80:-80] - (92, 34, 50)).sum(axis=2) < 40) for frame in frames]
    assert closed[-1] > closed[0] + 100


def test_a_film_without_a_way_is_refused_and_one_that_loses_it_ends(tmp_path: Path_) -> None:
    costs, start, goal = drawn(["s.#..", "..#..", "..#.g"])
    with pytest.raises(InvalidParameterError, match="separate"):
        write_repair_gif(tmp_path / "a.gif", costs, start, goal, [])
    costs[1, 2] = 1
    write_repair_gif(tmp_path / "a.gif", costs, start, goal, [Patch(1, 1, 1, "closed")])
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 3  # type: ignore[attr-defined]
    assert costs[1, 2] == 1
