"""An episode: a robot with its navigator drives in the simulated world, and all of it is told second by second.

The robot's beliefs and the truth meet only here. ``Episode.advance`` drives for some seconds and returns what happened
in them as a ``Second`` of numpy arrays, made in Rust without the interpreter. The same world, robot, navigator and
seeds give the same bytes; only ``Outcome.longest_step_s`` is measured with a clock.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from swathe import _core
from swathe.errors import InvalidParameterError
from swathe.sensor import PenetrometerReading

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray

    from swathe.drive import Navigator
    from swathe.sim import Robot, World

#: Status of a command by its code in ``Commands.status``.
STATUSES = ("driving", "recovering", "reached", "stopped", "no_route", "fault")


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """Scans that reached the robot, in the order of their arrival, with the sensor's description.

    Attributes:
        times_s: when each was taken, (n,).
        arrivals_s: when each reached the robot, (n,).
        ranges_m: (n, beams); infinite is clear, NaN or below ``range_min_m`` invalid.
        mount: ahead, left and heading of the sensor on the body.
    """

    times_s: NDArray[np.float64]
    arrivals_s: NDArray[np.float64]
    ranges_m: NDArray[np.float32]
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Sonar:
    """What the cones of the sonar ring heard, one row a cone, in the order of arrival; no rows without a ring.

    Attributes:
        times_s: when each was taken, (n,).
        arrivals_s: when each reached the robot, (n,).
        cones: number of the cone in the ring, (n,).
        ranges_m: (n,); infinite is clear, NaN or below ``range_min_m`` invalid.
        cone_rad: width of a cone.
        mounts: ahead, left and heading of each cone on the body.
    """

    times_s: NDArray[np.float64]
    arrivals_s: NDArray[np.float64]
    cones: NDArray[np.uint8]
    ranges_m: NDArray[np.float32]
    cone_rad: float
    range_min_m: float
    range_max_m: float
    mounts: list[tuple[float, float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Where a robot was and how it moved, one row a step, each (n,): as it believes, or in truth.

    Believed speed is that of the wheels, the true one is over the ground. Nose up and right side down are positive.
    """

    times_s: NDArray[np.float64]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    pitch_rad: NDArray[np.float64]
    roll_rad: NDArray[np.float64]
    speed_mps: NDArray[np.float64]
    turn_rate_radps: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Commands:
    """What the robot was told, one row a step, each (n,); ``status`` counts into ``STATUSES``."""

    times_s: NDArray[np.float64]
    speed_mps: NDArray[np.float64]
    turn_rate_radps: NDArray[np.float64]
    status: NDArray[np.uint8]


class Event(NamedTuple):
    """Something that happened; ``fields`` holds what JSON can hold."""

    time_s: float
    kind: str
    fields: dict[str, Any]


class Line(NamedTuple):
    """A way or route as it was from a time on: ``points_m`` is (k, 2), east and north; empty where there is none."""

    time_s: float
    points_m: NDArray[np.float64]


class CertaintyMap(NamedTuple):
    """The certainty window at a time: rows from north to south, 0 (free) to 15 (surely closed), 255 never seen."""

    time_s: float
    certainty: NDArray[np.uint8]
    west_m: float
    north_m: float
    cell_size_m: float


class Histogram(NamedTuple):
    """The polar histogram of the local method at a time.

    ``fields``: ``densities`` by sector, the first one's direction ``first_rad`` counter-clockwise from east,
    ``thresholds`` (low, high), ``blocked`` and ``masked`` by sector, ``direction_rad`` (None when it finds no
    direction).
    """

    time_s: float
    fields: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Movers:
    """Where what moves was: times (n,), places (n, movers, 2), radii (movers,)."""

    times_s: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    radii_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Grids:
    """What the overlapping grids said of the robot's pose, one row a step; no rows without a region.

    Attributes:
        times_s: (n,).
        answers: (n, grids), whether each grid holds the pose navigable.
        navigable: (n,), the answer in the grids' mode.
    """

    times_s: NDArray[np.float64]
    answers: NDArray[np.bool_]
    navigable: NDArray[np.bool_]


class Reading(NamedTuple):
    """A penetrometer reading and when it was done."""

    time_s: float
    reading: PenetrometerReading


