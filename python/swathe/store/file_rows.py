"""Rows of a project folder's GeoPackage as the store's data classes, and back."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from swathe.belief import ClassReading, PenetrometerReading
from swathe.grid import GridGeometry
from swathe.io.crs import Frame
from swathe.soil import SoilClass
from swathe.store.geopackage import LONLAT_SRS, blobs
from swathe.store.interface import Change, LayerInfo, Provenance, StoredReading

if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Mapping

REGION_COLUMNS = "fid, name, rows, columns, cell_size_m, west_m, north_m, crs, srs, file_x, file_y, file_unit_m, label"
LAYER_COLUMNS = "name, kind, dtype, inputs, crs, licence, author, time, options, details"
READING_COLUMNS = (
    "id, author, time, instrument, error, x_m, y_m, depths_m, cone_indices_kpa, sleeve_frictions_kpa, "
    "refusal_depth_m, soil_class, revision"
)
READING_TABLE = """(
    fid INTEGER PRIMARY KEY AUTOINCREMENT, geom POINT NOT NULL, id TEXT NOT NULL UNIQUE, author TEXT NOT NULL,
    time TEXT NOT NULL, instrument TEXT NOT NULL, error DOUBLE, x_m DOUBLE NOT NULL, y_m DOUBLE NOT NULL,
    depths_m TEXT NOT NULL, cone_indices_kpa TEXT NOT NULL, sleeve_frictions_kpa TEXT, refusal_depth_m DOUBLE,
    soil_class TEXT, revision INTEGER NOT NULL)"""
ROUTE_TABLE = """(
    fid INTEGER PRIMARY KEY AUTOINCREMENT, geom LINESTRING NOT NULL, id TEXT NOT NULL UNIQUE, vehicle TEXT NOT NULL,
    summary TEXT NOT NULL, author TEXT NOT NULL, time TEXT NOT NULL)"""
SOIL_TABLE = """(
    fid INTEGER PRIMARY KEY AUTOINCREMENT, geom MULTIPOLYGON NOT NULL, value TEXT NOT NULL, soil_class TEXT NOT NULL,
    cat INTEGER, attributes TEXT NOT NULL)"""
ZONE_TABLE = """(
    fid INTEGER PRIMARY KEY AUTOINCREMENT, geom MULTIPOLYGON NOT NULL, name TEXT NOT NULL, attributes TEXT NOT NULL)"""


def as_json(value: Any) -> str:  # noqa: ANN401 - JSON values are of any type
    """Return a value as JSON on one line, the same for equal values."""
    return json.dumps(value, ensure_ascii=False, sort_keys=True, separators=(",", ":"))


def frame_of(row: tuple[Any, ...]) -> Frame:
    """Return the frame of a row of REGION_COLUMNS."""
    _, _, rows, columns, cell_size_m, west_m, north_m, crs, _, file_x, file_y, file_unit_m, _ = row
    return Frame(GridGeometry(rows, columns, cell_size_m, west_m, north_m), crs, (file_x, file_y), file_unit_m)


def outline(frame: Frame) -> bytes | None:
    """Return the outline of a region in longitude and latitude as a GeoPackage holds it; None where it has none."""
    if not frame.has_lonlat:
        return None
    geometry = frame.geometry
    steps = np.linspace(0, 1, 17)[:-1]
    width_m, height_m = geometry.east_m - geometry.west_m, geometry.north_m - geometry.south_m
    x_m = np.concatenate([steps * width_m, np.full(16, width_m), (1 - steps) * width_m, np.zeros(16)])
    y_m = np.concatenate([np.zeros(16), steps * height_m, np.full(16, height_m), (1 - steps) * height_m])
    lon, lat = frame.to_lonlat(geometry.west_m + x_m, geometry.south_m + y_m)
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        return None
    ring = shapely.polygons(np.column_stack([lon, lat]))
    return blobs([shapely.to_wkb(ring)], LONLAT_SRS)[0][0]


def layer_of(row: tuple[Any, ...]) -> LayerInfo:
    """Return the layer of a row of LAYER_COLUMNS."""
    name, kind, dtype, inputs, crs, licence, author, time, options, details = row
    given = tuple((str(one), str(other)) for one, other in json.loads(inputs))
    provenance = Provenance(given, crs, licence, author, time, json.loads(options))
    return LayerInfo(name, kind, dtype, provenance, json.loads(details))


def layer_values(provenance: Provenance, time: str, details: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a layer's row holds after its dtype and place: digest to details."""
    return (
        provenance.digest,
        as_json(provenance.inputs),
        provenance.crs,
        provenance.licence,
        provenance.author,
        provenance.time or time,
        as_json(dict(provenance.options)),
        as_json(dict(details)),
    )


def reading_values(stored: StoredReading, revision: int) -> tuple[Any, ...]:
    """Return the values of READING_COLUMNS."""
    reading = stored.reading
    head = (stored.id, stored.author, stored.time, stored.instrument, stored.error)
    place = (float(reading.x_m), float(reading.y_m))
    if isinstance(reading, ClassReading):
        return (*head, *place, "[]", "[]", None, None, reading.soil_class.name.lower(), revision)
    sleeve = reading.sleeve_frictions_kpa
    return (
        *head,
        *place,
        as_json([float(value) for value in reading.depths_m]),
        as_json([float(value) for value in reading.cone_indices_kpa]),
        None if sleeve is None else as_json([float(value) for value in sleeve]),
        reading.refusal_depth_m,
        None,
        revision,
    )


def reading_of(row: tuple[Any, ...]) -> StoredReading:
    """Return the reading of a row of READING_COLUMNS, followed by the revision and reason of its withdrawal."""
    (id_, author, time, instrument, error, x_m, y_m, depths, cone, sleeve, refusal, word, revision, gone, reason) = row
    reading: PenetrometerReading | ClassReading
    if word is not None:
        reading = ClassReading(x_m, y_m, SoilClass[word.upper()])
    else:
        frictions = None if sleeve is None else tuple(json.loads(sleeve))
        reading = PenetrometerReading(x_m, y_m, tuple(json.loads(depths)), tuple(json.loads(cone)), refusal, frictions)
    return StoredReading(id_, reading, author, time, instrument, error, revision, gone, reason or "")


def change_of(row: tuple[Any, ...]) -> Change:
    """Return the change of a row: revision, time, kind, subject, count, author, detail."""
    revision, time, kind, subject, count, author, detail = row
    return Change(revision, time, kind, subject, count, author, json.loads(detail))


def add_change(
    connection: sqlite3.Connection,
    region: int,
    time: str,
    kind: str,
    *,
    subject: str = "",
    count: int = 1,
    author: str = "",
    detail: Mapping[str, Any] | None = None,
) -> int:
    """Write the next change of a region inside a transaction, and return its revision."""
    connection.execute("UPDATE regions SET revision = revision + 1 WHERE fid = ?", (region,))
    revision = int(connection.execute("SELECT revision FROM regions WHERE fid = ?", (region,)).fetchone()[0])
    connection.execute(
        "INSERT INTO changes (region, revision, time, kind, subject, count, author, detail) "
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        (region, revision, time, kind, subject, count, author, as_json(dict(detail or {}))),
    )
    return revision


def from_json(text: str) -> dict[str, Any]:
    """Return the object that JSON holds."""
    value = json.loads(text)
    return value if isinstance(value, dict) else {}
