"""The GeoPackage of a project folder: its tables, its geometries, and connections to it (OGC 12-128r18)."""

from __future__ import annotations

import errno
import math
import os
import sqlite3
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import shapely

from swathe.errors import (
    StoreBusyError,
    StoreDamagedError,
    StoreError,
    StoreFullError,
    StoreReadOnlyError,
    StoreSchemaError,
    StoreUnavailableError,
)
from swathe.io.crs import WGS84, old_wkt, registered_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

#: Version of the tables below; a store with a larger one is left alone.
SCHEMA = 1
#: "GPKG", and GeoPackage 1.3.
APPLICATION_ID, GPKG_VERSION = 0x47504B47, 10300
#: How long a writer waits for another.
BUSY_S = 60.0
UNDEFINED_SRS, LONLAT_SRS, FIRST_OWN_SRS = -1, 4326, 200_000

_TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (
    srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
    organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
    table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
    last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
    min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
    CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
    table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
    z TINYINT NOT NULL, m TINYINT NOT NULL,
    CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
    CONSTRAINT uk_gc_table_name UNIQUE (table_name),
    CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
    CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE gpkg_extensions (
    table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL, scope TEXT NOT NULL,
    CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
INSERT INTO gpkg_spatial_ref_sys VALUES
    ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', NULL),
    ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL);
CREATE TABLE swathe_store (fid INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, value TEXT NOT NULL);
CREATE TABLE regions (
    fid INTEGER PRIMARY KEY AUTOINCREMENT, geom POLYGON, name TEXT NOT NULL UNIQUE, rows INTEGER NOT NULL,
    columns INTEGER NOT NULL, cell_size_m DOUBLE NOT NULL, west_m DOUBLE NOT NULL, north_m DOUBLE NOT NULL,
    crs TEXT, srs INTEGER NOT NULL, file_x DOUBLE NOT NULL, file_y DOUBLE NOT NULL, file_unit_m DOUBLE NOT NULL,
    label TEXT NOT NULL, revision INTEGER NOT NULL DEFAULT 0);
CREATE TABLE layers (
    fid INTEGER PRIMARY KEY AUTOINCREMENT, region INTEGER NOT NULL, name TEXT NOT NULL, kind TEXT NOT NULL,
    dtype TEXT NOT NULL, place TEXT NOT NULL, digest TEXT NOT NULL, inputs TEXT NOT NULL, crs TEXT NOT NULL,
    licence TEXT NOT NULL, author TEXT NOT NULL, time TEXT NOT NULL, options TEXT NOT NULL, details TEXT NOT NULL,
    UNIQUE (region, name));
CREATE TABLE withdrawals (
    fid INTEGER PRIMARY KEY AUTOINCREMENT, region INTEGER NOT NULL, reading TEXT NOT NULL, revision INTEGER NOT NULL,
    reason TEXT NOT NULL, UNIQUE (region, reading));
CREATE TABLE runs (
    fid INTEGER PRIMARY KEY AUTOINCREMENT, region INTEGER NOT NULL, id TEXT NOT NULL, log TEXT NOT NULL,
    summary TEXT NOT NULL, author TEXT NOT NULL, time TEXT NOT NULL, UNIQUE (region, id));
CREATE TABLE changes (
    fid INTEGER PRIMARY KEY AUTOINCREMENT, region INTEGER NOT NULL, revision INTEGER NOT NULL, time TEXT NOT NULL,
    kind TEXT NOT NULL, subject TEXT NOT NULL, count INTEGER NOT NULL, author TEXT NOT NULL, detail TEXT NOT NULL,
    UNIQUE (region, revision));
INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES
    ('regions', 'features', 'regions', 4326), ('swathe_store', 'attributes', 'swathe_store', NULL),
    ('layers', 'attributes', 'layers', NULL), ('withdrawals', 'attributes', 'withdrawals', NULL),
    ('runs', 'attributes', 'runs', NULL), ('changes', 'attributes', 'changes', NULL);
INSERT INTO gpkg_geometry_columns VALUES ('regions', 'geom', 'POLYGON', 4326, 0, 0);
"""

_ENVELOPE_BYTES = {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}


def blobs(geometries: Sequence[bytes], srs_id: int) -> tuple[list[bytes], NDArray[np.float64]]:
    """Return geometries in WKB as a GeoPackage holds them, and their boxes (min x, min y, max x, max y)."""
    boxes: NDArray[np.float64] = shapely.bounds(shapely.from_wkb(np.array(geometries, dtype=object)))
    boxes = boxes.reshape(-1, 4)
    return [
        struct.pack("<2sBBi4d", b"GP", 0, 0b11, srs_id, west, east, south, north) + wkb
        for wkb, (west, south, east, north) in zip(geometries, boxes.tolist(), strict=True)
    ], boxes


def wkb_of(stored: bytes) -> bytes:
    """Return the WKB inside a geometry of a GeoPackage.

    Raises:
        StoreDamagedError: it is none.
    """
    if len(stored) < 8 or stored[:2] != b"GP" or (stored[3] >> 1) & 7 not in _ENVELOPE_BYTES:
        raise StoreDamagedError("A geometry of the store is damaged.", "Import the layer again.")
    return stored[8 + _ENVELOPE_BYTES[(stored[3] >> 1) & 7] :]


def connect(file: Path, *, create: bool) -> tuple[sqlite3.Connection, bool]:
    """Open the GeoPackage and return the connection and whether it may be written.

    Raises:
        StoreError: it is not there, no store of ours, newer than this version, or damaged.
    """
    with told_apart(file):
        if create and not file.exists():
            _make(file)
        if not file.is_file():
            raise StoreUnavailableError(
                f"There is no store in {file.parent}.", "Check the folder, or fill it with `swathe import`."
            )
        connection, writable = _open(file)
        try:
            _require_schema(connection, file)
        except BaseException:
            connection.close()
            raise
    return connection, writable


@contextmanager
def told_apart(file: Path) -> Iterator[None]:
    """Turn what SQLite and the system say into errors of a store."""
    try:
        yield
    except sqlite3.Error as error:
        raise _plain(file, error) from error
    except OSError as error:
        raise system_refusal(file, error) from error


def system_refusal(file: Path, error: OSError) -> StoreError:
    """Return the plain error for what the system said."""
    if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
        return StoreFullError(
            f"There is no room for the store in {file.parent}.", "Free some space and give the command again."
        )
    if error.errno in {errno.EACCES, errno.EPERM, errno.EROFS}:
        return StoreReadOnlyError(
            f"The store in {file.parent} cannot be written: {error.strerror}.", "Check the permissions of the folder."
        )
    return StoreUnavailableError(
        f"The store in {file.parent} cannot be used: {error.strerror or error}.", "Check the folder."
    )


def _plain(file: Path, error: sqlite3.Error) -> StoreError:
    name = getattr(error, "sqlite_errorname", "") or ""
    where = f"the store in {file.parent}"
    if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
        return StoreBusyError(f"Somebody else is writing to {where}.", "Wait until that is done, then try again.")
    if name.startswith("SQLITE_FULL") or name in {"SQLITE_IOERR_WRITE", "SQLITE_IOERR_SHMSIZE"}:
        return StoreFullError(f"There is no room for {where}.", "Free some space and give the command again.")
    if name.startswith(("SQLITE_READONLY", "SQLITE_PERM", "SQLITE_AUTH")):
        return StoreReadOnlyError(f"{where.capitalize()} may only be read.", "Check the permissions of the folder.")
    if name.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB", "SQLITE_IOERR_SHORT_READ")):
        return StoreDamagedError(
            f"{file.name} in {file.parent} is damaged or no GeoPackage.", "Fetch it from a copy, or import anew."
        )
    if name.startswith("SQLITE_CANTOPEN"):
        return StoreUnavailableError(f"{where.capitalize()} cannot be opened.", "Check the folder's permissions.")
    return StoreError(f"{where.capitalize()} refuses: {error}.", "Check the folder and its disk.")


def _make(file: Path) -> None:
    """Make an empty store under another name and give it its own in one step; the first of several makers wins."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.name}.{os.getpid()}.{os.urandom(4).hex()}.part")
    try:
        connection = sqlite3.connect(part, isolation_level=None)
        try:
            # The file remembers this, so that no two openers have to agree on it.
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {GPKG_VERSION}")
            connection.executescript(f"BEGIN; {_TABLES} COMMIT;")
            reference_system(connection, WGS84)
            connection.execute("INSERT INTO swathe_store (key, value) VALUES ('schema', ?)", (str(SCHEMA),))
        finally:
            connection.close()
        try:
            os.link(part, file)
        except FileExistsError:
            return
        except OSError:  # a file system without links
            part.replace(file)
        sync_folder(file.parent)
    finally:
        part.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Wait until the disk holds the names in a folder."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _open(file: Path) -> tuple[sqlite3.Connection, bool]:
    address = "file:" + quote(os.fsencode(file.absolute()))
    if os.access(file, os.W_OK) and os.access(file.parent, os.W_OK):
        connection = _connection(address + "?mode=rw")
        # With the write-ahead log: one sync for each commit, and readers never wait for writers.
        connection.execute("PRAGMA synchronous = FULL")
        return connection, True
    connection = _connection(address + "?mode=ro")
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.OperationalError:
        connection.close()
        log = file.with_name(f"{file.name}-wal")
        if log.is_file() and log.stat().st_size:
            raise StoreReadOnlyError(
                f"The last changes of the store in {file.parent} lie in {log.name}, which cannot be read there.",
                "Open the store once where it may be written, or make the folder writable.",
            ) from None
        # A folder that nobody may write has no room for the index of the journal, and needs none.
        connection = _connection(address + "?mode=ro&immutable=1")
    return connection, False


