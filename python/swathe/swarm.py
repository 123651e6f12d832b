"""The termite swarm: agents drop pellets on suitable cells, full cells become cores of nests, touching nests merge.

Limits first: for a full static map the swarm does more work than the one pass of ``swathe.nest.exact_nests``, with
which it agrees cell for cell once it is finished. At every earlier time its nests lie inside the exact ones.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Window, as_codes
from swathe.nest import NestParams, Nests

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence
    from concurrent.futures import Executor, Future

    from numpy.typing import ArrayLike, NDArray

    from swathe.rank import Region, TiledRegion

#: Ticks that a swarm which can finish never needs.
UNTIL_FINISHED = 2**63


@dataclass(frozen=True, slots=True)
class SwarmParams:
    """How the swarm works.

    Attributes:
        agents: number of agents, 1 to 1,000,000 (the paper: 10).
        pellet_max: pellets that make a cell a focus, 1 to 255 (profile ``paper``: 3).
        nest: what a nest is.
        teleport: probability of a new deployment per tick, 0 to 1.
        attract: pull of pellets on the walk, at least 0.
        explore: ``walk``, ``uniform`` (a new deployment every tick) or ``permute`` (each cell once an epoch).
        seed: seed of every draw, 0 to 2**64 - 1; the same seed gives the same result for any number of threads.
    """

    agents: int = 1024
    pellet_max: int = 1
    nest: NestParams = NestParams()
    teleport: float = 0.05
    attract: float = 0.0
    explore: Literal["walk", "uniform", "permute"] = "walk"
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("number of agents", self.agents, 1, 1_000_000),
            ("pellet limit", self.pellet_max, 1, 255),
            ("seed", self.seed, 0, 2**64 - 1),
            ("lowest suitable rank", self.nest.rank_min, 2, 10),
        ):
            if not low <= value <= high:
                raise InvalidParameterError(f"The {name} of {value} is not usable.", f"Give {low} to {high}.")

    def core_arguments(self) -> dict[str, Any]:
        """Return the parameters as the flat dictionary that the core takes."""
        flat = asdict(self)
        nest = flat.pop("nest")
        return {**flat, **nest}


#: The rules that end a swarm.
Rule = Literal["good", "connected", "finished", "statistical"]


@dataclass(frozen=True, slots=True)
class StopParams:
    """When a swarm stops and what it may spend; nothing given is no limit, 0 is nothing at all.

    Attributes:
        rule: ``good`` (the route is good enough for what is known), ``connected`` (start and goal lie in one nest),
            ``finished`` (nothing more can be found) or ``statistical`` (so many visits to random cells in a row met no
            suitable cell that lacks pellets, that their share is below ``open_share`` with the confidence 1 -
            ``doubt``). None is the usual one: ``good`` for a plan with the re-laid arc, else ``finished``.
        open_share: above 0 and below 1.
        doubt: above 0 and below 1.
        max_ticks: most ticks.
        max_evaluations: most cells whose rank is asked for; never exceeded.
        max_seconds: most seconds of the swarm. Only this makes a result depend on the machine.
    """

    rule: Rule | None = None
    open_share: float = 1e-3
    doubt: float = 0.05
    max_ticks: int | None = None
    max_evaluations: int | None = None
    max_seconds: float | None = None

    def __post_init__(self) -> None:
        if self.rule not in (None, "good", "connected", "finished", "statistical"):
            raise InvalidParameterError(
                f"The stop rule {self.rule!r} is not known.", "Give good, connected, finished or statistical."
            )
        for name, share in (("share left open", self.open_share), ("doubt", self.doubt)):
            if not 0 < share < 1:
                raise InvalidParameterError(f"The {name} of {share} is not usable.", "Give a number between 0 and 1.")
        for name, most in (("ticks", self.max_ticks), ("evaluations", self.max_evaluations)):
            if most is not None and not 0 <= most < 2**63:
                raise InvalidParameterError(f"A budget of {most} {name} cannot be kept.", "Give 0 or more.")
        if self.max_seconds is not None and not self.max_seconds >= 0:
            raise InvalidParameterError(f"A budget of {self.max_seconds} seconds cannot be kept.", "Give 0 or more.")

    def after(self, spent: Tally, seconds: float) -> StopParams:
        """Return the same with what is left of the budgets."""

        def left(most: int | None, gone: int) -> int | None:
            return None if most is None else max(0, most - gone)

        return replace(
            self,
            max_ticks=left(self.max_ticks, spent.ticks),
            max_evaluations=left(self.max_evaluations, spent.cells_evaluated),
            max_seconds=None if self.max_seconds is None else max(0.0, self.max_seconds - seconds),
        )


@dataclass(frozen=True, slots=True)
class Stopped:
    """What ended the search for ground, and what it left unseen.

    Attributes:
        by: ``good``, ``connected``, ``finished``, ``statistical``, ``max_ticks``, ``max_evaluations``, ``max_seconds``
            or ``stopped``.
        unknown_cells: cells of the swathe that nobody has looked at.
        swathe_cells: cells of the swathe, which is the one around the route that was found, or all that was searched.
        quiet_visits: random visits in a row without news that end the search, where the rule is the statistical one.
    """

    by: str
    unknown_cells: int
    swathe_cells: int
    quiet_visits: int | None = None

    @property
    def unknown_share(self) -> float:
        """Share of the swathe that nobody has looked at."""
        return self.unknown_cells / self.swathe_cells if self.swathe_cells else 0.0


@dataclass(frozen=True, slots=True)
class Tally:
    """What a swarm has done.

    Attributes:
        ticks: ticks so far.
        visits: visits of agents to cells.
        cells_evaluated: cells whose rank was asked for, each once (by ``run_tiles`` each once a tile).
        cores: cores found.
        connected_at: tick in which start and goal came into one nest, if they did.
    """

    ticks: int
    visits: int
    cells_evaluated: int
    cores: int
    connected_at: int | None


class Transition(NamedTuple):
    """A step of the swarm's flow charts: its chart (``swarm`` or ``nest``), the states, and when it is taken."""

    chart: str
    from_state: str
    to_state: str
    when: str


