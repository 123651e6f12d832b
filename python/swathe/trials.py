"""Trials: many drawn worlds, a drive through each, and what all of them together say.

Every trial is drawn from its seed and is judged by the truth: passable is what a search of poses that shares no code
with any planner finds (``sim.World.way``). Trials run in worker processes, in any number the rows are the same. Shares
come with Wilson's interval, medians and ratios with a bootstrap interval.
"""

from __future__ import annotations

import csv
import io
import math
import multiprocessing
import signal
import time
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import numpy as np
import shapely

from swathe import sim
from swathe.drive import DriveParams, Navigator
from swathe.episode import Episode, EpisodeParams
from swathe.random import uniform
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

Item = TypeVar("Item")
Answer = TypeVar("Answer")

Method = Literal["vfh", "vfh+", "vfh*", "player"]
KINDS: tuple[sim.Kind, ...] = get_args(sim.Kind)

#: Vehicles of drawn trials, 0.4 to 4.4 m long, the Jackal more often than the others.
VEHICLES = ("jackal", "jackal", "jackal", "pioneer-2dx", "husky", "warthog", "tractor")

#: Crates per 100 m2: from open to where a Jackal hardly gets through.
DENSITIES = (0.0, 36.0)

#: A vehicle whose circle has this radius gets a world of 40 m; larger ones a larger world.
_RADIUS_M = 0.7

#: The laser's 80 m mode from this scale on.
_FAR_SCALE = 1.2

#: What ``--noise`` means everywhere, as fields of a scenario's ``[sensors]``: a tenth of the beams lost, scans 0.1 s
#: late, odometry off by 2 % and corrected once a second to 0.3 m.
NOISE: dict[str, Any] = {
    "beam_dropout": 0.1,
    "scan_delay_s": 0.1,
    "scale_error": 0.02,
    "distance_noise_m": 0.02,
    "heading_noise_rad": 0.01,
    "fix_rate_hz": 1.0,
    "fix_noise_m": 0.3,
    "fix_heading_noise_rad": 0.05,
    "fuses_fixes": True,
}

#: Streams of ``swathe.random``; resampling takes the next one for every block of so many numbers.
_DRAW, _RESAMPLE = 103, 1000
_BLOCK = 1 << 22

#: Free space: nothing, and not the goal, nearer to the footprint than the vehicle's stopping distance and so much more.
_FREE_BEYOND_M = 2.0

#: Seconds after which a drive is over, in a world of the usual scale; or so many times the shortest way at full speed.
_LIMIT_S, _LIMIT_FACTOR = 1800.0, 20.0

#: Seconds between two looks at where the robot is and how fast.
_LOOK_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One drive through one drawn world.

    Attributes:
        seed: of the world and of the robot's noise.
        kind: of the world.
        density: crates per 100 m2, in worlds of the usual scale.
        vehicle: name of a vehicle.
        method: local method.
        alone: whether the local method drives alone, without memory, route and recoveries.
        noisy: 100 ms delay, 10 % of beams lost, 2 % odometry noise with a fix of 0.3 m once a second.
    """

    seed: int
    kind: sim.Kind = "clutter"
    density: float = 2.5
    vehicle: str = "jackal"
    method: Method = "vfh+"
    alone: bool = False
    noisy: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """How one trial went.

    Attributes:
        shortest_m: shortest true way; None where the search finds none, and then ``status`` is ``not_passable``.
        fastest_s: that way at the vehicle's greatest speed.
        status: as in ``episode.Outcome``, or ``not_passable``.
        seen_in_time: whether what was run into could have been seen while there was time to stop.
        free_s: seconds in free space: everything that stands or moves, and the goal, is farther from the footprint than
            the vehicle's stopping distance from its greatest speed and 2 m, and has been for as long as the vehicle
            needs to come to that speed from the one at which it got there.
        free_m: metres driven in them.
        cpu_s: CPU seconds of the drive; differs from run to run.
    """

    seed: int
    kind: str
    density: float
    vehicle: str
    method: str
    alone: bool
    noisy: bool
    shortest_m: float | None
    fastest_s: float | None
    status: str
    reason: str = ""
    distance_m: float = 0.0
    duration_s: float = 0.0
    min_clearance_m: float | None = None
    collisions: int = 0
    hit_a_mover: bool = False
    seen_in_time: bool = False
    recoveries: int = 0
    replans: int = 0
    goal_distance_m: float = math.nan
    top_speed_mps: float = 0.0
    free_s: float = 0.0
    free_m: float = 0.0
    cpu_s: float = 0.0

    @property
    def free_at_full_speed_m(self) -> float:
        """Metres that the vehicle's greatest speed makes in the seconds in free space."""
        return 0.0 if not self.fastest_s or not self.shortest_m else self.free_s * self.shortest_m / self.fastest_s

    @property
    def length_ratio(self) -> float | None:
        """Driven length over the shortest true way."""
        return None if not self.shortest_m else self.distance_m / self.shortest_m

    @property
    def time_ratio(self) -> float | None:
        """Driven time over the shortest true way at full speed."""
        return None if not self.fastest_s else self.duration_s / self.fastest_s


