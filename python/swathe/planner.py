"""From nests to a route: search, shortcuts, certificate, and reasons when there is no way."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.corridor import Corridor, CorridorParams
from swathe.drivable import DrivablePath, wrapped
from swathe.errors import InvalidParameterError
from swathe.grid import Cell, Position
from swathe.nest import NestParams, Nests
from swathe.objective import Objective, as_objective, closed_where, cost_factor
from swathe.rank import Region
from swathe.repair import RepairTally, Replanner
from swathe.swarm import Frame, StopParams, Stopped, SwarmParams, Tally, frame_of, tally
from swathe.ways import (
    AnyAnglePath,
    NoRoute,
    Path,
    Status,
    any_angle_path,
    as_cell,
    cost_field,
    eikonal_field,
    shortest_path,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike, NDArray

    from swathe.objective import CostFunction, Word
    from swathe.rank import TiledRegion

__all__ = [
    "AnyAnglePath",
    "LazySearch",
    "Leg",
    "NoRoute",
    "Path",
    "PathKind",
    "Plan",
    "RepairTally",
    "Replanner",
    "Route",
    "Status",
    "any_angle_path",
    "cost_field",
    "eikonal_field",
    "lazy_astar",
    "plan",
    "shortest_path",
]

PathKind = Literal["auto", "grid8", "grid16", "any-angle", "drivable"]


#: Why no way leads from one open cell to another.


#: Kinds of number that the core reads where they are.


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight part of a route. Grades are rise over run; ``grade_min`` is the steepest way down.

    ``cost`` is the objective's sum in seconds; ``risk_s`` its seconds beside no-go ground, weighted by the nearness.
    """

    start: Position
    end: Position
    length_m: float
    time_s: float
    cost: float
    energy_j: float
    risk_s: float
    climb_m: float
    descent_m: float
    grade_max: float
    grade_min: float
    side_slope_max: float
    bridged_m: float
    soil: str
    rank_min: int
    reason: str

    @property
    def speed_mps(self) -> float:
        """Mean speed."""
        return self.length_m / self.time_s


