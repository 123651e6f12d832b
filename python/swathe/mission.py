"""The use cases: prepare a region, plan a route, find nests, and leave a complete folder.

``cli`` calls these and holds no logic of its own. Steps stand in the order in which they happen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe import comparison, planner, rank
from swathe import nest as nesting
from swathe.config import require_swarm
from swathe.errors import InterruptedBySignalError, UnreadableFileError, UsageError
from swathe.export.folder import SUMMARY, run_folder, to_json, write_text
from swathe.export.geojson import drivable_collection, nest_collection, route_collection
from swathe.io.lazy import TRIES, tiles_under
from swathe.io.raster import write_raster
from swathe.io.window import bounded, first_window, larger_window, nearest_cell
from swathe.preparation import Stopwatch, as_read, lazy_elevation, open_source, place_of, prepare
from swathe.report.animation import MOST_FRAMES, frame_step
from swathe.report.palette import rank_colour_table
from swathe.summary import plan_summary, shared_summary, stop_notes, stop_summary, swarm_summary
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from swathe.config import Settings, TerrainRequest
    from swathe.grid import Position, Window
    from swathe.io.lazy import LazyElevation
    from swathe.planner import Plan
    from swathe.preparation import Ground

    OnProgress = Callable[[str, int, int], bool]


def plan_route(
    terrain: TerrainRequest,
    start: tuple[float, float],
    goal: tuple[float, float],
    settings: Settings,
    out: Path,
    *,
    animate: bool = False,
    keep_as: str | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Plan a route, write its folder and return its summary. ``start`` and ``goal`` are in ``terrain.points_crs``.

    ``animate`` adds an animation of the swarm and its arc. With ``keep_as``, the name of an author, what was found is
    filed in the store that the ground came from.

    Raises:
        SwatheError: the inputs cannot be used, the folder cannot be written, or the user stopped. A negative answer is
            no error: the summary's ``status`` tells.
        UnreadableFileError: a part of a map that is read when it is needed cannot be read, and no route is known. The
            folder with the nests found so far and the summary, of status ``error``, is there all the same.
    """
    watch = Stopwatch()
    require_swarm(settings, animate=animate)
    if keep_as is not None and terrain.store is None:
        raise UsageError("Only a plan on a store's ground can be kept in it.", "Give `--store` and `--region`.")
    stop = settings.stop
    headings_rad = settings.headings_rad()
    with run_folder(out) as folder:
        vehicle = load_vehicle(settings.vehicle)
        with watch.step("open"):
            source = open_source(terrain)
        with source:
            ends = [place_of(source, point, terrain.points_crs) for point in (start, goal)]
            whole = bounded(source, terrain.bounds, terrain.points_crs)
            # An animation shows all of its map.
            lazy = None if animate else lazy_elevation(source, terrain, whole, settings, on_progress)
            window = first_window(source, whole, ends, lazy=lazy is not None)
            while True:
                is_whole = window == whole
                ground = prepare(
                    source,
                    terrain,
                    window,
                    vehicle,
                    settings,
                    is_whole=is_whole,
                    watch=watch,
                    on_progress=on_progress,
                    lazy=lazy,
                )
                before = watch.seconds.get("plan", 0.0)
                with watch.step("plan"):
                    answer = planner.plan(
                        ground.planned,
                        ends[0],
                        ends[1],
                        method=settings.method,
                        swarm=settings.swarm_params(),
                        corridor=settings.corridor_params(),
                        path=settings.path,
                        start_heading_rad=headings_rad[0],
                        goal_heading_rad=headings_rad[1],
                        bridge=settings.bridge,
                        certify=settings.certify,
                        stop=stop,
                        map_continues=not ground.is_whole,
                        objective=settings.objective,
                        cost=ground.cost,
                        frames=MOST_FRAMES if animate else 0,
                        frame_step=frame_step(ground.planned.geometry),
                        on_progress=on_progress,
                    )
                if not _needs_more_map(answer, ground, settings):
                    break
                window = larger_window(window, whole)
                if answer.swarm is not None:
                    stop = stop.after(
                        replace(answer.swarm, cells_evaluated=answer.cells_evaluated), watch.seconds["plan"] - before
                    )
            shown, answer = _as_shown(ground, window, lazy, answer, ends[0])
            tiles = (tiles_under(window) if lazy is None else lazy.tiles_read, tiles_under(whole))
            is_lazy = lazy is not None
            summary = plan_summary(ground, answer, settings, (start, goal), ends, tiles=tiles, is_lazy=is_lazy)
            unread = _unread(lazy, answer, summary, out)
            if unread is not None:
                _write_unread(folder, out, shown, answer, summary, watch=watch)
            else:
                if animate and answer.frames:
                    _animate(folder, ground, answer, settings, (ends[0], ends[1]), watch=watch)
                _write(folder, out, shown, answer, summary, watch=watch, on_progress=on_progress)
                if keep_as is not None:
                    _keep(shown, answer, summary, keep_as)
    if unread is not None:
        raise unread
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
    the swarm, with ``ends`` of the planner's swarm and its arc.
    """
    watch = Stopwatch()
    require_swarm(settings, animate=False, compare=compare)
    with run_folder(out) as folder:
        vehicle = load_vehicle(settings.vehicle)
        with watch.step("open"):
            source = open_source(terrain)
        with source:
            window = bounded(source, terrain.bounds, terrain.points_crs)
            places = None
            if ends is not None:
                start, goal = (place_of(source, point, terrain.points_crs) for point in ends)
                places = (start, goal)
            ground = prepare(
                source, terrain, window, vehicle, settings, is_whole=True, watch=watch, on_progress=on_progress
            )
            params, corridor = settings.swarm_params(), settings.corridor_params()
            more: dict[str, Any] = {}
            with watch.step("nests"):
                if compare:
                    both = comparison.compare(
                        ground.region,
                        params,
                        corridor,
                        ends=places,
                        seeds=seeds,
                        stop=settings.stop,
                        on_progress=on_progress,
                    )
                    more = both.as_dict()
                    shown = both.by_swarm if settings.method == "swarm" else both.exact
                else:
                    shown, _ = comparison.find(
                        ground.region,
                        settings.method,
                        params,
                        corridor,
                        places,
                        stop=settings.stop,
                        on_progress=on_progress,
                    )
            summary = {
                **shared_summary("nests", ground, settings),
                "status": "done",
                "cells_evaluated": shown.cells_evaluated,
                **stop_summary(shown.stopped, settings, has_ends=places is not None),
                "nest_count": shown.nests.count,
                "nest_cells": int(shown.nests.sizes.sum()),
                "largest_nest_cells": int(shown.nests.sizes.max(initial=0)),
                "swarm": None if shown.tally is None else swarm_summary(shown.tally, settings),
                **more,
            }
            summary["notes"] += stop_notes(shown.stopped, settings)
            if animate:
                with watch.step("animate"):
                    from swathe.report import animation

                    names = ", ".join(source.names)
                    region, ticks = ground.region, None if shown.tally is None else shown.tally.ticks
                    if places is None:
                        animation.animate(folder, region, params, None, ticks=ticks, source=names)
                    else:
                        # The same swarm again, for as many ticks.
                        again = replace(settings.stop, max_ticks=ticks, max_seconds=None)
                        answer = planner.plan(
                            region,
                            *places,
                            swarm=params,
                            corridor=corridor,
                            stop=again,
                            frames=MOST_FRAMES,
                            frame_step=frame_step(region.geometry),
                        )
                        animation.animate_plan(folder, region, params, answer, places, source=names)
            _write(folder, out, ground, shown.nests, summary, watch=watch, on_progress=on_progress)
    return summary


def _as_shown(
    ground: Ground, window: Window, lazy: LazyElevation | None, answer: Plan, start: Position
) -> tuple[Ground, Plan]:
    """Return ground and answer as outputs show them."""
    shown = ground
    if lazy is not None:
        if lazy.tiles_read == 0:  # a point lies outside: the map is shown where it comes nearest
            lazy.read_at(nearest_cell(ground.source, start))
        shown, answer = as_read(ground, window, lazy, answer)
    return shown, _with_nests(answer, shown)


def _with_nests(answer: Plan, ground: Ground) -> Plan:
    """Return the answer with the nests of all that was read, when it was refused before any were looked for."""
    if answer.nests is not None:
        return answer
    ranks = _ranks(ground)
    return replace(answer, nests=nesting.exact_nests(ranks, rank_min=ground.region.params.rank_min))


def _needs_more_map(answer: Plan, ground: Ground, settings: Settings) -> bool:
    if ground.is_whole:
        return False
    if answer.stopped is not None and answer.stopped.by.startswith("max_"):
        return False
    return answer.status == "no_route" or (answer.route is not None and settings.certify and not answer.optimal)


def _ranks(ground: Ground) -> NDArray[np.uint8]:
    """Return the rank of every cell, 0 where too little was read to tell."""
    ranks = rank.rank_map(ground.region).rank
    return ranks if ground.trusted is None else np.where(ground.trusted, ranks, np.uint8(0))


def _animate(
    folder: Path, ground: Ground, answer: Plan, settings: Settings, ends: tuple[Position, Position], *, watch: Stopwatch
) -> None:
    """Write the animation of a plan."""
    from swathe.report import animation

    with watch.step("animate"):
        names = ", ".join(ground.source.names)
        animation.animate_plan(folder, ground.region, settings.swarm_params(), answer, ends, source=names)


def _keep(ground: Ground, answer: Plan, summary: dict[str, Any], author: str) -> None:
    """File what a plan found in the store that its ground came from."""
    from swathe.store.results import keep_map, keep_route
    from swathe.store.source import StoredElevation

    source = ground.source
    if not isinstance(source, StoredElevation):
        return
    store, region = source.store, source.region
    keep_map(store, region, ground.frame, "rank", _ranks(ground), summary=summary, author=author)
    if answer.nests is not None:
        labels = answer.nests.labels.astype(np.int32)
        keep_map(store, region, ground.frame, "nests", labels, summary=summary, author=author)
    if answer.route is not None and answer.route.legs:
        keep_route(store, region, answer.route.xy_m, summary, author)


def _unread(lazy: LazyElevation | None, answer: Plan, summary: dict[str, Any], out: Path) -> UnreadableFileError | None:
    """Return the error of a plan that could not read what it needed, its words put into the summary, or None."""
    if lazy is None or answer.status != "unread":
        return None
    why = "" if lazy.failure is None else lazy.failure.message
    remedy = "" if lazy.failure is None else lazy.failure.remedy
    place = ""
    if lazy.failed_window is not None:
        row, column, rows, columns = lazy.failed_window
        place = f" The tile of rows {row} to {row + rows - 1}, columns {column} to {column + columns - 1} was tried"
        place += f" {TRIES} times."
    error = UnreadableFileError(
        f"{why}{place} Until then {summary['cells_evaluated']:,} cells were evaluated and {summary['tiles_read']:,} of "
        f"{summary['tiles_total']:,} tiles read.",
        f"{remedy} The nests found so far are in {out}.",
    )
    summary |= {"status": "error", "kind": error.kind, "reason": error.message, "remedy": error.remedy}
    return error


def _write_unread(
    folder: Path, out: Path, ground: Ground, answer: Plan, summary: dict[str, Any], *, watch: Stopwatch
) -> None:
    """Write what is known when the ground could not be read: the nests, and the summary."""
    region = ground.region
    origin = {key: summary[key] for key in ("version", "seed", "inputs")}
    if answer.nests is not None:
        with watch.step("write_maps"):
            outlines = nesting.outlines(answer.nests, region.geometry)
            gaps = nesting.nest_graph(answer.nests, region.geometry)
            area_m2 = region.geometry.cell_size_m**2
            collection = nest_collection(answer.nests, outlines, gaps, area_m2, frame=ground.frame, origin=origin)
            write_text(folder / "nests.geojson", to_json(collection))
    _write_summary(folder, out, summary, watch, ())


def _write_summary(folder: Path, out: Path, summary: dict[str, Any], watch: Stopwatch, later: tuple[str, ...]) -> None:
    """Write the summary, which names every file of the folder and those that come ``later``."""
    names = sorted({entry.name for entry in folder.iterdir()} | {SUMMARY, *later})
    summary["outputs"] = {_output_key(name): name for name in names}
    summary["timings_s"] = {name: round(seconds, 4) for name, seconds in watch.seconds.items()}
    write_text(folder / SUMMARY, to_json(summary))
    # Callers get paths that they can open; the file holds names, so that the folder can be moved.
    summary["outputs"] = {name: str(out / path) for name, path in summary["outputs"].items()}


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
            if answer.drivable is not None:
                write_text(folder / "drivable.geojson", to_json(drivable_collection(answer.drivable, frame, origin)))
    _tell(on_progress, "writing", 1, 5)
    with watch.step("write_maps"):
        outlines: list[nesting.Outline] = []
        if nests is not None:
            outlines = nesting.outlines(nests, region.geometry)
            gaps = nesting.nest_graph(nests, region.geometry)
            area_m2 = region.geometry.cell_size_m**2
            collection = nest_collection(nests, outlines, gaps, area_m2, frame=frame, origin=origin)
            write_text(folder / "nests.geojson", to_json(collection))
        ranks = _ranks(ground)
        write_raster(
            folder / "rank.tif",
            ranks,
            frame,
            nodata=0,
            colours=rank_colour_table(),
            tags=tags,
            description="rank: 0 unknown, 1 no-go, 2 worst to 10 best",
        )
        _tell(on_progress, "writing", 2, 5)
        from swathe.report import run_pictures

        run_pictures.draw(folder, region, frame, ranks, outlines, plan=answer, summary=summary, metadata=tags)
    _tell(on_progress, "writing", 4, 5)
    _write_summary(folder, out, summary, watch, ("report.html",))
    from swathe.report.html import write_html

    write_html(folder)
    _tell(on_progress, "writing", 5, 5)


def _output_key(name: str) -> str:
    """Return the name of an output: that of its file without the ending, but for the two animations."""
    return {"animation.gif": "animation_gif", "animation.html": "animation_html"}.get(name, name.partition(".")[0])


def _tell(on_progress: OnProgress | None, stage: str, done: int, total: int) -> None:
    # Only False stops: a callback that returns nothing means "go on".
    if on_progress is not None and on_progress(stage, done, total) is False:
        raise InterruptedBySignalError("Writing was stopped.", "Nothing was written.")
