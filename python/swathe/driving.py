"""The use cases of a drive: drive a scenario and leave its folder; tell, repeat or verify a drive from its log."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swathe.drive_outputs import drive_summary, write_drive
from swathe.errors import InputError, UnreadableFileError, UsageError
from swathe.export.folder import RUN_LOG, SUMMARY, begin_log, log_of, require_not_in, run_folder
from swathe.news import FedNews, LoggedNews
from swathe.preparation import Stopwatch
from swathe.recording import Live, record
from swathe.report import wording
from swathe.runlog import RunLog, verify
from swathe.scenario import Scenario, scenario_from_toml, scenario_of
from swathe.sharing import StoreNews
from swathe.soil_feed import SoilFeed
from swathe.staging import stage

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from swathe.news import NewsSource
    from swathe.staging import Stage

    OnProgress = Callable[[str, int, int], bool]
    OnSecond = Callable[[Live], None]


def drive(
    scenario: Scenario,
    out: Path,
    *,
    body: str = "sim",
    soil_feed: Path | None = None,
    share_as: str | None = None,
    animate: bool = True,
    on_second: OnSecond | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Plan a scenario's route, drive it, write the folder and return the summary.

    ``soil_feed`` is a file of JSON lines that may grow while the drive goes on. On the ground of a store the drive
    hears what others measure there; with ``share_as``, the name of who drives, it files its own readings and the run.
    ``on_second`` is told every simulated second how the drive stands.

    Raises:
        SwatheError: the inputs cannot be used, the folder cannot be written, or the user stopped; what was driven until
            then is in the log.
    """
    watch = Stopwatch()
    news: NewsSource | None = None if soil_feed is None else FedNews(SoilFeed(soil_feed))
    terrain = scenario.terrain
    is_stored = terrain is not None and terrain.store is not None
    if share_as is not None and not is_stored:
        raise UsageError("Only a drive on a store's ground can share its readings.", "Give `--store` and `--region`.")
    with ExitStack() as stack:
        if terrain is not None and terrain.store is not None and terrain.region is not None:
            shared = stack.enter_context(StoreNews(terrain.store, terrain.region, share_as, news))
            news = shared
            # What was filed until now counts in the plan, what comes later is news; the log says which.
            scenario = scenario.with_changes({"terrain.revision": shared.revision})
        folder = stack.enter_context(run_folder(out, logs=True))
        made = stage(scenario, watch=watch, on_progress=on_progress)
        return _drive_into(
            folder, made, out, body, news, animate=animate, watch=watch, on_second=on_second, on_progress=on_progress
        )


