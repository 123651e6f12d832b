"""The store that needs no server: a folder of COGs and one GeoPackage, which QGIS opens as they are.

    PROJECT/swathe.gpkg                     regions, layers, soil, zones, readings, routes, runs, changes
    PROJECT/elevation/REGION.DIGEST.tif     heights, 256 x 256 blocks with overviews
    PROJECT/staging/                        imports that are not finished

The row of a layer names its file or table. A new one is made whole beside the old and the row is changed in one
transaction, so that there is never a mixture. SQLite's journal (WAL, every commit synced) makes the rest safe.
"""

from __future__ import annotations

import difflib
import re
import shutil
import sqlite3
import threading
import time
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from swathe.errors import (
    MissingLayerError,
    MissingRegionError,
    RegionConflictError,
    StoreDamagedError,
    StoreReadOnlyError,
    UnreadableFileError,
)
from swathe.io.tiled_raster import RasterReader
from swathe.store import file_polygons, file_rows
from swathe.store.file_import import FileImport, LayerLock
from swathe.store.geopackage import (
    add_feature_table,
    blobs,
    connect,
    drop_feature_table,
    quoted,
    reference_system,
    told_apart,
    wkb_of,
)
from swathe.store.interface import (
    SOIL,
    ZONES,
    Change,
    LayerInfo,
    Provenance,
    RegionInfo,
    StoredReading,
    StoredRoute,
    StoredRun,
    Subscription,
    TerrainStore,
    require_selection,
    require_window,
    require_within,
)
from swathe.store.naming import checked_name, label

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import DTypeLike, NDArray

    from swathe.grid import Window
    from swathe.io.crs import Frame
    from swathe.store.interface import Bounds, ImportSession, SoilPolygon, Zone

GEOPACKAGE = "swathe.gpkg"
POLL_S = 0.1
#: How often a raster is looked up again that went away between the look-up and the reading.
LOOKUPS = 5


