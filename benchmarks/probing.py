r"""What probing gives a drive with a false soil map: the table, paired tests, and a picture of one seed both ways.

    swathe trials --scenario wrong-soil --runs 100 --seed 2000 --out trials \
        --probing never --probing where-it-matters --probing where-it-pays
    python benchmarks/probing.py trials/trials.csv --command "swathe trials ..." [--name wrong-soil]
    python benchmarks/probing.py --picture 2001 docs/images/probing.png

Files the rows as ``runs/probing/NAME.csv`` beside ``NAME.json``, which says where they come from.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from run import surroundings
from swathe import trials
from swathe.preparation import Stopwatch
from swathe.scenario import load_scenario
from swathe.staging import stage

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

HERE = Path(__file__).parent

#: Seconds that a goal which is not reached costs on top: what freeing a stuck vehicle takes at least, as the
#: navigator reckons.
STUCK_S = 3600.0

Rows = dict[int, dict[str, str]]


def arms_of(path: Path) -> dict[str, Rows]:
    """Return the rows by arm and seed."""
    arms: dict[str, Rows] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            arms.setdefault(row["arm"], {})[int(row["seed"])] = row
    return arms


def is_reached(row: dict[str, str]) -> bool:
    return row["status"] == "reached"


def cost_s(row: dict[str, str]) -> float:
    """Return the time of a drive, and an hour more where it did not reach its goal."""
    return float(row["duration_s"]) + (0.0 if is_reached(row) else STUCK_S)


def share(count: int, of: int) -> str:
    low, high = trials.wilson(count, of)
    return f"{100 * count / of:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def median(values: Sequence[float]) -> str:
    middle, low, high = trials.bootstrap_median(values)
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def table(arms: dict[str, Rows]) -> list[str]:
    """Return the table of all arms, lines of Markdown."""
    lines = [
        (
            "| probing | reached | of those with a true way | stood on no-go ground | readings | time over the best "
            "| length driven, m | mean cost, s |"
        ),
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, rows in arms.items():
        told = list(rows.values())
        ways = [row for row in told if row["best_s"]]
        there = [row for row in told if is_reached(row)]
        ratios = [float(row["duration_s"]) / float(row["best_s"]) for row in there if row["best_s"]]
        cells = [
            name.removeprefix("probing "),
            share(len(there), len(told)),
            share(sum(map(is_reached, ways)), len(ways)),
            share(sum(row["no_go_entries"] != "0" for row in told), len(told)),
            f"{np.mean([int(row['probes']) for row in told]):.1f}",
            median(ratios),
            f"{np.median([float(row['distance_m']) for row in there]):.0f}",
            f"{np.mean([cost_s(row) for row in told]):.0f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def pair(one: Rows, other: Rows) -> dict[str, Any]:
    """Compare two arms on the same seeds; ``p`` are two-sided."""
    seeds = sorted(one.keys() & other.keys())

    def mcnemar(first: Sequence[bool], second: Sequence[bool]) -> tuple[int, int, float]:
        won = sum(b and not a for a, b in zip(first, second, strict=True))
        lost = sum(a and not b for a, b in zip(first, second, strict=True))
        return won, lost, float(stats.binomtest(won, won + lost).pvalue) if won + lost else 1.0

    won, lost, p_reached = mcnemar([is_reached(one[s]) for s in seeds], [is_reached(other[s]) for s in seeds])
    kept, entered, p_no_go = mcnemar(
        [one[s]["no_go_entries"] == "0" for s in seeds], [other[s]["no_go_entries"] == "0" for s in seeds]
    )
    saved = [cost_s(one[s]) - cost_s(other[s]) for s in seeds]
    both = [s for s in seeds if is_reached(one[s]) and is_reached(other[s])]
    longer = [float(other[s]["duration_s"]) - float(one[s]["duration_s"]) for s in both]
    return {
        "seeds": len(seeds),
        "reached_by_second_only": won,
        "reached_by_first_only": lost,
        "p_reached_mcnemar_exact": p_reached,
        "off_no_go_by_second_only": kept,
        "off_no_go_by_first_only": entered,
        "p_no_go_mcnemar_exact": p_no_go,
        "mean_cost_saved_s": float(np.mean(saved)),
        "p_cost_wilcoxon": float(stats.wilcoxon(saved).pvalue) if any(saved) else 1.0,
        "both_reached": len(both),
        "median_longer_s_where_both_reached": float(np.median(longer)) if longer else None,
    }


def picture(seed: int, path: Path, name: str) -> None:
    """Draw one seed without probing beside the same with it."""
    from matplotlib import pyplot as plt
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure, axes = plt.subplots(1, 2, figsize=(11, 6.3), sharey=True)
    for axis, policy, word in zip(axes, ("never", "where-it-pays"), ("without", "with"), strict=True):
        told = draw(axis, name, seed, policy)
        axis.set_title(f"{word} probing: {told}", fontsize=10)
    marks: list[Patch | Line2D] = [Patch(color=colour, label=label) for _, colour, label in SOILS]
    marks += [
        Patch(color="#303030", alpha=0.45, label="closed by readings"),
        Line2D([], [], color="black", label="driven"),
        Line2D([], [], color="black", linestyle=":", label="planned on the map"),
        Line2D([], [], color="#b00020", marker="v", linestyle="", label="reading"),
        Line2D([], [], color="black", marker="*", linestyle="", markersize=10, label="goal"),
    ]
    figure.legend(
        handles=marks,
        loc="lower center",
        bbox_to_anchor=(0.5, -0.005),
        ncols=len(marks),
        fontsize=8,
        frameon=False,
        columnspacing=1.2,
    )
    figure.suptitle(
        "The true soil, which the map does not show (metres), and the same drive with and without readings", fontsize=11
    )
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    figure.savefig(path, dpi=90)


SOILS = ((1, "#d9c9a3", "gravel"), (2, "#f2e3b3", "sand"), (3, "#c98a6b", "clay"), (4, "#c9d3a0", "silt"))


def draw(axis: Axes, name: str, seed: int, policy: str) -> str:
    """Draw one drive; returns how it ended."""
    from matplotlib.colors import ListedColormap

    made = stage(load_scenario(name).with_changes({"seed": seed, "probing.policy": policy}), watch=Stopwatch())
    if made.world is None or made.found is None:
        raise SystemExit(made.why_not)
    episode, navigator = made.episode()
    places, readings = [], []
    while episode.outcome is None:
        second = episode.advance(1.0)
        places += list(zip(second.truth.x_m, second.truth.y_m, strict=True))
        readings += [event.fields for event in second.events if event.kind == "reading_taken"]
    geometry = made.found.shown.region.geometry
    extent = (geometry.west_m, geometry.east_m, geometry.south_m, geometry.north_m)
    colours = ListedColormap([colour for _, colour, _ in SOILS])
    axis.imshow(made.world.soil, extent=extent, cmap=colours, vmin=0.5, vmax=4.5, interpolation="nearest")
    closed = np.where(navigator.ranks == 1, 1.0, np.nan)
    axis.imshow(closed, extent=extent, cmap=ListedColormap(["#303030"]), alpha=0.45, interpolation="nearest")
    axis.plot(*made.route.points_m.T, color="black", linestyle=":", linewidth=1)
    axis.plot(*np.array(places).T, color="black", linewidth=1.4)
    axis.plot(
        [told["x_m"] for told in readings], [told["y_m"] for told in readings], "v", color="#b00020", markersize=4
    )
    axis.plot(made.goal.x_m, made.goal.y_m, "*", color="black", markersize=13)
    outcome = asdict(episode.outcome)
    end = "goal reached" if outcome["status"] == "reached" else outcome["reason"].rstrip(".").lower()
    return f"{end}, {outcome['distance_m']:.0f} m, {outcome['duration_s']:.0f} s, {outcome['probes']} readings"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, nargs="?", help="trials.csv of `swathe trials`")
    parser.add_argument("--name", default="wrong-soil", help="the scenario, and name of what is filed")
    parser.add_argument("--command", help="the command that made the rows; files them")
    parser.add_argument("--picture", nargs=2, metavar=("SEED", "PATH"))
    given = parser.parse_args()
    if given.picture:
        picture(int(given.picture[0]), Path(given.picture[1]), given.name)
    if given.rows is None:
        return
    arms = arms_of(given.rows)
    first, *rest = arms
    pairs = {f"{name} against {first}": pair(arms[first], arms[name]) for name in rest}
    print("\n".join(table(arms)))
    print(json.dumps(pairs, indent=1))
    if given.command:
        shutil.copyfile(given.rows, HERE / "runs" / "probing" / f"{given.name}.csv")
        origin = surroundings([])
        del origin["command"]
        told = {
            "command": given.command,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            **origin,
            "pairs": pairs,
        }
        (HERE / "runs" / "probing" / f"{given.name}.json").write_text(
            json.dumps(told, indent=1) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
