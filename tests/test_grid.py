"""Cells and positions of one geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Cell, GridGeometry, Position, as_codes

metres = st.floats(-1e6, 1e6, allow_nan=False)
geometries = st.builds(
    GridGeometry,
    rows=st.integers(1, 500),
    columns=st.integers(1, 500),
    cell_size_m=st.floats(0.01, 500),
    west_m=metres,
    north_m=metres,
)


@given(geometries, st.data())
def test_from_cell_to_position_and_back_is_the_same_cell(geometry: GridGeometry, data: st.DataObject) -> None:
    row = data.draw(st.integers(0, geometry.rows - 1))
    column = data.draw(st.integers(0, geometry.columns - 1))
    assert geometry.cell_at(geometry.position_of(Cell(row, column))) == Cell(row, column)


@given(geometries, metres, metres)
def test_a_position_is_at_most_half_a_cell_from_the_centre_of_its_cell(
    geometry: GridGeometry, x_m: float, y_m: float
) -> None:
    cell = geometry.cell_at(Position(x_m, y_m))
    slack = 1e-6 + geometry.cell_size_m / 2
    if cell is None:
        within = (geometry.west_m, geometry.south_m), (geometry.east_m, geometry.north_m)
        assert not (within[0][0] + slack < x_m < within[1][0] - slack) or not (
            within[0][1] + slack < y_m < within[1][1] - slack
        )
    else:
        centre = geometry.position_of(cell)
        assert abs(centre.x_m - x_m) <= slack
        assert abs(centre.y_m - y_m) <= slack


def test_row_0_is_the_north_edge_and_column_0_the_west_edge() -> None:
    geometry = GridGeometry(3, 4, 10.0, 500.0, 900.0)
    assert geometry.position_of(Cell(0, 0)) == Position(505.0, 895.0)
    assert (geometry.east_m, geometry.south_m) == (540.0, 870.0)
    assert geometry.shape == (3, 4)
    assert geometry.cell_count == 12


@pytest.mark.parametrize(
    ("x_m", "y_m", "cell"),
    [
        (500.0, 900.0, Cell(0, 0)),
        (510.0, 900.0, Cell(0, 1)),
        (500.0, 890.0, Cell(1, 0)),
        (539.999, 870.001, Cell(2, 3)),
        (540.0, 880.0, None),
        (520.0, 870.0, None),
        (499.999, 880.0, None),
        (520.0, 900.001, None),
    ],
)
def test_the_north_and_west_edges_belong_to_a_cell_and_the_south_and_east_edges_do_not(
    x_m: float, y_m: float, cell: Cell | None
) -> None:
    assert GridGeometry(3, 4, 10.0, 500.0, 900.0).cell_at(Position(x_m, y_m)) == cell


@given(geometries, st.data())
def test_a_window_keeps_every_cell_where_it_is(geometry: GridGeometry, data: st.DataObject) -> None:
    row = data.draw(st.integers(0, geometry.rows - 1))
    column = data.draw(st.integers(0, geometry.columns - 1))
    window = geometry.window(row, column, geometry.rows - row, geometry.columns - column)
    there, here = window.position_of(Cell(0, 0)), geometry.position_of(Cell(row, column))
    assert there.x_m == pytest.approx(here.x_m, abs=1e-6)
    assert there.y_m == pytest.approx(here.y_m, abs=1e-6)
    assert window.south_m == pytest.approx(geometry.south_m, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((0, 3, 1.0), "0 rows"),
        ((3, -1, 1.0), "-1 columns"),
        ((3, 3, 0.0), "cell size"),
        ((3, 3, math.nan), "cell size"),
        ((3, 3, math.inf), "cell size"),
        ((3, 3, 1.0, math.nan), "corner"),
        ((3, 3, 1.0, 0.0, -math.inf), "corner"),
    ],
)
def test_a_geometry_that_cannot_be_is_refused(arguments: tuple[float, ...], named: str) -> None:
    with pytest.raises(InvalidParameterError, match=named):
        GridGeometry(*arguments)  # type: ignore[arg-type]


def test_codes_of_any_whole_numbers_become_bytes() -> None:
    for layer in (np.array([[0, 255]]), np.array([[0.0, 255.0]]), [[0, 255]], np.array([[0, 255]], dtype=np.uint8)):
        codes = as_codes(layer, "soil")
        assert codes.dtype == np.uint8
        assert codes.tolist() == [[0, 255]]
    assert as_codes(np.array([[True, False]]), "soil").tolist() == [[1, 0]]


@pytest.mark.parametrize("bad", [262, -1, 6.5, math.nan, "6", 6j])
def test_codes_that_a_cast_would_bend_are_refused(bad: object) -> None:
    with pytest.raises(InvalidParameterError, match="The soil holds"):
        as_codes(np.array([[6, bad]]), "soil")


@pytest.mark.parametrize("bad", [[1, 2], [[[1]]], [[]], 3])
def test_codes_without_rows_and_columns_are_refused(bad: object) -> None:
    with pytest.raises(ShapeMismatchError, match="The soil has the shape"):
        as_codes(bad, "soil")  # type: ignore[arg-type]
