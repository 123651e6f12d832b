"""The map of a drive: the global route, and dotted over it the way that was driven around what no map knew."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from swathe.report.drive import last_before
from swathe.report.drive_ground import (
    draw_driven,
    draw_ground,
    draw_movers,
    draw_obstacles,
    draw_route,
    draw_seen,
    frame_axes,
)
from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save, with_halo, wrapped
from swathe.report.graticule import distance_label, round_below
from swathe.report.palette import (
    BEST_RANK,
    DRIVEN_COLOUR,
    FAINT_INK_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    NO_GO_RANK,
    OBSTACLE_COLOUR,
    ROUTE_COLOUR,
    SEEN_COLOUR,
    WORST_RANK,
    rank_hex,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes

    from swathe.report.drive import Drive

_LONG_SIDE_IN = 7.8
_LEFT_IN = 0.75
_BOTTOM_IN = 0.55
_GAP_IN = 0.3
_KEY_IN = 2.15
_LINE_IN = 0.22
#: Kinds of events (a part of the name) that get a mark: the sign, its colour, its name in the key.
MARKS = (
    ("collision", "X", LIMIT_COLOUR, "collision"),
    ("recover", "v", "#d98a00", "recovery"),
    ("reading", "D", "#2a7d3f", "soil reading"),
)


def draw_drive_map(path: Path | str, drive: Drive, metadata: Mapping[str, str]) -> None:
    """Draw the map of a drive as PNG at ``path``.

    Raises:
        OutputError: the file cannot be written.
    """
    extent = drive.extent
    ratio = (extent.east_m - extent.west_m) / (extent.north_m - extent.south_m)
    width_in, height_in = (
        (_LONG_SIDE_IN, _LONG_SIDE_IN / ratio) if ratio >= 1 else (_LONG_SIDE_IN * ratio, _LONG_SIDE_IN)
    )
    whole_in = _LEFT_IN + width_in + _GAP_IN + _KEY_IN
    heading_in = heading_height_in(whole_in, _LEFT_IN, drive.title, drive.subtitle)
    inner_in = max(height_in, 3.6 + (0.0 if drive.ground is None else 1.2))
    with drawing(whole_in, heading_in + inner_in + _BOTTOM_IN) as figure:
        top_in = inner_in + _BOTTOM_IN
        add_heading(figure, _LEFT_IN, drive.title, drive.subtitle)
        axes = add_axes_in(figure, _LEFT_IN, top_in - height_in, width_in, height_in)
        frame_axes(axes, extent)
        draw_ground(axes, drive, extent, width_in)
        draw_obstacles(axes, drive)
        draw_movers(axes, drive, drive.end_s)
        draw_seen(axes, drive.seen_m, 1.6)
        draw_route(axes, drive.route_m)
        for line in drive.log.routes[1:]:
            axes.plot(*line.points_m.T, color=ROUTE_COLOUR, lw=1.1, ls=(0, (4, 2.5)), zorder=4.2)
        draw_driven(axes, drive.driven_m)
        marks = _draw_marks(axes, drive)
        _draw_ends(axes, drive)
        axes.set_xlabel("metres east", fontsize=8)
        axes.set_ylabel("metres north", fontsize=8)
        # Northings are large: an offset above the axis would lie over the heading.
        axes.ticklabel_format(style="plain", useOffset=False)
        key = add_axes_in(figure, _LEFT_IN + width_in + _GAP_IN, top_in - inner_in, _KEY_IN, inner_in)
        _draw_key(key, drive, inner_in, marks)
        _draw_scale(axes, extent.east_m - extent.west_m, (width_in, height_in))
        save(figure, path, metadata)


def _draw_marks(axes: Axes, drive: Drive) -> list[tuple[str, str, str]]:
    """Draw where something happened that is worth a mark; return the marks that were used."""
    used = []
    for part, sign, colour, name in MARKS:
        times_s = [event.time_s for event in drive.log.events if part in event.kind.lower()]
        if part == "reading":
            times_s = [reading.time_s for reading in drive.log.readings] or times_s
        if not times_s:
            continue
        places = np.array([drive.pose_at(time_s)[:2] for time_s in times_s])
        axes.plot(*places.T, sign, color=colour, markersize=7, markeredgecolor="white", markeredgewidth=0.9, zorder=6)
        used.append((sign, colour, name))
    return used


def _draw_ends(axes: Axes, drive: Drive) -> None:
    start, end = drive.pose_at(drive.start_s)[:2], drive.pose_at(drive.end_s)[:2]
    goal = drive.goal_m
    towards = np.subtract(end if goal is None else goal, start)
    points = [(start, "Start", "o", 9.0, "#ffffff", -towards)]
    if goal is not None:
        points.append((goal, "Goal", "*", 16.0, "#ffd23f", towards))
    if (drive.log.outcome or {}).get("status") != "reached":
        points.append((end, "End", "s", 7.0, "#ffffff", np.array([0.0, -1.0])))
    for place, name, sign, size, colour, away in points:
        mark = axes.plot(*place, sign, markersize=size, zorder=8)[0]
        mark.set(markerfacecolor=colour, markeredgecolor=INK_COLOUR, markeredgewidth=1.4)
        text = axes.annotate(
            name,
            place,
            xytext=(9 if away[0] > 0 else -9, 9),
            textcoords="offset points",
            ha="left" if away[0] > 0 else "right",
            va="bottom",
            fontsize=9.5,
            fontweight="bold",
            zorder=9,
        )
        with_halo(text, 3.0)


def _draw_scale(axes: Axes, span_m: float, size_in: tuple[float, float]) -> None:
    bar_m = round_below(0.26 * span_m)
    bar = bar_m / span_m
    plate = (bar + 0.3 / size_in[0], 0.36 / size_in[1])
    left, bottom = 0.1 / size_in[0], 0.1 / size_in[1]
    for x, y, wide, high, colour, edge in (
        (left, bottom, *plate, "white", "none"),
        (left + 0.15 / size_in[0], bottom + 0.08 / size_in[1], bar, 0.05 / size_in[1], INK_COLOUR, INK_COLOUR),
    ):
        part = Rectangle((x, y), wide, high, transform=axes.transAxes, zorder=8, facecolor=colour, edgecolor=edge)
        part.set_alpha(0.85 if colour == "white" else 1.0)
        axes.add_patch(part)
    at = (left + 0.15 / size_in[0] + bar / 2, bottom + 0.17 / size_in[1])
    text = axes.text(*at, distance_label(bar_m), transform=axes.transAxes, ha="center", va="bottom", fontsize=8)
    text.set_zorder(8)


def _draw_key(axes: Axes, drive: Drive, height_in: float, marks: list[tuple[str, str, str]]) -> None:
    """Draw the key beside the map, and under it how the drive went."""
    axes.set_axis_off()
    axes.set_xlim(0, _KEY_IN)
    axes.set_ylim(height_in, 0)
    y_in = 0.1
    if drive.ground is not None:
        axes.text(0, y_in, "Rank of the ground", va="center", fontsize=8.5, fontweight="bold")
        ranks = range(WORST_RANK, BEST_RANK + 1)
        for place, rank in enumerate(ranks):
            axes.add_patch(Rectangle((place * 0.2, y_in + 0.15), 0.2, 0.16, facecolor=rank_hex(rank), edgecolor="none"))
        axes.text(0, y_in + 0.42, "2  worst passable", va="center", fontsize=7, color=FAINT_INK_COLOUR)
        axes.text(9 * 0.2, y_in + 0.42, "10  best", va="center", ha="right", fontsize=7, color=FAINT_INK_COLOUR)
        y_in += 0.72
        axes.add_patch(Rectangle((0, y_in - 0.065), 0.28, 0.13, facecolor=rank_hex(NO_GO_RANK), edgecolor="none"))
        axes.text(0.38, y_in, "no-go", va="center_baseline", fontsize=8)
        y_in += _LINE_IN
    for sample, name in _entries(drive, marks):
        is_line = sample.get_marker() in {"", "None", None}
        sample.set_data((0.02, 0.26) if is_line else (0.14,), (y_in, y_in) if is_line else (y_in,))
        axes.add_line(sample)
        axes.text(0.38, y_in, name, va="center_baseline", fontsize=8)
        y_in += _LINE_IN
    y_in += 0.18
    for line in _facts(drive):
        shown = wrapped(line, _KEY_IN * 17, 3)
        axes.text(0, y_in, shown, va="top", fontsize=7.5, color=FAINT_INK_COLOUR, linespacing=1.35)
        y_in += 0.16 * (shown.count("\n") + 1)


def _entries(drive: Drive, marks: list[tuple[str, str, str]]) -> list[tuple[Line2D, str]]:
    """Return a sample and a name for everything on this map."""
    entries = []
    if drive.route_m is not None:
        entries.append((Line2D((), (), color=ROUTE_COLOUR, lw=2.9, solid_capstyle="round"), "global route"))
    if len(drive.log.routes) > 1:
        entries.append((Line2D((), (), color=ROUTE_COLOUR, lw=1.1, ls=(0, (4, 2.5))), "route as corrected"))
    entries.append(
        (
            Line2D((), (), color=DRIVEN_COLOUR, lw=1.9, ls=(0, (0.1, 2.1)), dash_capstyle="round"),
            "driven, around obstacles",
        )
    )
    if drive.shapes:
        square = Line2D((), (), color=OBSTACLE_COLOUR, marker="s", ls="", markersize=8, markeredgecolor="#4c4944")
        entries.append((square, "obstacle, in truth"))
    if len(drive.log.movers.radii_m):
        entries.append((Line2D((), (), color="#c9a13b", marker="o", ls="", ms=8, mec="#4c4944"), "moving, at the end"))
    if len(drive.seen_m):
        entries.append((Line2D((), (), color=SEEN_COLOUR, marker="o", ls="", ms=3), "seen by the robot"))
    entries += [
        (Line2D((), (), color=colour, marker=sign, ls="", ms=7, mec="white"), name) for sign, colour, name in marks
    ]
    return entries


def _facts(drive: Drive) -> list[str]:
    runs = np.hypot(*np.diff(drive.driven_m, axis=0).T)
    facts = [f"Driven {runs.sum():,.1f} m in {drive.end_s - drive.start_s:,.0f} s."]
    _, clearance = drive.clearance_true_m
    if np.isfinite(clearance).any():
        facts.append(f"Nearest to an obstacle {clearance.min():.2f} m.")
    replans = sum(event.kind == "route" for event in drive.log.events)
    if replans:
        facts.append(f"The local route was laid {replans:,} times.")
    way = last_before(drive.log.routes, drive.end_s)
    if way is not None and len(drive.log.routes) > 1:
        facts.append(f"The global route was laid {len(drive.log.routes):,} times.")
    if drive.log.cut is not None:
        facts.append("The log was cut: the drive is shown up to there.")
    return facts
