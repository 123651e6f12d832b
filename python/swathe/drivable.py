"""Paths that a car can drive: arcs within the vehicle's turning radius that follow a route, reversing where needed."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import Position
from swathe.nest import NestParams
from swathe.terrain import require_length

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from swathe.rank import Region


#: Turn between two points of an arc as a line.
_TURN_RAD = 0.1


class Pose(NamedTuple):
    """Where a vehicle stands, map metres, and where its nose points, counter-clockwise from east."""

    x_m: float
    y_m: float
    heading_rad: float


class CurveArc(NamedTuple):
    """A part of a curve: its curvature in 1/m (above 0 is left) and its length, negative when driven in reverse."""

    curvature_per_m: float
    length_m: float


@dataclass(frozen=True, slots=True)
class DrivableParams:
    """How a drivable path is searched; the figures are estimates.

    Attributes:
        reverse_factor: how many times the time and cost of reversing are those of driving forward; 1 to 1000.
        cusp_time_s: seconds for a change between forward and reverse; 0 to 1,000,000.
        weight: weight of the expected cost, 1 to 1000; greater values search less and may find dearer paths.
        most_states: states after which the search gives up; a state takes about 150 bytes.
    """

    reverse_factor: float = 2.0
    cusp_time_s: float = 4.0
    weight: float = 2.0
    most_states: int = 1_000_000


@dataclass(frozen=True, slots=True)
class DrivenArc:
    """A part of a path with one curvature and direction. Facts hold for the direction of travel, as those of a leg.

    ``length_m`` is that over the surface, ``map_length_m`` that on the map.
    """

    start: Pose
    curvature_per_m: float
    reverse: bool
    length_m: float
    time_s: float
    cost: float
    energy_j: float
    climb_m: float
    descent_m: float
    grade_max: float
    grade_min: float
    side_slope_max: float
    map_length_m: float

    def points(self, end: tuple[float, float]) -> NDArray[np.float64]:
        """Return (n, 2) map metres along the arc, at most a tenth of a radian apart; ``end`` is where it ends."""
        turn_rad = self.curvature_per_m * (-self.map_length_m if self.reverse else self.map_length_m)
        share = np.linspace(0, 1, max(2, math.ceil(abs(turn_rad) / _TURN_RAD) + 1))
        half = turn_rad * share / 2
        # The chord of an arc points along its middle heading.
        chord_m = self.map_length_m * share * np.sinc(half / np.pi) * (-1 if self.reverse else 1)
        along = self.start.heading_rad + half
        points = np.column_stack([self.start.x_m + chord_m * np.cos(along), self.start.y_m + chord_m * np.sin(along)])
        points[-1] = end
        return points


@dataclass(frozen=True, eq=False)
class DrivablePath:
    """A path within a vehicle's turning radius.

    Attributes:
        arcs: its parts in order.
        poses: (n, 3) x, y in map metres and heading in radians, at most a fifth of the turning radius apart; a pose at
            which the direction changes stands twice.
        reverse: for each pose whether it is driven in reverse.
        curvature_per_m: for each pose the curvature of its arc, above 0 to the left.
        length_m: length over the surface, reversing included.
        time_s: seconds, changes of direction included.
        cost: the planner's cost, changes of direction included.
        energy_j: energy in joules.
        cusps: changes between forward and reverse.
        reverse_m: metres in reverse, on the map.
        radius_m: the least turning radius that it keeps; 0 for a vehicle that turns in place.
        states: states that the search made.
    """

    arcs: tuple[DrivenArc, ...]
    poses: NDArray[np.float64]
    reverse: NDArray[np.bool_]
    curvature_per_m: NDArray[np.float64]
    length_m: float
    time_s: float
    cost: float
    energy_j: float
    cusps: int
    reverse_m: float
    radius_m: float
    states: int


@dataclass(frozen=True, slots=True)
class NotDrivable:
    """No path; falsy. Where the search came nearest to the goal, why there is none, and what would change it."""

    reason: str
    place: Position
    remedy: str

    def __bool__(self) -> bool:
        """Return False, so that ``if path:`` reads well."""
        return False


def drivable_path(
    region: Region,
    points: ArrayLike,
    *,
    start_heading_rad: float | None = None,
    goal_heading_rad: float | None = None,
    params: DrivableParams | None = None,
    nest: NestParams | None = None,
    on_progress: Callable[[str, int, int], bool] | None = None,
) -> DrivablePath | NotDrivable:
    """Return a path through the nests of a region that follows some points within the vehicle's turning radius.

    Args:
        region: the ground, the vehicle and the rules.
        points: (n, 2) map metres from start to goal, such as ``Route.xy_m``; the path begins and ends there and is
            searched around the lines between them, farther away when nothing is found.
        start_heading_rad: where the nose points at the start; free when None.
        goal_heading_rad: the same at the goal.
        params: how the path is searched.
        nest: what counts as a nest.
        on_progress: called with stage, work done and work expected; returning False stops with an error.

    A vehicle that turns in place keeps the lines between the points; its headings at the ends are not used.

    Raises:
        UsageError: a parameter is outside its range, or the points are not finite.
        InterruptedBySignalError: ``on_progress`` asked to stop.
    """
    way = np.asarray(points, dtype=np.float64)
    if way.ndim != 2 or way.shape[1] != 2:
        raise ShapeMismatchError(f"The points have the shape {way.shape}.", "Give an array of n rows of x and y.")
    if not np.isfinite(way).all():
        raise InvalidParameterError("A point is not finite.", "Give finite map metres.")
    params = params or DrivableParams()
    if params.most_states < 1:
        raise InvalidParameterError(f"{params.most_states} states are too few.", "Give at least 1.")
    request = {
        **asdict(params),
        "points": [(float(x), float(y)) for x, y in way],
        "start_heading_rad": start_heading_rad,
        "goal_heading_rad": goal_heading_rad,
    }
    nest = nest or NestParams(rank_min=region.params.rank_min)
    found = _core.drivable_path(region.core, request, asdict(nest), on_progress)
    if found["status"] != "route_found":
        return NotDrivable(found["reason"], Position(*found["place"]), found["remedy"])
    return wrapped(found)


def dubins(start: Pose, goal: Pose, radius_m: float) -> list[CurveArc]:
    """Return the shortest curve from pose to pose that is driven forward only and keeps a turning radius.

    Source: Dubins, American Journal of Mathematics 79 (1957).

    >>> import math
    >>> [round(arc.length_m, 6) for arc in dubins(Pose(0, 0, 0), Pose(0, 2, math.pi), 1.0)]
    [3.141593]

    Raises:
        UsageError: a number is not finite, or the radius not above 0.
    """
    return [CurveArc(*arc) for arc in _core.dubins(_pose(start), _pose(goal), require_length(radius_m))]


def reeds_shepp(start: Pose, goal: Pose, radius_m: float) -> list[CurveArc]:
    """Return the shortest curve from pose to pose that may reverse and keeps a turning radius.

    Source: Reeds and Shepp, Pacific Journal of Mathematics 145 (1990).

    >>> reeds_shepp(Pose(0, 0, 0), Pose(-3, 0, 0), 1.0)
    [CurveArc(curvature_per_m=0.0, length_m=-3.0)]

    Raises:
        UsageError: a number is not finite, or the radius not above 0.
    """
    return [CurveArc(*arc) for arc in _core.reeds_shepp(_pose(start), _pose(goal), require_length(radius_m))]


def _pose(pose: Pose) -> Pose:
    if not all(math.isfinite(value) for value in pose):
        raise InvalidParameterError(f"{pose!r} is not a pose.", "Give x, y and a heading, all finite.")
    return Pose(*(float(value) for value in pose))


_FACTS = (
    "length_m",
    "time_s",
    "cost",
    "energy_j",
    "climb_m",
    "descent_m",
    "grade_max",
    "grade_min",
    "side_slope_max",
)


def wrapped(found: dict[str, Any]) -> DrivablePath:
    """Return what the core found as a path."""
    arcs = tuple(
        DrivenArc(
            start=Pose(*arc["start"]),
            curvature_per_m=arc["curvature_per_m"],
            reverse=arc["reverse"],
            map_length_m=arc["map_length_m"],
            **{name: arc[name] for name in _FACTS},
        )
        for arc in found["arcs"]
    )
    same = (
        "poses",
        "curvature_per_m",
        "length_m",
        "time_s",
        "cost",
        "energy_j",
        "cusps",
        "reverse_m",
        "radius_m",
        "states",
    )
    reverse = np.asarray(found["reverse"], dtype=np.bool_)
    return DrivablePath(arcs=arcs, reverse=reverse, **{name: found[name] for name in same})
