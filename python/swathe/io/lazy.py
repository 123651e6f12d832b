"""Elevation that is read when it is first needed: tile by tile, each once, tried again when a server is silent."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.errors import InputError, InterruptedBySignalError
from swathe.grid import Window
from swathe.io.elevation import TILE_SIZE

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.grid import Cell
    from swathe.io.elevation import ElevationSource

#: A tile is tried so often before it counts as unreadable.
TRIES = 3

#: Seconds before the second try; the third waits twice as long.
PAUSE_S = 1.0


class LazyElevation:
    """The heights of a part of the map, in the tiles of its source.

    ``whole`` is the part that may be read. Windows of it can be given to a planner one after the other: a tile that
    was read for one is there for the next. ``failure`` is what was wrong with the tile that could not be read.
    """

    def __init__(
        self, source: ElevationSource, whole: Window, on_progress: Callable[[str, int, int], bool] | None = None
    ) -> None:
        self._source = source
        self._on_progress = on_progress
        self._tiles: dict[tuple[int, int], NDArray[np.float32]] = {}
        self.failure: InputError | None = None
        self.failed_window: Window | None = None
        self.tiles_total = tiles_under(whole)

    @property
    def tiles_read(self) -> int:
        """Tiles that were read so far, each once."""
        return len(self._tiles)

    def reader(self, window: Window) -> Callable[[int, int, int, int], NDArray[np.float32] | None]:
        """Return what reads (row, column, rows, columns) of a window, which must lie within one tile.

        It gives None for a tile that stays unreadable, and leaves the reason in ``failure``.
        """

        def read(row: int, column: int, rows: int, columns: int) -> NDArray[np.float32] | None:
            row, column = row + window.row, column + window.column
            tile = self._tile(row // TILE_SIZE, column // TILE_SIZE)
            if tile is None:
                return None
            top, left = row % TILE_SIZE, column % TILE_SIZE
            return np.ascontiguousarray(tile[top : top + rows, left : left + columns])

        return read

    def read_at(self, cell: Cell) -> None:
        """Read the tile that holds a cell of the map."""
        self._tile(cell.row // TILE_SIZE, cell.column // TILE_SIZE)

    def extent(self, window: Window) -> Window | None:
        """Return the smallest part of a window of the map that holds all tiles that were read in it, or None."""
        boxes = [box for box in (_shared(_cells(*place), window) for place in self._tiles) if box is not None]
        if not boxes:
            return None
        top, left = min(box.row for box in boxes), min(box.column for box in boxes)
        bottom = max(box.row + box.rows for box in boxes)
        right = max(box.column + box.columns for box in boxes)
        return Window(top, left, bottom - top, right - left)

    def heights(self, window: Window) -> NDArray[np.float32]:
        """Return the heights of a window of the map as far as they were read, NaN elsewhere."""
        heights = np.full((window.rows, window.columns), np.nan, dtype=np.float32)
        for place, tile in self._tiles.items():
            cells = _cells(*place)
            box = _shared(cells, window)
            if box is not None:
                inner = tile[box.row - cells.row :, box.column - cells.column :][: box.rows, : box.columns]
                _part(heights, box, window)[:] = inner
        return heights

    def surroundings_read(self, window: Window) -> NDArray[np.bool_]:
        """Return which cells of a window can be judged like on the whole map: what lies around them was read too."""
        known = np.zeros((window.rows + 2, window.columns + 2), dtype=np.bool_)
        wider = Window(window.row - 1, window.column - 1, window.rows + 2, window.columns + 2)
        for place in self._tiles:
            box = _shared(_cells(*place), wider)
            if box is not None:
                _part(known, box, wider)[:] = True
        rows, columns = self._source.frame.geometry.shape
        # Nothing lies beyond the map's own edges.
        known[: max(0, -wider.row)] = known[rows - wider.row :] = True
        known[:, : max(0, -wider.column)] = known[:, columns - wider.column :] = True
        inner = known[:, :-2] & known[:, 1:-1] & known[:, 2:]
        around: NDArray[np.bool_] = inner[:-2] & inner[1:-1] & inner[2:]
        return around

    def _tile(self, top: int, left: int) -> NDArray[np.float32] | None:
        tile = self._tiles.get((top, left))
        if tile is None:
            tile = self._read(top, left)
            if tile is not None:
                self._tiles[top, left] = tile
        return tile

    def _read(self, top: int, left: int) -> NDArray[np.float32] | None:
        rows, columns = self._source.frame.geometry.shape
        window = _shared(_cells(top, left), Window(0, 0, rows, columns))
        if window is None:  # the reader asks for cells of the map alone
            return None
        for attempt in range(1, TRIES + 1):
            try:
                return self._source.read(window)
            except InputError as error:
                self.failure, self.failed_window = error, window
            if attempt < TRIES:
                self._tell(attempt)
                time.sleep(PAUSE_S * attempt)
                # A server that was away is asked anew.
                self._source.close()
        return None

    def _tell(self, attempt: int) -> None:
        # Only False stops: a callback that returns nothing means "go on".
        if self._on_progress is not None and self._on_progress("reading again", attempt, TRIES - 1) is False:
            raise InterruptedBySignalError("Reading the elevation was stopped.", "Nothing was written.")


def tiles_under(window: Window) -> int:
    """Return how many tiles of the map hold cells of a window."""
    return len(_span(window.row, window.rows)) * len(_span(window.column, window.columns))


def _span(first: int, count: int) -> range:
    return range(first // TILE_SIZE, -(-(first + count) // TILE_SIZE))


def _cells(top: int, left: int) -> Window:
    return Window(top * TILE_SIZE, left * TILE_SIZE, TILE_SIZE, TILE_SIZE)


def _shared(one: Window, other: Window) -> Window | None:
    top, left = max(one.row, other.row), max(one.column, other.column)
    bottom = min(one.row + one.rows, other.row + other.rows)
    right = min(one.column + one.columns, other.column + other.columns)
    return Window(top, left, bottom - top, right - left) if top < bottom and left < right else None


def _part(layer: NDArray[Any], box: Window, window: Window) -> NDArray[Any]:
    """Return the part of a window's layer that is ``box``, both counted on the map."""
    row, column = box.row - window.row, box.column - window.column
    return layer[row : row + box.rows, column : column + box.columns]
