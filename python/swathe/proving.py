"""Trials as a use case: many seeded drives, a table with intervals, CSV, a picture, and logs of the worst runs.

Drawn worlds without a map are ``swathe.trials``; here a scenario with a map is driven under other seeds, several ways
side by side on the same seeds: with and without probing, with one grid or a pair.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections import Counter
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import swathe
from swathe import planner, trials
from swathe.errors import InvalidParameterError
from swathe.export.folder import SUMMARY, WORST_LOGS, run_folder, to_json, write_text
from swathe.news import NewsDesk
from swathe.preparation import Stopwatch
from swathe.recording import record
from swathe.scenario import Scenario, load_scenario, scenario_of
from swathe.staging import stage
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from swathe.staging import Stage

    OnProgress = Callable[[str, int, int], bool]

#: What ``--local`` may name: the navigator, or a local method alone.
METHODS: dict[str, tuple[trials.Method, bool]] = {
    "navigator": ("vfh+", False),
    "vfh": ("vfh", True),
    "vfh+": ("vfh+", True),
    "vfh*": ("vfh*", True),
    "player": ("player", True),
}


@dataclass(frozen=True, slots=True)
class MapTrial:
    """One drive of a scenario under a seed; ``arm`` names the way it is driven."""

    arm: str
    scenario: Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class MapRow:
    """How a drive of a scenario went.

    Attributes:
        planned_s: time of the route on the map; None when there was none.
        best_s: time of the best route on the true ground, which nobody knew; None when there is none. What stands on
            the ground besides is left out.
        best_m: its length.
        grids_differed: share of steps at which the overlapping grids gave different answers; None without steps.
    """

    arm: str
    seed: int
    status: str
    reason: str
    planned_s: float | None
    best_s: float | None
    best_m: float | None = None
    distance_m: float = 0.0
    duration_s: float = 0.0
    min_clearance_m: float | None = None
    collisions: int = 0
    replans: int = 0
    probes: int = 0
    soil_updates: int = 0
    no_go_entries: int = 0
    grids_differed: float | None = None

    @property
    def length_ratio(self) -> float | None:
        """Driven length over that of the best route on the true ground."""
        return None if not self.best_m else self.distance_m / self.best_m

    @property
    def time_ratio(self) -> float | None:
        """Driven time over the best on the true ground."""
        return None if not self.best_s else self.duration_s / self.best_s


def run_map_trial(trial: MapTrial) -> MapRow:
    """Drive a scenario under a seed."""
    made = stage(trial.scenario, watch=Stopwatch())
    seed = trial.scenario.seed
    planned = None if made.found is None or made.found.answer.route is None else made.found.answer.route.time_s
    if made.world is None:
        return MapRow(arm=trial.arm, seed=seed, status="no_route", reason=made.why_not, planned_s=planned, best_s=None)
    episode, navigator = made.episode()
    desk = NewsDesk(made, navigator, None)
    time_s, steps, differed = 0.0, 0, 0
    while episode.outcome is None:
        desk.tell(time_s)
        second = episode.advance(1.0)
        time_s, answers = second.end_s, second.grids.answers
        steps += len(answers)
        differed += int(np.count_nonzero(answers.any(axis=1) != answers.all(axis=1)))
    outcome = asdict(episode.outcome)
    kept = {field.name: outcome[field.name] for field in fields(MapRow) if field.name in outcome}
    best = _best(made)
    return MapRow(
        arm=trial.arm,
        seed=seed,
        planned_s=planned,
        best_s=None if best is None else best.time_s,
        best_m=None if best is None else best.length_m,
        grids_differed=differed / steps if steps else None,
        **kept,
    )


def _best(made: Stage) -> planner.Route | None:
    """Return the best route on the true ground."""
    if made.found is None or made.world is None:
        return None
    region = made.found.shown.region
    params = replace(region.params, moisture_percent=made.scenario.true_moisture_percent)
    true = replace(region, elevation_m=made.world.elevation_m, soil=made.world.soil, params=params)
    start, goal = made.found.ends
    return planner.plan(true, start, goal, method="exact").route


def run_trials(
    out: Path,
    *,
    runs: int,
    first_seed: int = 0,
    scenario: str | None = None,
    vehicles: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    grids: Sequence[str] | None = None,
    probing: Sequence[str] | None = None,
    noise: bool = False,
    workers: int | None = None,
    keep: int = 3,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Run trials, write ``trials.csv``, ``trials.png`` and the summary, and return it; ``table`` tells it to people.

    The ``keep`` worst runs are driven once more, each into a log that ``swathe replay`` takes.

    Without ``scenario`` worlds are drawn. An interrupt keeps what is done.

    Raises:
        InvalidParameterError: something that is asked for does not exist or does not fit the rest.
    """
    if not 0 <= keep <= len(WORST_LOGS):
        raise InvalidParameterError(f"{keep} runs cannot be kept.", f"Give 0 to {len(WORST_LOGS)}.")
    if not 1 <= runs <= 1_000_000:
        raise InvalidParameterError(f"{runs} runs cannot be done.", "Give at least 1.")
    unknown = sorted(set(methods or ()) - METHODS.keys())
    if unknown:
        raise InvalidParameterError(f"The method {unknown[0]!r} is not known.", f"Give {', '.join(METHODS)}.")
    seeds = range(first_seed, first_seed + runs)
    with run_folder(out) as folder:
        if scenario is None:
            if grids or probing:
                raise InvalidParameterError(
                    "Drawn worlds have no map.", "Give `--grids` and `--probing` with a scenario."
                )
            found = _drawn(seeds, vehicles, methods or ("navigator",), noise=noise, workers=workers, tell=on_progress)
        else:
            found = _mapped(
                load_scenario(scenario),
                scenario,
                seeds,
                vehicles=vehicles or (),
                methods=methods or (),
                grids=grids or (),
                probing=probing or (),
                noise=noise,
                workers=workers,
                tell=on_progress,
            )
        summary: dict[str, Any] = {
            "command": "trials",
            "version": swathe.__version__,
            "status": "done" if found.is_complete else "interrupted",
            "seed": first_seed,
            "runs": runs,
            "scenario": scenario,
            "inputs": [],
            "noise": noise,
            "arms": found.arms,
            "pairs": found.pairs,
            "worst": found.worst,
            "table": found.table,
        }
        write_text(folder / "trials.csv", found.csv)
        from swathe.report.trials import draw_trials

        draw_trials(folder / "trials.png", found.picture, found.title)
        outputs = {"summary": SUMMARY, "csv": "trials.csv", "picture": "trials.png"}
        if found.is_complete:
            outputs |= _keep(folder, found.again[:keep], on_progress)
        summary["outputs"] = outputs
        write_text(folder / SUMMARY, to_json(summary))
    summary["outputs"] = {name: str(out / path) for name, path in outputs.items()}
    return summary


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    arms: list[dict[str, Any]]
    pairs: list[dict[str, Any]]
    worst: list[dict[str, Any]]
    again: list[Scenario]
    table: str
    csv: str
    title: str
    picture: dict[str, dict[str, Any]]
    is_complete: bool


