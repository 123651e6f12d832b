"""Drawn worlds as a picture: share reached and time taken against the density of crates, for every vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swathe import trials
from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save
from swathe.report.palette import FAINT_INK_COLOUR, INK_COLOUR, LIMIT_COLOUR, SPEED_COLOUR

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

_LEFT_IN, _RIGHT_IN, _BOTTOM_IN, _GAP_IN = 0.85, 0.2, 0.5, 0.2
_EACH_IN, _SHARE_IN, _TIME_IN, _NAME_IN = 1.85, 1.5, 1.9, 0.28
_PARTS = 6
_RATIOS = (1.0, 40.0)
_GRID_COLOUR = "#e3e5ea"


def draw(path: Path, rows: Sequence[trials.Row]) -> None:
    """Draw a column for every vehicle: above the share reached with Wilson's band, below the time of every drive."""
    passable = [row for row in rows if row.shortest_m is not None]
    vehicles = [name for name in dict.fromkeys(trials.VEHICLES) if any(row.vehicle == name for row in passable)]
    title = f"{len(rows)} drawn worlds, {len(passable)} of them passable"
    subtitle = (
        "Above: share of passable worlds reached by density, with 95 % bands. Below: time over the shortest true way "
        "at full speed of every drive that reached its goal (red: among what moves), and the median."
    )
    width_in = _LEFT_IN + _RIGHT_IN + _EACH_IN * len(vehicles) + _GAP_IN * (len(vehicles) - 1)
    heading_in = heading_height_in(width_in, _LEFT_IN, title, subtitle)
    height_in = heading_in + _NAME_IN + _SHARE_IN + _GAP_IN + _TIME_IN + _BOTTOM_IN
    with drawing(width_in, height_in) as figure:
        add_heading(figure, _LEFT_IN, title, subtitle)
        for number, vehicle in enumerate(vehicles):
            left_in = _LEFT_IN + number * (_EACH_IN + _GAP_IN)
            share = add_axes_in(figure, left_in, _BOTTOM_IN + _TIME_IN + _GAP_IN, _EACH_IN, _SHARE_IN)
            time = add_axes_in(figure, left_in, _BOTTOM_IN, _EACH_IN, _TIME_IN)
            own = [row for row in passable if row.vehicle == vehicle]
            share.set_title(f"{vehicle} ({len(own)})", fontsize=9, color=INK_COLOUR, pad=5)
            _draw_share(share, own)
            _draw_time(time, own)
            for axes in (share, time):
                axes.set_xlim(*trials.DENSITIES)
                axes.set_xticks(np.linspace(*trials.DENSITIES, _PARTS // 2 + 1))
                axes.spines[["top", "right"]].set_visible(False)
                axes.grid(color=_GRID_COLOUR, lw=0.6)
                axes.set_axisbelow(True)
                if number:
                    axes.tick_params(labelleft=False)
            share.tick_params(labelbottom=False)
            if not number:
                share.set_ylabel("reached")
                time.set_ylabel("time ratio")
            if number == len(vehicles) // 2:
                time.set_xlabel("crates per 100 m²")
        save(figure, path, {})


def _parts(rows: Sequence[trials.Row]) -> list[tuple[float, list[trials.Row]]]:
    """Return the rows in equal parts of the densities, each with its middle; empty parts are left out."""
    edges = np.linspace(*trials.DENSITIES, _PARTS + 1)
    parts = np.clip(np.searchsorted(edges, [row.density for row in rows], side="right") - 1, 0, _PARTS - 1)
    found = [
        (float(edges[part] + edges[part + 1]) / 2, [row for row, own in zip(rows, parts, strict=True) if own == part])
        for part in range(_PARTS)
    ]
    return [(middle, part) for middle, part in found if part]


def _draw_share(axes: Axes, rows: Sequence[trials.Row]) -> None:
    parts = _parts(rows)
    middles = [middle for middle, _ in parts]
    counts = [(sum(row.status == "reached" for row in part), len(part)) for _, part in parts]
    bands = np.array([trials.wilson(reached, count) for reached, count in counts]).reshape(-1, 2)
    axes.fill_between(middles, bands[:, 0], bands[:, 1], color=SPEED_COLOUR, alpha=0.2, lw=0)
    axes.plot(middles, [reached / count for reached, count in counts], "o-", color=SPEED_COLOUR, lw=1.4, ms=3.5)
    axes.set_ylim(0, 1.04)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0", "25 %", "50 %", "75 %", "100 %"])


def _draw_time(axes: Axes, rows: Sequence[trials.Row]) -> None:
    reached = [row for row in rows if row.status == "reached" and row.time_ratio is not None]
    for moves, colour in ((False, FAINT_INK_COLOUR), (True, LIMIT_COLOUR)):
        shown = [row for row in reached if (row.kind == "moving") == moves]
        ratios = np.clip([row.time_ratio or 1.0 for row in shown], *_RATIOS)
        axes.plot([row.density for row in shown], ratios, "o", color=colour, ms=3.0, alpha=0.6, mew=0, clip_on=False)
    parts = _parts(reached)
    medians = [float(np.median([row.time_ratio or 1.0 for row in part])) for _, part in parts]
    axes.plot([middle for middle, _ in parts], medians, "-", color=INK_COLOUR, lw=1.6)
    axes.set_yscale("log")
    axes.set_ylim(*_RATIOS)
    axes.set_yticks([1, 2, 5, 10, 20, 40], ["1", "2", "5", "10", "20", "40"])
    axes.minorticks_off()
