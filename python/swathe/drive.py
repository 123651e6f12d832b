"""The navigator: from what a robot senses to what it should do, one step at a time."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from swathe import _core
from swathe.belief import CLASSES, BeliefParams, Unit, core_units, probing_policy, units_of_classes
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import GridGeometry
from swathe.nest import GridMode, NestParams
from swathe.soil_feed import SoilFeed, SoilUpdate, parse_update
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from swathe import rank
    from swathe.belief import PenetrometerReading as SoilReading
    from swathe.sensor import PenetrometerReading, Pose, Scan
    from swathe.soil import SoilClass

__all__ = [
    "Certainty",
    "Command",
    "DriveParams",
    "Event",
    "GlobalRoute",
    "Histogram",
    "Navigator",
    "Region",
    "SoilAt",
    "SoilFeed",
    "SoilUpdate",
    "Status",
    "parse_update",
]

Status = Literal["driving", "recovering", "reached", "stopped", "no_route", "fault"]
#: How robot and goal stand to each other on the map that learns.
Standing = Literal["unasked", "in_nests", "outside_nests", "unknown", "cut_off"]
#: Cells at most this wide tell which returns of a range sensor are ground.
_FINE_CELL_M = 2.0


@dataclass(frozen=True, slots=True)
class Command:
    """What the robot is told to do until the next step, within the vehicle's limits.

    Attributes:
        speed_mps: forward speed, negative when backing.
        turn_rate_radps: counter-clockwise.
        status: how the drive stands.
        reason: why, in a sentence.
    """

    speed_mps: float
    turn_rate_radps: float
    status: Status
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in a step; docs/drive.md lists the kinds with their fields.

    Attributes:
        kind: a stable word.
        time_s: time of the step.
        fields: what JSON can hold.
    """

    kind: str
    time_s: float
    fields: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return kind, time and fields in one dictionary, ready for JSON."""
        return {"kind": self.kind, "time_s": self.time_s, **self.fields}


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """What was seen around the robot.

    Attributes:
        cells: 0 (free) to 15 (surely an obstacle), 255 where nothing was seen; rows from the north.
        geometry: where the cells lie.
    """

    cells: NDArray[np.uint8]
    geometry: GridGeometry


@dataclass(frozen=True, slots=True)
class Histogram:
    """The polar histogram of a step, and what the local method made of it.

    Attributes:
        densities: obstacle density of every sector, counter-clockwise.
        blocked: whether a sector is too dense to drive into.
        masked: whether it is blocked or closed all the same: beyond an obstacle in the turning circle, towards one that
            is too near, or, for Player's method, behind.
        first_rad: direction of sector 0, counter-clockwise from east.
        thresholds: densities below which a sector opens and above which it is blocked.
        direction_rad: where it steers to, or None when it finds no direction.
    """

    densities: tuple[float, ...]
    blocked: tuple[bool, ...]
    masked: tuple[bool, ...]
    first_rad: float
    thresholds: tuple[float, float]
    direction_rad: float | None


@dataclass(frozen=True, slots=True)
class GlobalRoute:
    """The route over the map.

    Attributes:
        points: from where the robot was when it was last laid or repaired, to the goal; empty without one.
        cost_s: its cost in seconds of driving, where the region can learn; None without a route.
        standing: how robot and goal stand to each other, where the region can learn.
    """

    points: tuple[tuple[float, float], ...]
    cost_s: float | None = None
    standing: Standing = "unasked"


@dataclass(frozen=True, slots=True)
class SoilAt:
    """What is believed of the soil of a place: probability of each class, and of ground that does not carry."""

    probabilities: Mapping[SoilClass, float]
    no_go_probability: float


@dataclass(frozen=True, slots=True)
class DriveParams:
    """How a navigator drives; None takes the vehicle's figure.

    Attributes:
        method: local method.
        outside_nests: ground outside the nests costs more, or is blocked as in the paper.
        evidence: how the certainty grid counts what was seen: ``log-odds`` (Moravec and Elfes 1985), or ``himm``,
            histogramic in-motion mapping as the paper of VFH has it (Borenstein and Koren 1991).
        fade_s: time in which what the grid holds fades to 1/e; infinite for a world that stands still.
        lookahead_m: distances ahead on the route that are steered to, at rest and at full speed.
        unknown_cost: what ground that was never seen costs, as a multiple of seen ground.
        trap_s: time without headway that makes a trap.
        most_recoveries: recoveries without headway after which the robot gives up.
        follow_walls: whether it follows a wall before it does.
        arrival_m: distance to the goal that counts as arrival.
        margin_m: distance kept from obstacles at rest.
        stale_s: age at which a scan no longer counts.
        sensor_height_m: height of the range sensor.
        sonar_height_m: height of sonars, whose cones ``sense`` takes in.
        memory: whether a route is laid on what was seen.
        recover: whether the robot gets out of traps.
        probing: when the robot stops for a penetrometer reading: ``never``, ``every N m``, ``where it matters
            [above C]``: where of all on the next metres of its way the reading is expected to save most, and more
            than C seconds, or ``where it pays [above C]``: at the first that is expected to save more than C seconds.
        probe_wait_s: how long it waits for one before it drives on.
        probe_boom_m: distance from the front edge of the footprint forwards to the cone.
    """

    method: Literal["vfh", "vfh+", "vfh*", "player"] = "vfh+"
    outside_nests: Literal["cost", "block"] = "cost"
    evidence: Literal["log-odds", "himm"] = "log-odds"
    fade_s: float = math.inf
    lookahead_m: tuple[float, float] = (2.0, 5.0)
    unknown_cost: float = 1.5
    trap_s: float = 8.0
    most_recoveries: int = 12
    follow_walls: bool = True
    arrival_m: float = 0.5
    max_turn_rate_radps: float | None = None
    acceleration_mps2: float | None = None
    braking_mps2: float | None = None
    margin_m: float = 0.1
    stale_s: float = 0.5
    sensor_height_m: float = 0.3
    sonar_height_m: float = 0.18
    memory: bool = True
    recover: bool = True
    probing: str = "never"
    probe_wait_s: float = 30.0
    probe_boom_m: float = 0.5


@dataclass(frozen=True, eq=False)
class _Learning:
    """What a region that learns is made of."""

    ground: rank.Region
    layer: NDArray[np.uint32]
    units: Mapping[int, Unit]
    belief: BeliefParams
    nest: NestParams
    explains_returns: bool


@dataclass(frozen=True, eq=False)
class Region:
    """What a map knows, in the goal's frame. ``Region.of`` makes one that readings and updates teach.

    Attributes:
        ranks: rank of every terrain cell, 0 to 10.
        geometry: where the cells lie.
        route: points of a global route. A region that learns lays and repairs its own.
        elevation_m: heights of the cells; returns of a range sensor that they explain are ground.
        grids: which of the overlapping grids are asked, and how their answers combine.
    """

    ranks: ArrayLike | None
    geometry: GridGeometry
    route: Sequence[tuple[float, float]] = ()
    elevation_m: ArrayLike | None = None
    grids: GridMode = "or"
    learning: _Learning | None = None

    @classmethod
    def of(
        cls,
        ground: rank.Region,
        *,
        belief: BeliefParams | None = None,
        nest: NestParams | None = None,
        layer: ArrayLike | None = None,
        units: Mapping[int, Unit] | None = None,
        grids: GridMode = "or",
        explains_returns: bool | None = None,
    ) -> Region:
        """Return a region that readings and updates teach, from ground as it is planned on.

        Args:
            ground: elevation, soil, zones, vehicle and rules.
            belief: how readings change what is believed of the soil.
            nest: what a nest is; the lowest suitable rank of the ground's rules where not given.
            layer: number of each cell's soil polygon, 0 for none; connected patches of a class where not given.
            units: the polygons by number.
            grids: which of the overlapping grids are asked.
            explains_returns: whether the heights tell which returns of a range sensor are ground; where not given,
                whether cells are at most 2 m wide.

        Raises:
            InvalidParameterError: polygons are given without their layer, or the other way round.
        """
        if (layer is None) != (units is None):
            raise InvalidParameterError("Polygons and their layer belong together.", "Give both or none of them.")
        geometry = ground.geometry
        if layer is None or units is None:
            soil = ground.soil if ground.soil is not None else np.zeros(geometry.shape, dtype=np.uint8)
            numbers, known = units_of_classes(soil)
        else:
            numbers, known = np.ascontiguousarray(layer, dtype=np.uint32), dict(units)
        learning = _Learning(
            ground,
            numbers,
            known,
            belief or BeliefParams(),
            nest or NestParams(rank_min=ground.params.rank_min),
            geometry.cell_size_m <= _FINE_CELL_M if explains_returns is None else explains_returns,
        )
        return cls(None, geometry, (), None, grids, learning)


class Navigator:
    """Drives a robot to a goal around what it sees; with a region, also around what a map knows."""

    def __init__(
        self,
        vehicle: Vehicle | str | Path,
        goal: tuple[float, float],
        *,
        region: Region | None = None,
        params: DriveParams | None = None,
        seed: int = 0,
    ) -> None:
        """Make a navigator that waits for its first scan.

        Args:
            vehicle: a vehicle, the name of one, or a TOML file.
            goal: metres east and north.
            region: what a map knows, in the goal's frame.
            params: how to drive.
            seed: kept for methods that draw random numbers; none does so far.

        Raises:
            UsageError: a figure is outside its range.
            InvalidVehicleError: the vehicle is not usable.
        """
        chosen = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
        figures: dict[str, Any] = asdict(params or DriveParams())
        figures["probing"] = probing_policy(figures["probing"])
        for name, limit in (
            ("max_turn_rate_radps", chosen.max_turn_rate_radps),
            ("acceleration_mps2", chosen.max_acceleration_mps2),
            ("braking_mps2", chosen.max_braking_mps2),
        ):
            figures[name] = limit if figures[name] is None else min(figures[name], limit)
        self.seed = seed
        fixed, learning = _map_of(region, chosen), _learning_of(region, chosen)
        self._core = _core.Navigator(chosen.core, (float(goal[0]), float(goal[1])), figures, fixed, learning)

    def step(  # noqa: PLR0917 - what a robot senses, in the order that its drivers call it
        self,
        time_s: float,
        pose: Pose,
        speed_mps: float,
        turn_rate_radps: float,
        scan: Scan | None,
        reading: PenetrometerReading | SoilReading | None = None,
    ) -> Command:
        """Return what to do, given what the robot senses; input that cannot be used leads to a stop with its reason."""
        ranges, figures = None, [0.0] * 7
        if scan is not None:
            ranges, figures = _figures_of(scan)
        probe = None if reading is None else _reading_row(reading)
        place = (pose.x_m, pose.y_m, pose.heading_rad, pose.pitch_rad, pose.roll_rad)
        told = self._core.step(time_s, place, (speed_mps, turn_rate_radps), ranges, figures, probe)
        return Command(told[0], told[1], cast("Status", told[2]), told[3])

    def sense(self, time_s: float, pose: Pose, scan: Scan, *, cone_rad: float = 0.0) -> str | None:
        """Take in what another sensor sees between the steps, and return why it was left out, or None.

        A cone of a sonar ring or a second laser counts like the scan of a step, and may be all that the robot has.

        Args:
            time_s: when it was taken, on the clock of the steps.
            pose: where the robot was then.
            scan: what the sensor saw; one beam for a cone.
            cone_rad: width of a beam. Up to its range the whole cone is free; what it met counts in its middle.
        """
        ranges, figures = _figures_of(scan)
        place = (pose.x_m, pose.y_m, pose.heading_rad, pose.pitch_rad, pose.roll_rad)
        return self._core.sense(time_s, place, ranges, figures, cone_rad)

    def set_goal(self, goal: tuple[float, float]) -> None:
        """Drive to another goal from now on; what was seen and learnt is kept.

        Raises:
            UsageError: it is not a place.
        """
        self._core.set_goal((float(goal[0]), float(goal[1])))

    def learn_soil(self, update: SoilUpdate) -> int:
        """Take in news of the soil of an area; return how many cells have another rank now.

        Ranks, nests, both grids and the route follow at once; the next step's events tell it.

        Raises:
            UsageError: the update is not usable, or the region cannot learn; nothing is changed then.
        """
        return int(self._core.learn_soil(update.row()))

    def learn_reading(self, reading: PenetrometerReading | SoilReading) -> int:
        """Take in a reading that another vehicle has taken, as one of its own; return how many ranks have changed.

        Raises:
            UsageError: the reading is not usable, or the region cannot learn; nothing is changed then.
        """
        return int(self._core.learn_reading(_reading_row(reading)))

    @property
    def events(self) -> list[Event]:
        """What happened in the last step."""
        return [Event(kind, time_s, fields) for time_s, kind, fields in self._core.events()]

    @property
    def wants_probe(self) -> bool:
        """Whether the robot stands and waits for a penetrometer reading where it is."""
        return bool(self._core.wants_probe())

    @property
    def core(self) -> _core.Navigator:
        """The navigator in the core."""
        return self._core

    @property
    def way(self) -> list[tuple[float, float]]:
        """The way on the memory from the robot on, in metres."""
        return self._core.way()

    @property
    def global_route(self) -> GlobalRoute:
        """The route over the map: the region's own, or the one that is repaired while the ground is learnt."""
        cost = self._core.global_cost()
        cost_s, standing = (None, "unasked") if cost is None else cost
        return GlobalRoute(tuple(self._core.global_route()), cost_s, cast("Standing", standing))

    @property
    def histogram(self) -> Histogram | None:
        """The polar histogram of the last step in which the local method was asked, None before the first."""
        shown = self._core.histogram()
        if shown is None:
            return None
        densities, blocked, masked, first_rad, thresholds, direction_rad = shown
        return Histogram(tuple(densities), tuple(blocked), tuple(masked), first_rad, thresholds, direction_rad)

    @property
    def certainty(self) -> Certainty:
        """What was seen around the robot."""
        shown = self._core.certainty()
        if shown is None:
            return Certainty(np.full((1, 1), 255, dtype=np.uint8), GridGeometry(1, 1, 1.0))
        shape, cells = shown
        return Certainty(cells, GridGeometry(*shape))

    @property
    def ranks(self) -> NDArray[np.uint8] | None:
        """Ranks in use, None where the region cannot learn."""
        ground = self._core.ground()
        return None if ground is None else ground[0]

    @property
    def soil(self) -> NDArray[np.uint8] | None:
        """Soil codes in use, None where the region cannot learn."""
        ground = self._core.ground()
        return None if ground is None else ground[1]

    def soil_at(self, place: tuple[float, float]) -> SoilAt | None:
        """Return what is believed of the soil of a place, None outside the map or where the region cannot learn."""
        found = self._core.soil_at((float(place[0]), float(place[1])))
        if found is None:
            return None
        shares, no_go = found
        return SoilAt(dict(zip(CLASSES, shares, strict=True)), no_go)


