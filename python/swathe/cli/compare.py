"""``swathe nests --compare`` in words: one column a method, one line a figure, intervals under means."""

from __future__ import annotations

from typing import Any

from swathe.cli import say
from swathe.errors import UsageError

_TITLES = {"swarm": "swarm", "exact": "exact", "lazy_astar": "lazy A*", "lazy_astar_1.25": "lazy A* 1.25"}

#: figure, what it is called, how it is shown
_ROWS = (
    ("nest_count", "nests", "count"),
    ("cells_evaluated", "cells evaluated", "count"),
    ("share", "  of the map", "percent"),
    ("recall", "recall of cells", "share"),
    ("recall_cores", "recall of cores", "share"),
    ("precision", "precision", "share"),
    ("visits", "visits", "count"),
    ("ticks", "ticks", "count"),
    ("connected_at", "ticks to connection", "count"),
    ("cost", "cost of the way, s", "seconds"),
    ("cost_excess", "above the optimum", "percent"),
    ("seconds", "seconds", "time"),
)
_NAME_WIDTH, _COLUMN_WIDTH = 22, 21


def lines(summary: dict[str, Any]) -> list[str]:
    """Return the table of a summary with a comparison, nothing without one."""
    comparison = summary.get("comparison")
    if not comparison:
        return []
    methods = {name: _with_share(figures, summary["cells_total"]) for name, figures in comparison.items()}
    found = [f"  {'':{_NAME_WIDTH}}" + "".join(f"{_TITLES[name]:>{_COLUMN_WIDTH}}" for name in methods)]
    for figure, name, kind in _ROWS:
        if all(figures.get(figure) is None for figures in methods.values()):
            continue
        cells = [_shown(figures, figure, kind) for figures in methods.values()]
        found.append(f"  {name:{_NAME_WIDTH}}" + "".join(f"{cell:>{_COLUMN_WIDTH}}" for cell in cells))
    seeds = len(summary.get("seeds", ()))
    if seeds > 1:
        found.append(f"  means over {seeds} seeds, ± half of Student's 95 % interval")
    return found


def ends_of(start: str | None, goal: str | None) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the two ends of the swathe, None when neither is given.

    Raises:
        UsageError: one is given without the other, or is no pair of numbers.
    """
    if start is None and goal is None:
        return None
    if start is None or goal is None:
        missing = "--start" if start is None else "--goal"
        raise UsageError(f"{missing} is missing: a swathe has two ends.", "Give --start and --goal, or neither.")
    return say.pair("--start", start), say.pair("--goal", goal)


def _with_share(figures: dict[str, Any], cells_total: int) -> dict[str, Any]:
    """Add the share of the map's cells that were evaluated."""
    share = None if figures["cells_evaluated"] is None else figures["cells_evaluated"] / cells_total
    interval = figures["interval_95"].get("cells_evaluated")
    intervals = dict(figures["interval_95"])
    if interval is not None:
        intervals["share"] = [side / cells_total for side in interval]
    return {**figures, "share": share, "interval_95": intervals}


def _shown(figures: dict[str, Any], figure: str, kind: str) -> str:
    value = figures.get(figure)
    if value is None:
        return "\N{EN DASH}"
    interval = figures["interval_95"].get(figure)
    half = 0.0 if interval is None else (interval[1] - interval[0]) / 2
    return _number(value, kind) + (f" ± {_number(half, kind)}" if half > 0 else "")


def _number(value: float, kind: str) -> str:
    if kind == "percent":
        return f"{100 * value:.2f} %"
    if kind == "count":
        return f"{value:,.0f}"
    if kind == "share":
        return f"{value:.4f}"
    return f"{value:,.1f}" if kind == "seconds" else f"{value:,.3f}"
