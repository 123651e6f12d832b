"""Ticks and scale: round numbers along the edges of the map and under its scale bar."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from swathe.grid import GridGeometry

    LonLatOf = Callable[[NDArray[np.float64], NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]

_METRES_PER_KM = 1000.0
# Below this side degrees would need so many decimals that metres say more.
_SMALLEST_DEGREE_MAP_M = 400.0
_INCHES_PER_TICK = 1.6


def round_step(span: float, about: float) -> float:
    """Return the 1, 2 or 5 times a power of ten that splits ``span`` into about ``about`` parts."""
    if not (span > 0 and math.isfinite(span)):
        return 1.0
    raw = span / max(about, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    # The last entry catches rounding in the logarithm.
    return next((factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999), 10 * power)


def round_below(limit: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not above ``limit`` (which is above zero)."""
    power = 10.0 ** math.floor(math.log10(limit))
    return next((factor * power for factor in (5, 2, 1) if factor * power <= limit * 1.001), power)


def distance_label(length_m: float) -> str:
    """Return a round length with its unit: 350 m, 2 km, 0.5 m."""
    if length_m >= _METRES_PER_KM:
        return f"{length_m / _METRES_PER_KM:g} km"
    return f"{length_m:g} m"


def label_edges(axes: Axes, geometry: GridGeometry, lonlat_of: LonLatOf | None) -> None:
    """Put ticks on the west and south edge: degrees where the frame has them, else distances from the south-west."""
    width_m = geometry.east_m - geometry.west_m
    height_m = geometry.north_m - geometry.south_m
    box = axes.get_position()
    figure_width, figure_height = axes.get_figure(root=True).get_size_inches()  # type: ignore[union-attr]
    across = max(box.width * figure_width / _INCHES_PER_TICK, 1)
    up = max(box.height * figure_height / _INCHES_PER_TICK, 1)
    if lonlat_of is not None and min(width_m, height_m) >= _SMALLEST_DEGREE_MAP_M:
        along_x = np.linspace(geometry.west_m, geometry.east_m, 65)
        along_y = np.linspace(geometry.south_m, geometry.north_m, 65)
        lon, _ = lonlat_of(along_x, np.full_like(along_x, geometry.south_m))
        _, lat = lonlat_of(np.full_like(along_y, geometry.west_m), along_y)
        if _rises(lon) and _rises(lat):
            axes.set_xticks(*_degree_ticks(along_x, lon, across, "EW"))
            axes.set_yticks(*_degree_ticks(along_y, lat, up, "NS"))
            return
    for span_m, start_m, about, place in (
        (width_m, geometry.west_m, across, axes.set_xticks),
        (height_m, geometry.south_m, up, axes.set_yticks),
    ):
        step = round_step(span_m, about)
        offsets = np.arange(0, span_m + step * 1e-6, step)
        in_km = step >= _METRES_PER_KM / 2
        place(start_m + offsets, [f"{offset / _METRES_PER_KM if in_km else offset:g}" for offset in offsets])
        unit = "km" if in_km else "m"
        if place == axes.set_xticks:
            axes.set_xlabel(f"{unit} from the west edge", fontsize=7.5)
        else:
            axes.set_ylabel(f"{unit} from the south edge", fontsize=7.5)


def _rises(values: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(values).all() and (np.diff(values) > 0).all())


def _degree_ticks(
    along_m: NDArray[np.float64], degrees: NDArray[np.float64], about: float, signs: str
) -> tuple[list[float], list[str]]:
    step = round_step(float(degrees[-1] - degrees[0]), about)
    first = math.ceil(degrees[0] / step)
    last = math.floor(degrees[-1] / step)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    marks = [index * step for index in range(first, last + 1)]
    places = np.interp(marks, degrees, along_m)
    names = [f"{abs(mark):.{decimals}f}° {signs[0] if mark >= 0 else signs[1]}" for mark in marks]
    return [float(place) for place in places], names
