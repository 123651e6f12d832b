"""A region made of what was asked for: elevation and soil read, warped, averaged, checked, and noted."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import AllVoidError, TooSmallError
from swathe.grid import Cell, GridGeometry
from swathe.io.cost_raster import read_cost
from swathe.io.elevation import TILE_SIZE, open_elevation, require_known
from swathe.io.lazy import LazyElevation
from swathe.io.memory import require_memory
from swathe.io.soil import read_soil
from swathe.io.sources import single
from swathe.io.window import bounded, reads_lazily
from swathe.nest import Nests
from swathe.objective import closed_where, cost_factor
from swathe.rank import Region, TiledRegion
from swathe.store.source import StoredElevation
from swathe.terrain import block_max, group_mean, height_map, slope
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from swathe.config import Settings, TerrainRequest
    from swathe.grid import Position, Window
    from swathe.io.crs import Frame
    from swathe.io.elevation import ElevationSource
    from swathe.io.sources import Source
    from swathe.planner import Plan
    from swathe.soil import SoilReport
    from swathe.store.cell_table import CellTable
    from swathe.vehicle import Vehicle

    OnProgress = Callable[[str, int, int], bool]

#: The paper averages groups of 8 x 8 pixels; what is left must have a gradient.
_PAPER_GROUP, _FEWEST_GROUPS = 8, 3


@dataclass
class Stopwatch:
    """Seconds of each step, for the summary only."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the time of the block to a step."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began


@dataclass(frozen=True, eq=False)
class Ground:
    """A region with everything about it that outputs tell.

    Of one that is read when it is needed, ``as_read`` gives what was read as ground that can be shown; ``trusted`` are
    then the cells whose ranks are those of the whole map.
    """

    planned: Region | TiledRegion
    frame: Frame
    source: ElevationSource
    soil: SoilReport | None
    soil_source: Source | None
    cost: NDArray[np.float32] | None
    cost_source: Source | None
    notes: tuple[str, ...]
    is_whole: bool
    trusted: NDArray[np.bool_] | None = None

    @property
    def region(self) -> Region:
        """The region, all of which was read."""
        if isinstance(self.planned, Region):
            return self.planned
        raise TypeError("The region is read when it is needed; use as_read.")  # our own bug


def prepare_ground(terrain: TerrainRequest, settings: Settings, *, on_progress: OnProgress | None = None) -> Ground:
    """Read the whole map (or ``terrain.bounds``) and make a region of it, for pictures of it.

    Raises:
        SwatheError: the inputs cannot be used, or the user stopped.
    """
    watch = Stopwatch()
    vehicle = load_vehicle(settings.vehicle)
    with open_source(terrain) as source:
        window = bounded(source, terrain.bounds, terrain.points_crs)
        return prepare(source, terrain, window, vehicle, settings, is_whole=True, watch=watch, on_progress=on_progress)


def open_source(terrain: TerrainRequest) -> ElevationSource:
    """Open the elevation that was asked for, in files or in a store; nothing is read yet."""
    if terrain.store is not None and terrain.region is not None:
        return StoredElevation(terrain.store, terrain.region, terrain.revision)
    return open_elevation(
        terrain.dem,
        cell_size_m=terrain.cell_size_m,
        crs=terrain.crs,
        height_range_m=terrain.height_range_m,
    )


def lazy_elevation(
    source: ElevationSource,
    terrain: TerrainRequest,
    whole: Window,
    settings: Settings,
    on_progress: OnProgress | None,
) -> LazyElevation | None:
    """Return the elevation as what a plan reads when it needs it, or None where it is read at once."""
    # Costs of the user's and zones close cells of the map before anything is looked at.
    closes = terrain.cost_raster is not None or (isinstance(source, StoredElevation) and source.has_zones)
    if settings.looks_where_it_goes and not closes and reads_lazily(source, whole):
        return LazyElevation(source, whole, on_progress)
    return None


def place_of(source: ElevationSource, point: tuple[float, float], points_crs: str | None) -> Position:
    """Return a point, in ``points_crs``, in the frame of the elevation."""
    return source.frame.from_points(point[0], point[1], points_crs, source.source_crs_wkt)