def scenario_of_trial(trial: trials.Trial, fastest_s: float | None = None) -> Scenario:
    """Return the scenario whose drive is that of a trial in a drawn world, to the bit.

    ``fastest_s`` is that of its row; the trial's time limit comes of it.
    """
    vehicle = load_vehicle(trial.vehicle)
    content = {
        "title": f"Trial {trial.seed}",
        "vehicle": trial.vehicle,
        "seed": trial.seed,
        "world": {"kind": trial.kind, "density": trial.density, "scale": trials.scale_of(vehicle)},
        "drive": {
            "method": trial.method,
            "memory": not trial.alone,
            "recover": not trial.alone,
            "time_limit_s": trials.limit_s(vehicle, fastest_s or 0.0),
        },
        "sensors": {
            "laser": trials.laser_of(vehicle),
            **(trials.NOISE if trial.noisy else {}),
        },
    }
    return scenario_of(content, "The trial")


def _keep(folder: Path, worst: Sequence[Scenario], tell: OnProgress | None) -> dict[str, str]:
    """Drive the worst runs into logs of their own and return their names."""
    kept = {}
    for number, (name, scenario) in enumerate(zip(WORST_LOGS, worst, strict=False)):
        if tell is not None:
            tell("worst runs", number, len(worst))
        made = stage(scenario, watch=Stopwatch())
        if made.world is not None:
            record(made, folder / name, body="sim")
            kept[Path(name).stem] = name
    return kept


