"""How far paths lie from the cheapest there is, where the cheapest is known exactly.

Worlds whose answer is known in closed form or by an exact method of another kind: free ground at every heading, blocks
(a visibility graph), two media (Snell's law), speed that grows linearly (circular rays), and for a vehicle a plane with
directed cost, a ridge and a cone (unfolded). Writes the tables of ``docs/any-angle.md`` and its picture; a test
compares both tables with what this gives.

    .venv/bin/python benchmarks/any_angle_errors.py
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.optimize
import scipy.sparse.csgraph
import scipy.spatial
import shapely

from swathe import planner
from swathe.grid import Cell, GridGeometry, Position
from swathe.rank import Region
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Row = tuple[str, int, dict[str, list[float]]]

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE, PICTURE = DOCS / "any-angle.md", DOCS / "images" / "any-angle.png"

CELL_COLUMNS = ("8 neighbours", "16 neighbours", "any angle", "eikonal field")
ROUTE_COLUMNS = ("grid8", "grid16, before shortcuts", "grid16", "any-angle")


def free_ground() -> Iterator[tuple[NDArray[np.float64], Cell, Cell, float]]:
    """Yield level ground with goals all around, five degrees apart."""
    costs = np.ones((121, 121))
    for degrees in range(0, 360, 5):
        rows, columns = (round(58 * f(math.radians(degrees))) for f in (math.sin, math.cos))
        yield costs, Cell(60, 60), Cell(60 + rows, 60 + columns), math.hypot(rows, columns)


def blocks() -> Iterator[tuple[NDArray[np.float64], Cell, Cell, float]]:
    """Yield level ground with closed blocks; the shortest way comes from the visibility graph of their corners."""
    for seed in range(20):
        draw = np.random.default_rng(seed)
        costs = np.ones((60, 60))
        for _ in range(9):
            row, column = draw.integers(3, 50, 2)
            rows, columns = draw.integers(2, 14, 2)
            costs[row : row + rows, column : column + columns] = np.inf
        start, goal = Cell(0, int(draw.integers(0, 60))), Cell(59, int(draw.integers(0, 60)))
        if np.isfinite(costs[start]) and np.isfinite(costs[goal]):
            exact = shortest_past_blocks(costs, start, goal)
            if math.isfinite(exact):
                yield costs, start, goal, exact


def shortest_past_blocks(costs: NDArray[np.float64], start: Cell, goal: Cell) -> float:
    """Return the length of the shortest way past closed cells, which it may touch, as the visibility graph gives it."""
    closed = ~np.isfinite(costs)
    around = np.pad(closed, 1).astype(int)
    touching = around[:-1, :-1] + around[1:, :-1] + around[:-1, 1:] + around[1:, 1:]
    corners = [(float(column), float(row)) for row, column in np.argwhere(touching == 1)]
    inside = [(x, y) for x, y in corners if 0 <= x <= costs.shape[1] and 0 <= y <= costs.shape[0]]
    points = [(start.column + 0.5, start.row + 0.5), (goal.column + 0.5, goal.row + 0.5), *inside]
    cells = [shapely.box(column, row, column + 1, row + 1) for row, column in np.argwhere(closed)]
    # Shrunk by a hair, so that touching is no crossing.
    solid = shapely.union_all(cells).buffer(-1e-9)
    shapely.prepare(solid)
    pairs = list(itertools.combinations(range(len(points)), 2))
    lines = shapely.linestrings([[points[a], points[b]] for a, b in pairs])
    seen = ~shapely.intersects(solid, lines)
    lengths = np.zeros((len(points), len(points)))
    for (a, b), length, visible in zip(pairs, shapely.length(lines), seen, strict=True):
        lengths[a, b] = length if visible else 0.0
    return float(scipy.sparse.csgraph.dijkstra(scipy.sparse.csr_array(lengths), directed=False, indices=0)[1])


def two_media() -> Iterator[tuple[NDArray[np.float64], Cell, Cell, float]]:
    """Yield two halves of different cost; Snell's law says where the border is crossed."""
    for ratio in (1.5, 2.5, 4.0):
        costs = np.ones((100, 100))
        costs[:, 50:] = ratio
        for start, goal in [((10, 5), (90, 95)), ((5, 40), (95, 60)), ((50, 10), (20, 90)), ((3, 30), (97, 99))]:
            exact = scipy.optimize.minimize_scalar(
                lambda row, a=start, b=goal, k=ratio: (
                    math.hypot(49.5 - a[1], row - a[0]) + k * math.hypot(b[1] - 49.5, b[0] - row)
                ),
                bounds=(0, 99),
                method="bounded",
                options={"xatol": 1e-10},
            ).fun
            yield costs, Cell(*start), Cell(*goal), float(exact)


