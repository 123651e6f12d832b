"""Driving in the simulated world: 40 crates, a laser of 181 beams and 8 m, a step and a scan 35 times a second.

The peer is time itself: as many CPU seconds as were simulated. ``sim-drive`` is body and sensor alone, ``sim-episode``
with the navigator, everything recorded and the run log written.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from harness import Benchmark, Contender

if TYPE_CHECKING:
    from swathe.episode import Episode
    from swathe.sim import Robot

SECONDS = 60
RATE_HZ = 35


def robot() -> Robot:
    from swathe import sim

    scenario = sim.random_world(1, density=2.5, kind="clutter")
    return sim.Robot(scenario.world, "pioneer-2dx", scenario.start, seed=1)


def drive(driver: Robot) -> int:
    scans = 0
    for _ in range(SECONDS * RATE_HZ):
        seen = driver.step((0.5, 0.2), 1 / RATE_HZ)
        scans += seen.scan is not None
    return scans


def episodes() -> list[Episode]:
    # The log's modules are loaded here, not in what is measured.
    import swathe.runlog  # noqa: F401
    from swathe import sim
    from swathe.drive import Navigator
    from swathe.episode import Episode

    made = []
    for seed in range(12):
        world, start, goal = sim.random_world(seed, density=2.5, kind="clutter")
        robot = sim.Robot(world, "jackal", start, seed=seed)
        made.append(Episode(world, robot, Navigator("jackal", (goal.x_m, goal.y_m))))
    return made


def drive_all(made: list[Episode]) -> int:
    """Drive and log until as much was simulated as the peer waits."""
    from swathe.runlog import LogHeader, RunLogWriter

    scans, left_s = 0, float(SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        for number, episode in enumerate(made):
            with RunLogWriter(
                Path(folder) / f"{number}.mcap", LogHeader(seed=number, scenario="", vehicle="jackal")
            ) as log:
                while left_s > 0 and episode.outcome is None:
                    second = episode.advance(min(1.0, left_s))
                    log.write(second)
                    left_s -= second.end_s - second.start_s
                    scans += len(second.scans.times_s)
                log.close(episode.outcome or {})
    assert left_s <= 1e-6  # noqa: S101 - a benchmark that ran short would say too much
    return scans


def wait(_: object) -> int:
    """Use as much CPU time as was simulated."""
    end = time.process_time() + SECONDS
    while time.process_time() < end:
        pass
    return SECONDS * RATE_HZ


def scans(_: object, count: int) -> dict[str, float]:
    return {"scans": float(count)}


BENCHMARKS = [
    Benchmark(
        name="sim-drive",
        ours=Contender("swathe.sim.Robot.step", robot, drive, scans),
        peer=Contender("simulated time", lambda: None, wait, scans),
        must=300.0,
        goal=600.0,
    ),
    Benchmark(
        name="sim-episode",
        ours=Contender("swathe.episode.Episode.advance, run log", episodes, drive_all, scans),
        peer=Contender("simulated time", lambda: None, wait, scans),
        must=100.0,
        goal=200.0,
    ),
]
