"""Opening elevations: anything that GDAL reads, as heights in metres on a north-up lattice of square cells.

Sources that are already that are handed through bit by bit. All others (degrees, feet, rotated, cells that are not
square, several systems at once, another cell size) are warped once, on fixed tiles. Unknown is NaN: voids stay voids.
"""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from typing import TYPE_CHECKING, Self

import numpy as np

from swathe.errors import (
    AllVoidError,
    InterruptedBySignalError,
    InvalidParameterError,
    MissingCrsError,
    NotElevationError,
    OutsideGridError,
    TooLargeError,
)
from swathe.grid import GridGeometry, Window
from swathe.io.crs import Frame, crs_name, horizontal, parse_crs
from swathe.io.mosaic import Mosaic, group_into_mosaics, is_rotated
from swathe.io.sources import BUNDLED_PREFIX, Source, expand
from swathe.io.target import Target, choose_target, require_size
from swathe.io.tile import DatasetPool, GreyScale, RasterTile, Tile
from swathe.io.warp import Warp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType

    from numpy.typing import NDArray

TILE_SIZE = 256
KEPT_TILES = 64


class ElevationSource:
    """Heights that can be read as a whole or window by window; a context manager.

    ``names`` are the inputs as they may be shown (``is_remote`` when any lies on a server), ``frame`` the lattice of
    the whole extent, ``source_crs_wkt`` the system of the files themselves (None in a local frame), ``grey`` tells a
    picture from heights, ``height_range_m`` its heights of black and white, ``warped`` whether cells are resampled,
    ``is_tiled`` whether the files hold blocks that can be read alone, and ``native_cell_size_m`` the mean size of the
    files' own cells on the ground.
    """

    tile_size = TILE_SIZE

    def __init__(
        self,
        sources: Sequence[Source],
        mosaics: Sequence[Mosaic],
        target: Target,
        pool: DatasetPool,
        *,
        height_range_m: tuple[float, float] | None,
    ) -> None:
        self._sources = tuple(sources)
        self._mosaics = tuple(mosaics)
        self._pool = pool
        self.names = tuple(source.name for source in sources)
        self.is_remote = any(source.is_remote for source in sources)
        self.is_tiled = all(
            not isinstance(place.tile, RasterTile) or place.tile.is_tiled for one in mosaics for place in one.placed
        )
        self.frame = target.frame
        self.source_crs_wkt = mosaics[0].crs_wkt
        self.height_range_m = height_range_m
        self.grey = height_range_m is not None
        self.warped = target.warped
        self.native_cell_size_m = target.native_cell_size_m
        geometry = target.frame.geometry
        self._warps = [
            Warp(mosaic, str(target.frame.crs_wkt), geometry.west_m, geometry.north_m, geometry.cell_size_m)
            for mosaic in (mosaics if target.warped else ())
        ]
        self._kept: OrderedDict[tuple[int, int], NDArray[np.float32]] = OrderedDict()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. Reading again opens them again."""
        self._kept.clear()
        self._pool.close()

    @property
    def bytes_read(self) -> int:
        """Bytes of numbers that were read from the files so far, as they are once decoded."""
        return self._pool.bytes_read

    def fingerprint(self) -> dict[str, str]:
        """Return the SHA-256 of the bytes of every input by name; ``remote`` for what lies on a server."""
        return {source.name: _fingerprint(source) for source in self._sources}

    def read(
        self, window: Window | None = None, on_progress: Callable[[int, int], bool] | None = None
    ) -> NDArray[np.float32]:
        """Return heights in metres, NaN = unknown, of a window of ``frame`` (None: all of it).

        Only the files under the window are touched, and every window is bit-equal to the same window of the whole.
        ``on_progress(done_tiles, all_tiles)`` returns False to stop, which raises InterruptedBySignalError. Raises
        OutsideGridError, TooLargeError, and UnreadableFileError when a file turns out to be cut short.
        """
        geometry = self.frame.geometry
        window = Window(0, 0, *geometry.shape) if window is None else Window(*window)
        _require_inside(window, geometry)
        heights = _empty(window)
        tops = range(window.row // TILE_SIZE, -(-(window.row + window.rows) // TILE_SIZE))
        lefts = range(window.column // TILE_SIZE, -(-(window.column + window.columns) // TILE_SIZE))
        for done, top in enumerate(tops, start=1):
            if self._warps:
                for already, left in enumerate(lefts, start=1):
                    _paste(heights, window, self._tile(top, left), top * TILE_SIZE, left * TILE_SIZE)
                    _report(on_progress, (done - 1) * len(lefts) + already, len(tops) * len(lefts))
            else:
                # A whole row of tiles at once: many files are stored in full-width strips.
                row = max(top * TILE_SIZE, window.row)
                rows = min((top + 1) * TILE_SIZE, window.row + window.rows) - row
                band = self._mosaics[0].read(row, window.column, rows, window.columns)
                heights[row - window.row : row - window.row + rows] = band
                _report(on_progress, done * len(lefts), len(tops) * len(lefts))
        return heights

    def _tile(self, top: int, left: int) -> NDArray[np.float32]:
        """Return one warped tile; where mosaics overlap, the first that knows wins."""
        heights = self._kept.get((top, left))
        if heights is None:
            heights = self._warps[0].block(top * TILE_SIZE, left * TILE_SIZE, TILE_SIZE)
            for warp in self._warps[1:]:
                unknown = np.isnan(heights)
                if unknown.any():
                    other = warp.block(top * TILE_SIZE, left * TILE_SIZE, TILE_SIZE)
                    np.copyto(heights, other, where=unknown)
            self._kept[top, left] = heights
            if len(self._kept) > KEPT_TILES:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end((top, left))
        return heights


def open_elevation(
    sources: Sequence[str],
    *,
    cell_size_m: float | None = None,
    crs: str | None = None,
    height_range_m: tuple[float, float] | None = None,
) -> ElevationSource:
    """Open elevations.

    ``sources``: paths, folders, glob patterns, http(s) addresses or ``bundled:NAME``; several are put together.
    ``cell_size_m``: the cell of the result; for a raster without a place in the world, the size of its own cells.
    ``crs``: the projection of the result, in metres; for a raster that does not say its system, that system.
    ``height_range_m``: the heights of black and white when the source is a grey picture.

    Cells are kept as they are, interpolated between four (bilinear), or averaged when the new cell is at least twice
    the old. Raises an InputError that names the file, or a UsageError for an option that cannot be.
    """
    if cell_size_m is not None and not (math.isfinite(cell_size_m) and cell_size_m > 0):
        raise InvalidParameterError(f"The cell size of {cell_size_m:g} m is not a length.", "Give a number above zero.")
    cell_size_m = None if cell_size_m is None else float(cell_size_m)
    inputs = expand(sources)
    pool = DatasetPool()
    try:
        return _open(inputs, pool, cell_size_m, crs, height_range_m)
    except BaseException:
        pool.close()
        raise


def require_known(elevation_m: NDArray[np.float32], name: str) -> None:
    """Raise AllVoidError when no cell of the elevation is known."""
    if np.isnan(elevation_m).all():
        raise AllVoidError(f"{name} holds no known elevation.", "Choose another file or another part of it.")


def _open(
    inputs: Sequence[Source],
    pool: DatasetPool,
    cell_size_m: float | None,
    crs: str | None,
    height_range_m: tuple[float, float] | None,
) -> ElevationSource:
    tiles: list[Tile] = []
    default_cell_size_m = None
    for source in inputs:
        if source.path.startswith(BUNDLED_PREFIX):
            from swathe.io.bundled import bundled_elevation
            from swathe.io.bundled import default_cell_size_m as size_of

            tiles.append(bundled_elevation(source))
            default_cell_size_m = size_of(source)
        else:
            tiles.append(_raster_tile(source, pool, crs, height_range_m))
    _require_one_kind([tile for tile in tiles if isinstance(tile, RasterTile)])
    names = inputs[0].name if len(inputs) == 1 else f"{inputs[0].name} and {len(inputs) - 1} more"
    without = [tile.source.name for tile in tiles if tile.crs_wkt is None]
    if without and len(without) < len(tiles):
        raise MissingCrsError(
            f"{without[0]} has no coordinate reference system and others have one.", "Give its system to the file."
        )
    if without:
        mosaic, target = _local_target(tiles, cell_size_m or default_cell_size_m)
        return ElevationSource(inputs, [mosaic], target, pool, height_range_m=height_range_m)
    mosaics = group_into_mosaics(tiles)
    # A system given for files without one has been used up unless it is a projection.
    wanted = crs
    if crs is not None and any(isinstance(tile, RasterTile) and tile.crs_was_given for tile in tiles):
        wanted = crs if not horizontal(parse_crs(crs)).is_geographic else None
    target = choose_target(mosaics, names, cell_size_m=cell_size_m, crs=wanted, default_cell_size_m=default_cell_size_m)
    return ElevationSource(inputs, mosaics, target, pool, height_range_m=height_range_m)


def _require_one_kind(tiles: Sequence[RasterTile]) -> None:
    """Raise NotElevationError when bytes lie among heights: a folder often holds land cover beside its elevation."""
    of_bytes = [tile.source.name for tile in tiles if tile.dtype == np.uint8]
    if of_bytes and len(of_bytes) < len(tiles):
        raise NotElevationError(
            f"{of_bytes[0]} holds bytes and others hold heights, so it does not look like elevation.",
            "Name the elevation files alone.",
        )


def _raster_tile(
    source: Source, pool: DatasetPool, crs: str | None, height_range_m: tuple[float, float] | None
) -> RasterTile:
    tile = RasterTile(source, pool)
    if crs is not None and tile.crs_wkt is None:
        given = horizontal(parse_crs(crs))
        if not tile.has_place:
            raise MissingCrsError(
                f"{source.name} does not say where it lies, so {crs_name(given)} cannot be its system.",
                "Leave out `--crs` and use `--cell-size`, or add a world file.",
            )
        tile.give_crs(given.to_wkt())
    if height_range_m is not None:
        low_m, high_m = height_range_m
        if not (math.isfinite(low_m) and math.isfinite(high_m) and low_m < high_m):
            raise InvalidParameterError(
                f"The height range {low_m:g} to {high_m:g} m is not one.", "Give the lowest height, then the highest."
            )
        if tile.dtype.kind not in "iu":
            raise InvalidParameterError(
                f"{source.name} holds heights, not shades of grey.", "Leave out `--height-range`."
            )
        tile.grey = GreyScale(low_m, high_m, tile.white)
    elif tile.is_picture and not tile.crs_was_given:
        raise MissingCrsError(
            f"{source.name} has no coordinate reference system, and its shades of grey are no heights yet.",
            "For a grey height map give `--cell-size METRES` and `--height-range LOW,HIGH`.",
        )
    return tile


def _local_target(tiles: Sequence[Tile], cell_size_m: float | None) -> tuple[Mosaic, Target]:
    """Return the mosaic and frame of rasters without a coordinate reference system: metres from the south-west."""
    name = tiles[0].source.name
    if cell_size_m is None:
        raise MissingCrsError(
            f"{name} has no coordinate reference system.",
            "Give its system with `--crs`, or `--cell-size METRES` (and `--height-range LOW,HIGH` for a grey picture) "
            "for a map without a place.",
        )
    place = tiles[0].transform
    if is_rotated(place) or abs(abs(place.a) - abs(place.e)) > 1e-6 * abs(place.a):
        raise MissingCrsError(
            f"{name} has no coordinate reference system and its cells are not square and north-up.",
            "Give its system with `--crs`.",
        )
    mosaics = group_into_mosaics(tiles)
    if len(mosaics) > 1 or (len(tiles) > 1 and not all(isinstance(t, RasterTile) and t.has_place for t in tiles)):
        raise MissingCrsError(
            f"{name} and the others do not say how they lie to each other.", "Name one raster, or georeferenced ones."
        )
    mosaic = mosaics[0]
    geometry = GridGeometry(mosaic.rows, mosaic.columns, cell_size_m, 0.0, mosaic.rows * cell_size_m)
    require_size(geometry, name)
    corner = (mosaic.transform.c, mosaic.transform.f + mosaic.rows * mosaic.transform.e)
    frame = Frame(geometry, None, corner, cell_size_m / abs(mosaic.transform.a))
    return mosaic, Target(frame, warped=False, native_cell_size_m=cell_size_m)


def _fingerprint(source: Source) -> str:
    if not source.path.startswith(BUNDLED_PREFIX):
        return source.fingerprint()
    from swathe.io.bundled import bundled_fingerprint

    return bundled_fingerprint(source)


def _require_inside(window: Window, geometry: GridGeometry) -> None:
    row, column, rows, columns = window
    if not (
        rows > 0 and columns > 0 and 0 <= row <= geometry.rows - rows and 0 <= column <= geometry.columns - columns
    ):
        raise OutsideGridError(
            f"The window of {rows} x {columns} cells at row {row}, column {column} is not inside the map.",
            f"The map has {geometry.rows} rows and {geometry.columns} columns.",
        )


def _empty(window: Window) -> NDArray[np.float32]:
    needed = 4 * window.rows * window.columns
    # Half of the memory, because what is worked out from elevation takes room too.
    if needed > os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2:
        raise TooLargeError(
            f"{window.rows} x {window.columns} cells need {needed / 1e9:.1f} GB, more than half of the memory here.",
            "Use a larger `--cell-size` or a smaller map.",
        )
    return np.full((window.rows, window.columns), np.nan, dtype=np.float32)


def _paste(heights: NDArray[np.float32], window: Window, tile: NDArray[np.float32], row: int, column: int) -> None:
    """Copy the part of a tile that begins at (row, column) of the frame into the window's heights."""
    top, bottom = max(row, window.row), min(row + TILE_SIZE, window.row + window.rows)
    left, right = max(column, window.column), min(column + TILE_SIZE, window.column + window.columns)
    heights[top - window.row : bottom - window.row, left - window.column : right - window.column] = tile[
        top - row : bottom - row, left - column : right - column
    ]


def _report(on_progress: Callable[[int, int], bool] | None, done: int, total: int) -> None:
    # Only False stops: a callback that returns nothing means "go on".
    if on_progress is not None and on_progress(done, total) is False:
        raise InterruptedBySignalError("Reading the elevation was stopped.", "Nothing was written.")
