"""TRIALS.md: what the rows of all sets say, with intervals, methods and grids side by side."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

import trial_rows
from swathe import proving, trials
from swathe.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

FULL = "full-vfh-plus"
_WORDS = {"vfh": "vfh", "vfh+": "vfh-plus", "vfh*": "vfh-star", "player": "player"}

_HEAD = [
    "| | passable | reached | collisions | length over shortest | time over shortest at full speed | free space |",
    "| --- | --- | --- | --- | --- | --- | --- |",
]


def method_set(method: str, *, alone: bool) -> str:
    """Return the name of the set of a method."""
    return f"{'alone' if alone else 'full'}-{_WORDS[method]}"


def method_words(name: str) -> str:
    """Return what people call the set of a method."""
    way, _, word = name.partition("-")
    said = {"vfh": "VFH", "vfh-plus": "VFH+", "vfh-star": "VFH*", "player": "Player's"}[word]
    return f"{said} alone" if way == "alone" else f"navigator with {said}"


def grid_set(scenario: str, outside: str) -> str:
    """Return the name of the set of a scenario."""
    return f"grids-{scenario}-{outside}"


@dataclass(frozen=True)
class Found:
    """All rows of a folder, and what is noted of their sets."""

    drawn: list[trials.Row]
    noisy: list[trials.Row]
    unobstructed: list[trials.Row]
    methods: dict[str, list[trials.Row]]
    grids: dict[str, list[proving.MapRow]]
    notes: dict[str, dict[str, Any]]

    @classmethod
    def of(cls, folder: Path) -> Found:
        """Read a folder."""
        notes = trial_rows.notes_of(folder)

        def rows(name: str) -> list[trials.Row]:
            path = folder / f"{name}.csv"
            return trial_rows.rows_of(path.read_text(encoding="utf-8"), trials.Row) if name in notes else []

        names = [method_set(method, alone=alone) for alone in (False, True) for method in _WORDS]
        mapped = [name for name in notes if name.startswith("grids-")]
        return cls(
            rows("drawn"),
            rows("noisy"),
            rows("open"),
            {name: found for name in names if (found := rows(name))},
            {
                name: trial_rows.rows_of((folder / f"{name}.csv").read_text(encoding="utf-8"), proving.MapRow)
                for name in mapped
            },
            notes,
        )


def page(found: Found, picture: Path | None, beside: Path) -> str:
    """Return the page; addresses in it are relative to the folder that it will lie in."""
    lines = [
        "# Trials",
        "",
        "Written by `benchmarks/trials.py`; rows in `runs/trials`, with machine, commit and command in `sets.json`.",
        "Worlds, vehicles and densities are drawn by seed; passable is what a search of poses finds on the truth. A",
        "drive through a drawn world is over after 1800 s, which grow with the world of a larger vehicle, or after 20",
        "times what the shortest way takes at full speed, whichever is later.",
        "Collisions: with what could have been seen in time / the others. Free space is the speed there: metres driven",
        "over what full speed makes of the seconds in which everything, and the goal, is farther than the stopping",
        "distance from full speed and 2 m, counted from when that speed could be had. Intervals are 95 %: Wilson's for",
        "shares, percentile bootstrap for medians and for the speed.",
    ]
    if picture is not None:
        address = os.path.relpath(picture.resolve(), beside.resolve())
        lines += ["", f"![Share reached and time against the density of crates, by vehicle]({address})"]
    for part in (_drawn, _open, _methods, _grids, _failures, _sets):
        lines += part(found)
    return "\n".join(lines) + "\n"


def _drawn(found: Found) -> list[str]:
    rows = found.drawn
    lines: list[str] = []
    if rows:
        jackal = [row for row in rows if row.vehicle == "jackal" and row.kind != "moving"]
        lines += ["", f"## {len(rows)} drawn worlds, full navigator", "", *_HEAD, summary_row("all", rows)]
        lines.append(summary_row("static worlds", [row for row in rows if row.kind != "moving"]))
        lines.append(summary_row("Jackal, static worlds", jackal))
        lines += [summary_row(kind, [row for row in rows if row.kind == kind]) for kind in trials.KINDS]
        for vehicle in dict.fromkeys(trials.VEHICLES):
            lines.append(summary_row(vehicle, [row for row in rows if row.vehicle == vehicle]))
        low, high = trials.DENSITIES
        for part in range(3):
            least, most = low + (high - low) * part / 3, low + (high - low) * (part + 1) / 3
            within = [row for row in rows if least <= row.density < most or (part == 2 and row.density == most)]
            lines.append(summary_row(f"{least:.0f} to {most:.0f} crates per 100 m²", within))
    if found.noisy:
        static = [row for row in found.noisy if row.kind != "moving"]
        lines += ["", f"## {len(found.noisy)} drawn worlds with noise and delay", ""]
        lines += [
            "Scans 100 ms late, 10 % of beams lost, odometry off by 2 % and corrected once a second by a fix of 0.3 m.",
            "",
            *_HEAD,
            summary_row("all", found.noisy),
            summary_row("static worlds", static),
        ]
    return lines


def _open(found: Found) -> list[str]:
    if not found.unobstructed:
        return []
    lines = ["", "## Speed in free space, in worlds with nothing but the wall around them", ""]
    lines += ["| vehicle | drives | in free space, s | metres over those at full speed |", "| --- | --- | --- | --- |"]
    for vehicle in dict.fromkeys(row.vehicle for row in found.unobstructed):
        rows = [row for row in found.unobstructed if row.vehicle == vehicle]
        told = trials.summarise(rows)
        seconds = sum(row.free_s for row in rows)
        lines.append(f"| {vehicle} | {told.free_drives} | {seconds:.0f} | {_share(told.free_speed)} |")
    return lines


def _methods(found: Found) -> list[str]:
    sets = found.methods
    if not sets:
        return []
    counts = {len(rows) for rows in sets.values()}
    lines = ["", f"## Methods on the same {max(counts)} worlds (Jackal, static)", ""]
    if len(counts) > 1:
        lines += [f"Sets with fewer rows, {min(counts)} at least, have the first of these worlds only.", ""]
    for name, rows in sets.items():
        if (over_s := earlier_limit_s(rows)) is not None:
            lines += [f"Drives of {method_words(name)} were over after {over_s:.0f} s, by an earlier rule.", ""]
    lines += _HEAD
    lines += [summary_row(method_words(name), rows) for name, rows in sets.items()]
    reached = {name: {row.seed: row for row in rows if row.status == "reached"} for name, rows in sets.items()}
    for title, names in (
        ("every method", list(sets)),
        ("every method within the navigator", [name for name in sets if name.startswith("full")]),
    ):
        if not names:
            continue
        common = sorted(set.intersection(*(set(reached[name]) for name in names)))
        if not common:
            lines += ["", f"No world was reached by {title}."]
            continue
        lines += ["", f"On the {len(common)} worlds that {title} reached:", ""]
        lines += ["| | length over shortest | time over shortest at full speed |", "| --- | --- | --- |"]
        for name in names:
            length, time = (
                [getattr(reached[name][seed], f"{what}_ratio") for seed in common] for what in ("length", "time")
            )
            lines.append(f"| {method_words(name)} | {_median(length)} | {_median(time)} |")
    if FULL in sets:
        lines += ["", f"Against the {method_words(FULL)}, world by world:", "", *_PAIR_HEAD]
        lines += [pair_row(method_words(name), rows, sets[FULL]) for name, rows in sets.items() if name != FULL]
        lines += ["", *_PAIR_WORDS]
    return lines


def _grids(found: Found) -> list[str]:
    if not found.grids:
        return []
    lines = ["", "## One grid against the overlapping pair", ""]
    lines += [
        "Scenarios with a map under other seeds: ground outside the nests costs (`cost`) or must not be driven on",
        "(`block`). The best route on the true ground knows the soil and height that the map does not, and no crates.",
        "",
        "| scenario | grids | drives | reached | length over best | time over best | grids differ, share of steps |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    pairs = ["", "The pair against one grid, seed by seed:", "", *_PAIR_HEAD]
    for name, rows in found.grids.items():
        words = name.removeprefix("grids-").replace("-", ", ")
        by_mode = {mode: [row for row in rows if row.arm == mode] for mode in dict.fromkeys(row.arm for row in rows)}
        for mode, part in by_mode.items():
            driven = [row for row in part if row.status != "no_route"]
            reached = [row for row in driven if row.status == "reached"]
            differed = [row.grids_differed for row in driven if row.grids_differed is not None]
            lines.append(
                f"| {words} | {mode} | {len(driven)} | {_reached(len(reached), len(driven))} "
                f"| {_median([row.length_ratio for row in reached])} | {_median([row.time_ratio for row in reached])} "
                f"| {_mean(differed)} |"
            )
        if {"single", "or"} <= by_mode.keys():
            pairs.append(pair_row(words, by_mode["or"], by_mode["single"]))
    return [*lines, *pairs, "", *_PAIR_WORDS]


_PAIR_HEAD = [
    "| | pairs | only this / only the other reached | both | length over the other's | time over the other's |",
    "| --- | --- | --- | --- | --- | --- |",
]
_PAIR_WORDS = [
    "Ratios are medians over what both reached. p: McNemar's exact test of reaching, Wilcoxon's signed-rank test of",
    "the logarithms of the ratios; none is corrected for the number of comparisons.",
]


def pair_row(
    name: str, these: Sequence[trials.Row | proving.MapRow], others: Sequence[trials.Row | proving.MapRow]
) -> str:
    """Compare two ways of driving on the seeds that both have driven."""
    other_of = {row.seed: row for row in others if row.status not in _NOT_DRIVEN}
    pairs = [(row, other_of[row.seed]) for row in these if row.status not in _NOT_DRIVEN and row.seed in other_of]
    only = [sum(one.status == "reached" != two.status for one, two in pairs)]
    only.append(sum(two.status == "reached" != one.status for one, two in pairs))
    chance = stats.binomtest(only[0], sum(only)).pvalue if sum(only) else 1.0
    both = [(one, two) for one, two in pairs if one.status == two.status == "reached"]
    told = []
    for what in ("distance_m", "duration_s"):
        ratios = [
            getattr(one, what) / getattr(two, what) for one, two in both if getattr(one, what) > 0 < getattr(two, what)
        ]
        logs = np.log(ratios)
        chance_of = stats.wilcoxon(logs).pvalue if np.any(logs != 0) else 1.0
        told.append(f"{_median(ratios)}, {_chance(chance_of)}" if ratios else "-")
    return f"| {name} | {len(pairs)} | {only[0]} / {only[1]}, {_chance(chance)} | {len(both)} | {told[0]} | {told[1]} |"


_NOT_DRIVEN = ("no_route", "not_passable")


def _failures(found: Found) -> list[str]:
    lines = ["", "## Why the others were not reached"] if found.drawn or found.noisy else []
    for what, rows in (("drawn worlds", found.drawn), ("drawn worlds with noise and delay", found.noisy)):
        if rows:
            told = trials.summarise(rows)
            lines += [
                "",
                f"{told.passable - told.reached} of {told.passable} passable {what}:",
                "",
                *reason_lines(rows),
            ]
    if not found.drawn:
        return lines
    lines += ["", "## The worst without noise", "", "| seed | world | crates | vehicle | ended | time ratio |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for row in trials.worst(found.drawn):
        ratio = "-" if row.time_ratio is None else f"{row.time_ratio:.1f}"
        lines.append(
            f"| {row.seed} | {row.kind} | {row.density} | {row.vehicle} | {row.status}: {row.reason} | {ratio} |"
        )
    return lines


def reason_lines(rows: Sequence[trials.Row]) -> list[str]:
    """Return a line for every reason why goals were not reached: how often, with which vehicles, of how many worlds."""
    by_vehicle = {name: [row for row in rows if row.vehicle == name] for name in dict.fromkeys(trials.VEHICLES)}
    told = {name: trials.summarise(part) for name, part in by_vehicle.items() if part}
    return [
        f"- {count} x {reason.rstrip('.')}: "
        + ", ".join(
            f"{name} {missed} of {summary.passable}"
            for name, summary in told.items()
            if (missed := summary.not_reached.get(reason, 0))
        )
        for reason, count in trials.summarise(rows).not_reached.items()
    ]


def earlier_limit_s(rows: Sequence[trials.Row]) -> float | None:
    """Return after how long the drives of rows were over that had less time than drives have now; None without any."""
    late = [row for row in rows if row.status == "timeout" and row.fastest_s is not None]
    vehicles = {name: load_vehicle(name) for name in {row.vehicle for row in late}}
    short = [row for row in late if row.duration_s < trials.limit_s(vehicles[row.vehicle], row.fastest_s or 0.0) - 1]
    return max((row.duration_s for row in short), default=None)


def _sets(found: Found) -> list[str]:
    lines = [
        "",
        "## Sets",
        "",
        "| set | rows | code | commit | machine | took |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    counts: Mapping[str, int] = {
        "drawn": len(found.drawn),
        "noisy": len(found.noisy),
        "open": len(found.unobstructed),
        **{name: len(rows) for name, rows in (found.methods | found.grids).items()},
    }
    for name, note in found.notes.items():
        machine = note["machine"]
        where = f"{machine['processor']}, {machine['cores']} cores"
        took = trial_rows.minutes(note["wall_s"])
        lines.append(f"| {name} | {counts.get(name, 0)} | {note['code'][:12]} | {note['commit']} | {where} | {took} |")
    return lines


def summary_row(name: str, rows: Sequence[trials.Row]) -> str:
    """Return a line of the table of drawn worlds."""
    told = trials.summarise(rows)
    hits = f"{told.collisions_seen} / {told.collisions_unseen}"
    ratios = f"{_figures(told.length_ratio)} | {_figures(told.time_ratio)}"
    reached = _reached(told.reached, told.passable)
    return f"| {name} | {told.passable} | {reached} | {hits} | {ratios} | {_share(told.free_speed)} |"


def _reached(reached: int, count: int) -> str:
    if not count:
        return "-"
    low, high = trials.wilson(reached, count)
    return f"{100 * reached / count:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _median(values: Sequence[float | None]) -> str:
    return _figures(trials.bootstrap_median([value for value in values if value is not None]))


def _figures(figures: tuple[float, float, float]) -> str:
    middle, low, high = figures
    return "-" if math.isnan(middle) else f"{middle:.2f} ({low:.2f} to {high:.2f})"


def _share(figures: tuple[float, float, float]) -> str:
    middle, low, high = figures
    return "-" if math.isnan(middle) else f"{100 * middle:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _mean(shares: Sequence[float]) -> str:
    """Return a mean share with its bootstrap interval."""
    return _share(trials.bootstrap_ratio(shares, np.ones(len(shares))))


def _chance(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"
