"""The paper's figures of a region, drawn into a folder with an index: ``swathe figures``."""

from __future__ import annotations

import html
from dataclasses import replace
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe import nest as nesting
from swathe import planner, rank, swarm
from swathe.errors import InvalidParameterError
from swathe.export.folder import FIGURES, SUMMARY, run_folder, to_json, write_text
from swathe.grid import Cell
from swathe.preparation import prepare_ground
from swathe.soil import SoilClass
from swathe.summary import shared_summary
from swathe.terrain import height_map

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from swathe.config import Settings, TerrainRequest
    from swathe.grid import Position
    from swathe.nest import Nests
    from swathe.preparation import Ground

    OnProgress = Callable[[str, int, int], bool]

_WORDS = {
    "swarm-flow.png": "The swarm: what every agent does, drawn from the table that the code is tested against.",
    "nest-flow.png": "Nest building: what happens at a focus, from the same table.",
    "height-map.png": "The grey height map: heights as grey levels from 0 to 255.",
    "terrain-3d.png": "The terrain in three dimensions.",
    "soil.png": "The soil's categories.",
    "grid.png": "The grid: terrain cells with their ranks, in a part of the map.",
    "overlapping-grids.png": "Two overlapping grids of navigation cells, a quarter of a cell apart.",
    "grid-gain.png": "What overlapping grids gain: how often they find a gap of one to two navigation cells.",
    "nests.png": "Ranked cells with the nests outlined.",
    "global-path.png": "The global path through the nests.",
}


def draw_figures(
    terrain: TerrainRequest,
    settings: Settings,
    out: Path,
    *,
    ends: tuple[tuple[float, float], tuple[float, float]] | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Any]:
    """Draw every figure into a folder and return its summary.

    ``ends`` are start and goal of the global path in ``terrain.points_crs``; without them it joins two far ends of the
    largest nest.

    Raises:
        SwatheError: the inputs cannot be used, the folder cannot be written, or the user stopped.
    """
    with run_folder(out) as folder:
        ground = prepare_ground(terrain, settings, on_progress=on_progress)
        summary = {**shared_summary("figures", ground, settings), "status": "done"}
        drawn = _draw(folder, ground, settings, _ends(ground, terrain, ends), on_progress)
        write_text(folder / "index.html", _index(drawn, ground))
        names = [*drawn, "index.html", SUMMARY]
        summary["outputs"] = {name.partition(".")[0]: name for name in names}
        write_text(folder / SUMMARY, to_json(summary))
    summary["outputs"] = {name: str(out / path) for name, path in summary["outputs"].items()}
    return summary


