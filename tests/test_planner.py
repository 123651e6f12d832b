"""The laws that every planned route keeps."""

from __future__ import annotations

import itertools
import math
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import scipy.ndimage
import scipy.sparse
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from swathe.corridor import CorridorParams
from swathe.errors import (
    InterruptedBySignalError,
    InvalidParameterError,
)
from swathe.grid import Cell, Position
from swathe.nest import NestParams, outlines
from swathe.planner import Plan, Route, plan
from swathe.rank import RankParams, rank_cell
from swathe.swarm import SwarmParams
from swathe.vehicle import load_vehicle
from worlds import (
    EAST_SIDE,
    HILL_CELL_M,
    WEST_SIDE,
    Driven,
    changed,
    closed_zone,
    ends_of,
    flat_region,
    grades_along,
    region_of,
    region_of_mask,
    smooth_hills,
    steep_hills,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

DRIVEN = [{"seed": seed, "method": method} for seed in (1, 8, 10) for method in ("swarm", "exact")]
# Within a cell the ground bends by about a hundredth of grade at half a cell's distance on these hills.
BEND = 0.03


@pytest.fixture(scope="module", params=DRIVEN, ids=lambda options: f"{options['method']}-{options['seed']}")
def driven(request: pytest.FixtureRequest) -> Driven:
    return Driven(**request.param)


def test_a_route_keeps_the_limits_where_the_straight_line_does_not(driven: Driven) -> None:
    vehicle = driven.region.vehicle
    for leg in driven.route.legs:
        along, across = grades_along(driven, leg.start, leg.end)
        assert along.max() <= vehicle.grade_up + BEND
        assert along.min() >= -vehicle.grade_down - BEND
        assert np.abs(across).max() <= vehicle.side_slope + BEND
        assert leg.grade_max == pytest.approx(along.max(), abs=BEND)
        assert leg.grade_min == pytest.approx(along.min(), abs=BEND)
        assert leg.side_slope_max == pytest.approx(np.abs(across).max(), abs=2 * BEND)
        assert leg.grade_max <= vehicle.grade_up * (1 + 1e-6)
        assert leg.grade_min >= -vehicle.grade_down * (1 + 1e-6)
        assert leg.side_slope_max <= vehicle.side_slope * (1 + 1e-6)
    along, across = grades_along(driven, driven.start, driven.goal)
    straight_breaks = max(
        along.max() - vehicle.grade_up, -along.min() - vehicle.grade_down, np.abs(across).max() - vehicle.side_slope
    )
    assert straight_breaks > BEND


def test_a_route_and_the_vehicle_around_it_stay_in_the_nest(driven: Driven) -> None:
    nests = driven.answer.nests
    assert nests is not None
    label = nests.labels[driven.region.geometry.cell_at(driven.start) or (0, 0)]
    polygons = [
        shapely.Polygon(outline.exterior, outline.holes)
        for outline in outlines(nests, driven.region.geometry)
        if outline.nest == label
    ]
    nest = shapely.union_all(polygons)
    for leg in driven.route.legs:
        swept = shapely.LineString([leg.start, leg.end]).buffer(0.99 * driven.region.vehicle.circumscribed_radius_m)
        assert nest.covers(swept)
    assert all(nests.labels[cell] == label for cell in driven.answer.path)


def test_the_total_is_the_sum_of_the_legs(driven: Driven) -> None:
    route = driven.route
    for name in ("length_m", "time_s", "cost", "energy_j", "climb_m", "descent_m", "bridged_m"):
        assert getattr(route, name) == pytest.approx(sum(getattr(leg, name) for leg in route.legs)), name
    assert route.grade_max == max(leg.grade_max for leg in route.legs)
    assert route.grade_min == min(leg.grade_min for leg in route.legs)
    assert route.side_slope_max == max(leg.side_slope_max for leg in route.legs)
    assert {field.name for field in fields(Route)} - {"legs"} <= {field.name for field in fields(route.legs[0])}


def test_legs_follow_each_other_and_their_figures_fit(driven: Driven) -> None:
    route, vehicle = driven.route, driven.region.vehicle
    assert route.xy_m[0].tolist() == list(driven.start)
    assert route.xy_m[-1].tolist() == list(driven.goal)
    assert all(a.end == b.start for a, b in itertools.pairwise(route.legs))
    for leg in route.legs:
        assert leg.length_m >= math.dist(leg.start, leg.end) - 1e-6
        assert leg.time_s >= leg.length_m / vehicle.max_speed_mps - 1e-6
        assert leg.cost == pytest.approx(leg.time_s)
        assert leg.energy_j > 0
        assert 6 <= leg.rank_min <= 10
        assert leg.soil == "unknown"
        assert leg.reason
        rise_m = np.diff(driven.heights_m(np.asarray([leg.start, leg.end])))[0]
        assert leg.climb_m - leg.descent_m == pytest.approx(rise_m, abs=0.01)
    assert route.legs[-1].reason.endswith("reaches the goal")


def test_shortcuts_never_cost_more_than_the_way_over_cells_and_nothing_less_than_the_bound(driven: Driven) -> None:
    answer = driven.answer
    assert answer.path_cost is not None
    assert answer.cost_lower_bound is not None
    assert driven.route.cost <= answer.path_cost * (1 + 1e-9)
    direct_s = math.dist(driven.start, driven.goal) / driven.region.vehicle.max_speed_mps
    assert answer.cost_lower_bound == pytest.approx(direct_s)
    assert answer.cost_lower_bound <= driven.route.cost
    assert (answer.start, answer.goal) == ((driven.start, 0.0), (driven.goal, 0.0))


@pytest.mark.parametrize("seed", range(1, 9))
def test_a_certified_swarm_finds_the_cost_of_the_exact_method(seed: int) -> None:
    region = steep_hills(seed)
    start, goal = ends_of(region, 100 + seed)
    exact = plan(region, start, goal, method="exact")
    swarm = plan(region, start, goal, certify=True)
    plain = plan(region, start, goal)
    assert exact.path_cost is not None
    assert (exact.optimal, swarm.optimal) == (True, True)
    assert swarm.path_cost == pytest.approx(exact.path_cost, rel=1e-9)
    assert plain.path_cost is not None
    assert plain.path_cost >= exact.path_cost * (1 - 1e-9)


@pytest.mark.parametrize("arc", ["line", "circle", "spine"])
@pytest.mark.parametrize("seed", range(1, 7))
def test_a_certificate_on_part_of_the_map_holds_for_all_of_it(seed: int, arc: Any) -> None:
    draw = np.random.default_rng(seed)
    gentle = smooth_hills(seed, 70, 90, height_m=20, cell_size_m=HILL_CELL_M, wave_m=1400)
    zones = scipy.ndimage.binary_dilation(draw.random(gentle.shape) < 0.01, np.ones((3, 3)))
    zones[30:40, 10:14] = zones[30:40, 70:74] = False
    region = region_of(gentle, HILL_CELL_M, zones=zones)
    start, goal = (region.geometry.position_of(Cell(35, column)) for column in (12, 72))
    exact = plan(region, start, goal, method="exact")
    swarm = plan(region, start, goal, certify=True, corridor=CorridorParams(arc=arc, width_m=240.0))
    assert exact.path_cost is not None
    assert swarm.optimal
    assert swarm.corridor is not None
    assert not swarm.corridor.cells(region.geometry).all()
    assert swarm.path_cost == pytest.approx(exact.path_cost, rel=1e-9)


def test_a_gap_half_inside_the_swathe_is_no_reason_for_a_certificate() -> None:
    # The best way leads through the upper gap, one of whose three rows lies outside the swathe.
    zones = np.zeros((60, 61), dtype=np.bool_)
    zones[:29, 30] = zones[28, 20:31] = zones[28:, 20] = True
    zones[18:21, 30] = zones[39:42, 20] = False
    region = region_of(np.zeros(zones.shape, dtype=np.float32), 10.0, vehicle="pioneer-3at", zones=zones)
    start, goal = (region.geometry.position_of(Cell(30, column)) for column in (10, 50))
    exact = plan(region, start, goal, method="exact")
    swarm = plan(region, start, goal, certify=True, corridor=CorridorParams(arc="line", width_m=230.0))
    assert exact.path_cost is not None
    assert swarm.optimal
    assert swarm.path_cost == pytest.approx(exact.path_cost, rel=1e-9)


def test_the_edge_of_a_map_that_continues_limits_what_can_be_certified() -> None:
    region = steep_hills(2)
    start, goal = ends_of(region, 2)
    assert not plan(region, start, goal, method="exact", map_continues=True).optimal


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), row=st.integers(0, 69), column=st.integers(0, 89))
def test_a_closed_zone_never_lowers_the_cost(seed: int, row: int, column: int) -> None:
    region = steep_hills(seed % 3)
    start, goal = ends_of(region, seed)
    zones = np.zeros(region.geometry.shape, dtype=np.bool_)
    zones[row : row + 12, column : column + 12] = True
    before = plan(region, start, goal, method="exact")
    after = plan(replace(region, zones=zones), start, goal, method="exact")
    assert before.path_cost is not None
    if after.start == before.start and after.goal == before.goal and after.path_cost is not None:
        assert after.path_cost >= before.path_cost * (1 - 1e-9)
    assert not any(zones[cell] for cell in after.path)


