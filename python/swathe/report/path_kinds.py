"""One picture of several ways between the same places: a panel for each map, a close-up where they differ most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from swathe.report.figure import DPI, add_axes_in, add_heading, drawing, save
from swathe.report.palette import INK_COLOUR
from swathe.report.relief import draw_relief

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from swathe.grid import GridGeometry

#: Told apart by readers with any colour vision, and on green and brown ground.
COLOURS = ("#e69f00", "#0072b2", "#cc2a8a", "#000000")
_SIDE_IN, _GAP_IN, _LEGEND_IN, _TOP_IN = 5.2, 0.35, 1.25, 0.85


@dataclass(frozen=True)
class Way:
    """A way to draw: its name, vertices in map metres, (n, 2), and what is written beside its name."""

    name: str
    xy_m: NDArray[np.float64]
    figures: str


@dataclass(frozen=True)
class Panel:
    """A map with its ways. Layers have the shape of ``geometry``; at most four ways."""

    title: str
    geometry: GridGeometry
    elevation_m: NDArray[np.float32]
    rank: NDArray[np.uint8]
    ways: Sequence[Way]


def draw_path_kinds(path: Path | str, title: str, subtitle: str, panels: Sequence[Panel]) -> None:
    """Draw each panel's map above a close-up of the place where its ways lie farthest apart.

    Raises:
        OutputError: the file cannot be written.
    """
    width_in = len(panels) * (_SIDE_IN + _GAP_IN) + _GAP_IN
    height_in = _TOP_IN + 2 * (_SIDE_IN + _GAP_IN) + _LEGEND_IN
    with drawing(width_in, height_in) as figure:
        add_heading(figure, _GAP_IN, title, subtitle)
        for number, panel in enumerate(panels):
            left_in = _GAP_IN + number * (_SIDE_IN + _GAP_IN)
            above = add_axes_in(figure, left_in, _LEGEND_IN + _SIDE_IN + _GAP_IN, _SIDE_IN, _SIDE_IN)
            below = add_axes_in(figure, left_in, _LEGEND_IN, _SIDE_IN, _SIDE_IN)
            _draw(above, panel, 1.5)
            _draw(below, panel, 2.0)
            above.set_title(panel.title, loc="left", fontsize=9.5)
            _frame(above, _whole(panel))
            part = _where_they_differ(panel)
            _frame(below, part)
            west_m, east_m, south_m, north_m = part
            above.add_patch(
                Rectangle((west_m, south_m), east_m - west_m, north_m - south_m, fill=False, color=INK_COLOUR, zorder=9)
            )
            lines = [f"{way.name}: {way.figures}" for way in panel.ways]
            for place, (line, colour) in enumerate(zip(lines, COLOURS, strict=False)):
                y_in = _LEGEND_IN - 0.25 - 0.24 * place
                figure.text(left_in / width_in, y_in / height_in, "━━", color=colour, va="center", fontsize=11)
                figure.text((left_in + 0.42) / width_in, y_in / height_in, line, va="center", fontsize=8.5)
        save(figure, path, {"Title": title})


def _draw(axes: Axes, panel: Panel, width: float) -> None:
    pixels = round(_SIDE_IN * DPI)
    image, rows, columns = draw_relief(
        panel.rank, panel.elevation_m, None, cell_size_m=panel.geometry.cell_size_m, target_shape=(pixels, pixels)
    )
    shown = panel.geometry.window(0, 0, rows, columns)
    axes.imshow(image, extent=(shown.west_m, shown.east_m, shown.south_m, shown.north_m), interpolation="antialiased")
    for place, (way, colour) in enumerate(zip(panel.ways, COLOURS, strict=False)):
        # Later ways are thinner, so that one that lies on another hides nothing.
        stroke = width * (2.2 - 0.4 * place)
        casing = [withStroke(linewidth=stroke + 1.2, foreground="white", alpha=0.7)] if place == 0 else []
        axes.plot(*way.xy_m.T, color=colour, linewidth=stroke, path_effects=casing, zorder=3 + place)
    ends = panel.ways[0].xy_m[[0, -1]]
    axes.plot(*ends.T, "o", markersize=6, color="white", markeredgecolor=INK_COLOUR, zorder=8)
    axes.set_xticks([])
    axes.set_yticks([])


def _frame(axes: Axes, part: tuple[float, float, float, float]) -> None:
    axes.set_xlim(part[0], part[1])
    axes.set_ylim(part[2], part[3])


def _square(centre_m: NDArray[np.float64], side_m: float) -> tuple[float, float, float, float]:
    x_m, y_m = (float(value) for value in centre_m)
    return x_m - side_m / 2, x_m + side_m / 2, y_m - side_m / 2, y_m + side_m / 2


def _whole(panel: Panel) -> tuple[float, float, float, float]:
    points = np.vstack([way.xy_m for way in panel.ways])
    low, high = points.min(axis=0), points.max(axis=0)
    return _square((low + high) / 2, 1.15 * float((high - low).max()))


def _where_they_differ(panel: Panel) -> tuple[float, float, float, float]:
    """Return the square around the vertex that lies farthest from the second way, a quarter of the whole."""
    reference = _dense(panel.ways[min(1, len(panel.ways) - 1)].xy_m)
    west_m, east_m, *_ = _whole(panel)
    centre, apart_m = reference[len(reference) // 2], -1.0
    for way in panel.ways:
        points = _dense(way.xy_m)
        gaps_m = np.array([np.hypot(*(reference - point).T).min() for point in points])
        if gaps_m.max() > apart_m:
            centre, apart_m = points[int(gaps_m.argmax())], float(gaps_m.max())
    return _square(centre, (east_m - west_m) / 4)


def _dense(xy_m: NDArray[np.float64], pieces: int = 400) -> NDArray[np.float64]:
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))])
    places = np.linspace(0, along[-1], pieces)
    return np.column_stack([np.interp(places, along, xy_m[:, axis]) for axis in (0, 1)])