def _drive_into(
    folder: Path,
    made: Stage,
    out: Path,
    body: str,
    news: NewsSource | None,
    *,
    animate: bool,
    watch: Stopwatch,
    on_second: OnSecond | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    log = outcome = None
    if made.world is None:
        (out / RUN_LOG).unlink(missing_ok=True)
    else:
        log = begin_log(out)
        with watch.step("drive"):
            outcome = record(made, log, body=body, news=news, on_second=on_second)
    summary = drive_summary(made, outcome, body=body, seconds=watch.seconds.get("drive", 0.0))
    write_drive(folder, out, made, summary, log, animate=animate, watch=watch, on_progress=on_progress)
    if isinstance(news, StoreNews) and log is not None:
        news.keep_run(log, summary)
    return summary


def scenario_of_plan(folder: Path) -> Scenario:
    """Return the drive of a plan's route, from the plan's folder.

    Raises:
        InputError: it is not the folder of a plan.
    """
    remedy = "Give the folder that `swathe plan` has written."
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{folder} holds no {SUMMARY} that can be read: {error.strerror}.", remedy) from error
    except ValueError as error:
        raise UnreadableFileError(f"The {SUMMARY} of {folder} is broken.", remedy) from error
    request = summary.get("request") if isinstance(summary, dict) else None
    if not isinstance(summary, dict) or summary.get("command") != "plan":
        raise InputError(f"{folder} is not the folder of a plan.", remedy)
    if not isinstance(request, dict):
        raise InputError(
            f"The plan in {folder} was ended by a clock (`--max-seconds`): its route cannot be found again.",
            "Plan with `--max-ticks` or `--max-evaluations`.",
        )
    return scenario_of(request, f"The plan in {folder}")


def replay(
    run: Path, *, again: bool = False, out: Path | None = None, on_second: OnSecond | None = None
) -> dict[str, Any]:
    """Tell what a drive's log holds; drive ``again`` and compare the logs, or write the drive to ``out`` again.

    The answer's ``status`` is ``done``, or after a comparison ``equal`` or ``different``; ``lines`` tells it to people.

    Raises:
        SwatheError: the log cannot be read, an input of it is gone or another one, or ``out`` holds the log itself.
    """
    path = log_of(run)
    if out is not None:
        require_not_in(out, path)
    log = RunLog.read(path)
    scenario = scenario_from_toml(log.scenario, f"The scenario in {path}")
    answer: dict[str, Any] = {
        "status": "done",
        "log": str(path),
        "complete": log.is_complete,
        "cut": log.cut,
        "seconds": log.seconds,
        "version": log.header.version,
        "seed": log.header.seed,
        "vehicle": log.header.vehicle,
        "title": scenario.title,
        "outcome": log.outcome,
        "events": dict(sorted(Counter(event.kind for event in log.events).items())),
    }
    if not (again or out is not None):
        answer["lines"] = _told(answer, path)
        return answer
    vehicle_toml = log.header.vehicle_toml or None
    made = stage(scenario, vehicle_toml=vehicle_toml, watch=Stopwatch())
    _require_same(made.inputs, log.header.inputs)
    if made.world is None:
        raise InputError(f"There is no route to drive any more: {made.why_not}", "Check the inputs.")
    if out is not None:
        with run_folder(out, logs=True) as folder:
            watch = Stopwatch()
            news = LoggedNews(log.events)
            summary = _drive_into(
                folder, made, out, log.header.body, news, animate=True, watch=watch, on_second=on_second
            )
        answer["again"] = summary["outputs"]
        answer["lines"] = [*_told(answer, path), f"driven again into {out}"]
    if again:
        with tempfile.TemporaryDirectory(prefix="swathe-") as folder:
            second = Path(folder) / RUN_LOG
            record(made, second, body=log.header.body, news=LoggedNews(log.events), on_second=on_second)
            verdict = verify(path, second)
        answer["status"] = "equal" if verdict else "different"
        answer["verdict"] = asdict(verdict)
        answer["lines"] = [*_told(answer, path), verdict.words]
    return answer


def _require_same(now: Mapping[str, str], logged: Mapping[str, str]) -> None:
    """Raise InputError when an input of a log is another file now."""
    other = sorted(name for name in now.keys() | logged.keys() if now.get(name) != logged.get(name))
    if other:
        raise InputError(
            f"{', '.join(other)}: not the file that the log was driven with (its SHA-256 is another).",
            "Put the file of that time in its place; the log names its SHA-256.",
        )


def _told(answer: Mapping[str, Any], path: Path) -> list[str]:
    """Return what a log holds as lines for people."""
    outcome = answer["outcome"]
    what = f"{answer['title'] or 'a drive'} with a {answer['vehicle']}"
    lines = [f"{path}: {what}, seed {answer['seed']}, swathe {answer['version']}"]
    if answer["cut"] is not None:
        lines.append(f"  {answer['cut']} {answer['seconds']} s can be read.")
    if outcome is not None:
        lines.append(f"  {wording.headline({'command': 'drive', **outcome})}: {outcome['reason']}")
        lines.append(
            f"  {wording.length(outcome['distance_m'])} driven in {wording.duration(outcome['duration_s'])}, "
            f"{outcome['replans']} replans, {outcome['probes']} probes, {outcome['collisions']} collisions"
        )
    lines.append("  " + ", ".join(f"{count} x {kind}" for kind, count in answer["events"].items()))
    return lines