def draw(seed: int, *, noisy: bool = False, vehicles: Sequence[str] = VEHICLES) -> Trial:
    """Draw a trial: its kind of world, its density of crates and its vehicle."""
    kind, crates, vehicle = (float(chance) for chance in uniform(seed, _DRAW, 3))
    low, high = DENSITIES
    return Trial(
        seed=seed,
        kind=KINDS[int(kind * len(KINDS))],
        density=round(low + (high - low) * crates, 2),
        vehicle=vehicles[int(vehicle * len(vehicles))],
        noisy=noisy,
    )


def world_of(trial: Trial) -> sim.Scenario:
    """Return the world of a trial."""
    return sim.random_world(
        trial.seed, density=trial.density, kind=trial.kind, scale=scale_of(load_vehicle(trial.vehicle))
    )


def scale_of(vehicle: Vehicle) -> float:
    """Return how much larger than usual a vehicle's worlds are."""
    return max(1.0, math.hypot(vehicle.length_m, vehicle.width_m) / 2 / _RADIUS_M)


def limit_s(vehicle: Vehicle, fastest_s: float) -> float:
    """Return the seconds after which a trial's drive is over, by those of the shortest way at full speed."""
    return max(_LIMIT_S * scale_of(vehicle), _LIMIT_FACTOR * fastest_s)


def laser_of(vehicle: Vehicle) -> sim.Preset:
    """Return the name of the laser that a vehicle has in trials."""
    return "sick-lms200-80m" if scale_of(vehicle) >= _FAR_SCALE else "sick-lms200-8m"


def begin(trial: Trial, *, records: bool = True, time_limit_s: float = 600.0) -> tuple[Episode, sim.Scenario]:
    """Return the episode of a trial before its first step, and its world."""
    episode, scenario, _ = _begin(trial, records=records, time_limit_s=time_limit_s)
    return episode, scenario


def _begin(trial: Trial, *, records: bool, time_limit_s: float) -> tuple[Episode, sim.Scenario, sim.Robot]:
    vehicle = load_vehicle(trial.vehicle)
    scenario = world_of(trial)
    laser = sim.Laser.preset(laser_of(vehicle))
    params = sim.RobotParams()
    if trial.noisy:
        of_robot = dict(NOISE)
        laser = replace(laser, dropout=of_robot.pop("beam_dropout"))
        params = sim.RobotParams(**of_robot)
    robot = sim.Robot(scenario.world, vehicle, scenario.start, laser=laser, params=params, seed=trial.seed)
    drive = DriveParams(method=trial.method, memory=not trial.alone, recover=not trial.alone)
    navigator = Navigator(vehicle, (scenario.goal.x_m, scenario.goal.y_m), params=drive, seed=trial.seed)
    limits = EpisodeParams(time_limit_s=time_limit_s, records=records)
    return Episode(scenario.world, robot, navigator, params=limits), scenario, robot


