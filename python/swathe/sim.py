"""The simulated world: the truth, apart from everything that a robot believes.

A ``World`` holds real terrain and soil, obstacles, ditches and what moves. A ``Robot`` drives in it with its vehicle's
limits and slip, and senses it with noise, loss and delay. Everything drawn comes from seeds: the same seed and commands
give the same bytes.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.grid import GridGeometry, Position, as_codes
from swathe.sensor import PenetrometerReading, Pose, Scan
from swathe.terrain import as_heights
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    _Five = tuple[float, float, float, float, float]
    _StateFigures = tuple[tuple[float, _Five, float], _Five, str | None, str | None, int]

Kind = Literal["clutter", "corridor", "u-trap", "dead-end", "moving"]
NoGo = Literal["obstacle", "soil", "grade", "side_slope", "unknown", "outside"]
Stop = Literal["collision", "sunk", "edge"]
Preset = Literal["sick-lms200-8m", "sick-lms200-80m", "sick-lms200-8m-361", "sick-lms200-80m-361"]
_SEEDS = 2**64


@dataclass(frozen=True, slots=True)
class Disc:
    """An upright disc."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float = 1.0


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box turned by a heading, such as a crate."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float
    heading_rad: float = 0.0
    height_m: float = 1.0

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Its corners, counter-clockwise."""
        cos, sin = math.cos(self.heading_rad), math.sin(self.heading_rad)
        sides = [(self.length_m / 2 * ahead, self.width_m / 2 * left) for ahead, left in _CORNERS]
        return [(self.x_m + cos * x - sin * y, self.y_m + sin * x + cos * y) for x, y in sides]


_CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


@dataclass(frozen=True, slots=True)
class Polygon:
    """A solid upright polygon without crossings: its corners (x, y) in order."""

    points: Sequence[tuple[float, float]]
    height_m: float = 1.0


@dataclass(frozen=True, slots=True)
class Wall:
    """A thin wall along points (x, y)."""

    points: Sequence[tuple[float, float]]
    height_m: float = 2.0


@dataclass(frozen=True, slots=True)
class Mover:
    """A disc that goes to and fro along a path; ``start_m`` is how far along it is at time 0."""

    path: Sequence[tuple[float, float]]
    speed_mps: float
    radius_m: float = 0.3
    start_m: float = 0.0


@dataclass(frozen=True, slots=True)
class TruthErrors:
    """How the truth differs from a map: smooth errors of height, and patches whose soil is another."""

    height_m: float = 0.0
    patch_m: float = 30.0
    soil_share: float = 0.0


class Way(NamedTuple):
    """A way for a vehicle: metres driven, and poses along it."""

    length_m: float
    poses: list[Pose]


class World:
    """True terrain and soil, and what stands and moves on it."""

    def __init__(
        self,
        elevation_m: ArrayLike,
        soil: ArrayLike | None = None,
        *,
        cell_size_m: float = 1.0,
        west_m: float = 0.0,
        north_m: float | None = None,
        moisture_percent: float = 20.0,
        errors: TruthErrors | None = None,
        seed: int = 0,
    ) -> None:
        """Make a world of heights in metres and soil codes (gravel when not given).

        ``north_m`` is the north edge; when not given the south edge is 0. With ``errors`` the layers are a map, and the
        truth behind it is drawn.

        Raises:
            ShapeMismatchError: the layers differ in shape.
            InvalidParameterError: a code, the moisture, the errors or the geometry is not usable.
        """
        heights = as_heights(elevation_m)
        codes = np.full(heights.shape, 1, dtype=np.uint8) if soil is None else as_codes(soil, "soil layer")
        if codes.shape != heights.shape:
            raise ShapeMismatchError(
                f"The soil layer has the shape {codes.shape}, the elevation {heights.shape}.",
                "Give layers of one shape.",
            )
        north_m = heights.shape[0] * cell_size_m if north_m is None else north_m
        drawn = None if errors is None else (errors.height_m, errors.patch_m, errors.soil_share)
        shape = (*heights.shape, cell_size_m, west_m, north_m)
        self.core = _core.SimWorld(heights, codes, shape, moisture_percent, drawn, _seed(seed))

    @classmethod
    def from_core(cls, core: _core.SimWorld) -> World:
        """Return the world that the core has drawn."""
        world = cls.__new__(cls)
        world.core = core
        return world

    def place(self, *obstacles: Disc | Box | Polygon | Wall) -> None:
        """Put obstacles into the world; vehicles drive over what is not higher than their step height.

        Raises:
            InvalidParameterError: a shape is not one.
        """
        discs = [((o.x_m, o.y_m), o.radius_m, o.height_m) for o in obstacles if isinstance(o, Disc)]
        boxes = [(o.corners, o.height_m) for o in obstacles if isinstance(o, Box)]
        polygons = [(_points(o.points), o.height_m) for o in obstacles if isinstance(o, Polygon)]
        walls = [(_points(o.points), o.height_m) for o in obstacles if isinstance(o, Wall)]
        self.core.place(discs, boxes + polygons, walls)

    def set_in_motion(self, *movers: Mover) -> None:
        """Set discs in motion; where they are depends on the time alone.

        Raises:
            InvalidParameterError: a path, speed or radius is not usable.
        """
        self.core.set_in_motion([(_points(m.path), m.speed_mps, m.radius_m, m.start_m) for m in movers])

    def dig(self, line: Sequence[tuple[float, float]], width_m: float, depth_m: float) -> None:
        """Dig a ditch along points (x, y): cells whose centre is within half the width lie deeper.

        Raises:
            InvalidParameterError: the line has fewer than two points, or width or depth is not above 0.
        """
        self.core.dig(_points(line), width_m, depth_m)

    @property
    def geometry(self) -> GridGeometry:
        """Where the cells of the ground lie."""
        return GridGeometry(*self.core.geometry())

    @property
    def elevation_m(self) -> NDArray[np.float32]:
        """True heights."""
        return np.asarray(self.core.elevation_m())

    @property
    def soil(self) -> NDArray[np.uint8]:
        """True soil codes."""
        return np.asarray(self.core.soil())

    @property
    def obstacles(self) -> list[Disc | Polygon | Wall]:
        """What stands; boxes come back as polygons."""
        found: list[Disc | Polygon | Wall] = []
        for kind, points, radius_m, height_m in self.core.obstacles():
            if kind == "disc":
                found.append(Disc(*points[0], radius_m, height_m))
            else:
                found.append((Polygon if kind == "polygon" else Wall)(points, height_m))
        return found

    def movers_at(self, time_s: float) -> list[Disc]:
        """Return what moves, where it is at a time."""
        return [Disc(*at, radius_m) for at, radius_m in self.core.movers(time_s)]

    def height_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height at a place, or None where it is not known."""
        return self.core.height_m((x_m, y_m))

    def collides(self, vehicle: Vehicle | str | Path, pose: Pose, time_s: float = 0.0) -> bool:
        """Return whether the vehicle's rectangle meets an obstacle or mover; touching counts."""
        return self.core.collides(_vehicle(vehicle).core, _plane(pose), time_s)

    def no_go(self, vehicle: Vehicle | str | Path, pose: Pose, time_s: float = 0.0) -> NoGo | None:
        """Return why the vehicle must not be at a pose, or None where it may."""
        return cast("NoGo | None", self.core.no_go(_vehicle(vehicle).core, _plane(pose), time_s))

    def way(self, vehicle: Vehicle | str | Path, start: Pose, goal: tuple[float, float]) -> Way | None:
        """Return the shortest way that a search of poses finds, or None: the truth that trials are judged by.

        The vehicle's rectangle, 0.1 m wider on every side, is free at every pose; a vehicle with a turning circle keeps
        to it, forwards and backwards. It ends within 0.3 m of the goal, in any heading. What moves is left out.
        """
        found = self.core.way(_vehicle(vehicle).core, _plane(start), (goal[0], goal[1]))
        if found is None:
            return None
        return Way(found[0], [Pose(*pose) for pose in found[1]])

    def passable(self, vehicle: Vehicle | str | Path, start: Pose, goal: tuple[float, float]) -> float | None:
        """Return the length of ``way``, or None when there is none."""
        found = self.way(vehicle, start, goal)
        return None if found is None else found.length_m


