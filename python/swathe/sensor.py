"""What a robot senses: poses, scans and penetrometer readings. Data only.

Metres, headings counter-clockwise from east in radians; beams counter-clockwise from the robot's nose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot is and how it is turned; nose up and right side down are positive."""

    x_m: float
    y_m: float
    heading_rad: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Ranges in a fan of directions.

    Infinity or at least ``range_max_m`` is clear, NaN or below ``range_min_m`` invalid. ``mount`` is (ahead, left,
    heading) of the sensor on the body.
    """

    ranges_m: NDArray[np.float64] | Sequence[float]
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PenetrometerReading:
    """One push of a cone penetrometer: cone indices in kPa at rising depths, and where it could not be pushed on."""

    x_m: float
    y_m: float
    depths_m: tuple[float, ...]
    cone_indices_kpa: tuple[float, ...]
    refusal_depth_m: float | None = None
