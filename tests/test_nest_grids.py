"""Overlapping grids from Python: what they hold, what a second grid gains, and the picture of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import GridGeometry, Position, Window
from swathe.nest import DIAGONAL_PHASES, HALF_PHASES, OverlappingGrids, gap_share, gaps_found
from swathe.report.figures_grids import SIDES_IN_CELLS, draw_gap_gain, gap_gains
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

GEOMETRY = GridGeometry(40, 50, 1.0, 300.0, 700.0)
MIDDLE = Position(325.0, 680.0)

grounds = st.builds(
    lambda seed, share: np.random.default_rng(seed).random(GEOMETRY.shape) < share,
    seed=st.integers(0, 2**32 - 1),
    share=st.floats(0.9, 1.0),
)


def ranks_of(suitable: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.where(suitable, 8, 1).astype(np.uint8)


def grids_on(suitable: NDArray[np.bool_], **changes: Any) -> OverlappingGrids:
    # A navigation cell measures four terrain cells, and the window holds the whole terrain.
    return OverlappingGrids(ranks_of(suitable), GEOMETRY, MIDDLE, **{"size_m": 1.0, "window_cells": 16, **changes})


@given(grounds)
def test_each_grid_holds_the_blocks_that_are_wholly_suitable(suitable: NDArray[np.bool_]) -> None:
    grids = grids_on(suitable)
    for grid, shift in enumerate((0, 1)):
        geometry = grids.geometry(grid)
        blocks = suitable[shift:, shift:]
        rows, columns = (side // 4 for side in blocks.shape)
        whole = blocks[: rows * 4, : columns * 4].reshape(rows, 4, columns, 4).all(axis=(1, 3))
        row = round((geometry.north_m - (GEOMETRY.north_m - shift)) / 4)
        column = round((GEOMETRY.west_m + shift - geometry.west_m) / 4)
        expected = np.zeros(geometry.shape, dtype=np.bool_)
        expected[row : row + rows, column : column + columns] = whole
        np.testing.assert_array_equal(grids.ranks(grid) >= 6, expected)
        labels, count = scipy.ndimage.label(expected)
        nests = grids.nests(grid)
        assert nests.count == count
        np.testing.assert_array_equal(nests.labels, labels)


@given(grounds, st.floats(300, 350), st.floats(660, 700), st.floats(-4, 4), st.floats(0, 2), st.floats(0, 2))
def test_what_is_navigable_is_suitable_under_the_whole_footprint(
    suitable: NDArray[np.bool_], x_m: float, y_m: float, heading_rad: float, length_m: float, width_m: float
) -> None:
    grids = grids_on(suitable, phases=HALF_PHASES)
    answer = grids.navigable(Position(x_m, y_m), heading_rad=heading_rad, rectangle_m=(length_m, width_m))
    assert answer.navigable == any(answer.grids)
    assert answer.disagreement == (sum(answer.grids) == 1)
    if answer.navigable:
        along, aside = (np.linspace(-side / 2, side / 2, 9) for side in (length_m, width_m))
        for a in along:
            for b in aside:
                point = Position(
                    x_m + a * math.cos(heading_rad) - b * math.sin(heading_rad),
                    y_m + a * math.sin(heading_rad) + b * math.cos(heading_rad),
                )
                cell = GEOMETRY.cell_at(point)
                assert cell is not None
                assert suitable[cell]


def test_a_gap_that_one_grid_misses_is_found_by_the_other() -> None:
    suitable = np.zeros(GEOMETRY.shape, dtype=np.bool_)
    suitable[9:13, 21:25] = True
    grids = grids_on(suitable)
    inside = Position(323.0, 689.0)
    answer = grids.navigable(inside, radius_m=0.5)
    assert answer == (True, (False, True), True)
    assert not grids_on(suitable, mode="and").navigable(inside, radius_m=0.5).navigable
    assert grids_on(suitable, mode="single").navigable(inside, radius_m=0.5) == (False, (False,), False)
    assert len(grids_on(suitable, mode="exact16").phases) == 16
    assert not grids.navigable(inside, radius_m=2.1).navigable


def test_the_size_is_the_vehicle_s_circumscribed_diameter_unless_given() -> None:
    vehicle = load_vehicle("pioneer-3at")
    ranks = np.full(GEOMETRY.shape, 8)
    diameter_m = math.hypot(vehicle.length_m, vehicle.width_m)
    for changes, sizes in (({}, 4), ({"reading": "area"}, 2)):
        grids = OverlappingGrids(ranks, GEOMETRY, MIDDLE, vehicle=vehicle, **changes)  # type: ignore[arg-type]
        assert grids.geometry(0).cell_size_m == pytest.approx(sizes * diameter_m)
    assert OverlappingGrids(ranks, GEOMETRY, MIDDLE, vehicle=vehicle, size_m=0.5).geometry(0).cell_size_m == 2
    assert grids.phases == DIAGONAL_PHASES
    assert grids.geometry(0).shape == (32, 32)
    with pytest.raises(InvalidParameterError, match="size is not known"):
        OverlappingGrids(ranks, GEOMETRY, MIDDLE)


@given(grounds, st.lists(st.tuples(st.floats(280, 370), st.floats(640, 720)), min_size=1, max_size=4))
def test_a_window_that_moved_and_was_refreshed_equals_a_new_one(
    suitable: NDArray[np.bool_], places: list[tuple[float, float]]
) -> None:
    grids = grids_on(suitable, window_cells=6, size_m=0.8)
    for place in places:
        grids.recentre(Position(*place))
    changed = suitable.copy()
    changed[10:14, 20:30] ^= True
    assert grids.refresh(ranks_of(changed), Window(10, 20, 4, 10)) >= 0
    fresh = OverlappingGrids(ranks_of(changed), GEOMETRY, Position(*places[-1]), size_m=0.8, window_cells=6)
    for grid in range(2):
        assert grids.geometry(grid) == fresh.geometry(grid)
        np.testing.assert_array_equal(grids.ranks(grid), fresh.ranks(grid))


def test_joined_nests_connect_over_grids_what_no_grid_connects_alone() -> None:
    suitable = np.zeros(GEOMETRY.shape, dtype=np.bool_)
    suitable[8:12, 20:24] = suitable[9:13, 21:25] = True
    plain, moved = grids_on(suitable).joined_nests()
    assert sorted(np.unique(plain)) == sorted(np.unique(moved)) == [0, 1]
    apart = np.zeros(GEOMETRY.shape, dtype=np.bool_)
    apart[8:12, 20:24] = apart[25:29, 33:37] = True
    plain, moved = grids_on(apart).joined_nests()
    assert {*np.unique(plain), *np.unique(moved)} == {0, 1, 2}


def test_the_first_grid_alone_finds_a_quarter_of_pockets_of_one_and_a_half_cells_and_two_find_more() -> None:
    assert gap_share("pocket", 1.25, mode="single") == pytest.approx(0.0625)
    assert gap_share("pocket", 1.25) == pytest.approx(0.125)
    assert gap_share("pocket", 1.5) == pytest.approx(0.4375)
    assert gap_share("pocket", 1.5, phases=HALF_PHASES) == pytest.approx(1)
    assert gap_share("corridor", 1.75) == pytest.approx(1)
    one, two = (gaps_found("pocket", 1.5, mode=mode, trials=2000) / 2000 for mode in ("single", "or"))
    assert one == pytest.approx(0.25, abs=0.04)
    assert two == pytest.approx(0.4375, abs=0.045)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"size_m": 0.0}, "robot size"),
        ({"size_m": math.nan}, "robot size"),
        ({"reading": "volume"}, "reading"),
        ({"mode": "xor"}, "mode"),
        ({"phases": []}, "number of phases"),
        ({"phases": [(0.0, 1.0)]}, "phase of 1"),
        ({"window_cells": 1}, "window"),
        ({"window_cells": -1}, "window"),
        ({"rank_min": 1}, "rank of 1"),
    ],
)
def test_parameters_that_no_grid_has_are_refused(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidParameterError, match=named):
        grids_on(np.ones(GEOMETRY.shape, dtype=np.bool_), **changes)


def test_questions_that_make_no_sense_are_refused() -> None:
    grids = grids_on(np.ones(GEOMETRY.shape, dtype=np.bool_))
    for footprint in ({}, {"radius_m": 1.0, "rectangle_m": (1.0, 1.0)}, {"radius_m": -1.0}, {"radius_m": math.nan}):
        with pytest.raises(InvalidParameterError, match="footprint"):
            grids.navigable(MIDDLE, **footprint)
    assert not grids.navigable(Position(math.nan, 0.0), radius_m=1.0).navigable
    with pytest.raises(InvalidParameterError, match="position"):
        grids.recentre(Position(math.inf, 0.0))
    for grid in (-1, 2):
        for question in (grids.geometry, grids.ranks, grids.nests):
            with pytest.raises(InvalidParameterError, match="no grid"):
                question(grid)
    with pytest.raises(ShapeMismatchError, match="rank map"):
        grids.refresh(np.ones((3, 3)), Window(0, 0, 1, 1))
    with pytest.raises(InvalidParameterError, match="rank of 11"):
        grids.refresh(np.full(GEOMETRY.shape, 11), Window(0, 0, 1, 1))
    with pytest.raises(InvalidParameterError, match="window"):
        grids.refresh(np.ones(GEOMETRY.shape), Window(0, 0, -1, 1))
    for arguments in ({"trials": 0}, {"trials": 10**7}, {"seed": -1}, {"phases": ()}, {"mode": "nor"}):
        with pytest.raises(InvalidParameterError):
            gaps_found("pocket", 1.5, **arguments)
    for side in (0.0, 2.5, math.nan):
        with pytest.raises(InvalidParameterError, match="gap"):
            gap_share("pocket", side)


def test_counted_gaps_lie_near_the_exact_curve() -> None:
    for gain in gap_gains("pocket", trials=400):
        exact = np.interp(SIDES_IN_CELLS, gain.exact_sides, gain.exact)
        assert np.abs(np.array(gain.counted) - exact).max() < 0.1
        assert (np.diff(gain.exact) >= -1e-12).all()


def test_the_picture_of_the_gain_is_drawn_alike_each_time(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        draw_gap_gain(tmp_path / name, trials=50, metadata={"Title": "gain"})
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.text["Title"] == "gain"  # type: ignore[attr-defined]
        assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 50
    with pytest.raises(InvalidParameterError, match="trials"):
        draw_gap_gain(tmp_path / "c.png", trials=0)
