"""The truth behind a scenario: the world that a drive meets, where it differs from the map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from swathe.belief import units_of_classes
from swathe.errors import OutsideGridError
from swathe.random import uniform
from swathe.sim import Box, Mover, TruthErrors, Wall, World
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swathe import scenario as plan
    from swathe.grid import GridGeometry

#: Streams of draws for what stands in the world, and for what is wrong with its map.
_CRATES, _HOLLOWS, _POLYGONS = 101, 102, 103
_TRIES = 20


@dataclass(frozen=True, eq=False)
class Route:
    """The way that obstacles are placed along: vertices (n, 2) in metres, at least two."""

    points_m: NDArray[np.float64]

    @property
    def length_m(self) -> float:
        """Its length."""
        return float(self._steps_m().sum())

    def place(self, along: float, offset_m: float) -> tuple[float, float, float]:
        """Return east, north and heading of the place at a share (0..1) of the way, so far to the left of it."""
        steps_m = self._steps_m()
        rest_m = along * steps_m.sum()
        leg = int(min(np.searchsorted(np.cumsum(steps_m), rest_m), len(steps_m) - 1))
        rest_m -= steps_m[:leg].sum()
        start, end = self.points_m[leg], self.points_m[leg + 1]
        heading_rad = math.atan2(end[1] - start[1], end[0] - start[0])
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        x_m, y_m = start[0] + rest_m * cos - offset_m * sin, start[1] + rest_m * sin + offset_m * cos
        return float(x_m), float(y_m), heading_rad

    def _steps_m(self) -> NDArray[np.float64]:
        steps: NDArray[np.float64] = np.hypot(*np.diff(self.points_m, axis=0).T)
        return steps


def place_of(part: plan.Patch | plan.Box | plan.SoilNews, route: Route) -> tuple[float, float, float]:
    """Return where a part of a scenario lies: east, north, and the heading that it is turned from."""
    if part.x_m is not None and part.y_m is not None:
        return part.x_m, part.y_m, 0.0
    return route.place(part.along or 0.0, part.offset_m)


def true_world(
    scenario: plan.Scenario,
    geometry: GridGeometry,
    elevation_m: NDArray[np.float32],
    soil: NDArray[np.uint8] | None,
    route: Route,
    *,
    seed: int | None = None,
) -> World:
    """Return the world behind a map of heights and soil codes, with all that the scenario puts into it.

    What the map does not know of the soil is sand in truth. ``seed`` is the scenario's unless given.

    Raises:
        OutsideGridError: something of the scenario lies outside the map.
        InvalidParameterError: a figure is not usable.
    """
    seed = scenario.seed if seed is None else seed
    truth = scenario.truth
    codes = np.full(geometry.shape, SoilClass.SAND, dtype=np.uint8) if soil is None else soil.copy()
    if truth.wrong_polygons > 0 and soil is not None:
        codes = mistaken(truth, geometry, soil, route, seed)
    codes[codes == SoilClass.UNKNOWN] = SoilClass.SAND

    def world(
        heights_m: NDArray[np.float32], soil_codes: NDArray[np.uint8], errors: TruthErrors | None = None
    ) -> World:
        return World(
            heights_m,
            soil_codes,
            cell_size_m=geometry.cell_size_m,
            west_m=geometry.west_m,
            north_m=geometry.north_m,
            moisture_percent=scenario.true_moisture_percent,
            errors=errors,
            seed=seed,
        )

    drawn = world(elevation_m, codes, TruthErrors(truth.height_error_m, truth.patch_m, truth.soil_error))
    if truth.patches or truth.hollows:
        codes = drawn.soil.copy()
        dug = hollows(truth, geometry, drawn.soil, route, seed)
        # All rims before all cores: a hollow that reaches into another does not firm it up.
        for share, soil_name in ((1.0, truth.rim_soil), (0.5, truth.core_soil)):
            for x_m, y_m, radius_m in dug:
                codes[disc(geometry, x_m, y_m, share * radius_m)] = SoilClass[soil_name.upper()]
        for patch in truth.patches:
            x_m, y_m, _ = place_of(patch, route)
            _require_inside(geometry, x_m, y_m, "A patch of soil")
            codes[disc(geometry, x_m, y_m, patch.radius_m)] = SoilClass[patch.soil.upper()]
        drawn = world(drawn.elevation_m, codes)
    _fill(drawn, scenario, geometry, route, seed)
    return drawn


def mistaken(
    truth: plan.TruthPart, geometry: GridGeometry, soil: NDArray[np.uint8], route: Route, seed: int
) -> NDArray[np.uint8]:
    """Return the true soil behind a map some of whose polygons are of another class as wholes.

    Polygons are connected patches of a class; those of a route's ends, and unknown ground, are as the map says.
    """
    layer, units = units_of_classes(soil)
    draws = uniform(seed, _POLYGONS, (len(units) + 1) * 2).reshape(-1, 2)
    kept = {int(layer[geometry_cell(geometry, *end)]) for end in (route.points_m[0], route.points_m[-1])}
    codes = soil.copy()
    for number, unit in units.items():
        wrong, pick = draws[number]
        others = [SoilClass[name.upper()] for name in truth.wrong_soils if SoilClass[name.upper()] != unit.soil_class]
        if wrong < truth.wrong_polygons and number not in kept:
            codes[layer == number] = others[int(pick * len(others))]
    return codes


def geometry_cell(geometry: GridGeometry, x_m: float, y_m: float) -> tuple[int, int]:
    """Return row and column of the cell at a place, of the nearest one outside."""
    row = int((geometry.north_m - y_m) / geometry.cell_size_m)
    column = int((x_m - geometry.west_m) / geometry.cell_size_m)
    return max(0, min(row, geometry.shape[0] - 1)), max(0, min(column, geometry.shape[1] - 1))


def hollows(
    truth: plan.TruthPart, geometry: GridGeometry, soil: NDArray[np.uint8], route: Route, seed: int
) -> list[tuple[float, float, float]]:
    """Return east, north and radius of hollows drawn on one soil of a map, clear of a route's ends."""
    draws = uniform(seed, _HOLLOWS, truth.hollows * _TRIES * 3).reshape(truth.hollows, _TRIES, 3)
    least_m, most_m = sorted(truth.hollow_m)
    ends = (route.points_m[0], route.points_m[-1])
    found = []
    for tries in draws:
        for east, north, size in tries:
            x_m = geometry.west_m + float(east) * (geometry.east_m - geometry.west_m)
            y_m = geometry.south_m + float(north) * (geometry.north_m - geometry.south_m)
            radius_m = least_m + float(size) * (most_m - least_m)
            if soil[geometry_cell(geometry, x_m, y_m)] != SoilClass[truth.hollow_in.upper()]:
                continue
            if min(math.hypot(x_m - end[0], y_m - end[1]) for end in ends) >= radius_m + truth.clear_m:
                found.append((x_m, y_m, radius_m))
                break
    return found


