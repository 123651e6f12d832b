"""Trials of the navigator: drawn worlds, outcomes with intervals, methods and grids side by side.

    python benchmarks/trials.py [--only drawn,noisy,open,methods,grids] [--sets NAMES] [--worlds N] [--noisy N]
                                [--open N] [--methods N] [--grids N] [--processes N] [--again] [--folder DIR]

Writes ``runs/trials/*.csv`` (one row a drive), ``TRIALS.md`` and ``docs/images/trials.png``, or all of it into a
folder. Trials of which the same code has left a row are not run again (``trial_rows`` says what the same code is), so
a run that was cut goes on where it was. Ctrl-C keeps what is done.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import harness
import run
import trial_report
import trial_rows
import trials_plot
from swathe import proving, trials
from swathe.scenario import load_scenario

#: The local methods, alone and within the navigator.
METHODS: tuple[trials.Method, ...] = ("vfh", "vfh+", "vfh*", "player")

#: Scenarios whose maps the overlapping grids look at, and what ground outside the nests does.
SCENARIOS = ("paper", "heath")
OUTSIDE = ("cost", "block")

DRIVES = trial_rows.Job(trials.run_one, trials.Row, lambda trial: trial, trials.trial_of)
MAPPED = trial_rows.Job(
    proving.run_map_trial,
    proving.MapRow,
    lambda trial: (trial.arm, trial.scenario.seed),
    lambda row: (row.arm, row.seed),
)


@dataclass(frozen=True)
class Asked:
    """A set of trials that is asked for: its file's name, and what to run how."""

    name: str
    items: list[Any]
    job: trial_rows.Job[Any, Any]


def drawn(count: int) -> list[Asked]:
    """Return the drawn worlds."""
    return [Asked("drawn", [trials.draw(seed) for seed in range(count)], DRIVES)]


def noisy(count: int) -> list[Asked]:
    """Return the same worlds with noise and delay."""
    return [Asked("noisy", [trials.draw(seed, noisy=True) for seed in range(count)], DRIVES)]


def unobstructed(count: int) -> list[Asked]:
    """Return worlds with nothing but the wall around them, for every vehicle as many."""
    vehicles = dict.fromkeys(trials.VEHICLES)
    return [
        Asked(
            "open",
            [trials.Trial(seed=seed, density=0.0, vehicle=name) for name in vehicles for seed in range(count)],
            DRIVES,
        )
    ]


def methods(count: int) -> list[Asked]:
    """Return static worlds for a Jackal, driven by every local method alone and within the navigator."""
    static = (trials.draw(seed, vehicles=("jackal",)) for seed in range(10 * count))
    chosen = [trial for trial in static if trial.kind != "moving"][:count]
    return [
        Asked(
            trial_report.method_set(method, alone=alone),
            [replace(trial, method=method, alone=alone) for trial in chosen],
            DRIVES,
        )
        for method in METHODS
        for alone in (True, False)
    ]


def grids(count: int) -> list[Asked]:
    """Return scenarios with a map under many seeds, with one grid and with the overlapping pair."""
    asked = []
    for name in SCENARIOS:
        for outside in OUTSIDE:
            base = load_scenario(name).with_changes({"drive.outside_nests": outside})
            items = [
                proving.MapTrial(mode, base.with_changes({"drive.grids": mode, "seed": seed}))
                for seed in range(count)
                for mode in ("single", "or")
            ]
            asked.append(Asked(trial_report.grid_set(name, outside), items, MAPPED))
    return asked


#: Every group of sets: how it is made, how many seeds, what the number counts.
GROUPS = {
    "drawn": (drawn, 1000, "drawn worlds"),
    "noisy": (noisy, 300, "drawn worlds with noise and delay"),
    "open": (unobstructed, 20, "worlds without crates for every vehicle"),
    "methods": (methods, 100, "worlds for every method"),
    "grids": (grids, 100, "seeds of every scenario with a map"),
}


def main(arguments: list[str]) -> int:
    """Run what ``arguments`` ask for and return the exit status: 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description="Run trials of the navigator.")
    parser.add_argument("--only", default=",".join(GROUPS), help=f"groups to run, of {', '.join(GROUPS)} (all)")
    parser.add_argument("--sets", default="", help="of those groups only these sets, such as full-vfh-plus (all)")
    for name, (_, usual, counted) in GROUPS.items():
        option = "worlds" if name == "drawn" else name
        parser.add_argument(f"--{option}", dest=name, type=int, default=usual, help=f"{counted} ({usual})")
    parser.add_argument("--processes", type=int, default=None, help="workers (one a core)")
    parser.add_argument("--again", action="store_true", help="run what is there again")
    parser.add_argument("--folder", type=Path, default=None, help="write everything there instead")
    chosen = parser.parse_args(arguments)
    wanted = [name for name in chosen.only.split(",") if name]
    counts = {name: getattr(chosen, name) for name in GROUPS}
    if not set(wanted) <= GROUPS.keys() or min(counts.values()) < 1:
        parser.error(f"Known groups: {', '.join(GROUPS)}. Numbers: at least 1.")
    every = [asked for group in wanted for asked in GROUPS[group][0](counts[group])]
    sets = {name for name in chosen.sets.split(",") if name} or {asked.name for asked in every}
    if not sets <= {asked.name for asked in every}:
        parser.error(f"Known sets of these groups: {', '.join(asked.name for asked in every)}.")
    here, root = harness.FOLDER, trial_rows.root()
    rows, page, picture = here / "runs" / "trials", here / "TRIALS.md", root / "docs" / "images" / "trials.png"
    if chosen.folder is not None:
        rows, page, picture = (chosen.folder / name for name in ("rows", "TRIALS.md", "trials.png"))
        rows.mkdir(parents=True, exist_ok=True)
    code, is_complete = trial_rows.code_of(root), True
    for asked in every:
        if asked.name not in sets:
            continue
        _, is_complete = trial_rows.run_set(
            rows,
            asked.name,
            asked.items,
            asked.job,
            code=code,
            arguments=arguments,
            processes=chosen.processes,
            again=chosen.again,
        )
        publish(rows, page, picture)
        if not is_complete:
            return 130
    publish(rows, page, picture)
    return 0


def publish(rows: Path, page: Path, picture: Path) -> None:
    """Write the page and the picture from all rows that are there."""
    found = trial_report.Found.of(rows)
    if found.drawn:
        trials_plot.draw(picture, found.drawn)
    run.write_text(page, trial_report.page(found, picture if found.drawn else None, page.parent))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
