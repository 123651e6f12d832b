"""Soil maps and zones in a project folder: each a table of its own, filled unseen and registered in one step."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.errors import StoreBusyError
from swathe.soil import SoilClass
from swathe.store.file_rows import SOIL_TABLE, ZONE_TABLE, as_json
from swathe.store.geopackage import (
    add_feature_table,
    add_spatial_index,
    blobs,
    drop_feature_table,
    quoted,
    wkb_of,
)
from swathe.store.interface import SOIL, LayerInfo, SoilPolygon, Zone

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from swathe.store.files import FileStore
    from swathe.store.interface import Bounds

    Row = tuple[Any, ...]

PAGE = 2000
_COLUMNS = {SOIL: "geom, value, soil_class, cat, attributes"}
_ZONE_COLUMNS = "geom, name, attributes"


def soil_rows(batch: Sequence[SoilPolygon]) -> list[Row]:
    """Return polygons as rows: WKB, value, class, category, attributes."""
    return [(one.wkb, one.value, one.soil_class.name.lower(), one.cat, as_json(dict(one.attributes))) for one in batch]


def zone_rows(batch: Sequence[Zone]) -> list[Row]:
    """Return zones as rows: WKB, name, attributes."""
    return [(one.wkb, one.name, as_json(dict(one.attributes))) for one in batch]


def soil_of(row: Row) -> SoilPolygon:
    """Return the polygon of a row."""
    geom, value, word, cat, attributes = row
    return SoilPolygon(wkb_of(geom), value, SoilClass[word.upper()], cat, json.loads(attributes))


def zone_of(row: Row) -> Zone:
    """Return the zone of a row."""
    return Zone(wkb_of(row[0]), row[1], json.loads(row[2]))


def write(store: FileStore, region: str, info: LayerInfo, batches: Iterable[list[Row]]) -> bool:
    """Make a table of the batches and let the layer be it; False if it is this very layer already."""
    layer = info.name
    with store.layer_lock(region, layer):
        if store.holds(region, info):
            return False
        row = store.region_row(region)
        table = f"{layer}_{row[12]}_{info.provenance.digest[:12]}"
        _begin(store, layer, row, table)
        box = np.array([np.inf, np.inf, -np.inf, -np.inf])
        for batch in batches:
            if batch:
                boxes = _insert(store, layer, row, table, batch)
                box = np.concatenate(
                    [np.minimum(box[:2], boxes[:, :2].min(axis=0)), np.maximum(box[2:], boxes[:, 2:].max(axis=0))]
                )
        with store.writing() as connection:
            add_feature_table(connection, table, "MULTIPOLYGON", row[8], description=f"{layer} of {row[1]}")
            add_spatial_index(connection, table)
            if np.isfinite(box).all():
                connection.execute(
                    "UPDATE gpkg_contents SET min_x = ?, min_y = ?, max_x = ?, max_y = ? WHERE table_name = ?",
                    (*box.tolist(), table),
                )
            store.switch(connection, row, info, table)
    return True


def _begin(store: FileStore, layer: str, row: Row, table: str) -> None:
    """Make an empty table with its index, without what earlier imports have left unfinished."""
    with store.writing() as connection:
        kept = connection.execute("SELECT place FROM layers WHERE region = ? AND kind = 'polygons'", (row[0],))
        known = {str(place) for (place,) in kept}
        # Digests are of one length, so that no other region's tables begin and end like these.
        pattern = f"{layer}_{row[12]}_" + "[0-9a-f]" * 12
        left = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name GLOB ?", (pattern,))
        for (name,) in left.fetchall():
            if name not in known:
                drop_feature_table(connection, name)
        if table in known:  # the same source on a layer that is a raster now
            drop_feature_table(connection, table)
        connection.execute(f"CREATE TABLE {quoted(table)} {SOIL_TABLE if layer == SOIL else ZONE_TABLE}")
        connection.execute(
            f"CREATE VIRTUAL TABLE {quoted(f'rtree_{table}_geom')} USING rtree(id, minx, maxx, miny, maxy)"
        )


def _insert(store: FileStore, layer: str, row: Row, table: str, batch: list[Row]) -> np.ndarray[Any, Any]:
    """Write a batch as a transaction of its own, so that others can write in between; return the boxes."""
    stored, boxes = blobs([one[0] for one in batch], row[8])
    columns = _COLUMNS.get(layer, _ZONE_COLUMNS)
    marks = ", ".join("?" * len(batch[0]))
    with store.writing() as connection:
        first = connection.execute(f"SELECT coalesce(max(fid), 0) FROM {quoted(table)}").fetchone()[0] + 1
        connection.executemany(
            f"INSERT INTO {quoted(table)} (fid, {columns}) VALUES (?, {marks})",
            ((first + n, geom, *one[1:]) for n, (geom, one) in enumerate(zip(stored, batch, strict=True))),
        )
        connection.executemany(
            f"INSERT INTO {quoted(f'rtree_{table}_geom')} VALUES (?, ?, ?, ?, ?)",
            ((first + n, west, east, south, north) for n, (west, south, east, north) in enumerate(boxes.tolist())),
        )
    return boxes


def read(store: FileStore, region: str, layer: str, bounds: Bounds | None) -> Iterator[Row]:
    """Yield the rows of a layer in the order of writing, page by page.

    Raises:
        StoreBusyError: the layer was replaced meanwhile.
    """
    table = store.polygon_table(region, layer)
    columns = _COLUMNS.get(layer, _ZONE_COLUMNS)
    wanted = None if bounds is None else _near(store, table, bounds)
    last = 0
    while True:
        if wanted is None:
            rows = _page(
                store,
                table,
                f"SELECT fid, {columns} FROM {quoted(table)} WHERE fid > ? ORDER BY fid LIMIT {PAGE}",
                (last,),
            )
        else:
            some, wanted = wanted[:PAGE], wanted[PAGE:]
            marks = ", ".join("?" * len(some))
            rows = (
                _page(
                    store,
                    table,
                    f"SELECT fid, {columns} FROM {quoted(table)} WHERE fid IN ({marks}) ORDER BY fid",
                    tuple(some),
                )
                if some
                else []
            )
        if not rows:
            return
        for row in rows:
            yield row[1:]
        last = rows[-1][0]


def _near(store: FileStore, table: str, bounds: Bounds) -> list[int]:
    west, south, east, north = bounds
    sql = (
        f"SELECT id FROM {quoted(f'rtree_{table}_geom')} "
        "WHERE maxx >= ? AND minx <= ? AND maxy >= ? AND miny <= ? ORDER BY id"
    )
    return [int(number) for (number,) in _page(store, table, sql, (west, east, south, north))]


def _page(store: FileStore, table: str, sql: str, values: tuple[Any, ...]) -> list[Row]:
    with store.reading() as connection, closing(connection.cursor()) as cursor:
        try:
            return cursor.execute(sql, values).fetchall()
        except sqlite3.OperationalError as error:
            if "no such table" not in str(error):
                raise
            raise StoreBusyError(
                f"{table} in {store.folder} was replaced while it was read.", "Give the command again."
            ) from error
