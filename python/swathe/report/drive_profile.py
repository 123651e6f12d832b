"""A drive over time: how fast it was, how near to obstacles, how it turned, and what happened when."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from swathe.episode import STATUSES
from swathe.report.drive_map import MARKS
from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save, with_halo
from swathe.report.palette import FAINT_INK_COLOUR, INK_COLOUR, LIMIT_COLOUR, ROUTE_COLOUR, SEEN_COLOUR, SPEED_COLOUR

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from swathe.report.drive import Drive

_WIDTH_IN = 10.6
_LEFT_IN = 0.75
_RIGHT_IN = 0.3
_SPEED_IN, _CLEARANCE_IN, _TURN_IN, _STATUS_IN = 1.5, 1.3, 0.85, 0.17
_GAP_IN, _BOTTOM_IN = 0.2, 0.55
#: Beyond this a clearance says nothing about a drive.
_MOST_CLEARANCE_M = 5.0
_STATUS_COLOURS = {
    "driving": "#cfe3df",
    "recovering": "#f2c46d",
    "reached": "#3f9c63",
    "stopped": "#8a8d94",
    "no_route": "#8a8d94",
    "fault": "#c2414c",
}
#: Events that get a line across: a part of their kinds, the line's colour, its name in the key.
_MARKED = (
    *((part, colour, name) for part, _, colour, name in MARKS),
    ("fault", LIMIT_COLOUR, "fault begins or ends"),
)
#: Widths of the samples of a band and of a line in the key.
_BAND_IN, _LINE_IN = 0.16, 0.02


def draw_profile(path: Path | str, drive: Drive, metadata: Mapping[str, str]) -> None:
    """Draw speed, clearance and turning over time as PNG at ``path``.

    Raises:
        OutputError: the file cannot be written.
    """
    title, subtitle = "The drive over time", drive.subtitle
    heading_in = heading_height_in(_WIDTH_IN, _LEFT_IN, title, subtitle)
    height_in = heading_in + _STATUS_IN + _SPEED_IN + _CLEARANCE_IN + _TURN_IN + 3 * _GAP_IN + _BOTTOM_IN
    wide_in = _WIDTH_IN - _LEFT_IN - _RIGHT_IN
    with drawing(_WIDTH_IN, height_in) as figure:
        add_heading(figure, _LEFT_IN, title, subtitle)
        top_in, panels = height_in - heading_in, []
        for panel_in in (_STATUS_IN, _SPEED_IN, _CLEARANCE_IN, _TURN_IN):
            top_in -= panel_in
            panels.append(add_axes_in(figure, _LEFT_IN, top_in, wide_in, panel_in))
            top_in -= _GAP_IN
        status, speed, clearance, turn = panels
        _draw_status(status, drive)
        _draw_speed(speed, drive)
        _draw_clearance(clearance, drive)
        _draw_turn(turn, drive)
        for axes in panels:
            axes.set_xlim(drive.start_s, max(drive.end_s, drive.start_s + 0.1))
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
            axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
            axes.tick_params(labelbottom=axes is turn, bottom=axes is not status)
        for axes in panels[1:]:
            axes.set_axisbelow(True)
            axes.grid(axis="both", color="#e4e6ea", linewidth=0.6)
            _mark_events(axes, drive)
        turn.set_xlabel("time in s", fontsize=8)
        turn.tick_params(axis="x", colors=INK_COLOUR)
        save(figure, path, metadata)


def _draw_status(axes: Axes, drive: Drive) -> None:
    """Draw a band of the navigator's status; above it on the right the names of its colours and of the lines across."""
    axes.set_yticks([])
    axes.set_ylim(0, 1)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.text(
        -0.006, 0.5, "status", transform=axes.transAxes, ha="right", va="center", fontsize=8, color=FAINT_INK_COLOUR
    )
    commands = drive.log.commands
    if not len(commands.times_s):
        return
    ends = np.append(np.flatnonzero(np.diff(commands.status)) + 1, len(commands.status))
    begins = np.concatenate([[0], ends[:-1]])
    times_s = np.append(commands.times_s, drive.end_s)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        colour = _STATUS_COLOURS[STATUSES[int(commands.status[begin])]]
        at, width = float(times_s[begin]), float(times_s[end] - times_s[begin])
        axes.add_patch(Rectangle((at, 0.1), width, 0.8, facecolor=colour, edgecolor="none"))
    names = [
        (name.replace("_", " "), _STATUS_COLOURS[name], _BAND_IN)
        for code, name in enumerate(STATUSES)
        if (commands.status == code).any()
    ]
    names += [(name, colour, _LINE_IN) for part, colour, name in _MARKED if _times_s(drive, part)]
    _draw_names(axes, names)


