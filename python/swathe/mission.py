"""The use cases: prepare a region, plan a route, find nests, and leave a complete folder.

``cli`` calls these and holds no logic of its own. Steps stand in the order in which they happen.
"""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import swathe
from swathe import comparison, planner, rank, swarm
from swathe import nest as nesting
from swathe.corridor import CorridorParams
from swathe.errors import InterruptedBySignalError, InvalidParameterError, TooSmallError
from swathe.export import place
from swathe.export.folder import SUMMARY, run_folder, to_json, write_text
from swathe.export.geojson import nest_collection, route_collection
from swathe.grid import GridGeometry
from swathe.io.elevation import open_elevation, require_known
from swathe.io.memory import require_memory
from swathe.io.raster import write_raster
from swathe.io.soil import read_soil
from swathe.io.sources import single
from swathe.io.window import bounded, first_window, larger_window
from swathe.nest import NestParams
from swathe.rank import RankParams, Region
from swathe.report.palette import rank_colour_table
from swathe.swarm import SwarmParams
from swathe.terrain import block_max, group_mean, height_map, slope
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from swathe.grid import Position, Window
    from swathe.io.crs import Frame
    from swathe.io.elevation import ElevationSource
    from swathe.io.sources import Source
    from swathe.planner import Plan
    from swathe.soil import SoilReport
    from swathe.vehicle import Vehicle

    OnProgress = Callable[[str, int, int], bool]

#: The paper averages groups of 8 x 8 pixels; what is left must have a gradient.
_PAPER_GROUP, _FEWEST_GROUPS = 8, 3


@dataclass(frozen=True, slots=True)
class TerrainRequest:
    """Which ground is meant.

    Attributes:
        dem: elevation sources; several are put together.
        soil: soil vector or raster, or None.
        soil_field: its attribute.
        soil_legend: CSV that explains its values.
        cell_size_m: size of terrain cells; the source's when None.
        crs: projection to plan in; UTM or the source's own when None.
        height_range_m: heights of black and white of a grey picture.
        points_crs: system of points and bounds; None is WGS 84 longitude,latitude.
        bounds: west, south, east, north of the part to use, in ``points_crs``.
        memory_limit_bytes: most memory that may be used; None takes what is free.
    """

    dem: tuple[str, ...]
    soil: str | None = None
    soil_field: str | None = None
    soil_legend: str | None = None
    cell_size_m: float | None = None
    crs: str | None = None
    height_range_m: tuple[float, float] | None = None
    points_crs: str | None = None
    bounds: tuple[float, float, float, float] | None = None
    memory_limit_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class Settings:
    """How the ground is judged and the route is found.

    ``agents``, ``pellet_max`` and ``arc`` are the profile's when None: 1024, 1 and a re-laid arc, or with the paper's
    profiles 10, 3 and a circle.
    """

    vehicle: str = "pioneer-3at"
    rank: RankParams = field(default_factory=RankParams)
    method: Literal["swarm", "exact"] = "swarm"
    agents: int | None = None
    pellet_max: int | None = None
    seed: int = 0
    arc: Literal["relaid", "spine", "circle", "line"] | None = None
    sagitta_m: float | None = None
    width_m: float | None = None
    bridge: bool = False
    certify: bool = False

    @property
    def follows_paper(self) -> bool:
        """Whether the profile is one of the paper's."""
        return self.rank.profile != "metric"

    def swarm_params(self) -> SwarmParams:
        """Return the swarm's parameters."""
        return SwarmParams(
            agents=self.agents if self.agents is not None else (10 if self.follows_paper else 1024),
            pellet_max=self.pellet_max if self.pellet_max is not None else (3 if self.follows_paper else 1),
            nest=NestParams(rank_min=self.rank.rank_min),
            seed=self.seed,
        )

    def corridor_params(self) -> CorridorParams:
        """Return the arc and width of the swathe."""
        arc = self.arc or ("circle" if self.follows_paper else "relaid")
        return CorridorParams(arc, self.sagitta_m, self.width_m)


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
    """A region with everything about it that outputs tell."""

    region: Region
    frame: Frame
    source: ElevationSource
    soil: SoilReport | None
    soil_source: Source | None
    notes: tuple[str, ...]
    is_whole: bool


