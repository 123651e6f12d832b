"""Driving a staged scenario to its end, with every second in a log that can be driven again."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from swathe.episode import STATUSES
from swathe.news import NewsDesk
from swathe.runlog import LogHeader, RunLogWriter
from swathe.sharing import StoreNews

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from swathe.episode import Outcome, Second
    from swathe.news import NewsSource
    from swathe.staging import Stage

    OnSecond = Callable[["Live"], None]


class Live(NamedTuple):
    """How a drive stands: simulated time, place as the robot believes, speed, metres to go, and what it has met."""

    time_s: float
    x_m: float
    y_m: float
    speed_mps: float
    goal_distance_m: float
    replans: int
    probes: int
    status: str


def record(
    made: Stage, log: Path, *, body: str, news: NewsSource | None = None, on_second: OnSecond | None = None
) -> Outcome:
    """Drive to the end, write every second into the log, and return how it went."""
    episode, navigator = made.episode()
    desk = NewsDesk(made, navigator, news)
    counts: Counter[str] = Counter()
    with RunLogWriter(log, _header(made, body)) as writer:
        time_s = 0.0
        while (outcome := episode.outcome) is None:
            told = desk.tell(time_s)
            second = episode.advance(1.0)
            left = [] if episode.outcome is None else desk.finish(second.end_s)
            second = replace(second, events=[*told, *second.events, *left])
            time_s = second.end_s
            writer.write(second)
            if isinstance(news, StoreNews):
                news.file(second)
            counts.update(event.kind for event in second.events)
            if on_second is not None:
                on_second(_live(made, second, counts))
        writer.close(outcome)
    return outcome


def _live(made: Stage, second: Second, counts: Counter[str]) -> Live:
    odometry = second.odometry
    x_m, y_m = float(odometry.x_m[-1]), float(odometry.y_m[-1])
    return Live(
        second.end_s,
        x_m,
        y_m,
        float(odometry.speed_mps[-1]),
        math.hypot(made.goal.x_m - x_m, made.goal.y_m - y_m),
        counts["route"],
        counts["reading_taken"],
        STATUSES[int(second.commands.status[-1])],
    )


def _header(made: Stage, body: str) -> LogHeader:
    return LogHeader(
        seed=made.scenario.seed,
        scenario=made.scenario.to_toml(),
        vehicle=made.vehicle.name,
        vehicle_toml=made.vehicle_toml,
        body=body,
        inputs=made.inputs,
    )