def prepare(
    source: ElevationSource,
    terrain: TerrainRequest,
    window: Window,
    vehicle: Vehicle,
    settings: Settings,
    *,
    is_whole: bool,
    watch: Stopwatch,
    on_progress: OnProgress | None,
    lazy: LazyElevation | None = None,
) -> Ground:
    """Read a window of the ground and make a region of it; ``lazy`` elevation is read when it is needed."""
    if lazy is not None:
        return _prepare_lazily(source, terrain, window, vehicle, settings, is_whole=is_whole, watch=watch, lazy=lazy)
    frame = source.frame.window(window)
    require_memory(window, frame.geometry.cell_size_m, source.names, terrain.memory_limit_bytes)
    with watch.step("read"):
        table = source.cells(window) if settings.follows_paper and isinstance(source, StoredElevation) else None
        report = None if on_progress is None else (lambda done, total: on_progress("reading elevation", done, total))
        elevation_m = source.read(window, report) if table is None else table.elevation_m
    if is_whole:
        require_known(elevation_m, ", ".join(source.names))
    notes: list[str] = []
    grey = None
    if settings.follows_paper:
        _require_groups(frame.geometry)
        if table is None:
            frame, elevation_m, grey, steepest = _averaged(frame, elevation_m, source.height_range_m)
        else:
            frame, grey, steepest = replace(frame, geometry=table.geometry), table.height, table.steepest_grade
        notes.append(f"Profile {settings.rank.profile}: heights averaged by groups of 8 x 8 pixels, as in the paper.")
        notes += _hidden_note(steepest, vehicle)
    soil_report, codes, soil_source, more = _soil(source, terrain, frame, vehicle, settings, watch=watch, cells=table)
    notes += more
    zones = source.closed(frame) if isinstance(source, StoredElevation) else None
    region = Region(frame.geometry, elevation_m, vehicle, codes, grey, zones, settings.rank)
    cost = cost_source = None
    if terrain.cost_raster is not None:
        with watch.step("cost"):
            cost = cost_factor(region, read_cost(terrain.cost_raster, frame))
        cost_source = single(terrain.cost_raster)
        region = closed_where(region, cost)
        notes.append(_cost_note(cost))
    notes += _notes(region, source, soil_report)
    return Ground(region, frame, source, soil_report, soil_source, cost, cost_source, tuple(notes), is_whole)


def _cost_note(cost: NDArray[np.float32]) -> str:
    known = cost[np.isfinite(cost)]
    closed = 100 * float(np.mean(~np.isfinite(cost)))
    span = f"{known.min():g} to {known.max():g}"
    return f"Costs were multiplied by {span}, by cell; {closed:.1f} % of the cells were closed."


def _prepare_lazily(
    source: ElevationSource,
    terrain: TerrainRequest,
    window: Window,
    vehicle: Vehicle,
    settings: Settings,
    *,
    is_whole: bool,
    watch: Stopwatch,
    lazy: LazyElevation,
) -> Ground:
    """Make a region of a window of the ground whose elevation is read when it is needed; its soil is read at once."""
    frame = source.frame.window(window)
    require_memory(window, frame.geometry.cell_size_m, source.names, terrain.memory_limit_bytes)
    soil_report, codes, soil_source, more = _soil(source, terrain, frame, vehicle, settings, watch=watch)
    first = (window.row % TILE_SIZE, window.column % TILE_SIZE)
    region = TiledRegion(frame.geometry, lazy.reader(window), vehicle, codes, settings.rank, TILE_SIZE, first)
    notes = (*more, *_notes(region, source, soil_report))
    return Ground(region, frame, source, soil_report, soil_source, None, None, notes, is_whole)


def as_read(ground: Ground, window: Window, lazy: LazyElevation, answer: Plan) -> tuple[Ground, Plan]:
    """Return what was read of a window as ground that can be shown, with the answer on it.

    Raises:
        InputError: nothing could be read.
    """
    extent = lazy.extent(window)
    if extent is None:
        raise lazy.failure or AllVoidError("Nothing of the elevation was read.", "Choose places inside it.")
    row, column = extent.row - window.row, extent.column - window.column
    part = (slice(row, row + extent.rows), slice(column, column + extent.columns))
    frame = ground.source.frame.window(extent)
    region = ground.planned
    soil = None if region.soil is None else region.soil[part]
    shown = Region(frame.geometry, lazy.heights(extent), region.vehicle, soil, params=region.params)
    nests = answer.nests
    if nests is not None:
        nests = Nests(np.ascontiguousarray(nests.labels[part]), nests.sizes)
    path = [Cell(cell.row - row, cell.column - column) for cell in answer.path]
    trusted = lazy.surroundings_read(extent)
    return replace(ground, planned=shown, frame=frame, trusted=trusted), replace(answer, nests=nests, path=path)


