"""Local avoidance by itself: a window of certainties or a scan in, a steering direction out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from swathe.sensor import Scan

CERTAINTY_MAX = 15
"""Greatest certainty that an obstacle stands in a cell."""

_DIMENSIONS = 3


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
        return self._core.steer(cells.reshape(len(cells), side * side), heading_rad, target_rad, figures)

    def histogram(self) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return density, blocked and masked sectors of the last step; sector k lies k sectors left of east."""
        return self._core.histogram()


class PlayerVfh:
    """The method with the parameters and the behaviour of Player's ``vfh`` driver."""

    def __init__(self, *, robot_radius_m: float = 0.25) -> None:
        """Make the method at rest, with the driver's default parameters.

        Raises:
            InvalidParameterError: the radius is not above 0.
        """
        if not 0 < robot_radius_m < math.inf:
            raise InvalidParameterError(f"A radius of {robot_radius_m} m is not usable.", "It must be above 0.")
        self._core = _core.PlayerVfh(robot_radius_m)

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
        return self._core.update(rows, fan, speed_mps, goal_rad, step_s)

    def histogram(self) -> NDArray[np.float64]:
        """Return the density of every sector in the last step, from the nose on counter-clockwise."""
        return self._core.histogram()
