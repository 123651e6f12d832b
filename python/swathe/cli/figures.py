"""``swathe figures``: which ground and which way when none is given, and what is printed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from swathe import figures
from swathe.cli import say

if TYPE_CHECKING:
    from pathlib import Path

    from swathe.config import Settings, TerrainRequest

_BUNDLED = "bundled:jacksboro"
_OVER_THE_RIDGES = ((-84.1311, 36.4621), (-84.1872, 36.5762))


def draw(
    terrain: TerrainRequest,
    settings: Settings,
    out: Path,
    *,
    ends: tuple[tuple[float, float], tuple[float, float]] | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Draw the figures, of the bundled terrain when none is given, and print where they are."""
    if not terrain.dem and terrain.store is None:
        terrain = replace(terrain, dem=(_BUNDLED,), soil=terrain.soil or _BUNDLED)
        ends = ends or (_OVER_THE_RIDGES if terrain.points_crs is None else None)
    with say.progress(quiet=quiet or as_json) as report:
        summary = figures.draw_figures(terrain, settings, out, ends=ends, on_progress=report)
    count = sum(path.endswith(".png") for path in summary["outputs"].values())
    say.line(summary, f"{count} figures. See\n{summary['outputs']['index']}", as_json=as_json)
    return 0
