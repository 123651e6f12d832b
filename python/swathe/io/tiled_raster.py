"""Rasters that are written tile by tile, in any order and over several lives of a process, and end as COGs.

The workbench is a plain TIFF of whole tiles, none compressed, whose layout is final before the first tile is written: a
tile is one write at a known place, so that a process may die at any moment. A COG is made of it in one go.
"""

from __future__ import annotations

import os
import threading
import warnings
from collections import OrderedDict
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import rasterio
import rasterio.shutil
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.errors import NotGeoreferencedWarning
from rasterio.windows import Window as RasterWindow

from swathe.errors import UnreadableFileError
from swathe.io.tile import GDAL_ERRORS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from swathe.grid import Window
    from swathe.io.crs import Frame

TILE_SIZE = 256
# GDAL would keep a twentieth of the memory in blocks that nobody reads again.
CACHE_BYTES = 64 << 20
OPEN_RASTERS = 16
#: Overviews are made until one tile holds all, or one of their cells stands for so many squared.
COARSEST = 64


class Workbench:
    """An uncompressed raster of whole tiles under way. Raises OSError; a disk that is full among others."""

    def __init__(self, path: Path, frame: Frame, dtype: str, tags: Mapping[str, str]) -> None:
        self.path = path
        rows, columns = frame.geometry.shape
        self.tile_rows, self.tile_columns = -(-rows // TILE_SIZE), -(-columns // TILE_SIZE)
        self._dtype = np.dtype(dtype)
        if not path.exists():
            self._make(frame, tags)
        self._first = self._first_offset()
        self._file = path.open("r+b", buffering=0)

    @property
    def tile_bytes(self) -> int:
        """Bytes of one tile."""
        return TILE_SIZE * TILE_SIZE * self._dtype.itemsize

    def write(self, row: int, column: int, tile: NDArray[Any]) -> None:
        """Write a whole tile at its place in tiles."""
        data = memoryview(tile.tobytes())
        place = self._place(row, column)
        while data:
            written = os.pwrite(self._file.fileno(), data, place)
            data, place = data[written:], place + written

    def read(self, row: int, column: int) -> bytes:
        """Return the bytes of a whole tile; fewer where the file ends."""
        return os.pread(self._file.fileno(), self.tile_bytes, self._place(row, column))

    def sync(self) -> None:
        """Wait until the disk holds what was written."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _place(self, row: int, column: int) -> int:
        return self._first + (row * self.tile_columns + column) * self.tile_bytes

    def _make(self, frame: Frame, tags: Mapping[str, str]) -> None:
        """Make the file whole before it takes its name."""
        part = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        profile = _profile(frame, self._dtype) | {
            "driver": "GTiff",
            "tiled": True,
            "blockxsize": TILE_SIZE,
            "blockysize": TILE_SIZE,
            "bigtiff": "YES",
            "sparse_ok": False,
        }
        profile["height"], profile["width"] = self.tile_rows * TILE_SIZE, self.tile_columns * TILE_SIZE
        try:
            with _settings(), rasterio.open(part, "w", **profile) as dataset:
                dataset.update_tags(**tags)
            # GDAL is silent about a disk that is full.
            if part.stat().st_size < self.tile_rows * self.tile_columns * self.tile_bytes:
                raise OSError(28, "No space left on device", str(part))
            part.replace(self.path)
        except GDAL_ERRORS as error:
            raise OSError(28, f"No space left on device ({error})", str(part)) from error
        finally:
            part.unlink(missing_ok=True)

    def _first_offset(self) -> int:
        try:
            with _settings(), rasterio.open(self.path) as dataset:
                return int(dataset.get_tag_item("BLOCK_OFFSET_0_0", "TIFF", bidx=1))
        except (*GDAL_ERRORS, TypeError) as error:
            raise UnreadableFileError(f"{self.path.name} is damaged.", "Begin the import anew.") from error


def write_cog(workbench: Path, target: Path) -> None:
    """Make a COG with overviews of a workbench; the caller checks that it is whole. Raises OSError.

    Overviews hold the mean of known heights, and of codes the value of one cell.
    """
    with _settings():
        try:
            with rasterio.open(workbench) as dataset:
                is_float = np.dtype(dataset.dtypes[0]).kind == "f"
            rasterio.shutil.copy(
                workbench,
                target,
                driver="COG",
                compress="ZSTD",
                level=1,  # 1 % larger than the usual level, in a third of the time
                predictor="YES" if is_float else "NO",
                blocksize=TILE_SIZE,
                overview_resampling="AVERAGE" if is_float else "NEAREST",
                bigtiff="IF_SAFER",
            )
        except GDAL_ERRORS as error:
            raise OSError(28, str(error), str(target)) from error


class RasterReader:
    """Windows of finished rasters; keeps the files open that were read last. Any thread may call it."""

    def __init__(self) -> None:
        self._open: OrderedDict[Path, Any] = OrderedDict()
        self._lock = threading.Lock()

    def read(self, path: Path, window: Window, overview: int = 1) -> NDArray[Any]:
        """Return a window in cells, its sides divided by ``overview`` and rounded up.

        Raises:
            FileNotFoundError: the file is not there.
            UnreadableFileError: it is damaged.
        """
        with self._lock, _settings():
            try:
                dataset = self._dataset(path, overview)
                top, left = window.row // overview, window.column // overview
                rows, columns = -(-window.rows // overview), -(-window.columns // overview)
                part = RasterWindow(left, top, columns, rows)
                if overview > 1 and dataset.width != -(-self._dataset(path, 1).width // overview):
                    # The raster is too small to have this overview.
                    part = RasterWindow(window.column, window.row, columns * overview, rows * overview)
                method = Resampling.average if dataset.dtypes[0].startswith("float") else Resampling.nearest
                numbers: NDArray[Any] = dataset.read(1, window=part, out_shape=(rows, columns), resampling=method)
            except GDAL_ERRORS as error:
                if not path.exists():
                    raise FileNotFoundError(2, "No such file", str(path)) from error
                raise UnreadableFileError(f"{path.name} is damaged.", "Import the layer again.") from error
            return numbers

    def close(self) -> None:
        """Close all files."""
        with self._lock:
            while self._open:
                self._open.popitem()[1].close()

    def _dataset(self, path: Path, overview: int) -> Any:  # noqa: ANN401 - rasterio has no types
        """Return the open dataset of an overview, or of the whole raster when there is no such overview."""
        level = overview.bit_length() - 2
        key = path if level < 0 else path / str(level)
        dataset = self._open.get(key)
        if dataset is None:
            options = {} if level < 0 else {"OVERVIEW_LEVEL": level}
            try:
                dataset = rasterio.open(path, **options)
            except GDAL_ERRORS:
                if level < 0:
                    raise
                return self._dataset(path, 1)
            self._open[key] = dataset
            if len(self._open) > OPEN_RASTERS:
                self._open.popitem(last=False)[1].close()
        self._open.move_to_end(key)
        return dataset


def _profile(frame: Frame, dtype: np.dtype[Any]) -> dict[str, Any]:
    geometry = frame.geometry
    return {
        "height": geometry.rows,
        "width": geometry.columns,
        "count": 1,
        "dtype": dtype.name,
        "nodata": float("nan") if dtype.kind == "f" else 0,
        "crs": None if frame.crs_wkt is None else CRS.from_wkt(frame.crs_wkt),
        "transform": Affine(geometry.cell_size_m, 0, geometry.west_m, 0, -geometry.cell_size_m, geometry.north_m),
    }


@contextmanager
def small_cache() -> Iterator[None]:
    """Let GDAL keep few blocks, for work that reads or writes each block once."""
    with rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        yield


@contextmanager
def _settings() -> Iterator[None]:
    """Hold GDAL's settings for own files."""
    with warnings.catch_warnings(), small_cache(), rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR"):
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield
