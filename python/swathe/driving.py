"""The use cases of a drive: drive a scenario and leave its folder, and tell, repeat or verify a drive from its log."""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from swathe.errors import InputError, UnreadableFileError
from swathe.export.folder import RUN_LOG, SUMMARY, begin_log, run_folder
from swathe.preparation import Stopwatch
from swathe.runlog import LogHeader, RunLog, RunLogWriter, verify
from swathe.scenario import Scenario, load_scenario, scenario_from_toml, scenario_of
from swathe.staging import Stage, stage

if TYPE_CHECKING:
    from collections.abc import Callable

    from swathe.episode import Outcome, Second

    OnProgress = Callable[[str, int, int], bool]
    OnSecond = Callable[["Live"], None]

#: Fields of ``[sensors]`` for a robot that is not sure of anything: scans 0.1 s late, a tenth of the beams lost, odometry
#: off by 2 % and corrected once a second to 0.3 m.
NOISE = {
    "beam_dropout": 0.1,
    "scan_delay_s": 0.1,
    "scale_error": 0.02,
    "distance_noise_m": 0.02,
    "heading_noise_rad": 0.005,
    "fix_rate_hz": 1.0,
    "fix_noise_m": 0.3,
    "fix_heading_noise_rad": 0.02,
}


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


def drive(
    scenario: Scenario,
    out: Path,
    *,
    body: str = "sim",
    soil_feed: Path | None = None,
    animate: bool = True,
    on_second: OnSecond | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Plan a scenario's route, drive it, write the folder and return the summary.

    ``soil_feed`` is a file of JSON lines that may grow while the drive goes on. ``on_second`` is told every simulated
    second how the drive stands.

    Raises:
        SwatheError: the inputs cannot be used, the folder cannot be written, or the user stopped; what was driven until
            then is in the log.
    """
    watch = Stopwatch()
    with run_folder(out, logs=True) as folder:
        made = stage(scenario, watch=watch, on_progress=on_progress)
        log = None
        if made.world is None:
            (out / RUN_LOG).unlink(missing_ok=True)
            end = _not_driven(made)
        else:
            log = begin_log(out)
            feed = None if soil_feed is None else SoilFeed(soil_feed)
            with watch.step("drive"):
                outcome = record(made, log, body=body, feed=feed, on_second=on_second)
            end = _driven(outcome, watch.seconds["drive"])
        summary = drive_summary(made, end, body=body)
        write_drive(folder, out, made, summary, log, animate=animate, watch=watch, on_progress=on_progress)
    return summary


def record(
    made: Stage, log: Path, *, body: str, feed: SoilFeed | None = None, on_second: OnSecond | None = None
) -> Outcome:
    """Drive to the end with every second in the log, and return how it went."""
    episode, navigator = made.episode()
    news = Newsroom(made, navigator, feed)
    replans = probes = 0
    with RunLogWriter(log, header_of(made, body)) as writer:
        while episode.outcome is None:
            told = news.tell(episode)
            second = episode.advance(1.0)
            writer.write(replace(second, events=[*told, *second.events]) if told else second)
            ...
        writer.close(episode.outcome)
    return episode.outcome