def transitions() -> list[Transition]:
    """Return every transition that agents and nests make; the core's tests hold the swarm against this table."""
    return [Transition(*row) for row in _core.transitions()[0]]


def state_texts() -> dict[str, str]:
    """Return what each state of the flow charts says, in their order; questions end with a question mark."""
    return dict(_core.transitions()[1])


@dataclass(frozen=True, eq=False)
class Frame:
    """A swarm at one tick, in blocks of ``step`` x ``step`` cells.

    Attributes:
        tally: what the swarm has done so far.
        step: cells per side of a block.
        seen: (rows, columns) uint8: 0 outside the swathe, 1 not looked at, 2 not suitable, 3 suitable; a block shows
            the greatest of its cells.
        pellets: (rows, columns) uint8, the most pellets on a cell of the block.
        nests: (rows, columns) uint32, 0 or a name of the nest that changes only when nests merge.
        agents: (agents, 2) uint32, row and column of the agents' blocks.
        arc: (n, 2) map metres of the arc around which the agents are sent, None for a swarm by itself.
        is_route: whether the arc is a route through nests that is being improved.
    """

    tally: Tally
    step: int
    seen: NDArray[np.uint8]
    pellets: NDArray[np.uint8]
    nests: NDArray[np.uint32]
    agents: NDArray[np.uint32]
    arc: NDArray[np.float64] | None = None
    is_route: bool = False


@dataclass(frozen=True, eq=False)
class Swarm:
    """The nests that a swarm has built and how far it came.

    ``ending`` is ``finished``, ``statistical``, ``ticks_spent``, ``evaluations_spent``, ``seconds_spent`` or
    ``stopped``; ``stopped`` says what that left unseen (None for a swarm in tiles).
    """

    nests: Nests
    ending: str
    tally: Tally
    stopped: Stopped | None = None


