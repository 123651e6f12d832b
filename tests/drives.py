"""Seconds of a drive that were never driven, with something in every part: for tests of what consumes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.episode import (
    CertaintyMap,
    Commands,
    Event,
    Grids,
    Histogram,
    Line,
    Motion,
    Movers,
    Reading,
    Scans,
    Second,
    Sonar,
)
from swathe.runlog import LogHeader, RunLogWriter
from swathe.sensor import PenetrometerReading

if TYPE_CHECKING:
    from pathlib import Path

HEADER = LogHeader(
    seed=7,
    scenario='name = "made up"\nseed = 7\n',
    vehicle="jackal",
    vehicle_toml="length_m = 0.5\n",
    inputs={"dem.tif": "ab" * 32},
    files={"crates.json": b"[]"},
)
CERTAINTIES = np.array([*range(16), 255], np.uint8)
HISTOGRAM = {"densities": [0.0, 1.5], "thresholds": [1.0, 2.0], "first_rad": 0.1, "direction_rad": None}
OUTCOME = {"status": "reached", "reason": "At the goal.", "distance_m": 12.5, "min_clearance_m": None}


def made_second(start_s: float = 0.0, *, steps: int = 35, beams: int = 181, seed: int = 0, **changes: Any) -> Second:
    """Make a second; equal arguments make equal seconds."""
    drawn = np.random.default_rng(seed)
    times_s = start_s + 0.01 + np.arange(steps) / max(steps, 1)
    motion = Motion(times_s, *(drawn.normal(size=steps).cumsum() for _ in range(7)))
    ranges = drawn.uniform(0, 9, (steps, beams)).astype(np.float32)
    ranges[ranges > 8] = np.inf
    ranges[ranges < 0.1] = np.nan
    speeds, turns = drawn.normal(size=(2, steps))
    parts: dict[str, Any] = {
        "start_s": start_s,
        "end_s": start_s + 1,
        "scans": Scans(times_s - 0.01, times_s, ranges, -np.pi / 2, np.pi / 180, 0.1, 8.0, (0.2, 0.0, 0.1)),
        "sonar": Sonar(
            times_s[:4].repeat(3) - 0.01,
            times_s[:4].repeat(3),
            np.tile(np.arange(3, dtype=np.uint8), len(times_s[:4])),
            np.resize(np.array([0.5, np.inf, np.nan, 2.25, 0.0], np.float32), 3 * len(times_s[:4])),
            0.5,
            0.125,
            5.0,
            [(0.2, 0.1, 0.5), (0.25, 0.0, 0.0), (0.2, -0.1, -0.5)],
        ),
        "odometry": motion,
        "truth": Motion(times_s, *(drawn.normal(size=steps).cumsum() for _ in range(7))),
        "commands": Commands(times_s, speeds, turns, drawn.integers(0, 2, steps, np.uint8)),
        "events": [Event(start_s + 0.5, "obstacle_seen", {"range_m": float(drawn.uniform()), "words": "ä <b>"})],
        "ways": [Line(start_s + 0.1, drawn.normal(size=(n, 2))) for n in (0, 1, 5)],
        "routes": [Line(start_s, drawn.normal(size=(3, 2)))],
        "maps": [CertaintyMap(start_s, drawn.choice(CERTAINTIES, (7, 5)), -3.0, 4.0, 0.1)],
        "histograms": [Histogram(start_s, HISTOGRAM)],
        "movers": Movers(times_s[:2], drawn.normal(size=(len(times_s[:2]), 2, 2)), np.array([0.3, 0.4])),
        "readings": [Reading(start_s + 0.2, PenetrometerReading(1.0, 2.0, (0.1, 0.2), (300.0, 410.5), None))],
        "grids": Grids(times_s, drawn.uniform(size=(steps, 4)) < 0.5, drawn.uniform(size=steps) < 0.5),
    }  # fmt: skip
    return Second(**{**parts, **changes})


def made_log(path: Path, seconds: int = 3, *, close: bool = True, **changes: Any) -> list[Second]:
    """Write a log of made-up seconds and return them."""
    made = [made_second(float(at), seed=at, **changes) for at in range(seconds)]
    with RunLogWriter(path, HEADER) as log:
        for second in made:
            log.write(second)
        if close:
            log.close(OUTCOME)
    return made
