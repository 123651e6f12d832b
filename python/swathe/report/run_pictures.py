"""The pictures of a run: its map, and the profile along its route."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.grid import GridGeometry, Window
from swathe.report import wording
from swathe.report.map import MapPicture, draw_map
from swathe.report.profile import draw_profile
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from swathe.io.crs import Frame
    from swathe.nest import Outline
    from swathe.planner import Plan, Route
    from swathe.rank import Region

#: Points of a profile; more than a picture can show.
_MOST_SAMPLES = 600

#: Notes on a picture; the report has them all.
_PICTURE_NOTES = ("generated", "resampled")


def draw(
    folder: Path,
    region: Region,
    frame: Frame,
    ranks: NDArray[np.uint8],
    outlines: Sequence[Outline],
    *,
    plan: Plan | None,
    summary: Mapping[str, Any],
    metadata: Mapping[str, str],
) -> None:
    """Draw ``map.png``, and ``profile.png`` when there is a route with a length."""
    corridor = None if plan is None else plan.corridor
    ends: list[tuple[float, float] | None] = [None, None]
    if plan is not None:
        ends = [(summary[name]["x_m"], summary[name]["y_m"]) for name in ("start", "goal")]
    swathe = None if corridor is None else corridor.cells(region.geometry)
    # A guided swarm was not kept inside a swathe: the map is shown as it is.
    is_guided = (summary.get("corridor") or {}).get("arc") == "relaid"
    view = _view(region.geometry, swathe)
    shown = (slice(view.row, view.row + view.rows), slice(view.column, view.column + view.columns))
    picture = MapPicture(
        geometry=region.geometry.window(*view),
        elevation_m=region.elevation_m[shown],
        rank=ranks[shown],
        nest_rings=[ring for outline in outlines for ring in (outline.exterior, *outline.holes)],
        swathe=None if swathe is None or is_guided else swathe[shown],
        arc_xy_m=None if corridor is None else corridor.arc_xy_m,
        route_xy_m=None if plan is None else _shown_route(plan),
        start_xy_m=ends[0],
        goal_xy_m=ends[1],
        blocked_xy_m=None if plan is None else plan.place,
        title=wording.headline(dict(summary)),
        subtitle=_subtitle(region, summary),
        notes=tuple(note for note in summary["notes"] if any(word in note for word in _PICTURE_NOTES)),
        lonlat_of=frame.to_lonlat if frame.has_lonlat else None,
    )
    draw_map(folder / "map.png", picture, metadata=metadata)
    if plan is not None and plan.route is not None and plan.route.legs:
        _profile(folder / "profile.png", region, plan.route, summary, metadata)


def _shown_route(plan: Plan) -> NDArray[np.float64] | None:
    """Return the line of the route: the drivable path where there is one."""
    if plan.route is None or plan.drivable is None:
        return None if plan.route is None else plan.route.xy_m
    return plan.drivable.poses[:, :2]


def _view(geometry: GridGeometry, swathe: NDArray[np.bool_] | None) -> Window:
    """Return the part of the map to show: the swathe with a margin, in the map's own proportions where it can be."""
    rows, columns = geometry.shape
    if swathe is None or not swathe.any():
        return Window(0, 0, rows, columns)
    bounds = []
    for axis, size in ((1, rows), (0, columns)):
        inside = np.flatnonzero(swathe.any(axis=axis))
        bounds.append((int(inside[0]), int(inside[-1]) + 1, size))
    longest = max(high - low for low, high, _ in bounds)
    starts, sizes = [], []
    for low, high, size in bounds:
        # A little context around the swathe, and a picture that is not a thin strip.
        wanted = min(size, max(int(1.15 * (high - low)) + 8, int(0.75 * longest)))
        start = min(max(0, (low + high - wanted) // 2), size - wanted)
        starts.append(start)
        sizes.append(wanted)
    return Window(starts[0], starts[1], sizes[0], sizes[1])


def _subtitle(region: Region, summary: Mapping[str, Any]) -> str:
    return (
        f"{region.vehicle.name}, profile {summary['profile']}, method {summary['method']}, "
        f"{region.geometry.rows} x {region.geometry.columns} cells of {region.geometry.cell_size_m:g} m"
    )


def _profile(path: Path, region: Region, route: Route, summary: Mapping[str, Any], metadata: Mapping[str, str]) -> None:
    vertices = route.xy_m
    runs = np.hypot(*np.diff(vertices, axis=0).T)
    reached = np.concatenate([[0.0], np.cumsum(runs)])
    samples = min(_MOST_SAMPLES, max(2, int(np.ceil(reached[-1] / region.geometry.cell_size_m)) + 1))
    # The vertices themselves are kept, so that every grade belongs to one leg.
    distance_m = np.unique(np.concatenate([np.linspace(0.0, reached[-1], samples), reached]))
    xy_m = np.column_stack([np.interp(distance_m, reached, vertices[:, axis]) for axis in (0, 1)])
    heights_m = height_along(region, xy_m)
    middle_m = (distance_m[:-1] + distance_m[1:]) / 2
    leg = np.clip(np.searchsorted(reached, middle_m) - 1, 0, len(route.legs) - 1)
    speeds = np.asarray([part.speed_mps for part in route.legs])
    draw_profile(
        path,
        distance_m=distance_m,
        elevation_m=heights_m,
        leg_distance_m=distance_m,
        leg_grade=np.diff(heights_m) / np.diff(distance_m),
        leg_speed_mps=speeds[leg],
        leg_soil=_soil_along(region, (xy_m[:-1] + xy_m[1:]) / 2),
        grade_up_limit=region.vehicle.grade_up,
        grade_down_limit=region.vehicle.grade_down,
        title=wording.headline(dict(summary)),
        metadata=metadata,
    )


def height_along(region: Region, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return heights at map positions, bilinear between cell centres; unknown centres give their weight to the rest."""
    geometry = region.geometry
    row = (geometry.north_m - xy_m[:, 1]) / geometry.cell_size_m - 0.5
    column = (xy_m[:, 0] - geometry.west_m) / geometry.cell_size_m - 0.5
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, right = row - top, column - left
    total = np.zeros(len(xy_m))
    weights = np.zeros(len(xy_m))
    for rows, columns, weight in (
        (0, 0, (1 - down) * (1 - right)),
        (0, 1, (1 - down) * right),
        (1, 0, down * (1 - right)),
        (1, 1, down * right),
    ):
        inside = (top + rows >= 0) & (top + rows < geometry.rows) & (left + columns >= 0)
        inside &= left + columns < geometry.columns
        heights = np.full(len(xy_m), np.nan)
        heights[inside] = region.elevation_m[top[inside] + rows, left[inside] + columns]
        known = np.isfinite(heights)
        total[known] += weight[known] * heights[known]
        weights[known] += weight[known]
    with np.errstate(invalid="ignore", divide="ignore"):
        return total / weights


def _soil_along(region: Region, xy_m: NDArray[np.float64]) -> list[str]:
    if region.soil is None:
        return ["unknown"] * len(xy_m)
    geometry = region.geometry
    rows = ((geometry.north_m - xy_m[:, 1]) / geometry.cell_size_m).astype(int).clip(0, geometry.rows - 1)
    columns = ((xy_m[:, 0] - geometry.west_m) / geometry.cell_size_m).astype(int).clip(0, geometry.columns - 1)
    return [SoilClass(int(code)).name.lower() for code in region.soil[rows, columns]]