@dataclass(frozen=True, slots=True, eq=False)
class Second:
    """What happened from ``start_s`` (with it) to ``end_s`` (without it; with it at the end of an episode).

    Attributes:
        scans: scans that arrived.
        sonar: what arrived from the sonar ring.
        odometry: the robot as it believes, one row a step.
        truth: the body, the same rows.
        commands: the same rows.
        events: everything else that happened, in order.
        ways: the local route, whenever it changed.
        routes: the global route, whenever it changed.
        maps: the certainty window, once a second.
        histograms: the local method's histogram, twice a second.
        movers: what moves, twice a second.
        readings: penetrometer readings.
        grids: what the overlapping grids said.
    """

    start_s: float
    end_s: float
    scans: Scans
    sonar: Sonar
    odometry: Motion
    truth: Motion
    commands: Commands
    events: list[Event]
    ways: list[Line]
    routes: list[Line]
    maps: list[CertaintyMap]
    histograms: list[Histogram]
    movers: Movers
    readings: list[Reading]
    grids: Grids


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an episode ended.

    Attributes:
        status: ``reached``, ``not_reached``, ``collision`` or ``timeout``.
        reason: why, in a sentence.
        distance_m: driven, as the body moved in truth.
        duration_s: simulated.
        min_clearance_m: least true distance of the footprint to anything that stands or moves; None when nothing was
            near.
        collisions: how often the body ran into something.
        replans: how often the local route was laid anew or mended.
        probes: readings taken.
        soil_updates: how often knowledge of the soil came from outside.
        no_go_entries: how often the body came onto ground beyond its vehicle's limits.
        goal_distance_m: true distance to the goal at the end.
        top_speed_mps: greatest true speed.
        longest_step_s: longest step of the navigator by the computer's clock; the one figure that differs from run to
            run.
    """

    status: Literal["reached", "not_reached", "collision", "timeout"]
    reason: str
    distance_m: float
    duration_s: float
    min_clearance_m: float | None
    collisions: int
    replans: int
    probes: int
    soil_updates: int
    no_go_entries: int
    goal_distance_m: float
    top_speed_mps: float
    longest_step_s: float


FaultKind = Literal[
    "scan_dead",
    "scan_nan",
    "scan_zero",
    "scan_beams",
    "scan_max",
    "scan_repeated",
    "scan_late",
    "scan_swapped",
    "pose_off",
    "clock_off",
    "reading_of",
]


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong between the sensors and the navigator, from one time up to another.

    ``scan_dead``: no scan comes. ``scan_nan``, ``scan_zero``, ``scan_max``: every range is that. ``scan_beams``: a scan
    has ``figures[0]`` beams. ``scan_repeated``: the first scan comes again and again. ``scan_late``: scans come
    ``figures[0]`` seconds later. ``scan_swapped``: every other scan comes after the next. ``pose_off``: the pose is off
    by ``figures`` (east, north, heading). ``clock_off``: the clock is off by ``figures[0]`` seconds. ``reading_of``:
    penetrometer readings say ``figures[0]`` kPa. What befalls scans befalls the cones of a sonar ring too.
    """

    kind: FaultKind
    from_s: float = 0.0
    until_s: float = float("inf")
    figures: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeParams:
    """How an episode runs.

    Attributes:
        control_period_s: seconds between steps of the navigator; None for 1/35, one a scan of the SICK LMS 200.
        time_limit_s: simulated seconds after which it ends as ``timeout``.
        patience_s: seconds standing without a way, or with a fault, after which it ends as ``not_reached``.
        stops_at_collision: whether the first collision ends it.
        records: whether rows, maps and histograms are recorded; events and the outcome always are.
        faults: what goes wrong with the sensors, and when.
    """

    control_period_s: float | None = None
    time_limit_s: float = 600.0
    patience_s: float = 15.0
    stops_at_collision: bool = True
    records: bool = True
    faults: tuple[Fault, ...] = ()


class Episode:
    """A drive in the simulated world, from its beginning on.

    The robot and the navigator stay the caller's: between two calls of ``advance`` they may be looked at, and the
    navigator may be given a new goal or new knowledge.
    """

    def __init__(
        self, world: World, robot: Robot, navigator: Navigator, *, params: EpisodeParams | None = None
    ) -> None:
        """Begin an episode with the robot as it is.

        Raises:
            InvalidParameterError: the robot is in another world, or a parameter is outside its range.
        """
        if not robot.core.is_in(world.core):
            raise InvalidParameterError("The robot is in another world.", "Give the world that the robot was put into.")
        given = params or EpisodeParams()
        figures = asdict(given)
        figures["faults"] = [(fault.from_s, fault.until_s, fault.kind, list(fault.figures)) for fault in given.faults]
        self._core = _core.Episode(robot.core, navigator.core, figures)

    def advance(self, seconds: float = 1.0) -> Second:
        """Drive on for some seconds, or to the end, and return what happened."""
        return _second(self._core.advance(seconds))

    @property
    def outcome(self) -> Outcome | None:
        """How it ended; None while it goes on."""
        told = self._core.outcome()
        return None if told is None else Outcome(**told)

    def seconds(self, seconds: float = 1.0) -> Iterator[Second]:
        """Drive to the end, piece by piece."""
        while self._core.outcome() is None:
            yield self.advance(seconds)

    def run(self) -> Outcome:
        """Drive to the end and return how it went; what was recorded on the way is let go."""
        while (outcome := self.outcome) is None:
            self._core.advance(10.0)
        return outcome

    def ask_for_probe(self) -> None:
        """Have the robot stop and probe the soil, as an operator would."""
        self._core.ask_for_probe()


def _second(told: dict[str, Any]) -> Second:
    return Second(
        start_s=told["start_s"],
        end_s=told["end_s"],
        scans=Scans(**told["scans"]),
        sonar=Sonar(**told["sonar"]),
        odometry=Motion(**told["odometry"]),
        truth=Motion(**told["truth"]),
        commands=Commands(**told["commands"]),
        events=[Event(*event) for event in told["events"]],
        ways=[Line(*line) for line in told["ways"]],
        routes=[Line(*line) for line in told["routes"]],
        maps=[CertaintyMap(*window) for window in told["maps"]],
        histograms=[Histogram(*row) for row in told["histograms"]],
        movers=Movers(**told["movers"]),
        readings=[
            Reading(time_s, PenetrometerReading(place[0], place[1], tuple(depths_m), tuple(indices_kpa), refusal_m))
            for time_s, (place, depths_m, indices_kpa, refusal_m) in told["readings"]
        ],
        grids=Grids(**told["grids"]),
    )
