"""Local avoidance by itself: a window of certainties or a scan in, a steering direction out."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal, cast, get_args

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from swathe.sensor import Pose, Scan

CERTAINTY_MAX = 15
"""Greatest certainty that an obstacle stands in a cell."""

_DIMENSIONS = 3

PlayerState = Literal["driving", "escaping", "turning", "there"]
"""What Player's driver is doing."""

_PLAYER_STATES: tuple[PlayerState, ...] = get_args(PlayerState)

_WIDEST_WINDOW = 255
_WIDEST_SECTOR_DEG = 90.0


@dataclass(frozen=True, slots=True)
class Steering:
    """What a method has decided.

    Attributes:
        direction_rad: where to steer, counter-clockwise from east; None when every direction is closed.
        crowding: density in that direction over the density that blocks, 0 to 1.
        width_rad: width of the opening that is steered through.
    """

    direction_rad: float | None
    crowding: float
    width_rad: float


@dataclass(frozen=True, slots=True)
class Body:
    """What a method must know of the robot at its present speed.

    Attributes:
        enlarged_m: robot radius and safety distance.
        turn_radius_m: least radius of a turn to the left and to the right; 0 turns in place.
        reaction_m: distance at which an obstacle 0.3 m wide must block.
    """

    enlarged_m: float
    turn_radius_m: tuple[float, float] = (0.0, 0.0)
    reaction_m: float = 1.5


