"""Trials of the navigator: drawn worlds, outcomes with intervals, the methods side by side.

    python benchmarks/trials.py [--worlds N] [--methods N] [--processes N]

Writes ``runs/trials/*.csv`` (one row a drive) and ``TRIALS.md``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from swathe import trials

if TYPE_CHECKING:
    from collections.abc import Sequence

HERE = Path(__file__).parent


def summary_row(name: str, rows: Sequence[trials.Row]) -> str:
    told = trials.summarise(rows)
    low, high = told.reached_interval
    share = f"{100 * told.reached_share:.1f} % ({100 * low:.1f} to {100 * high:.1f})" if told.passable else "-"

    def ratio(figures: tuple[float, float, float]) -> str:
        middle, least, most = figures
        return f"{middle:.2f} ({least:.2f} to {most:.2f})" if told.reached else "-"

    hits = f"{told.collisions_seen} / {told.collisions_unseen}"
    return f"| {name} | {told.passable} | {share} | {hits} | {ratio(told.length_ratio)} | {ratio(told.time_ratio)} |"


HEAD = [
    "| | passable | reached | collisions seen / unseen | length over shortest | time over shortest at full speed |",
    "| --- | --- | --- | --- | --- | --- |",
]


def report(sets: dict[str, Sequence[trials.Row]]) -> str:
    """Return TRIALS.md."""
    drawn, noisy = sets["drawn"], sets.get("noisy", ())
    jackal = [row for row in drawn if row.vehicle == "jackal" and row.kind != "moving"]
    lines = [
        "# Trials",
        "",
        "Written by `benchmarks/trials.py`; rows in `runs/trials`. Worlds, vehicles and densities are drawn by seed;",
        "passable is what a search of poses finds on the truth. Collisions: with what could have been seen in time /",
        "the others.",
        "Intervals are 95 %: Wilson's for shares, percentile bootstrap for medians.",
        "",
        f"## {len(drawn)} drawn worlds, full navigator",
        "",
        *HEAD,
        summary_row("all", drawn),
        summary_row("Jackal, static worlds", jackal),
    ]
    lines += [summary_row(kind, [row for row in drawn if row.kind == kind]) for kind in trials.KINDS]
    for vehicle in dict.fromkeys(trials.VEHICLES):
        lines.append(summary_row(vehicle, [row for row in drawn if row.vehicle == vehicle]))
    low, high = trials.DENSITIES
    for part in range(3):
        least, most = low + (high - low) * part / 3, low + (high - low) * (part + 1) / 3
        within = [row for row in drawn if least <= row.density < most or (part == 2 and row.density == most)]
        lines.append(summary_row(f"{least:.0f} to {most:.0f} crates per 100 m²", within))
    if noisy:
        lines.append(summary_row("with noise and delay", noisy))
    methods = {name: rows for name, rows in sets.items() if name.startswith(("alone", "full"))}
    if methods:
        lines += ["", "## Methods on the same worlds (Jackal, static)", "", *HEAD]
        lines += [summary_row(name, rows) for name, rows in methods.items()]
    lines += ["", "## Why the others were not reached", ""]
    lines += [f"- {count} x {reason}" for reason, count in trials.summarise(drawn).not_reached.items()]
    lines += [
        "",
        "## The worst",
        "",
        "| seed | world | crates | vehicle | ended | time ratio |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in trials.worst(drawn):
        ratio = "-" if row.time_ratio is None else f"{row.time_ratio:.1f}"
        lines.append(
            f"| {row.seed} | {row.kind} | {row.density} | {row.vehicle} | {row.status}: {row.reason} | {ratio} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="Run trials of the navigator.")
    parser.add_argument("--worlds", type=int, default=1000)
    parser.add_argument("--noisy", type=int, default=200)
    parser.add_argument("--methods", type=int, default=100)
    parser.add_argument("--processes", type=int, default=None)
    chosen = parser.parse_args()
    folder = HERE / "runs" / "trials"
    folder.mkdir(parents=True, exist_ok=True)
    asked = {
        "drawn": [trials.draw(seed) for seed in range(chosen.worlds)],
        "noisy": [trials.draw(seed, noisy=True) for seed in range(chosen.noisy)],
    }
    static = [trials.draw(seed, vehicles=("jackal",)) for seed in range(4 * chosen.methods)]
    static = [trial for trial in static if trial.kind != "moving"][: chosen.methods]
    methods: tuple[trials.Method, ...] = ("vfh", "vfh+", "vfh*", "player")
    for method in methods:
        for alone in (True, False):
            name = f"{'alone' if alone else 'full navigator'}, {method}"
            asked[name] = [replace(trial, method=method, alone=alone) for trial in static]
    sets: dict[str, Sequence[trials.Row]] = {}
    for name, group in asked.items():
        print(name, len(group), flush=True)
        rows, complete = trials.run(group, processes=chosen.processes)
        sets[name] = rows
        (folder / f"{name.replace(', ', '-').replace(' ', '-').replace('*', '-star')}.csv").write_text(
            trials.csv_text(rows)
        )
        (HERE / "TRIALS.md").write_text(report(sets))
        if not complete:
            return


if __name__ == "__main__":
    main()
