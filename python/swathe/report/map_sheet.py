"""Drawing the map: the ground, the lines and points on it, the scale, and the place of the legend."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon, Rectangle
from matplotlib.patheffects import withStroke

from swathe.report.figure import DPI, add_axes_in, add_heading, drawing, heading_height_in, save, with_halo
from swathe.report.graticule import distance_label, label_edges, round_below
from swathe.report.legend import draw_legend, legend_height_in
from swathe.report.map import MAX_RATIO
from swathe.report.palette import (
    ARC_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    NEST_COLOUR,
    ROUTE_CASING_COLOUR,
    ROUTE_COLOUR,
)
from swathe.report.relief import draw_relief

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from swathe.grid import GridGeometry
    from swathe.report.map import MapPicture

_LONG_SIDE_IN = 7.8  # of the map
_MIN_SIDE_IN = 1.5
_LEFT_IN = 0.85
_BOTTOM_IN = 0.55
_GAP_IN = 0.3
_LEGEND_WIDTH_IN = 2.15
_SCALE_BAR_SHARE = 0.26
# Past this many rings only those are drawn that can be made out.
_MANY_RINGS = 400
_SMALLEST_RING_SHARE = 0.012


def draw_sheet(path: Path | str, picture: MapPicture, metadata: Mapping[str, str]) -> None:
    """Draw ``picture`` with heading and legend as PNG at ``path``."""
    map_width_in, map_height_in = _map_size_in(picture.geometry)
    beside = map_width_in < map_height_in * 1.75
    width_in = _LEFT_IN + map_width_in + (_GAP_IN + _LEGEND_WIDTH_IN if beside else 0.25)
    heading_in = heading_height_in(width_in, _LEFT_IN, picture.title, picture.subtitle)
    panel_width_in = _LEGEND_WIDTH_IN if beside else map_width_in
    panel_height_in = legend_height_in(picture, panel_width_in, upright=beside)
    inner_in = max(map_height_in, panel_height_in) if beside else map_height_in + _BOTTOM_IN + panel_height_in
    height_in = heading_in + inner_in + _BOTTOM_IN if beside else heading_in + inner_in + 0.15
    top_in = height_in - heading_in

    with drawing(width_in, height_in) as figure:
        add_heading(figure, _LEFT_IN, picture.title, picture.subtitle)
        axes = add_axes_in(figure, _LEFT_IN, top_in - map_height_in, map_width_in, map_height_in)
        _draw_ground(axes, picture, (map_width_in, map_height_in))
        _draw_lines(axes, picture)
        size_in = (map_width_in, map_height_in)
        points_in = _draw_points(axes, picture, size_in)
        _draw_north(axes, size_in, points_in)
        if not picture.is_stretched:
            _draw_scale(axes, picture.geometry, size_in, points_in)
        if beside:
            panel = add_axes_in(
                figure, _LEFT_IN + map_width_in + _GAP_IN, top_in - panel_height_in, panel_width_in, panel_height_in
            )
        else:
            bottom_in = top_in - map_height_in - _BOTTOM_IN - panel_height_in
            panel = add_axes_in(figure, _LEFT_IN, bottom_in, panel_width_in, panel_height_in)
        draw_legend(panel, picture, panel_width_in, panel_height_in, upright=beside)
        save(figure, path, metadata)


def _map_size_in(geometry: GridGeometry) -> tuple[float, float]:
    """Return width and height of the map in inches; a long strip is drawn wider than it is."""
    ratio = geometry.columns / geometry.rows
    if ratio >= 1:
        return _LONG_SIDE_IN, max(_LONG_SIDE_IN / min(ratio, MAX_RATIO), _MIN_SIDE_IN)
    return max(_LONG_SIDE_IN * max(ratio, 1 / MAX_RATIO), _MIN_SIDE_IN), _LONG_SIDE_IN


def _draw_ground(axes: Axes, picture: MapPicture, size_in: tuple[float, float]) -> None:
    geometry = picture.geometry
    image, rows, columns = draw_relief(
        picture.rank,
        picture.elevation_m,
        picture.swathe,
        cell_size_m=geometry.cell_size_m,
        target_shape=(round(size_in[1] * DPI), round(size_in[0] * DPI)),
    )
    shown = geometry.window(0, 0, rows, columns)
    extent = (shown.west_m, shown.east_m, shown.south_m, shown.north_m)
    axes.imshow(image, extent=extent, aspect="auto", interpolation="antialiased", zorder=0)
    axes.set_xlim(geometry.west_m, geometry.east_m)
    axes.set_ylim(geometry.south_m, geometry.north_m)
    axes.autoscale(enable=False)
    label_edges(axes, geometry, picture.lonlat_of)
    for label in axes.get_yticklabels():
        label.set_rotation(90)
        label.set_verticalalignment("center")


def _draw_lines(axes: Axes, picture: MapPicture) -> None:
    rings = _visible_rings(picture)
    if rings:
        halo = withStroke(linewidth=2.2, foreground="white", alpha=0.5)
        axes.add_collection(
            LineCollection(rings, colors=NEST_COLOUR, linewidths=0.8, joinstyle="round", path_effects=[halo], zorder=2),
            autolim=False,
        )
    if picture.arc_xy_m is not None and len(picture.arc_xy_m) > 1:
        axes.plot(
            picture.arc_xy_m[:, 0],
            picture.arc_xy_m[:, 1],
            color=ARC_COLOUR,
            linewidth=1.1,
            linestyle=(0, (5, 3.5)),
            path_effects=[withStroke(linewidth=2.4, foreground="white", alpha=0.55)],
            zorder=3,
        )
    if picture.route_xy_m is not None and picture.has_route:
        for colour, width, zorder in ((ROUTE_CASING_COLOUR, 5.4, 4), (ROUTE_COLOUR, 2.9, 5)):
            axes.plot(
                picture.route_xy_m[:, 0],
                picture.route_xy_m[:, 1],
                color=colour,
                linewidth=width,
                solid_joinstyle="round",
                solid_capstyle="round",
                zorder=zorder,
            )


def _visible_rings(picture: MapPicture) -> list[NDArray[np.float64]]:
    rings = [np.asarray(ring, np.float64) for ring in picture.nest_rings if len(ring) > 1]
    if len(rings) <= _MANY_RINGS:
        return rings
    geometry = picture.geometry
    smallest_m = _SMALLEST_RING_SHARE * max(geometry.rows, geometry.columns) * geometry.cell_size_m
    return [ring for ring in rings if np.ptp(ring, axis=0).max() >= smallest_m]


def _draw_points(axes: Axes, picture: MapPicture, size_in: tuple[float, float]) -> list[tuple[float, float]]:
    """Draw and name the points; return where they lie, in inches from the lower left corner of the map."""
    route = picture.route_xy_m
    away_from = [(0.0, 0.0), (0.0, 0.0)]
    if route is not None and len(route) > 1:
        # The direction over the first and last twentieth of the way: single steps of a grid route say little.
        some = max(1, len(route) // 20)
        away_from = [tuple(route[some] - route[0]), tuple(route[-1 - some] - route[-1])]
    places_in = []
    for xy_m, name, marker, size, colour, away in (
        (picture.blocked_xy_m, "blocked here", "X", 11.0, LIMIT_COLOUR, (0.0, 0.0)),
        (picture.start_xy_m, "Start", "o", 9.0, "#ffffff", away_from[0]),
        (picture.goal_xy_m, "Goal", "*", 16.0, "#ffd23f", away_from[1]),
    ):
        if xy_m is None:
            continue
        mark = axes.plot(*xy_m, marker, markersize=size, zorder=7)[0]
        edge = "white" if marker == "X" else INK_COLOUR
        mark.set(markerfacecolor=colour, markeredgecolor=edge, markeredgewidth=1.4)
        place_in = _place_in(picture.geometry, xy_m, size_in)
        # Without a direction the start is named below its mark and the goal above: they may be one point.
        towards = (away[0], away[1] or (1.0 if name == "Start" else -1.0))
        _label_point(axes, xy_m, name, place_in=place_in, size_in=size_in, away_from=towards)
        places_in.append(place_in)
    return places_in


def _place_in(geometry: GridGeometry, xy_m: tuple[float, float], size_in: tuple[float, float]) -> tuple[float, float]:
    right = (xy_m[0] - geometry.west_m) / (geometry.east_m - geometry.west_m)
    up = (xy_m[1] - geometry.south_m) / (geometry.north_m - geometry.south_m)
    return right * size_in[0], up * size_in[1]


def _label_point(
    axes: Axes,
    xy_m: tuple[float, float],
    name: str,
    *,
    place_in: tuple[float, float],
    size_in: tuple[float, float],
    away_from: tuple[float, float],
) -> None:
    """Name a point on the side away from a direction, but within the map."""
    needed_in = (0.2 + 0.09 * len(name), 0.3)
    before = [side > needed for side, needed in zip(place_in, needed_in, strict=True)]
    beyond = [whole - side > needed for whole, side, needed in zip(size_in, place_in, needed_in, strict=True)]
    to_left, downwards = (before[axis] and (away_from[axis] > 0 or not beyond[axis]) for axis in (0, 1))
    text = axes.annotate(
        name,
        xy_m,
        xytext=(-8 if to_left else 8, -8 if downwards else 8),
        textcoords="offset points",
        ha="right" if to_left else "left",
        va="top" if downwards else "bottom",
        fontsize=9.5,
        fontweight="bold",
        zorder=8,
    )
    with_halo(text, 3.0)


def _free_corner(
    points_in: list[tuple[float, float]], box_in: tuple[float, float], corners_in: list[tuple[float, float]]
) -> tuple[float, float] | None:
    """Return the first corner whose box holds no point with its label, or None."""
    room_in = 0.75
    for left_in, bottom_in in corners_in:
        if not any(
            -room_in < x_in - left_in < box_in[0] + room_in
            and -room_in / 2 < y_in - bottom_in < box_in[1] + room_in / 2
            for x_in, y_in in points_in
        ):
            return left_in, bottom_in
    return None


def _draw_north(axes: Axes, size_in: tuple[float, float], points_in: list[tuple[float, float]]) -> None:
    """Draw an arrow to the north in a free upper corner."""
    width_in, height_in = size_in
    corner_in = _free_corner(points_in, (0.3, 0.5), [(width_in - 0.4, height_in - 0.6), (0.1, height_in - 0.6)])
    if corner_in is None:
        return
    middle_in, foot_in = corner_in[0] + 0.15, corner_in[1] + 0.06
    outline = ((-0.07, 0.0), (0.0, 0.24), (0.07, 0.0), (0.0, 0.05))
    points = [((middle_in + dx) / width_in, (foot_in + dy) / height_in) for dx, dy in outline]
    arrow_head = Polygon(points, transform=axes.transAxes, zorder=8)
    arrow_head.set(facecolor=INK_COLOUR, edgecolor="white", linewidth=0.8)
    axes.add_patch(arrow_head)
    letter = axes.text(middle_in / width_in, (foot_in + 0.26) / height_in, "N", transform=axes.transAxes, zorder=8)
    letter.set(ha="center", va="bottom", fontsize=8.5, fontweight="bold")
    with_halo(letter)


def _draw_scale(
    axes: Axes, geometry: GridGeometry, size_in: tuple[float, float], points_in: list[tuple[float, float]]
) -> None:
    """Draw a scale bar of round length in a free lower corner."""
    width_in, height_in = size_in
    span_m = geometry.east_m - geometry.west_m
    bar_m = round_below(_SCALE_BAR_SHARE * span_m)
    bar_in = bar_m / span_m * width_in
    plate_in = (bar_in + 0.3, 0.36)
    corners_in = [(0.1, 0.1), (width_in - plate_in[0] - 0.1, 0.1), (0.1, height_in - 0.46)]
    left_in, bottom_in = _free_corner(points_in, plate_in, corners_in) or corners_in[0]
    for right_in, up_in, wide_in, high_in, colour, edge, alpha in (
        (0.0, 0.0, *plate_in, "white", "none", 0.8),
        (0.15, 0.08, bar_in / 2, 0.05, INK_COLOUR, INK_COLOUR, 1.0),
        (0.15 + bar_in / 2, 0.08, bar_in / 2, 0.05, "white", INK_COLOUR, 1.0),
    ):
        corner = ((left_in + right_in) / width_in, (bottom_in + up_in) / height_in)
        part = Rectangle(corner, wide_in / width_in, high_in / height_in, transform=axes.transAxes, zorder=6)
        part.set(facecolor=colour, edgecolor=edge, linewidth=0.7, alpha=alpha)
        axes.add_patch(part)
    middle = ((left_in + 0.15 + bar_in / 2) / width_in, (bottom_in + 0.17) / height_in)
    length = axes.text(*middle, distance_label(bar_m), transform=axes.transAxes, zorder=6)
    length.set(ha="center", va="bottom", fontsize=8)
