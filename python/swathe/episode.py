"""An episode: a robot with its navigator drives in the simulated world, and all of it is told second by second.

The robot's beliefs and the truth meet only here. ``Episode.advance`` drives for some seconds and returns what happened
in them as a ``Second`` of numpy arrays, made in Rust without the interpreter. The same world, robot, navigator and
seeds give the same bytes; only ``Outcome.longest_step_s`` is measured with a clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swathe.sensor import PenetrometerReading

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
    """The certainty window at a time: rows from north to south, 0 (free or never seen) to 15 (surely closed)."""

    time_s: float
    certainty: NDArray[np.uint8]
    west_m: float
    north_m: float
    cell_size_m: float


class Histogram(NamedTuple):
    """The polar histogram of the local method at a time.

    ``fields``: ``densities`` by sector counter-clockwise from east, ``thresholds``, ``blocked`` and ``masked`` by sector
    where the method has them, ``direction_rad`` (None when every direction is closed).
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
        longest_step_s: longest step of the navigator by the computer's clock; the one figure that differs from run to run.
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
