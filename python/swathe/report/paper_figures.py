"""The paper's figures of a region: grey height map, terrain in three dimensions, soil, grid, and overlapping grids.

Maps with nests and routes are ``swathe.report.map``'s, flow charts ``swathe.report.flow_chart``'s.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import LightSource, ListedColormap
from matplotlib.patches import Patch, Rectangle

from swathe.report.figure import add_axes_in, add_heading, drawing, save
from swathe.report.graticule import distance_label, label_edges
from swathe.report.palette import (
    BEST_RANK,
    FAINT_INK_COLOUR,
    INK_COLOUR,
    LIMIT_COLOUR,
    ROUTE_COLOUR,
    SOIL_COLOURS,
    WORST_RANK,
    rank_hex,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from swathe.grid import GridGeometry, Window

    LonLatOf = Callable[[NDArray[np.float64], NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
    Metadata = Mapping[str, str]

_SIDE_IN, _LEFT_IN, _BOTTOM_IN, _TOP_IN, _KEY_IN = 7.2, 0.85, 0.6, 0.95, 1.7
_MOST_SURFACE_CELLS = 220
#: Navigation cells that the picture of overlapping grids is wide.
NAVIGATION_CELLS_ACROSS = 16
# Heights are shown so much steeper than they are that the relief takes this share of the map's side.
_RELIEF_SHARE = 0.09


def draw_height_map(
    path: Path | str, grey: NDArray[np.float32], geometry: GridGeometry, lonlat_of: LonLatOf | None, metadata: Metadata
) -> None:
    """Draw the grey levels 0 to 255 as they are, with their scale; unknown ground is hatched red."""
    title, subtitle = "Grey height map", "Heights as grey levels, 0 the lowest to 255 the highest ground"
    with drawing(*_size_in(geometry)) as figure:
        axes = _map_axes(figure, geometry, title, subtitle, lonlat_of)
        colours = colormaps["gray"].with_extremes(bad="#d9b3b3")
        image = axes.imshow(
            np.ma.masked_invalid(grey),
            cmap=colours,
            vmin=0,
            vmax=255,
            extent=_extent(geometry),
            interpolation="nearest",
        )
        width_in, height_in = _map_in(geometry)
        scale = add_axes_in(figure, _LEFT_IN + width_in + 0.3, _BOTTOM_IN + height_in - 3.2, 0.22, 3.2)
        figure.colorbar(image, cax=scale, ticks=[0, 64, 128, 192, 255]).outline.set_linewidth(0.6)
        scale.set_title("grey level", fontsize=8, loc="left", color=FAINT_INK_COLOUR)
        save(figure, path, metadata)


def draw_terrain(
    path: Path | str, elevation_m: NDArray[np.float32], geometry: GridGeometry, metadata: Metadata
) -> None:
    """Draw the terrain as a shaded surface seen from the south-west."""
    step = math.ceil(max(geometry.shape) / _MOST_SURFACE_CELLS)
    heights = elevation_m[::step, ::step].astype(np.float64)
    known = np.isfinite(heights)
    low, high = (float(side) for side in (heights[known].min(), heights[known].max()))
    rows, columns = heights.shape
    x, y = np.meshgrid(np.arange(columns), np.arange(rows)[::-1])
    side_m = max(rows, columns) * step * geometry.cell_size_m
    steeper = _RELIEF_SHARE * side_m / max(high - low, 1.0)
    shares = (np.where(known, heights, low) - low) / max(high - low, 1.0)
    tint = colormaps["gist_earth"](0.28 + 0.62 * shares)
    light = LightSource(azdeg=315, altdeg=42)
    spacing = step * geometry.cell_size_m
    shaded = light.shade_rgb(
        tint[..., :3],
        np.where(known, heights, low),
        blend_mode="soft",
        vert_exag=max(steeper, 1) * 1.4,
        dx=spacing,
        dy=spacing,
    )
    with drawing(9.0, 6.6) as figure:
        times = f"{steeper:.1f}" if steeper >= 1 else f"{steeper:.2f}"
        add_heading(
            figure,
            0.4,
            "Terrain",
            f"{low:,.0f} to {high:,.0f} m, heights drawn {times} times as steep, seen from the south-west",
        )
        axes: Any = figure.add_axes((0.0, -0.02, 1.0, 0.96), projection="3d")
        surface = axes.plot_surface(
            x,
            y,
            np.where(known, heights, np.nan),
            facecolors=np.clip(shaded, 0, 1),
            rstride=1,
            cstride=1,
            linewidth=0,
            antialiased=False,
            shade=False,
        )
        # The axes are a square in the middle of the page; the ground may go beyond it.
        surface.set_clip_on(False)
        axes.set_box_aspect((columns, rows, _RELIEF_SHARE * max(rows, columns)), zoom=1.3)
        axes.set_zlim(low, high)
        axes.view_init(elev=38, azim=-112)
        axes.set_axis_off()
        save(figure, path, metadata)


def draw_soil(
    path: Path | str,
    soil: NDArray[np.uint8],
    geometry: GridGeometry,
    metadata: Metadata,
    *,
    names: Sequence[str],
    lonlat_of: LonLatOf | None,
    note: str = "",
) -> None:
    """Draw soil classes by code; ``names`` are the classes in the order of their codes."""
    with drawing(*_size_in(geometry)) as figure:
        axes = _map_axes(figure, geometry, "Soil", note or "Class of every cell", lonlat_of)
        colours = ListedColormap([SOIL_COLOURS[name] for name in names])
        axes.imshow(
            soil, cmap=colours, vmin=-0.5, vmax=len(names) - 0.5, extent=_extent(geometry), interpolation="nearest"
        )
        present = [code for code in range(len(names)) if (soil == code).any()]
        total = soil.size
        entries = [
            (
                SOIL_COLOURS[names[code]],
                f"{'no ground' if names[code] == 'none' else names[code]}  {100 * (soil == code).sum() / total:.0f} %",
            )
            for code in present
        ]
        _key(figure, geometry, entries)
        save(figure, path, metadata)


def draw_grid(
    path: Path | str, rank: NDArray[np.uint8], geometry: GridGeometry, window: Window, metadata: Metadata
) -> None:
    """Draw the terrain cells of a window with their ranks."""
    part = geometry.window(*window)
    ranks = rank[window.row : window.row + window.rows, window.column : window.column + window.columns]
    size = distance_label(geometry.cell_size_m)
    with drawing(*_size_in(part)) as figure:
        axes = _map_axes(figure, part, "Grid", f"Terrain cells of {size} with their ranks, a part of the map", None)
        colours = ListedColormap([rank_hex(code) for code in range(BEST_RANK + 1)])
        axes.imshow(ranks, cmap=colours, vmin=-0.5, vmax=BEST_RANK + 0.5, extent=_extent(part), interpolation="nearest")
        _grid_lines(axes, part, part.cell_size_m, 0.0, colour=INK_COLOUR, style="solid", width=0.5)
        for (row, column), value in np.ndenumerate(ranks):
            x_m = part.west_m + (column + 0.5) * part.cell_size_m
            y_m = part.north_m - (row + 0.5) * part.cell_size_m
            dark = value in {1, 2, 3}
            axes.text(x_m, y_m, str(value), ha="center", va="center", fontsize=7, color="white" if dark else INK_COLOUR)
        entries = [(rank_hex(code), _rank_name(code)) for code in (*range(BEST_RANK, WORST_RANK - 1, -1), 1, 0)]
        _key(figure, part, entries)
        save(figure, path, metadata)


def draw_overlapping_grids(
    path: Path | str,
    suitable: NDArray[np.bool_],
    geometry: GridGeometry,
    window: Window,
    metadata: Metadata,
    *,
    cell_m: float,
) -> None:
    """Draw two grids of navigation cells of side ``cell_m``, the second a quarter of a cell south-east of the first.

    A cell is free where all the ground that it touches is suitable, and each grid is filled from the ground itself.
    """
    part = geometry.window(*window)
    ground = suitable[window.row : window.row + window.rows, window.column : window.column + window.columns]
    part, ground = _close_up(part, ground, cell_m)
    subtitle = f"Navigation cells of {cell_m:.1f} m, four times the vehicle, the second grid a quarter of a cell aside"
    with drawing(*_size_in(part)) as figure:
        axes = _map_axes(figure, part, "Overlapping grids", subtitle, None)
        axes.imshow(
            ground,
            cmap=ListedColormap(["#d8b9b4", "#fbfaf5"]),
            vmin=0,
            vmax=1,
            extent=_extent(part),
            interpolation="nearest",
        )
        grids = ((0.0, ROUTE_COLOUR, "solid"), (0.25, LIMIT_COLOUR, (0, (3, 1.6))))
        for offset, colour, _ in grids:
            free = _free_cells(ground, part, cell_m, offset * cell_m)
            axes.add_collection(PatchCollection(free, facecolor=colour, edgecolor="none", alpha=0.2, zorder=2))
        for offset, colour, style in grids:
            _grid_lines(axes, part, cell_m, offset * cell_m, colour=colour, style=style, width=0.8)
        both = "#c5aecd"
        entries = [
            ("#d3d7f3", "free in the first grid"),
            ("#f0d3d6", "free in the second"),
            (both, "free in both"),
            ("#fbfaf5", "suitable ground"),
            ("#d8b9b4", "not suitable"),
        ]
        _key(
            figure,
            part,
            entries,
            lines=((ROUTE_COLOUR, "first grid", "solid"), (LIMIT_COLOUR, "second grid", "dashed")),
        )
        save(figure, path, metadata)


def mixed_window(suitable: NDArray[np.bool_], rows: int, columns: int) -> Window:
    """Return the block of cells nearest to the middle of the map in which about 60 % of the ground is suitable."""
    from swathe.grid import Window

    rows, columns = min(rows, suitable.shape[0]), min(columns, suitable.shape[1])
    sums = np.pad(suitable.astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    inside = sums[rows:, columns:] - sums[:-rows, columns:] - sums[rows:, :-columns] + sums[:-rows, :-columns]
    share = np.abs(inside / (rows * columns) - 0.6)
    row, column = np.indices(share.shape)
    away = np.hypot(row - share.shape[0] / 2, column - share.shape[1] / 2) / max(share.shape)
    best = int(np.argmin(np.maximum(share, 0.05) + 0.2 * away))
    return Window(best // share.shape[1], best % share.shape[1], rows, columns)


def _close_up(part: GridGeometry, ground: NDArray[np.bool_], cell_m: float) -> tuple[GridGeometry, NDArray[np.bool_]]:
    """Return the middle of a window where its terrain cells are much larger than navigation cells."""
    width_m = NAVIGATION_CELLS_ACROSS * cell_m
    if part.cell_size_m * part.columns < 1.8 * width_m:
        return part, ground
    finer = math.ceil(2 * part.cell_size_m / cell_m)
    side_m = part.cell_size_m / finer
    ground = ground.repeat(finer, axis=0).repeat(finer, axis=1)
    columns = min(ground.shape[1], math.ceil(width_m / side_m))
    rows = min(ground.shape[0], math.ceil(0.8 * width_m / side_m))
    row, column = (ground.shape[0] - rows) // 2, (ground.shape[1] - columns) // 2
    whole = replace(part, rows=ground.shape[0], columns=ground.shape[1], cell_size_m=side_m)
    return whole.window(row, column, rows, columns), ground[row : row + rows, column : column + columns]


def _free_cells(ground: NDArray[np.bool_], part: GridGeometry, cell_m: float, offset_m: float) -> list[Rectangle]:
    """Return the navigation cells of a grid that touch suitable ground only."""
    width_m, height_m = part.east_m - part.west_m, part.north_m - part.south_m
    found = []
    for down in range(int((height_m - offset_m) / cell_m)):
        for along in range(int((width_m - offset_m) / cell_m)):
            top_m, left_m = offset_m + down * cell_m, offset_m + along * cell_m
            rows = slice(int(top_m / part.cell_size_m), math.ceil((top_m + cell_m) / part.cell_size_m))
            columns = slice(int(left_m / part.cell_size_m), math.ceil((left_m + cell_m) / part.cell_size_m))
            if ground[rows, columns].all():
                found.append(Rectangle((part.west_m + left_m, part.north_m - top_m - cell_m), cell_m, cell_m))
    return found


def _rank_name(code: int) -> str:
    return {0: "not known", 1: "1  no-go", WORST_RANK: "2  worst", BEST_RANK: "10  best"}.get(code, str(code))


def _map_in(geometry: GridGeometry) -> tuple[float, float]:
    ratio = min(max(geometry.columns / geometry.rows, 0.2), 5.0)
    return (_SIDE_IN, _SIDE_IN / ratio) if ratio >= 1 else (_SIDE_IN * ratio, _SIDE_IN)


def _size_in(geometry: GridGeometry) -> tuple[float, float]:
    width_in, height_in = _map_in(geometry)
    return _LEFT_IN + width_in + 0.25 + _KEY_IN, _BOTTOM_IN + max(height_in, 3.4) + _TOP_IN


def _extent(geometry: GridGeometry) -> tuple[float, float, float, float]:
    return (geometry.west_m, geometry.east_m, geometry.south_m, geometry.north_m)


def _map_axes(figure: Figure, geometry: GridGeometry, title: str, subtitle: str, lonlat_of: LonLatOf | None) -> Axes:
    add_heading(figure, _LEFT_IN, title, subtitle)
    width_in, height_in = _map_in(geometry)
    axes = add_axes_in(figure, _LEFT_IN, _BOTTOM_IN, width_in, height_in)
    axes.set_aspect("auto")
    axes.set_xlim(geometry.west_m, geometry.east_m)
    axes.set_ylim(geometry.south_m, geometry.north_m)
    axes.autoscale(enable=False)
    label_edges(axes, geometry, lonlat_of)
    for label in axes.get_yticklabels():
        label.set_rotation(90)
        label.set_verticalalignment("center")
    return axes


def _grid_lines(
    axes: Axes,
    part: GridGeometry,
    side_m: float,
    offset_m: float,
    *,
    colour: str,
    style: object,
    width: float,
) -> None:
    xs = np.arange(part.west_m + offset_m, part.east_m + side_m * 1e-6, side_m)
    ys = np.arange(part.north_m - offset_m, part.south_m - side_m * 1e-6, -side_m)
    lines = [[(x, ys[0]), (x, ys[-1])] for x in xs] + [[(xs[0], y), (xs[-1], y)] for y in ys]
    axes.add_collection(
        LineCollection(lines, colors=colour, linewidths=width, linestyles=[style], zorder=3), autolim=False
    )


def _key(
    figure: Figure,
    geometry: GridGeometry,
    entries: Sequence[tuple[str, str]],
    lines: Sequence[tuple[str, str, Literal["solid", "dashed"]]] = (),
) -> None:
    from matplotlib.lines import Line2D

    width_in, height_in = _map_in(geometry)
    panel = add_axes_in(figure, _LEFT_IN + width_in + 0.2, _BOTTOM_IN, _KEY_IN, height_in)
    panel.set_axis_off()
    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, edgecolor="#c9ccd4", linewidth=0.5, label=name) for colour, name in entries
    ]
    handles += [
        Line2D((), (), color=colour, label=name, linestyle=style, linewidth=1.2) for colour, name, style in lines
    ]
    panel.legend(
        handles=handles,
        loc="upper left",
        frameon=False,
        fontsize=8,
        borderaxespad=0,
        handlelength=1.6,
        labelspacing=0.7,
    )
