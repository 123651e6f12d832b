"""What a robot senses: poses, scans and penetrometer readings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot is: metres, radians counter-clockwise from east; nose up and right side down are positive."""

    x_m: float
    y_m: float
    heading_rad: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Scan:
    """Ranges in a fan of directions, angles counter-clockwise from the sensor's axis.

    Attributes:
        ranges_m: one for each beam; infinite or the greatest range is clear, NaN or below the least is invalid.
        angle_min_rad: direction of the first beam.
        angle_increment_rad: from one beam to the next.
        range_min_m: least range that is measured.
        range_max_m: greatest range that is measured.
        mount: the sensor on the body: metres ahead, metres to the left, heading from the robot's nose.
    """

    ranges_m: ArrayLike
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PenetrometerReading:
    """One push of a cone penetrometer: depths in metres, rising, and the cone index in kPa at each."""

    x_m: float
    y_m: float
    depths_m: Sequence[float]
    cone_indices_kpa: Sequence[float]
    refusal_depth_m: float | None = None
