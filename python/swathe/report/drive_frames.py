"""Frames of a drive: at a few moments what the robot saw, what it made of that, and what it decided."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from swathe.episode import STATUSES
from swathe.report.drive import Extent, certainty_rgba, last_before, masked_sectors, sector_directions
from swathe.report.drive_ground import (
    draw_driven,
    draw_ground,
    draw_movers,
    draw_route,
    draw_scan,
    draw_vehicle,
    frame_axes,
)
from swathe.report.figure import add_axes_in, add_heading, drawing, heading_height_in, save, wrapped
from swathe.report.palette import (
    DRIVEN_COLOUR,
    FAINT_INK_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    LOCAL_WAY_COLOUR,
    ROUTE_COLOUR,
    SEEN_COLOUR,
    SPEED_COLOUR,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swathe.report.drive import Drive, Moment

_VIEW_IN = 2.5
_HISTOGRAM_IN = 0.72
_CAPTION_IN = 0.44
_GAP_IN = 0.3
_ROW_GAP_IN = 0.5
_LEFT_IN = 0.35
_KEY_IN = 0.42
_COLUMNS = 4
#: Half the side of what a frame shows, where the certainty window does not say.
_HALF_VIEW_M = 4.0
_DENSITY_COLOUR, _BLOCKED_COLOUR = "#7f8894", "#f3d9d5"


def draw_frames(path: Path | str, drive: Drive, metadata: Mapping[str, str], count: int = 8) -> None:
    """Draw ``count`` moments of a drive as PNG at ``path``.

    Raises:
        OutputError: the file cannot be written.
    """
    moments = drive.moments(count)
    columns = min(_COLUMNS, len(moments))
    rows = math.ceil(len(moments) / columns)
    width_in = 2 * _LEFT_IN + columns * _VIEW_IN + (columns - 1) * _GAP_IN
    histogram_in = _HISTOGRAM_IN if drive.log.histograms else 0.0
    subtitle = "What the scan hit, the certainty grid and the way, north up"
    subtitle += "; below each the polar histogram, unrolled." if histogram_in else "."
    title = "Frames of the drive"
    heading_in = heading_height_in(width_in, _LEFT_IN, title, subtitle) + 0.12
    each_in = _CAPTION_IN + _VIEW_IN + histogram_in + (_ROW_GAP_IN if histogram_in else 0.16)
    height_in = heading_in + rows * each_in + _KEY_IN
    with drawing(width_in, height_in) as figure:
        add_heading(figure, _LEFT_IN, title, subtitle)
        half_m = _half_view_m(drive)
        for place, moment in enumerate(moments):
            left_in = _LEFT_IN + place % columns * (_VIEW_IN + _GAP_IN)
            top_in = height_in - heading_in - place // columns * each_in
            _draw_caption(figure, drive, moment, (left_in, top_in))
            view = add_axes_in(figure, left_in, top_in - _CAPTION_IN - _VIEW_IN, _VIEW_IN, _VIEW_IN)
            _draw_view(view, drive, moment.time_s, half_m)
            if histogram_in:
                bottom_in = top_in - _CAPTION_IN - _VIEW_IN - histogram_in - 0.06
                _draw_histogram(add_axes_in(figure, left_in, bottom_in, _VIEW_IN, histogram_in), drive, moment.time_s)
        _draw_key(add_axes_in(figure, _LEFT_IN, 0.0, width_in - 2 * _LEFT_IN, _KEY_IN), drive)
        save(figure, path, metadata)


def _half_view_m(drive: Drive) -> float:
    """Return half the side of every frame: the certainty window's, within what can be made out."""
    sides = [max(window.certainty.shape) * window.cell_size_m / 2 for window in drive.log.maps]
    least = 2.0 * drive.length_m
    return max(least, min(max(sides, default=_HALF_VIEW_M), 12 * drive.length_m))