def _connection(address: str) -> sqlite3.Connection:
    connection = sqlite3.connect(address, uri=True, isolation_level=None, timeout=BUSY_S, check_same_thread=False)
    # What the standard triggers of spatial indexes call.
    for number, name in enumerate(("ST_MinX", "ST_MinY", "ST_MaxX", "ST_MaxY")):
        connection.create_function(name, 1, _side(number), deterministic=True)
    connection.create_function("ST_IsEmpty", 1, _is_empty, deterministic=True)
    return connection


def _side(number: int) -> Any:  # noqa: ANN401 - a callback of SQLite
    def side(stored: bytes | None) -> float | None:
        if stored is None:
            return None
        value = float(shapely.bounds(shapely.from_wkb(wkb_of(stored)))[number])
        return None if math.isnan(value) else value

    return side


def _is_empty(stored: bytes | None) -> int | None:
    return None if stored is None else int(shapely.is_empty(shapely.from_wkb(wkb_of(stored))))


def _require_schema(connection: sqlite3.Connection, file: Path) -> None:
    try:
        row = connection.execute("SELECT value FROM swathe_store WHERE key = 'schema'").fetchone()
    except sqlite3.OperationalError as error:
        if "no such table" not in str(error):
            raise
        row = None
    if row is None or not str(row[0]).isdigit():
        raise StoreSchemaError(
            f"{file} is no store of Swathe.", "Choose an empty folder, or one that `swathe import` made."
        )
    if int(row[0]) > SCHEMA:
        raise StoreSchemaError(
            f"The store in {file.parent} has schema {row[0]}; this version knows up to {SCHEMA}.",
            "Use the version of Swathe that wrote it, or a later one.",
        )