def _soil(
    source: ElevationSource,
    terrain: TerrainRequest,
    frame: Frame,
    vehicle: Vehicle,
    settings: Settings,
    *,
    watch: Stopwatch,
    cells: CellTable | None = None,
) -> tuple[SoilReport | None, NDArray[np.uint8] | None, Source | None, list[str]]:
    """Read the soil map that was asked for, if any; with one of a store, its readings count."""
    if isinstance(source, StoredElevation):
        with watch.step("soil"):
            stored = source.soil(frame, vehicle, settings.rank, cells)
        if stored is None:
            return None, None, None, []
        found, codes, origin, readings = stored
        notes = [f"Soil is believed after {readings} readings of the store."] if readings else []
        return found.report, codes, origin, notes
    if terrain.soil is None:
        return None, None, None, []
    with watch.step("soil"):
        origin = single(terrain.soil)  # first: what has to be fetched for it is then fetched once
        layer = read_soil(terrain.soil, frame, field=terrain.soil_field, legend=terrain.soil_legend)
    return layer.report, layer.codes, origin, []


def _require_groups(geometry: GridGeometry) -> None:
    rows, columns = geometry.rows // _PAPER_GROUP, geometry.columns // _PAPER_GROUP
    if min(rows, columns) < _FEWEST_GROUPS:
        raise TooSmallError(
            f"The paper's groups of 8 x 8 cells make {rows} x {columns} of {geometry.rows} x {geometry.columns} cells.",
            "At least 3 x 3 are needed: use a larger map, a smaller `--cell-size` or `--profile metric`.",
        )


def _averaged(
    frame: Frame, elevation_m: NDArray[np.float32], grey_range_m: tuple[float, float] | None
) -> tuple[Frame, NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Average the map by groups of 8 x 8 pixels, as the paper does: heights, grey levels, and the steepest slopes."""
    geometry = frame.geometry
    rows, columns = geometry.rows // _PAPER_GROUP, geometry.columns // _PAPER_GROUP
    levels = height_map(elevation_m, grey_range_m)
    coarse = GridGeometry(rows, columns, geometry.cell_size_m * _PAPER_GROUP, geometry.west_m, geometry.north_m)
    steepest = block_max(slope(elevation_m, geometry.cell_size_m))
    return replace(frame, geometry=coarse), group_mean(elevation_m), group_mean(levels), steepest


def _hidden_note(steepest: NDArray[np.float32], vehicle: Vehicle) -> list[str]:
    known = steepest[np.isfinite(steepest)]
    hidden = float(np.mean(known > vehicle.max_grade)) if known.size else 0.0
    if hidden <= 0:
        return []
    return [f"{100 * hidden:.0f} % of the averaged cells hold ground steeper than the vehicle's limit."]


def _notes(region: Region | TiledRegion, source: ElevationSource, soil: SoilReport | None) -> list[str]:
    """Return what a reader of any output must know about it."""
    cell_m = region.geometry.cell_size_m
    notes = [f"Obstacles smaller than a terrain cell ({cell_m:g} m) are not seen."]
    if source.warped:
        notes.append(f"Elevation was resampled to {source.frame.name}, {source.frame.geometry.cell_size_m:g} m cells.")
    unknown = {
        "neutral": "counts as goodness 3 and is not gated",
        "avoid": "is avoided",
    }.get(region.params.unknown_soil, f"counts as {region.params.unknown_soil}")
    if region.soil is None:
        notes.append(f"No soil map was given: unknown soil {unknown}.")
    else:
        if soil is not None and "generated" in soil.source:
            notes.append("The soil layer was generated from the elevation by rule; it is not a survey.")
        share = float(np.mean(region.soil == 0))
        if share > 0:
            notes.append(f"The soil of {100 * share:.1f} % of the cells is unknown; it {unknown}.")
        if soil is not None and soil.not_understood:
            labels = ", ".join(entry.label or entry.value for entry in soil.not_understood[:5])
            notes.append(f"Soil labels not understood: {labels}.")
    if region.vehicle.core.cone_index()[2]:
        notes.append("The vehicle cone index is extrapolated: no formula was calibrated on vehicles this small.")
    return notes
