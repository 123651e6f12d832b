"""Run files in, a table for people out."""

from __future__ import annotations

import json
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

HEADING = "| job | ours, CPU s | peer, CPU s | ratio | must | goal | peak MB, ours | peak MB, peer |"
RULE = "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"


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
        "| job | ours | peer | run | commit | machine |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {name} | `{record['ours']}` | {record['peer']} | [{file}](runs/{file}) | {run['commit']} "
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


def _median(record: dict[str, Any], side: str, figure: str) -> float | None:
    values = [sample[figure] for sample in record["samples"][side] if sample[figure] is not None]
    return median(values) if values else None


def _number(value: float | None, decimals: int, factor: float = 1.0) -> str:
    return "-" if value is None else f"{value * factor:.{decimals}f}"
