"""Words in and out: points and numbers from options, progress on stderr, answers on stdout."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from swathe.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from swathe.recording import Live

_STAGES = {
    "reading elevation": "Reading elevation",
    "checking": "Checking the source",
    "importing elevation": "Importing elevation",
    "importing soil": "Importing soil",
    "importing zones": "Importing zones",
    "compressing": "Compressing",
    "reading again": "No answer, reading again",
    "corridor": "Laying the arc",
    "regions": "Termites at work",
    "route": "Searching the route",
    "writing": "Writing maps and report",
    "figures": "Drawing figures",
    "trials": "Driving",
}


def numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """Return the numbers of an option such as ``8.5,47.1``.

    Raises:
        UsageError: there are more or fewer, or one is no number.
    """
    parts = text.replace(";", ",").split(",")
    try:
        values = tuple(float(part) for part in parts)
    except ValueError:
        values = ()
    if len(values) != count:
        raise UsageError(
            f"{option} {text!r} is not {count} numbers with commas between.",
            f"Write for example {option}={','.join(str(n) for n in range(1, count + 1))}",
        )
    return values


def pair(option: str, text: str) -> tuple[float, float]:
    """Return a point such as ``-84.13,36.46``."""
    x, y = numbers(option, text, 2)
    return x, y


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str, int, int], bool] | None]:
    """Give a function that shows progress on stderr when that is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description:<24}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int) -> bool:
            if stage not in tasks:
                tasks[stage] = bars.add_task(_STAGES.get(stage, stage), total=None)
            bars.update(tasks[stage], completed=done, total=total or None)
            return True

        yield report


@contextmanager
def driving(*, quiet: bool) -> Iterator[Callable[[Live], None] | None]:
    """Give a function that shows on stderr how a drive stands, when that is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.live import Live as Display
    from rich.text import Text

    from swathe.report import wording

    with Display(console=Console(stderr=True), transient=True, refresh_per_second=8) as display:

        def show_live(live: Live) -> None:
            display.update(
                Text(
                    f"{wording.duration(live.time_s):>12}  at {live.x_m:.1f}, {live.y_m:.1f} m  "
                    f"{live.speed_mps:4.1f} m/s  {wording.length(live.goal_distance_m)} to go  "
                    f"{live.replans} replans  {live.probes} probes  {live.status}"
                )
            )

        yield show_live


def scenarios(*, as_json: bool) -> None:
    """Print the list of bundled scenarios."""
    from swathe.scenario import load_scenario, scenario_names

    found = {name: load_scenario(name) for name in scenario_names()}
    lines = [f"{name:14}{scenario.vehicle:16}{scenario.title}" for name, scenario in found.items()]
    lines.append("Drive one: swathe drive --scenario NAME. A TOML file of your own works the same way.")
    listed = [{"name": name, "title": one.title, "vehicle": one.vehicle} for name, one in found.items()]
    line({"status": "done", "scenarios": listed}, "\n".join(lines), as_json=as_json)


class PrintError(Exception):
    """Stdout does not take the answer: its reader has gone, or its disk is full."""

    def __init__(self, cause: OSError) -> None:
        super().__init__(str(cause))
        self.cause = cause


def show(words: str) -> None:
    """Print lines on stdout, at once.

    Raises:
        PrintError: stdout does not take them.
    """
    try:
        sys.stdout.write(words + "\n")
        sys.stdout.flush()
    except OSError as error:
        raise PrintError(error) from error


def line(answer: dict[str, Any], words: str, *, as_json: bool) -> None:
    """Print an answer as one JSON object or as text."""
    from swathe.export.folder import finite

    if as_json:
        words = json.dumps(finite(answer), ensure_ascii=False, allow_nan=False)
    show(words)


def result(summary: dict[str, Any], *, as_json: bool) -> None:
    """Print what came out of a run."""
    line(summary, "\n".join(in_words(summary)), as_json=as_json)


def in_words(summary: dict[str, Any]) -> list[str]:
    """Return a run's answer as lines for people."""
    from swathe.cli import compare
    from swathe.report import wording

    lines = [wording.headline(summary) + "."]
    if summary["command"] == "plan":
        if summary["status"] == "route_found":
            lines.append(
                f"  climb {wording.length(summary['climb_m'])}, "
                f"steepest grade {wording.percent(summary['max_grade'])}, "
                f"side slope {wording.percent(summary['max_side_slope'])}, energy {wording.energy(summary['energy_j'])}"
            )
            if summary["objective"] != "time":
                cost, risk = wording.duration(summary["cost"]), wording.duration(summary["risk_s"])
                lines.append(f"  objective {summary['objective']}: cost {cost}, {risk} near no-go ground")
            share = summary["cells_evaluated"] / summary["cells_total"]
            known = "the best of the whole map" if summary["optimal"] else "the best inside the swathe"
            if summary["stopped_by"] not in (None, "good", "finished"):
                known = "the best of what was seen"
            lines.append(f"  {known}; {wording.percent(share)} of the cells were looked at")
        else:
            lines += [f"  {summary[key]}" for key in ("reason", "where", "remedy") if summary[key]]
        corridor = summary["corridor"]
        if corridor and corridor["sagitta_m"] is not None:
            sagitta, width = wording.length(corridor["sagitta_m"]), wording.length(corridor["width_m"])
            lines.append(f"  arc with a sagitta of {sagitta}, swathe {width} wide")
    if summary["command"] == "drive":
        lines += drive_lines(summary)
    if summary["command"] == "nests":
        share = summary["nest_cells"] / summary["cells_total"]
        lines.append(f"  {summary['nest_count']:,} nests cover {wording.percent(share)} of the map")
        lines += compare.lines(summary)
    soil = summary.get("soil")
    if soil:
        lost = [entry["label"] or entry["value"] for entry in soil["entries"] if not entry["understood"]]
        lines.append(f"  soil from {soil['source']} covers {wording.percent(soil['covered_fraction'])} of the map")
        if lost:
            lines.append(f"  soil labels not understood: {', '.join(lost[:8])} (explain them with --soil-legend)")
    lines += [f"  note: {note}" for note in summary["notes"]]
    lines.append(f"  report: {summary['outputs']['report']}")
    return lines


