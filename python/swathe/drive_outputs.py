"""What a drive leaves beside its log: the plan's files, pictures, report and the summary."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import swathe
from swathe.outputs import write, write_summary
from swathe.planning import ranks_of
from swathe.summary import plan_summary

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from swathe.episode import Outcome
    from swathe.preparation import Stopwatch
    from swathe.staging import Stage

    OnProgress = Callable[[str, int, int], bool]

#: What a drive's summary says of the plan that it followed; the rest of the plan's summary is the drive's too.
_OF_PLAN = (
    "status",
    "reason",
    "where",
    "remedy",
    "length_m",
    "straight_m",
    "duration_s",
    "energy_j",
    "climb_m",
    "descent_m",
    "max_grade",
    "max_side_slope",
    "cost",
    "optimal",
)


def drive_summary(made: Stage, outcome: Outcome | None, *, body: str, seconds: float) -> dict[str, Any]:
    """Return the summary of a drive; ``outcome`` is None where there was nothing to drive.

    ``seconds`` are those that the drive took by the clock.
    """
    scenario = made.scenario
    if made.found is None:
        shared: dict[str, Any] = {
            "version": swathe.__version__,
            "vehicle": made.vehicle.name,
            "vehicle_figures": made.vehicle.as_dict()["figures"],
            "seed": scenario.seed,
            "profile": None,
            "method": None,
            "soil": None,
            "inputs": [],
            "notes": ["A drawn world without a map: what is seen is all that is known."],
        }
        plan = None
    else:
        assert scenario.drive.start is not None and scenario.drive.goal is not None  # noqa: S101, PT018
        shared = plan_summary(made.found, scenario.settings(), (scenario.drive.start, scenario.drive.goal))
        plan = {key: shared.pop(key) for key in _OF_PLAN}
    told = _not_driven(made) if outcome is None else asdict(outcome)
    told.pop("longest_step_s", None)
    return {
        **shared,
        "command": "drive",
        "scenario": scenario.title,
        "body": body,
        "local_method": scenario.drive.method,
        "grids": scenario.drive.grids,
        "probing": scenario.probing.policy,
        "soil_rule": scenario.drive.soil_rule,
        "plan": plan,
        **told,
        "real_time_factor": None if outcome is None or seconds <= 0 else round(outcome.duration_s / seconds, 1),
        "time_limit_s": made.time_limit_s,
    }


def _not_driven(made: Stage) -> dict[str, Any]:
    assert made.found is not None  # noqa: S101 - a drawn world always has something to drive
    answer = made.found.answer
    at_goal = answer.route is not None
    return {
        "status": "reached" if at_goal else "not_reached",
        "reason": made.why_not,
        "distance_m": 0.0,
        "duration_s": 0.0,
        "min_clearance_m": None,
        "collisions": 0,
        "replans": 0,
        "probes": 0,
        "soil_updates": 0,
        "no_go_entries": 0,
    }


def write_drive(
    folder: Path,
    out: Path,
    made: Stage,
    summary: dict[str, Any],
    log: Path | None,
    *,
    animate: bool,
    watch: Stopwatch,
    on_progress: OnProgress | None,
) -> None:
    """Write every file of a drive into its staging folder, the summary last; ``log`` is None where nothing drove."""
    if log is not None:
        with watch.step("pictures"):
            _draw(folder, made, log, summary, animate=animate)
    if made.found is not None:
        write(folder, out, made.found.shown, made.found.answer, summary, watch=watch, on_progress=on_progress, log=log)
        return
    write_summary(folder, out, summary, watch, ("report.html", *(() if log is None else (log.name,))))
    from swathe.report.html import write_html

    write_html(folder, log=log)


def _draw(folder: Path, made: Stage, log: Path, summary: dict[str, Any], *, animate: bool) -> None:
    """Draw the pictures of a drive from its log."""
    from swathe.report import drive_pictures, wording
    from swathe.report.drive import Drive, Ground
    from swathe.runlog import RunLog

    ground = None
    if made.found is not None:
        region = made.found.shown.region
        ground = Ground(region.geometry, region.elevation_m, ranks_of(made.found.shown))
    scenario = made.scenario
    drawn = Drive(
        RunLog.read(log),
        made.vehicle.length_m,
        made.vehicle.width_m,
        wording.headline(summary),
        f"{made.vehicle.name}, {scenario.drive.method}, seed {scenario.seed}",
        (made.goal.x_m, made.goal.y_m),
        () if made.world is None else made.world.obstacles,
        ground,
        made.vehicle.step_height_m,
    )
    tags = {"swathe_version": str(summary["version"]), "swathe_seed": str(scenario.seed)}
    drive_pictures.draw(folder, drawn, tags, animate=animate)