def reference_system(connection: sqlite3.Connection, wkt: str | None) -> int:
    """Return the number of a system in the GeoPackage, entering it when it is not there yet.

    A system that its format cannot say is entered as an undefined plane.
    """
    definition = None if wkt is None else old_wkt(wkt)
    if wkt is None or definition is None:
        return UNDEFINED_SRS
    known = registered_name(wkt)
    if known is not None:
        name, authority, code = known
        row = connection.execute(
            "SELECT srs_id FROM gpkg_spatial_ref_sys WHERE organization = ? AND organization_coordsys_id = ?",
            (authority, code),
        ).fetchone()
        srs_id = code if authority == "EPSG" else None
    else:
        name, authority, code = "a projection of its own", "NONE", 0
        row = connection.execute(
            "SELECT srs_id FROM gpkg_spatial_ref_sys WHERE definition = ?", (definition,)
        ).fetchone()
        srs_id = None
    if row is not None:
        return int(row[0])
    if srs_id is None:
        largest = connection.execute("SELECT max(srs_id) FROM gpkg_spatial_ref_sys").fetchone()[0]
        srs_id = max(int(largest), FIRST_OWN_SRS) + 1
    connection.execute(
        "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)",
        (name, srs_id, authority, code or srs_id, definition),
    )
    return srs_id