def now() -> str:
    """Return the time as ISO 8601 in UTC."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


class FileStore(TerrainStore):
    """A project folder; see ``TerrainStore`` for what it does. Any thread may call it."""

    def __init__(self, folder: Path, *, create: bool = False) -> None:
        self.folder = folder
        self.file = folder / GEOPACKAGE
        self.address = str(folder)
        self._connection, self._writable = connect(self.file, create=create)
        self._lock = threading.RLock()
        self._rasters = RasterReader()

    def close(self) -> None:
        """Let go of the files."""
        with self._lock:
            self._rasters.close()
            self._connection.close()

    # Regions

    def create_region(self, name: str, frame: Frame) -> RegionInfo:
        """Make a region, or return the one that is there; see ``TerrainStore.create_region``."""
        name = checked_name(name)
        geometry, (file_x, file_y) = frame.geometry, frame.file_origin
        with self.writing() as connection:
            columns = file_rows.REGION_COLUMNS
            row = connection.execute(f"SELECT {columns} FROM regions WHERE name = ?", (name,)).fetchone()
            if row is None:
                srs = reference_system(connection, frame.crs_wkt)
                cursor = connection.execute(
                    "INSERT INTO regions (geom, name, rows, columns, cell_size_m, west_m, north_m, crs, srs, file_x, "
                    "file_y, file_unit_m, label) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        file_rows.outline(frame), name, geometry.rows, geometry.columns, geometry.cell_size_m,
                        geometry.west_m, geometry.north_m, frame.crs_wkt, srs, file_x, file_y, frame.file_unit_m,
                        label(name),
                    ),
                )  # fmt: skip
                self._add_tables(connection, name, srs)
                file_rows.add_change(connection, int(cursor.lastrowid or 0), now(), "region", subject=name)
            elif file_rows.frame_of(row) != frame:
                raise RegionConflictError(
                    f"The region {name!r} lies on other cells.",
                    "Choose another name, or drop the region first; the cells of a region never change.",
                )
        return self.region(name)

    @staticmethod
    def _add_tables(connection: sqlite3.Connection, name: str, srs: int) -> None:
        for what, kind, table in (
            ("readings", "POINT", file_rows.READING_TABLE),
            ("routes", "LINESTRING", file_rows.ROUTE_TABLE),
        ):
            table_name = f"{what}_{label(name)}"
            connection.execute(f"CREATE TABLE {quoted(table_name)} {table}")
            add_feature_table(connection, table_name, kind, srs, description=f"{what} of {name}")

    def regions(self) -> list[RegionInfo]:
        """Return all regions, by name."""
        with self.reading() as connection:
            names = connection.execute("SELECT name FROM regions ORDER BY name").fetchall()
            return [self.region(name) for (name,) in names]

    def region(self, name: str) -> RegionInfo:
        """Return a region as it is now."""
        with self.reading() as connection:
            row = self._row(name)
            layers = connection.execute(
                f"SELECT {file_rows.LAYER_COLUMNS} FROM layers WHERE region = ? ORDER BY name",
                (row[0],),
            ).fetchall()
        found = [file_rows.layer_of(layer) for layer in layers]
        return RegionInfo(row[1], file_rows.frame_of(row), {layer.name: layer for layer in found})

    def drop_region(self, name: str) -> None:
        """Remove a region with everything in it."""
        with self.writing() as connection:
            row = self._row(name)
            fid, own = row[0], row[12]
            places = connection.execute("SELECT kind, place FROM layers WHERE region = ?", (fid,)).fetchall()
            tables = [place for kind, place in places if kind == "polygons"]
            for table in (*tables, f"readings_{own}", f"routes_{own}"):
                drop_feature_table(connection, table)
            for listing in ("layers", "withdrawals", "runs", "changes"):
                connection.execute(f"DELETE FROM {listing} WHERE region = ?", (fid,))
            connection.execute("DELETE FROM regions WHERE fid = ?", (fid,))
        for kind, place in places:
            if kind == "raster":
                (self.folder / place).unlink(missing_ok=True)
        for left in self.folder.glob(f"staging/{own}.*"):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)

    # Rasters

    def begin_import(
        self,
        region: str,
        layer: str,
        provenance: Provenance,
        *,
        dtype: DTypeLike = "float32",
        details: Mapping[str, Any] | None = None,
    ) -> ImportSession:
        """Begin to write a raster; see ``TerrainStore.begin_import``."""
        self._require_writable()
        info = LayerInfo(checked_name(layer, "layer"), "raster", np.dtype(dtype).name, provenance, details or {})
        found = self.region(region)
        lock = self.layer_lock(region, layer)
        try:
            return FileImport(self, region, found.frame, info, lock)
        except BaseException:
            lock.release()
            raise

    def read_window(self, region: str, layer: str, window: Window, *, overview: int = 1) -> NDArray[Any]:
        """Return a window of a raster; see ``TerrainStore.read_window``."""
        for attempt in range(LOOKUPS):
            with self.reading():
                row = self._row(region)
                require_window(file_rows.frame_of(row).geometry, window, overview)
                kind, place = self._layer_place(row, layer)
            if kind != "raster":
                raise MissingLayerError(f"The layer {layer!r} of {region!r} is no raster.", "Read its polygons.")
            try:
                return self._rasters.read(self.folder / place, window, overview)
            except FileNotFoundError:
                # A new layer took its place just now.
                time.sleep(0.02 * attempt)
            except UnreadableFileError as error:
                raise StoreDamagedError(
                    f"{place} in {self.folder} is damaged.", f"Import the {layer} of {region!r} again."
                ) from error
        raise StoreDamagedError(f"{place} in {self.folder} is missing.", f"Import the {layer} of {region!r} again.")

    # Polygons

    def write_soil_polygons(
        self,
        region: str,
        batches: Iterable[Sequence[SoilPolygon]],
        provenance: Provenance,
        *,
        details: Mapping[str, Any] | None = None,
    ) -> bool:
        """Replace the soil map; see ``TerrainStore.write_soil_polygons``."""
        rows = (file_polygons.soil_rows(batch) for batch in batches)
        return file_polygons.write(self, region, LayerInfo(SOIL, "polygons", "", provenance, details or {}), rows)

    def soil_polygons(self, region: str, bounds: Bounds | None = None) -> Iterator[SoilPolygon]:
        """Yield soil polygons; see ``TerrainStore.soil_polygons``."""
        return map(file_polygons.soil_of, file_polygons.read(self, region, SOIL, bounds))

    def write_zones(
        self,
        region: str,
        batches: Iterable[Sequence[Zone]],
        provenance: Provenance,
        *,
        details: Mapping[str, Any] | None = None,
    ) -> bool:
        """Replace the zones; see ``TerrainStore.write_zones``."""
        rows = (file_polygons.zone_rows(batch) for batch in batches)
        return file_polygons.write(self, region, LayerInfo(ZONES, "polygons", "", provenance, details or {}), rows)

    def zones(self, region: str, bounds: Bounds | None = None) -> Iterator[Zone]:
        """Yield zones; see ``TerrainStore.zones``."""
        return map(file_polygons.zone_of, file_polygons.read(self, region, ZONES, bounds))

    # Readings

    def add_readings(self, region: str, readings: Sequence[StoredReading]) -> int:
        """File readings; see ``TerrainStore.add_readings``."""
        require_within(self.region(region), readings)
        with self.writing() as connection:
            row = self._row(region)
            fid, srs, table = row[0], row[8], quoted(f"readings_{row[12]}")
            new = []
            for stored in {stored.id: stored for stored in reversed(readings)}.values():
                known = connection.execute(f"SELECT 1 FROM {table} WHERE id = ?", (stored.id,)).fetchone()
                if known is None:
                    new.append(stored)
            if not new:
                return 0
            new.reverse()
            authors = sorted({stored.author for stored in new})
            revision = file_rows.add_change(
                connection,
                fid,
                now(),
                "readings",
                count=len(new),
                author=authors[0] if len(authors) == 1 else "",
                detail={"ids": sorted(stored.id for stored in new)},
            )
            places = [shapely.Point(stored.reading.x_m, stored.reading.y_m) for stored in new]
            points, _ = blobs([shapely.to_wkb(place) for place in places], srs)
            marks = ", ".join("?" * 14)
            connection.executemany(
                f"INSERT INTO {table} (geom, {file_rows.READING_COLUMNS}) VALUES ({marks})",
                [
                    (point, *file_rows.reading_values(stored, revision))
                    for point, stored in zip(points, new, strict=True)
                ],
            )
        return len(new)

    def readings(
        self, region: str, *, since: int = 0, until: int | None = None, withdrawn: bool = False
    ) -> list[StoredReading]:
        """Return readings; see ``TerrainStore.readings``."""
        with self.reading() as connection:
            row = self._row(region)
            columns = ", ".join(f"r.{name.strip()}" for name in file_rows.READING_COLUMNS.split(","))
            rows = connection.execute(
                f"SELECT {columns}, w.revision, w.reason FROM {quoted(f'readings_{row[12]}')} AS r "
                "LEFT JOIN withdrawals AS w ON w.region = ? AND w.reading = r.id AND w.revision <= ? "
                "WHERE r.revision > ? AND r.revision <= ? ORDER BY r.revision, r.id",
                (row[0], *([2**62 if until is None else until, since, 2**62 if until is None else until])),
            ).fetchall()
        found = [file_rows.reading_of(one) for one in rows]
        return found if withdrawn else [stored for stored in found if stored.withdrawn_at is None]

    def withdraw(
        self,
        region: str,
        reason: str,
        *,
        instrument: str | None = None,
        author: str | None = None,
        ids: Sequence[str] | None = None,
    ) -> int:
        """Let readings count no more; see ``TerrainStore.withdraw``."""
        require_selection(instrument, author, ids)
        with self.writing() as connection:
            fid = self._row(region)[0]
            wanted = None if ids is None else set(ids)
            gone = [
                stored.id
                for stored in self.readings(region)
                if (instrument is not None and stored.instrument == instrument)
                or (author is not None and stored.author == author)
                or (wanted is not None and stored.id in wanted)
            ]
            if not gone:
                return 0
            revision = file_rows.add_change(
                connection, fid, now(), "withdrawal", count=len(gone), detail={"ids": sorted(gone), "reason": reason}
            )
            connection.executemany(
                "INSERT INTO withdrawals (region, reading, revision, reason) VALUES (?, ?, ?, ?)",
                [(fid, reading, revision, reason) for reading in gone],
            )
        return len(gone)

    # Routes and runs

    def add_route(self, region: str, route: StoredRoute) -> None:
        """File a route; see ``TerrainStore.add_route``."""
        with self.writing() as connection:
            row = self._row(region)
            table = quoted(f"routes_{row[12]}")
            (line,), _ = blobs([route.wkb], row[8])
            filed = route.time or now()
            connection.execute(f"DELETE FROM {table} WHERE id = ?", (route.id,))
            connection.execute(
                f"INSERT INTO {table} (geom, id, vehicle, summary, author, time) VALUES (?, ?, ?, ?, ?, ?)",
                (line, route.id, route.vehicle, file_rows.as_json(dict(route.summary)), route.author, filed),
            )
            file_rows.add_change(connection, row[0], now(), "route", subject=route.id, author=route.author)

    def routes(self, region: str) -> list[StoredRoute]:
        """Return the routes, by time and id."""
        with self.reading() as connection:
            table = quoted(f"routes_{self._row(region)[12]}")
            rows = connection.execute(
                f"SELECT id, geom, vehicle, summary, author, time FROM {table} ORDER BY time, id"
            ).fetchall()
        return [
            StoredRoute(id_, wkb_of(geom), vehicle, file_rows.from_json(summary), author, filed)
            for id_, geom, vehicle, summary, author, filed in rows
        ]

    def add_run(self, region: str, run: StoredRun) -> None:
        """File a drive; see ``TerrainStore.add_run``."""
        with self.writing() as connection:
            fid = self._row(region)[0]
            connection.execute(
                "INSERT OR REPLACE INTO runs (region, id, log, summary, author, time) VALUES (?, ?, ?, ?, ?, ?)",
                (fid, run.id, run.log, file_rows.as_json(dict(run.summary)), run.author, run.time or now()),
            )
            file_rows.add_change(connection, fid, now(), "run", subject=run.id, author=run.author)

    def runs(self, region: str) -> list[StoredRun]:
        """Return the drives, by time and id."""
        with self.reading() as connection:
            rows = connection.execute(
                "SELECT id, log, summary, author, time FROM runs WHERE region = ? ORDER BY time, id",
                (self._row(region)[0],),
            ).fetchall()
        return [StoredRun(id_, log, file_rows.from_json(text), author, filed) for id_, log, text, author, filed in rows]

    # Changes

    def changes(self, region: str, since: int = 0) -> list[Change]:
        """Return every change after a revision, in order."""
        with self.reading() as connection:
            rows = connection.execute(
                "SELECT revision, time, kind, subject, count, author, detail FROM changes "
                "WHERE region = ? AND revision > ? ORDER BY revision",
                (self._row(region)[0], since),
            ).fetchall()
        return [file_rows.change_of(row) for row in rows]

    def subscribe(self, region: str, *, since: int | None = None) -> Subscription:
        """Begin to listen for changes; a folder cannot call, so it is asked ten times a second."""
        if since is None:
            since = max((change.revision for change in self.changes(region)), default=0)
        return _Polling(self, region, since)

    # What the parts of this store share

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """Give the connection to this thread alone."""
        with self._lock, told_apart(self.file):
            yield self._connection

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """Give the connection inside a transaction, which holds all or nothing."""
        with self.reading() as connection:
            self._require_writable()
            connection.execute("BEGIN IMMEDIATE")
            try:
                yield connection
                connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):
                    connection.execute("ROLLBACK")
                raise

    def layer_lock(self, region: str, layer: str) -> LayerLock:
        """Return the lock of a layer's only writer."""
        self._require_writable()
        staging = self.staging(region, layer)
        return LayerLock(staging.with_name(f"{staging.name}.lock"), f"the {layer} of {region!r}", self.file)

    def staging(self, region: str, layer: str) -> Path:
        """Return the folder of an import that is under way."""
        return self.folder / "staging" / f"{label(checked_name(region))}.{label(checked_name(layer, 'layer'))}"

    def holds(self, region: str, layer: LayerInfo) -> bool:
        """Return whether a layer of this very source is there."""
        found = self.region(region).layers.get(layer.name)
        same = found is not None and found.provenance.digest == layer.provenance.digest and found.kind == layer.kind
        if not same or layer.kind != "raster":
            return same
        with self.reading():
            return (self.folder / self._layer_place(self._row(region), layer.name)[1]).is_file()

    def raster_place(self, region: str, layer: LayerInfo) -> str:
        """Return where the file of a raster lies in the folder."""
        digest = layer.provenance.digest
        return f"{label(layer.name)}/{label(checked_name(region))}.{digest[:12]}.tif"

    def switch_raster(self, row: tuple[Any, ...], layer: LayerInfo, place: str) -> None:
        """Let a layer be the raster at a place, and remove what it was."""
        with self.writing() as connection:
            self.switch(connection, row, layer, place)
        file = self.folder / place
        own = re.compile(re.escape(file.name.split(".", maxsplit=1)[0]) + r"\.[0-9a-f]{12}\.tif")
        for other in file.parent.iterdir():
            if other != file and own.fullmatch(other.name):
                other.unlink(missing_ok=True)

    def switch(self, connection: sqlite3.Connection, row: tuple[Any, ...], layer: LayerInfo, place: str) -> None:
        """Let a layer be what lies at a place, inside a transaction; tables of polygons that it was are dropped.

        Raises:
            MissingRegionError: the region of that row is no more, though one of its name may be there.
        """
        fid, stamp = row[0], now()
        if self._row(row[1])[0] != fid:
            raise MissingRegionError(f"The region {row[1]!r} was dropped meanwhile.", "Give the command again.")
        former = connection.execute(
            "SELECT kind, place FROM layers WHERE region = ? AND name = ?", (fid, layer.name)
        ).fetchone()
        if former is not None and former[0] == "polygons" and former[1] != place:
            drop_feature_table(connection, former[1])
        connection.execute(
            "INSERT OR REPLACE INTO layers (region, name, kind, dtype, place, digest, inputs, crs, licence, author, "
            "time, options, details) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                fid, layer.name, layer.kind, layer.dtype, place,
                *file_rows.layer_values(layer.provenance, stamp, layer.details),
            ),
        )  # fmt: skip
        file_rows.add_change(
            connection,
            fid,
            stamp,
            "layer",
            subject=layer.name,
            author=layer.provenance.author,
            detail={"digest": layer.provenance.digest},
        )

    def region_row(self, name: str) -> tuple[Any, ...]:
        """Return the row of a region, in the order of ``file_rows.REGION_COLUMNS``."""
        with self.reading():
            return self._row(name)

    def polygon_table(self, region: str, layer: str) -> str:
        """Return the table of a layer of polygons."""
        with self.reading():
            kind, place = self._layer_place(self._row(region), layer)
        if kind != "polygons":
            raise MissingLayerError(f"The layer {layer!r} of {region!r} is a raster.", "Read a window of it.")
        return place

    def _row(self, name: str) -> tuple[Any, ...]:
        name = checked_name(name)
        row: tuple[Any, ...] | None = self._connection.execute(
            f"SELECT {file_rows.REGION_COLUMNS} FROM regions WHERE name = ?",
            (name,),
        ).fetchone()
        if row is None:
            names = [str(one) for (one,) in self._connection.execute("SELECT name FROM regions ORDER BY name")]
            near = difflib.get_close_matches(name, names, n=3, cutoff=0.0)
            remedy = f"Name one of {', '.join(map(repr, near))}." if near else "Import an elevation first."
            raise MissingRegionError(f"The store {self.address} has no region {name!r}.", remedy)
        return row

    def _layer_place(self, row: tuple[Any, ...], layer: str) -> tuple[str, str]:
        found = self._connection.execute(
            "SELECT kind, place FROM layers WHERE region = ? AND name = ?", (row[0], checked_name(layer, "layer"))
        ).fetchone()
        if found is None:
            raise MissingLayerError(
                f"The region {row[1]!r} of {self.address} has no {layer}.", "Import it with `swathe import`."
            )
        return str(found[0]), str(found[1])

    def _require_writable(self) -> None:
        if not self._writable:
            raise StoreReadOnlyError(
                f"The store in {self.folder} may only be read.", "Check the permissions of the folder and its files."
            )


class _Polling(Subscription):
    """Asks for changes again and again."""

    def __init__(self, store: FileStore, region: str, since: int) -> None:
        self._store, self._region, self._since = store, region, since

    def poll(self, timeout_s: float = 0.0) -> list[Change]:
        """Return the changes since the last call; see ``Subscription.poll``."""
        end = time.monotonic() + timeout_s
        while True:
            found = self._store.changes(self._region, self._since)
            left = end - time.monotonic()
            if found or left <= 0:
                break
            time.sleep(min(POLL_S, left))
        if found:
            self._since = found[-1].revision
        return found

    def close(self) -> None:
        """Stop listening."""