def growing_speed() -> Iterator[tuple[NDArray[np.float64], Cell, Cell, float]]:
    """Yield speeds that grow linearly to the east, where the quickest ways are arcs of circles."""
    growth = 0.03
    speed = 1.0 + growth * np.arange(121)
    costs = np.tile(1.0 / speed, (121, 1))
    for start, goal in [
        ((10, 10), (110, 10)),
        ((10, 10), (110, 110)),
        ((60, 5), (60, 115)),
        ((110, 100), (5, 20)),
        ((20, 60), (100, 60)),
        ((5, 30), (100, 5)),
    ]:
        apart = (start[0] - goal[0]) ** 2 + (start[1] - goal[1]) ** 2
        exact = math.acosh(1 + growth**2 * apart / (2 * speed[start[1]] * speed[goal[1]])) / growth
        yield costs, Cell(*start), Cell(*goal), exact


def cell_rows() -> list[Row]:
    """Return the relative errors of paths over plain costs, world by world."""
    worlds = {
        "free ground, every heading": free_ground,
        "blocks, visibility graph": blocks,
        "two media, Snell's law": two_media,
        "speed growing linearly, circular rays": growing_speed,
    }
    rows: list[Row] = []
    for name, world in worlds.items():
        errors: dict[str, list[float]] = {column: [] for column in CELL_COLUMNS}
        for costs, start, goal, exact in world():
            found = (
                cost_of(planner.shortest_path(costs, start, goal)),
                cost_of(planner.shortest_path(costs, start, goal, neighbours=16)),
                cost_of(planner.any_angle_path(costs, start, goal)),
                float(planner.eikonal_field(costs, start)[goal]),
            )
            for column, cost in zip(CELL_COLUMNS, found, strict=True):
                errors[column].append(cost / exact - 1)
        rows.append((name, len(errors["any angle"]), errors))
    return rows


def cost_of(path: planner.Path | planner.AnyAnglePath | planner.NoRoute) -> float:
    """Return the cost of a path that must be there."""
    if isinstance(path, planner.NoRoute):
        raise RuntimeError(path.reason)  # noqa: TRY004 - the answer is wrong, not its type
    return path.cost


@dataclass(frozen=True)
class Surface:
    """A surface of which the cheapest times are known."""

    height_m: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
    vehicle: Vehicle
    exact_s: Callable[[Position, Position], float]
    pairs: tuple[tuple[tuple[int, int], tuple[int, int]], ...]


SIDE, CELL_M = 100, 10.0
GEOMETRY = GridGeometry(SIDE, SIDE, CELL_M, 0.0, SIDE * CELL_M)
#: A vehicle that nothing slows, so that its time is the length of the way over its speed.
STEADY = {"power_w": 1e8, "sight_distance_m": 1e4, "grade_up": 0.45, "grade_down": 0.45, "side_slope": 0.45}


def changed(**figures: float) -> Vehicle:
    """Return a tractor with other figures."""
    return Vehicle(**{**load_vehicle("tractor").model_dump(), **figures})