def run_swarm(
    region: Region | TiledRegion,
    params: SwarmParams | None = None,
    *,
    inside: NDArray[np.bool_] | None = None,
    ticks: int | None = None,
    stop: StopParams | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    frame_every: int | Sequence[int] = 1,
    frame_step: int = 1,
) -> Swarm:
    """Run a swarm over a region until it is finished, ``ticks`` are over or ``on_progress`` returns False.

    ``inside`` limits it to a mask of cells, ``stop`` gives another rule and budgets. A walk without teleport may never
    finish: give it ``ticks``.

    ``on_frame`` is called with the first and the last state and every ``frame_every`` ticks (or at those ticks), in
    blocks of ``frame_step`` cells. Watching changes nothing about the swarm.

    Raises:
        UsageError: a parameter is outside its range or the mask does not fit.
    """
    params = params or SwarmParams(nest=NestParams(rank_min=region.params.rank_min))
    stop = stop or StopParams()
    if stop.rule in ("good", "connected"):
        raise InvalidParameterError(
            f"The stop rule {stop.rule} needs a start and a goal.", "Give both, or another rule."
        )
    mask = _mask(inside, region.geometry.shape)
    limit = _limit(ticks)
    every, at = (frame_every, []) if isinstance(frame_every, int) else (0, sorted(frame_every))
    if frame_step < 1 or (isinstance(frame_every, int) and frame_every < 1) or min(at, default=0) < 0:
        raise InvalidParameterError(
            f"Frames every {frame_every} ticks in blocks of {frame_step} cells cannot be taken.", "Give 1 or more."
        )
    view = None if on_frame is None else (lambda found: on_frame(frame_of(found)))
    found = _core.run_swarm(
        region.core, mask, params.core_arguments(), limit, asdict(stop), on_progress, view, every, at, frame_step
    )
    return _swarm(found, region.geometry.cell_count if mask is None else int(mask.sum()))


