"""The same question asked for four kinds of path, in one picture.

    python examples/path_kinds.py OUT.png DEM START GOAL VEHICLE [DEM START GOAL VEHICLE ...]

START and GOAL are x,y in the elevation's own system; VEHICLE is one of `swathe vehicles`. Example:

    python examples/path_kinds.py kinds.png dem.tif 597230,150620 597600,150980 pickup-4x4
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swathe import planner, rank
from swathe.config import Settings, TerrainRequest
from swathe.preparation import open_source, place_of, prepare_ground
from swathe.report.path_kinds import Panel, Way, draw_path_kinds

if TYPE_CHECKING:
    from swathe.planner import PathKind, Plan

KINDS: tuple[tuple[str, PathKind], ...] = (
    ("8 neighbours", "grid8"),
    ("16 neighbours, shortcuts", "grid16"),
    ("any angle", "any-angle"),
    ("drivable", "drivable"),
)


def way_of(name: str, answer: Plan) -> Way:
    """Return what is drawn of an answer: of a drivable path its poses, else the ends of the legs."""
    if answer.route is None:
        raise SystemExit(f"{name}: {answer.reason}")
    driven = answer.drivable
    if driven is not None:
        points = driven.poses[:, :2]
        turns = f"{driven.cusps} changes of direction, radius {driven.radius_m:g} m"
        return Way(name, points, f"{driven.time_s:.1f} s, {driven.length_m:.0f} m, {turns}")
    legs = answer.route.legs
    points = np.array([(legs[0].start.x_m, legs[0].start.y_m), *((leg.end.x_m, leg.end.y_m) for leg in legs)])
    return Way(name, points, f"{answer.route.time_s:.1f} s, {answer.route.length_m:.0f} m, {len(legs)} legs")


def panel(dem: str, start: str, goal: str, vehicle: str) -> Panel:
    """Plan all kinds of path on one map."""
    terrain = TerrainRequest(dem=(dem,), points_crs="native")
    ground = prepare_ground(terrain, Settings(vehicle=vehicle))
    with open_source(terrain) as source:
        ends = [place_of(source, tuple(map(float, place.split(","))), "native") for place in (start, goal)]  # type: ignore[arg-type]
    answers = [(name, planner.plan(ground.region, *ends, method="exact", path=kind)) for name, kind in KINDS]
    region = ground.region
    return Panel(
        f"{Path(dem).stem}, {vehicle}, cells of {region.geometry.cell_size_m:g} m",
        region.geometry,
        region.elevation_m,
        rank.rank_map(region).rank,
        [way_of(name, answer) for name, answer in answers],
    )


def main(arguments: list[str]) -> None:
    """Draw the picture that the arguments ask for."""
    out, *questions = arguments
    asked = [questions[place : place + 4] for place in range(0, len(questions), 4)]
    if not asked or len(asked[-1]) != 4:
        raise SystemExit(__doc__)
    panels = [panel(*question) for question in asked]
    draw_path_kinds(
        out, "Four kinds of path", "Above: the whole way. Below: where the ways lie farthest apart.", panels
    )


if __name__ == "__main__":
    main(sys.argv[1:])
