"""``swathe export``: a finished run for another program."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from swathe.config import TerrainRequest


def write(
    folder: Path,
    location: Path,
    *,
    mapset: str,
    prefix: str,
    overwrite: bool,
    terrain: TerrainRequest,
    as_json: bool,
) -> int:
    """Write a run's maps into a GRASS location and say which."""
    from swathe.cli import say
    from swathe.export.grass import GrassTarget, export_grass

    maps = export_grass(folder, GrassTarget(location, mapset, prefix, overwrite), terrain=terrain)
    answer = {"status": "done", "location": str(location), "outputs": maps}
    lines = [f"{location} has {len(maps)} maps of this run:", *(f"  {what:10} {name}" for what, name in maps.items())]
    say.line(answer, "\n".join(lines), as_json=as_json)
    return 0
