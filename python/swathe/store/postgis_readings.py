"""Readings in PostGIS: facts that are filed once, and withdrawn by another fact."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from swathe.belief import ClassReading, PenetrometerReading
from swathe.soil import SoilClass
from swathe.store.interface import StoredReading
from swathe.store.naming import checked_name
from swathe.store.postgis_regions import missing_region, region_row
from swathe.store.queries import query

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swathe.store.postgis_server import Server


def add_readings(server: Server, region: str, readings: Sequence[StoredReading]) -> int:
    """File readings, all or none, and return how many were new."""
    if not readings:
        return 0
    batch = json.dumps([_values(stored) for stored in readings])
    with server.use() as connection:
        (added,) = connection.execute(query("file_readings"), (checked_name(region), batch)).fetchone() or (None,)
        if added is None:
            raise missing_region(connection, region)
    return int(added)


def read_readings(
    server: Server, region: str, since: int, until: int | None, *, withdrawn: bool
) -> list[StoredReading]:
    """Return the readings filed after a revision, as they stood at another."""
    with server.use() as connection:
        asked = {
            "region": region_row(connection, region).id,
            "since": since,
            "until": until,
            "withdrawn": withdrawn,
        }
        return [_stored(row) for row in connection.execute(query("read_readings"), asked)]


def withdraw(
    server: Server,
    region: str,
    reason: str,
    *,
    instrument: str | None,
    author: str | None,
    ids: Sequence[str] | None,
) -> int:
    """Let readings count no more and return how many."""
    named = None if ids is None else [str(one) for one in ids]
    with server.use() as connection:
        asked = (checked_name(region), instrument, author, named, reason)
        (gone,) = connection.execute(query("withdraw_readings"), asked).fetchone() or (None,)
        if gone is None:
            raise missing_region(connection, region)
    return int(gone)


def _values(stored: StoredReading) -> dict[str, Any]:
    reading = stored.reading
    values: dict[str, Any] = {
        "id": stored.id,
        "author": stored.author,
        "time": stored.time,
        "instrument": stored.instrument,
        "error": stored.error,
        "x_m": float(reading.x_m),
        "y_m": float(reading.y_m),
    }
    if isinstance(reading, ClassReading):
        return values | {"soil_class": int(reading.soil_class)}
    sleeve = reading.sleeve_frictions_kpa
    return values | {
        "depths_m": [float(value) for value in reading.depths_m],
        "cone_index_kpa": [float(value) for value in reading.cone_indices_kpa],
        "sleeve_friction_kpa": None if sleeve is None else [float(value) for value in sleeve],
        "refusal_depth_m": None if reading.refusal_depth_m is None else float(reading.refusal_depth_m),
    }


def _stored(row: tuple[Any, ...]) -> StoredReading:
    (identity, author, time, instrument, error, revision, withdrawn_at, reason), place = row[:8], row[8:]
    x_m, y_m, soil_class, depths_m, cone_index_kpa, refusal_depth_m, sleeve_friction_kpa = place
    reading: ClassReading | PenetrometerReading
    if soil_class is not None:
        reading = ClassReading(x_m, y_m, SoilClass(soil_class))
    else:
        sleeve = None if sleeve_friction_kpa is None else tuple(sleeve_friction_kpa)
        reading = PenetrometerReading(x_m, y_m, tuple(depths_m), tuple(cone_index_kpa), refusal_depth_m, sleeve)
    return StoredReading(identity, reading, author, time, instrument, error, revision, withdrawn_at, reason)
