"""The terrain store in PostgreSQL with PostGIS, for those who share a region.

Plain SQL in named files (``sql/``), numbered migrations (``migrations/``), parameters always bound. Many processes may
read and write at once: a layer is switched in one transaction, readings are facts in one order.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.errors import RegionConflictError
from swathe.io.crs import Frame, registered_name
from swathe.store import postgis_cells, postgis_polygons, postgis_rasters, postgis_readings
from swathe.store.interface import (
    SOIL,
    ZONES,
    LayerInfo,
    RegionInfo,
    StoredRoute,
    StoredRun,
    TerrainStore,
    require_selection,
    require_within,
)
from swathe.store.naming import checked_name
from swathe.store.postgis_changes import PostgisSubscription, read_changes
from swathe.store.postgis_regions import missing_region, read_regions, region_row, region_values
from swathe.store.postgis_schema import prepare
from swathe.store.postgis_server import Server
from swathe.store.queries import query

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import DTypeLike, NDArray

    from swathe.grid import Window
    from swathe.store.cell_table import CellTable
    from swathe.store.interface import (
        Bounds,
        Change,
        ImportSession,
        Provenance,
        SoilPolygon,
        StoredReading,
        Subscription,
        Zone,
    )
    from swathe.store.postgis_server import Connection


class PostgisStore(TerrainStore):
    """Regions in a database. Its connection is shared by all calls and opened anew where it was lost between them."""

    def __init__(self, url: str, *, create: bool = False) -> None:
        self._server = Server(url)
        self.address = self._server.address
        try:
            prepare(self._server, create=create)
        except BaseException:
            self._server.close()
            raise

    def close(self) -> None:
        """Close the connection."""
        self._server.close()

    # Regions

    def create_region(self, name: str, frame: Frame) -> RegionInfo:
        """Make a region, or return the one that is there."""
        name = checked_name(name)
        with self._server.use() as connection:
            found = read_regions(connection, name)
            if not found:
                srid = self._srid(connection, frame)
                with connection.transaction():
                    added = connection.execute(query("add_region"), region_values(name, frame, srid)).fetchone()
                    if added is not None:
                        self._note(connection, added[0], "region", name)
                found = read_regions(connection, name)
        (region,) = found
        if region.frame != frame:
            raise RegionConflictError(
                f"The region {name!r} lies on other cells.",
                "Choose another name, or drop the region first; the cells of a region never change.",
            )
        return region

    @staticmethod
    def _srid(connection: Connection, frame: Frame) -> int:
        """Return the number by which the database knows the frame's system, 0 for none."""
        found = None if frame.crs_wkt is None else registered_name(frame.crs_wkt)
        if found is None or found[1] != "EPSG":
            return 0
        number = found[2]
        (known,) = connection.execute(query("known_srid"), (number,)).fetchone() or (0,)
        return number if known else 0

    @staticmethod
    def _note(connection: Connection, region_id: int, kind: str, subject: str, author: str = "") -> None:
        change = {"region": region_id, "kind": kind, "subject": subject, "count": 1, "author": author, "detail": "{}"}
        connection.execute(query("note_change"), change)

    def regions(self) -> list[RegionInfo]:
        """Return all regions, by name."""
        with self._server.use() as connection:
            return read_regions(connection)

    def region(self, name: str) -> RegionInfo:
        """Return a region as it is now."""
        with self._server.use() as connection:
            found = read_regions(connection, checked_name(name))
            if not found:
                raise missing_region(connection, name)
        return found[0]

    def drop_region(self, name: str) -> None:
        """Remove a region with everything in it."""
        with self._server.use() as connection:
            if connection.execute(query("drop_region"), (checked_name(name),)).rowcount == 0:
                raise missing_region(connection, name)

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
        """Begin to write a raster of float32 (NaN unknown), uint8, uint16 or int32 (0 unknown)."""
        info = LayerInfo(checked_name(layer, "layer"), "raster", np.dtype(dtype).name, provenance, details or {})
        return postgis_rasters.PostgisImport(self._server, region, info)

    def read_window(self, region: str, layer: str, window: Window, *, overview: int = 1) -> NDArray[Any]:
        """Return a window of a raster."""
        return postgis_rasters.read_window(self._server, region, layer, window, overview)

    # Polygons

    def write_soil_polygons(
        self,
        region: str,
        batches: Iterable[Sequence[SoilPolygon]],
        provenance: Provenance,
        *,
        details: Mapping[str, Any] | None = None,
    ) -> bool:
        """Replace the soil map by polygons, in one step when all have come; False if it is this very map already."""
        info = LayerInfo(SOIL, "polygons", "", provenance, details or {})
        return postgis_polygons.write_soil(self._server, region, info, batches)

    def soil_polygons(self, region: str, bounds: Bounds | None = None) -> Iterator[SoilPolygon]:
        """Yield the polygons whose box meets ``bounds`` (west, south, east, north), in the order of writing."""
        return postgis_polygons.read_soil(self._server, region, bounds)

    def write_zones(
        self,
        region: str,
        batches: Iterable[Sequence[Zone]],
        provenance: Provenance,
        *,
        details: Mapping[str, Any] | None = None,
    ) -> bool:
        """Replace the zones as ``write_soil_polygons`` does the soil."""
        info = LayerInfo(ZONES, "polygons", "", provenance, details or {})
        return postgis_polygons.write_zones(self._server, region, info, batches)

    def zones(self, region: str, bounds: Bounds | None = None) -> Iterator[Zone]:
        """Yield the zones whose box meets ``bounds``, in the order of writing."""
        return postgis_polygons.read_zones(self._server, region, bounds)

    # Readings

    def add_readings(self, region: str, readings: Sequence[StoredReading]) -> int:
        """File readings, all or none, as one revision, and return how many were new (their id not there yet)."""
        with self._server.use() as connection:
            row = region_row(connection, region)
        require_within(RegionInfo(row.name, Frame(row.geometry)), readings)
        return postgis_readings.add_readings(self._server, region, readings)

    def readings(
        self, region: str, *, since: int = 0, until: int | None = None, withdrawn: bool = False
    ) -> list[StoredReading]:
        """Return the readings filed after revision ``since``, by revision and id."""
        return postgis_readings.read_readings(self._server, region, since, until, withdrawn=withdrawn)

    def withdraw(
        self,
        region: str,
        reason: str,
        *,
        instrument: str | None = None,
        author: str | None = None,
        ids: Sequence[str] | None = None,
    ) -> int:
        """Let readings count no more, as one revision, and return how many; those withdrawn before stay as they are."""
        require_selection(instrument, author, ids)
        return postgis_readings.withdraw(self._server, region, reason, instrument=instrument, author=author, ids=ids)

    # Routes and runs

    def add_route(self, region: str, route: StoredRoute) -> None:
        """File a route; one of the same id is replaced."""
        with self._server.use() as connection, connection.transaction():
            row = region_row(connection, region)
            values = {
                "region": row.id,
                "srid": row.srid,
                "id": route.id,
                "vehicle": route.vehicle,
                "summary": json.dumps(dict(route.summary)),
                "author": route.author,
                "time": route.time,
                "wkb": route.wkb,
            }
            connection.execute(query("put_route"), values)
            self._note(connection, row.id, "route", route.id, route.author)

    def routes(self, region: str) -> list[StoredRoute]:
        """Return the routes, by time and id."""
        with self._server.use() as connection:
            found = connection.execute(query("read_routes"), (region_row(connection, region).id,))
            return [StoredRoute(*row) for row in found]

    def add_run(self, region: str, run: StoredRun) -> None:
        """File a drive; one of the same id is replaced."""
        with self._server.use() as connection, connection.transaction():
            row = region_row(connection, region)
            values = {
                "region": row.id,
                "id": run.id,
                "log": run.log,
                "summary": json.dumps(dict(run.summary)),
                "author": run.author,
                "time": run.time,
            }
            connection.execute(query("put_run"), values)
            self._note(connection, row.id, "run", run.id, run.author)

    def runs(self, region: str) -> list[StoredRun]:
        """Return the drives, by time and id."""
        with self._server.use() as connection:
            found = connection.execute(query("read_runs"), (region_row(connection, region).id,))
            return [StoredRun(*row) for row in found]

    # The paper's table

    def cell_table(self, region: str) -> CellTable | None:
        """Return the paper's table of a region, filled anew where its layers have changed.

        None when this user may not fill it, or the region has no elevation or is smaller than one group of cells.
        """
        found = postgis_cells.read_cells(self._server, region)
        if found is not None or not postgis_cells.may_fill(self._server):
            return found
        return postgis_cells.read_cells(self._server, region) if self.fill_cells(region) else None

    def fill_cells(self, region: str) -> int:
        """Make the paper's table of a region anew and return its number of cells (``cells`` in the database)."""
        return postgis_cells.fill_cells(self._server, self, region)

    # Changes

    def changes(self, region: str, since: int = 0) -> list[Change]:
        """Return every change after a revision, in order."""
        with self._server.use() as connection:
            return read_changes(connection, region_row(connection, region).id, since)

    def subscribe(self, region: str, *, since: int | None = None) -> Subscription:
        """Begin to listen for changes after a revision, by default after the present one."""
        return PostgisSubscription(self._server, region, since)
