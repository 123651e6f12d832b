"""Cheapest ways over any costs, against scipy and scikit-image."""

from __future__ import annotations

import itertools
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.ndimage
import scipy.sparse
import skimage.graph
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from swathe.errors import (
    InterruptedBySignalError,
    InvalidParameterError,
    OutsideGridError,
    ShapeMismatchError,
    TooLargeError,
)
from swathe.grid import Cell
from swathe.planner import NoRoute, Path, cost_field, shortest_path
from worlds import (
    World,
    drawn,
    graph_of,
    mask,
    random_world,
)

METHODS = ("astar", "dijkstra", "auto")
ROOT_2, ROOT_5 = math.sqrt(2), math.sqrt(5)

#: Drawn worlds with the cost for 8 and for 16 neighbours; None where closed cells separate start and goal.
WORLDS: dict[str, tuple[list[str], float | None, float | None]] = {
    "straight": (["s...g"], 4, 4),
    "one cell beside": (["sg"], 1, 1),
    "diagonal": (["s..", "...", "..g"], 2 * ROOT_2, 2 * ROOT_2),
    "knight": (["s....", "....g"], 3 + ROOT_2, 2 + ROOT_5),
    "wall": (["s.#..", "..#..", "..#..", "....g"], 5 + ROOT_2, 4 + ROOT_5),
    "corner may not be cut": ([".#g", "..#", "s.."], None, None),
    "closed": (["s#.", "##.", "..g"], None, None),
    "hill": ([".999.", "s.9.g", "....."], 2 + 2 * ROOT_2, 2 * ROOT_5),
    "swamp is cheaper than the way round": (["s2g", ".#.", ".#.", "..."], 3, 3),
    "free ground": (["s0000g"], 1, 1),
    "column": (["s", "3", "g"], 4, 4),
}


@pytest.mark.parametrize("neighbours", [8, 16])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", WORLDS)
def test_drawn_worlds(name: str, method: Any, neighbours: int) -> None:
    rows, eight, sixteen = WORLDS[name]
    costs, start, goal = drawn(rows)
    expected = eight if neighbours == 8 else sixteen
    found = shortest_path(costs, start, goal, method=method, neighbours=neighbours)
    if expected is None:
        assert isinstance(found, NoRoute)
        assert not found
        assert (found.status, found.reason) == ("no_route", "Closed cells separate start and goal.")
    else:
        assert isinstance(found, Path)
        assert found.cost == pytest.approx(expected, rel=1e-12)
        assert (found.cells[0], found.cells[-1]) == (start, goal)


worlds = st.builds(random_world, st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(1, 14))


@pytest.mark.parametrize("corners", ["keep", "cut"])
@pytest.mark.parametrize("neighbours", [8, 16])
@given(world=worlds, cell_size_m=st.sampled_from([1.0, 0.5, 30.0]))
def test_the_cost_is_scipys_dijkstra_on_the_documented_graph(
    neighbours: int, corners: Any, world: World, cell_size_m: float
) -> None:
    costs, start, goal = world
    graph = graph_of(costs, cell_size_m, neighbours, corners)
    columns = costs.shape[1]
    source, target = start.row * columns + start.column, goal.row * columns + goal.column
    expected = float(scipy.sparse.csgraph.dijkstra(graph, indices=source)[target])
    for method in METHODS:
        found = shortest_path(
            costs,
            start,
            goal,
            cell_size_m=cell_size_m,
            neighbours=neighbours,
            corners=corners,
            method=method,  # type: ignore[arg-type]
        )
        if math.isinf(expected):
            assert isinstance(found, NoRoute)
            continue
        assert isinstance(found, Path)
        assert found.cost == pytest.approx(expected, rel=1e-9, abs=1e-9)
        numbers = [cell.row * columns + cell.column for cell in found.cells]
        walked = [graph[a, b] for a, b in itertools.pairwise(numbers)]
        assert sum(walked) == pytest.approx(found.cost, rel=1e-9, abs=1e-9)
        length_m = sum(math.dist(a, b) for a, b in itertools.pairwise(found.cells)) * cell_size_m
        assert found.length_m == pytest.approx(length_m)
        assert found.length_m >= math.dist(start, goal) * cell_size_m - 1e-9
        assert len(set(found.cells)) == len(found.cells)


@given(worlds)
def test_the_cost_with_cut_corners_is_scikit_images(world: World) -> None:
    costs, start, goal = world
    search = skimage.graph.MCP_Geometric(np.where(np.isfinite(costs), costs, -1.0), fully_connected=True)
    expected = float(search.find_costs([start])[0][goal])
    found = shortest_path(costs, start, goal, corners="cut")
    assert (found.cost if isinstance(found, Path) else math.inf) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(world=worlds, neighbours=st.sampled_from([8, 16]), corners=st.sampled_from(["keep", "cut"]))
