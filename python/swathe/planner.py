"""From nests to a route: search, shortcuts, certificate, and reasons when there is no way.

Why this file is long: plans, ways over cells and ways at any angle are one public module, and its functions carry the
documentation.
"""

from __future__ import annotations

import math
import operator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.corridor import Corridor, CorridorParams
from swathe.errors import InvalidParameterError, OutsideGridError, ShapeMismatchError, TooLargeError
from swathe.grid import Cell, Position
from swathe.nest import NestParams, Nests
from swathe.objective import Objective, as_objective, closed_where, cost_factor
from swathe.swarm import Frame, StopParams, Stopped, SwarmParams, Tally, frame_of, tally
from swathe.terrain import require_length

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike, NDArray

    from swathe.objective import CostFunction, Word
    from swathe.rank import Region

PathKind = Literal["grid8", "grid16", "any-angle"]
Status = Literal["route_found", "no_route", "start_blocked", "goal_blocked", "outside_map"]


@dataclass(frozen=True, slots=True)
class Path:
    """A cheapest way over cells: its cells from start to goal, its cost and its length in metres."""

    cells: list[Cell]
    cost: float
    length_m: float


@dataclass(frozen=True, eq=False)
class AnyAnglePath:
    """A way of straight segments at any angle.

    Attributes:
        points: (n, 2) vertices from start to goal as row and column; whole numbers are the centres of cells.
        cost: the integral of the cost per metre along the segments.
        length_m: their length in metres.
    """

    points: NDArray[np.float64]
    cost: float
    length_m: float


@dataclass(frozen=True, slots=True)
class NoRoute:
    """No way; falsy. ``status`` is ``no_route``, ``start_blocked`` or ``goal_blocked``, ``reason`` one sentence."""

    status: Status
    reason: str

    def __bool__(self) -> bool:
        """Return False, so that ``if path:`` reads well."""
        return False