def _draw(
    folder: Path,
    ground: Ground,
    settings: Settings,
    ends: tuple[Position, Position] | None,
    on_progress: OnProgress | None,
) -> list[str]:
    """Draw what the ground allows and return the names in order."""
    from swathe.report import paper_figures
    from swathe.report.figures_grids import draw_gap_gain
    from swathe.report.flow_chart import draw_flow_chart
    from swathe.report.map import MapPicture, draw_map

    region, frame = ground.region, ground.frame
    geometry = region.geometry
    lonlat_of = frame.to_lonlat if frame.has_lonlat else None
    tags = {"swathe_seed": str(settings.seed)}
    ranks = rank.rank_map(region).rank
    params = settings.swarm_params()
    suitable = ranks >= params.nest.rank_min
    drawn: list[str] = []

    def tell(name: str) -> Path:
        if on_progress is not None:
            on_progress("figures", len(drawn), len(FIGURES))
        drawn.append(name)
        return folder / name

    for chart in ("swarm", "nest"):
        draw_flow_chart(tell(f"{chart}-flow.png"), chart, swarm.transitions(), swarm.state_texts(), metadata=tags)
    grey = height_map(region.elevation_m)
    paper_figures.draw_height_map(tell("height-map.png"), grey, geometry, lonlat_of, tags)
    paper_figures.draw_terrain(tell("terrain-3d.png"), region.elevation_m, geometry, tags)
    if region.soil is not None:
        names = [known.name.lower() for known in SoilClass]
        source = "" if ground.soil is None else ground.soil.source
        paper_figures.draw_soil(
            tell("soil.png"), region.soil, geometry, tags, names=names, lonlat_of=lonlat_of, note=source
        )
    window = paper_figures.mixed_window(suitable, 16, 20)
    paper_figures.draw_grid(tell("grid.png"), ranks, geometry, window, tags)
    cell_m = 4 * region.vehicle.length_m
    across = max(2, round(paper_figures.NAVIGATION_CELLS_ACROSS * cell_m / geometry.cell_size_m))
    window = paper_figures.mixed_window(suitable, max(2, round(across * 0.8)), across)
    paper_figures.draw_overlapping_grids(tell("overlapping-grids.png"), suitable, geometry, window, tags, cell_m=cell_m)
    draw_gap_gain(tell("grid-gain.png"), seed=settings.seed, metadata=tags)
    nests = nesting.exact_nests(ranks, rank_min=params.nest.rank_min)
    subtitle = f"{region.vehicle.name}, {geometry.rows} x {geometry.columns} cells of {geometry.cell_size_m:g} m"
    picture = MapPicture(
        geometry,
        region.elevation_m,
        ranks,
        "One nest on ranked ground" if nests.count == 1 else f"{nests.count:,} nests on ranked ground",
        subtitle,
        nest_rings=_rings(nests, ground),
        lonlat_of=lonlat_of,
    )
    draw_map(tell("nests.png"), picture, metadata=tags)
    ends = ends or _far_ends(nests, ground)
    if ends is not None:
        plan = planner.plan(region, *ends, method=settings.method, swarm=params, corridor=settings.corridor_params())
        picture = replace(
            picture,
            title="Global path through the nests" if plan.route else f"No global path: {plan.reason}",
            nest_rings=_rings(plan.nests or nests, ground),
            swathe=None if plan.corridor is None else plan.corridor.cells(geometry),
            arc_xy_m=None if plan.corridor is None else plan.corridor.arc_xy_m,
            route_xy_m=None if plan.route is None else plan.route.xy_m,
            start_xy_m=ends[0],
            goal_xy_m=ends[1],
            blocked_xy_m=plan.place,
        )
        draw_map(tell("global-path.png"), picture, metadata=tags)
    return drawn


def _rings(nests: Nests, ground: Ground) -> list[Any]:
    outlines = nesting.outlines(nests, ground.region.geometry)
    return [ring for outline in outlines for ring in (outline.exterior, *outline.holes)]


def _ends(
    ground: Ground, terrain: TerrainRequest, ends: tuple[tuple[float, float], tuple[float, float]] | None
) -> tuple[Position, Position] | None:
    if ends is None:
        return None
    places = [ground.frame.from_points(x, y, terrain.points_crs, ground.source.source_crs_wkt) for x, y in ends]
    for name, place in zip(("start", "goal"), places, strict=True):
        if ground.region.geometry.cell_at(place) is None:
            raise InvalidParameterError(f"The {name} lies outside the map.", "Give a point on the map.")
    return places[0], places[1]


def _far_ends(nests: Nests, ground: Ground) -> tuple[Position, Position] | None:
    """Return two cells of the largest nest that lie far apart, None without a nest."""
    if nests.count == 0:
        return None
    cells = np.argwhere(nests.labels == int(np.argmax(nests.sizes)) + 1)
    sums = cells.sum(axis=1)
    first, last = cells[np.argmin(sums)], cells[np.argmax(sums)]
    geometry = ground.region.geometry
    return geometry.position_of(Cell(*map(int, first))), geometry.position_of(Cell(*map(int, last)))


def _index(drawn: list[str], ground: Ground) -> str:
    """Return the page that shows the figures; it lies beside them."""
    style = resources.files("swathe.report").joinpath("page.css").read_text(encoding="utf-8")
    names = html.escape(", ".join(ground.source.names))
    pictures = "\n".join(
        f'<figure class="picture"><img src="{name}" alt="{html.escape(_WORDS[name])}"></figure>\n'
        f'<p class="under">{html.escape(_WORDS[name])}</p>'
        for name in drawn
    )
    vehicle = html.escape(ground.region.vehicle.name)
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in ground.notes)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Figures</title>\n<style>{style}</style>\n</head>\n<body>\n<main>\n"
        f'<header><h1>Figures</h1><p class="lead">{names}, for the {vehicle}</p></header>\n'
        f'{pictures}\n<h2>Notes</h2>\n<ul class="notes">{notes}</ul>\n</main>\n</body>\n</html>\n'
    )
