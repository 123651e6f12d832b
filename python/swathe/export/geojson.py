"""Routes and nests as GeoJSON (RFC 7946): longitude and latitude with 8 decimals.

A frame without longitude and latitude (a local height map, another planet) keeps its own metres, and the member
``reference_system`` of the collection says so.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from swathe.drivable import DrivablePath
    from swathe.io.crs import Frame
    from swathe.nest import Gap, Nests, Outline
    from swathe.planner import Route

_DECIMALS_DEGREES = 8
_DECIMALS_METRES = 3


def route_collection(route: Route | None, frame: Frame, origin: Mapping[str, Any]) -> dict[str, Any]:
    """Return one LineString feature per leg, in order, with its facts; ``origin`` is kept as member ``swathe``."""
    features = []
    for number, leg in enumerate(route.legs if route else (), start=1):
        features.append(
            {
                "type": "Feature",
                "geometry": {
                    "type": "LineString",
                    "coordinates": _coordinates(np.asarray([leg.start, leg.end]), frame),
                },
                "properties": {
                    "leg": number,
                    "length_m": round(leg.length_m, 3),
                    "grade_max": round(leg.grade_max, 5),
                    "grade_min": round(leg.grade_min, 5),
                    "side_slope_max": round(leg.side_slope_max, 5),
                    "soil": leg.soil,
                    "rank_min": leg.rank_min,
                    "speed_mps": round(leg.speed_mps, 4),
                    "time_s": round(leg.time_s, 3),
                    "energy_j": round(leg.energy_j, 1),
                    "risk_s": round(leg.risk_s, 3),
                    "climb_m": round(leg.climb_m, 3),
                    "descent_m": round(leg.descent_m, 3),
                    "outside_nests_m": round(leg.bridged_m, 3),
                    "reason": leg.reason,
                },
            }
        )
    return _collection(features, frame, origin)


def drivable_collection(path: DrivablePath, frame: Frame, origin: Mapping[str, Any]) -> dict[str, Any]:
    """Return one LineString feature per arc, in order, with its curvature, direction and facts.

    ``heading_deg`` is where the nose points at the arc's start, clockwise from the map's north.
    """
    features = []
    for number, arc in enumerate(path.arcs, start=1):
        end = path.arcs[number].start[:2] if number < len(path.arcs) else tuple(path.poses[-1, :2])
        features.append(
            {
                "type": "Feature",
                "geometry": {"type": "LineString", "coordinates": _coordinates(arc.points(end), frame)},
                "properties": {
                    "arc": number,
                    "direction": "reverse" if arc.reverse else "forward",
                    "radius_m": None if arc.curvature_per_m == 0 else round(1 / abs(arc.curvature_per_m), 3),
                    "turn": "straight"
                    if arc.curvature_per_m == 0
                    else ("left" if arc.curvature_per_m > 0 else "right"),
                    "heading_deg": round((90 - math.degrees(arc.start.heading_rad)) % 360, 3),
                    "length_m": round(arc.length_m, 3),
                    "time_s": round(arc.time_s, 3),
                    "energy_j": round(arc.energy_j, 1),
                    "grade_max": round(arc.grade_max, 5),
                    "grade_min": round(arc.grade_min, 5),
                    "side_slope_max": round(arc.side_slope_max, 5),
                },
            }
        )
    return _collection(features, frame, origin)


def nest_collection(
    nests: Nests,
    outlines: list[Outline],
    gaps: list[Gap],
    cell_area_m2: float,
    *,
    frame: Frame,
    origin: Mapping[str, Any],
) -> dict[str, Any]:
    """Return one feature per nest, largest first, with its size and its nearest neighbour in the nest graph."""
    polygons: dict[int, list[list[Any]]] = {}
    for outline in outlines:
        rings = [outline.exterior, *outline.holes]
        polygons.setdefault(outline.nest, []).append([_coordinates(ring, frame) for ring in rings])
    nearest: dict[int, Gap] = {}
    for gap in gaps:
        for nest in (gap.from_nest, gap.to_nest):
            if nest not in nearest or gap.distance_m < nearest[nest].distance_m:
                nearest[nest] = gap
    features = []
    for nest in sorted(polygons, key=lambda nest: (-int(nests.sizes[nest - 1]), nest)):
        parts = polygons[nest]
        shape = (
            {"type": "Polygon", "coordinates": parts[0]}
            if len(parts) == 1
            else {"type": "MultiPolygon", "coordinates": parts}
        )
        cells = int(nests.sizes[nest - 1])
        gap_here = nearest.get(nest)
        features.append(
            {
                "type": "Feature",
                "geometry": shape,
                "properties": {
                    "nest": nest,
                    "cells": cells,
                    "area_m2": round(cells * cell_area_m2, 3),
                    "nearest_nest": _other(gap_here, nest),
                    "gap_m": None if gap_here is None else round(gap_here.distance_m, 3),
                },
            }
        )
    return _collection(features, frame, origin)


def _other(gap: Gap | None, nest: int) -> int | None:
    if gap is None:
        return None
    return gap.to_nest if gap.from_nest == nest else gap.from_nest


def _coordinates(xy_m: NDArray[np.float64], frame: Frame) -> list[list[float]]:
    if frame.has_lonlat:
        lon, lat = frame.to_lonlat(xy_m[:, 0], xy_m[:, 1])
        points = np.round(np.column_stack([lon, lat]), _DECIMALS_DEGREES)
    else:
        points = np.round(xy_m, _DECIMALS_METRES)
    listed: list[list[float]] = points.tolist()
    return listed


def _collection(features: list[dict[str, Any]], frame: Frame, origin: Mapping[str, Any]) -> dict[str, Any]:
    collection: dict[str, Any] = {"type": "FeatureCollection", "swathe": dict(origin)}
    if not frame.has_lonlat:
        collection["reference_system"] = f"metres in {frame.name}, not longitude and latitude"
    return {**collection, "features": features}