class VfhPlus:
    """VFH+ of Ulrich and Borenstein, ICRA 1998, on windows of certainties (0 to 15) around the robot's cell."""

    def __init__(
        self,
        *,
        window_cells: int = 61,
        cell_size_m: float = 0.1,
        sectors: int = 72,
        too_close: Literal["stop", "turn_away"] = "stop",
    ) -> None:
        """Make the method's tables.

        Args:
            window_cells: side of the window, odd, 3 to 255.
            cell_size_m: side of a cell.
            sectors: of the histogram, 4 to 3600; the paper's 5 degrees give 72.
            too_close: what an obstacle nearer than the enlargement does: every direction is closed, as in the paper, or
                those that lead nearer to it are.

        Raises:
            InvalidParameterError: a figure is outside its range.
        """
        for name, given, fits, allowed in (
            ("side of the window", window_cells, 3 <= window_cells <= 255 and window_cells % 2 == 1, "3 to 255, odd"),
            ("side of a cell", cell_size_m, 0 < cell_size_m < math.inf, "above 0 m"),
            ("number of sectors", sectors, 4 <= sectors <= 3600, "4 to 3600"),
        ):
            if not fits:
                raise InvalidParameterError(f"The {name} of {given} is not usable.", f"Allowed is {allowed}.")
        self._core = _core.VfhPlus(window_cells, cell_size_m, sectors, too_close)

    def steer(self, window: ArrayLike, heading_rad: float, target_rad: float, body: Body) -> Steering:
        """Choose a direction for a window, whose first row lies north; directions are counter-clockwise from east."""
        direction_rad, crowding, width_rad = self.steer_all(np.asarray(window)[None], heading_rad, target_rad, body)[0]
        return Steering(None if math.isnan(direction_rad) else float(direction_rad), float(crowding), float(width_rad))

    def steer_all(self, windows: ArrayLike, heading_rad: float, target_rad: float, body: Body) -> NDArray[np.float64]:
        """Steer through windows one after the other; rows of direction (NaN where closed), crowding and width.

        Raises:
            ShapeMismatchError: the windows are not of this method's size.
            InvalidParameterError: a certainty is above 15, or a figure is not finite or below 0.
        """
        side = self._core.window_cells()
        cells = np.ascontiguousarray(windows, dtype=np.uint8)
        if cells.ndim != _DIMENSIONS or cells.shape[1:] != (side, side):
            raise ShapeMismatchError(
                f"Windows of the shape {cells.shape} do not fit.", f"Give windows of {side} by {side} cells."
            )
        if cells.size and cells.max() > CERTAINTY_MAX:
            raise InvalidParameterError(f"A certainty of {cells.max()} is not usable.", "Certainties go from 0 to 15.")
        figures = (body.enlarged_m, *body.turn_radius_m, body.reaction_m)
        if not all(0 <= figure < math.inf for figure in figures) or not math.isfinite(heading_rad + target_rad):
            raise InvalidParameterError(
                "A figure of the robot is not usable.", "All must be finite, lengths not below 0."
            )
        told = self._core.steer(cells.reshape(len(cells), side * side), heading_rad, target_rad, figures)
        return cast("NDArray[np.float64]", told)

    def histogram(self) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return density, blocked and masked sectors of the last step; sector k lies k sectors left of east."""
        return self._core.histogram()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayerParams:
    """Parameters of Player's ``vfh`` driver by its names, in its units: metres, seconds and degrees.

    Where None is the default, the value is that of the parameter which the driver takes instead: ``_1ms`` (at 1 m/s,
    linear between) that of ``_0ms``, speeds in openings ``max_speed``, ``obs_cutoff_0ms`` ``free_space_cutoff_0ms``.
    Source: Player's manual, driver vfh.

    Attributes:
        cell_size: side of a cell.
        window_diameter: cells along the window's side; made odd.
        sector_angle: of the histogram.
        safety_dist_0ms: distance kept from obstacles at rest.
        max_speed: greatest speed, that in openings below 80 degrees, and in wider ones.
        max_acceleration: by which the speed rises.
        min_turnrate: of turns in place at the goal.
        max_turnrate_0ms: greatest turn rate at rest.
        min_turn_radius_safety_factor: by which the least circle is wider.
        free_space_cutoff_0ms: density below which a sector opens.
        obs_cutoff_0ms: density above which a sector closes.
        weight_desired_dir: of the way off the goal.
        weight_current_dir: of the way off the last direction.
        distance_epsilon: nearer to the goal is there.
        angle_epsilon: less off the goal's heading is in it.
        escape_speed: driven where every direction is closed; none without, nor without a time.
        escape_time: for so long.
        escape_max_turnrate: each escape turns by chance, to either side and no faster.
    """

    cell_size: float = 0.1
    window_diameter: int = 61
    sector_angle: float = 5.0
    safety_dist_0ms: float = 0.1
    safety_dist_1ms: float | None = None
    max_speed: float = 0.2
    max_speed_narrow_opening: float | None = None
    max_speed_wide_opening: float | None = None
    max_acceleration: float = 0.2
    min_turnrate: float = 10.0
    max_turnrate_0ms: float = 40.0
    max_turnrate_1ms: float | None = None
    min_turn_radius_safety_factor: float = 1.0
    free_space_cutoff_0ms: float = 2_000_000.0
    free_space_cutoff_1ms: float | None = None
    obs_cutoff_0ms: float | None = None
    obs_cutoff_1ms: float | None = None
    weight_desired_dir: float = 5.0
    weight_current_dir: float = 3.0
    distance_epsilon: float = 0.5
    angle_epsilon: float = 10.0
    escape_speed: float = 0.0
    escape_time: float = 0.0
    escape_max_turnrate: float = 0.0

    def __post_init__(self) -> None:
        """Check every figure.

        Raises:
            InvalidParameterError: a figure is outside its range.
        """
        above = ("cell_size", "max_speed", "max_acceleration", "max_turnrate_0ms")
        for field in fields(self):
            given = getattr(self, field.name)
            if given is None:
                continue
            least = -math.inf if field.name == "escape_speed" else 0.0
            allowed = f"above {least:g}" if field.name in above else f"at least {least:g}"
            fits = math.isfinite(given) and (given > least if field.name in above else given >= least)
            if field.name == "window_diameter":
                fits, allowed = 3 <= given <= _WIDEST_WINDOW, f"3 to {_WIDEST_WINDOW} cells"
            elif field.name == "sector_angle":
                fits, allowed = 0.1 <= given <= _WIDEST_SECTOR_DEG, f"0.1 to {_WIDEST_SECTOR_DEG:g} degrees"
            if not fits:
                raise InvalidParameterError(
                    f"Player's {field.name} of {given} is not usable.", f"It must be {allowed}, and finite."
                )

    def figures(self) -> tuple[list[float], list[list[float]]]:
        """Return the core's figures and its pairs at 0 and 1 m/s, in SI units."""
        narrow, wide = self.max_speed_narrow_opening, self.max_speed_wide_opening
        obs = self.free_space_cutoff_0ms if self.obs_cutoff_0ms is None else self.obs_cutoff_0ms
        pairs = [
            (self.safety_dist_0ms, self.safety_dist_1ms),
            (self.max_turnrate_0ms, self.max_turnrate_1ms),
            (self.free_space_cutoff_0ms, self.free_space_cutoff_1ms),
            (obs, self.obs_cutoff_1ms),
        ]
        both = [[slow, slow if fast is None else fast] for slow, fast in pairs]
        both[1] = [math.radians(rate) for rate in both[1]]
        figures = [
            self.cell_size,
            self.sector_angle,
            self.max_speed,
            self.max_speed if narrow is None else narrow,
            self.max_speed if wide is None else wide,
            self.max_acceleration,
            math.radians(self.min_turnrate),
            self.min_turn_radius_safety_factor,
            self.weight_desired_dir,
            self.weight_current_dir,
            self.distance_epsilon,
            math.radians(self.angle_epsilon),
            self.escape_speed,
            self.escape_time,
            math.radians(self.escape_max_turnrate),
        ]
        return figures, both


