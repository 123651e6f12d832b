"""The key of the map: the scale of ranks, the marks that this map uses, and its notes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from swathe.report.figure import wrapped
from swathe.report.palette import (
    ARC_COLOUR,
    BEST_RANK,
    FAINT_INK_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    NEST_COLOUR,
    NO_GO_RANK,
    ROUTE_CASING_COLOUR,
    ROUTE_COLOUR,
    UNKNOWN_RANK,
    WORST_RANK,
    rank_hex,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from swathe.report.map import MapPicture

_LINE_IN = 0.21
_NOTE_LINE_IN = 0.145
_SWATCH_IN = 0.19
_COLUMN_IN = 2.05
_CHARACTERS_PER_INCH = 17.5
_LINE_SAMPLES: dict[str, tuple[str, float, tuple[float, tuple[float, ...]]]] = {
    "nest": (NEST_COLOUR, 1.1, (0, ())),
    "arc": (ARC_COLOUR, 1.1, (0, (4, 2.5))),
    "swathe": (INK_COLOUR, 1.6, (0, ())),
}


def legend_height_in(picture: MapPicture, width_in: float, *, upright: bool) -> float:
    """Return the height that the key needs at this width, in inches."""
    notes = sum(note.count("\n") + 1 for note in _notes(picture, width_in)) * _NOTE_LINE_IN
    if upright:
        ranks = BEST_RANK - WORST_RANK + 1
        return 0.3 + ranks * _SWATCH_IN + 0.15 + (2 + len(_marks(picture))) * _LINE_IN + 0.15 + notes
    columns = max(int(width_in / _COLUMN_IN), 1)
    return 0.62 + math.ceil((2 + len(_marks(picture))) / columns) * _LINE_IN + 0.1 + notes


def draw_legend(axes: Axes, picture: MapPicture, width_in: float, height_in: float, *, upright: bool) -> None:
    """Draw the key into ``axes``, as a column beside the map or as a block below it."""
    axes.set_axis_off()
    axes.set_xlim(0, width_in)
    axes.set_ylim(height_in, 0)
    y_in = _rank_column(axes) if upright else _rank_row(axes)
    entries = [("no-go", rank_hex(NO_GO_RANK)), ("not known", rank_hex(UNKNOWN_RANK)), *_marks(picture)]
    columns = 1 if upright else max(int(width_in / _COLUMN_IN), 1)
    for index, (name, sample) in enumerate(entries):
        x_in = (index % columns) * _COLUMN_IN
        middle_in = y_in + (index // columns + 0.5) * _LINE_IN
        _sample(axes, x_in, middle_in, sample)
        axes.text(x_in + 0.38, middle_in, name, va="center_baseline", fontsize=8)
    y_in += math.ceil(len(entries) / columns) * _LINE_IN + (0.15 if upright else 0.1)
    for note in _notes(picture, width_in):
        axes.text(0, y_in, note, va="top", fontsize=7, color=FAINT_INK_COLOUR, linespacing=1.35)
        y_in += (note.count("\n") + 1) * _NOTE_LINE_IN


def _rank_column(axes: Axes) -> float:
    axes.text(0, 0.1, "Rank of the ground", va="center", fontsize=8.5, fontweight="bold")
    top_in = 0.3
    for place, rank in enumerate(range(BEST_RANK, WORST_RANK - 1, -1)):
        _swatch(axes, (0, top_in + place * _SWATCH_IN), (0.28, _SWATCH_IN), rank_hex(rank))
        name = {BEST_RANK: f"{BEST_RANK}  best", WORST_RANK: f"{WORST_RANK}  worst passable"}.get(rank, str(rank))
        axes.text(0.38, top_in + (place + 0.5) * _SWATCH_IN, name, va="center_baseline", fontsize=7.5)
    return top_in + (BEST_RANK - WORST_RANK + 1) * _SWATCH_IN + 0.15


def _rank_row(axes: Axes) -> float:
    axes.text(0, 0.1, "Rank of the ground", va="center", fontsize=8.5, fontweight="bold")
    for place, rank in enumerate(range(WORST_RANK, BEST_RANK + 1)):
        left_in = 1.45 + place * 0.32
        _swatch(axes, (left_in, 0), (0.32, _SWATCH_IN), rank_hex(rank))
        axes.text(left_in + 0.16, 0.29, str(rank), ha="center", va="center", fontsize=7)
    axes.text(1.45, 0.43, "worst passable", va="center", fontsize=7, color=FAINT_INK_COLOUR)
    axes.text(1.45 + 9 * 0.32, 0.43, "best", ha="right", va="center", fontsize=7, color=FAINT_INK_COLOUR)
    return 0.58


def _swatch(axes: Axes, corner_in: tuple[float, float], size_in: tuple[float, float], colour: str) -> None:
    axes.add_patch(Rectangle(corner_in, *size_in, facecolor=colour, edgecolor="none"))


def _marks(picture: MapPicture) -> list[tuple[str, str]]:
    """Return (name, sample) of the marks that this map has; the names of samples are known to ``_sample``."""
    marks = []
    if picture.has_route:
        marks.append(("route", "route"))
    if len(picture.nest_rings) > 0:
        marks.append(("nest (navigable region)", "nest"))
    if picture.arc_xy_m is not None and len(picture.arc_xy_m) > 1:
        marks.append(("arc from start to goal", "arc"))
    if picture.swathe is not None:
        marks.append(("edge of the swathe", "swathe"))
    if picture.blocked_xy_m is not None:
        marks.append(("where the way is blocked", "blocked"))
    return marks


def _sample(axes: Axes, left_in: float, middle_in: float, sample: str) -> None:
    xs = (left_in + 0.01, left_in + 0.27)
    ys = (middle_in, middle_in)
    if sample.startswith("#"):
        _swatch(axes, (left_in, middle_in - 0.065), (0.28, 0.13), sample)
        if sample == rank_hex(UNKNOWN_RANK):
            for step in range(4):
                shift = left_in + 0.02 + step * 0.07
                axes.add_line(
                    Line2D((shift, shift + 0.05), (middle_in + 0.06, middle_in - 0.06), color="#8f8f94", lw=1)
                )
    elif sample == "route":
        axes.add_line(Line2D(xs, ys, color="#c9ccd4", linewidth=5.4, solid_capstyle="round"))
        axes.add_line(Line2D(xs, ys, color=ROUTE_CASING_COLOUR, linewidth=4.6, solid_capstyle="round"))
        axes.add_line(Line2D(xs, ys, color=ROUTE_COLOUR, linewidth=2.9, solid_capstyle="round"))
    elif sample == "blocked":
        axes.add_line(
            Line2D((left_in + 0.14,), ys, color=LIMIT_COLOUR, marker="X", markersize=8, markeredgecolor="white")
        )
    else:
        colour, width, style = _LINE_SAMPLES[sample]
        axes.add_line(Line2D(xs, ys, color=colour, linewidth=width, linestyle=style))


def _notes(picture: MapPicture, width_in: float) -> list[str]:
    notes = list(picture.notes)
    if picture.swathe is not None:
        notes.append("Paler ground lies outside the swathe.")
    if picture.is_stretched:
        notes.append("Drawn wider than it is: scales along and across differ.")
    return [wrapped(note, width_in * _CHARACTERS_PER_INCH, 6) for note in notes if note.strip()]