def _draw_caption(figure: Figure, drive: Drive, moment: Moment, corner_in: tuple[float, float]) -> None:
    width_in, height_in = (float(side) for side in figure.get_size_inches())
    left, top = corner_in[0] / width_in, corner_in[1] / height_in
    figure.text(left, top, f"{moment.time_s:.1f} s   {moment.name}", fontsize=9, fontweight="bold", va="top")
    commands = drive.log.commands
    row = int(np.searchsorted(commands.times_s, moment.time_s + 1e-9, side="right")) - 1
    told = "no command yet"
    if row >= 0:
        turn = math.degrees(float(commands.turn_rate_radps[row]))
        side = "" if abs(turn) < 0.5 else " left" if turn > 0 else " right"
        status = STATUSES[int(commands.status[row])].replace("_", " ")
        told = f"{status}: {commands.speed_mps[row]:.2f} m/s, {abs(turn):.0f}°/s{side}"
    figure.text(left, top - 0.19 / height_in, wrapped(told, 40, 1), fontsize=8, color=FAINT_INK_COLOUR, va="top")


def _draw_view(axes: Axes, drive: Drive, time_s: float, half_m: float) -> None:
    """Draw the surroundings of the robot, north up."""
    pose = drive.pose_at(time_s)
    row = drive.scan_before(time_s)
    x_m, y_m = pose[:2] if row is None else drive.believed(row)[:2]
    extent = Extent(x_m - half_m, x_m + half_m, y_m - half_m, y_m + half_m)
    frame_axes(axes, extent)
    draw_ground(axes, drive, extent, _VIEW_IN, pale=True)
    axes.tick_params(labelbottom=False, labelleft=False, length=0)
    window = last_before(drive.log.maps, time_s)
    if window is not None:
        height, width = (side * window.cell_size_m for side in window.certainty.shape)
        axes.imshow(
            certainty_rgba(window),
            extent=(window.west_m, window.west_m + width, window.north_m - height, window.north_m),
            interpolation="nearest",
            aspect="auto",
            zorder=1,
        )
        frame_axes(axes, extent)
    draw_movers(axes, drive, time_s)
    route = last_before(drive.log.routes, time_s)
    draw_route(axes, None if route is None else route.points_m, 2.0)
    way = last_before(drive.log.ways, time_s)
    if way is not None and len(way.points_m) > 1:
        axes.plot(*way.points_m.T, color=LOCAL_WAY_COLOUR, lw=1.6, zorder=5.2)
    driven = drive.driven_m[drive.log.truth.times_s <= time_s]
    draw_driven(axes, driven, 1.3)
    if row is not None:
        draw_scan(axes, drive, row)
        pose = drive.believed(row)
    draw_vehicle(axes, drive, pose)
    histogram = last_before(drive.log.histograms, time_s)
    direction = None if histogram is None else histogram.fields.get("direction_rad")
    if direction is not None:
        reach = 0.42 * half_m
        axes.annotate(
            "",
            (x_m + reach * math.cos(direction), y_m + reach * math.sin(direction)),
            (x_m, y_m),
            arrowprops={"arrowstyle": "-|>", "color": SPEED_COLOUR, "lw": 2.0, "shrinkA": 0, "shrinkB": 0},
            zorder=8,
        )


