"""Writing a raster into a project folder: tiles on a workbench, then a COG, then one switch in the GeoPackage."""

from __future__ import annotations

import fcntl
import os
import shutil
import struct
import zlib
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from swathe.errors import InvalidParameterError, ShapeMismatchError, StoreBusyError, StoreFullError, UnreadableFileError
from swathe.grid import Window
from swathe.io.tiled_raster import RasterReader, Workbench, write_cog
from swathe.store.file_rows import as_json
from swathe.store.geopackage import sync_folder, told_apart
from swathe.store.interface import TILE_SIZE, ImportSession

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from numpy.typing import NDArray

    from swathe.io.crs import Frame
    from swathe.store.files import FileStore
    from swathe.store.interface import LayerInfo

DTYPES = ("float32", "uint8", "uint16", "int32")
#: Row, column and checksum of a tile that is whole, and the checksum of these three.
_ENTRY = struct.Struct("<IIII")


class LayerLock:
    """One writer for each layer. It ends with its process, however that ends. A context manager.

    Raises:
        StoreBusyError: another writer has it.
    """

    def __init__(self, path: Path, what: str, store: Path) -> None:
        self._handle = -1
        with told_apart(store):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                self.release()
                raise StoreBusyError(
                    f"Another import of {what} is under way.", "Wait until it is done, then try again."
                ) from error

    def release(self) -> None:
        """Let others write."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


class FileImport(ImportSession):
    """A raster of a project folder under way; see ``ImportSession``."""

    def __init__(self, store: FileStore, region: str, frame: Frame, layer: LayerInfo, lock: LayerLock) -> None:
        if layer.dtype not in DTYPES:
            raise InvalidParameterError(
                f"A raster of {layer.dtype} cannot be stored.", f"Give one of {', '.join(DTYPES)}."
            )
        self._store, self._region, self._frame, self._layer = store, region, frame, layer
        self._folder, self._lock = store.staging(region, layer.name), lock
        self._row = store.region_row(region)
        self._bench: Workbench | None = None
        self._journal = -1
        self._checksums: dict[tuple[int, int], int] = {}
        self.is_current = store.holds(region, layer)
        if self.is_current:
            shutil.rmtree(self._folder, ignore_errors=True)

    def have(self) -> frozenset[tuple[int, int]]:
        """Return the tiles that an earlier, unfinished session has left whole."""
        with self._told_apart():
            self._begin()
        return frozenset(self._checksums)

    def write_tile(self, row: int, column: int, tile: NDArray[Any]) -> None:
        """Write one tile, counted in tiles; at the south and east edge it may be smaller than TILE_SIZE squared."""
        with self._told_apart():
            bench = self._begin()
            whole = self._whole(bench, row, column, tile)
            bench.write(row, column, whole)
            checksum = zlib.crc32(whole.tobytes())
            head = _ENTRY.pack(row, column, checksum, 0)[:12]
            # The journal comes after the tile: what it lists is there, unless the machine itself fell.
            entry = head + struct.pack("<I", zlib.crc32(head))
            if os.write(self._journal, entry) != len(entry):
                raise OSError(28, "No space left on device")
            self._checksums[row, column] = checksum

    def commit(self) -> None:
        """Put the layer into the place of the old one, in one step; see ``ImportSession.commit``."""
        if self.is_current:
            return
        with self._told_apart():
            bench = self._begin()
            bench.sync()
            made = self._folder / "cog.tif"
            made.unlink(missing_ok=True)
            write_cog(bench.path, made)
            self._require_whole(made, bench)
            handle = os.open(made, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
            place = self._store.raster_place(self._region, self._layer)
            target = self._store.folder / place
            target.parent.mkdir(parents=True, exist_ok=True)
            made.replace(target)
            sync_folder(target.parent)
            self._store.switch_raster(self._row, self._layer, place)
            self._end()
            shutil.rmtree(self._folder, ignore_errors=True)
        self.is_current = True

    def abort(self) -> None:
        """Throw away what was written; the old layer stands."""
        self._end()
        shutil.rmtree(self._folder, ignore_errors=True)

    def close(self) -> None:
        """Let go of the layer; what was written stays for the next session."""
        self._end()
        self._lock.release()

    def _told_apart(self) -> Any:  # noqa: ANN401 - a context manager
        return told_apart(self._store.file)

    def _begin(self) -> Workbench:
        """Return the workbench, with what an earlier session of the same source has left on it."""
        if self._bench is not None:
            return self._bench
        note = self._folder / "import.json"
        this = as_json({"digest": self._layer.provenance.digest, "dtype": self._layer.dtype})
        try:
            same = note.read_text(encoding="utf-8") == this
        except (OSError, UnicodeDecodeError):
            same = False
        if not same:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder.mkdir(parents=True)
        tags = {"SOURCE": as_json(self._layer.provenance.inputs), "LICENCE": self._layer.provenance.licence}
        path = self._folder / "tiles.tif"
        try:
            bench = Workbench(path, self._frame, self._layer.dtype, tags)
        except UnreadableFileError:
            path.unlink(missing_ok=True)
            (self._folder / "done").unlink(missing_ok=True)
            bench = Workbench(path, self._frame, self._layer.dtype, tags)
        self._bench = bench
        self._read_journal(bench)
        if not same:
            note.write_text(this, encoding="utf-8")
        return bench

    def _read_journal(self, bench: Workbench) -> None:
        self._journal = os.open(self._folder / "done", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        listed = os.pread(self._journal, os.fstat(self._journal).st_size, 0)
        whole = len(listed) - len(listed) % _ENTRY.size
        for row, column, checksum, check in _ENTRY.iter_unpack(listed[:whole]):
            head = _ENTRY.pack(row, column, checksum, 0)[:12]
            inside = row < bench.tile_rows and column < bench.tile_columns
            if check == zlib.crc32(head) and inside and zlib.crc32(bench.read(row, column)) == checksum:
                self._checksums[row, column] = checksum
            else:
                self._checksums.pop((row, column), None)
        os.ftruncate(self._journal, whole)
        os.lseek(self._journal, 0, os.SEEK_END)

    def _whole(self, bench: Workbench, row: int, column: int, tile: NDArray[Any]) -> NDArray[Any]:
        rows, columns = self._frame.geometry.shape
        inside = 0 <= row < bench.tile_rows and 0 <= column < bench.tile_columns
        expected = (min(TILE_SIZE, rows - row * TILE_SIZE), min(TILE_SIZE, columns - column * TILE_SIZE))
        if not inside or tile.shape not in {expected, (TILE_SIZE, TILE_SIZE)}:
            raise ShapeMismatchError(
                f"A tile of shape {tile.shape} does not fit at row {row}, column {column} of the tiles.",
                f"The raster has {bench.tile_rows} x {bench.tile_columns} tiles of {TILE_SIZE} x {TILE_SIZE} cells.",
            )
        dtype = np.dtype(self._layer.dtype)
        whole = np.full((TILE_SIZE, TILE_SIZE), np.nan if dtype.kind == "f" else 0, dtype=dtype)
        whole[: expected[0], : expected[1]] = tile[: expected[0], : expected[1]]
        return whole

    def _require_whole(self, made: Path, bench: Workbench) -> None:
        """Raise StoreFullError unless the COG holds every tile that was written: GDAL is silent about a full disk."""
        reader = RasterReader()
        try:
            for row in range(bench.tile_rows):
                band = reader.read(made, Window(row * TILE_SIZE, 0, TILE_SIZE, bench.tile_columns * TILE_SIZE))
                for column in range(bench.tile_columns):
                    expected = self._checksums.get((row, column))
                    tile = band[:, column * TILE_SIZE : (column + 1) * TILE_SIZE]
                    if expected is not None and zlib.crc32(tile.tobytes()) != expected:
                        raise UnreadableFileError(f"{made.name} is not whole.")  # noqa: TRY301 - one refusal
        except (UnreadableFileError, FileNotFoundError) as error:
            made.unlink(missing_ok=True)
            raise StoreFullError(
                f"The new layer could not be written whole in {self._store.folder}.",
                "Free some space and give the command again; it goes on where it stopped.",
            ) from error
        finally:
            reader.close()

    def _end(self) -> None:
        if self._bench is not None:
            self._bench.close()
            self._bench = None
        if self._journal >= 0:
            os.close(self._journal)
            self._journal = -1
        self._checksums.clear()
