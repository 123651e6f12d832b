"""The ground of a stored region, read like that of files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from affine import Affine

from swathe.errors import MissingLayerError, StoreBusyError
from swathe.grid import Window
from swathe.io.elevation import ElevationSource
from swathe.io.mosaic import Mosaic
from swathe.io.sources import RecordedSource
from swathe.io.target import Target
from swathe.io.tile import DatasetPool
from swathe.store import open_store
from swathe.store.interface import ELEVATION, SOIL, ZONES
from swathe.store.shared_belief import belief_of_frame, in_order
from swathe.store.soil import closed_by_zones, soil_of_frame, soil_units

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from swathe.belief import ClassReading, PenetrometerReading, Unit
    from swathe.io.crs import Frame
    from swathe.io.soil import SoilLayer
    from swathe.io.sources import Source
    from swathe.rank import RankParams
    from swathe.store.cell_table import CellTable
    from swathe.store.interface import LayerInfo, TerrainStore
    from swathe.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class SoilLearning:
    """The soil of a frame before anything was learnt, and what was read there since.

    Attributes:
        codes: the map's class of each cell.
        layer: number of the soil polygon of each cell, 0 for none.
        units: the polygons by number.
        readings: all that count, in an order that does not depend on who filed first.
    """

    codes: NDArray[np.uint8]
    layer: NDArray[np.uint32]
    units: Mapping[int, Unit]
    readings: tuple[PenetrometerReading | ClassReading, ...]


class StoredElevation(ElevationSource):
    """The elevation of a region, as ``swathe.io.elevation.open_elevation`` gave it when it was imported.

    Inputs have the names and hashes of the files that were imported. After ``close`` the store is opened again when it
    is needed.
    """

    def __init__(self, url: str, region: str, revision: int | None = None) -> None:
        """Open a region; readings filed after ``revision`` do not count."""
        self._url, self._region, self._revision = url, region, revision
        self._store: TerrainStore | None = None
        info = self.store.region(region)
        layer = info.layers.get(ELEVATION)
        if layer is None:
            address = self.store.address
            self.close()
            raise MissingLayerError(
                f"The region {region!r} of {address} has no elevation.", "Import it with `swathe import dem`."
            )
        self._layer = layer
        details = layer.details
        grey_range = details["height_range_m"]
        super().__init__(
            recorded(layer),
            [Mosaic([_StoredTile(self, info.frame, layer)])],
            Target(info.frame, warped=False, native_cell_size_m=float(details["native_cell_size_m"])),
            DatasetPool(),
            height_range_m=None if grey_range is None else (float(grey_range[0]), float(grey_range[1])),
        )
        self.source_crs_wkt = details["source_crs_wkt"]
        self.warped = bool(details["warped"])

    @property
    def region(self) -> str:
        """The region's name."""
        return self._region

    @property
    def store(self) -> TerrainStore:
        """The store, open."""
        if self._store is None:
            self._store = open_store(self._url)
        return self._store

    @property
    def has_zones(self) -> bool:
        """Whether the region has ground that is closed to all."""
        return ZONES in self.store.region(self._region).layers

    def close(self) -> None:
        """Close the store. Reading again opens it again."""
        if self._store is not None:
            self._store.close()
            self._store = None

    def read_stored(self, window: Window) -> NDArray[np.float32]:
        """Return the heights of a window inside the region.

        Raises:
            StoreBusyError: the elevation was replaced meanwhile, so that what was read before is of another map.
        """
        heights = self.store.read_window(self._region, ELEVATION, window)
        self._require_unchanged()
        self._pool.bytes_read += heights.nbytes
        return np.ascontiguousarray(heights, dtype=np.float32)

    def _require_unchanged(self) -> None:
        now = self.store.region(self._region).layers.get(ELEVATION)
        if now is None or now.provenance.digest != self._layer.provenance.digest:
            raise StoreBusyError(
                f"The elevation of {self._region!r} was replaced while it was read.", "Give the command again."
            )

    def cells(self, window: Window) -> CellTable | None:
        """Return the paper's table where the store keeps one and all of the region is wanted."""
        info = self.store.region(self._region)
        if window != Window(0, 0, *info.frame.geometry.shape):
            # Grey levels span the heights of the part that is planned on.
            return None
        table = self.store.cell_table(self._region)
        self._require_unchanged()
        return table

    def soil(
        self, frame: Frame, vehicle: Vehicle, params: RankParams, cells: CellTable | None = None
    ) -> tuple[SoilLayer, NDArray[np.uint8], Source, int] | None:
        """Return the soil map of a frame, the codes to rank by, its source, and how many readings the codes heed."""
        info = self.store.region(self._region)
        layer = info.layers.get(SOIL)
        if layer is None:
            return None
        found = cells.soil if cells is not None else None
        if found is None:
            found = soil_of_frame(self.store, info, frame)
        filed = self.store.readings(self._region, until=self._revision)
        if not filed:
            return found, found.codes, recorded(layer)[0], 0
        judged = {"moisture_percent": params.moisture_percent, "soil_table": params.soil_table}
        believed = belief_of_frame(self.store, info, frame, filed, vehicle, **judged)
        return found, believed.soil_beside(found.codes), recorded(layer)[0], len(filed)

    def learning(self, frame: Frame) -> SoilLearning | None:
        """Return what a drive on a frame needs to go on learning its soil; None without a soil map."""
        info = self.store.region(self._region)
        if SOIL not in info.layers:
            return None
        layer, units = soil_units(self.store, info, frame)
        filed = in_order(self.store.readings(self._region, until=self._revision), frame)
        return SoilLearning(soil_of_frame(self.store, info, frame).codes, layer, units, filed)

    def closed(self, frame: Frame) -> NDArray[np.bool_] | None:
        """Return which cells of a frame zones close, or None without zones."""
        return closed_by_zones(self.store, self.store.region(self._region), frame)


class _StoredTile:
    """A stored elevation as one raster of heights."""

    is_picture = False

    def __init__(self, elevation: StoredElevation, frame: Frame, layer: LayerInfo) -> None:
        place = frame.geometry
        self._elevation = elevation
        self.source: Source = recorded(layer)[0]
        self.rows, self.columns = place.shape
        self.crs_wkt = frame.crs_wkt
        self.transform = Affine(place.cell_size_m, 0, place.west_m, 0, -place.cell_size_m, place.north_m)

    def read(self, row: int, column: int, rows: int, columns: int) -> NDArray[np.float32]:
        """Return the heights of a block that lies inside."""
        return self._elevation.read_stored(Window(row, column, rows, columns))


def recorded(layer: LayerInfo) -> list[RecordedSource]:
    """Return the files of a layer as they were when it was imported."""
    return [RecordedSource(name, "", sha256=sha256) for name, sha256 in layer.provenance.inputs]