def _reading_row(reading: PenetrometerReading | SoilReading) -> tuple[Any, ...]:
    """Return a reading as the core takes it."""
    sleeve = getattr(reading, "sleeve_frictions_kpa", None)
    sleeve = None if sleeve is None else list(sleeve)
    depths, indices = list(reading.depths_m), list(reading.cone_indices_kpa)
    return reading.x_m, reading.y_m, depths, indices, reading.refusal_depth_m, sleeve


def _shape(geometry: GridGeometry) -> tuple[int, int, float, float, float]:
    return (geometry.rows, geometry.columns, geometry.cell_size_m, geometry.west_m, geometry.north_m)


def _grids(mode: GridMode, vehicle: Vehicle, rank_min: int) -> dict[str, Any]:
    size_m = 2 * vehicle.circumscribed_radius_m
    usual = {"reading": "side", "phases": None, "window_cells": None}
    return usual | {"size_m": size_m, "mode": mode, "rank_min": rank_min}


def _figures_of(scan: Scan) -> tuple[NDArray[np.float64], list[float]]:
    figures = [scan.angle_min_rad, scan.angle_increment_rad, scan.range_min_m, scan.range_max_m, *scan.mount]
    return np.ascontiguousarray(scan.ranges_m, dtype=np.float64).ravel(), figures


