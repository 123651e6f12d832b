"""The profile along the route: height over a band of soil, grade between the vehicle's limits, and speed.

Importing this module is quick; matplotlib is loaded by the first drawing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import ShapeMismatchError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray


def draw_profile(
    path: Path | str,
    *,
    distance_m: NDArray[np.float64],
    elevation_m: NDArray[np.float64],
    leg_distance_m: NDArray[np.float64],
    leg_grade: NDArray[np.float64],
    leg_speed_mps: NDArray[np.float64],
    leg_soil: Sequence[str],
    grade_up_limit: float,
    grade_down_limit: float,
    title: str,
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Draw the profile as PNG at ``path``, replacing it in one step; equal input gives equal bytes.

    Args:
        path: the file to write.
        distance_m: distance from the start of each point of the path, rising.
        elevation_m: height of each point, NaN where unknown.
        leg_distance_m: distance from the start of every boundary between legs, first 0 and last the route's length:
            one more than there are legs.
        leg_grade: rise over run of each leg in the direction of travel, climbing positive.
        leg_speed_mps: speed on each leg.
        leg_soil: soil class name of each leg (gravel, sand, clay, silt, rock, unknown, none).
        grade_up_limit: the vehicle's limit when climbing, rise over run.
        grade_down_limit: the vehicle's limit when descending, rise over run, positive.
        title: the heading.
        metadata: text entries of the PNG.

    Raises:
        ShapeMismatchError: the arrays do not belong to one route.
        OutputError: the file cannot be written.
    """
    if len(distance_m) != len(elevation_m):
        raise ShapeMismatchError(
            f"The profile has {len(distance_m)} distances and {len(elevation_m)} heights.", "Give one height a point."
        )
    legs = len(leg_grade)
    if (len(leg_speed_mps), len(leg_soil), len(leg_distance_m)) != (legs, legs, legs + 1 if legs else 0) and not (
        legs == 0 and len(leg_speed_mps) == len(leg_soil) == 0 and len(leg_distance_m) <= 1
    ):
        raise ShapeMismatchError(
            f"The profile has {legs} grades, {len(leg_speed_mps)} speeds, {len(leg_soil)} soils and "
            f"{len(leg_distance_m)} boundaries of legs.",
            "Give one of each a leg, and one boundary more than legs.",
        )
    from swathe.report.profile_sheet import Profile, draw_sheet

    profile = Profile(
        distance_m=np.asarray(distance_m, np.float64),
        elevation_m=np.asarray(elevation_m, np.float64),
        leg_distance_m=np.asarray(leg_distance_m, np.float64),
        leg_grade=np.asarray(leg_grade, np.float64),
        leg_speed_mps=np.asarray(leg_speed_mps, np.float64),
        leg_soil=tuple(leg_soil),
        grade_up_limit=grade_up_limit,
        grade_down_limit=grade_down_limit,
        title=title,
    )
    draw_sheet(path, profile, metadata or {})
