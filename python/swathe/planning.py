"""The search for a route on a map of any size: over a window that grows until the answer is one of the whole map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from swathe import nest as nesting
from swathe import planner, rank
from swathe.io.lazy import tiles_under
from swathe.io.window import bounded, first_window, larger_window, nearest_cell
from swathe.preparation import as_read, lazy_elevation, place_of, prepare
from swathe.report.animation import frame_step

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.config import Settings, TerrainRequest
    from swathe.grid import Position, Window
    from swathe.io.elevation import ElevationSource
    from swathe.io.lazy import LazyElevation
    from swathe.planner import Plan
    from swathe.preparation import Ground, Stopwatch
    from swathe.vehicle import Vehicle

    OnProgress = Callable[[str, int, int], bool]


@dataclass(frozen=True, eq=False)
class Found:
    """What a search came to.

    Attributes:
        planned: the ground that was searched.
        shown: the same as outputs show it: of a map that is read where it is needed, what was read.
        answer: the planner's, on ``shown``.
        ends: start and goal in the frame.
        lazy: the elevation that is read where it is needed, or None.
        tiles: tiles that were read, and tiles of the whole map.
    """

    planned: Ground
    shown: Ground
    answer: Plan
    ends: tuple[Position, Position]
    lazy: LazyElevation | None
    tiles: tuple[int, int]


def search(
    source: ElevationSource,
    terrain: TerrainRequest,
    points: tuple[tuple[float, float], tuple[float, float]],
    settings: Settings,
    vehicle: Vehicle,
    *,
    watch: Stopwatch,
    lazily: bool,
    frames: int = 0,
    on_progress: OnProgress | None = None,
) -> Found:
    """Plan between two points in ``terrain.points_crs``; ``lazily`` lets large maps be read where the swarm looks.

    ``frames`` is the number of pictures of the swarm that the answer holds.

    Raises:
        SwatheError: the inputs cannot be used, or the user stopped.
    """
    stop = settings.stop
    headings_rad = settings.headings_rad()
    start, goal = (place_of(source, point, terrain.points_crs) for point in points)
    ends = (start, goal)
    whole = bounded(source, terrain.bounds, terrain.points_crs)
    lazy = lazy_elevation(source, terrain, whole, settings, on_progress) if lazily else None
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
                start,
                goal,
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
                frames=frames,
                frame_step=frame_step(ground.planned.geometry) if frames else 1,
                on_progress=on_progress,
            )
        if not _needs_more_map(answer, ground, settings):
            break
        window = larger_window(window, whole)
        if answer.swarm is not None:
            stop = stop.after(
                replace(answer.swarm, cells_evaluated=answer.cells_evaluated), watch.seconds["plan"] - before
            )
    shown, answer = _as_shown(ground, window, lazy, answer, start)
    tiles = (tiles_under(window) if lazy is None else lazy.tiles_read, tiles_under(whole))
    return Found(ground, shown, answer, ends, lazy, tiles)


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
    ranks = ranks_of(ground)
    return replace(answer, nests=nesting.exact_nests(ranks, rank_min=ground.region.params.rank_min))


def _needs_more_map(answer: Plan, ground: Ground, settings: Settings) -> bool:
    if ground.is_whole:
        return False
    if answer.stopped is not None and answer.stopped.by.startswith("max_"):
        return False
    return answer.status == "no_route" or (answer.route is not None and settings.certify and not answer.optimal)


def ranks_of(ground: Ground) -> NDArray[np.uint8]:
    """Return the rank of every cell, 0 where too little was read to tell."""
    ranks = rank.rank_map(ground.region).rank
    return ranks if ground.trusted is None else np.where(ground.trusted, ranks, np.uint8(0))
