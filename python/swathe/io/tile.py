"""One elevation raster as heights in metres: everything that makes a number not a height is decided here.

Unknown (NaN) are: the declared no-data value, cells masked out, NaN and infinity, the customary stand-ins for "nothing
here", and heights that no place on the body can have.
"""

from __future__ import annotations

import threading
import warnings
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import rasterio
from affine import Affine
from rasterio._err import CPLE_BaseError
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window as RasterWindow

from swathe.errors import NotElevationError, UnreadableFileError
from swathe.io.crs import crs_from_wkt, height_unit_m, horizontal, is_earth
from swathe.io.sources import REMOTE_SETTINGS, Source

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

# GDAL's own errors have no public name in rasterio, and not all of them come wrapped.
GDAL_ERRORS = (RasterioError, CPLE_BaseError)
# Deeper and higher than any place on Earth; on other bodies only what is no height at all is refused.
EARTH_LIMIT_M = 20_000.0
OTHER_BODY_LIMIT_M = 1e7
# Written by many programs for "nothing here" without declaring it.
CUSTOMARY_VOIDS = (-9999.0, -32767.0, -32768.0)
OPEN_FILES = 64
HEIGHT_WORDS = ("elev", "height", "altitude", "dem", "dtm", "dsm")
UNIT_M = {
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "international foot": 0.3048, "international feet": 0.3048,
    "us survey foot": 1200 / 3937, "us survey feet": 1200 / 3937, "us-ft": 1200 / 3937, "us_ft": 1200 / 3937,
    "ftus": 1200 / 3937, "us foot": 1200 / 3937, "foot_us": 1200 / 3937,
    "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01, "centimeters": 0.01, "dm": 0.1, "decimetre": 0.1,
    "decimeter": 0.1, "decimeters": 0.1, "km": 1000.0, "kilometre": 1000.0, "kilometer": 1000.0,
}  # fmt: skip


class Tile(Protocol):
    """A raster of heights, north up and west left unless it is rotated."""

    @property
    def source(self) -> Source:
        """Where it comes from."""

    @property
    def rows(self) -> int:
        """Rows."""

    @property
    def columns(self) -> int:
        """Columns."""

    @property
    def transform(self) -> Affine:
        """Coordinates from (column, row) of cell corners."""

    @property
    def crs_wkt(self) -> str | None:
        """The system of the coordinates, heights left out; None without one."""

    @property
    def is_picture(self) -> bool:
        """True when numbers are shades of grey, not heights."""

    def read(self, row: int, column: int, rows: int, columns: int) -> NDArray[np.float32]:
        """Return the heights of a block that lies inside, metres, NaN = unknown."""


@dataclass(frozen=True)
class GreyScale:
    """The heights in metres of black and white, and the number that is white."""

    low_m: float
    high_m: float
    white: float


class DatasetPool:
    """Open datasets, the least recently used closed first, so that thousands of tiles never exhaust the system.

    ``bytes_read`` counts the decoded numbers that were read.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[str, Any] = OrderedDict()
        self.bytes_read = 0
        self.lock = threading.RLock()

    def dataset(self, source: Source) -> Any:  # noqa: ANN401 - rasterio has no types
        """Return the open dataset of a source. Raises UnreadableFileError when it cannot be opened."""
        dataset = self._open.get(source.path)
        if dataset is None:
            dataset = open_dataset(source)
            self._open[source.path] = dataset
            if len(self._open) > OPEN_FILES:
                self._open.popitem(last=False)[1].close()
        self._open.move_to_end(source.path)
        return dataset

    def close(self) -> None:
        """Close every dataset."""
        with self.lock:
            while self._open:
                self._open.popitem()[1].close()


def open_dataset(source: Source) -> Any:  # noqa: ANN401 - rasterio has no types
    """Open a raster. Raises UnreadableFileError (MissingFileError for an address that does not exist)."""
    try:
        with gdal_settings(source), warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            return rasterio.open(source.path)
    except GDAL_ERRORS as error:
        raise source.refusal(error) from error


def gdal_settings(source: Source) -> Any:  # noqa: ANN401 - rasterio has no types
    """Return the context manager that holds GDAL's settings for reading a source."""
    return rasterio.Env(**(REMOTE_SETTINGS if source.is_remote else {}))


def declared_crs_wkt(dataset: Any) -> str | None:  # noqa: ANN401 - rasterio has no types
    """Return the coordinate reference system of a dataset as WKT, or None: an unnamed local system is none."""
    if not dataset.crs:
        return None
    wkt = str(dataset.crs.to_wkt())
    return None if wkt.startswith(("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS")) else wkt


def placed_transform(transform: Affine, rows: int) -> tuple[Affine, bool]:
    """Return where a raster's cells lie and whether the file says so.

    A raster without any place gets cells of one unit with the south-west corner at (0, 0).
    """
    if transform == Affine.identity():
        return Affine(1, 0, 0, 0, -1, rows), False
    return transform, True


