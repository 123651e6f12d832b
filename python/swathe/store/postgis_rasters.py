"""Rasters in PostGIS: tiles of 256 x 256 cells with their overviews, written by COPY and read whole."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import numpy as np
from psycopg import sql

from swathe.errors import InvalidParameterError, OutsideGridError, ShapeMismatchError
from swathe.grid import GridGeometry, Window
from swathe.store.interface import OVERVIEWS, TILE_SIZE, ImportSession, require_window
from swathe.store.naming import checked_name
from swathe.store.postgis_layers import StagedLayer
from swathe.store.postgis_regions import missing_layer, region_row
from swathe.store.queries import query
from swathe.store.raster_wkb import RasterTile, decode, encode

if TYPE_CHECKING:
    import psycopg
    from numpy.typing import NDArray

    from swathe.store.interface import LayerInfo
    from swathe.store.postgis_server import Server

_DTYPES = ("float32", "uint8", "uint16", "int32")
#: Tiles that are committed at once: what a killed import loses at most.
TILES_PER_COMMIT = 64


class PostgisImport(ImportSession):
    """A raster that is being written: rows that no reader sees until they are switched to.

    It has a connection of its own, whose end (by whatever cause) lets go of the lock on the layer.
    """

    def __init__(self, server: Server, region: str, layer: LayerInfo) -> None:
        self._dtype = np.dtype(layer.dtype)
        if self._dtype.name not in _DTYPES:
            raise InvalidParameterError(
                f"A raster of {self._dtype} cannot be kept.", f"Give one of {', '.join(_DTYPES)}."
            )
        self._copying: contextlib.ExitStack | None = None
        self._copy: psycopg.Copy | None = None
        self._unsaved = 0
        self._staged = StagedLayer(server, region, layer)
        self._connection = self._staged.connection
        try:
            with self._staged.told():
                found = self._connection.execute(query("staged_tiles"), (self._staged.layer_id,))
                self._have = {(row, column) for row, column in found}
        except BaseException:
            self._staged.close()
            raise
        self.is_current = self._staged.is_current

    def have(self) -> frozenset[tuple[int, int]]:
        """Return the tiles that an earlier, unfinished session has left whole."""
        return frozenset(self._have)

    def write_tile(self, row: int, column: int, tile: NDArray[Any]) -> None:
        """Write one tile with its overviews."""
        pixels = self._checked(row, column, tile)
        with self._staged.told():
            if (row, column) in self._have:
                self._save()
                self._connection.execute(query("remove_tile"), (self._staged.layer_id, row, column))
            if self._copy is None:
                self._copying = contextlib.ExitStack()
                cursor = self._copying.enter_context(self._connection.cursor())
                self._copy = self._copying.enter_context(cursor.copy(query("copy_tiles")))
            self._copy.write(self._line(row, column, pixels))
            self._have.add((row, column))
            self._unsaved += 1
            if self._unsaved >= TILES_PER_COMMIT:
                self._save()

    def commit(self) -> None:
        """Put the layer into the place of the old one, in one step."""
        if self.is_current:
            return
        with self._staged.told():
            self._save()
            self._staged.switch()
        # From here on readers see the new one; the old one's rows go when they go.
        self.is_current = True
        self._staged.sweep()

    def abort(self) -> None:
        """Throw away what was written; the old layer stands."""
        if self.is_current:
            return
        with self._staged.told():
            self._save()
            self._staged.restart()
        self._have.clear()

    def close(self) -> None:
        """Keep what was written whole, and let go of the layer."""
        if not self._connection.closed:
            try:
                with self._staged.told():
                    self._save()
            finally:
                self._staged.close()

    def _save(self) -> None:
        """End the COPY, which commits its tiles."""
        copying, self._copying, self._copy, self._unsaved = self._copying, None, None, 0
        if copying is not None:
            copying.close()

    def _checked(self, row: int, column: int, tile: NDArray[Any]) -> NDArray[Any]:
        rows = min(TILE_SIZE, self._staged.region.rows - row * TILE_SIZE)
        columns = min(TILE_SIZE, self._staged.region.columns - column * TILE_SIZE)
        if self.is_current:
            raise InvalidParameterError("The layer is finished.", "Begin a new import.")
        if row < 0 or column < 0 or rows <= 0 or columns <= 0:
            raise OutsideGridError(f"The tile {row}, {column} is not inside the region.", "Count tiles from 0.")
        if tile.shape not in {(rows, columns), (TILE_SIZE, TILE_SIZE)}:
            raise ShapeMismatchError(
                f"The tile {row}, {column} has the shape {tile.shape}.", f"Give {rows} rows and {columns} columns."
            )
        # What a whole tile has beyond the region's edge is not of the region.
        return np.ascontiguousarray(tile[:rows, :columns], dtype=self._dtype)

    def _line(self, row: int, column: int, pixels: NDArray[Any]) -> bytes:
        """Return a line of COPY: there is no binary input of rasters, and hexadecimal text is what there is."""
        region = self._staged.region
        size_m = region.cell_size_m
        west_m = region.west_m + column * TILE_SIZE * size_m
        north_m = region.north_m - row * TILE_SIZE * size_m
        fields = [str(self._staged.layer_id), str(row), str(column)]
        nodata = float("nan") if self._dtype.kind == "f" else 0.0
        for factor, numbers in zip(OVERVIEWS, pyramid(pixels), strict=True):
            cell_m = size_m * factor
            fields.append(encode(RasterTile(numbers, west_m, north_m, cell_m, -cell_m, region.srid, nodata)).hex())
        return ("\t".join(fields) + "\n").encode("ascii")


def pyramid(pixels: NDArray[Any]) -> list[NDArray[Any]]:
    """Return a tile at every overview: means of the known where they are floats, one of the codes otherwise."""
    if pixels.dtype.kind != "f":
        return [np.ascontiguousarray(pixels[::factor, ::factor]) for factor in OVERVIEWS]
    known = np.isfinite(pixels)
    whole = bool(known.all())
    sums = pixels.astype(np.float64) if whole else np.where(known, pixels, 0.0).astype(np.float64)
    counts = np.ones(pixels.shape) if whole else known.astype(np.float64)
    levels = [pixels]
    for _ in OVERVIEWS[1:]:
        sums, counts = _paired(sums), _paired(counts)
        with np.errstate(invalid="ignore"):
            levels.append((sums / counts).astype(pixels.dtype))
    return levels


def _paired(layer: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of 2 x 2 cells; what the edge cuts off counts as nothing."""
    rows, columns = layer.shape
    if rows % 2 or columns % 2:
        layer = np.pad(layer, ((0, rows % 2), (0, columns % 2)))
    pairs: NDArray[np.float64] = layer[0::2] + layer[1::2]
    return pairs[:, 0::2] + pairs[:, 1::2]