def test_uphill_is_slower_than_downhill_for_a_weak_vehicle() -> None:
    ramp = np.asarray(np.tile(np.arange(60) * HILL_CELL_M * 0.1, (20, 1)), dtype=np.float32)
    weak = changed(load_vehicle("tractor"), power_w=6000.0)
    region = region_of(ramp, HILL_CELL_M, vehicle=weak)
    low, high = (region.geometry.position_of(Cell(10, column)) for column in (5, 50))
    up, down = plan(region, low, high, method="exact"), plan(region, high, low, method="exact")
    assert up.route is not None
    assert down.route is not None
    assert up.route.time_s > 1.5 * down.route.time_s
    assert up.route.length_m == pytest.approx(down.route.length_m)
    assert (up.route.climb_m, up.route.descent_m) == pytest.approx((down.route.descent_m, down.route.climb_m), abs=1e-3)
    assert up.route.climb_m == pytest.approx(45 * HILL_CELL_M * 0.1, abs=0.01)
    assert up.route.energy_j > down.route.energy_j
    # Speed is drive power over weight times (rolling resistance + grade) in level and steep parts alike.
    strong = plan(region_of(ramp, HILL_CELL_M), low, high, method="exact")
    assert strong.route is not None
    assert strong.route.time_s < up.route.time_s


