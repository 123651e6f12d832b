"""Trials in one picture: how the runs of each way of driving ended, and how their times spread."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Patch

from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save
from swathe.report.palette import FAINT_INK_COLOUR, INK_COLOUR, SPEED_COLOUR

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_WIDTH_IN, _LEFT_IN, _RIGHT_IN = 10.6, 2.1, 0.3
_ROW_IN, _BOTTOM_IN, _GAP_IN = 0.42, 0.95, 0.35
_MOST_RATIO = 6.0
_ENDINGS = {
    "reached": ("reached", "#3f9c63"),
    "not_reached": ("given up", "#8a8d94"),
    "timeout": ("out of time", "#d9b44a"),
    "collision": ("collision", "#c2414c"),
    "no_route": ("no route to drive", "#d7d9de"),
    "not_passable": ("no true way", "#eceef1"),
}


def draw_trials(path: Path, arms: Mapping[str, Mapping[str, Any]], title: str) -> None:
    """Draw a bar for every arm: shares of its ``statuses`` (counts by status) and the spread of its ``time_ratios``.

    Raises:
        OutputError: the file cannot be written.
    """
    subtitle = "How the runs ended, and the time of those that reached the goal over the shortest true way."
    heading_in = heading_height_in(_WIDTH_IN, _LEFT_IN, title, subtitle)
    height_in = heading_in + _ROW_IN * len(arms) + _BOTTOM_IN
    half_in = (_WIDTH_IN - _LEFT_IN - _RIGHT_IN - _GAP_IN) / 2
    with drawing(_WIDTH_IN, height_in) as figure:
        add_heading(figure, _LEFT_IN, title, subtitle)
        share = add_axes_in(figure, _LEFT_IN, _BOTTOM_IN, half_in, _ROW_IN * len(arms))
        ratio = add_axes_in(figure, _LEFT_IN + half_in + _GAP_IN, _BOTTOM_IN, half_in, _ROW_IN * len(arms))
        met = [status for status in _ENDINGS if any(arm["statuses"].get(status) for arm in arms.values())]
        for row, arm in enumerate(arms.values()):
            runs, before = max(1, sum(arm["statuses"].values())), 0.0
            for status in met:
                part = arm["statuses"].get(status, 0) / runs
                share.barh(row, part, left=before, height=0.62, color=_ENDINGS[status][1])
                before += part
            times = np.clip(np.asarray(arm["time_ratios"], dtype=np.float64), 0, _MOST_RATIO)
            if times.size:
                low, first, middle, third, high = np.percentile(times, [5, 25, 50, 75, 95])
                ratio.plot([low, high], [row, row], color=FAINT_INK_COLOUR, lw=1.2, solid_capstyle="butt")
                ratio.barh(row, third - first, left=first, height=0.42, color=SPEED_COLOUR, alpha=0.55)
                ratio.plot([middle, middle], [row - 0.26, row + 0.26], color=INK_COLOUR, lw=1.8)
        for axes in (share, ratio):
            axes.set_ylim(len(arms) - 0.5, -0.5)
            axes.spines[["top", "right", "left"]].set_visible(False)
            axes.tick_params(axis="y", length=0)
        share.set_xlim(0, 1)
        share.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "25 %", "50 %", "75 %", "100 %"])
        share.set_yticks(range(len(arms)), list(arms))
        share.tick_params(axis="y", labelcolor=INK_COLOUR)
        ratio.set_yticks([])
        ratio.set_xlim(left=0)
        ratio.set_xlabel("time over the shortest way: 5, 25, 50, 75, 95 %")
        ratio.grid(axis="x", color="#e3e5ea", lw=0.6)
        ratio.set_axisbelow(True)
        figure.legend(
            handles=[Patch(color=_ENDINGS[status][1], label=_ENDINGS[status][0]) for status in met],
            loc="lower left",
            bbox_to_anchor=(_LEFT_IN / _WIDTH_IN, 0.08 / height_in),
            ncols=len(met) or 1,
            frameon=False,
            fontsize=8,
            handlelength=1.0,
            borderaxespad=0,
        )
        save(figure, path, {})