@dataclass(frozen=True, slots=True)
class Route:
    """A way that the vehicle can drive: its legs in order, none when start and goal are the same place."""

    legs: tuple[Leg, ...]
    length_m: float
    time_s: float
    cost: float
    energy_j: float
    risk_s: float
    climb_m: float
    descent_m: float
    grade_max: float
    grade_min: float
    side_slope_max: float
    bridged_m: float

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """The vertices, (n, 2) map metres."""
        points = [leg.start for leg in self.legs[:1]] + [leg.end for leg in self.legs]
        return np.asarray(points, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Plan:
    """The planner's answer.

    Attributes:
        status: ``route_found`` or the kind of refusal; ``unread`` says that heights which were needed could not be
            read, and nothing of whether a way exists.
        route: the route, None in a refusal.
        reason: why there is none, in one sentence.
        place: where.
        remedy: the nearest thing that would change it.
        drivable: the arcs that follow the route within the vehicle's turning radius, where they were asked for.
        path: cells of the way over the grid, before shortcuts and refinement.
        path_cost: its cost in seconds, weighted by the objective.
        cost_lower_bound: no way from start to goal costs less.
        optimal: whether the way is known to be the best of the whole map.
        start: where the route starts and how far that is from the place asked for, in metres.
        goal: the same for the goal.
        nests: the nests that were found.
        corridor: arc and swathe (swarm only).
        swarm: what the swarm did (swarm only).
        cells_evaluated: cells whose rank was asked for.
        is_complete: False when heights that were wanted could not be read: a better route may lie there.
        stopped: what ended the search for ground and what it left unseen (swarm only).
        frames: pictures of the swarm at work and its arc, as many as were asked for at most.
    """

    status: Status
    route: Route | None
    reason: str | None
    place: Position | None
    remedy: str | None
    drivable: DrivablePath | None
    path: list[Cell]
    path_cost: float | None
    cost_lower_bound: float | None
    optimal: bool
    start: tuple[Position, float] | None
    goal: tuple[Position, float] | None
    nests: Nests | None
    corridor: Corridor | None
    swarm: Tally | None
    cells_evaluated: int
    is_complete: bool = True
    stopped: Stopped | None = None
    frames: tuple[Frame, ...] = ()


def plan(
    region: Region | TiledRegion,
    start: Position,
    goal: Position,
    *,
    method: Literal["swarm", "exact"] = "swarm",
    swarm: SwarmParams | None = None,
    corridor: CorridorParams | None = None,
    path: PathKind = "auto",
    start_heading_rad: float | None = None,
    goal_heading_rad: float | None = None,
    bridge: bool = False,
    certify: bool = False,
    stop: StopParams | None = None,
    map_continues: bool = False,
    objective: Objective | Word | str | Mapping[str, float] = "time",
    cost: ArrayLike | CostFunction | None = None,
    reverse: bool = False,
    frames: int = 0,
    frame_step: int = 1,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> Plan:
    """Plan a route over a region.

    Args:
        region: the ground, the vehicle and the rules. Of a ``TiledRegion`` the swarm with a re-laid arc reads what it
            comes to look at; everything else reads all of it first.
        start: where the vehicle is, in the map frame.
        goal: where it should go.
        method: ``swarm`` in a swathe around an arc, or ``exact`` over the whole map.
        swarm: the swarm's parameters; its nest parameters hold for ``exact`` too.
        corridor: arc and width of the swathe.
        path: what the route is made of. ``grid8``: steps to 8 neighbours as they are; ``grid16``: steps to 16
            neighbours, then shortcuts; ``any-angle``: straight segments whose vertices lie anywhere; ``drivable``: as
            ``grid16``, then followed by arcs within the vehicle's turning radius (``Plan.drivable``); ``auto``:
            ``drivable`` for a vehicle that cannot turn in place where its radius spans a cell, else ``grid16``.
        start_heading_rad: where the nose points at the start of a drivable path, counter-clockwise from east; free when
            None.
        goal_heading_rad: the same at the goal.
        bridge: whether suitable ground outside nests may be crossed, at three times the cost, when nothing else does.
        certify: whether the swathe is widened until the way is known to be the best of the whole map.
        stop: when the swarm stops and what it may spend. Stopped early, it answers with the route that is known by
            then, or a refusal that does not claim that there is none.
        map_continues: whether there is more map beyond the region, which limits what can be certified.
        objective: what the way should save: ``time``, ``energy``, ``risk``, or weights (``swathe.objective``). The
            vehicle's limits hold under every objective.
        cost: the user's factor on the cost of each cell, at least 0, closed where it is NaN or infinite: an array of
            the region's shape or a function of blocks (``swathe.objective.cost_factor``).
        reverse: charge every step, and hold its limits, as if it were driven the other way: the way from A to B then
            costs what the way from B to A costs without.
        frames: most pictures to take of the swarm, 0 or at least 2, which changes nothing about it.
        frame_step: cells per side of a picture's blocks.
        on_progress: called with stage, work done and work expected; returning False stops with an error.

    Raises:
        UsageError: a parameter is outside its range.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    swarm = swarm or SwarmParams(nest=NestParams(rank_min=region.params.rank_min))
    corridor = corridor or CorridorParams()
    if frames < 0 or frame_step < 1:
        raise InvalidParameterError(
            f"{frames} frames in blocks of {frame_step} cells cannot be taken.", "Give 0 or more, and 1 or more."
        )
    request = {
        **asdict(stop or StopParams()),
        "frames": frames,
        "frame_step": frame_step,
        **swarm.core_arguments(),
        "start": tuple(start),
        "goal": tuple(goal),
        "method": method,
        "arc": corridor.arc,
        "sagitta_m": corridor.sagitta_m,
        "width_m": corridor.width_m,
        "path": path,
        "start_heading_rad": start_heading_rad,
        "goal_heading_rad": goal_heading_rad,
        "bridge": bridge,
        "certify": certify,
        "objective": as_objective(objective).core_argument(),
        "reversed": reverse,
    }
    factor = None
    if cost is not None:
        if not isinstance(region, Region):
            raise InvalidParameterError(
                "Costs of your own close cells before any is looked at.", "Give a region that was read at once."
            )
        factor = cost_factor(region, cost)
        region = closed_where(region, factor)
    return _plan(_core.plan(region.core, request, factor, map_continues, on_progress))


@dataclass(frozen=True, slots=True)
class LazySearch:
    """What lazy A* found.

    Attributes:
        cells: the way from start to goal, None when there is none.
        cost: its cost in seconds.
        cells_evaluated: cells whose rank was asked for, each once.
        cells_expanded: cells expanded.
    """

    cells: list[Cell] | None
    cost: float | None
    cells_evaluated: int
    cells_expanded: int


def lazy_astar(
    region: Region,
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    nest: NestParams | None = None,
    weight: float = 1.0,
    objective: Objective | Word | str | Mapping[str, float] = "time",
    cost: ArrayLike | CostFunction | None = None,
    reverse: bool = False,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> LazySearch:
    """Find a cheapest way through the nests of the whole map, ranking cells only where it comes to expand them.

    The honest peer of the swarm: with ``weight`` 1 the cost is the least there is, with weight w at most w times that.
    ``start`` and ``goal`` are (row, column) of cells in nests; elsewhere there is no way. ``objective``, ``cost`` and
    ``reverse`` are those of ``plan``.

    Raises:
        UsageError: a cell lies outside, or a parameter is outside its range.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    first, last = as_cell(start, region.geometry.shape), as_cell(goal, region.geometry.shape)
    nest = nest or NestParams(rank_min=region.params.rank_min)
    request = {"objective": as_objective(objective).core_argument(), "reversed": reverse}
    factor = None if cost is None else cost_factor(region, cost)
    region = closed_where(region, factor)
    found = _core.lazy_astar(region.core, first, last, asdict(nest), weight, request, factor, on_progress)
    cells = None if found["cells"] is None else [Cell(*cell) for cell in found["cells"]]
    return LazySearch(cells, found["cost"], found["cells_evaluated"], found["cells_expanded"])


def _plan(found: dict[str, Any]) -> Plan:
    route = _route(found["total"], found["legs"]) if found["status"] == "route_found" else None
    nests = corridor = None
    if "labels" in found:
        nests = Nests(found["labels"], np.asarray(found["sizes"], dtype=np.uint32))
    if "arc" in found:
        arc = np.asarray(found["arc"], dtype=np.float64)
        corridor = Corridor(arc, found["width_m"], found["sagitta_m"], found["widened"])
    place = found.get("place")
    return Plan(
        status=found["status"],
        route=route,
        reason=found.get("reason"),
        place=None if place is None else Position(*place),
        remedy=found.get("remedy"),
        drivable=wrapped(found["drivable"]) if "drivable" in found else None,
        path=[Cell(*cell) for cell in found["path"]],
        path_cost=found["path_cost"],
        cost_lower_bound=found["cost_lower_bound"],
        optimal=found["optimal"],
        start=_end(found["start"]),
        goal=_end(found["goal"]),
        nests=nests,
        corridor=corridor,
        swarm=tally(found["swarm"]) if "swarm" in found else None,
        cells_evaluated=found["cells_evaluated"],
        is_complete=found["is_complete"],
        stopped=Stopped(*found["stopped"]) if "stopped" in found else None,
        frames=tuple(frame_of(frame) for frame in found["frames"]),
    )


def _end(found: tuple[tuple[float, float], float] | None) -> tuple[Position, float] | None:
    return None if found is None else (Position(*found[0]), found[1])


_SUMS = (
    "length_m",
    "time_s",
    "cost",
    "energy_j",
    "risk_s",
    "climb_m",
    "descent_m",
    "grade_max",
    "grade_min",
    "side_slope_max",
    "bridged_m",
)


def _route(total: dict[str, Any], legs: list[dict[str, Any]]) -> Route:
    parts = tuple(
        Leg(
            start=Position(*leg["from"]),
            end=Position(*leg["to"]),
            soil=leg["soil"],
            rank_min=leg["rank_min"],
            reason=leg["reason"],
            **{name: leg[name] for name in _SUMS},
        )
        for leg in legs
    )
    return Route(parts, **{name: total[name] for name in _SUMS})