def test_start_equal_to_goal_is_a_route_of_no_length() -> None:
    region = region_of(np.zeros((20, 20), dtype=np.float32), HILL_CELL_M)
    place = Position(1311.0, 8707.0)
    for method in ("swarm", "exact"):
        answer = plan(region, place, place, method=method)
        assert answer.status == "route_found"
        assert answer.route is not None
        assert (answer.route.legs, answer.route.length_m, answer.route.xy_m.shape) == ((), 0.0, (0, 2))


def drowned() -> NDArray[np.uint8]:
    soil = np.ones((30, 40), dtype=np.uint8)
    soil[:, 18:22] = 6
    return soil


def chasm() -> NDArray[np.float32]:
    elevation = np.zeros((30, 40), dtype=np.float32)
    elevation[:, 20:] = 40
    return elevation


def unknown_around(cell: Cell) -> NDArray[np.float32]:
    elevation = np.zeros((30, 40), dtype=np.float32)
    elevation[cell.row - 4 : cell.row + 5, cell.column - 4 : cell.column + 5] = np.nan
    return elevation


#: Regions without a way from west to east: status, words of the reason, columns in which the place lies.
REFUSALS: dict[str, tuple[dict[str, Any], str, str, tuple[int, int]]] = {
    "river": ({"soil": drowned()}, "no_route", "water or peat", (18, 21)),
    "cliff": ({"elevation": chasm()}, "no_route", "too steep", (18, 21)),
    "zone": ({"zones": closed_zone(slice(None), slice(18, 22))}, "no_route", "a closed zone", (18, 21)),
    "start in a zone": ({"zones": closed_zone(slice(8, 22), slice(0, 12))}, "start_blocked", "a closed zone", (5, 5)),
    "goal in a zone": ({"zones": closed_zone(slice(8, 22), slice(28, 40))}, "goal_blocked", "a closed zone", (34, 34)),
    "start unknown": ({"elevation": unknown_around(Cell(15, 5))}, "start_blocked", "unknown elevation", (5, 5)),
}


@pytest.mark.parametrize("method", ["swarm", "exact"])
@pytest.mark.parametrize("name", REFUSALS)
def test_refusals_say_what_where_and_what_would_help(name: str, method: Any) -> None:
    layers, status, words, (first, last) = REFUSALS[name]
    region = flat_region(**layers)
    answer = plan(region, WEST_SIDE, EAST_SIDE, method=method)
    assert answer.status == status
    assert answer.route is None
    assert answer.path == []
    assert answer.reason is not None
    assert words in answer.reason
    assert answer.remedy
    assert answer.place is not None
    cell = region.geometry.cell_at(answer.place)
    assert cell is not None
    assert first <= cell.column <= last
    assert rank_cell(region, cell)[0] < 6
    assert not answer.optimal


@pytest.mark.parametrize("method", ["swarm", "exact"])
@pytest.mark.parametrize(
    ("start", "goal", "named"),
    [
        (Position(900.0, 8850.0), EAST_SIDE, "start lies 100 m outside"),
        (WEST_SIDE, Position(1430.0, 8660.0), "goal lies 50 m outside"),
    ],
)
def test_places_outside_the_map_are_an_answer(start: Position, goal: Position, named: str, method: Any) -> None:
    answer = plan(flat_region(), start, goal, method=method)
    assert answer.status == "outside_map"
    assert answer.reason is not None
    assert named in answer.reason
    assert answer.place in (start, goal)