def disc(geometry: GridGeometry, x_m: float, y_m: float, radius_m: float) -> NDArray[np.bool_]:
    """Return the cells whose centre lies within a radius of a place, and the cell of the place itself."""
    rows, columns = np.indices(geometry.shape)
    east_m = geometry.west_m + (columns + 0.5) * geometry.cell_size_m - x_m
    north_m = geometry.north_m - (rows + 0.5) * geometry.cell_size_m - y_m
    half_m = geometry.cell_size_m / 2
    is_under = (np.abs(east_m) <= half_m) & (np.abs(north_m) <= half_m)
    inside: NDArray[np.bool_] = (np.hypot(east_m, north_m) <= radius_m) | is_under
    return inside


def _fill(world: World, scenario: plan.Scenario, geometry: GridGeometry, route: Route, seed: int) -> None:
    obstacles = scenario.obstacles
    for ditch in obstacles.ditches:
        world.dig(ditch.line, ditch.width_m, ditch.depth_m)
    boxes = []
    for box in obstacles.boxes:
        x_m, y_m, turned_rad = place_of(box, route)
        _require_inside(geometry, x_m, y_m, "A box")
        heading_rad = turned_rad + math.radians(box.heading_deg)
        boxes.append(Box(x_m, y_m, box.length_m, box.width_m, heading_rad, box.height_m))
    world.place(*boxes, *crates(obstacles, geometry, route, seed))
    world.place(*(Wall(wall.points, wall.height_m) for wall in obstacles.walls))
    world.set_in_motion(
        *(Mover(mover.path, mover.speed_mps, mover.radius_m, mover.start_m) for mover in obstacles.movers)
    )


def crates(obstacles: plan.ObstaclesPart, geometry: GridGeometry, route: Route, seed: int) -> list[Box]:
    """Return crates drawn along a route, none nearer to its ends than ``clear_m``; fewer where there is no room."""
    draws = uniform(seed, _CRATES, obstacles.crates * _TRIES * 5).reshape(obstacles.crates, _TRIES, 5)
    least_m, most_m = sorted(obstacles.crate_m)
    ends = (route.points_m[0], route.points_m[-1])
    found: list[Box] = []
    for tries in draws:
        for along, aside, length, width, turn in tries:
            x_m, y_m, heading_rad = route.place(float(along), obstacles.spread_m * (2 * float(aside) - 1))
            if min(math.hypot(x_m - end[0], y_m - end[1]) for end in ends) < obstacles.clear_m:
                continue
            if not _is_inside(geometry, x_m, y_m):
                continue
            length_m, width_m = (least_m + (most_m - least_m) * float(side) for side in (length, width))
            found.append(Box(x_m, y_m, length_m, width_m, heading_rad + math.pi * float(turn), 0.6))
            break
    return found


def _is_inside(geometry: GridGeometry, x_m: float, y_m: float) -> bool:
    return geometry.west_m < x_m < geometry.east_m and geometry.south_m < y_m < geometry.north_m


def _require_inside(geometry: GridGeometry, x_m: float, y_m: float, what: str) -> None:
    if not _is_inside(geometry, x_m, y_m):
        raise OutsideGridError(
            f"{what} of the scenario at {x_m:.1f}, {y_m:.1f} m lies outside the map.",
            f"The map reaches from {geometry.west_m:.1f}, {geometry.south_m:.1f} to "
            f"{geometry.east_m:.1f}, {geometry.north_m:.1f} m.",
        )
