"""One geometry for every layer: rows and columns of square cells in a projected, north-up frame of metres.

Row 0 is the north edge and column 0 the west edge. ``Cell`` (row, column) and ``Position`` (metres east and north)
are different types, and no function accepts either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


class Cell(NamedTuple):
    """A cell by row (0 = north) and column (0 = west)."""

    row: int
    column: int


class Position(NamedTuple):
    """A point of the map frame: metres east and metres north."""

    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """Where the cells of a layer lie.

    ``west_m`` and ``north_m`` are the map coordinates of the outer corner of cell (0, 0).
    """

    rows: int
    columns: int
    cell_size_m: float
    west_m: float = 0.0
    north_m: float = 0.0

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise InvalidParameterError(
                f"A grid of {self.rows} rows and {self.columns} columns has no cells.", "Give at least one of each."
            )
        if not (math.isfinite(self.cell_size_m) and self.cell_size_m > 0):
            raise InvalidParameterError(
                f"The cell size of {self.cell_size_m} m is not a length.", "Give a finite number above zero."
            )
        if not (math.isfinite(self.west_m) and math.isfinite(self.north_m)):
            raise InvalidParameterError("The corner of the grid is not finite.", "Give finite map coordinates.")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return (self.rows, self.columns)

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return self.rows * self.columns

    @property
    def east_m(self) -> float:
        """Map x of the east edge."""
        return self.west_m + self.columns * self.cell_size_m

    @property
    def south_m(self) -> float:
        """Map y of the south edge."""
        return self.north_m - self.rows * self.cell_size_m

    def cell_at(self, position: Position) -> Cell | None:
        """Return the cell that holds ``position``, or None outside the grid (the south and east edges are outside)."""
        column = math.floor((position.x_m - self.west_m) / self.cell_size_m)
        row = math.floor((self.north_m - position.y_m) / self.cell_size_m)
        if 0 <= row < self.rows and 0 <= column < self.columns:
            return Cell(row, column)
        return None

    def position_of(self, cell: Cell) -> Position:
        """Return the centre of ``cell`` (which may lie outside the grid)."""
        return Position(
            self.west_m + (cell.column + 0.5) * self.cell_size_m,
            self.north_m - (cell.row + 0.5) * self.cell_size_m,
        )

    def window(self, row: int, column: int, rows: int, columns: int) -> GridGeometry:
        """Return the geometry of a block of cells, on the same lattice."""
        return GridGeometry(
            rows,
            columns,
            self.cell_size_m,
            self.west_m + column * self.cell_size_m,
            self.north_m - row * self.cell_size_m,
        )


class Window(NamedTuple):
    """A block of cells: its first row and column, and how many rows and columns it has."""

    row: int
    column: int
    rows: int
    columns: int


def as_codes(layer: ArrayLike, name: str) -> NDArray[np.uint8]:
    """Return a layer of codes, whole numbers from 0 to 255, as a contiguous uint8 array of two dimensions.

    Raises:
        ShapeMismatchError: the layer does not have two dimensions or has no cells.
        InvalidParameterError: it holds anything else; a plain cast would turn 262 into 6.
    """
    array = np.asarray(layer)
    if array.ndim != 2 or array.size == 0:
        raise ShapeMismatchError(
            f"The {name} has the shape {array.shape}.", "Give an array of rows and columns with at least one cell."
        )
    if array.dtype != np.uint8:
        numbers = array.dtype.kind in "buif"
        if not (numbers and ((array >= 0) & (array <= 255) & (array == np.floor(array))).all()):
            raise InvalidParameterError(f"The {name} holds more than codes.", "Give whole numbers from 0 to 255.")
    return np.ascontiguousarray(array, dtype=np.uint8)


def distance_transform(marks: ArrayLike, cell_size_m: float = 1.0) -> NDArray[np.float64]:
    """Return the exact distance in metres from the centre of every cell to that of the nearest marked one.

    ``marks`` is (rows, columns), True where marked; without any mark every distance is infinite. It is what risk
    measures from no-go ground (Meijster, Roerdink and Hesselink 2000).

    Raises:
        ShapeMismatchError: the marks do not have two dimensions or have no cells.
        InvalidParameterError: they are not booleans, or the cell size is not a length.
    """
    array = np.asarray(marks)
    if array.ndim != 2 or array.size == 0:
        raise ShapeMismatchError(f"The marks have the shape {array.shape}.", "Give an array of rows and columns.")
    if array.dtype != np.bool_:
        raise InvalidParameterError(f"The marks hold {array.dtype}.", "Give booleans.")
    if not (math.isfinite(cell_size_m) and cell_size_m > 0):
        raise InvalidParameterError(
            f"The cell size of {cell_size_m} m is not a length.", "Give a finite number above zero."
        )
    squared = _core.squared_distances(np.ascontiguousarray(array))
    reached = squared != np.iinfo(np.uint64).max
    return np.where(reached, np.sqrt(squared.astype(np.float64)) * cell_size_m, np.inf)