def test_ends_beside_a_nest_are_moved_into_it_and_the_distance_is_said() -> None:
    zones = closed_zone(slice(14, 17), slice(4, 7))
    answer = plan(flat_region(zones=zones), WEST_SIDE, EAST_SIDE, method="exact")
    assert answer.status == "route_found"
    assert answer.start is not None
    assert answer.nests is not None
    place, away_m = answer.start
    assert away_m == pytest.approx(math.dist(place, WEST_SIDE))
    assert away_m == 20.0
    assert answer.route is not None
    assert answer.route.xy_m[0].tolist() == list(place)


def narrow_pass() -> NDArray[np.bool_]:
    zones = closed_zone(slice(None), slice(18, 22))
    zones[15, :] = False
    return zones


@pytest.mark.parametrize("method", ["swarm", "exact"])
def test_a_bridge_leaves_the_nests_at_three_times_the_cost_and_only_when_nothing_else_connects(method: Any) -> None:
    # One cell wide: suitable, but no nest of 3 x 3.
    region = flat_region(zones=narrow_pass())
    assert plan(region, WEST_SIDE, EAST_SIDE, method=method).status == "no_route"
    answer = plan(region, WEST_SIDE, EAST_SIDE, method=method, bridge=True)
    assert answer.route is not None
    assert answer.route.bridged_m == pytest.approx(40.0, abs=20.0)
    speed = answer.route.length_m / answer.route.time_s
    assert answer.route.cost == pytest.approx(answer.route.time_s + 2 * answer.route.bridged_m / speed, rel=0.02)
    assert any("leaves the nests" in leg.reason for leg in answer.route.legs)
    assert not answer.optimal
    around = flat_region(zones=narrow_pass() & ~closed_zone(slice(25, 30), slice(18, 22)))
    kept = plan(around, WEST_SIDE, EAST_SIDE, method=method, bridge=True)
    assert kept.route is not None
    assert kept.route.bridged_m == 0
    assert kept.route.length_m > answer.route.length_m


def other_than(last: str, stage: str, _done: int, _total: int) -> bool:
    return stage != last


def test_a_report_is_told_the_stages_and_can_stop_the_plan() -> None:
    region = steep_hills(1)
    start, goal = ends_of(region, 1)
    stages: list[str] = []

    def told(stage: str, _done: int, _total: int) -> bool:
        stages.append(stage)
        return True

    assert plan(region, start, goal, on_progress=told).status == "route_found"
    assert list(dict.fromkeys(stages)) == ["corridor", "regions", "route"]
    for stage in ("corridor", "regions", "route"):
        with pytest.raises(InterruptedBySignalError, match="stopped"):
            plan(region, start, goal, on_progress=partial(other_than, stage))


def bytes_of(answer: Plan) -> tuple[Any, ...]:
    assert answer.nests is not None
    assert answer.corridor is not None
    return (answer.route, answer.path, answer.swarm, answer.nests.labels.tobytes(), answer.corridor.arc_xy_m.tobytes())


def test_the_same_seed_gives_the_same_plan() -> None:
    region = steep_hills(3)
    start, goal = ends_of(region, 3)
    params = SwarmParams(agents=5000, seed=7)
    first, again = (plan(region, start, goal, swarm=params) for _ in range(2))
    assert bytes_of(first) == bytes_of(again)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"start": (math.nan, 0.0)}, "start"),
        ({"goal": (0.0, math.inf)}, "goal"),
        ({"method": "guess"}, "guess"),
        ({"corridor": CorridorParams(width_m=-1.0)}, "width"),
        ({"swarm": SwarmParams(teleport=2.0)}, "deployment"),
        ({"swarm": SwarmParams(nest=NestParams(vicinity="disk:99"))}, "vicinity"),
    ],
)
def test_plans_that_make_no_sense_are_refused(options: dict[str, Any], named: str) -> None:
    request = {"start": WEST_SIDE, "goal": EAST_SIDE, **options}
    with pytest.raises(InvalidParameterError, match=named):
        plan(flat_region(), request.pop("start"), request.pop("goal"), **request)


def test_nest_parameters_of_the_swarm_hold_for_the_exact_method_too() -> None:
    region = region_of_mask(~narrow_pass())
    params = SwarmParams(nest=NestParams(vicinity="cell"))
    for method in ("swarm", "exact"):
        answer = plan(region, WEST_SIDE, EAST_SIDE, method=method, swarm=params)
        assert answer.status == "route_found"
        assert answer.route is not None
        assert answer.route.bridged_m == 0


def test_the_literal_profile_plans_by_rank_7_unless_told_otherwise() -> None:
    grey = np.full((30, 40), 20.0, dtype=np.float32)
    rock = np.full((30, 40), 5, dtype=np.uint8)
    for profile, status in (("paper", "route_found"), ("literal", "start_blocked")):
        region = flat_region(grey=grey, soil=rock, params=RankParams(profile=profile))  # type: ignore[arg-type]
        assert plan(region, WEST_SIDE, EAST_SIDE).status == status