def plane(grade: float, vehicle: Vehicle) -> Surface:
    """Return a plane that rises to the north.

    Its cheapest times are those of the convex hull of the headings' velocities: where the hull is met between two
    headings, the cheapest way tacks between them.
    """
    heading = np.radians(np.arange(0, 360, 0.02))
    if vehicle.grade_up < grade:
        steepest = math.asin(vehicle.grade_up / grade)
        heading = np.append(heading, [steepest, math.pi - steepest])
    along = grade * np.sin(heading)
    resistance = 0.04 + 0.9 / 63 + along  # ground of unknown soil
    cosine = 1 / np.hypot(1, along)
    force_n = vehicle.mass_kg * 9.80665 * cosine * resistance
    pull_mps = vehicle.drive_efficiency * vehicle.power_w / np.where(resistance > 0, force_n, np.nan)
    speed_mps = np.fmin(vehicle.max_speed_mps, pull_mps) * cosine
    allowed = (along <= vehicle.grade_up * (1 + 1e-12)) & (-along <= vehicle.grade_down)
    allowed &= np.abs(grade * np.cos(heading)) <= vehicle.side_slope
    ends = (speed_mps * np.array([np.cos(heading), np.sin(heading)])).T[allowed]
    hull = scipy.spatial.ConvexHull(ends).equations

    def exact_s(start: Position, goal: Position) -> float:
        wanted = np.array([goal.x_m - start.x_m, goal.y_m - start.y_m])
        return float(np.max(hull[:, :2] @ wanted / -hull[:, 2]))

    pairs = tuple(
        ((50, 50), goal) for goal in ((5, 50), (8, 80), (20, 95), (50, 95), (90, 80), (95, 50), (80, 8), (10, 20))
    )
    return Surface(lambda _, north_m: grade * north_m, vehicle, exact_s, pairs)


def ridge() -> Surface:
    """Return a roof with its crest along a border of columns.

    Heights of a raster are level between the centres beside it, and the planner takes them as linear from border to
    border, so the two cells there have half the slope.
    """
    slope, vehicle = 0.4, changed(**STEADY)
    crest_m, stretch, top = SIDE / 2 * CELL_M, math.hypot(1, slope), math.hypot(1, slope / 2)

    def exact_s(start: Position, goal: Position) -> float:
        slopes_m = abs(start.x_m - crest_m) + abs(goal.x_m - crest_m) - 2 * CELL_M
        across_m = slopes_m * stretch + 2 * CELL_M * top
        return math.hypot(across_m, start.y_m - goal.y_m) / vehicle.max_speed_mps

    pairs = (((10, 5), (90, 95)), ((5, 40), (95, 60)), ((50, 10), (20, 90)), ((30, 20), (34, 80)), ((3, 45), (96, 57)))
    return Surface(lambda east_m, _: 500 - slope * np.abs(east_m - crest_m), vehicle, exact_s, pairs)