def test_there_and_back_cost_the_same(world: World, neighbours: int, corners: Any) -> None:
    costs, start, goal = world
    there = shortest_path(costs, start, goal, neighbours=neighbours, corners=corners)
    back = shortest_path(costs, goal, start, neighbours=neighbours, corners=corners)
    assert bool(there) == bool(back)
    if isinstance(there, Path) and isinstance(back, Path):
        assert there.cost == pytest.approx(back.cost, rel=1e-9, abs=1e-9)


@given(world=worlds, at=st.tuples(st.integers(0, 13), st.integers(0, 13)), neighbours=st.sampled_from([8, 16]))
def test_an_obstacle_never_lowers_the_cost(world: World, at: tuple[int, int], neighbours: int) -> None:
    costs, start, goal = world
    cell = (at[0] % costs.shape[0], at[1] % costs.shape[1])
    assume(cell not in (start, goal))
    closed = costs.copy()
    closed[cell] = np.inf
    before, after = (shortest_path(layer, start, goal, neighbours=neighbours) for layer in (costs, closed))
    assert (after.cost if isinstance(after, Path) else math.inf) >= (
        before.cost - 1e-9 if isinstance(before, Path) else math.inf
    )


def test_booleans_are_passable_at_cost_1() -> None:
    cells = mask(["##.", ".##", "..#"])
    found = shortest_path(cells, (0, 0), (2, 2), cell_size_m=2.0)
    assert isinstance(found, Path)
    assert found.cells == [(0, 0), (0, 1), (1, 1), (1, 2), (2, 2)]
    assert (found.cost, found.length_m) == (8.0, 8.0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64, np.uint8, np.uint16, np.float16, np.dtype(">f8")])
def test_numbers_of_any_kind_and_any_layout_are_costs(dtype: Any) -> None:
    costs = np.asarray([[1, 9, 1], [1, 9, 1], [1, 1, 1]], dtype=dtype)
    for layout in (costs, np.asfortranarray(costs), costs[:, ::-1]):
        found = shortest_path(layout, (0, 0), (0, 2))
        assert isinstance(found, Path)
        assert found.cost == pytest.approx(2 + 2 * ROOT_2)


@pytest.mark.parametrize("corners", ["keep", "cut"])
@pytest.mark.parametrize("neighbours", [8, 16])
@given(world=worlds)
def test_a_cost_field_is_scipys(neighbours: int, corners: Any, world: World) -> None:
    costs, start, _ = world
    graph = graph_of(costs, 2.0, neighbours, corners)
    source = start.row * costs.shape[1] + start.column
    expected = scipy.sparse.csgraph.dijkstra(graph, indices=source).reshape(costs.shape)
    found = cost_field(costs, start, cell_size_m=2.0, neighbours=neighbours, corners=corners)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), decades=st.sampled_from([0.5, 1, 3, 6]), closed=st.sampled_from([0.0, 0.2]))
def test_large_maps_keep_scikit_images_cost(seed: int, decades: float, closed: float) -> None:
    draw = np.random.default_rng(seed)
    costs = 10 ** (decades * scipy.ndimage.zoom(draw.random((20, 20)), 6, order=1))
    costs[draw.random(costs.shape) < closed] = np.inf
    ends = [Cell(3, 2), Cell(int(draw.integers(120)), 117)]
    for end in ends:
        costs[end] = 1.0
    search = skimage.graph.MCP_Geometric(np.where(np.isfinite(costs), costs, -1.0), fully_connected=True)
    expected = float(search.find_costs([ends[0]])[0][ends[1]])
    for method in METHODS:
        found = shortest_path(costs, *ends, corners="cut", method=method)  # type: ignore[arg-type]
        assert (found.cost if isinstance(found, Path) else math.inf) == pytest.approx(expected, rel=1e-9)


def test_memory_beyond_the_limit_is_refused_before_it_is_taken() -> None:
    cells = np.ones((2000, 2000), dtype=np.float32)
    with pytest.raises(TooLargeError, match=r"more than the 1000000 allowed: about 2\d{5} cells would fit") as refusal:
        shortest_path(cells, (0, 0), (1999, 1999), memory_limit_bytes=1_000_000)
    assert "coarser" in str(refusal.value)
    with pytest.raises(TooLargeError, match="copied first, which takes 32000000 bytes of the 30000000 allowed"):
        shortest_path(cells.astype(np.int32), (0, 0), (1999, 1999), memory_limit_bytes=30_000_000)
    with pytest.raises(TooLargeError, match="more than the 10000000 allowed"):
        cost_field(cells, (0, 0), memory_limit_bytes=10_000_000)
    assert shortest_path(cells, (0, 0), (1999, 1999), memory_limit_bytes=20_000_000)


