"""The paper's table in PostGIS: heights and soil come by COPY, goodness and rank by one statement over all cells."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.errors import StoreBusyError
from swathe.grid import GridGeometry
from swathe.io.soil import SoilLayer
from swathe.soil import SoilClass, SoilEntry, SoilReport
from swathe.store.cell_table import GROUP, CellTable, make_table
from swathe.store.postgis_regions import region_row
from swathe.store.queries import query

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swathe.store.interface import TerrainStore
    from swathe.store.postgis_regions import RegionRow
    from swathe.store.postgis_server import Connection, Server

#: Rows of binary COPY: the number of fields, and before each its bytes; big end first.
_HEAD = b"PGCOPY\n\xff\r\n\0" + bytes(8)
_TAIL = b"\xff\xff"
_FIELDS = {
    "row": ">i4",
    "column": ">i4",
    "height": ">f4",
    "elevation_m": ">f4",
    "steepest_grade": ">f4",
    "soil_category": ">i2",
}
_ROW = np.dtype(
    [("fields", ">i2")] + [part for name, kind in _FIELDS.items() for part in ((f"{name}_bytes", ">i4"), (name, kind))]
)
_ROWS_PER_WRITE = 100_000


def fill_cells(server: Server, store: TerrainStore, region: str) -> int:
    """Make the table of a region anew from its finished layers and return its number of cells.

    Raises:
        MissingRegionError: there is no such region.
        StoreBusyError: a layer was replaced meanwhile.
        StoreReadOnlyError: this user may not write.
    """
    info = store.region(region)
    connection = server.connect(patient=True)
    try:
        with server.told(connection):
            row = region_row(connection, region)
            layers = _layers(connection, row)
        table = None if layers[0] is None else make_table(store, info)
        if table is None:
            return 0
        with server.told(connection), connection.transaction():
            connection.execute(query("lock_cells"), (row.id,))
            connection.execute(query("make_new_cells"))
            with connection.cursor() as cursor, cursor.copy(query("copy_new_cells")) as copy:
                copy.write(_HEAD)
                rows = _rows(table)
                for first in range(0, rows.size, _ROWS_PER_WRITE):
                    copy.write(rows[first : first + _ROWS_PER_WRITE].tobytes())
                copy.write(_TAIL)
            if _layers(connection, row) != layers:
                raise StoreBusyError(
                    f"A layer of {region!r} was replaced while it was read.", "Give the command again."
                )
            report = None if table.soil is None else json.dumps(table.soil.report.as_dict())
            connection.execute(query("forget_cells"), {"region": row.id})
            connection.execute(query("fill_cells"), {"region": row.id})
            connection.execute(query("note_cells"), {"region": row.id, "elevation": layers[0], "soil": layers[1],
                                                     "report": report})  # fmt: skip
            return rows.size
    finally:
        connection.close()


def may_fill(server: Server) -> bool:
    """Return whether this user may fill tables of cells."""
    with server.use() as connection:
        (may,) = connection.execute(query("may_fill_cells")).fetchone() or (False,)
    return bool(may)


def read_cells(server: Server, region: str) -> CellTable | None:
    """Return the table of a region, or None where there is none of its present layers."""
    with server.use() as connection, connection.transaction():
        connection.execute(query("one_state"))
        row = region_row(connection, region)
        found = connection.execute(query("present_cells"), (row.id,)).fetchone()
        if found is None:
            return None
        with connection.cursor() as cursor, cursor.copy(query("read_cells"), (row.id,)) as copy:
            stream = b"".join(copy)
    rows, columns = row.rows // GROUP, row.columns // GROUP
    cells = np.frombuffer(stream, _ROW, rows * columns, len(_HEAD)).reshape(rows, columns)
    geometry = GridGeometry(rows, columns, row.cell_size_m * GROUP, row.west_m, row.north_m)
    soil = None
    if found[0] is not None:
        soil = SoilLayer(np.ascontiguousarray(cells["soil_category"], dtype=np.uint8), _report(found[0]))
    return CellTable(
        geometry,
        np.ascontiguousarray(cells["height"], dtype=np.float32),
        np.ascontiguousarray(cells["elevation_m"], dtype=np.float32),
        np.ascontiguousarray(cells["steepest_grade"], dtype=np.float32),
        soil,
    )


def _layers(connection: Connection, region: RegionRow) -> tuple[int | None, int | None]:
    """Return the rows of the present elevation and soil."""
    elevation, soil = connection.execute(query("present_layers"), (region.id,)).fetchone() or (None, None)
    return elevation, soil


def _rows(table: CellTable) -> NDArray[Any]:
    rows, columns = table.geometry.shape
    cells = np.zeros((rows, columns), _ROW)
    cells["fields"] = len(_FIELDS)
    for name, kind in _FIELDS.items():
        cells[f"{name}_bytes"] = np.dtype(kind).itemsize
    cells["row"], cells["column"] = np.arange(rows)[:, None], np.arange(columns)[None, :]
    cells["height"], cells["elevation_m"] = table.height, table.elevation_m
    cells["steepest_grade"] = table.steepest_grade
    cells["soil_category"] = 0 if table.soil is None else table.soil.codes
    return cells.ravel()


def _report(stored: dict[str, Any]) -> SoilReport:
    entries = tuple(
        SoilEntry(
            entry["value"], entry["label"], SoilClass[entry["soil_class"].upper()], entry["understood"], entry["cells"]
        )
        for entry in stored["entries"]
    )
    return SoilReport(stored["source"], stored["field"], entries, stored["covered_fraction"], stored["disputed_cells"])
