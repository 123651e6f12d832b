"""The use cases: prepare a region, plan a route, find nests, and leave a complete folder.

``cli`` calls these and holds no logic of its own. Steps stand in the order in which they happen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe import comparison, planner
from swathe.config import require_swarm
from swathe.errors import UsageError
from swathe.export.folder import run_folder
from swathe.io.window import bounded
from swathe.outputs import unread_error, write, write_unread
from swathe.planning import ranks_of, search
from swathe.preparation import Stopwatch, open_source, place_of, prepare
from swathe.report.animation import MOST_FRAMES, frame_step
from swathe.scenario import request_of
from swathe.summary import plan_summary, shared_summary, stop_notes, stop_summary, swarm_summary
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from swathe.config import Settings, TerrainRequest
    from swathe.grid import Position
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
    with run_folder(out) as folder:
        vehicle = load_vehicle(settings.vehicle)
        with watch.step("open"):
            source = open_source(terrain)
        with source:
            found = search(
                source,
                terrain,
                (start, goal),
                settings,
                vehicle,
                watch=watch,
                # An animation shows all of its map.
                lazily=not animate,
                frames=MOST_FRAMES if animate else 0,
                on_progress=on_progress,
            )
            ground, answer, ends = found.shown, found.answer, found.ends
            summary = plan_summary(found, settings, (start, goal))
            summary["request"] = request_of(terrain, settings, (start, goal))
            unread = unread_error(found.lazy, answer, summary, out)
            if unread is not None:
                write_unread(folder, out, ground, answer, summary, watch=watch)
            else:
                if animate and answer.frames:
                    _animate(folder, ground, answer, settings, ends, watch=watch)
                write(folder, out, ground, answer, summary, watch=watch, on_progress=on_progress)
                if keep_as is not None:
                    _keep(ground, answer, summary, keep_as)
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
            write(folder, out, ground, shown.nests, summary, watch=watch, on_progress=on_progress)
    return summary


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
    keep_map(store, region, ground.frame, "rank", ranks_of(ground), summary=summary, author=author)
    if answer.nests is not None:
        labels = answer.nests.labels.astype(np.int32)
        keep_map(store, region, ground.frame, "nests", labels, summary=summary, author=author)
    if answer.route is not None and answer.route.legs:
        keep_route(store, region, answer.route.xy_m, summary, author)