def _drawn(
    seeds: Sequence[int],
    vehicles: Sequence[str] | None,
    methods: Sequence[str],
    *,
    noise: bool,
    workers: int | None,
    tell: OnProgress | None,
) -> _Found:
    drawn = [trials.draw(seed, noisy=noise, vehicles=vehicles or trials.VEHICLES) for seed in seeds]
    asked = [replace(trial, method=METHODS[name][0], alone=METHODS[name][1]) for name in methods for trial in drawn]
    rows, is_complete = trials.run(asked, processes=workers, progress=_progress(tell))
    by_arm = {name: [row for row in rows if (row.method, row.alone) == METHODS[name]] for name in methods}
    arms = [{"arm": name, **asdict(trials.summarise(part))} for name, part in by_arm.items()]
    worst_rows = trials.worst(rows)
    worst = [{**asdict(row), "time_ratio": row.time_ratio} for row in worst_rows]
    head = ("method", "worlds", "passable", "reached", "95 %", "hits", "unseen", "length", "time", "free")
    lines = ["{:10} {:>7} {:>9} {:>8} {:>15} {:>5} {:>7} {:>7} {:>6} {:>6}".format(*head)]
    for arm in arms:
        low, high = arm["reached_interval"]
        share = arm["reached"] / arm["passable"] if arm["passable"] else math.nan
        lines.append(
            f"{arm['arm']:10} {arm['trials']:>7} {arm['passable']:>9} {share:>8.1%} {low:>7.1%}-{high:<7.1%} "
            f"{arm['collisions_seen']:>5} {arm['collisions_unseen']:>7} {arm['length_ratio'][0]:>7.2f} "
            f"{arm['time_ratio'][0]:>6.2f} {_percent(arm['free_speed'][0]):>6}"
        )
    lines += [
        "hits: ran into what could be seen in time; unseen: into what could not. length and time: medians of what was",
        "reached over the shortest true way, at full speed. free: speed over the greatest where nothing is near.",
        "The worst:",
    ]
    lines += [
        f"  seed {bad['seed']}: {bad['vehicle']}, {bad['kind']}, density {bad['density']}, {bad['method']}: "
        f"{bad['status']}. {bad['reason']}"
        for bad in worst[:5]
    ]
    picture = {
        name: {
            "statuses": dict(Counter(row.status for row in part)),
            "time_ratios": [row.time_ratio for row in part if row.status == "reached" and row.time_ratio is not None],
        }
        for name, part in by_arm.items()
    }
    title = f"{len(seeds)} drawn worlds" + (", noisy sensors" if noise else "")
    return _Found(
        arms=arms,
        pairs=[],
        worst=worst,
        again=[scenario_of_trial(trials.trial_of(row), row.fastest_s) for row in worst_rows],
        table="\n".join(lines),
        csv=trials.csv_text(rows),
        title=title,
        picture=picture,
        is_complete=is_complete,
    )


def _mapped(
    base: Scenario,
    name: str,
    seeds: Sequence[int],
    *,
    vehicles: Sequence[str],
    methods: Sequence[str],
    grids: Sequence[str],
    probing: Sequence[str],
    noise: bool,
    workers: int | None,
    tell: OnProgress | None,
) -> _Found:
    if noise:
        base = base.with_changes({"sensors": {**base.sensors.model_dump(), **trials.NOISE}})
    choices: list[list[tuple[str, dict[str, Any]]]] = [
        [(vehicle, {"vehicle": vehicle}) for vehicle in vehicles],
        [
            (
                method,
                {
                    "drive.method": METHODS[method][0],
                    "drive.memory": not METHODS[method][1],
                    "drive.recover": not METHODS[method][1],
                },
            )
            for method in methods
        ],
        [(f"grids {mode}", {"drive.grids": mode}) for mode in grids],
        [(f"probing {policy}", {"probing.policy": policy}) for policy in probing],
    ]
    ways = list(itertools.product(*(choice or [("", {})] for choice in choices)))
    arms: dict[str, Scenario] = {}
    for way in ways:
        label = ", ".join(word for word, _ in way if word) or name
        changes: dict[str, Any] = {}
        for _, part in way:
            changes |= part
        arms[label] = base.with_changes(changes)
    asked = [
        MapTrial(label, scenario.with_changes({"seed": seed})) for label, scenario in arms.items() for seed in seeds
    ]
    rows, is_complete = trials.run_all(run_map_trial, asked, processes=workers, progress=_progress(tell))
    by_arm = {label: [row for row in rows if row.arm == label] for label in arms}
    told = [_map_summary(label, part) for label, part in by_arm.items()]
    pairs = [_pair(first, by_arm[first], second, by_arm[second]) for first, second in itertools.combinations(by_arm, 2)]
    head = ("", "runs", "reached", "95 %", "no-go", "probes", "length", "time", "95 %", "differ")
    lines = ["{:28} {:>5} {:>8} {:>15} {:>6} {:>7} {:>6} {:>6} {:>11} {:>6}".format(*head)]
    for arm in told:
        low, high = arm["reached_interval"]
        middle, least, most = arm["time_ratio"]
        lines.append(
            f"{arm['arm']:28} {arm['runs']:>5} {arm['reached_share']:>8.1%} {low:>7.1%}-{high:<7.1%} "
            f"{arm['no_go_entries']:>6.2f} {arm['probes']:>7.1f} {arm['length_ratio'][0]:>6.2f} "
            f"{middle:>6.2f} {least:>5.2f}-{most:<5.2f} {_percent(arm['grids_differed']):>6}"
        )
    lines += [
        "no-go, probes: means of a run; length, time: medians over the best route on the true ground, of what was",
        "reached; differ: share of steps at which the overlapping grids gave different answers.",
    ]
    lines += [pair["words"] for pair in pairs]
    worst = sorted(
        (row for row in rows if row.status != "no_route"),
        key=lambda row: (row.status == "reached", -(row.no_go_entries), -(row.time_ratio or 0.0)),
    )[:10]
    return _Found(
        arms=told,
        pairs=pairs,
        worst=[asdict(row) for row in worst],
        again=[arms[row.arm].with_changes({"seed": row.seed}) for row in worst],
        table="\n".join(lines),
        csv=_csv(rows),
        title=f"{base.title or name}: {len(seeds)} seeds",
        picture={
            label: {
                "statuses": dict(Counter(row.status for row in part)),
                "time_ratios": [row.time_ratio for row in part if row.status == "reached" and row.time_ratio],
            }
            for label, part in by_arm.items()
        },
        is_complete=is_complete,
    )


