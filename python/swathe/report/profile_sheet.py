"""Drawing the profile: three panels over one distance axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, MaxNLocator

from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save
from swathe.report.palette import (
    FAINT_INK_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    ROUTE_COLOUR,
    SOIL_COLOURS,
    SPEED_COLOUR,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

_WIDTH_IN = 10.6
_LEFT_IN = 0.75
_RIGHT_IN = 0.3
_ELEVATION_IN = 1.9
_SOIL_IN = 0.16
_GRADE_IN = 1.05
_SPEED_IN = 0.8
_GAP_IN = 0.2
_BOTTOM_IN = 0.55
# A flat route would otherwise show its centimetres as mountains.
_LEAST_HEIGHT_SPAN_M = 5.0
_METRES_PER_KM = 1000.0


@dataclass(frozen=True)
class Profile:
    """One route as it is drawn; the fields are those of ``draw_profile``."""

    distance_m: NDArray[np.float64]
    elevation_m: NDArray[np.float64]
    leg_distance_m: NDArray[np.float64]
    leg_grade: NDArray[np.float64]
    leg_speed_mps: NDArray[np.float64]
    leg_soil: tuple[str, ...]
    grade_up_limit: float
    grade_down_limit: float
    title: str

    @property
    def length_m(self) -> float:
        """Length of the route, 0 where there is none."""
        ends = [float(values[-1]) for values in (self.distance_m, self.leg_distance_m) if len(values)]
        return max(ends, default=0.0)


def draw_sheet(path: Path | str, profile: Profile, metadata: Mapping[str, str]) -> None:
    """Draw ``profile`` as PNG at ``path``."""
    subtitle = _subtitle(profile)
    heading_in = heading_height_in(_WIDTH_IN, _LEFT_IN, profile.title, subtitle)
    inner_in = _ELEVATION_IN + _SOIL_IN + _GRADE_IN + _SPEED_IN + 2 * _GAP_IN
    height_in = heading_in + inner_in + _BOTTOM_IN
    wide_in = _WIDTH_IN - _LEFT_IN - _RIGHT_IN
    with drawing(_WIDTH_IN, height_in) as figure:
        add_heading(figure, _LEFT_IN, profile.title, subtitle)
        top_in = top_of_panels_in = height_in - heading_in
        panels = []
        for panel_in, gap_in in ((_ELEVATION_IN, 0.0), (_SOIL_IN, _GAP_IN), (_GRADE_IN, _GAP_IN), (_SPEED_IN, 0.0)):
            top_in -= panel_in
            panels.append(add_axes_in(figure, _LEFT_IN, top_in, wide_in, panel_in))
            top_in -= gap_in
        elevation, soil, grade, speed = panels
        _draw_elevation(elevation, profile)
        _draw_soil(soil, profile, key_at_in=top_of_panels_in + 0.15)
        _draw_grade(grade, profile)
        _draw_speed(speed, profile)
        for axes in panels:
            axes.set_xlim(0, profile.length_m or 1.0)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
        in_km = profile.length_m >= 2 * _METRES_PER_KM
        scale = _METRES_PER_KM if in_km else 1.0
        for axes in (elevation, soil, grade):
            axes.tick_params(labelbottom=False, bottom=axes is not soil)
        speed.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
        if in_km:
            # Locate round kilometres, not round metres.
            speed.xaxis.set_major_formatter(FuncFormatter(lambda place, _: f"{place / scale:g}"))
        for axes in (elevation, grade):
            axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
            axes.grid(axis="both", color="#e4e6ea", linewidth=0.6)
        speed.grid(axis="both", color="#e4e6ea", linewidth=0.6)
        speed.set_xlabel(f"distance along the route in {'km' if in_km else 'm'}", fontsize=8)
        save(figure, path, metadata)


def _subtitle(profile: Profile) -> str:
    known = profile.elevation_m[np.isfinite(profile.elevation_m)]
    if profile.length_m == 0:
        return "A route of 0 m: the start is the goal."
    if not len(known):
        return "No height along the route is known."
    return f"heights from {known.min():,.0f} to {known.max():,.0f} m"


def _draw_elevation(axes: Axes, profile: Profile) -> None:
    axes.set_ylabel("height in m", fontsize=8)
    axes.set_axisbelow(True)
    known = profile.elevation_m[np.isfinite(profile.elevation_m)]
    if not len(known):
        axes.set_yticks([])
        axes.text(0.5, 0.5, "not known", transform=axes.transAxes, ha="center", va="center", color=FAINT_INK_COLOUR)
        return
    low, high = float(known.min()), float(known.max())
    span = max(high - low, _LEAST_HEIGHT_SPAN_M)
    middle = (low + high) / 2
    axes.set_ylim(middle - span * 0.58, middle + span * 0.58)
    axes.fill_between(
        profile.distance_m, profile.elevation_m, middle - span, color=ROUTE_COLOUR, alpha=0.10, linewidth=0
    )
    axes.plot(profile.distance_m, profile.elevation_m, color=ROUTE_COLOUR, linewidth=1.7, solid_joinstyle="round")
    if profile.length_m == 0:
        axes.plot([0], [known[0]], "o", color=ROUTE_COLOUR, clip_on=False)
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def _draw_soil(axes: Axes, profile: Profile, *, key_at_in: float) -> None:
    """Draw a band of soil colours, and the names of the soils that occur at the right above the profile."""
    axes.set_yticks([])
    axes.set_ylim(0, 1)
    axes.spines["left"].set_visible(False)
    axes.spines["bottom"].set_visible(False)
    axes.text(
        -0.006, 0.5, "soil", transform=axes.transAxes, ha="right", va="center", fontsize=8, color=FAINT_INK_COLOUR
    )
    for begin, end, soil in _runs(profile):
        axes.add_patch(Rectangle((begin, 0.08), end - begin, 0.74, facecolor=_soil_colour(soil), edgecolor="none"))
    figure = axes.get_figure(root=True)
    if figure is None:
        return
    width_in, height_in = (float(side) for side in figure.get_size_inches())
    right_in = width_in - _RIGHT_IN
    present = [soil for soil in SOIL_COLOURS if soil in profile.leg_soil]
    present += sorted(set(profile.leg_soil) - set(SOIL_COLOURS))
    for soil in reversed(present):
        right_in -= 0.075 * len(soil) + 0.1
        figure.text(right_in / width_in, key_at_in / height_in, soil, fontsize=8, va="center")
        right_in -= 0.2
        swatch = Rectangle(
            (right_in / width_in, (key_at_in - 0.06) / height_in),
            0.15 / width_in,
            0.12 / height_in,
            transform=figure.transFigure,
        )
        swatch.set(facecolor=_soil_colour(soil), edgecolor="none")
        figure.add_artist(swatch)
        right_in -= 0.12


def _soil_colour(soil: str) -> str:
    return SOIL_COLOURS.get(soil, SOIL_COLOURS["unknown"])


def _runs(profile: Profile) -> list[tuple[float, float, str]]:
    """Return (begin, end, soil) with neighbouring legs of one soil joined."""
    runs: list[tuple[float, float, str]] = []
    for begin, end, soil in zip(
        profile.leg_distance_m[:-1], profile.leg_distance_m[1:], profile.leg_soil, strict=False
    ):
        if runs and runs[-1][2] == soil:
            runs[-1] = (runs[-1][0], float(end), soil)
        else:
            runs.append((float(begin), float(end), soil))
    return runs


def _draw_grade(axes: Axes, profile: Profile) -> None:
    """Draw the grade of each leg between the vehicle's limits, in per cent."""
    axes.set_ylabel("grade in %", fontsize=8)
    axes.set_axisbelow(True)
    up, down = 100 * profile.grade_up_limit, -100 * profile.grade_down_limit
    steepest = np.nan_to_num(100 * profile.leg_grade)
    axes.set_ylim(min([down, *steepest]) * 1.18, max([up, *steepest]) * 1.18)
    for limit in (up, down):
        axes.axhline(limit, color=LIMIT_COLOUR, linewidth=1.0, linestyle=(0, (5, 3)))
        axes.annotate(
            f"limit {limit:+.0f} %".replace("-", "\N{MINUS SIGN}"),
            (1, limit),
            xycoords=("axes fraction", "data"),
            xytext=(-3, -3 if limit > 0 else 3),
            textcoords="offset points",
            ha="right",
            va="top" if limit > 0 else "bottom",
            fontsize=7.5,
            color=LIMIT_COLOUR,
        )
    axes.axhline(0, color=FAINT_INK_COLOUR, linewidth=0.6)
    if len(profile.leg_grade):
        axes.stairs(
            100 * profile.leg_grade, profile.leg_distance_m, baseline=0, fill=True, color=ROUTE_COLOUR, alpha=0.28
        )
        axes.stairs(100 * profile.leg_grade, profile.leg_distance_m, baseline=None, color=ROUTE_COLOUR, linewidth=1.1)
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _draw_speed(axes: Axes, profile: Profile) -> None:
    axes.set_ylabel("speed in m/s", fontsize=8)
    axes.set_axisbelow(True)
    fastest = float(np.nan_to_num(profile.leg_speed_mps).max()) if len(profile.leg_speed_mps) else 0.0
    axes.set_ylim(0, fastest * 1.2 or 1.0)
    if len(profile.leg_speed_mps):
        axes.stairs(
            profile.leg_speed_mps, profile.leg_distance_m, baseline=0, fill=True, color=SPEED_COLOUR, alpha=0.22
        )
        axes.stairs(profile.leg_speed_mps, profile.leg_distance_m, baseline=None, color=SPEED_COLOUR, linewidth=1.3)
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axes.tick_params(axis="x", colors=INK_COLOUR)
