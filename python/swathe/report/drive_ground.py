"""What every picture of a drive draws alike: the ground, what stands on it, the lines, and the vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Circle, Polygon
from matplotlib.patheffects import withStroke

from swathe.report.drive import rectangle
from swathe.report.figure import DPI
from swathe.report.palette import (
    DRIVEN_COLOUR,
    INK_COLOUR,
    OBSTACLE_COLOUR,
    ROUTE_CASING_COLOUR,
    ROUTE_COLOUR,
    SEEN_COLOUR,
)
from swathe.report.relief import draw_relief

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from swathe.report.drive import Drive, Extent, Ground

PAPER_COLOUR = "#f1efea"
_GRID_COLOUR = "#e0ddd5"
#: Cells around the shown part, so that the shading at its edge is that of the map.
_BORDER_CELLS = 2


def frame_axes(axes: Axes, extent: Extent) -> None:
    """Set axes to a part of the map."""
    axes.set_xlim(extent.west_m, extent.east_m)
    axes.set_ylim(extent.south_m, extent.north_m)
    axes.set_aspect("equal", adjustable="box")
    axes.autoscale(enable=False)


def draw_ground(axes: Axes, drive: Drive, extent: Extent, width_in: float, *, pale: bool = False) -> None:
    """Draw the shaded ranks of the map, or paper where there is none."""
    axes.set_facecolor(PAPER_COLOUR)
    if drive.ground is None:
        axes.set_axisbelow(True)
        axes.grid(color=_GRID_COLOUR, linewidth=0.6)
        return
    image, covered = relief_of(drive.ground, extent, round(width_in * DPI))
    axes.imshow(
        image,
        extent=(covered.west_m, covered.east_m, covered.south_m, covered.north_m),
        aspect="auto",
        interpolation="antialiased",
        alpha=0.45 if pale else 1.0,
        zorder=0,
    )
    frame_axes(axes, extent)


def relief_of(ground: Ground, extent: Extent, width_px: int) -> tuple[NDArray[np.uint8], Extent]:
    """Return the shaded ranks of the cells that touch a part of the map, and what they cover."""
    from swathe.report.drive import Extent as Part

    geometry, cell = ground.geometry, ground.geometry.cell_size_m
    top = int(np.floor((geometry.north_m - extent.north_m) / cell)) - _BORDER_CELLS
    bottom = int(np.ceil((geometry.north_m - extent.south_m) / cell)) + _BORDER_CELLS
    left = int(np.floor((extent.west_m - geometry.west_m) / cell)) - _BORDER_CELLS
    right = int(np.ceil((extent.east_m - geometry.west_m) / cell)) + _BORDER_CELLS
    top, bottom = min(max(top, 0), geometry.rows - 1), max(min(bottom, geometry.rows), 1)
    left, right = min(max(left, 0), geometry.columns - 1), max(min(right, geometry.columns), 1)
    rows, columns = slice(top, max(bottom, top + 1)), slice(left, max(right, left + 1))
    shape = (rows.stop - top, columns.stop - left)
    image, covered_rows, covered_columns = draw_relief(
        ground.rank[rows, columns],
        ground.elevation_m[rows, columns],
        None,
        cell_size_m=cell,
        target_shape=(max(1, round(width_px * shape[0] / shape[1])), width_px),
    )
    west, north = geometry.west_m + left * cell, geometry.north_m - top * cell
    return image, Part(west, west + covered_columns * cell, north - covered_rows * cell, north)


def draw_obstacles(axes: Axes, drive: Drive) -> None:
    """Draw what stands in truth."""
    patches = [
        Polygon(np.asarray(part.exterior.coords), closed=True)
        for shape in drive.shapes
        for part in getattr(shape, "geoms", [shape])
    ]
    if patches:
        standing = PatchCollection(patches, facecolor=OBSTACLE_COLOUR, edgecolor="#4c4944", linewidth=0.7, zorder=4.5)
        axes.add_collection(standing, autolim=False)


def draw_movers(axes: Axes, drive: Drive, time_s: float) -> None:
    """Draw what moves, where it is at a time."""
    movers = drive.log.movers
    for mover, radius_m in enumerate(movers.radii_m.tolist()):
        at = [np.interp(time_s, movers.times_s, movers.positions_m[:, mover, axis]) for axis in (0, 1)]
        axes.add_patch(Circle((at[0], at[1]), radius_m, facecolor="#c9a13b", edgecolor="#4c4944", lw=0.7, zorder=4.6))


def draw_seen(axes: Axes, points_m: NDArray[np.float64], size: float) -> None:
    """Draw what scans hit as dots."""
    axes.scatter(points_m[:, 0], points_m[:, 1], s=size, c=SEEN_COLOUR, linewidths=0, zorder=4.7)


def draw_route(axes: Axes, points_m: NDArray[np.float64] | None, width: float = 2.9) -> None:
    """Draw a global route."""
    if points_m is None or len(points_m) < 2:
        return
    for colour, more, zorder in ((ROUTE_CASING_COLOUR, 2.2, 4.0), (ROUTE_COLOUR, 0.0, 4.1)):
        axes.plot(
            *points_m.T, color=colour, lw=width + more, solid_joinstyle="round", solid_capstyle="round", zorder=zorder
        )


def draw_driven(axes: Axes, points_m: NDArray[np.float64], width: float = 1.9) -> None:
    """Draw the way that was driven, dotted."""
    halo = withStroke(linewidth=width + 2.0, foreground="white", alpha=0.85)
    line = axes.plot(*points_m.T, color=DRIVEN_COLOUR, lw=width, dash_capstyle="round", zorder=5)[0]
    line.set(linestyle=(0, (0.1, 2.1)), path_effects=[halo])


def draw_scan(axes: Axes, drive: Drive, row: int) -> None:
    """Draw the beams of a scan that hit something, from the sensor on."""
    points = drive.map_points(row)
    ahead_m, left_m, _ = drive.log.scans.mount
    x_m, y_m, heading = drive.believed(row)
    origin = (
        x_m + np.cos(heading) * ahead_m - np.sin(heading) * left_m,
        y_m + np.sin(heading) * ahead_m + np.cos(heading) * left_m,
    )
    beams = [np.array([origin, point]) for point in points]
    axes.add_collection(LineCollection(beams, colors=SEEN_COLOUR, linewidths=0.35, alpha=0.4, zorder=3), autolim=False)
    draw_seen(axes, points, 4.0)


def draw_vehicle(axes: Axes, drive: Drive, pose: tuple[float, float, float]) -> None:
    """Draw the vehicle's rectangle and its nose."""
    corners = rectangle(drive, pose)
    axes.add_patch(Polygon(corners, closed=True, facecolor="white", edgecolor=INK_COLOUR, linewidth=1.2, zorder=7))
    nose = np.array([corners[0], pose[:2], corners[3]])
    axes.add_patch(Polygon(nose, closed=True, facecolor=INK_COLOUR, edgecolor="none", zorder=7.1))
