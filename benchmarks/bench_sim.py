"""Driving in the simulated world: 40 crates, a laser of 181 beams and 8 m, a step and a scan 35 times a second.

The peer is time itself: as many CPU seconds as were simulated. The ratio is that of body and sensor alone.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from harness import Benchmark, Contender

if TYPE_CHECKING:
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
]
