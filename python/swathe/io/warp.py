"""Laying rasters onto a north-up lattice of square metric cells, block by block.

Every block of the lattice is made by one call that knows nothing of the window that asked for it, so a window read
lazily is bit-equal to the same window of the whole. GDAL does the resampling; unknown cells are left out of the mean
of a cell, and a cell that has only unknown under it stays unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.io import MemoryFile
from rasterio.vrt import WarpedVRT

from swathe.io.crs import crs_from_wkt, transformer_between

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swathe.io.mosaic import Mosaic

# From this ratio of cell sizes on, a cell is the mean of the source cells under it instead of an interpolation.
AVERAGE_FROM_RATIO = 2.0
# Edge of the largest source block held at once; coarser maps are made in smaller blocks.
SOURCE_EDGE_LIMIT = 4096
# GDAL interpolates coordinates between exact ones up to this error, in source cells: its own default of 1/8 cell
# would move a height on a 30 % slope of 90 m cells by 3 m.
COORDINATE_TOLERANCE = 0.01
# Source cells around a block that interpolation may touch.
MARGIN_CELLS = 4
PROBES = 17
TURN_DEG = 360.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """A box of coordinates."""

    west: float
    south: float
    east: float
    north: float

    def united(self, other: Bounds) -> Bounds:
        """Return the box around both."""
        return Bounds(
            min(self.west, other.west),
            min(self.south, other.south),
            max(self.east, other.east),
            max(self.north, other.north),
        )


class Warp:
    """One mosaic laid onto a lattice with its origin at (``west_m``, ``north_m``)."""

    def __init__(self, mosaic: Mosaic, crs_wkt: str, west_m: float, north_m: float, cell_size_m: float) -> None:
        self._mosaic = mosaic
        self._source_crs = CRS.from_wkt(mosaic.crs_wkt)
        # The very same system must not be sent through a projection and back.
        same = mosaic.crs_wkt == crs_wkt
        self._target_crs = self._source_crs if same else CRS.from_wkt(crs_wkt)
        self._to_source = None if same else transformer_between(crs_wkt, str(mosaic.crs_wkt))
        self._turns = not same and crs_from_wkt(str(mosaic.crs_wkt)).is_geographic
        self._lattice = Affine(cell_size_m, 0, west_m, 0, -cell_size_m, north_m)
        self.ratio = self._cells_per_target(Bounds(*_extent(mosaic)), crs_wkt, cell_size_m)

    def _cells_per_target(self, extent: Bounds, crs_wkt: str, cell_size_m: float) -> float:
        """Return how many source cells one target cell is wide, at the middle of the data."""
        x, y = (extent.west + extent.east) / 2, (extent.south + extent.north) / 2
        if self._to_source is not None:
            x, y = transformer_between(str(self._mosaic.crs_wkt), crs_wkt).transform(x, y)
        half = cell_size_m / 2
        columns, rows = self._source_cells(np.array([x - half, x + half, x, x]), np.array([y, y, y - half, y + half]))
        across = math.hypot(columns[1] - columns[0], rows[1] - rows[0])
        along = math.hypot(columns[3] - columns[2], rows[3] - rows[2])
        ratio = math.sqrt(across * along)
        return ratio if math.isfinite(ratio) and ratio > 0 else 1.0

    def block(self, row: int, column: int, edge: int) -> NDArray[np.float32]:
        """Return the square block of ``edge`` cells that begins at (row, column) of the lattice; NaN = unknown."""
        part = edge
        while part * self.ratio > SOURCE_EDGE_LIMIT and part > 1:
            part //= 2
        heights = np.full((edge, edge), np.nan, dtype=np.float32)
        for top in range(0, edge, part):
            for left in range(0, edge, part):
                self._fill(heights[top : top + part, left : left + part], row + top, column + left)
        return heights

    def _fill(self, heights: NDArray[np.float32], row: int, column: int) -> None:
        rows, columns = heights.shape
        place = self._lattice @ Affine.translation(column, row)
        window = self._source_window(place, rows, columns)
        if window is None:
            return
        top, left, height, width = window
        numbers = self._mosaic.read(top, left, height, width)
        if np.isnan(numbers).all():
            return
        source_place = self._mosaic.transform @ Affine.translation(left, top)
        if self._turns:  # GDAL's longitudes are within half a turn of Greenwich
            middle = source_place.c + source_place.a * width / 2
            source_place = Affine.translation(-TURN_DEG * round(middle / TURN_DEG), 0) @ source_place
        resampling = Resampling.average if self.ratio >= AVERAGE_FROM_RATIO else Resampling.bilinear
        heights[:] = warp_array(
            numbers,
            source_place,
            self._source_crs,
            np.nan,
            place=place,
            crs=self._target_crs,
            shape=(rows, columns),
            resampling=resampling,
        )

    def _source_window(self, place: Affine, rows: int, columns: int) -> tuple[int, int, int, int] | None:
        """Return (row, column, rows, columns) of the source cells under a block, or None when there are none."""
        across, along = np.meshgrid(np.linspace(0, columns, PROBES), np.linspace(0, rows, PROBES))
        source_columns, source_rows = self._source_cells(place.c + place.a * across, place.f + place.e * along)
        known = np.isfinite(source_columns) & np.isfinite(source_rows)
        if not known.any():
            return None
        margin = MARGIN_CELLS + math.ceil(2 * self.ratio)
        top = math.floor(source_rows[known].min()) - margin
        bottom = math.ceil(source_rows[known].max()) + margin
        left = math.floor(source_columns[known].min()) - margin
        right = math.ceil(source_columns[known].max()) + margin
        if self._turns and (right - left) * abs(self._mosaic.transform.a) > TURN_DEG / 2:
            # The block holds a pole: every longitude, and the rows up to the pole.
            left, right = 0, self._mosaic.columns
            top, bottom = (0, bottom) if top < self._mosaic.rows / 2 else (top, self._mosaic.rows)
        top, left = max(top, 0), max(left, 0)
        bottom, right = min(bottom, self._mosaic.rows), min(right, self._mosaic.columns)
        return (top, left, bottom - top, right - left) if top < bottom and left < right else None

    def _source_cells(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the fractional columns and rows of the mosaic at coordinates of the target."""
        if self._to_source is not None:
            x, y = self._to_source.transform(x, y)
        if self._turns:
            west, _, east, _ = _extent(self._mosaic)
            with np.errstate(invalid="ignore"):
                x = x + TURN_DEG * np.round(((west + east) / 2 - x) / TURN_DEG)
        inverse = ~self._mosaic.transform
        with np.errstate(invalid="ignore"):
            return (
                inverse.a * x + inverse.b * y + inverse.c,
                inverse.d * x + inverse.e * y + inverse.f,
            )