def run_swarm_on_ranks(
    rank: ArrayLike,
    params: SwarmParams | None = None,
    *,
    inside: NDArray[np.bool_] | None = None,
    ticks: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> Swarm:
    """Run a swarm over ranks that are known already, as ``swathe.nest.exact_nests`` takes them.

    Raises:
        UsageError: the ranks are not (rows, columns) of 0 to 10, a parameter is outside its range, or the mask does not
            fit.
    """
    array = as_codes(rank, "rank map")
    mask = _mask(inside, array.shape)
    arguments = (params or SwarmParams()).core_arguments()
    found = _core.run_swarm_on_ranks(array, mask, arguments, _limit(ticks), on_progress)
    return _swarm(found, array.size if mask is None else int(mask.sum()))


def _mask(inside: NDArray[np.bool_] | None, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    mask = None if inside is None else np.ascontiguousarray(inside, dtype=np.bool_)
    if mask is not None and mask.shape != shape:
        raise ShapeMismatchError(
            f"The mask has the shape {mask.shape} where the grid has {shape}.", "Give one value per cell."
        )
    return mask


def _swarm(found: dict[str, Any], cells: int) -> Swarm:
    nests = Nests(found["labels"], np.asarray(found["sizes"], dtype=np.uint32))
    done = tally(found)
    by = _BUDGETS.get(found["ending"], found["ending"])
    return Swarm(nests, found["ending"], done, Stopped(by, cells - done.cells_evaluated, cells, found["quiet_visits"]))


_BUDGETS = {
    "ticks_spent": "max_ticks",
    "evaluations_spent": "max_evaluations",
    "seconds_spent": "max_seconds",
}


def _limit(ticks: int | None) -> int:
    limit = UNTIL_FINISHED if ticks is None else ticks
    if not 0 <= limit <= UNTIL_FINISHED:
        raise InvalidParameterError(f"{ticks} ticks cannot be spent.", "Give 0 or more.")
    return limit


class _Tile(NamedTuple):
    """A tile's share of the work as it goes to a worker: the ground of its window and what to do there."""

    ground: Region
    window: Window
    map_shape: tuple[int, int]
    own: Window
    params: SwarmParams
    ticks: int
    threads: int | None

    def run(self) -> dict[str, Any]:
        """Run the swarm of the tile."""
        first = (self.window.row, self.window.column)
        arguments = self.params.core_arguments()
        return _core.run_tile(self.ground.core, first, self.map_shape, self.own, arguments, self.ticks, self.threads)


def run_tiles(
    region: Region,
    params: SwarmParams | None = None,
    *,
    tile_cells: int = 512,
    executor: Executor | None = None,
    ticks: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> Swarm:
    """Run a swarm of its own in every tile of a region and merge their nests along the seams.

    The nests of finished tiles are those of ``run_swarm`` and ``exact_nests``, whatever the size of tiles and whoever
    runs them. Each tile is sent with the ground of its window alone, so that workers need not hold the map.

    Args:
        region: the ground.
        params: how each tile's swarm works; tiles draw seeds of their own from its seed.
        tile_cells: cells along a side of a tile, at least 1; each tile looks at a rim as wide as the vicinity reaches.
        executor: threads or processes of ``concurrent.futures`` that run the tiles, each with one thread of the core;
            None runs tile after tile, with all threads in each.
        ticks: most ticks of each tile; None goes on until it is finished.
        on_progress: told the tiles done and in all; returns False to stop with the nests of the tiles that are done.

    Returns:
        The nests, how the tiles ended (``finished`` if all did) and the sum of their tallies; ``ticks`` is that of the
        tile that took longest.

    Raises:
        UsageError: a parameter is outside its range.
    """
    params = params or SwarmParams(nest=NestParams(rank_min=region.params.rank_min))
    if not 1 <= tile_cells <= 2**32:
        raise InvalidParameterError(f"Tiles of {tile_cells} cells cannot be laid.", "Give 1 to 4294967296.")
    limit = _limit(ticks)
    shape = region.geometry.shape
    jobs = _core.tile_jobs(shape, tile_cells, params.core_arguments())
    threads = None if executor is None else 1
    tiles = (
        _Tile(
            _part(region, Window(*window)),
            Window(*window),
            shape,
            Window(*own),
            replace(params, seed=seed),
            limit,
            threads,
        )
        for own, window, seed in jobs
    )
    results = (tile.run() for tile in tiles) if executor is None else _submitted(executor, tiles)
    done: list[dict[str, Any]] = []
    stopped = on_progress is not None and not on_progress("regions", 0, len(jobs))
    with closing(results):
        while not stopped and len(done) < len(jobs):
            done.append(next(results))
            stopped = on_progress is not None and not on_progress("regions", len(done), len(jobs))
    found = [(result["own"], result["window"], result["labels"]) for result in done]
    labels, sizes = _core.merge_tiles(shape, asdict(params.nest), found)
    endings = {str(result["ending"]) for result in done}
    ending = "stopped" if len(done) < len(jobs) else "ticks_spent" if "ticks_spent" in endings else "finished"
    return Swarm(Nests(labels, np.asarray(sizes, dtype=np.uint32)), ending, _total(done))


def _part(region: Region, window: Window) -> Region:
    """Return the ground of a window, fit to be sent to another process."""
    rows = slice(window.row, window.row + window.rows)
    columns = slice(window.column, window.column + window.columns)
    return replace(
        region,
        geometry=region.geometry.window(*window),
        elevation_m=region.elevation_m[rows, columns],
        # A copy without what the core has made of it.
        vehicle=type(region.vehicle).model_construct(**dict(region.vehicle)),
        soil=None if region.soil is None else region.soil[rows, columns],
        grey=None if region.grey is None else region.grey[rows, columns],
        zones=None if region.zones is None else region.zones[rows, columns],
    )


def _submitted(executor: Executor, tiles: Generator[_Tile, None, None]) -> Generator[dict[str, Any], None, None]:
    """Hand out all tiles and yield their results in order; what is not wanted any more is withdrawn."""
    waiting: list[Future[dict[str, Any]]] = []
    try:
        waiting.extend(executor.submit(tile.run) for tile in tiles)
        for future in waiting:
            yield future.result()
    finally:
        for future in waiting:
            future.cancel()


def _total(results: list[dict[str, Any]]) -> Tally:
    return Tally(
        ticks=max((result["ticks"] for result in results), default=0),
        visits=sum(result["visits"] for result in results),
        cells_evaluated=sum(result["cells_evaluated"] for result in results),
        cores=sum(result["cores"] for result in results),
        connected_at=None,
    )


def tally(found: dict[str, Any]) -> Tally:
    """Return the tally out of the core's answer."""
    names = ("ticks", "visits", "cells_evaluated", "cores", "connected_at")
    return Tally(**{name: found[name] for name in names})


def frame_of(found: dict[str, Any]) -> Frame:
    """Return the frame out of the core's answer."""
    arc = np.asarray(found["arc"], dtype=np.float64).reshape(-1, 2) if "arc" in found else None
    layers = {name: found[name] for name in ("step", "seen", "pellets", "nests", "agents")}
    return Frame(tally(found), **layers, arc=arc, is_route=found.get("is_route", False))