@pytest.mark.parametrize("search", [partial(shortest_path, goal=(699, 699)), cost_field])
def test_a_search_tells_how_far_it_is_and_stops_when_asked(search: Any) -> None:
    told: list[tuple[str, int, int]] = []
    cells = np.ones((700, 700), dtype=np.bool_)

    def tell(stage: str, done: int, total: int) -> bool:
        told.append((stage, done, total))
        return True

    search(cells, start=(0, 0), on_progress=tell)
    assert [seen[0] for seen in told] == ["route"] * len(told)
    assert 0 < told[-1][1] <= 2 * cells.size
    with pytest.raises(InterruptedBySignalError, match="stopped"):
        search(cells, start=(0, 0), on_progress=lambda *_: False)
    with pytest.raises(ZeroDivisionError):
        search(cells, start=(0, 0), on_progress=lambda *_: 1 / 0)


@pytest.mark.parametrize("closed", [math.nan, math.inf])
@pytest.mark.parametrize(("cell", "end"), [((0, 0), "start"), ((2, 3), "goal")])
def test_a_closed_end_is_a_falsy_answer_that_says_where(closed: float, cell: tuple[int, int], end: str) -> None:
    costs = np.ones((3, 4))
    costs[cell] = closed
    found = shortest_path(costs, (0, 0), (2, 3))
    assert isinstance(found, NoRoute)
    assert not found
    assert found.status == f"{end}_blocked"
    assert found.reason == f"The {end} cell ({cell[0]}, {cell[1]}) is closed."


@pytest.mark.parametrize("method", METHODS)
def test_start_equal_to_goal_is_a_path_of_one_cell(method: Any) -> None:
    assert shortest_path(np.full((2, 2), 7.0), (1, 0), (1, 0), method=method) == Path([Cell(1, 0)], 0.0, 0.0)


@pytest.mark.parametrize("neighbours", [8, 16])
@pytest.mark.parametrize("method", METHODS)
def test_ground_that_costs_nothing_is_crossed_without_a_circle(method: Any, neighbours: int) -> None:
    found = shortest_path(np.zeros((9, 9)), (0, 0), (8, 7), method=method, neighbours=neighbours)
    assert isinstance(found, Path)
    assert found.cost == 0
    assert len(set(found.cells)) == len(found.cells)
    assert all(max(abs(a.row - b.row), abs(a.column - b.column)) <= 2 for a, b in itertools.pairwise(found.cells))


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"cells": [[1.0, -1.0]]}, InvalidParameterError, r"-1 at cell \(0, 1\)"),
        ({"cells": [[-math.inf, 1.0]]}, InvalidParameterError, r"-inf at cell \(0, 0\)"),
        ({"cells": [[math.nan, -2.0]]}, InvalidParameterError, r"-2 at cell \(0, 1\)"),
        ({"cells": [["a", "b"]]}, InvalidParameterError, "do not hold numbers"),
        ({"cells": [[1j, 1.0]]}, InvalidParameterError, "do not hold numbers"),
        ({"cells": [1.0, 1.0]}, ShapeMismatchError, "shape"),
        ({"cells": [[]]}, ShapeMismatchError, "shape"),
        ({"start": (0, 2)}, OutsideGridError, r"\(0, 2\)"),
        ({"goal": (-1, 0)}, OutsideGridError, r"\(-1, 0\)"),
        ({"goal": (0.5, 0)}, InvalidParameterError, "not a cell"),
        ({"goal": (0, 0, 0)}, InvalidParameterError, "not a cell"),
        ({"goal": None}, InvalidParameterError, "not a cell"),
        ({"neighbours": 4}, InvalidParameterError, "4 neighbours"),
        ({"method": "greedy"}, InvalidParameterError, "greedy"),
        ({"corners": "round"}, InvalidParameterError, "round"),
        ({"memory_limit_bytes": -1}, InvalidParameterError, "memory limit of -1"),
        ({"memory_limit_bytes": 1.5}, InvalidParameterError, "memory limit of 1.5"),
        ({"cell_size_m": 0.0}, InvalidParameterError, "cell size"),
        ({"cell_size_m": math.nan}, InvalidParameterError, "cell size"),
    ],
)
@pytest.mark.parametrize("blocked", [False, True])
def test_requests_that_make_no_sense_are_refused_before_any_answer(
    arguments: dict[str, Any], error: type[Exception], named: str, blocked: bool
) -> None:
    request = {"cells": [[math.nan if blocked else 1.0, 1.0]], "start": (0, 0), "goal": (0, 1), **arguments}
    with pytest.raises(error, match=named):
        shortest_path(**request)
