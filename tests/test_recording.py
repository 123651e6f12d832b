"""A drive as it is told while it goes on: where the robot is, how fast, and what it has met so far."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from swathe.episode import STATUSES
from swathe.preparation import Stopwatch
from swathe.recording import Live, record
from swathe.runlog import RunLog
from swathe.scenario import scenario_of
from swathe.staging import stage

if TYPE_CHECKING:
    from pathlib import Path


def test_live_progress_tells_place_speed_replans_and_readings(tmp_path: Path) -> None:
    scenario = scenario_of(
        {
            "vehicle": "husky",
            "terrain": {
                "dem": ["bundled:heath"], "soil": "bundled:heath", "points_crs": "native", "bounds": [30, 30, 90, 90]
            },
            "drive": {"start": (40, 60), "goal": (70, 60)},
            "probing": {"policy": "every", "every_m": 10},
            "obstacles": {"crates": 4},
        },
        "it",
    )  # fmt: skip
    made = stage(scenario, watch=Stopwatch())
    told: list[Live] = []
    outcome = record(made, tmp_path / "run.mcap", body="sim", on_second=told.append)
    log = RunLog.read(tmp_path / "run.mcap")
    assert outcome.status == "reached"
    assert [live.time_s for live in told] == pytest.approx([*range(1, len(told)), outcome.duration_s])
    # A second is told without its end, the last one with it.
    for live, end_s in zip(told, [live.time_s - 1e-6 for live in told[:-1]] + [math.inf], strict=True):
        last = int((log.odometry.times_s < end_s).sum()) - 1
        place_m = (live.x_m, live.y_m)
        assert place_m == (log.odometry.x_m[last], log.odometry.y_m[last])
        assert live.speed_mps == log.odometry.speed_mps[last]
        assert live.goal_distance_m == math.dist(place_m, (made.goal.x_m, made.goal.y_m))
        assert live.status in STATUSES
        kinds = [event.kind for event in log.events if event.time_s < end_s]
        assert (live.replans, live.probes) == (kinds.count("route"), kinds.count("reading_taken"))
    assert max(live.speed_mps for live in told) > 0.5
    assert told[0].goal_distance_m > 25
    assert told[-1].goal_distance_m < 1
    assert (told[-1].replans, told[-1].probes) == (outcome.replans, outcome.probes)
    assert outcome.replans > 1
    assert outcome.probes > 1
