"""What every store offers: the data that it holds, and the operations on them.

Coordinates are metres in the frame of the region, rows run south and columns east from its north-west corner. Names of
regions and layers are any text. Every operation is safe beside other processes that read and write.
"""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Self

from swathe.errors import InvalidParameterError, OutsideGridError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from types import TracebackType

    import numpy as np
    from numpy.typing import DTypeLike, NDArray

    from swathe.belief import BeliefParams, ClassReading, PenetrometerReading, SoilBelief
    from swathe.grid import GridGeometry, Window
    from swathe.io.crs import Frame
    from swathe.io.soil import SoilLayer
    from swathe.soil import SoilClass
    from swathe.store.cell_table import CellTable
    from swathe.vehicle import Vehicle

#: Cells along the edge of the tiles in which rasters are written.
TILE_SIZE = 256

#: What ``read_window`` can give one number for: so many cells squared.
OVERVIEWS = (1, 2, 4, 8, 16, 32, 64)

#: The layers that every command knows. Others (ranks and nests of a vehicle) take any other name.
ELEVATION, SOIL, ZONES = "elevation", "soil", "zones"

Bounds = tuple[float, float, float, float]
ChangeKind = Literal["region", "layer", "readings", "withdrawal", "route", "run"]
Join = Literal["centre", "area"]


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a layer comes from.

    Attributes:
        inputs: name and SHA-256 of every file, in the order in which they were given.
        crs: the system of the files, as WKT; empty where they have none.
        licence: a note on the terms of the data.
        author: who imported it.
        time: when, ISO 8601 in UTC; filled in by the store when empty.
        options: what was asked for that changes the result (cell size, field, legend), as text by name.
    """

    inputs: tuple[tuple[str, str], ...]
    crs: str = ""
    licence: str = ""
    author: str = ""
    time: str = ""
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """SHA-256 over the content of the inputs and the options: two imports of one digest give the same layer."""
        # What lies on a server, or is made by rule, has no hash: there the name counts.
        inputs = [sha256 if len(sha256) == 64 else name for name, sha256 in self.inputs]
        what = {"inputs": inputs, "options": dict(sorted(self.options.items()))}
        return hashlib.sha256(json.dumps(what, ensure_ascii=True, separators=(",", ":")).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class LayerInfo:
    """A finished layer.

    Attributes:
        name: ``elevation``, ``soil``, ``zones``, or any other.
        kind: ``raster`` (read by ``read_window``) or ``polygons``.
        dtype: numpy's name of the numbers of a raster; empty for polygons.
        provenance: where it comes from.
        details: what a reader must know of it, as values of JSON (the legend of soil values, the height range of grey).
    """

    name: str
    kind: Literal["raster", "polygons"]
    dtype: str
    provenance: Provenance
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RegionInfo:
    """A region: the lattice that all its rasters share, and its finished layers by name."""

    name: str
    frame: Frame
    layers: Mapping[str, LayerInfo] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SoilPolygon:
    """A piece of a soil map: a valid polygon or multipolygon in the region's frame.

    Attributes:
        wkb: its geometry.
        value: the text of the map that says its soil.
        soil_class: what that was understood as.
        cat: its category, as GRASS counts them; None without one.
        attributes: everything else that the map says of it, as values of JSON.
    """

    wkb: bytes
    value: str
    soil_class: SoilClass
    cat: int | None = None
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Zone:
    """Ground that is closed to every vehicle: a valid polygon or multipolygon in the region's frame."""

    wkb: bytes
    name: str = ""
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StoredReading:
    """A reading as a fact: never changed and never removed.

    Attributes:
        id: chosen by who files it; the same id filed again is the same reading.
        reading: a push of the cone, or somebody's word on the soil; in the region's frame.
        author: person or vehicle.
        time: when it was taken, ISO 8601 in UTC.
        instrument: the very instrument, so that a wrong one can be withdrawn.
        error: standard deviation of its cone index over the cone index; None when not known.
        revision: the region's revision that added it; 0 before it is filed.
        withdrawn_at: the revision that withdrew it, or None.
        reason: why it was withdrawn.
    """

    id: str
    reading: PenetrometerReading | ClassReading
    author: str
    time: str
    instrument: str = ""
    error: float | None = None
    revision: int = 0
    withdrawn_at: int | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class StoredRoute:
    """A route: its line in the region's frame as WKB, and the summary of the plan that found it."""

    id: str
    wkb: bytes
    vehicle: str
    summary: Mapping[str, Any]
    author: str = ""
    time: str = ""


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A drive: its summary, and the path of its log, which stays where it is."""

    id: str
    log: str
    summary: Mapping[str, Any]
    author: str = ""
    time: str = ""


@dataclass(frozen=True, slots=True)
class Change:
    """One change of a region. Revisions count up from 1, without a gap, in the order in which they became visible.

    Attributes:
        revision: its number.
        time: when, ISO 8601 in UTC.
        kind: what changed; ``readings`` and ``withdrawal`` change the belief.
        subject: the layer's, route's or run's name; empty for readings.
        count: how many things.
        author: who did it.
        detail: more, as values of JSON: for ``readings`` and ``withdrawal`` their ``ids`` and the ``reason``.
    """

    revision: int
    time: str
    kind: ChangeKind
    subject: str = ""
    count: int = 1
    author: str = ""
    detail: Mapping[str, Any] = field(default_factory=dict)


def require_window(geometry: GridGeometry, window: Window, overview: int = 1) -> None:
    """Raise OutsideGridError or InvalidParameterError for a window that cannot be read."""
    row, column, rows, columns = window
    inside = 0 <= row <= geometry.rows - rows and 0 <= column <= geometry.columns - columns
    if rows < 1 or columns < 1 or not inside:
        raise OutsideGridError(
            f"The window of {rows} x {columns} cells at row {row}, column {column} is not inside the region.",
            f"It has {geometry.rows} rows and {geometry.columns} columns.",
        )
    if overview not in OVERVIEWS or row % overview or column % overview:
        raise InvalidParameterError(
            f"There is no overview {overview} from row {row}, column {column} on.",
            f"Give one of {', '.join(map(str, OVERVIEWS))}, and a row and column that are multiples of it.",
        )


def require_within(region: RegionInfo, readings: Sequence[StoredReading]) -> None:
    """Raise a UsageError for a reading without an id, that is not physical, or that lies outside the region."""
    from swathe.belief import PenetrometerReading
    from swathe.grid import Position

    for stored in readings:
        reading = stored.reading
        if isinstance(reading, PenetrometerReading):
            reading.validate()
        finite = math.isfinite(reading.x_m) and math.isfinite(reading.y_m)
        if not finite or region.frame.geometry.cell_at(Position(reading.x_m, reading.y_m)) is None:
            raise OutsideGridError(
                f"The reading at {reading.x_m:.12g}, {reading.y_m:.12g} lies outside the region {region.name!r}.",
                "Give places in the metres of the region.",
            )
        if not stored.id or not (stored.error is None or 0 <= stored.error < math.inf):
            raise InvalidParameterError(
                f"The reading {stored.id!r} has no id, or an error that is none.", "Give an id and an error from 0 on."
            )


def require_selection(instrument: str | None, author: str | None, ids: Sequence[str] | None) -> None:
    """Raise InvalidParameterError unless exactly one of the three says which readings are meant."""
    if [instrument, author, ids].count(None) != 2:
        raise InvalidParameterError(
            "Which readings are withdrawn is not clear.", "Give an instrument, an author or the readings' ids."
        )


class ImportSession(ABC):
    """A raster that is being written, unseen until ``commit``. A context manager.

    It holds the layer for itself: a second one on the same layer is refused with StoreBusyError. Leaving it without
    ``commit`` keeps what was written; the next session of the same provenance goes on from there.

    Attributes:
        is_current: whether the store holds this very layer already, so that there is nothing to do.
    """

    is_current: bool

    @abstractmethod
    def have(self) -> frozenset[tuple[int, int]]:
        """Return the tiles (row, column of the tile) that an earlier, unfinished session has left whole."""

    @abstractmethod
    def write_tile(self, row: int, column: int, tile: NDArray[Any]) -> None:
        """Write one tile, counted in tiles; at the south and east edge it may be smaller than TILE_SIZE squared."""

    @abstractmethod
    def commit(self) -> None:
        """Put the layer into the place of the old one, in one step. Tiles that were not written are unknown (NaN, 0).

        Raises:
            StoreError: it cannot be; the old layer stands and the tiles are kept.
        """

    @abstractmethod
    def abort(self) -> None:
        """Throw away what was written; the old layer stands."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the layer."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Subscription(ABC):
    """What hears of changes of one region. A context manager."""

    @abstractmethod
    def poll(self, timeout_s: float = 0.0) -> list[Change]:
        """Return the changes since the last call in order, after waiting at most so long for the first."""

    @abstractmethod
    def close(self) -> None:
        """Stop listening."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class TerrainStore(ABC):
    """Regions with their layers, readings, routes and runs. A context manager; ``address`` is fit to be shown.

    Every method may raise StoreUnavailableError, StoreBusyError, StoreDamagedError, and when it writes
    StoreReadOnlyError or StoreFullError; MissingRegionError for a region that is not there.
    """

    address: str

    # Regions

    @abstractmethod
    def create_region(self, name: str, frame: Frame) -> RegionInfo:
        """Make a region, or return the one that is there.

        Raises:
            RegionConflictError: a region of this name lies on another lattice.
            InvalidParameterError: the name is empty, longer than 200 characters, or holds control characters.
        """

    @abstractmethod
    def regions(self) -> list[RegionInfo]:
        """Return all regions, by name."""

    @abstractmethod
    def region(self, name: str) -> RegionInfo:
        """Return a region as it is now."""

    @abstractmethod
    def drop_region(self, name: str) -> None:
        """Remove a region with everything in it."""

    # Rasters

    @abstractmethod
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

    @abstractmethod
    def read_window(self, region: str, layer: str, window: Window, *, overview: int = 1) -> NDArray[Any]:
        """Return a window of a raster; its rows and columns are divided by ``overview`` and rounded up.

        Args:
            region: its region.
            layer: its name.
            window: row, column, rows, columns in cells, inside the region; its row and column are multiples of
                ``overview``.
            overview: 1, or a power of 2 up to 64: each number then stands for so many cells squared. It is the mean of
                the known heights, or one of the codes.

        Raises:
            MissingLayerError: the region has no such raster.
            OutsideGridError: the window is not inside.
        """

    # Polygons

    @abstractmethod
    def write_soil_polygons(
        self,
        region: str,
        batches: Iterable[Sequence[SoilPolygon]],
        provenance: Provenance,
        *,
        details: Mapping[str, Any] | None = None,
    ) -> bool:
        """Replace the soil map by polygons, in one step when all have come; False if it is this very map already."""

    @abstractmethod
    def soil_polygons(self, region: str, bounds: Bounds | None = None) -> Iterator[SoilPolygon]:
        """Yield the polygons whose box meets ``bounds`` (west, south, east, north), in the order of writing."""

    @abstractmethod
    def write_zones(
        self,
        region: str,
        batches: Iterable[Sequence[Zone]],
        provenance: Provenance,
        *,
        details: Mapping[str, Any] | None = None,
    ) -> bool:
        """Replace the zones as ``write_soil_polygons`` does the soil."""

    @abstractmethod
    def zones(self, region: str, bounds: Bounds | None = None) -> Iterator[Zone]:
        """Yield the zones whose box meets ``bounds``, in the order of writing."""

    # Readings

    @abstractmethod
    def add_readings(self, region: str, readings: Sequence[StoredReading]) -> int:
        """File readings, all or none, as one revision, and return how many were new (their id not there yet).

        Raises:
            UsageError: one is not physical or lies outside the region.
        """

    @abstractmethod
    def readings(
        self, region: str, *, since: int = 0, until: int | None = None, withdrawn: bool = False
    ) -> list[StoredReading]:
        """Return the readings filed after revision ``since``, by revision and id.

        Args:
            region: its region.
            since: the revision after which.
            until: the revision of which the state is wanted: readings filed later are not there and those withdrawn
                later still count. None is now.
            withdrawn: whether those that were withdrawn are returned too.
        """

    @abstractmethod
    def withdraw(
        self,
        region: str,
        reason: str,
        *,
        instrument: str | None = None,
        author: str | None = None,
        ids: Sequence[str] | None = None,
    ) -> int:
        """Let readings count no more, as one revision, and return how many; those withdrawn before stay as they are.

        Exactly one of ``instrument``, ``author`` and ``ids`` says which.
        """

    # Routes and runs

    @abstractmethod
    def add_route(self, region: str, route: StoredRoute) -> None:
        """File a route; one of the same id is replaced."""

    @abstractmethod
    def routes(self, region: str) -> list[StoredRoute]:
        """Return the routes, by time and id."""

    @abstractmethod
    def add_run(self, region: str, run: StoredRun) -> None:
        """File a drive; one of the same id is replaced."""

    @abstractmethod
    def runs(self, region: str) -> list[StoredRun]:
        """Return the drives, by time and id."""

    # Changes

    @abstractmethod
    def changes(self, region: str, since: int = 0) -> list[Change]:
        """Return every change after a revision, in order: the history of belief and layers."""

    @abstractmethod
    def subscribe(self, region: str, *, since: int | None = None) -> Subscription:
        """Begin to listen for changes after a revision, by default after the present one."""

    @abstractmethod
    def close(self) -> None:
        """Let go of files and connections."""

    # What follows from the above, the same in every store

    def soil_layer(self, region: str, window: Window, *, join: Join = "centre") -> SoilLayer | None:
        """Return the soil of a window's cells with its report, as from files; None without a soil map.

        ``join``: the soil under the centre of a cell, or that with the greatest area in it.
        """
        from swathe.store.soil import soil_layer

        return soil_layer(self, region, window, join=join)

    def soil_window(self, region: str, window: Window, *, join: Join = "centre") -> NDArray[np.uint8]:
        """Return the codes (``swathe.soil.SoilClass``, uint8) of a window's cells, 0 = unknown.

        Raises:
            MissingLayerError: the region has no soil map.
            OutsideGridError: the window is not inside.
        """
        from swathe.store.soil import soil_codes

        return soil_codes(self, region, window, join=join)

    def cell_table(self, region: str) -> CellTable | None:  # noqa: ARG002 - for stores that keep one
        """Return the paper's table of a region, or None in a store that keeps none."""
        return None

    def belief(
        self,
        region: str,
        vehicle: Vehicle | str,
        *,
        window: Window | None = None,
        moisture_percent: float = 20.0,
        soil_table: Literal["text", "table2"] = "text",
        params: BeliefParams | None = None,
        until: int | None = None,
    ) -> SoilBelief:
        """Return what is believed of the soil by all readings that count, whatever the order in which they came.

        ``until`` a revision gives the belief of that time. Readings outside the ``window`` do not reach it.

        Raises:
            MissingLayerError: the region has no soil map.
        """
        from swathe.store.shared_belief import belief

        return belief(
            self,
            region,
            vehicle,
            window=window,
            moisture_percent=moisture_percent,
            soil_table=soil_table,
            params=params,
            until=until,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