def cone() -> Surface:
    """Return a cone, which unfolds to a sector of a disc."""
    slope, vehicle = 0.4, changed(**STEADY)
    middle_m, stretch = SIDE / 2 * CELL_M, math.hypot(1, slope)

    def exact_s(start: Position, goal: Position) -> float:
        (r, a), (s, b) = (
            (math.hypot(p.x_m - middle_m, p.y_m - middle_m), math.atan2(p.y_m - middle_m, p.x_m - middle_m))
            for p in (start, goal)
        )
        apart = abs(math.remainder(a - b, 2 * math.pi)) / stretch
        chord_m = stretch * math.sqrt(r * r + s * s - 2 * r * s * math.cos(apart))
        return chord_m / vehicle.max_speed_mps

    def height_m(east_m: NDArray[np.float64], north_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return 500 - slope * np.hypot(east_m - middle_m, north_m - middle_m)

    pairs = (((90, 10), (90, 90)), ((20, 10), (60, 95)), ((10, 40), (60, 90)), ((70, 5), (95, 50)), ((5, 20), (20, 95)))
    return Surface(height_m, vehicle, exact_s, pairs)


def surfaces() -> dict[str, Surface]:
    """Return the surfaces by their names in the table."""
    free = {"sight_distance_m": 1e4, "grade_up": 0.45, "grade_down": 0.45, "side_slope": 0.45}
    return {
        "plane, directed cost": plane(0.2, changed(**free)),
        "plane too steep straight up": plane(0.2, changed(**{**free, "grade_up": 0.15})),
        "ridge, unfolded": ridge(),
        "cone, unfolded": cone(),
    }


def region(surface: Surface) -> Region:
    """Return the surface as a raster."""
    row, column = np.mgrid[0:SIDE, 0:SIDE]
    heights = surface.height_m((column + 0.5) * CELL_M, (SIDE - row - 0.5) * CELL_M)
    return Region(GEOMETRY, heights.astype(np.float32), surface.vehicle)


def route_rows() -> list[Row]:
    """Return the relative errors of a vehicle's routes, surface by surface."""
    rows: list[Row] = []
    for name, surface in surfaces().items():
        ground = region(surface)
        errors: dict[str, list[float]] = {column: [] for column in ROUTE_COLUMNS}
        for ends in surface.pairs:
            start, goal = (Position((column + 0.5) * CELL_M, (SIDE - row - 0.5) * CELL_M) for row, column in ends)
            exact_s = surface.exact_s(start, goal)
            found: list[float] = []
            for path in ("grid8", "grid16", "any-angle"):
                plan = planner.plan(ground, start, goal, method="exact", path=path)
                if plan.route is None or plan.path_cost is None:
                    raise RuntimeError(plan.reason)
                found += [plan.path_cost, plan.route.cost] if path == "grid16" else [plan.route.cost]
            for column, cost in zip(ROUTE_COLUMNS, found, strict=True):
                errors[column].append(cost / exact_s - 1)
        rows.append((name, len(surface.pairs), errors))
    return rows


def percent(error: float) -> str:
    """Return an error in per cent; what rounds to nothing has no sign."""
    text = f"{100 * error:.3f}"
    return "0.000" if float(text) == 0 else text


def table(columns: tuple[str, ...], rows: list[Row]) -> str:
    """Return a table: mean and greatest error of each column, and the least of any-angle."""
    lines = [
        "| world | pairs | " + " | ".join(columns) + " | any angle, least |",
        "| --- | ---: |" + " ---: |" * (len(columns) + 1),
    ]
    for name, count, errors in rows:
        cells = [f"{percent(float(np.mean(errors[c])))} / {percent(max(errors[c]))}" for c in columns]
        least = percent(min(errors.get("any angle") or errors["any-angle"]))
        lines.append(f"| {name} | {count} | " + " | ".join(cells) + f" | {least} |")
    return "\n".join(lines)


def tables() -> dict[str, str]:
    """Return the tables of the page by the names of their marks."""
    return {"cells": table(CELL_COLUMNS, cell_rows()), "routes": table(ROUTE_COLUMNS, route_rows())}


def marked(name: str, text: str) -> str:
    """Return a table between its marks, as it stands in the page."""
    return f"<!-- {name} -->\n\n{text}\n\n<!-- end of {name} -->"


def write_page() -> None:
    """Put the tables into the page."""
    page = PAGE.read_text(encoding="utf-8")
    for name, text in tables().items():
        before, rest = page.split(f"<!-- {name} -->")
        _, after = rest.split(f"<!-- end of {name} -->")
        page = before + marked(name, text) + after
    PAGE.write_text(page, encoding="utf-8")


def draw() -> None:
    """Draw the paths of three kinds through three worlds."""
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    mpl.use("Agg")
    worlds = [
        ("Blocks", list(blocks())[1]),
        ("Two media", list(two_media())[5]),
        ("Speed growing to the right", next(growing_speed())),
    ]
    figure, axes = plt.subplots(1, 3, figsize=(12, 5.4), layout="constrained")
    for axis, (title, (costs, start, goal, exact)) in zip(axes, worlds, strict=True):
        axis.imshow(np.where(np.isfinite(costs), costs, np.nan), cmap="Greys", vmin=0, vmax=5, interpolation="nearest")
        axis.imshow(np.where(np.isfinite(costs), np.nan, 1.0), cmap="copper", interpolation="nearest")
        field = planner.eikonal_field(costs, start)
        axis.contour(np.where(np.isfinite(field), field, np.nan), levels=14, colors="#7a9cc6", linewidths=0.6)
        for label, colour, path in (
            ("8 neighbours", "#d95f02", planner.shortest_path(costs, start, goal)),
            ("16 neighbours", "#7570b3", planner.shortest_path(costs, start, goal, neighbours=16)),
            ("any angle", "#1b9e77", planner.any_angle_path(costs, start, goal)),
        ):
            error = f"{100 * (cost_of(path) / exact - 1):+.2f}"
            vertices = path.points if isinstance(path, planner.AnyAnglePath) else getattr(path, "cells", [])
            points = np.asarray(vertices, dtype=float)
            axis.plot(points[:, 1], points[:, 0], color=colour, linewidth=2, label=f"{label}: {error} %")
        axis.set(title=title, xticks=[], yticks=[])
        axis.legend(title="error of the cost", loc="upper center", bbox_to_anchor=(0.5, -0.02), fontsize=8)
    figure.savefig(PICTURE, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    write_page()
    draw()
    print(f"{PAGE}\n{PICTURE}")
