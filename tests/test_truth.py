"""The truth behind a scenario: what is put into the world, where, and that it follows from the seed alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.belief import units_of_classes
from swathe.errors import OutsideGridError
from swathe.grid import GridGeometry
from swathe.io.generated import generated_soil
from swathe.random import uniform
from swathe.scenario import Scenario, load_scenario, scenario_of
from swathe.soil import SoilClass
from swathe.truth import Route, crates, disc, hollows, mistaken, true_world

GEOMETRY = GridGeometry(60, 80, 1.0, 100.0, 260.0)
FLAT = np.zeros(GEOMETRY.shape, dtype=np.float32)
SAND = np.full(GEOMETRY.shape, SoilClass.SAND, dtype=np.uint8)
ROUTE = Route(np.array([(105.0, 205.0), (135.0, 205.0), (135.0, 245.0)]))


def scenario(**parts: object) -> Scenario:
    drive = {"start": (0, 0), "goal": (1, 1)}
    return scenario_of({"terrain": {"dem": ["x"]}, "drive": drive, **parts}, "it")


def test_places_along_a_route_lie_on_it_and_left_is_left() -> None:
    assert ROUTE.length_m == 70
    assert ROUTE.place(0, 0) == (105, 205, 0)
    assert ROUTE.place(15 / 70, 2) == pytest.approx((120, 207, 0))
    x_m, y_m, heading_rad = ROUTE.place(50 / 70, 3)
    assert (x_m, y_m, heading_rad) == pytest.approx((132, 225, math.pi / 2))
    assert ROUTE.place(1, 0)[:2] == pytest.approx((135, 245))


def test_a_patch_of_the_truth_changes_the_soil_under_it_and_no_other() -> None:
    wrong = scenario(truth={"patches": [{"soil": "clay", "radius_m": 5, "along": 0.5}]})
    world = true_world(wrong, GEOMETRY, FLAT, SAND, ROUTE)
    x_m, y_m, _ = ROUTE.place(0.5, 0)
    inside = disc(GEOMETRY, x_m, y_m, 5)
    assert 70 < inside.sum() < 90  # pi r^2 is 78.5
    assert (world.soil[inside] == SoilClass.CLAY).all()
    assert (world.soil[~inside] == SoilClass.SAND).all()


def test_a_small_disc_holds_at_least_its_own_cell() -> None:
    assert disc(GEOMETRY, 110.9, 230.1, 0.01).sum() == 1
    assert disc(GEOMETRY, 110.9, 230.1, 0.01)[29, 10]


def test_unknown_soil_is_sand_in_truth_and_no_soil_map_too() -> None:
    soil = SAND.copy()
    soil[:10] = SoilClass.UNKNOWN
    soil[10:20] = SoilClass.NONE
    world = true_world(scenario(), GEOMETRY, FLAT, soil, ROUTE)
    assert (world.soil[:10] == SoilClass.SAND).all()
    assert (world.soil[10:20] == SoilClass.NONE).all()
    assert (true_world(scenario(), GEOMETRY, FLAT, None, ROUTE).soil == SoilClass.SAND).all()


def test_soil_errors_change_about_the_share_that_was_asked_for() -> None:
    geometry = GridGeometry(400, 400, 1.0, 0.0, 400.0)
    flat, sand = np.zeros(geometry.shape, np.float32), np.full(geometry.shape, SoilClass.SAND, np.uint8)
    route = Route(np.array([(5.0, 5.0), (395.0, 395.0)]))
    wrong = scenario(truth={"soil_error": 0.3, "patch_m": 10.0})
    changed = (true_world(wrong, geometry, flat, sand, route).soil != SoilClass.SAND).mean()
    assert 0.2 < changed < 0.4
    again = true_world(wrong, geometry, flat, sand, route).soil
    np.testing.assert_array_equal(again, true_world(wrong, geometry, flat, sand, route).soil)
    other = true_world(wrong, geometry, flat, sand, route, seed=1).soil
    assert (other != again).any()


@given(seed=st.integers(0, 2**64 - 1), count=st.integers(0, 60), spread=st.floats(0.1, 12))
def test_crates_keep_clear_of_the_ends_and_near_the_route(seed: int, count: int, spread: float) -> None:
    wanted = scenario(obstacles={"crates": count, "spread_m": spread, "clear_m": 4.0, "crate_m": (0.5, 1.0)})
    found = crates(wanted.obstacles, GEOMETRY, ROUTE, seed)
    assert len(found) <= count
    for box in found:
        for end in ROUTE.points_m[[0, -1]]:
            assert math.hypot(box.x_m - end[0], box.y_m - end[1]) >= 4
        to_route = min(
            math.hypot(box.x_m - x, box.y_m - y) for x, y, _ in (ROUTE.place(k / 500, 0) for k in range(501))
        )
        assert to_route <= spread + 0.1
        assert 0.5 <= box.length_m <= 1.0
        assert 0.5 <= box.width_m <= 1.0


def test_more_crates_begin_with_the_same_ones() -> None:
    few, many = (crates(scenario(obstacles={"crates": count}).obstacles, GEOMETRY, ROUTE, 3) for count in (5, 25))
    assert many[:5] == few


def test_boxes_walls_movers_and_ditches_stand_where_they_were_put() -> None:
    full = scenario(
        obstacles={
            "boxes": [{"along": 0.2, "offset_m": 3.0, "length_m": 2.0, "width_m": 1.0}, {"x_m": 150, "y_m": 240}],
            "walls": [{"points": [(110, 230), (120, 230)]}],
            "movers": [{"path": [(140, 210), (150, 210)], "speed_mps": 1.0}],
            "ditches": [{"line": [(102, 250), (178, 250)], "width_m": 2.0, "depth_m": 1.5}],
        }
    )
    world = true_world(full, GEOMETRY, FLAT, SAND, ROUTE)
    assert len(world.obstacles) == 3
    assert world.movers_at(4.0)[0].x_m == pytest.approx(144)
    assert world.height_m(140, 250) == pytest.approx(-1.5, abs=0.01)
    with pytest.raises(OutsideGridError, match="A box"):
        true_world(scenario(obstacles={"boxes": [{"x_m": 0, "y_m": 0}]}), GEOMETRY, FLAT, SAND, ROUTE)


def test_draws_are_even_and_a_longer_draw_begins_with_a_shorter_one() -> None:
    long = uniform(7, 3, 4000)
    np.testing.assert_array_equal(uniform(7, 3, 10), long[:10])
    assert (long >= 0).all()
    assert (long < 1).all()
    counts = np.histogram(long, 10, (0, 1))[0]
    assert (abs(counts - 400) < 90).all()
    assert not np.array_equal(uniform(8, 3, 10), long[:10])
    assert not np.array_equal(uniform(7, 4, 10), long[:10])


@given(seed=st.integers(0, 2**32), count=st.integers(0, 12), clear_m=st.floats(0, 20))
def test_hollows_are_soft_in_the_middle_and_clear_of_the_ends(seed: int, count: int, clear_m: float) -> None:
    asked = scenario(truth={"hollows": count, "hollow_m": [8, 4], "clear_m": clear_m}, seed=seed)
    dug = hollows(asked.truth, GEOMETRY, SAND, ROUTE, seed)
    assert len(dug) <= count
    soil = true_world(asked, GEOMETRY, FLAT, SAND, ROUTE).soil
    wet = np.zeros(GEOMETRY.shape, dtype=bool)
    for x_m, y_m, radius_m in dug:
        assert 4 <= radius_m <= 8
        for end_x_m, end_y_m in ROUTE.points_m[[0, -1]]:
            assert math.hypot(x_m - end_x_m, y_m - end_y_m) >= radius_m + clear_m
        assert (soil[disc(GEOMETRY, x_m, y_m, radius_m / 2)] == SoilClass.CLAY).all()
        wet |= disc(GEOMETRY, x_m, y_m, radius_m)
    assert (np.isin(soil, [SoilClass.SILT, SoilClass.CLAY]) == wet).all()
    assert (soil[~wet] == SoilClass.SAND).all()


def test_hollows_follow_from_the_seed() -> None:
    asked = scenario(truth={"hollows": 5, "hollow_m": [4, 8]}).truth
    assert hollows(asked, GEOMETRY, SAND, ROUTE, 3) == hollows(asked, GEOMETRY, SAND, ROUTE, 3)
    assert hollows(asked, GEOMETRY, SAND, ROUTE, 3) != hollows(asked, GEOMETRY, SAND, ROUTE, 4)


def test_hollows_lie_on_the_soil_that_hides_them() -> None:
    soil = SAND.copy()
    soil[:, :40] = SoilClass.GRAVEL
    dug = hollows(scenario(truth={"hollows": 30, "hollow_m": [4, 8]}).truth, GEOMETRY, soil, ROUTE, 1)
    assert len(dug) > 10
    assert all(x_m >= 140 for x_m, _, _ in dug)


def test_polygons_are_wrong_as_wholes_but_those_of_the_ends() -> None:
    truth = load_scenario("wrong-soil").truth
    geometry = GridGeometry(320, 320, 1.0, 0.0, 320.0)
    soil = generated_soil("fields")
    route = Route(np.array([(20.0, 30.0), (300.0, 290.0)]))
    layer, units = units_of_classes(soil)
    wrong = 0
    for seed in range(20):
        true = mistaken(truth, geometry, soil, route, seed)
        changed = {number for number in units if (true != soil)[layer == number].any()}
        for number in changed:
            assert len(np.unique(true[layer == number])) == 1
        assert not changed & {int(layer[290, 20]), int(layer[30, 300])}
        wrong += len(changed)
    # Four in ten, but for those of the ends.
    assert 0.3 < wrong / (20 * len(units)) < 0.45