@dataclass(frozen=True, slots=True)
class Laser:
    """A laser scanner. Nearer than the least range it gives 0, beyond the greatest infinity, for a lost beam NaN."""

    beams: int
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: tuple[float, float, float]
    height_m: float
    rate_hz: float
    noise_m: float
    bias_m: float
    dropout: float
    resolution_m: float

    @classmethod
    def preset(cls, name: Preset = "sick-lms200-8m") -> Laser:
        """Return the SICK LMS 200: 181 beams (or 361) over half a turn, its 8 m or 80 m mode.

        Raises:
            InvalidParameterError: there is no such preset.
        """
        known = ("sick-lms200-8m", "sick-lms200-80m", "sick-lms200-8m-361", "sick-lms200-80m-361")
        if name not in known:
            raise InvalidParameterError(f"The laser {name!r} is not known.", f"Choose one of {', '.join(known)}.")
        return cls(**_core.sick_lms200(name.endswith("361"), "80m" in name))


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotParams:
    """How exactly a robot moves and knows where it is; the usual values give exact poses without delay.

    ``sonar`` gives it the Pioneer's ring, drawn out to the vehicle's length and width; without ``has_laser`` that is
    all it sees with.

    Odometry: ``scale_error`` and ``heading_drift_radps`` are deviations drawn once a run; noises are per root of a
    metre driven; ``blind_to_slip`` makes it count wheels. Fixes replace the estimate ``fix_rate_hz`` times a second, or
    with ``fuses_fixes`` are weighed against it by the variances of both. ``probe_boom_m`` is the distance from the
    vehicle's front edge forwards to the cone of the penetrometer, at most 20 m either way.
    """

    has_laser: bool = True
    sonar: bool = False
    scan_delay_s: float = 0.0
    scan_dropout: float = 0.0
    slip_variation: float = 0.2
    scale_error: float = 0.0
    distance_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    heading_drift_radps: float = 0.0
    fix_rate_hz: float = 0.0
    fix_noise_m: float = 0.0
    fix_heading_noise_rad: float = 0.0
    blind_to_slip: bool = False
    fuses_fixes: bool = False
    probe_boom_m: float = 0.5