def warp_array(
    numbers: NDArray[Any],
    source_place: Affine,
    source_crs: CRS,
    nodata: float,
    *,
    place: Affine,
    crs: CRS,
    shape: tuple[int, int],
    resampling: Resampling,
) -> NDArray[Any]:
    """Return an array laid onto the cells of another; ``nodata`` is left out, and stands where nothing lies."""
    rows, columns = numbers.shape
    # The plain reprojection call of rasterio has a fixed tolerance; only a warped dataset lets it be chosen.
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff",
            height=rows,
            width=columns,
            count=1,
            dtype=numbers.dtype.name,
            crs=source_crs,
            transform=source_place,
            nodata=nodata,
        ) as dataset:
            dataset.write(numbers, 1)
        with (
            memory.open() as dataset,
            WarpedVRT(
                dataset,
                crs=crs,
                transform=place,
                height=shape[0],
                width=shape[1],
                resampling=resampling,
                src_nodata=nodata,
                nodata=nodata,
                tolerance=COORDINATE_TOLERANCE,
                # Left alone, GDAL widens the kernel by a ratio that it guesses anew for every block.
                XSCALE=1,
                YSCALE=1,
            ) as warped,
        ):
            result: NDArray[Any] = warped.read(1)
            return result


def _extent(mosaic: Mosaic) -> tuple[float, float, float, float]:
    corners = [mosaic.transform @ (c, r) for c in (0, mosaic.columns) for r in (0, mosaic.rows)]
    x, y = [corner[0] for corner in corners], [corner[1] for corner in corners]
    return (min(x), min(y), max(x), max(y))


def bounds_in(mosaic: Mosaic, crs_wkt: str) -> Bounds | None:
    """Return the box of a mosaic in another system, its edges and inside followed; None when nothing has a place."""
    across, along = np.meshgrid(np.linspace(0, mosaic.columns, 2 * PROBES), np.linspace(0, mosaic.rows, 2 * PROBES))
    place = mosaic.transform
    x = place.a * across + place.b * along + place.c
    y = place.d * across + place.e * along + place.f
    if mosaic.crs_wkt != crs_wkt:
        x, y = transformer_between(str(mosaic.crs_wkt), crs_wkt).transform(x, y)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return None
    return Bounds(float(x[known].min()), float(y[known].min()), float(x[known].max()), float(y[known].max()))