def read_window(server: Server, region: str, layer: str, window: Window, overview: int) -> NDArray[Any]:
    """Return a window of a raster; whole tiles are fetched and put together here, which is quickest."""
    window = Window(*window)
    if overview not in OVERVIEWS:
        require_window(GridGeometry(1, 1, 1.0), Window(0, 0, 1, 1), overview)
    size = TILE_SIZE // overview
    top, left = window.row // overview, window.column // overview
    rows, columns = -(-window.rows // overview), -(-window.columns // overview)
    asked = {
        "region": checked_name(region),
        "layer": checked_name(layer, "layer"),
        "first_row": window.row // TILE_SIZE,
        "last_row": (window.row + window.rows - 1) // TILE_SIZE,
        "first_column": window.column // TILE_SIZE,
        "last_column": (window.column + window.columns - 1) // TILE_SIZE,
    }
    column_name = "rast" if overview == 1 else f"rast_{overview}"
    statement = sql.SQL(query("read_tiles")).format(column=sql.Identifier(column_name))
    result: NDArray[Any] | None = None
    with server.use() as connection, connection.cursor(binary=True) as cursor:
        # Row by row, so that a large window is not held twice; one statement, so that all of it is of one layer.
        for name, all_rows, all_columns, row, column, wkb in cursor.stream(statement, asked):
            if result is None:
                require_window(GridGeometry(all_rows, all_columns, 1.0), window, overview)
                dtype = np.dtype(name)
                result = np.full((rows, columns), np.nan if dtype.kind == "f" else 0, dtype)
            if wkb is not None:
                _paste(result, decode(wkb).pixels, row * size - top, column * size - left)
        if result is None:
            region_row(connection, region)
            raise missing_layer(region, layer)
    return result


def _paste(result: NDArray[Any], pixels: NDArray[Any], row: int, column: int) -> None:
    """Copy what lies inside of a tile whose north-west cell is (row, column) of the result."""
    top, left = max(0, row), max(0, column)
    bottom, right = min(result.shape[0], row + pixels.shape[0]), min(result.shape[1], column + pixels.shape[1])
    if top < bottom and left < right:
        result[top:bottom, left:right] = pixels[top - row : bottom - row, left - column : right - column]