def run_one(trial: Trial) -> Row:
    """Run one trial. What the search finds no way for is not driven."""
    vehicle = load_vehicle(trial.vehicle)
    scenario = world_of(trial)
    shortest_m = scenario.world.passable(vehicle, scenario.start, scenario.goal)
    known: dict[str, Any] = asdict(trial)
    if shortest_m is None:
        return Row(**known, shortest_m=None, fastest_s=None, status="not_passable")
    fastest_s = shortest_m / vehicle.max_speed_mps
    begun_s = time.process_time()
    episode, _, robot = _begin(trial, records=False, time_limit_s=limit_s(vehicle, fastest_s))
    collision: dict[str, Any] = {}
    recoveries = 0
    looks: list[sim.State] = []
    for second in episode.seconds(_LOOK_S):
        looks.append(robot.state)
        for event in second.events:
            recoveries += event.kind == "recovery"
            if event.kind == "collision":
                collision = event.fields
    outcome = episode.outcome
    if outcome is None:  # pragma: no cover - seconds() ends with an outcome
        raise AssertionError
    cpu_s = time.process_time() - begun_s
    free_s, free_m = free_space(scenario, vehicle, looks)
    return Row(
        **known,
        shortest_m=shortest_m,
        fastest_s=fastest_s,
        status=outcome.status,
        reason=outcome.reason,
        distance_m=outcome.distance_m,
        duration_s=outcome.duration_s,
        min_clearance_m=outcome.min_clearance_m,
        collisions=outcome.collisions,
        hit_a_mover=bool(collision.get("moves")),
        seen_in_time=bool(collision.get("seen_in_time")),
        recoveries=recoveries,
        replans=outcome.replans,
        goal_distance_m=outcome.goal_distance_m,
        top_speed_mps=outcome.top_speed_mps,
        free_s=free_s,
        free_m=free_m,
        cpu_s=cpu_s,
    )


def free_space(scenario: sim.Scenario, vehicle: Vehicle, looks: Sequence[sim.State]) -> tuple[float, float]:
    """Return the seconds in free space and the metres driven in them, as ``Row`` says, of states in their order."""
    if not looks:
        return 0.0, 0.0
    speed_mps = vehicle.max_speed_mps
    stopping_m = speed_mps * vehicle.reaction_time_s + speed_mps**2 / (2 * vehicle.max_braking_mps2)
    apart_m = stopping_m + _FREE_BEYOND_M
    footprints = shapely.polygons(
        [sim.Box(*_place(look), vehicle.length_m, vehicle.width_m, look.pose.heading_rad).corners for look in looks]
    )
    near = np.zeros(len(looks), dtype=bool)
    standing = [_shape(obstacle) for obstacle in scenario.world.obstacles]
    standing.append(shapely.Point(scenario.goal.x_m, scenario.goal.y_m))
    hits, _ = shapely.STRtree(standing).query(footprints, predicate="dwithin", distance=apart_m)
    near[hits] = True
    for number in np.flatnonzero(~near).tolist():
        discs = scenario.world.movers_at(looks[number].time_s)
        places = [shapely.Point(disc.x_m, disc.y_m) for disc in discs]
        away_m = shapely.distance(footprints[number], places) - [disc.radius_m for disc in discs]
        near[number] = bool(np.any(away_m <= apart_m))
    free_s = free_m = 0.0
    counts_from_s = math.inf
    for before, look, was_near, is_near in zip(looks, looks[1:], near, near[1:], strict=False):
        if is_near:
            counts_from_s = math.inf
        elif was_near or math.isinf(counts_from_s):
            lacking_mps = max(0.0, speed_mps - abs(look.speed_mps))
            counts_from_s = look.time_s + lacking_mps / vehicle.max_acceleration_mps2
        elif before.time_s >= counts_from_s:
            free_s += look.time_s - before.time_s
            free_m += math.dist(_place(before), _place(look))
    return free_s, free_m