def shortest_path(
    cells: ArrayLike,
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    neighbours: int = 8,
    method: Literal["auto", "astar", "dijkstra"] = "auto",
    corners: Literal["keep", "cut"] = "keep",
    memory_limit_bytes: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> Path | NoRoute:
    """Return a cheapest way over cells from ``start`` to ``goal``, both (row, column).

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
            Contiguous arrays of bool, uint8, uint16, float32 and float64 are read where they are; others are copied.
        start: row and column of the first cell.
        goal: row and column of the last cell.
        cell_size_m: side of a cell.
        neighbours: 8 or 16 directions.
        method: ``auto`` leaves out ground from which, by a coarse grid's bound, the goal cannot be reached in time;
            ``dijkstra`` searches in all directions until the goal is reached; ``astar`` is the textbook search with the
            least cost times the straight distance, slower and kept for comparison. The cost is the same.
        corners: ``keep`` lets no step pass a closed cell at a corner; ``cut`` allows it, for comparison with peers.
        memory_limit_bytes: most memory that the search may hold beside ``cells``, copies of them included.
        on_progress: called with ``"route"``, the cells settled so far and 0; returning False stops with an error.

    An edge costs its metres times the length-weighted mean of the cells that it crosses (with 8 neighbours the mean of
    both ends). The cost is the way's own, summed in floats, and above the least there is by at most 1e-8 of it; it is
    infinite when the sum is beyond what a float holds.

    >>> import numpy as np
    >>> shortest_path(np.ones((3, 4), dtype=bool), (0, 0), (0, 3)).cost
    3.0

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        TooLargeError: the search would need more memory than ``memory_limit_bytes``.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs, left_bytes = _costs(cells, memory_limit_bytes)
    options = _cell_search(cell_size_m, neighbours, corners, left_bytes)
    if method not in ("auto", "astar", "dijkstra"):
        raise InvalidParameterError(f"The method {method!r} is not known.", "Give auto, astar or dijkstra.")
    first, last = _cell(start, costs.shape), _cell(goal, costs.shape)
    blocked = _blocked_end(costs, first, last)
    if blocked is not None:
        return blocked
    found = _core.shortest_path(costs, first, last, options, method, on_progress)
    if found is None:
        return NoRoute("no_route", _SEPARATED)
    way, cost = found
    steps = np.diff(np.asarray(way, dtype=np.float64), axis=0)
    length_m = float(np.hypot(steps[:, 0], steps[:, 1]).sum() * cell_size_m) if len(way) > 1 else 0.0
    return Path([Cell(*cell) for cell in way], cost, length_m)


def cost_field(
    cells: ArrayLike,
    start: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    neighbours: int = 8,
    corners: Literal["keep", "cut"] = "keep",
    memory_limit_bytes: int | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> NDArray[np.float64]:
    """Return the least cost from ``start``, (row, column), to every cell: infinite where no way leads.

    Arguments and edges are those of :func:`shortest_path`. From a closed start no way leads anywhere.

    >>> import numpy as np
    >>> cost_field(np.ones((2, 3), dtype=bool), (0, 0))[0].tolist()
    [0.0, 1.0, 2.0]

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        TooLargeError: the field would need more memory than ``memory_limit_bytes``.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs, left_bytes = _costs(cells, memory_limit_bytes)
    options = _cell_search(cell_size_m, neighbours, corners, left_bytes)
    field: NDArray[np.float64] = _core.cost_field(costs, _cell(start, costs.shape), options, on_progress)
    return field


def any_angle_path(
    cells: ArrayLike,
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    method: Literal["auto", "theta", "eikonal"] = "auto",
    corners: Literal["keep", "cut"] = "keep",
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> AnyAnglePath | NoRoute:
    """Return a cheap way of straight segments at any angle from the centre of ``start`` to the centre of ``goal``.

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
        start: row and column of the first cell.
        goal: row and column of the last cell.
        cell_size_m: side of a cell.
        method: ``theta`` refines what Lazy Theta* and the search over 16 neighbours find, ``eikonal`` the way down the
            eikonal field; ``auto`` takes the cheapest of all.
        corners: ``keep`` lets no segment touch a closed cell, not even at a corner; ``cut`` allows it.
        on_progress: called with stage, work done and work expected; returning False stops with an error.

    The cost is the integral of the cost per metre along the segments, so it is never less than that of a cheapest way;
    with ``auto`` and ``theta`` it is never more than that of ``shortest_path``. How near it comes to the cheapest is
    measured in docs/any-angle.md. Where corners are cut, ``eikonal`` alone finds only ways that share sides of cells.

    >>> import numpy as np
    >>> any_angle_path(np.ones((4, 5)), (0, 0), (3, 4)).cost
    5.0

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs = _floats(cells)
    if method not in ("auto", "theta", "eikonal"):
        raise InvalidParameterError(f"The method {method!r} is not known.", "Give auto, theta or eikonal.")
    _require_corners(corners)
    cell_size_m = require_length(cell_size_m)
    first, last = _cell(start, costs.shape), _cell(goal, costs.shape)
    blocked = _blocked_end(costs, first, last)
    if blocked is not None:
        return blocked
    found = _core.any_angle_path(costs, first, last, cell_size_m, method, corners == "cut", on_progress)
    if found is None:
        return NoRoute("no_route", _SEPARATED)
    way, cost = found
    points = np.asarray(way, dtype=np.float64)
    points[0], points[-1] = first, last  # without the rounding of metres
    steps = np.diff(points, axis=0)
    return AnyAnglePath(points, cost, float(np.hypot(steps[:, 0], steps[:, 1]).sum() * cell_size_m))


def eikonal_field(
    cells: ArrayLike,
    start: tuple[int, int],
    *,
    cell_size_m: float = 1.0,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> NDArray[np.float64]:
    """Return the costs from the centre of ``start`` to the centre of every cell, as if any heading could be taken.

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
        start: row and column of the start.
        cell_size_m: side of a cell.
        on_progress: called with stage, work done and work expected; returning False stops with an error.

    The values solve the eikonal equation by fast marching (Sethian 1996, 1999), of second order where the cost is
    smooth. Right for costs that change little from cell to cell; docs/any-angle.md tells the errors. Infinite where no
    way of steps along rows and columns leads, and everywhere when the start is closed.

    >>> import numpy as np
    >>> eikonal_field(np.ones((1, 4)), (0, 0))
    array([[0., 1., 2., 3.]])

    Raises:
        UsageError: a cost is negative, or the start lies outside.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    costs = _floats(cells)
    cell_size_m = require_length(cell_size_m)
    first = _cell(start, costs.shape)
    field: NDArray[np.float64] = _core.eikonal_field(costs, first, cell_size_m, on_progress)
    return field


#: Why no way leads from one open cell to another.
_SEPARATED = "Closed cells separate start and goal."


def _require_corners(corners: str) -> None:
    if corners not in ("keep", "cut"):
        raise InvalidParameterError(f"The corners {corners!r} are not known.", "Give keep or cut.")


def _blocked_end(costs: NDArray[Any], start: Cell, goal: Cell) -> NoRoute | None:
    """Return the refusal when start or goal is closed."""
    for name, cell in (("start", start), ("goal", goal)):
        if not (costs[cell] if costs.dtype == np.bool_ else math.isfinite(costs[cell])):
            _refuse_negative(costs)  # the core, which looks otherwise, is not asked
            status: Status = "start_blocked" if name == "start" else "goal_blocked"
            return NoRoute(status, f"The {name} cell ({cell.row}, {cell.column}) is closed.")
    return None


def _cell_search(cell_size_m: float, neighbours: int, corners: str, left_bytes: int | None) -> dict[str, Any]:
    if neighbours not in (8, 16):
        raise InvalidParameterError(f"{neighbours} neighbours are not offered.", "Give 8 or 16.")
    _require_corners(corners)
    return {
        "cell_size_m": require_length(cell_size_m),
        "neighbours": neighbours,
        "cut_corners": corners == "cut",
        "memory_limit_bytes": left_bytes,
    }


#: Kinds of number that the core reads where they are.
_IN_PLACE = (np.bool_, np.uint8, np.uint16, np.float32, np.float64)


def _costs(cells: ArrayLike, limit_bytes: int | None) -> tuple[NDArray[Any], int | None]:
    """Return costs as the core reads them, and what is left of the memory allowed."""
    if limit_bytes is not None:
        limit_bytes = _bytes(limit_bytes)
    array: NDArray[Any] = np.asarray(cells)
    if array.ndim != 2 or array.size == 0:
        raise ShapeMismatchError(f"The cells have the shape {array.shape}.", "Give an array of rows and columns.")
    if array.dtype.kind not in "biuf":
        raise InvalidParameterError("The cells do not hold numbers.", "Give costs per metre or booleans.")
    dtype = array.dtype if array.dtype in _IN_PLACE else np.dtype(np.float64)
    if array.dtype == dtype and array.flags.c_contiguous and array.flags.aligned:
        return array, limit_bytes
    copied_bytes = array.size * dtype.itemsize
    if limit_bytes is not None and copied_bytes > limit_bytes:
        raise TooLargeError(
            f"The cells, {array.dtype} in this layout, are copied first, which takes {copied_bytes} bytes of the "
            f"{limit_bytes} allowed: about {limit_bytes // (dtype.itemsize + 4)} cells would fit.",
            "Give a contiguous array of float32, or allow more memory.",
        )
    left_bytes = None if limit_bytes is None else limit_bytes - copied_bytes
    return np.require(array, dtype, ["C", "A"]), left_bytes


def _bytes(given: int) -> int:
    try:
        count = operator.index(given)
    except TypeError:
        count = -1
    if count < 0:
        raise InvalidParameterError(f"A memory limit of {given!r} is not usable.", "Give a whole number of bytes.")
    return min(count, 2**63)


def _floats(cells: ArrayLike) -> NDArray[np.float64]:
    """Return costs as floats, infinite where a boolean says closed."""
    costs, _ = _costs(cells, None)
    return np.where(costs, 1.0, np.inf) if costs.dtype == np.bool_ else np.ascontiguousarray(costs, np.float64)


def _refuse_negative(costs: NDArray[Any]) -> None:
    if costs.dtype != np.bool_ and len(below := np.argwhere(costs < 0)):
        row, column = below[0]
        raise InvalidParameterError(
            f"The cost {costs[row, column]:g} at cell ({row}, {column}) is negative.",
            "Mark closed cells with NaN or infinity instead.",
        )


def _cell(cell: tuple[int, int], shape: tuple[int, ...]) -> Cell:
    try:
        row, column = (operator.index(value) for value in cell)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"{cell!r} is not a cell.", "Give a row and a column, whole numbers.") from error
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise OutsideGridError(
            f"Cell ({row}, {column}) lies outside {shape[0]} rows and {shape[1]} columns.",
            "Rows and columns count from 0 at the north-west.",
        )
    return Cell(row, column)


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
        status: ``route_found`` or the kind of refusal.
        route: the route, None in a refusal.
        reason: why there is none, in one sentence.
        place: where.
        remedy: the nearest thing that would change it.
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
        stopped: what ended the search for ground and what it left unseen (swarm only).
        frames: pictures of the swarm at work and its arc, as many as were asked for at most.
    """

    status: Status
    route: Route | None
    reason: str | None
    place: Position | None
    remedy: str | None
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
    stopped: Stopped | None = None
    frames: tuple[Frame, ...] = ()


def plan(
    region: Region,
    start: Position,
    goal: Position,
    *,
    method: Literal["swarm", "exact"] = "swarm",
    swarm: SwarmParams | None = None,
    corridor: CorridorParams | None = None,
    path: PathKind = "grid16",
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
        region: the ground, the vehicle and the rules.
        start: where the vehicle is, in the map frame.
        goal: where it should go.
        method: ``swarm`` in a swathe around an arc, or ``exact`` over the whole map.
        swarm: the swarm's parameters; its nest parameters hold for ``exact`` too.
        corridor: arc and width of the swathe.
        path: what the route is made of. ``grid8``: steps to 8 neighbours as they are; ``grid16``: steps to 16
            neighbours, then shortcuts; ``any-angle``: straight segments whose vertices lie anywhere.
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
        "bridge": bridge,
        "certify": certify,
        "objective": as_objective(objective).core_argument(),
        "reversed": reverse,
    }
    factor = None if cost is None else cost_factor(region, cost)
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
    first, last = _cell(start, region.geometry.shape), _cell(goal, region.geometry.shape)
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
