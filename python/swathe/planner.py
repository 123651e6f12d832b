"""From nests to a route: search, shortcuts, certificate, and reasons when there is no way."""

# Why this file is long: it is the mirror of a core module that finds ways, repairs them and plans routes.

from __future__ import annotations

import math
import operator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from swathe import _core
from swathe.corridor import Corridor, CorridorParams
from swathe.drivable import DrivablePath, wrapped
from swathe.errors import InvalidParameterError, OutsideGridError, ShapeMismatchError
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

PathKind = Literal["auto", "grid8", "grid16", "any-angle", "drivable"]
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
) -> Path | NoRoute:
    """Return a cheapest way over cells from ``start`` to ``goal``, both (row, column).

    Args:
        cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
        start: row and column of the first cell.
        goal: row and column of the last cell.
        cell_size_m: side of a cell.
        neighbours: 8 or 16 directions.
        method: ``auto``, ``astar`` or ``dijkstra``; the cost is the same.
        corners: ``keep`` lets no step pass a closed cell at a corner; ``cut`` allows it, for comparison with peers.

    An edge costs its metres times the length-weighted mean of the cells that it crosses (with 8 neighbours the mean of
    both ends).

    >>> import numpy as np
    >>> shortest_path(np.ones((3, 4), dtype=bool), (0, 0), (0, 3)).cost
    3.0

    Raises:
        UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
    """
    costs = _costs(cells)
    if neighbours not in (8, 16):
        raise InvalidParameterError(f"{neighbours} neighbours are not offered.", "Give 8 or 16.")
    _require_corners(corners)
    if method not in ("auto", "astar", "dijkstra"):
        raise InvalidParameterError(f"The method {method!r} is not known.", "Give auto, astar or dijkstra.")
    cell_size_m = require_length(cell_size_m)
    first, last = _cell(start, costs.shape), _cell(goal, costs.shape)
    blocked = _blocked_end(costs, first, last)
    if blocked is not None:
        return blocked
    found = _core.shortest_path(costs, first, last, cell_size_m, neighbours, method, corners == "cut", None)
    if found is None:
        return NoRoute("no_route", _SEPARATED)
    way, cost = found
    steps = np.diff(np.asarray(way, dtype=np.float64), axis=0)
    length_m = float(np.hypot(steps[:, 0], steps[:, 1]).sum() * cell_size_m) if len(way) > 1 else 0.0
    return Path([Cell(*cell) for cell in way], cost, length_m)


@dataclass(frozen=True, slots=True)
class RepairTally:
    """What the last search of a :class:`Replanner` did, and how many there were.

    Attributes:
        expanded: cells that it settled or unsettled, some of them more than once.
        looked_at: the same, with the cells around changed ones and those whose way was withdrawn.
        afresh: whether it began from nothing.
        fresh_plans: searches from nothing so far.
        repairs: repairs so far.
    """

    expanded: int
    looked_at: int
    afresh: bool
    fresh_plans: int
    repairs: int