def add_feature_table(connection: sqlite3.Connection, table: str, kind: str, srs_id: int, *, description: str) -> None:
    """Register a table with a column ``geom`` as a layer of features."""
    connection.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id) "
        "VALUES (?, 'features', ?, ?, ?)",
        (table, table, description, srs_id),
    )
    connection.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 0, 0)", (table, kind, srs_id))


def drop_feature_table(connection: sqlite3.Connection, table: str) -> None:
    """Remove a table, its index and what registers it."""
    for listing in ("gpkg_geometry_columns", "gpkg_extensions", "gpkg_contents"):
        connection.execute(f"DELETE FROM {listing} WHERE table_name = ?", (table,))
    connection.execute(f"DROP TABLE IF EXISTS {quoted(f'rtree_{table}_geom')}")
    connection.execute(f"DROP TABLE IF EXISTS {quoted(table)}")


def quoted(name: str) -> str:
    """Return a table's name as SQL writes it."""
    return '"' + name.replace('"', '""') + '"'


def add_spatial_index(connection: sqlite3.Connection, table: str) -> None:
    """Register the R-tree of a table, which is filled already, with the triggers that keep it (annex F.3 of 1.3)."""
    connection.execute(
        "INSERT INTO gpkg_extensions VALUES (?, 'geom', 'gpkg_rtree_index', "
        "'http://www.geopackage.org/spec120/#extension_rtree', 'write-only')",
        (table,),
    )
    name, tree = quoted(table), quoted(f"rtree_{table}_geom")
    new = "NEW.fid, ST_MinX(NEW.geom), ST_MaxX(NEW.geom), ST_MinY(NEW.geom), ST_MaxY(NEW.geom)"
    full, empty = "NEW.geom NOT NULL AND NOT ST_IsEmpty(NEW.geom)", "(NEW.geom IS NULL OR ST_IsEmpty(NEW.geom))"
    for suffix, when, what in (
        ("insert", f"INSERT ON {name} WHEN ({full})", f"INSERT OR REPLACE INTO {tree} VALUES ({new})"),
        (
            "update1",
            f"UPDATE OF geom ON {name} WHEN OLD.fid = NEW.fid AND ({full})",
            f"INSERT OR REPLACE INTO {tree} VALUES ({new})",
        ),
        (
            "update2",
            f"UPDATE OF geom ON {name} WHEN OLD.fid = NEW.fid AND {empty}",
            f"DELETE FROM {tree} WHERE id = OLD.fid",
        ),
        (
            "update3",
            f"UPDATE ON {name} WHEN OLD.fid != NEW.fid AND ({full})",
            f"DELETE FROM {tree} WHERE id = OLD.fid; INSERT OR REPLACE INTO {tree} VALUES ({new})",
        ),
        (
            "update4",
            f"UPDATE ON {name} WHEN OLD.fid != NEW.fid AND {empty}",
            f"DELETE FROM {tree} WHERE id IN (OLD.fid, NEW.fid)",
        ),
        ("delete", f"DELETE ON {name} WHEN OLD.geom NOT NULL", f"DELETE FROM {tree} WHERE id = OLD.fid"),
    ):
        trigger = quoted(f"rtree_{table}_geom_{suffix}")
        connection.execute(f"CREATE TRIGGER {trigger} AFTER {when} BEGIN {what}; END")
