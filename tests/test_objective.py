"""What a way saves: objectives, the user's own costs, reciprocity, and what is refused."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from swathe.errors import InvalidParameterError, ShapeMismatchError, UsageError
from swathe.grid import GridGeometry, Position, distance_transform
from swathe.objective import Objective, as_objective, cost_factor
from swathe.planner import Plan, lazy_astar, plan
from swathe.rank import Region
from swathe.vehicle import load_vehicle
from worlds import smooth_hills

if TYPE_CHECKING:
    from numpy.typing import NDArray

CELL_M = 10.0


def hills(seed: int = 3, side: int = 60, height_m: float = 10.0, vehicle: str = "pioneer-3at") -> Region:
    """Return a region of smooth hills on firm soil."""
    heights = smooth_hills(seed, side, side, height_m=height_m, cell_size_m=CELL_M, wave_m=300.0)
    soil = np.ones(heights.shape, dtype=np.uint8)
    return Region(GridGeometry(side, side, CELL_M), heights, load_vehicle(vehicle), soil)


def between(region: Region, start: tuple[int, int], goal: tuple[int, int], **options: Any) -> Plan:
    """Plan over the whole region from cell to cell."""
    ends = [Position((column + 0.5) * CELL_M, -(row + 0.5) * CELL_M) for row, column in (start, goal)]
    return plan(region, ends[0], ends[1], method="exact", **options)


@given(arrays.arrays(np.bool_, arrays.array_shapes(min_dims=2, max_dims=2, max_side=40)))
def test_distances_are_scipy_s(marks: NDArray[np.bool_]) -> None:
    found = distance_transform(marks, 2.5)
    if marks.any():
        np.testing.assert_allclose(found, scipy.ndimage.distance_transform_edt(~marks) * 2.5, rtol=1e-12)
    else:
        assert np.isinf(found).all()


def test_marks_that_are_none_are_refused() -> None:
    with pytest.raises(ShapeMismatchError):
        distance_transform(np.zeros(3, dtype=bool))
    with pytest.raises(InvalidParameterError, match="booleans"):
        distance_transform(np.zeros((3, 3)))
    for cell_size_m in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InvalidParameterError):
            distance_transform(np.ones((2, 2), dtype=bool), cell_size_m)


def test_the_default_is_the_quickest_way() -> None:
    region = hills()
    plain, named = between(region, (5, 5), (50, 52)), between(region, (5, 5), (50, 52), objective="time")
    assert plain.route is not None
    assert plain.route == named.route
    assert plain.route.cost == pytest.approx(plain.route.time_s, rel=1e-12)


def test_each_objective_saves_what_it_is_about_and_costs_its_weighted_sum() -> None:
    region = hills(1, height_m=25.0, vehicle="tractor")
    found = {}
    for objective in ("time", "energy", "risk", "time=1,energy=2,risk=20"):
        route = between(region, (5, 5), (50, 52), objective=objective).route
        assert route is not None
        weights = as_objective(objective)
        power_w = region.vehicle.power_w
        total = weights.time * route.time_s + weights.energy * route.energy_j / power_w + weights.risk * route.risk_s
        assert route.cost == pytest.approx(total, rel=1e-9)
        for name in ("time_s", "energy_j", "risk_s"):
            assert sum(getattr(leg, name) for leg in route.legs) == pytest.approx(getattr(route, name), rel=1e-9)
        found[objective] = route
    assert found["time"].time_s < found["energy"].time_s
    assert found["energy"].energy_j < 0.97 * found["time"].energy_j
    assert found["time=1,energy=2,risk=20"].risk_s < 0.5 * found["time"].risk_s


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    time=st.floats(0, 5),
    energy=st.floats(0.01, 5),
    risk=st.sampled_from([0.0, 3.0]),
    priced=st.booleans(),
)
def test_the_way_back_costs_the_same_on_reversed_costs(
    seed: int, time: float, energy: float, risk: float, *, priced: bool
) -> None:
    region = hills(seed, 30)
    cost = np.random.default_rng(seed).uniform(0, 3, (30, 30)) if priced else None
    weights = {"time": time, "energy": energy, "risk": risk}
    there = between(region, (4, 3), (26, 25), objective=weights, cost=cost)
    back = between(region, (26, 25), (4, 3), objective=weights, cost=cost, reverse=True)
    assert (there.route is None) == (back.route is None)
    if there.route is not None:
        assert back.path_cost == pytest.approx(there.path_cost, rel=1e-9)
        assert there.cost_lower_bound is not None
        assert there.cost_lower_bound <= there.route.cost * (1 + 1e-9)
        lazy = lazy_astar(region, there.path[0], there.path[-1], objective=weights, cost=cost)
        assert lazy.cost == pytest.approx(there.path_cost, rel=1e-9)


def test_no_objective_breaks_a_limit() -> None:
    region = hills(height_m=20.0)
    vehicle = region.vehicle
    routes = 0
    for objective in ("time", "energy", {"time": 1, "risk": 100}, {"time": 0.01, "energy": 1e6}):
        route = between(region, (5, 5), (50, 52), objective=objective).route
        if route is None:
            continue
        routes += 1
        assert route.grade_max <= vehicle.grade_up + 1e-6
        assert route.grade_min >= -vehicle.grade_down - 1e-6
        assert route.side_slope_max <= vehicle.side_slope + 1e-6
    assert routes in {0, 4}


def test_a_cost_raster_and_the_function_that_makes_it_agree() -> None:
    region = hills(side=300, height_m=20.0)
    raster = np.where(region.elevation_m > 0, 4.0, 1.0)
    raster[140:160, 100:200] = np.nan
    seen = []

    def cost(rows: slice, columns: slice, layers: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
        seen.append((rows.start, rows.stop, columns.start, columns.stop))
        assert set(layers) == {"elevation_m", "slope", "soil"}
        assert layers["slope"].shape == layers["soil"].shape == layers["elevation_m"].shape
        with pytest.raises(ValueError, match="read-only"):
            layers["elevation_m"][0, 0] = 0
        found = np.where(layers["elevation_m"] > 0, 4.0, 1.0)
        closed = raster[rows, columns]
        found[np.isnan(closed)] = math.inf
        return found

    by_array = between(region, (20, 20), (280, 270), cost=raster)
    by_function = between(region, (20, 20), (280, 270), cost=cost)
    assert by_array.route is not None
    assert by_array.route == by_function.route
    assert len(seen) == 4
    assert (256, 300, 0, 256) in seen
    assert by_array.nests is not None
    assert (by_array.nests.labels[140:160, 100:200] == 0).all()
    assert not any(np.isnan(raster[cell]) for cell in by_array.path)
    assert by_array.route.cost > between(region, (20, 20), (280, 270)).route.cost  # type: ignore[union-attr]


def test_a_factor_of_two_doubles_the_cost_and_zero_is_free() -> None:
    region = hills(side=30)
    plain = between(region, (4, 3), (26, 25))
    doubled = between(region, (4, 3), (26, 25), cost=np.full((30, 30), 2, dtype=np.int64))
    free = between(region, (4, 3), (26, 25), cost=np.zeros((30, 30)))
    assert plain.path_cost is not None
    assert plain.cost_lower_bound is not None
    assert doubled.path_cost == pytest.approx(2 * plain.path_cost, rel=1e-12)
    assert doubled.cost_lower_bound == pytest.approx(2 * plain.cost_lower_bound, rel=1e-12)
    assert free.path_cost == 0
    assert free.route is not None
    assert free.route.time_s > 0


@pytest.mark.parametrize("method", ["swarm", "exact"])
def test_a_swarm_follows_objective_and_factor(method: Any) -> None:
    region = hills(side=80, height_m=15.0)
    cost = np.ones((80, 80))
    cost[30:50, 20:60] = 30.0
    ends = [Position(405.0, -105.0), Position(405.0, -695.0)]
    found = plan(region, ends[0], ends[1], method=method, cost=cost, objective={"time": 1, "energy": 1})
    assert found.route is not None
    assert not any(cost[cell] > 1 for cell in found.path)


@pytest.mark.parametrize(
    ("cost", "kind", "text"),
    [
        (np.ones((4, 5)), ShapeMismatchError, "(4, 5)"),
        (np.ones(900), ShapeMismatchError, "(900,)"),
        (np.full((30, 30), np.nan), InvalidParameterError, "every cell"),
        (np.full((30, 30), 1 + 1j), InvalidParameterError, "complex"),
        (np.full((30, 30), "a"), InvalidParameterError, "not numbers"),
        (np.ones((30, 30), dtype=bool), InvalidParameterError, "bool"),
        (np.full((30, 30), -np.inf), InvalidParameterError, "negative"),
        (np.full((30, 30), 1e300), InvalidParameterError, "too large"),
        (np.where(np.arange(900).reshape(30, 30) == 63, -1.0, 1.0), InvalidParameterError, "(2, 3): -1"),
    ],
)
def test_a_cost_raster_that_is_none_is_refused(cost: Any, kind: type[UsageError], text: str) -> None:
    with pytest.raises(kind) as caught:
        between(hills(side=30), (4, 3), (26, 25), cost=cost)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("answer", "kind", "text"),
    [
        (lambda *_: np.ones((2, 2)), ShapeMismatchError, "rows 0 to 29, columns 0 to 29 has the shape (2, 2)"),
        (lambda *_: 1 / 0, InvalidParameterError, "rows 0 to 29, columns 0 to 29: ZeroDivisionError"),
        (lambda *_: None, ShapeMismatchError, "()"),
        (lambda *_: np.full((30, 30), -2.0), InvalidParameterError, "(0, 0): -2"),
        (lambda: 1, InvalidParameterError, "TypeError"),
    ],
)
def test_a_cost_function_that_fails_is_refused_by_its_block(answer: Any, kind: type[UsageError], text: str) -> None:
    with pytest.raises(kind) as caught:
        cost_factor(hills(side=30), answer)
    assert text in str(caught.value)


def test_an_interrupt_inside_a_cost_function_is_no_error_of_it() -> None:
    def cost(*_: object) -> NDArray[np.float64]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cost_factor(hills(side=30), cost)


@pytest.mark.parametrize(
    ("given", "weights"),
    [
        ("time", (1, 0, 0, None)),
        ("energy", (0, 1, 0, None)),
        ("risk", (1, 0, 1, None)),
        ("time=1,energy=0.5", (1, 0.5, 0, None)),
        (" energy = 2 , risk=1e2", (0, 2, 100, None)),
        ({"time": 1, "risk": 4, "risk_distance_m": 25}, (1, 0, 4, 25)),
        (Objective(energy=3), (1, 3, 0, None)),
        ({"energy": np.float32(2)}, (0, 2, 0, None)),
    ],
)
def test_objectives_are_words_or_weights(given: Any, weights: tuple[float, ...]) -> None:
    objective = as_objective(given)
    assert objective.core_argument() == weights
    assert as_objective(objective.text) == objective


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ("fast", "'fast'"),
        ("", "''"),
        ("time=", "'time='"),
        ("time=1,time=2", "'time=2'"),
        ("time=1;energy=2", "time=1;energy=2"),
        ("speed=1", "'speed'"),
        ({"comfort": 1}, "'comfort'"),
        ({"time": "1"}, "'1'"),
        ({"time": True}, "True"),
        ({"time": None}, "None"),
        (7, "7"),
        (None, "None"),
        ("risk=1", "time or energy"),
        ({"time": 0, "energy": 0}, "time or energy"),
        ("time=-1", "-1"),
        ("energy=nan", "NaN"),
        ("time=inf", "inf"),
        ("time=1,risk_distance_m=0", "risk distance"),
        ("time=1,risk_distance_m=1e9", "64 cells"),
    ],
)
def test_objectives_that_mean_nothing_are_refused(given: Any, text: str) -> None:
    with pytest.raises(InvalidParameterError) as caught:
        between(hills(side=30), (4, 3), (26, 25), objective=given)
    assert text in str(caught.value)