def _draw_names(axes: Axes, entries: Sequence[tuple[str, str, float]]) -> None:
    figure = axes.get_figure(root=True)
    if figure is None:
        return
    width_in, height_in = (float(side) for side in figure.get_size_inches())
    right_in, y_in = width_in - _RIGHT_IN, float(axes.get_position().y1) * height_in + 0.13
    for words, colour, sample_in in reversed(entries):
        right_in -= 0.072 * len(words) + 0.08
        figure.text(right_in / width_in, y_in / height_in, words, fontsize=8, va="center")
        right_in -= sample_in + 0.06
        swatch = Rectangle((right_in / width_in, (y_in - 0.06) / height_in), sample_in / width_in, 0.12 / height_in)
        swatch.set(transform=figure.transFigure, facecolor=colour, edgecolor="none")
        figure.add_artist(swatch)
        right_in -= 0.14


def _draw_speed(axes: Axes, drive: Drive) -> None:
    commands, truth = drive.log.commands, drive.log.truth
    axes.set_ylabel("speed in m/s", fontsize=8)
    axes.step(commands.times_s, commands.speed_mps, where="post", color=FAINT_INK_COLOUR, lw=0.9, label="commanded")
    axes.plot(truth.times_s, truth.speed_mps, color=SPEED_COLOUR, lw=1.4, label="over the ground")
    axes.axhline(0, color=FAINT_INK_COLOUR, lw=0.6)
    low = float(min(truth.speed_mps.min(), commands.speed_mps.min(initial=0.0), 0.0))
    high = float(max(truth.speed_mps.max(), commands.speed_mps.max(initial=0.0), 0.1))
    axes.set_ylim(1.15 * low, 1.25 * high)
    _draw_legend(axes)


def _draw_clearance(axes: Axes, drive: Drive) -> None:
    axes.set_ylabel("clearance in m", fontsize=8)
    axes.set_ylim(0, _MOST_CLEARANCE_M)
    seen_s, seen_m = drive.clearance_seen_m
    true_s, true_m = drive.clearance_true_m
    shown = np.minimum(seen_m, 2 * _MOST_CLEARANCE_M)
    axes.plot(seen_s, shown, color=SEEN_COLOUR, lw=1.0, label="to what the scan hit")
    if np.isfinite(true_m).any():
        axes.plot(true_s, np.minimum(true_m, 2 * _MOST_CLEARANCE_M), color=INK_COLOUR, lw=1.3, label="in truth")
        at = int(np.argmin(true_m))
        if true_m[at] < _MOST_CLEARANCE_M:
            axes.plot(true_s[at], true_m[at], "o", color=INK_COLOUR, ms=4, zorder=5)
            figure = axes.annotate(
                f"{true_m[at]:.2f} m",
                (true_s[at], true_m[at]),
                xytext=(6, 5),
                textcoords="offset points",
                fontsize=8,
                fontweight="bold",
                zorder=5,
            )
            with_halo(figure)
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    _draw_legend(axes)


def _draw_turn(axes: Axes, drive: Drive) -> None:
    commands = drive.log.commands
    axes.set_ylabel("turn in °/s", fontsize=8)
    turns = np.degrees(commands.turn_rate_radps)
    axes.fill_between(commands.times_s, turns, 0, step="post", color=ROUTE_COLOUR, alpha=0.25, linewidth=0)
    axes.step(commands.times_s, turns, where="post", color=ROUTE_COLOUR, lw=0.9)
    axes.axhline(0, color=FAINT_INK_COLOUR, lw=0.6)
    most = max(10.0, float(np.abs(turns).max(initial=0.0))) * 1.15
    axes.set_ylim(-most, most)
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 3, 5, 10]))
    for y, word in ((0.93, "left"), (0.07, "right")):
        axes.text(
            0.995, y, word, transform=axes.transAxes, ha="right", va="center", fontsize=7.5, color=FAINT_INK_COLOUR
        )


def _draw_legend(axes: Axes) -> None:
    axes.legend(
        loc="upper right", ncols=2, frameon=True, framealpha=0.85, edgecolor="none", fontsize=7.5, borderpad=0.2
    )


def _mark_events(axes: Axes, drive: Drive) -> None:
    for part, colour, _ in _MARKED:
        for time_s in _times_s(drive, part):
            axes.axvline(time_s, color=colour, lw=0.9, alpha=0.7, zorder=1)


def _times_s(drive: Drive, part: str) -> list[float]:
    """Return when events happened whose kind holds ``part``."""
    return [event.time_s for event in drive.log.events if part in event.kind.lower() and math.isfinite(event.time_s)]