@dataclass(frozen=True, slots=True)
class State:
    """The truth about a robot.

    ``stop`` is what kept it from moving in the last step, ``no_go`` which limit it is beyond; ``slip`` is the share of
    the running gear's motion that is lost.
    """

    time_s: float
    pose: Pose
    height_m: float
    wheel_speed_mps: float
    wheel_turn_rate_radps: float
    speed_mps: float
    turn_rate_radps: float
    slip: float
    stop: Stop | None
    no_go: NoGo | None
    collisions: int


class Observation(NamedTuple):
    """What reaches the robot after a step: the pose it thinks it has, and a scan with its time, if any came."""

    pose: Pose
    scan: Scan | None
    scan_time_s: float | None
    state: State


class Robot:
    """A vehicle in a world, with a laser, a penetrometer and, if asked for, the Pioneer's sonar ring."""

    def __init__(
        self,
        world: World,
        vehicle: Vehicle | str | Path,
        pose: Pose,
        *,
        laser: Laser | None = None,
        params: RobotParams | None = None,
        seed: int = 0,
    ) -> None:
        """Put a robot at rest at a place and heading; its attitude follows from the ground.

        Raises:
            InvalidParameterError: the pose, the laser or a parameter is not usable.
        """
        machine = _vehicle(vehicle)
        motion = (
            machine.steering,
            machine.max_acceleration_mps2,
            machine.max_braking_mps2,
            machine.max_turn_rate_radps,
        )
        laser = laser or Laser.preset()
        sensing = {field.name: getattr(laser, field.name) for field in fields(laser)}
        given = {**asdict(params or RobotParams()), "seed": _seed(seed)}
        self._core = _core.SimRobot(world.core, machine.core, motion, _plane(pose), sensing, given)

    @property
    def core(self) -> _core.SimRobot:
        """The robot in the core."""
        return self._core

    def step(self, command: tuple[float, float], duration_s: float) -> Observation:
        """Drive with a command (speed in m/s, turn rate in rad/s) for a time of at most a minute."""
        pose, scan, state = self._core.step(*command, duration_s)
        taken_s, figures = scan or (None, None)
        return Observation(Pose(*pose), None if figures is None else Scan(*figures), taken_s, _state(state))

    def scan(self) -> Scan:
        """Return a scan of this moment."""
        return Scan(*self._core.scan())

    def sonar(self) -> list[Scan]:
        """Return a scan of one beam from every sonar; none without a ring."""
        return [Scan(*figures) for figures in self._core.sonar()]

    def probe(self) -> PenetrometerReading:
        """Stop, push the penetrometer in, and return the reading; simulated time passes, 15 s for 30 cm."""
        (x_m, y_m), depths_m, cone_indices_kpa, refusal_depth_m = self._core.probe()
        return PenetrometerReading(x_m, y_m, tuple(depths_m), tuple(cone_indices_kpa), refusal_depth_m)

    @property
    def pose(self) -> Pose:
        """Where the robot thinks it is."""
        return Pose(*self._core.pose())

    @property
    def state(self) -> State:
        """The truth."""
        return _state(self._core.state())


class Scenario(NamedTuple):
    """A drawn world with where to go."""

    world: World
    start: Pose
    goal: Position


def random_world(seed: int, *, density: float = 2.5, kind: Kind = "clutter", scale: float = 1.0) -> Scenario:
    """Draw a world of 40 x 40 m around the origin: level gravel, start in the west, goal in the east, a wall around it.

    ``density`` is crates per 100 m2 (2.5 gives 40); ``scale`` enlarges the world and its crates for larger vehicles.
    Draws do not check that there is a way; ``World.passable`` does.

    Raises:
        InvalidParameterError: the density is not from 0 to 50, the scale not from 1 to 20, or there is no such kind.
    """
    core, start, goal = _core.random_world(_seed(seed), density, kind, scale)
    return Scenario(World.from_core(core), Pose(*start), Position(*goal))


def _state(figures: _StateFigures) -> State:
    (time_s, pose, height_m), motion, stop, no_go, collisions = figures
    wheel_speed_mps, wheel_turn_rate_radps, speed_mps, turn_rate_radps, slip = motion
    return State(
        time_s,
        Pose(*pose),
        height_m,
        wheel_speed_mps,
        wheel_turn_rate_radps,
        speed_mps,
        turn_rate_radps,
        slip,
        cast("Stop | None", stop),
        cast("NoGo | None", no_go),
        collisions,
    )


def _plane(pose: Pose) -> tuple[float, float, float]:
    return (pose.x_m, pose.y_m, pose.heading_rad)


def _points(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in points]


def _vehicle(vehicle: Vehicle | str | Path) -> Vehicle:
    return vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)


def _seed(seed: int) -> int:
    if not 0 <= seed < _SEEDS:
        raise InvalidParameterError(f"The seed {seed} is not one.", "Give a whole number from 0 to 2^64 - 1.")
    return int(seed)