def _draw_histogram(axes: Axes, drive: Drive, time_s: float) -> None:
    """Draw the polar histogram unrolled, from behind on the left over the nose to behind on the right."""
    axes.set_xlim(180, -180)
    axes.set_xticks([180, 90, 0, -90, -180], ["", "left", "ahead", "right", ""])
    axes.set_yticks([])
    axes.tick_params(axis="x", length=2, pad=2)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    histogram = last_before(drive.log.histograms, time_s)
    densities = np.array([] if histogram is None else histogram.fields.get("densities") or [], np.float64)
    if histogram is None or not len(densities):
        axes.text(0.5, 0.5, "no histogram", transform=axes.transAxes, ha="center", va="center", color=FAINT_INK_COLOUR)
        return
    fields = histogram.fields
    heading = math.degrees(_believed_heading(drive, histogram.time_s))
    width = 360 / len(densities)
    middles = _around(np.degrees(sector_directions(fields)) - heading)
    closed = masked_sectors(fields)
    thresholds = [float(value) for value in fields.get("thresholds") or []]
    shown = np.nan_to_num(densities, posinf=0.0)
    ceiling = max([2.2 * value for value in thresholds] or [float(shown.max())]) or 1.0
    axes.set_ylim(0, ceiling)
    axes.bar(middles[closed], ceiling, width=width * 1.04, color=_BLOCKED_COLOUR, linewidth=0, zorder=1)
    axes.bar(middles, np.minimum(shown, ceiling), width=width * 0.9, color=_DENSITY_COLOUR, linewidth=0, zorder=2)
    for value in thresholds:
        axes.axhline(value, color=LIMIT_COLOUR, lw=0.9, ls=(0, (4, 2.5)), zorder=3)
    direction = fields.get("direction_rad")
    if direction is None:
        label = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
        axes.text(
            0,
            0.8 * ceiling,
            "no direction",
            ha="center",
            va="center",
            fontsize=8,
            color=LIMIT_COLOUR,
            bbox=label,
            zorder=5,
        )
    else:
        at = float(_around(np.array([math.degrees(direction) - heading]))[0])
        axes.axvline(at, color=SPEED_COLOUR, lw=2.0, zorder=4)


def _believed_heading(drive: Drive, time_s: float) -> float:
    odometry = drive.log.odometry
    row = max(int(np.searchsorted(odometry.times_s, time_s + 1e-9, side="right")) - 1, 0)
    return float(odometry.heading_rad[row])


def _around(degrees: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return angles from -180 to 180 degrees."""
    return (degrees + 180) % 360 - 180


def _draw_key(axes: Axes, drive: Drive) -> None:
    axes.set_axis_off()
    width_in = 4 * (_VIEW_IN + _GAP_IN)
    axes.set_xlim(0, width_in)
    axes.set_ylim(0, _KEY_IN)
    entries: list[tuple[Line2D | Rectangle, str]] = [
        (Line2D((), (), color=SEEN_COLOUR, marker="o", ls="", ms=3.5), "hit by the scan"),
        (Rectangle((0, 0), 0.2, 0.12, facecolor="#303036", edgecolor="none"), "closed cell"),
        (Rectangle((0, 0), 0.2, 0.12, facecolor="#ffffff", edgecolor=FAINT_INK_COLOUR, lw=0.6), "free cell"),
        (Line2D((), (), color=ROUTE_COLOUR, lw=2.2), "global route"),
        (Line2D((), (), color=LOCAL_WAY_COLOUR, lw=1.8), "local way"),
        (Line2D((), (), color=DRIVEN_COLOUR, lw=1.6, ls=(0, (0.1, 2.1)), dash_capstyle="round"), "driven"),
        (Line2D((), (), color=SPEED_COLOUR, lw=2.2), "chosen direction"),
        (Line2D((), (), color=LIMIT_COLOUR, lw=1.0, ls=(0, (4, 2.5))), "thresholds"),
        (Rectangle((0, 0), 0.2, 0.12, facecolor=_BLOCKED_COLOUR, edgecolor="none"), "closed sector"),
    ]
    unused = set() if drive.log.routes else {"global route"}
    unused |= set() if drive.log.histograms else {"chosen direction", "thresholds", "closed sector"}
    entries = [entry for entry in entries if entry[1] not in unused]
    at_in, middle_in = 0.0, 0.22
    for sample, name in entries:
        if isinstance(sample, Rectangle):
            sample.set_xy((at_in, middle_in - 0.06))
            axes.add_patch(sample)
        else:
            is_dot = sample.get_marker() == "o"
            sample.set_data((at_in + 0.1,) if is_dot else (at_in, at_in + 0.2), (middle_in,) * (1 if is_dot else 2))
            axes.add_line(sample)
        axes.text(at_in + 0.27, middle_in, name, va="center_baseline", fontsize=8, color=INK_COLOUR)
        at_in += 0.44 + 0.066 * len(name)