def _place(state: sim.State) -> tuple[float, float]:
    return state.pose.x_m, state.pose.y_m


def _shape(obstacle: sim.Disc | sim.Polygon | sim.Wall) -> shapely.Geometry:
    if isinstance(obstacle, sim.Disc):
        return shapely.Point(obstacle.x_m, obstacle.y_m).buffer(obstacle.radius_m)
    return (shapely.LineString if isinstance(obstacle, sim.Wall) else shapely.Polygon)(obstacle.points)


def run(
    trials: Iterable[Trial],
    *,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    chunk: int = 4,
) -> tuple[list[Row], bool]:
    """Run trials in worker processes.

    Args:
        trials: what to run.
        processes: how many workers; None for one a core, 1 for none but this process.
        progress: called with how many are done and how many there are.
        chunk: trials that a worker takes at once.

    Returns:
        The rows in the order of the trials, and whether all are there: an interrupt (Ctrl-C) keeps what is done.
    """
    return run_all(run_one, list(trials), processes=processes, progress=progress, chunk=chunk)


def run_all(
    work: Callable[[Item], Answer],
    items: Sequence[Item],
    *,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    keep: Callable[[Answer], None] | None = None,
    chunk: int = 1,
) -> tuple[list[Answer], bool]:
    """Do some work, a function of a module, on every item in worker processes; arguments and answers as ``run``'s.

    ``keep`` is given every answer as it comes, in any order.
    """
    done: dict[int, Answer] = {}

    def take(results: Iterator[tuple[int, Answer]]) -> bool:
        try:
            for number, answer in results:
                done[number] = answer
                if keep is not None:
                    keep(answer)
                if progress is not None:
                    progress(len(done), len(items))
        except KeyboardInterrupt:
            return False
        return True

    numbered = [(work, number, item) for number, item in enumerate(items)]
    if processes == 1:
        complete = take(map(_done, numbered))
    else:
        # A fresh interpreter for each worker: no threads or open files are inherited.
        with multiprocessing.get_context("spawn").Pool(processes, initializer=_ignore_interrupts) as pool:
            complete = take(pool.imap_unordered(_done, numbered, chunksize=max(1, chunk)))
            if not complete:
                pool.terminate()
    return [done[number] for number in sorted(done)], complete


def _done(numbered: tuple[Callable[[Item], Answer], int, Item]) -> tuple[int, Answer]:
    work, number, item = numbered
    return number, work(item)


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def wilson(successes: int, count: int, *, z: float = 1.959964) -> tuple[float, float]:
    """Return Wilson's interval (1927) of a share; 0 to 1 without any trial."""
    if count == 0:
        return (0.0, 1.0)
    share = successes / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return (max(0.0, middle - half), min(1.0, middle + half))


def bootstrap_median(values: ArrayLike, *, seed: int = 0, draws: int = 2000) -> tuple[float, float, float]:
    """Return the median with its 95 % percentile-bootstrap interval (Efron 1979); NaN without any value."""
    given = np.asarray(values, dtype=np.float64)
    if given.size == 0:
        return (math.nan, math.nan, math.nan)
    medians = [np.median(given[chosen], axis=1) for chosen in _resamples(given.size, seed, draws)]
    return (float(np.median(given)), *_middle_95(medians))


def bootstrap_ratio(
    parts: ArrayLike, wholes: ArrayLike, *, seed: int = 0, draws: int = 2000
) -> tuple[float, float, float]:
    """Return the sum of ``parts`` over that of ``wholes`` with the same interval, drawn in pairs; NaN without any."""
    part, whole = np.asarray(parts, dtype=np.float64), np.asarray(wholes, dtype=np.float64)
    if part.size == 0:
        return (math.nan, math.nan, math.nan)
    ratios = [part[drawn].sum(axis=1) / whole[drawn].sum(axis=1) for drawn in _resamples(part.size, seed, draws)]
    return (float(part.sum() / whole.sum()), *_middle_95(ratios))