class RasterTile:
    """A raster file as a tile. Rows run southward and columns eastward, however the file stores them."""

    def __init__(self, source: Source, pool: DatasetPool) -> None:
        self.source = source
        self._pool = pool
        dataset = pool.dataset(source)
        self._band = _elevation_band(source, dataset)
        _require_numbers(source, dataset, self._band)
        self.rows, self.columns = int(dataset.height), int(dataset.width)
        self._set_transform(dataset.transform)
        wkt = declared_crs_wkt(dataset)
        crs = None if wkt is None else crs_from_wkt(wkt)
        has_heights = crs is not None and len(crs.axis_info) > 2
        self.crs_wkt = horizontal(crs).to_wkt() if crs is not None and has_heights else wkt
        self.crs_was_given = False
        self.dtype = np.dtype(dataset.dtypes[self._band - 1])
        bits = dataset.tags(self._band, ns="IMAGE_STRUCTURE").get("NBITS")
        self.white = float((1 << int(bits)) - 1 if bits else np.iinfo(self.dtype).max if self.dtype.kind in "iu" else 1)
        # A byte cannot hold the heights of any but the flattest land, and a PNG is a picture first.
        self.is_picture = wkt is None and (self.dtype in (np.uint8, np.uint16) or dataset.driver == "PNG")
        self.grey: GreyScale | None = None
        # In full-width strips a narrow block costs as much as a wide one.
        self.is_tiled = dataset.block_shapes[self._band - 1][1] < self.columns
        self._nodata = dataset.nodatavals[self._band - 1]
        flags = dataset.mask_flag_enums[self._band - 1]
        self._has_mask = MaskFlags.per_dataset in flags or MaskFlags.alpha in flags
        self._scale, self._offset = dataset.scales[self._band - 1], dataset.offsets[self._band - 1]
        unit = UNIT_M.get((dataset.units[self._band - 1] or "").strip().lower())
        self._unit_m = unit if unit is not None else ((crs and height_unit_m(crs)) or 1.0)
        self._limit_m = EARTH_LIMIT_M if crs is None or is_earth(crs) else OTHER_BODY_LIMIT_M

    def give_crs(self, wkt: str) -> None:
        """Take ``wkt`` as the system of a file that does not say its own."""
        self.crs_wkt = wkt
        self.crs_was_given = True
        self._limit_m = EARTH_LIMIT_M if is_earth(crs_from_wkt(wkt)) else OTHER_BODY_LIMIT_M

    def _set_transform(self, transform: Affine) -> None:
        transform, self.has_place = placed_transform(transform, self.rows)
        rotated = transform.b != 0 or transform.d != 0
        self._flip_rows = not rotated and transform.e > 0
        self._flip_columns = not rotated and transform.a < 0
        if self._flip_rows:
            transform = transform @ Affine.translation(0, self.rows) @ Affine.scale(1, -1)
        if self._flip_columns:
            transform = transform @ Affine.translation(self.columns, 0) @ Affine.scale(-1, 1)
        self.transform = transform

    def read(self, row: int, column: int, rows: int, columns: int) -> NDArray[np.float32]:
        """Return the heights of a block that lies inside, metres, NaN = unknown. Raises UnreadableFileError."""
        file_row = self.rows - row - rows if self._flip_rows else row
        file_column = self.columns - column - columns if self._flip_columns else column
        window = RasterWindow(file_column, file_row, columns, rows)
        try:
            with self._pool.lock, gdal_settings(self.source):
                dataset = self._pool.dataset(self.source)
                numbers = dataset.read(self._band, window=window)
                self._pool.bytes_read += numbers.nbytes
                masked = dataset.read_masks(self._band, window=window) == 0 if self._has_mask else None
        except GDAL_ERRORS as error:
            raise self.source.refusal(error) from error
        heights = self._heights(numbers)
        if masked is not None:
            heights[masked] = np.nan
        if self._flip_rows:
            heights = heights[::-1]
        if self._flip_columns:
            heights = heights[:, ::-1]
        return np.ascontiguousarray(heights)

    def _heights(self, numbers: NDArray[Any]) -> NDArray[np.float32]:
        """Return numbers of the file as metres."""
        with np.errstate(over="ignore", invalid="ignore"):
            if self.grey is not None:
                span_m = self.grey.high_m - self.grey.low_m
                heights = (self.grey.low_m + numbers.astype(np.float64) * (span_m / self.grey.white)).astype(np.float32)
            elif self._scale == 1 and self._offset == 0 and self._unit_m == 1:
                heights = numbers.astype(np.float32)
            else:
                metres = (numbers.astype(np.float64) * self._scale + self._offset) * self._unit_m
                heights = metres.astype(np.float32)
            for void in self._voids():
                heights[numbers == void] = np.nan
            heights[~(np.abs(heights) <= self._limit_m)] = np.nan
        return heights

    def _voids(self) -> Iterator[float]:
        if self._nodata is not None:
            yield self._nodata
        if self.grey is None and self.dtype.kind != "u":
            yield from CUSTOMARY_VOIDS


def _elevation_band(source: Source, dataset: Any) -> int:  # noqa: ANN401 - rasterio has no types
    """Return the number of the band that holds the elevation."""
    count = int(dataset.count)
    if count == 0:
        inside = ", ".join(dataset.subdatasets[:5])
        raise UnreadableFileError(
            f"{source.name} holds several rasters and none by itself." if inside else f"{source.name} holds no raster.",
            f"Name one of {inside}." if inside else "Name a raster file.",
        )
    if count == 1 or (count == 2 and dataset.colorinterp[1] == ColorInterp.alpha):
        return 1
    named = [
        band
        for band, description in enumerate(dataset.descriptions, start=1)
        if any(word in (description or "").lower() for word in HEIGHT_WORDS)
    ]
    if len(named) == 1:
        return named[0]
    raise NotElevationError(
        f"{source.name} has {count} bands and none is named as elevation; it looks like a picture.",
        "Name a raster with one band of heights.",
    )


def _require_numbers(source: Source, dataset: Any, band: int) -> None:  # noqa: ANN401 - rasterio has no types
    if dataset.colorinterp[band - 1] == ColorInterp.palette:
        raise NotElevationError(
            f"{source.name} is a picture with a colour table, not elevation.", "Name a raster of heights."
        )
    if dataset.dtypes[band - 1].startswith("complex"):
        raise NotElevationError(f"{source.name} holds complex numbers, not elevation.", "Name a raster of heights.")