def drive_lines(summary: dict[str, Any]) -> list[str]:
    """Return how a drive went, as lines for people."""
    from swathe.report import wording

    lines = [] if summary["status"] == "reached" and summary["distance_m"] else [f"  {summary['reason']}"]
    plan = summary["plan"]
    if plan is not None and plan["length_m"]:
        lines.append(
            f"  {wording.length(summary['distance_m'])} driven in {wording.duration(summary['duration_s'])}; planned "
            f"were {wording.length(plan['length_m'])} in {wording.duration(plan['duration_s'])}"
        )
    if summary["duration_s"]:
        clearance = summary["min_clearance_m"]
        near = "nothing was near" if clearance is None else f"nearest thing {clearance:.2f} m"
        lines.append(
            f"  {near}, {summary['collisions']} collisions, {summary['replans']} replans, {summary['probes']} probes, "
            f"{summary['soil_updates']} news of the soil, {summary['no_go_entries']} times on no-go ground"
        )
        lines.append(f"  simulated {summary['real_time_factor']:g} times faster than the clock")
    return lines


def vehicles(name: str | None, *, as_json: bool) -> None:
    """Print the list of vehicles, or one of them in full."""
    from swathe.vehicle import load_vehicle, vehicle_names

    if name is not None:
        found = load_vehicle(name).as_dict()
        lines = [f"{found['name']}: {found['description']}"]
        lines += [
            f"  {figure:28} {entry['value']!s:>10}  {entry['source'] or 'no source given'}"
            for figure, entry in found["figures"].items()
        ]
        line({"status": "done", **found}, "\n".join(lines), as_json=as_json)
        return
    all_of_them = [load_vehicle(known) for known in vehicle_names()]
    lines = [f"{'vehicle':18}{'mass':>10}{'speed':>10}{'up':>7}{'down':>7}{'side':>7}{'cone index':>12}"]
    for vehicle in all_of_them:
        strength_kpa = vehicle.core.cone_index()[0]
        lines.append(
            f"{vehicle.name:18}{vehicle.mass_kg:>7,.0f} kg{vehicle.max_speed_mps:>6.1f} m/s"
            f"{vehicle.grade_up:>7.0%}{vehicle.grade_down:>7.0%}{vehicle.side_slope:>7.0%}{strength_kpa:>8.0f} kPa"
        )
    lines.append("Show one with its sources: swathe vehicles NAME. A file of your own works the same way.")
    listed = [vehicle.as_dict() for vehicle in all_of_them]
    line({"status": "done", "vehicles": listed}, "\n".join(lines), as_json=as_json)