def _map_summary(label: str, rows: Sequence[MapRow]) -> dict[str, Any]:
    driven = [row for row in rows if row.status != "no_route"]
    reached = [row for row in driven if row.status == "reached"]
    low, high = trials.wilson(len(reached), len(driven))
    differed = [row.grids_differed for row in driven if row.grids_differed is not None]
    return {
        "arm": label,
        "runs": len(driven),
        "no_route": len(rows) - len(driven),
        "reached": len(reached),
        "reached_share": len(reached) / len(driven) if driven else math.nan,
        "reached_interval": (low, high),
        "collisions": sum(row.collisions for row in driven),
        "no_go_entries": float(np.mean([row.no_go_entries for row in driven])) if driven else math.nan,
        "probes": float(np.mean([row.probes for row in driven])) if driven else math.nan,
        "length_ratio": trials.bootstrap_median([row.length_ratio for row in reached if row.length_ratio]),
        "time_ratio": trials.bootstrap_median([row.time_ratio for row in reached if row.time_ratio]),
        "grids_differed": float(np.mean(differed)) if differed else math.nan,
        "reasons": dict(Counter(row.reason for row in driven if row.status != "reached")),
    }


def _pair(first: str, one: Sequence[MapRow], second: str, other: Sequence[MapRow]) -> dict[str, Any]:
    """Compare two arms on the seeds that both have driven."""
    by_seed = {row.seed: row for row in other if row.status != "no_route"}
    both = [(row, by_seed[row.seed]) for row in one if row.status != "no_route" and row.seed in by_seed]
    saved = [a.duration_s - b.duration_s for a, b in both if a.status == b.status == "reached"]
    safer = [a.no_go_entries - b.no_go_entries for a, b in both]
    middle, low, high = trials.bootstrap_median(saved)
    mean = float(np.mean(safer)) if safer else math.nan
    only = (
        sum(b.status == "reached" != a.status for a, b in both),
        sum(a.status == "reached" != b.status for a, b in both),
    )
    words = (
        f"{second} against {first}, {len(both)} seeds: median time saved {middle:.1f} s ({low:.1f} to {high:.1f}) "
        f"where both reached it, {mean:.2f} fewer times on no-go ground a run; only {second} reached it {only[0]} "
        f"times, only {first} {only[1]} times."
    )
    return {
        "first": first,
        "second": second,
        "seeds": len(both),
        "time_saved_s": (middle, low, high),
        "fewer_no_go_entries": mean,
        "only_second_reached": only[0],
        "only_first_reached": only[1],
        "words": words,
    }


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{share:.1%}"


def _progress(tell: OnProgress | None) -> Callable[[int, int], None] | None:
    if tell is None:
        return None

    def progress(done: int, total: int) -> None:
        tell("trials", done, total)

    return progress


def _csv(rows: Sequence[MapRow]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(MapRow)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    return text.getvalue()