class PlayerVfh:
    """The method and the driver with the parameters and the behaviour of Player's ``vfh`` driver."""

    def __init__(self, params: PlayerParams | None = None, *, robot_radius_m: float = 0.25, seed: int = 0) -> None:
        """Make the method at rest, with the driver's default parameters if none are given.

        Args:
            params: the driver's parameters.
            robot_radius_m: the driver takes half the longer side of the base.
            seed: draws the turns of escapes.

        Raises:
            InvalidParameterError: the radius is not above 0.
        """
        if not 0 < robot_radius_m < math.inf:
            raise InvalidParameterError(f"A radius of {robot_radius_m} m is not usable.", "It must be above 0.")
        params = params or PlayerParams()
        figures, pairs = params.figures()
        self._core = _core.PlayerVfh(robot_radius_m, params.window_diameter, figures, pairs, seed)

    def drive(
        self, scan: Scan, pose: Pose, speed_mps: float, goal: Pose, step_s: float
    ) -> tuple[float, float, PlayerState]:
        """Return speed, turn rate and what the driver does on the way from a pose to a place and a heading there.

        Raises:
            InvalidParameterError: a figure is not finite.
            UsageError: the scan is not usable.
        """
        if not all(map(math.isfinite, (*_at(pose), *_at(goal), speed_mps, step_s))):
            raise InvalidParameterError(
                "A figure of the drive is not finite.", "Give poses, speed and step as numbers."
            )
        fan = (scan.angle_min_rad, scan.angle_increment_rad, scan.range_min_m, scan.range_max_m)
        ranges_m = np.asarray(scan.ranges_m, dtype=np.float64).tolist()
        speed, turn, _, state = self._core.drive(ranges_m, fan, _at(pose), speed_mps, _at(goal), step_s)
        return speed, turn, _PLAYER_STATES[state]

    def update(self, scan: Scan, speed_mps: float, goal_rad: float, step_s: float) -> tuple[float, float, float]:
        """Return speed, turn rate and direction off the nose for a scan and the goal's direction off the nose.

        Raises:
            UsageError: the scan's description is not usable.
        """
        speed, turn, direction = self.update_all(scan, np.asarray(scan.ranges_m)[None], speed_mps, goal_rad, step_s)[0]
        return float(speed), float(turn), float(direction)

    def update_all(
        self, scan: Scan, ranges_m: ArrayLike, speed_mps: float, goal_rad: float, step_s: float
    ) -> NDArray[np.float64]:
        """Go through scans one after the other, each a row of ranges and otherwise as ``scan``."""
        rows = np.ascontiguousarray(ranges_m, dtype=np.float64)
        if rows.ndim != _DIMENSIONS - 1:
            raise ShapeMismatchError(f"Ranges of the shape {rows.shape} do not fit.", "Give one row for each scan.")
        fan = (scan.angle_min_rad, scan.angle_increment_rad, scan.range_min_m, scan.range_max_m)
        return cast("NDArray[np.float64]", self._core.update(rows, fan, speed_mps, goal_rad, step_s))

    def histogram(self) -> NDArray[np.float64]:
        """Return the density of every sector in the last step, from the nose on counter-clockwise."""
        return cast("NDArray[np.float64]", self._core.histogram())


def _at(pose: Pose) -> tuple[float, float, float]:
    return pose.x_m, pose.y_m, pose.heading_rad
