"""The arc and the swathe around it, as the planner lays them and as the mirror draws them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from swathe import _core
from swathe.corridor import Corridor, CorridorParams
from swathe.errors import InvalidParameterError
from swathe.grid import Cell, GridGeometry, Position
from swathe.planner import Plan, plan
from worlds import region_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

GEOMETRY = GridGeometry(40, 60, 10.0, 1000.0, 9000.0)
START, GOAL = GEOMETRY.position_of(Cell(30, 8)), GEOMETRY.position_of(Cell(10, 50))
LEVEL = np.zeros(GEOMETRY.shape, dtype=np.float32)


def within(geometry: GridGeometry, arc_xy_m: NDArray[np.float64], reach_m: float) -> NDArray[np.bool_]:
    """Return the cells whose centre is within reach of an arc, by shapely."""
    row, column = np.indices(geometry.shape)
    x_m = geometry.west_m + (column + 0.5) * geometry.cell_size_m
    y_m = geometry.north_m - (row + 0.5) * geometry.cell_size_m
    arc = shapely.LineString(arc_xy_m) if len(arc_xy_m) > 1 else shapely.Point(arc_xy_m[0])
    near: NDArray[np.bool_] = shapely.distance(arc, shapely.points(x_m, y_m)) <= reach_m
    return near


points = st.tuples(st.integers(950, 1650), st.integers(8550, 9050))


@given(arc=st.lists(points, min_size=1, max_size=5, unique=True), width_m=st.integers(1, 900))
def test_the_swathe_is_what_lies_within_half_its_width_of_the_arc(arc: list[tuple[int, int]], width_m: int) -> None:
    xy_m = np.asarray(arc, dtype=np.float64)
    cells = Corridor(xy_m, float(width_m)).cells(GEOMETRY)
    least = within(GEOMETRY, xy_m, width_m / 2 - 1e-6)
    most = within(GEOMETRY, xy_m, width_m / 2 + 1e-6)
    assert (least <= cells).all()
    assert (cells <= most).all()


def test_cells_exactly_at_half_the_width_belong_to_the_swathe_on_all_sides() -> None:
    xy_m = np.asarray([GEOMETRY.position_of(Cell(20, 20)), GEOMETRY.position_of(Cell(20, 40))], dtype=np.float64)
    cells = Corridor(xy_m, 60.0).cells(GEOMETRY)
    assert cells[17:24, 30].all()
    assert (cells[20, 17], cells[20, 43]) == (True, True)
    assert not cells[[16, 24], 30].any()


def lay(arc: Any, width_m: float | None = None, sagitta_m: float | None = None) -> Plan:
    params = CorridorParams(arc=arc, width_m=width_m, sagitta_m=sagitta_m)
    return plan(region_of(LEVEL, 10.0), START, GOAL, corridor=params)


@pytest.mark.parametrize("sagitta_m", [None, 60.0, -60.0, 300.0, 0.0])
def test_the_circle_rises_by_its_sagitta_to_the_left_of_the_chord(sagitta_m: float | None) -> None:
    corridor = lay("circle", 80.0, sagitta_m).corridor
    assert corridor is not None
    chord_m = math.dist(START, GOAL)
    height_m = _core.defaults()["sagitta_share"] * chord_m if sagitta_m is None else sagitta_m
    assert corridor.sagitta_m == pytest.approx(height_m)
    along = np.subtract(GOAL, START) / chord_m
    offset = corridor.arc_xy_m - START
    forth, left = offset @ along, along[0] * offset[:, 1] - along[1] * offset[:, 0]
    assert np.sign(height_m) * left == pytest.approx(np.abs(left), abs=1e-6)
    assert np.abs(left).max() == pytest.approx(abs(height_m), abs=1e-6)
    if height_m:
        radius_m = (chord_m**2 / 4 + height_m**2) / (2 * abs(height_m))
        down_m = (radius_m - abs(height_m)) * np.sign(height_m)
        assert np.hypot(forth - chord_m / 2, left + down_m) == pytest.approx(radius_m, rel=1e-9)
    assert np.allclose(corridor.arc_xy_m[[0, -1]], [START, GOAL])


def test_the_line_is_straight_and_the_spine_goes_around_what_the_coarse_map_shows() -> None:
    line, spine = lay("line").corridor, lay("spine").corridor
    assert line is not None
    assert spine is not None
    assert line.arc_xy_m.tolist() == [list(START), list(GOAL)]
    assert line.sagitta_m is None
    assert np.allclose(spine.arc_xy_m[[0, -1]], [START, GOAL])
    lake = LEVEL.copy()
    lake[8:, 24:40] = np.nan  # unknown, open in the north
    start, goal = (GEOMETRY.position_of(Cell(10, column)) for column in (8, 50))
    around = plan(region_of(lake, 10.0), start, goal).corridor
    assert around is not None
    assert around.arc_xy_m[:, 1].max() > GEOMETRY.position_of(Cell(8, 0)).y_m


def test_the_width_is_a_quarter_of_the_distance_but_at_least_20_cells_unless_given() -> None:
    corridor = lay("line").corridor
    assert corridor is not None
    assert corridor.width_m == max(0.25 * math.dist(START, GOAL), 200.0)
    given_width = lay("line", 90.0).corridor
    assert given_width is not None
    assert given_width.width_m == 90.0
    wide = plan(
        region_of(np.zeros((40, 400), dtype=np.float32), 10.0),
        START,
        Position(4900.0, 8700.0),
        corridor=CorridorParams("spine"),
    )
    assert wide.corridor is not None
    assert wide.corridor.width_m == pytest.approx(0.25 * math.dist(START, (4900.0, 8700.0)))


def test_the_swathe_is_doubled_until_start_and_goal_connect() -> None:
    # The only gap of the wall lies far to the south.
    zones = np.zeros(GEOMETRY.shape, dtype=np.bool_)
    zones[:35, 30] = True
    start, goal = GEOMETRY.position_of(Cell(10, 10)), GEOMETRY.position_of(Cell(10, 50))
    params = CorridorParams(arc="line", width_m=100.0)
    answer = plan(region_of(LEVEL, 10.0, zones=zones), start, goal, corridor=params)
    assert answer.status == "route_found"
    assert answer.corridor is not None
    assert answer.corridor.widened >= 2
    assert answer.corridor.width_m == 100.0 * 2**answer.corridor.widened
    assert answer.nests is not None
    # The mirror draws the swathe in which the core worked.
    assert (answer.nests.labels[~answer.corridor.cells(GEOMETRY)] == 0).all()


@pytest.mark.parametrize(
    ("params", "named"),
    [
        (CorridorParams(width_m=0.0), "width of 0"),
        (CorridorParams(width_m=-5.0), "width of -5"),
        (CorridorParams(width_m=math.nan), "width"),
        (CorridorParams(arc="circle", sagitta_m=math.inf), "sagitta"),
        (CorridorParams(arc="zigzag"), "arc"),  # type: ignore[arg-type]
    ],
)
def test_corridors_that_cannot_be_laid_are_refused(params: CorridorParams, named: str) -> None:
    with pytest.raises(InvalidParameterError, match=named):
        plan(region_of(LEVEL, 10.0), START, GOAL, corridor=params)
