"""``swathe demo``: the story that the bundled terrain tells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from swathe import driving, mission
from swathe.cli import say
from swathe.config import Settings, TerrainRequest
from swathe.report import wording
from swathe.scenario import load_scenario

if TYPE_CHECKING:
    from pathlib import Path

_BUNDLED = "bundled:jacksboro"
_DRIVE = "drive"

#: name of the folder, what is tried, vehicle, start, goal, whether the soil map is used
_CHAPTERS = (
    ("tractor", "A farm tractor crosses the ridges", "tractor", (-84.1311, 36.4621), (-84.1872, 36.5762), True),
    ("no-soil", "The same if soil is ignored", "tractor", (-84.1311, 36.4621), (-84.1872, 36.5762), False),
    ("pickup", "A 4x4 on the same way", "pickup-4x4", (-84.1311, 36.4621), (-84.1872, 36.5762), True),
    ("ridge-tractor", "The tractor at the ridge", "tractor", (-84.2026, 36.6236), (-84.190, 36.665), True),
    ("ridge-pickup", "The 4x4 at the ridge", "pickup-4x4", (-84.2026, 36.6236), (-84.190, 36.665), True),
)


def tell(out: Path, *, as_json: bool, quiet: bool) -> int:
    """Plan every chapter into a folder of its own below ``out``, drive the last one, and name the reports.

    Returns 0, or 3 as ``swathe drive`` does when the drive has not reached its goal.
    """
    from swathe.export.folder import require_ours_or_runs

    require_ours_or_runs(out, (*(chapter[0] for chapter in _CHAPTERS), _DRIVE))
    answers: list[dict[str, Any]] = []
    if not (as_json or quiet):
        say.show("The hills at the Jacksboro fault, Tennessee: USGS elevation, soil generated from it by rule.")
    for name, title, vehicle, start, goal, with_soil in _CHAPTERS:
        terrain = TerrainRequest(dem=(_BUNDLED,), soil=_BUNDLED if with_soil else None)
        with say.progress(quiet=quiet or as_json) as report:
            summary = mission.plan_route(
                terrain, start, goal, Settings(vehicle=vehicle), out / name, on_progress=report
            )
        answers.append({"chapter": name, "title": title, **summary})
        if not as_json:
            say.show(f"\n{title}: {_in_short(summary)}")
    answers.append(_drive(out / _DRIVE, as_json=as_json, quiet=quiet))
    first = answers[0]["outputs"]["report"]
    is_done = answers[-1]["status"] == "reached"
    found = {"status": "done" if is_done else "not_reached", "report": first, "chapters": answers}
    last = answers[-1]["outputs"]["report"]
    words = f"\nEvery way has a report with its map; the drive's is\n{last}\nthe tractor's\n{first}"
    say.line(found, words, as_json=as_json)
    return 0 if is_done else 3


def _drive(out: Path, *, as_json: bool, quiet: bool) -> dict[str, Any]:
    """Drive the last chapter and return its summary."""
    title = "The tractor drives a field leg among things that no map shows"
    with say.driving(quiet=quiet or as_json) as on_second, say.progress(quiet=quiet or as_json) as report:
        summary = driving.drive(load_scenario("tractor"), out, on_second=on_second, on_progress=report)
    if not as_json:
        how = f"{wording.length(summary['distance_m'])} in {wording.duration(summary['duration_s'])}"
        near = "" if summary["min_clearance_m"] is None else f", never nearer than {summary['min_clearance_m']:.1f} m"
        reached = "reached the goal" if summary["status"] == "reached" else summary["reason"].rstrip(".")
        say.show(f"\n{title}: {reached}; {how}{near}.")
    return {"chapter": _DRIVE, "title": title, **summary}


def _in_short(summary: dict[str, Any]) -> str:
    if summary["status"] == "route_found":
        straight = wording.length(summary["straight_m"])
        took = summary["timings_s"].get("plan", 0.0)
        return (
            f"{wording.length(summary['length_m'])} in {wording.duration(summary['duration_s'])} "
            f"({straight} straight), planned in {took:.2f} s."
        )
    return f"refused. {summary['reason']} {summary['remedy']}"