class Replanner:
    """A cheapest way over cells that is kept right while cells change and the robot moves (D* Lite).

    The cost of :meth:`path` is that of a new ``Replanner`` on the changed cells to the last bit: the least over all
    ways of the sum of their steps, taken from the goal backwards. :func:`shortest_path` sums in another order, so it
    may differ from it in the last bits.

    >>> import numpy as np
    >>> replanner = Replanner(np.ones((3, 5)), (1, 0), (1, 4))
    >>> replanner.path().cost
    4.0
    >>> replanner.update(slice(0, 2), slice(2, 3), np.inf)
    2
    >>> replanner.move_to((1, 1))
    >>> round(replanner.path().cost, 3)
    4.414
    """

    def __init__(
        self,
        cells: ArrayLike,
        start: tuple[int, int],
        goal: tuple[int, int],
        *,
        cell_size_m: float = 1.0,
        neighbours: int = 8,
        corners: Literal["keep", "cut"] = "keep",
        repair_share: float = 0.2,
        keep_expanded: bool = False,
    ) -> None:
        """Take a copy of the cells; the arguments that :func:`shortest_path` has too mean the same.

        Args:
            cells: (rows, columns); bool = passable at cost 1, numbers = cost per metre (NaN and infinity are closed).
            start: row and column of the robot.
            goal: row and column of the last cell.
            cell_size_m: side of a cell.
            neighbours: 8 or 16 directions.
            corners: ``keep`` or ``cut``.
            repair_share: share of a fresh plan's work, 0 or more, after which a repair is given up for a fresh plan.
            keep_expanded: whether :attr:`expanded` is kept, for pictures.

        Raises:
            UsageError: a cost is negative, a cell lies outside, or an argument is not one of those named.
        """
        costs = _costs(cells)
        if neighbours not in (8, 16):
            raise InvalidParameterError(f"{neighbours} neighbours are not offered.", "Give 8 or 16.")
        if corners not in ("keep", "cut"):
            raise InvalidParameterError(f"The corners {corners!r} are not known.", "Give keep or cut.")
        if not repair_share >= 0:
            raise InvalidParameterError(f"A repair share of {repair_share} is not usable.", "Give 0 or more.")
        self._cell_size_m = require_length(cell_size_m)
        self._start, self._goal = _cell(start, costs.shape), _cell(goal, costs.shape)
        self._shape = costs.shape
        self._core = _core.Replanner(
            costs,
            self._start,
            self._goal,
            self._cell_size_m,
            neighbours,
            corners == "cut",
            float(repair_share),
            keep_expanded,
        )

    @property
    def start(self) -> Cell:
        """Where the robot is."""
        return self._start

    @property
    def goal(self) -> Cell:
        """Where it should go."""
        return self._goal

    def move_to(self, cell: tuple[int, int]) -> None:
        """Move the robot to a cell (row, column).

        Raises:
            UsageError: the cell lies outside.
        """
        self._start = _cell(cell, self._shape)
        self._core.move_to(self._start)

    def update(self, rows: ArrayLike | slice, columns: ArrayLike | slice, values: ArrayLike) -> int:
        """Give cells new values and return how many of them are now others than before.

        Args:
            rows: a slice for a rectangle of cells, or whole numbers for single ones.
            columns: as ``rows``.
            values: what ``cells`` may hold, one for each cell or one for all.

        Raises:
            UsageError: a value is negative, a cell lies outside, or the shapes do not fit; nothing has changed then.
        """
        if isinstance(rows, slice) and isinstance(columns, slice):
            spans = [range(*span.indices(size)) for span, size in zip((rows, columns), self._shape, strict=True)]
            if any(span.step != 1 for span in spans):
                raise InvalidParameterError("A rectangle of cells has no gaps.", "Give slices without a step.")
            shape = (len(spans[0]), len(spans[1]))
            costs = _costs_like(values, shape)
            return self._core.update_window(spans[0].start, spans[1].start, costs) if costs.size else 0
        if isinstance(rows, slice) or isinstance(columns, slice):
            raise InvalidParameterError("Rows and columns are not of one kind.", "Give two slices or two arrays.")
        row, column = (_numbers(name, given) for name, given in (("rows", rows), ("columns", columns)))
        try:
            row, column = np.broadcast_arrays(row, column)
        except ValueError as error:
            raise ShapeMismatchError(
                f"Rows of the shape {row.shape} do not fit columns of the shape {column.shape}.",
                "Give one row and one column for each cell.",
            ) from error
        costs = _costs_like(values, row.shape)
        return self._core.update_cells(np.ravel(row), np.ravel(column), np.ravel(costs))

    def path(self, *, on_progress: Callable[[str, int, int], bool] | None = None) -> Path | NoRoute:
        """Return a cheapest way from the robot to the goal, repaired or searched afresh as needed.

        Args:
            on_progress: called with ``route``, the cells looked at and 0; returning False stops with an error, and the
                next call goes on.

        Raises:
            InterruptedBySignalError: ``on_progress`` asked to stop.
        """
        ends: tuple[tuple[Status, str, Cell], ...] = (
            ("start_blocked", "start", self._start),
            ("goal_blocked", "goal", self._goal),
        )
        for status, name, cell in ends:
            if math.isinf(self._core.cost(cell)):
                return NoRoute(status, f"The {name} cell ({cell.row}, {cell.column}) is closed.")
        found = self._core.path(on_progress)
        if found is None:
            return NoRoute("no_route", "Closed cells separate start and goal.")
        way, cost = found
        steps = np.diff(np.asarray(way, dtype=np.float64), axis=0)
        length_m = float(np.hypot(steps[:, 0], steps[:, 1]).sum() * self._cell_size_m) if len(way) > 1 else 0.0
        return Path([Cell(*cell) for cell in way], cost, length_m)

    @property
    def tally(self) -> RepairTally:
        """What the last search did."""
        return RepairTally(*self._core.tally())

    @property
    def expanded(self) -> NDArray[np.uint32]:
        """Rows and columns of the cells that the last search expanded, (n, 2) in their order; see ``keep_expanded``."""
        return np.asarray(self._core.expanded())


