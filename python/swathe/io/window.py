"""Which part of the elevation to read: all of it, what bounds ask for, or a window around the way that can grow."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from swathe.errors import InvalidParameterError, NoOverlapError
from swathe.grid import Cell, Position, Window

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swathe.grid import GridGeometry
    from swathe.io.elevation import ElevationSource

#: A plan reads the whole map up to this many cells; beyond, and for maps on a server, a window around the way.
WHOLE_MAP_CELLS = 16_000_000

#: Least margin of such a window around start and goal, in cells.
LEAST_MARGIN_CELLS = 256

#: Windows begin at multiples of this, so that the paper's groups of 8 x 8 pixels are the same in every window.
_GROUP = 8


def bounded(
    source: ElevationSource, bounds: tuple[float, float, float, float] | None, points_crs: str | None
) -> Window:
    """Return the cells inside ``bounds`` (west, south, east, north in ``points_crs``), or all of them.

    Raises:
        UsageError: the bounds hold nothing or cannot be placed.
        NoOverlapError: they lie outside the elevation.
    """
    geometry = source.frame.geometry
    if bounds is None:
        return Window(0, 0, geometry.rows, geometry.columns)
    west, south, east, north = bounds
    shown = f"{west:g},{south:g},{east:g},{north:g}"
    if not (west < east and south < north):
        raise InvalidParameterError(f"The bounds {shown} hold nothing.", "Give west,south,east,north.")
    corners = [(west, south), (west, north), (east, south), (east, north)]
    places = [source.frame.from_points(x, y, points_crs, source.source_crs_wkt) for x, y in corners]
    window = _around(geometry, places, 0)
    if window is None:
        raise NoOverlapError(
            f"The bounds {shown} lie outside {', '.join(source.names)}.",
            "Give bounds inside the elevation, in longitude and latitude unless `--points-crs` says otherwise.",
        )
    return window


def reads_lazily(source: ElevationSource, whole: Window) -> bool:
    """Return whether a plan that needs but a part of a map should read it tile by tile: it is large, or on a server."""
    return source.is_remote or (source.is_tiled and whole.rows * whole.columns > WHOLE_MAP_CELLS)


def first_window(source: ElevationSource, whole: Window, ends: Sequence[Position], *, lazy: bool = False) -> Window:
    """Return what a plan reads first: ``whole``, or for large and remote maps the part around start and goal.

    A ``lazy`` plan reads little of its window; only what is kept for each cell bounds it.

    A place outside the map counts as the nearest inside: that it is outside can be told from any part.
    """
    geometry = source.frame.geometry
    if whole.rows * whole.columns <= WHOLE_MAP_CELLS and (lazy or not source.is_remote):
        return whole
    inside = [
        Position(
            min(max(end.x_m, geometry.west_m), geometry.east_m), min(max(end.y_m, geometry.south_m), geometry.north_m)
        )
        for end in ends
    ]
    distance_m = math.dist(*inside)
    margin = max(LEAST_MARGIN_CELLS, int(0.5 * distance_m / geometry.cell_size_m))
    window = _around(geometry, inside, margin)
    return whole if window is None else _clipped(window, whole)


def nearest_cell(source: ElevationSource, place: Position) -> Cell:
    """Return the cell of the map that is nearest to a place."""
    geometry = source.frame.geometry
    row = math.floor((geometry.north_m - place.y_m) / geometry.cell_size_m)
    column = math.floor((place.x_m - geometry.west_m) / geometry.cell_size_m)
    return Cell(min(max(row, 0), geometry.rows - 1), min(max(column, 0), geometry.columns - 1))


def larger_window(window: Window, whole: Window) -> Window:
    """Return a window with about twice the sides, inside ``whole``."""
    wider = Window(
        window.row - window.rows // 2, window.column - window.columns // 2, 2 * window.rows, 2 * window.columns
    )
    return _clipped(wider, whole)


def _around(geometry: GridGeometry, places: Sequence[Position], margin_cells: int) -> Window | None:
    """Return the cells of the box around places with a margin, or None outside the map."""
    size = geometry.cell_size_m
    columns = [math.floor((place.x_m - geometry.west_m) / size) for place in places]
    rows = [math.floor((geometry.north_m - place.y_m) / size) for place in places]
    top, bottom = max(0, min(rows) - margin_cells), min(geometry.rows, max(rows) + 1 + margin_cells)
    left, right = max(0, min(columns) - margin_cells), min(geometry.columns, max(columns) + 1 + margin_cells)
    if top >= bottom or left >= right:
        return None
    return Window(top, left, bottom - top, right - left)


def _clipped(window: Window, whole: Window) -> Window:
    """Return the part of a window inside ``whole``, widened to whole groups of cells."""
    top = max(whole.row, window.row - window.row % _GROUP)
    left = max(whole.column, window.column - window.column % _GROUP)
    bottom = min(whole.row + whole.rows, window.row + window.rows + -(window.row + window.rows) % _GROUP)
    right = min(
        whole.column + whole.columns, window.column + window.columns + -(window.column + window.columns) % _GROUP
    )
    if top >= bottom or left >= right:
        return whole
    return Window(top, left, bottom - top, right - left)