def _map_of(region: Region | None, vehicle: Vehicle) -> tuple[Any, ...] | None:
    if region is None or region.learning is not None:
        return None
    if region.ranks is None:
        raise InvalidParameterError("The region has no ranks.", "Give them, or make it with Region.of.")
    geometry, ranks = region.geometry, np.ascontiguousarray(region.ranks, dtype=np.uint8)
    heights = None if region.elevation_m is None else np.ascontiguousarray(region.elevation_m, dtype=np.float32)
    for what, layer in (("Ranks", ranks), ("Heights", heights)):
        if layer is not None and layer.shape != geometry.shape:
            raise ShapeMismatchError(
                f"{what} of the shape {layer.shape} do not fit the geometry.", "Give one for each cell."
            )
    route = [(float(x), float(y)) for x, y in region.route]
    return ranks, _shape(geometry), heights, route, _grids(region.grids, vehicle, NestParams().rank_min)


def _learning_of(region: Region | None, vehicle: Vehicle) -> tuple[Any, ...] | None:
    if region is None or region.learning is None:
        return None
    learning = region.learning
    ground = learning.ground
    if ground.vehicle != vehicle:
        ground = replace(ground, vehicle=vehicle)
    return (
        ground.core,
        learning.layer,
        core_units(learning.units),
        learning.belief.core_arguments(),
        asdict(learning.nest),
        learning.explains_returns,
        _grids(region.grids, vehicle, learning.nest.rank_min),
    )