def _resamples(size: int, seed: int, draws: int) -> Iterator[NDArray[np.intp]]:
    """Draw ``size`` of ``size`` numbers again and again, in blocks: a draw is a row."""
    at_once = max(1, _BLOCK // size)
    for block, first in enumerate(range(0, draws, at_once)):
        shape = (min(at_once, draws - first), size)
        chosen = uniform(seed, _RESAMPLE + block, shape[0] * shape[1]) * size
        yield chosen.astype(np.intp).reshape(shape)


def _middle_95(found: list[NDArray[np.float64]]) -> tuple[float, float]:
    low, high = np.percentile(np.concatenate(found), [2.5, 97.5])
    return float(low), float(high)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What rows together say; intervals are (low, high) at 95 %.

    Attributes:
        trials: rows.
        passable: rows with a true way.
        reached: of those.
        reached_interval: Wilson's, of the share of passable ones.
        collisions_seen: runs into something that could have been seen in time.
        collisions_unseen: the others.
        length_ratio: median of driven over shortest length of what was reached, with its interval.
        time_ratio: the same for time over the shortest way at full speed.
        free_speed: metres driven in free space over what the vehicles' greatest speeds would have made of the same
            seconds, all drives together, with its bootstrap interval over drives; NaN without any.
        free_drives: drives with at least a second in free space.
        not_reached: how many for each reason.
    """

    trials: int
    passable: int
    reached: int
    reached_interval: tuple[float, float]
    collisions_seen: int
    collisions_unseen: int
    length_ratio: tuple[float, float, float]
    time_ratio: tuple[float, float, float]
    free_speed: tuple[float, float, float]
    free_drives: int
    not_reached: dict[str, int]

    @property
    def reached_share(self) -> float:
        """Share of passable worlds that were reached; NaN without any."""
        return self.reached / self.passable if self.passable else math.nan


def summarise(rows: Iterable[Row]) -> Summary:
    """Put rows together."""
    given = list(rows)
    passable = [row for row in given if row.shortest_m is not None]
    reached = [row for row in passable if row.status == "reached"]
    reasons: dict[str, int] = {}
    for row in passable:
        if row.status != "reached":
            what = row.status if row.status == "timeout" else row.reason
            reasons[what] = reasons.get(what, 0) + 1
    hits = [row for row in passable if row.collisions]
    free = [row for row in passable if row.free_s >= 1.0]
    return Summary(
        trials=len(given),
        passable=len(passable),
        reached=len(reached),
        reached_interval=wilson(len(reached), len(passable)),
        collisions_seen=sum(row.seen_in_time for row in hits),
        collisions_unseen=sum(not row.seen_in_time for row in hits),
        length_ratio=bootstrap_median([row.length_ratio for row in reached if row.length_ratio is not None]),
        time_ratio=bootstrap_median([row.time_ratio for row in reached if row.time_ratio is not None]),
        free_speed=bootstrap_ratio([row.free_m for row in free], [row.free_at_full_speed_m for row in free]),
        free_drives=len(free),
        not_reached=dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0]))),
    )


def worst(rows: Iterable[Row], count: int = 10) -> list[Row]:
    """Return the worst rows of passable worlds: collisions, then what was not reached, then the slowest."""

    def badness(row: Row) -> tuple[bool, bool, float]:
        return (row.collisions > 0, row.status != "reached", row.time_ratio or 0.0)

    driven = [row for row in rows if row.shortest_m is not None]
    return sorted(driven, key=badness, reverse=True)[:count]


def csv_text(rows: Iterable[Row]) -> str:
    """Return rows as CSV with a header; None is an empty field."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Row)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return text.getvalue()


def trial_of(row: Row) -> Trial:
    """Return the trial of a row, to run it again."""
    return Trial(**{field.name: getattr(row, field.name) for field in fields(Trial)})
