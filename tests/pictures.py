"""Sample pictures and what to look for in them, shared by the tests of the report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from swathe.grid import GridGeometry
from swathe.report.map import MapPicture

if TYPE_CHECKING:
    from pathlib import Path


def hills(rows: int, columns: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    row, column = np.mgrid[:rows, :columns]
    heights: np.ndarray[Any, np.dtype[np.float32]] = (8 * np.sin(row / 9) + 6 * np.cos(column / 11)).astype(np.float32)
    return heights


def picture_of(rows: int = 40, columns: int = 60, **changes: Any) -> MapPicture:
    geometry = GridGeometry(rows, columns, 10.0, 500_000.0, 5_000_000.0)
    heights = hills(rows, columns)
    rank = (2 + (heights - heights.min()) % 9).astype(np.uint8)
    x_m = np.linspace(geometry.west_m, geometry.east_m, 12)[1:-1]
    y_m = np.linspace(geometry.south_m, geometry.north_m, 12)[1:-1]
    route = np.column_stack([x_m, y_m])
    values: dict[str, Any] = {
        "geometry": geometry,
        "elevation_m": heights,
        "rank": rank,
        "title": "Route found",
        "route_xy_m": route,
        "start_xy_m": (float(x_m[0]), float(y_m[0])),
        "goal_xy_m": (float(x_m[-1]), float(y_m[-1])),
    }
    return MapPicture(**{**values, **changes})


def route_profile(legs: int = 6) -> dict[str, Any]:
    distance_m = np.linspace(0, 3000, 200)
    boundaries = np.linspace(0, 3000, legs + 1)
    return {
        "distance_m": distance_m,
        "elevation_m": 100 + 20 * np.sin(distance_m / 400),
        "leg_distance_m": boundaries,
        "leg_grade": np.linspace(-0.2, 0.2, legs),
        "leg_speed_mps": np.full(legs, 0.7),
        "leg_soil": ["sand", "sand", "clay", "silt", "rock", "something else"][:legs],
        "grade_up_limit": 0.25,
        "grade_down_limit": 0.3,
        "title": "Profile",
    }


def pixels(path: Path) -> np.ndarray[Any, np.dtype[np.int16]]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.int16)


def pixels_near(path: Path, colour: tuple[int, ...]) -> int:
    return int((np.abs(pixels(path) - np.array(colour)).max(axis=2) < 12).sum())