def plan_route(
    terrain: TerrainRequest,
    start: tuple[float, float],
    goal: tuple[float, float],
    settings: Settings,
    out: Path,
    *,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Plan a route, write its folder and return its summary. ``start`` and ``goal`` are in ``terrain.points_crs``.

    Raises:
        SwatheError: the inputs cannot be used, the folder cannot be written, or the user stopped. A negative answer is
            no error: the summary's ``status`` tells.
    """
    watch = Stopwatch()
    with run_folder(out) as folder:
        vehicle = load_vehicle(settings.vehicle)
        with watch.step("open"):
            source = _open(terrain)
        with source:
            ends = [_place(source, point, terrain.points_crs) for point in (start, goal)]
            whole = bounded(source, terrain.bounds, terrain.points_crs)
            window = first_window(source, whole, ends)
            while True:
                is_whole = window == whole
                ground = _prepare(
                    source, terrain, window, vehicle, settings, is_whole=is_whole, watch=watch, on_progress=on_progress
                )
                with watch.step("plan"):
                    answer = planner.plan(
                        ground.region,
                        ends[0],
                        ends[1],
                        method=settings.method,
                        swarm=settings.swarm_params(),
                        corridor=settings.corridor_params(),
                        bridge=settings.bridge,
                        certify=settings.certify,
                        map_continues=not ground.is_whole,
                        on_progress=on_progress,
                    )
                if not _needs_more_map(answer, ground, settings):
                    break
                window = larger_window(window, whole)
            answer = _with_nests(answer, ground)
            summary = _plan_summary(ground, answer, settings, (start, goal), ends)
            _write(folder, out, ground, answer, summary, watch=watch, on_progress=on_progress)
    return summary


def find_nests(
    terrain: TerrainRequest,
    settings: Settings,
    out: Path,
    *,
    ends: tuple[tuple[float, float], tuple[float, float]] | None = None,
    compare: bool = False,
    seeds: int = 1,
    animate: bool = False,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Find the nests of the whole map (or of ``terrain.bounds``), write their folder and return the summary.

    With ``ends``, a start and a goal in ``terrain.points_crs``, only the swathe between them is searched. ``compare``
    runs swarm, exact pass and lazy A* side by side with so many ``seeds`` and adds ``comparison``, ``precision``,
    ``recall`` (cells of the exact nests that the swarm found) and ``recall_cores``. ``animate`` adds an animation of
    the swarm.
    """
    watch = Stopwatch()
    with run_folder(out) as folder:
        vehicle = load_vehicle(settings.vehicle)
        with watch.step("open"):
            source = _open(terrain)
        with source:
            window = bounded(source, terrain.bounds, terrain.points_crs)
            places = None
            if ends is not None:
                start, goal = (_place(source, point, terrain.points_crs) for point in ends)
                places = (start, goal)
            ground = _prepare(
                source, terrain, window, vehicle, settings, is_whole=True, watch=watch, on_progress=on_progress
            )
            params, corridor = settings.swarm_params(), settings.corridor_params()
            more: dict[str, Any] = {}
            with watch.step("nests"):
                if compare:
                    both = comparison.compare(
                        ground.region, params, corridor, ends=places, seeds=seeds, on_progress=on_progress
                    )
                    more = both.as_dict()
                    shown = both.by_swarm if settings.method == "swarm" else both.exact
                else:
                    shown, _ = comparison.find(
                        ground.region, settings.method, params, corridor, places, on_progress=on_progress
                    )
            summary = {
                **_summary("nests", ground, settings),
                "status": "done",
                "cells_evaluated": shown.cells_evaluated,
                "nest_count": shown.nests.count,
                "nest_cells": int(shown.nests.sizes.sum()),
                "largest_nest_cells": int(shown.nests.sizes.max(initial=0)),
                "swarm": None if shown.tally is None else _swarm_summary(shown.tally, settings),
                **more,
            }
            if animate:
                with watch.step("animate"):
                    from swathe.report import animation

                    # With two ends the planner has sent the agents; here they search its swathe by themselves.
                    ticks = None if shown.tally is None or places else shown.tally.ticks
                    searched = shown.inside(ground.region)
                    names = ", ".join(source.names)
                    animation.animate(folder, ground.region, params, searched, ticks=ticks, source=names)
            _write(folder, out, ground, shown.nests, summary, watch=watch, on_progress=on_progress)
    return summary


def prepare_ground(terrain: TerrainRequest, settings: Settings, *, on_progress: OnProgress | None = None) -> Ground:
    """Read the whole map (or ``terrain.bounds``) and make a region of it, for pictures of it.

    Raises:
        SwatheError: the inputs cannot be used, or the user stopped.
    """
    watch = Stopwatch()
    vehicle = load_vehicle(settings.vehicle)
    with _open(terrain) as source:
        window = bounded(source, terrain.bounds, terrain.points_crs)
        return _prepare(source, terrain, window, vehicle, settings, is_whole=True, watch=watch, on_progress=on_progress)


def shared_summary(command: str, ground: Ground, settings: Settings) -> dict[str, Any]:
    """Return the part of a summary that every command shares."""
    return _summary(command, ground, settings)


def use_threads(threads: int | None) -> None:
    """Set the number of threads of the core, before its first work. The result does not depend on it.

    Raises:
        InvalidParameterError: the number is not at least one.
    """
    if threads is None:
        return
    if threads < 1:
        raise InvalidParameterError(f"{threads} threads cannot work.", "Give at least 1, or leave it out.")
    os.environ["RAYON_NUM_THREADS"] = str(threads)


def _open(terrain: TerrainRequest) -> ElevationSource:
    return open_elevation(
        terrain.dem,
        cell_size_m=terrain.cell_size_m,
        crs=terrain.crs,
        height_range_m=terrain.height_range_m,
    )


def _place(source: ElevationSource, point: tuple[float, float], points_crs: str | None) -> Position:
    return source.frame.from_points(point[0], point[1], points_crs, source.source_crs_wkt)


def _with_nests(answer: Plan, ground: Ground) -> Plan:
    """Return the answer with the nests of all that was read, when it was refused before any were looked for."""
    if answer.nests is not None:
        return answer
    ranks = rank.rank_map(ground.region)
    return replace(answer, nests=nesting.exact_nests(ranks.rank, rank_min=ground.region.params.rank_min))


def _needs_more_map(answer: Plan, ground: Ground, settings: Settings) -> bool:
    if ground.is_whole:
        return False
    return answer.status == "no_route" or (answer.route is not None and settings.certify and not answer.optimal)


def _prepare(
    source: ElevationSource,
    terrain: TerrainRequest,
    window: Window,
    vehicle: Vehicle,
    settings: Settings,
    *,
    is_whole: bool,
    watch: Stopwatch,
    on_progress: OnProgress | None,
) -> Ground:
    """Read a window of the ground and make a region of it."""
    frame = source.frame.window(window)
    require_memory(window, frame.geometry.cell_size_m, source.names, terrain.memory_limit_bytes)
    with watch.step("read"):
        report = None if on_progress is None else (lambda done, total: on_progress("reading elevation", done, total))
        elevation_m = source.read(window, report)
    if is_whole:
        require_known(elevation_m, ", ".join(source.names))
    notes: list[str] = []
    grey = None
    if settings.follows_paper:
        frame, elevation_m, grey, more = _averaged(
            frame, elevation_m, terrain.height_range_m if source.grey else None, vehicle
        )
        notes.append(f"Profile {settings.rank.profile}: heights averaged by groups of 8 x 8 pixels, as in the paper.")
        notes += more
    soil_report = codes = None
    if terrain.soil is not None:
        with watch.step("soil"):
            layer = read_soil(terrain.soil, frame, field=terrain.soil_field, legend=terrain.soil_legend)
        soil_report, codes = layer.report, layer.codes
    region = Region(frame.geometry, elevation_m, vehicle, codes, grey, None, settings.rank)
    notes += _notes(region, source, soil_report)
    soil_source = None if terrain.soil is None else single(terrain.soil)
    return Ground(region, frame, source, soil_report, soil_source, tuple(notes), is_whole)


def _averaged(
    frame: Frame, elevation_m: NDArray[np.float32], grey_range_m: tuple[float, float] | None, vehicle: Vehicle
) -> tuple[Frame, NDArray[np.float32], NDArray[np.float32], list[str]]:
    """Average the map by groups of 8 x 8 pixels, as the paper does; heights and grey levels alike."""
    geometry = frame.geometry
    rows, columns = geometry.rows // _PAPER_GROUP, geometry.columns // _PAPER_GROUP
    if min(rows, columns) < _FEWEST_GROUPS:
        raise TooSmallError(
            f"The paper's groups of 8 x 8 cells make {rows} x {columns} of {geometry.rows} x {geometry.columns} cells.",
            "At least 3 x 3 are needed: use a larger map, a smaller `--cell-size` or `--profile metric`.",
        )
    levels = height_map(elevation_m, grey_range_m)
    grey, heights = group_mean(levels), group_mean(elevation_m)
    coarse = GridGeometry(rows, columns, geometry.cell_size_m * _PAPER_GROUP, geometry.west_m, geometry.north_m)
    notes = []
    steepest = block_max(slope(elevation_m, geometry.cell_size_m))
    known = steepest[np.isfinite(steepest)]
    hidden = float(np.mean(known > vehicle.max_grade)) if known.size else 0.0
    if hidden > 0:
        notes.append(f"{100 * hidden:.0f} % of the averaged cells hold ground steeper than the vehicle's limit.")
    return replace(frame, geometry=coarse), heights, grey, notes


def _notes(region: Region, source: ElevationSource, soil: SoilReport | None) -> list[str]:
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


def _summary(command: str, ground: Ground, settings: Settings) -> dict[str, Any]:
    """Return the part of the summary that every command shares."""
    geometry = ground.region.geometry
    soil = None if ground.soil is None else ground.soil.as_dict()
    vehicle = ground.region.vehicle
    return {
        "command": command,
        "version": swathe.__version__,
        "cells_total": geometry.cell_count,
        "method": settings.method,
        "profile": settings.rank.profile,
        "vehicle": vehicle.name,
        "vehicle_figures": vehicle.as_dict()["figures"],
        "seed": settings.seed,
        "rank_params": rank.as_dict(settings.rank),
        "soil": soil,
        "crs": ground.frame.name,
        "cell_size_m": geometry.cell_size_m,
        "rows": geometry.rows,
        "columns": geometry.columns,
        "inputs": _inputs(ground),
        "notes": list(ground.notes),
    }


def _inputs(ground: Ground) -> list[dict[str, str]]:
    inputs = [{"name": name, "sha256": digest} for name, digest in ground.source.fingerprint().items()]
    if ground.soil_source is not None:
        inputs.append({"name": ground.soil_source.name, "sha256": ground.soil_source.fingerprint()})
    return inputs


def _swarm_summary(tally: swarm.Tally, settings: Settings) -> dict[str, Any]:
    params = settings.swarm_params()
    return {
        "agents": params.agents,
        "pellet_max": params.pellet_max,
        "rank_min": params.nest.rank_min,
        "ticks": tally.ticks,
        "visits": tally.visits,
        "cores": tally.cores,
        "connected_at": tally.connected_at,
    }


def _plan_summary(
    ground: Ground,
    answer: Plan,
    settings: Settings,
    asked: tuple[tuple[float, float], tuple[float, float]],
    ends: list[Position],
) -> dict[str, Any]:
    route = answer.route
    corridor = answer.corridor
    notes = list(ground.notes)
    for name, moved in (("start", answer.start), ("goal", answer.goal)):
        if moved is not None and moved[1] > 0:
            notes.append(f"The {name} was moved {moved[1]:.0f} m to the nearest safe ground.")
    if corridor is not None and corridor.widened:
        times = "once" if corridor.widened == 1 else f"{corridor.widened} times"
        notes.append(f"The swathe was widened {times}, to {corridor.width_m:.0f} m.")
    if not ground.is_whole:
        notes.append("Only the part of the map around start and goal was read.")
    return {
        **_summary("plan", ground, settings),
        "status": answer.status,
        "reason": answer.reason,
        "where": place.in_words(answer.place, ground.frame),
        "remedy": answer.remedy,
        "length_m": None if route is None else route.length_m,
        "straight_m": float(np.hypot(ends[0].x_m - ends[1].x_m, ends[0].y_m - ends[1].y_m)),
        "duration_s": None if route is None else route.time_s,
        "energy_j": None if route is None else route.energy_j,
        "climb_m": None if route is None else route.climb_m,
        "descent_m": None if route is None else route.descent_m,
        "max_grade": None if route is None else max(route.grade_max, -route.grade_min, 0.0),
        "max_side_slope": None if route is None else route.side_slope_max,
        "outside_nests_m": None if route is None else route.bridged_m,
        "cost": None if route is None else route.cost,
        "cost_lower_bound": answer.cost_lower_bound,
        "grid_cost": answer.path_cost,
        "optimal": answer.optimal,
        "cells_evaluated": answer.cells_evaluated,
        "nest_count": None if answer.nests is None else answer.nests.count,
        "start": place.end_of_route(asked[0], ends[0], answer.start, ground.frame),
        "goal": place.end_of_route(asked[1], ends[1], answer.goal, ground.frame),
        "swarm": None if answer.swarm is None else _swarm_summary(answer.swarm, settings),
        "corridor": None
        if corridor is None
        else {
            "arc": settings.corridor_params().arc,
            "width_m": corridor.width_m,
            "widened": corridor.widened,
            "sagitta_m": corridor.sagitta_m,
        },
        "notes": notes,
    }


def _write(
    folder: Path,
    out: Path,
    ground: Ground,
    found: Plan | nesting.Nests,
    summary: dict[str, Any],
    *,
    watch: Stopwatch,
    on_progress: OnProgress | None,
) -> None:
    """Write every file of a run into its staging folder, the summary last."""
    answer = found if isinstance(found, planner.Plan) else None
    nests = found if isinstance(found, nesting.Nests) else found.nests
    frame, region = ground.frame, ground.region
    origin = {key: summary[key] for key in ("version", "seed", "inputs")}
    tags = {
        "swathe_version": str(summary["version"]),
        "swathe_seed": str(summary["seed"]),
        "swathe_inputs": "; ".join(f"{given['name']} {given['sha256']}" for given in summary["inputs"]),
    }
    _tell(on_progress, "writing", 0, 5)
    if answer is not None:
        with watch.step("write_route"):
            write_text(folder / "route.geojson", to_json(route_collection(answer.route, frame, origin)))
    _tell(on_progress, "writing", 1, 5)
    with watch.step("write_maps"):
        outlines: list[nesting.Outline] = []
        if nests is not None:
            outlines = nesting.outlines(nests, region.geometry)
            gaps = nesting.nest_graph(nests, region.geometry)
            area_m2 = region.geometry.cell_size_m**2
            collection = nest_collection(nests, outlines, gaps, area_m2, frame=frame, origin=origin)
            write_text(folder / "nests.geojson", to_json(collection))
        ranks = rank.rank_map(region)
        write_raster(
            folder / "rank.tif",
            ranks.rank,
            frame,
            nodata=0,
            colours=rank_colour_table(),
            tags=tags,
            description="rank: 0 unknown, 1 no-go, 2 worst to 10 best",
        )
        _tell(on_progress, "writing", 2, 5)
        from swathe.report import run_pictures

        run_pictures.draw(folder, region, frame, ranks.rank, outlines, plan=answer, summary=summary, metadata=tags)
    _tell(on_progress, "writing", 4, 5)
    names = sorted({entry.name for entry in folder.iterdir()} | {SUMMARY, "report.html"})
    summary["outputs"] = {_output_key(name): name for name in names}
    summary["timings_s"] = {name: round(seconds, 4) for name, seconds in watch.seconds.items()}
    write_text(folder / SUMMARY, to_json(summary))
    from swathe.report.html import write_html

    write_html(folder)
    _tell(on_progress, "writing", 5, 5)
    # Callers get paths that they can open; the file holds names, so that the folder can be moved.
    summary["outputs"] = {name: str(out / path) for name, path in summary["outputs"].items()}


def _output_key(name: str) -> str:
    """Return the name of an output: that of its file without the ending, but for the two animations."""
    return {"animation.gif": "animation_gif", "animation.html": "animation_html"}.get(name, name.partition(".")[0])


def _tell(on_progress: OnProgress | None, stage: str, done: int, total: int) -> None:
    # Only False stops: a callback that returns nothing means "go on".
    if on_progress is not None and on_progress(stage, done, total) is False:
        raise InterruptedBySignalError("Writing was stopped.", "Nothing was written.")
