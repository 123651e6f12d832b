"""A scenario made real: the ground as it is planned on, the world as it is in truth, the robot, and its navigator."""

from __future__ import annotations

import hashlib
import math
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swathe import sim
from swathe.belief import BeliefParams, ClassReading, PenetrometerReading, SoilType, load_soil_types
from swathe.drive import DriveParams, Navigator, Region
from swathe.episode import Episode, EpisodeParams
from swathe.io.readings import read_readings
from swathe.planning import Found, search
from swathe.preparation import open_source
from swathe.sensor import Pose
from swathe.soil_feed import SoilUpdate
from swathe.store.source import StoredElevation
from swathe.summary import inputs_of
from swathe.truth import Route, true_world
from swathe.vehicle import load_vehicle, vehicle_names

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from swathe.grid import Position
    from swathe.preparation import Stopwatch
    from swathe.scenario import Scenario
    from swathe.soil import SoilClass
    from swathe.store.source import SoilLearning
    from swathe.vehicle import Vehicle

    OnProgress = Callable[[str, int, int], bool]

#: How far somebody's word on the soil of a place reaches.
WORD_RADIUS_M = 10.0

#: A drive may take this many times the time of its route, and at least so many seconds; and so many more for every
#: reading that it may stop for, at most one in so many metres where the robot itself says when.
_PATIENCE, _LEAST_LIMIT_S = 6.0, 300.0
_READING_S, _READINGS_M = 30.0, 10.0


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything that a drive needs.

    Attributes:
        scenario: what was asked for.
        vehicle: the vehicle.
        found: the plan and its ground; None in a world without a map.
        world: the truth; None when there is no route to drive.
        start: where the robot stands at first.
        goal: where it is to go.
        route: what things are placed along.
        vehicle_toml: the vehicle's file, empty for a bundled one.
        learning: the soil of a store's ground before anything was learnt there, and all that was read since.
        readings: hand readings that are known before the drive begins.
        soil_types: what readings are matched with.
    """

    scenario: Scenario
    vehicle: Vehicle
    vehicle_toml: str
    found: Found | None
    world: sim.World | None
    start: Pose
    goal: Position
    route: Route
    learning: SoilLearning | None = None
    readings: tuple[PenetrometerReading | ClassReading, ...] = ()
    soil_types: Mapping[SoilClass, SoilType] = field(default_factory=load_soil_types)

    @property
    def inputs(self) -> dict[str, str]:
        """Name and SHA-256 of every input."""
        if self.found is None:
            return {}
        given = {given["name"]: given["sha256"] for given in inputs_of(self.found.shown)}
        for name in (self.scenario.drive.soil_types, self.scenario.drive.readings):
            if name is not None:
                given[Path(name).name] = hashlib.sha256(Path(name).expanduser().read_bytes()).hexdigest()
        return given

    @property
    def why_not(self) -> str:
        """Why there is nothing to drive; empty when there is."""
        if self.world is not None or self.found is None:
            return ""
        return self.found.answer.reason or "Start and goal are the same place."

    @property
    def time_limit_s(self) -> float:
        """Simulated seconds after which the drive ends."""
        limit_s = self.scenario.drive.time_limit_s
        if limit_s is not None:
            return limit_s
        planned = None if self.found is None else self.found.answer.route
        usual_s = self.route.length_m / self.vehicle.max_speed_mps if planned is None else planned.time_s
        probing = self.scenario.probing
        spacing_m = {"never": math.inf, "every": probing.every_m}.get(probing.policy, _READINGS_M)
        return max(_LEAST_LIMIT_S, _PATIENCE * usual_s) + _READING_S * self.route.length_m / spacing_m

    def episode(self, *, records: bool = True) -> tuple[Episode, Navigator]:
        """Return the drive at its beginning, and the navigator that drives; ``records`` as in ``EpisodeParams``."""
        assert self.world is not None  # noqa: S101 - callers stop before when there is no route
        scenario, sensors, given = self.scenario, self.scenario.sensors, self.scenario.drive
        laser = sim.Laser.preset(sensors.laser)
        laser = replace(laser, dropout=sensors.beam_dropout) if sensors.beam_dropout else laser
        params = sim.RobotParams(
            has_laser=sensors.sensor != "sonar",
            sonar=sensors.sensor != "laser",
            scan_delay_s=sensors.scan_delay_s,
            scan_dropout=sensors.scan_dropout,
            scale_error=sensors.scale_error,
            distance_noise_m=sensors.distance_noise_m,
            heading_noise_rad=sensors.heading_noise_rad,
            heading_drift_radps=sensors.heading_drift_radps,
            fix_rate_hz=sensors.fix_rate_hz,
            fix_noise_m=sensors.fix_noise_m,
            fix_heading_noise_rad=sensors.fix_heading_noise_rad,
            blind_to_slip=sensors.blind_to_slip,
            fuses_fixes=sensors.fuses_fixes,
            probe_boom_m=scenario.probing.boom_m,
        )
        robot = sim.Robot(self.world, self.vehicle, self.start, laser=laser, params=params, seed=scenario.seed)
        how = DriveParams(
            method=given.method,
            outside_nests=given.outside_nests,
            evidence=given.evidence,
            fade_s=math.inf if given.fade_s is None else given.fade_s,
            arrival_m=given.arrival_m,
            margin_m=given.margin_m,
            memory=given.memory,
            recover=given.recover,
            probing=scenario.probing.text,
            probe_boom_m=scenario.probing.boom_m,
            sensor_height_m=laser.height_m,
        )
        goal = (self.goal.x_m, self.goal.y_m)
        navigator = Navigator(self.vehicle, goal, region=self._region(), params=how, seed=scenario.seed)
        known = self.readings if self.learning is None else (*self.learning.readings, *self.readings)
        for reading in known:
            if isinstance(reading, PenetrometerReading):
                navigator.learn_reading(reading)
            else:
                disc = (reading.x_m, reading.y_m, WORD_RADIUS_M)
                navigator.learn_soil(SoilUpdate(disc=disc, soil_class=reading.soil_class))
        limits = EpisodeParams(time_limit_s=self.time_limit_s, records=records)
        return Episode(self.world, robot, navigator, params=limits), navigator

    def _region(self) -> Region | None:
        """Return what the map knows, ready to learn; None without a map."""
        if self.found is None:
            return None
        region, grids = self.found.shown.region, self.scenario.drive.grids
        drive = self.scenario.drive
        belief = BeliefParams(rule=drive.soil_rule, types=self.soil_types)
        if self.learning is None:
            return Region.of(region, belief=belief, grids=grids)
        learning = self.learning
        unread = replace(region, soil=learning.codes)
        return Region.of(unread, belief=belief, grids=grids, layer=learning.layer, units=learning.units)


def stage(
    scenario: Scenario,
    *,
    vehicle_toml: str | None = None,
    watch: Stopwatch,
    on_progress: OnProgress | None = None,
) -> Stage:
    """Plan the route of a scenario and make its world; ``vehicle_toml`` stands for the vehicle's file.

    Raises:
        SwatheError: the inputs cannot be used, or the user stopped. That there is no route is no error: there is no
            world then.
    """
    vehicle, toml = _vehicle(scenario.vehicle, vehicle_toml)
    if scenario.world is not None:
        asked = scenario.world
        drawn = sim.random_world(scenario.seed, density=asked.density, kind=asked.kind, scale=asked.scale)
        points = np.array([(drawn.start.x_m, drawn.start.y_m), (drawn.goal.x_m, drawn.goal.y_m)])
        return Stage(scenario, vehicle, toml, None, drawn.world, drawn.start, drawn.goal, Route(points))
    terrain, settings = scenario.terrain_request(), scenario.settings()
    # The model saw to it that there are both.
    ends = (scenario.drive.start or (0.0, 0.0), scenario.drive.goal or (0.0, 0.0))
    with watch.step("open"):
        source = open_source(terrain)
    soil_types = load_soil_types(scenario.drive.soil_types)
    learning: SoilLearning | None = None
    readings: tuple[PenetrometerReading | ClassReading, ...] = ()
    with source:
        found = search(source, terrain, ends, settings, vehicle, watch=watch, lazily=False, on_progress=on_progress)
        if isinstance(source, StoredElevation):
            learning = source.learning(found.shown.frame)
        if scenario.drive.readings is not None:
            readings = tuple(
                read_readings(
                    scenario.drive.readings,
                    found.shown.frame,
                    points_crs=terrain.points_crs,
                    source_crs_wkt=source.source_crs_wkt,
                )
            )
    planned = found.answer.route
    if planned is None or not planned.legs:
        start, goal = found.ends
        between = Route(np.array([(start.x_m, start.y_m), (goal.x_m, goal.y_m)]))
        return Stage(scenario, vehicle, toml, found, None, Pose(start.x_m, start.y_m, 0.0), goal, between)
    route = Route(planned.xy_m)
    first, second = route.points_m[:2]
    heading_rad = math.atan2(second[1] - first[1], second[0] - first[0])
    if scenario.drive.start_bearing_deg is not None:
        heading_rad = math.radians(90 - scenario.drive.start_bearing_deg)
    ground = found.shown.region
    with watch.step("world"):
        soil = ground.soil if learning is None else learning.codes
        world = true_world(scenario, ground.geometry, ground.elevation_m, soil, route)
    goal = found.answer.goal[0] if found.answer.goal is not None else found.ends[1]
    stands = Pose(first[0], first[1], heading_rad)
    return Stage(scenario, vehicle, toml, found, world, stands, goal, route, learning, readings, soil_types)


def _vehicle(name: str, toml: str | None) -> tuple[Vehicle, str]:
    """Return a vehicle and, unless it is a bundled one, the text of its file."""
    if toml is not None:
        with tempfile.TemporaryDirectory(prefix="swathe-") as folder:
            path = Path(folder) / "vehicle.toml"
            path.write_text(toml, encoding="utf-8")
            return load_vehicle(path), toml
    vehicle = load_vehicle(name)
    return vehicle, "" if name in vehicle_names() else Path(name).read_text(encoding="utf-8-sig")
