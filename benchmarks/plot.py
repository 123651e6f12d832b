"""The newest figures of each job as a picture: how many times less work than the peer, beside the bars we set."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import results

if TYPE_CHECKING:
    from pathlib import Path

OURS, MUST, GOAL, INK = "#2f6f4f", "#c0392b", "#7f8c8d", "#222222"


def draw(runs: Path, picture: Path) -> None:
    """Draw a bar per job, longest ratio first, and the marks that it must and should reach; nothing without figures."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = sorted(_rows(runs), key=lambda row: row[1])
    if not rows:
        return
    figure = Figure(figsize=(9, 0.9 + 0.34 * len(rows)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    places = range(len(rows))
    axes.barh(places, [ratio for _, ratio, _ in rows], color=OURS, height=0.62)
    for place, (_, ratio, record) in enumerate(rows):
        for figure_of, colour in ((record["must"], MUST), (record["goal"], GOAL)):
            axes.plot([figure_of] * 2, [place - 0.4, place + 0.4], color=colour, linewidth=2, solid_capstyle="butt")
        axes.annotate(
            f"{ratio:.3g}",
            (ratio, place),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            color=INK,
            fontsize=9,
            # Marks lie under the number, not through it.
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
        )
    axes.set_yticks(
        list(places), [f"{name}  against  {_short(record['peer'])}" for name, _, record in rows], fontsize=8
    )
    axes.set_xscale("log")
    axes.set_xlim(right=3 * max(ratio for _, ratio, _ in rows))
    axes.set_xlabel("CPU seconds of the peer over ours (log scale); red: must, grey: goal")
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", color="#dddddd")
    axes.set_axisbelow(True)
    temporary = picture.with_name(f".{picture.name}.tmp")
    try:
        figure.savefig(temporary, dpi=110, format="png", metadata={"Software": None})
        temporary.replace(picture)
    finally:
        temporary.unlink(missing_ok=True)


def _rows(runs: Path) -> list[tuple[str, float, dict[str, Any]]]:
    newest: dict[str, dict[str, Any]] = {}
    for path in sorted(runs.glob("*.json")):
        for record in json.loads(path.read_text(encoding="utf-8"))["benchmarks"]:
            newest[record["name"]] = record
    ratios = {name: results.cpu_ratio(record) for name, record in newest.items() if not record["errors"]}
    return [(name, ratio, newest[name]) for name, ratio in ratios.items() if ratio is not None]


def _short(peer: str) -> str:
    return peer if len(peer) <= 44 else f"{peer[:43]}…"
