"""Drawing the gain of overlapping grids: two panels with one key."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.ticker import FixedLocator, FuncFormatter

from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save
from swathe.report.figures_grids import SIDES_IN_CELLS
from swathe.report.palette import FAINT_INK_COLOUR, LIMIT_COLOUR, NEST_COLOUR, ROUTE_COLOUR, SPEED_COLOUR

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from swathe.report.figures_grids import Gain

_WIDTH_IN = 10.6
_LEFT_IN = 0.75
_RIGHT_IN = 0.3
_GAP_IN = 0.5
_PANEL_IN = 3.6
_PANEL_TITLE_IN = 0.3
_KEY_IN = 0.68
_BOTTOM_IN = 0.5
_TITLE = "What a second grid of navigation cells finds"

# One colour and mark for each setting, in their order.
_COLOURS = (LIMIT_COLOUR, FAINT_INK_COLOUR, ROUTE_COLOUR, SPEED_COLOUR, NEST_COLOUR)
_MARKS = ("v", "o", "s", "D", "^")


def draw_sheet(
    path: Path | str, corridors: Sequence[Gain], pockets: Sequence[Gain], trials: int, metadata: Mapping[str, str]
) -> None:
    """Draw the counted and exact shares as PNG at ``path``."""
    subtitle = (
        f"Share of gaps, wider than one navigation cell and at most two, in which the grids find navigable ground. "
        f"Marks: counted on {trials:,} drawn gaps each, at random places. Lines: exact."
    )
    heading_in = heading_height_in(_WIDTH_IN, _LEFT_IN, _TITLE, subtitle)
    height_in = heading_in + _PANEL_TITLE_IN + _PANEL_IN + _BOTTOM_IN + _KEY_IN
    wide_in = (_WIDTH_IN - _LEFT_IN - _RIGHT_IN - _GAP_IN) / 2
    with drawing(_WIDTH_IN, height_in) as figure:
        add_heading(figure, _LEFT_IN, _TITLE, subtitle)
        bottom_in = _KEY_IN + _BOTTOM_IN
        left = add_axes_in(figure, _LEFT_IN, bottom_in, wide_in, _PANEL_IN)
        right = add_axes_in(figure, _LEFT_IN + wide_in + _GAP_IN, bottom_in, wide_in, _PANEL_IN)
        _draw_panel(left, "Corridors: limited in width", corridors)
        _draw_panel(right, "Pockets: squares", pockets)
        left.set_ylabel("share of gaps found", fontsize=8)
        figure.legend(
            *left.get_legend_handles_labels(),
            loc="lower left",
            bbox_to_anchor=(_LEFT_IN / _WIDTH_IN, 0.12 / height_in),
            ncols=2,
            frameon=False,
            fontsize=8,
            borderaxespad=0,
            borderpad=0,
        )
        save(figure, path, metadata)


def _draw_panel(axes: Axes, title: str, gains: Sequence[Gain]) -> None:
    axes.set_title(title, loc="left", fontsize=9.5)
    axes.set_xlabel("width of the gap in navigation cells", fontsize=8)
    axes.set_axisbelow(True)
    axes.grid(axis="both", color="#e4e6ea", linewidth=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set_xlim(0.985, 2.015)
    axes.set_ylim(-0.015, 1.03)
    axes.xaxis.set_major_locator(FixedLocator([1, 1.25, 1.5, 1.75, 2]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda place, _: f"{place:g}"))
    axes.yaxis.set_major_locator(FixedLocator([0, 0.25, 0.5, 0.75, 1]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g} %"))
    for gain, colour, mark in zip(gains, _COLOURS, _MARKS, strict=True):
        axes.plot(gain.exact_sides, gain.exact, color=colour, linewidth=1.3)
        axes.plot(SIDES_IN_CELLS, gain.counted, mark, color=colour, markersize=5, markeredgewidth=0, clip_on=False)
        # What the key shows: line and mark together.
        axes.plot([], [], color=colour, linewidth=1.3, marker=mark, markersize=5, label=gain.setting.name)