def _numbers(name: str, given: ArrayLike) -> NDArray[np.int64]:
    array = np.asarray(given)
    if array.size == 0:
        return array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise InvalidParameterError(f"The {name} are not whole numbers.", "Give rows and columns counted from 0.")
    return array.astype(np.int64)


def _costs_like(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return costs per metre of a shape from what ``cells`` may hold."""
    array = np.asarray(values)
    if array.dtype == np.bool_:
        array = np.where(array, 1.0, np.inf)
    if array.dtype.kind not in "iuf":
        raise InvalidParameterError("The values do not hold numbers.", "Give costs per metre or booleans.")
    try:
        return np.ascontiguousarray(np.broadcast_to(array, shape), dtype=np.float64)
    except ValueError as error:
        raise ShapeMismatchError(
            f"Values of the shape {array.shape} do not fit cells of the shape {shape}.",
            "Give one value for each cell, or one for all.",
        ) from error


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
    costs = _costs(cells)
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
    costs = _costs(cells)
    cell_size_m = require_length(cell_size_m)
    first = _cell(start, costs.shape)
    field: NDArray[np.float64] = _core.eikonal_field(costs, first, cell_size_m, on_progress)
    return field


#: Why no way leads from one open cell to another.
_SEPARATED = "Closed cells separate start and goal."


def _require_corners(corners: str) -> None:
    if corners not in ("keep", "cut"):
        raise InvalidParameterError(f"The corners {corners!r} are not known.", "Give keep or cut.")


def _blocked_end(costs: NDArray[np.float64], start: Cell, goal: Cell) -> NoRoute | None:
    """Return the refusal when start or goal is closed."""
    for name, cell in (("start", start), ("goal", goal)):
        if not math.isfinite(costs[cell]):
            _refuse_negative(costs)  # the core, which looks otherwise, is not asked
            status: Status = "start_blocked" if name == "start" else "goal_blocked"
            return NoRoute(status, f"The {name} cell ({cell.row}, {cell.column}) is closed.")
    return None


def _costs(cells: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(cells)
    if array.ndim != 2 or array.size == 0:
        raise ShapeMismatchError(f"The cells have the shape {array.shape}.", "Give an array of rows and columns.")
    if array.dtype == np.bool_:
        return np.where(array, 1.0, np.inf)
    if array.dtype.kind not in "iuf":
        raise InvalidParameterError("The cells do not hold numbers.", "Give costs per metre or booleans.")
    return np.ascontiguousarray(array, dtype=np.float64)


def _refuse_negative(costs: NDArray[np.float64]) -> None:
    below = np.argwhere(costs < 0)
    if len(below):
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
        region: the ground, the vehicle and the rules.
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
