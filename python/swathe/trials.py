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
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import numpy as np

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

#: Streams of ``swathe.random``; resampling takes the next one for every block of so many numbers.
_DRAW, _RESAMPLE = 103, 1000
_BLOCK = 1 << 22


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
    cpu_s: float = 0.0

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


def begin(trial: Trial, *, records: bool = True, time_limit_s: float = 600.0) -> tuple[Episode, sim.Scenario]:
    """Return the episode of a trial before its first step, and its world."""
    vehicle = load_vehicle(trial.vehicle)
    scenario = world_of(trial)
    laser = sim.Laser.preset("sick-lms200-80m" if scale_of(vehicle) >= _FAR_SCALE else "sick-lms200-8m")
    params = sim.RobotParams()
    if trial.noisy:
        laser = sim.Laser(**{**asdict(laser), "dropout": 0.1})
        params = sim.RobotParams(
            scan_delay_s=0.1,
            scale_error=0.02,
            distance_noise_m=0.02,
            heading_noise_rad=0.01,
            fix_rate_hz=1.0,
            fix_noise_m=0.3,
            fix_heading_noise_rad=0.05,
            fuses_fixes=True,
        )
    robot = sim.Robot(scenario.world, vehicle, scenario.start, laser=laser, params=params, seed=trial.seed)
    drive = DriveParams(method=trial.method, memory=not trial.alone, recover=not trial.alone)
    navigator = Navigator(vehicle, (scenario.goal.x_m, scenario.goal.y_m), params=drive, seed=trial.seed)
    limits = EpisodeParams(time_limit_s=time_limit_s, records=records)
    return Episode(scenario.world, robot, navigator, params=limits), scenario


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
    episode, _ = begin(trial, records=False, time_limit_s=max(900.0, 20.0 * fastest_s))
    collision: dict[str, Any] = {}
    recoveries = 0
    for second in episode.seconds(10.0):
        for event in second.events:
            recoveries += event.kind == "recovery"
            if event.kind == "collision":
                collision = event.fields
    outcome = episode.outcome
    if outcome is None:  # pragma: no cover - seconds() ends with an outcome
        raise AssertionError
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
        cpu_s=time.process_time() - begun_s,
    )


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
    chunk: int = 1,
) -> tuple[list[Answer], bool]:
    """Do some work, a function of a module, on every item in worker processes; arguments and answers as ``run``'s."""
    done: dict[int, Answer] = {}

    def take(results: Iterator[tuple[int, Answer]]) -> bool:
        try:
            for number, answer in results:
                done[number] = answer
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
    medians: list[NDArray[np.float64]] = []
    at_once = max(1, _BLOCK // given.size)
    for block, first in enumerate(range(0, draws, at_once)):
        shape = (min(at_once, draws - first), given.size)
        chosen = uniform(seed, _RESAMPLE + block, shape[0] * shape[1]) * given.size
        medians.append(np.median(given[chosen.astype(np.intp).reshape(shape)], axis=1))
    low, high = np.percentile(np.concatenate(medians), [2.5, 97.5])
    return (float(np.median(given)), float(low), float(high))


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
    return Summary(
        trials=len(given),
        passable=len(passable),
        reached=len(reached),
        reached_interval=wilson(len(reached), len(passable)),
        collisions_seen=sum(row.seen_in_time for row in hits),
        collisions_unseen=sum(not row.seen_in_time for row in hits),
        length_ratio=bootstrap_median([row.length_ratio for row in reached if row.length_ratio is not None]),
        time_ratio=bootstrap_median([row.time_ratio for row in reached if row.time_ratio is not None]),
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
