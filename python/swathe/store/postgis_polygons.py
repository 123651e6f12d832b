"""Soil maps and zones in PostGIS: polygons that come in batches and are switched to when all have come."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

from swathe.errors import InvalidParameterError
from swathe.soil import SoilClass
from swathe.store.interface import SOIL, ZONES, SoilPolygon, Zone
from swathe.store.naming import checked_name
from swathe.store.postgis_layers import StagedLayer
from swathe.store.postgis_regions import missing_layer, region_row
from swathe.store.queries import query

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from typing import LiteralString

    from swathe.store.interface import Bounds, LayerInfo
    from swathe.store.postgis_server import Server

_SRID_FLAG = 0x20000000
#: Rows that are fetched at a time.
_ROWS = 1000


class _Table(NamedTuple):
    """How polygons of one kind become rows: the COPY, its types (geometry takes its binary form as it comes)."""

    copying: str
    types: tuple[str, ...]
    row: Callable[[Any], tuple[Any, ...]]


def _soil_row(polygon: SoilPolygon) -> tuple[Any, ...]:
    return (polygon.value, int(polygon.soil_class), polygon.cat, dict(polygon.attributes), polygon.wkb)


def _zone_row(zone: Zone) -> tuple[Any, ...]:
    return (zone.name, dict(zone.attributes), zone.wkb)


_SOIL = _Table("copy_soil_polygons", ("int8", "int8", "text", "int2", "int8", "json", "bytea"), _soil_row)
_ZONES = _Table("copy_zones", ("int8", "int8", "text", "json", "bytea"), _zone_row)


def write_soil(server: Server, region: str, layer: LayerInfo, batches: Iterable[Sequence[SoilPolygon]]) -> bool:
    """Replace the soil map; False if it is this very one already."""
    return _write(server, region, layer, _SOIL, batches)


def write_zones(server: Server, region: str, layer: LayerInfo, batches: Iterable[Sequence[Zone]]) -> bool:
    """Replace the zones; False if they are these very ones already."""
    return _write(server, region, layer, _ZONES, batches)


def _write(
    server: Server, region: str, layer: LayerInfo, table: _Table, batches: Iterable[Sequence[SoilPolygon | Zone]]
) -> bool:
    with StagedLayer(server, region, layer) as staged:
        if staged.is_current:
            return False
        # All in one transaction: what comes from a stream has no place to go on from.
        staged.restart()
        srid, number = staged.region.srid, 0
        with staged.told(), staged.connection.transaction():
            with staged.connection.cursor() as cursor, cursor.copy(query(table.copying)) as copy:
                copy.set_types(table.types)
                for batch in batches:
                    for polygon in batch:
                        *values, wkb = table.row(polygon)
                        copy.write_row((staged.layer_id, number, *values, with_srid(wkb, srid)))
                        number += 1
            staged.switch()
        staged.sweep()
    return True


def with_srid(wkb: bytes, srid: int) -> bytes:
    """Return a geometry's well-known binary form with the number of its system in it, as PostGIS takes it.

    Raises:
        InvalidParameterError: it is too short to be a geometry.
    """
    if len(wkb) < 5:
        raise InvalidParameterError("A geometry is cut short.", "Give its well-known binary form.")
    order = "<" if wkb[0] == 1 else ">"
    (kind,) = struct.unpack_from(order + "I", wkb, 1)
    if kind & _SRID_FLAG:
        raise InvalidParameterError("A geometry brings a system of its own.", "Give it in the region's frame.")
    return wkb[:1] + struct.pack(order + "II", kind | _SRID_FLAG, srid) + wkb[5:]


def read_soil(server: Server, region: str, bounds: Bounds | None) -> Iterator[SoilPolygon]:
    """Yield the soil polygons whose box meets the bounds, in the order of writing."""
    for wkb, value, soil_class, cat, attributes in _read(server, region, SOIL, bounds):
        yield SoilPolygon(bytes(wkb), value, SoilClass(soil_class), cat, attributes)


def read_zones(server: Server, region: str, bounds: Bounds | None) -> Iterator[Zone]:
    """Yield the zones whose box meets the bounds, in the order of writing."""
    for wkb, name, attributes in _read(server, region, ZONES, bounds):
        yield Zone(bytes(wkb), name, attributes)


def _read(server: Server, region: str, layer: str, bounds: Bounds | None) -> Iterator[tuple[Any, ...]]:
    statement: LiteralString = query(f"read_{layer}" if bounds is None else f"read_{layer}_inside")
    name = checked_name(region)
    parameters = (name,) if bounds is None else (*map(float, bounds), name)
    # A connection of its own: whoever reads may ask the store something else between two polygons.
    connection = server.connect()
    try:
        with server.told(connection), connection.transaction():
            row = region_row(connection, region)
            if connection.execute(query("has_polygons"), (row.id, layer)).fetchone() is None:
                raise missing_layer(region, layer)
            with connection.cursor(name="swathe_polygons", binary=True) as cursor:
                cursor.itersize = _ROWS
                yield from cursor.execute(statement, parameters)
    finally:
        connection.close()
