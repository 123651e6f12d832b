"""Run files in, a table for people out."""

from __future__ import annotations

import json
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

HEADING = "| job | ours, CPU s | peer, CPU s | ratio | must | goal | peak MB, ours | peak MB, peer |"
RULE = "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"

#: Facts that tell how often a sample did the same thing, by what one of them is called.
COUNTS = {"steps": "step", "updates": "update", "scans": "scan", "readings": "reading", "seconds": "second"}

#: What is asked of one, in microseconds of CPU time: which figure, what it must be at most, and the goal.
ASKED = {
    "navigator-step": ("p99_us", 2000, 500),
    "navigator-step-map": ("p99_us", 2000, 500),
    "vfh-plus": ("mean", 10, 3),
    "vfh-plus-car": ("mean", 10, 3),
}


def disagreements(samples: dict[str, list[dict[str, Any]]], relative: float | None) -> list[str]:
    """Return a sentence for each fact on which any two samples differ by more than ``relative``."""
    if relative is None:
        return []
    figures: dict[str, list[float]] = {}
    for sample in [*samples["ours"], *samples["peer"]]:
        for name, value in sample["facts"].items():
            figures.setdefault(name, []).append(value)
    expected = len(samples["ours"]) + len(samples["peer"])
    return [
        f"results disagree on {name}: {min(values)!r} to {max(values)!r}"
        for name, values in figures.items()
        if len(values) != expected or max(values) - min(values) > relative * max(abs(value) for value in values)
    ]


def dearer(samples: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Return a sentence when our path costs more than the peer's, beyond rounding."""
    ours, peer = ([sample["facts"]["cost"] for sample in samples[side]] for side in ("ours", "peer"))
    return [f"ours costs more: {max(ours)!r}, the peer's {min(peer)!r}"] if max(ours) > min(peer) * (1 + 1e-6) else []


def cpu_ratio(record: dict[str, Any]) -> float | None:
    """Return median CPU seconds of the peer over ours, None when a side has no samples or took no time."""
    ours, peer = (_median(record, side, "cpu_s") for side in ("ours", "peer"))
    return peer / ours if ours and peer is not None else None


def table(runs: Path) -> str:
    """Return RESULTS.md: the newest figures of each job over all run files of the folder ``runs``."""
    newest: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {}
    for path in sorted(runs.glob("*.json")):
        run = json.loads(path.read_text(encoding="utf-8"))
        for record in run["benchmarks"]:
            newest[record["name"]] = (record, run, path.name)
    lines = [
        "# Results",
        "",
        "Written by `make bench`; [README.md](README.md) tells how it is measured. The ratio is the peer's median CPU",
        "seconds over ours. Memory is counted above what was held before the job, inputs not counted.",
        "",
        "![Ratios of CPU seconds, peers over ours](results.png)",
        "",
        HEADING,
        RULE,
        *(_row(record) for record, _, _ in newest.values()),
        "",
        *_of_one({name: (record, run) for name, (record, run, _) in newest.items()}),
        "| job | ours | peer | run | commit | machine |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {name} | `{_cell(record['ours'])}` | {_cell(record['peer'])} | [{file}](runs/{file}) | {run['commit']} "
        f"| {run['machine']['processor']}, {run['machine']['cores']} cores |"
        for name, (record, run, file) in newest.items()
    ]
    failed = [f"- {name}: {error}" for name, (record, _, _) in newest.items() for error in record["errors"]]
    if failed:
        lines += ["", "Not valid:", "", *failed]
    return "\n".join(lines) + "\n"


def table_of_run(run: dict[str, Any]) -> str:
    """Return the table of one run."""
    return "\n".join([HEADING, RULE, *(_row(record) for record in run["benchmarks"])])


def _of_one(newest: dict[str, tuple[dict[str, Any], dict[str, Any]]]) -> list[str]:
    """Return the table of single steps, updates and the like, of the jobs whose samples say how many they did."""
    counted = {name: told for name, told in newest.items() if _count(told[0], "ours") is not None}
    if not counted:
        return []
    samples = [sample for record, _ in counted.values() for sample in record["samples"]["ours"]]
    timed = list(dict.fromkeys(fact for sample in samples for fact in sample["facts"] if fact.endswith("_us")))
    heads = ["job", "one", "mean", *(_head(fact) for fact in timed), "peer, mean", "must", "goal", "bytes", "machine"]
    lines = [
        "CPU time of one, in microseconds, and bytes written for one: medians over samples. Must and goal are for the",
        "figure that they name.",
        "",
        "| " + " | ".join(heads) + " |",
        "| --- | --- |" + " ---: |" * (len(heads) - 3) + " --- |",
    ]
    for name, (record, run) in counted.items():
        figure, *limits = ASKED.get(name, ("", None, None))
        cells = [
            name,
            COUNTS[_count(record, "ours") or ""],
            _number(_each(record, "ours", "cpu_s"), 1, 1e6),
            *(_number(_fact(record, fact), 1) for fact in timed),
            _number(_each(record, "peer", "cpu_s"), 1, 1e6),
            *("-" if limit is None else f"{limit}, {_head(figure)}" for limit in limits),
            _number(_each(record, "ours", "bytes"), 0),
            f"{run['machine']['processor']}, {run['machine']['cores']} cores",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def _count(record: dict[str, Any], side: str) -> str | None:
    """Return the fact that tells how often every sample of a side did the same."""
    samples = record["samples"][side]
    return next((fact for fact in COUNTS if samples and all(sample["facts"].get(fact) for sample in samples)), None)


def _each(record: dict[str, Any], side: str, figure: str) -> float | None:
    """Return the median of a figure or fact of the samples of a side over how often they did the same."""
    count = _count(record, side)
    values = [sample["facts"] | sample for sample in record["samples"][side]]
    found = [value[figure] / value["facts"][count] for value in values if count is not None and figure in value]
    return median(found) if found else None


def _fact(record: dict[str, Any], fact: str) -> float | None:
    values = [sample["facts"][fact] for sample in record["samples"]["ours"] if fact in sample["facts"]]
    return median(values) if values else None


def _head(fact: str) -> str:
    """Return what people call a fact: ``p99_us`` is 99 %."""
    name = fact.removesuffix("_us")
    return f"{name[1:]} %" if name[:1] == "p" and name[1:].isdigit() else name


def _row(record: dict[str, Any]) -> str:
    ratio = cpu_ratio(record)
    cells = [
        record["name"],
        _number(_median(record, "ours", "cpu_s"), 4),
        _number(_median(record, "peer", "cpu_s"), 4),
        "failed" if record["errors"] or ratio is None else f"**{ratio:.2f}**",
        f"{record['must']:.3g}",
        f"{record['goal']:.3g}",
        *(_number(_median(record, side, "peak_bytes"), 1, 1e-6) for side in ("ours", "peer")),
    ]
    return "| " + " | ".join(cells) + " |"


def _cell(text: str) -> str:
    """Return a text that does not end its cell of a table."""
    return text.replace("|", "\\|")


def _median(record: dict[str, Any], side: str, figure: str) -> float | None:
    values = [sample[figure] for sample in record["samples"][side] if sample[figure] is not None]
    return median(values) if values else None


def _number(value: float | None, decimals: int, factor: float = 1.0) -> str:
    return "-" if value is None else f"{value * factor:.{decimals}f}"
