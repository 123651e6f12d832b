"""Worlds that tests draw or make: maps as text, smooth hills, and regions of them."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.ndimage
import scipy.sparse

from swathe.grid import Cell, GridGeometry, Position
from swathe.planner import Route, plan
from swathe.rank import RankParams, Region
from swathe.vehicle import Vehicle, load_vehicle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class World(NamedTuple):
    """Costs per metre with a start and a goal."""

    costs: NDArray[np.float64]
    start: Cell
    goal: Cell


def drawn(rows: Sequence[str]) -> World:
    """Read a world from text: ``#`` closed, a digit its cost per metre, ``.``, ``s`` and ``g`` cost 1."""
    letters = np.array([list(row) for row in rows])
    costs = np.ones(letters.shape)
    costs[letters == "#"] = np.inf
    digits = np.char.isdigit(letters)
    costs[digits] = letters[digits].astype(float)

    def place(letter: str) -> Cell:
        row, column = np.argwhere(letters == letter)[0]
        return Cell(int(row), int(column))

    return World(costs, place("s"), place("g"))


def mask(rows: Sequence[str]) -> NDArray[np.bool_]:
    """Read a mask from text: ``#`` is True."""
    return np.asarray(np.array([list(row) for row in rows]) == "#", dtype=np.bool_)


def smooth_hills(
    seed: int, rows: int, columns: int, *, height_m: float, cell_size_m: float, wave_m: float
) -> NDArray[np.float32]:
    """Return smooth random heights in float32: six waves of about ``wave_m``, together up to ``height_m`` high."""
    draw = np.random.default_rng(seed)
    row, column = np.mgrid[0:rows, 0:columns] * cell_size_m
    heights = np.zeros((rows, columns))
    for _ in range(6):
        angle, phase = draw.uniform(0, 2 * np.pi, 2)
        length_m = wave_m * draw.uniform(0.7, 1.6)
        heights += np.sin(2 * np.pi * (row * np.sin(angle) + column * np.cos(angle)) / length_m + phase)
    return np.asarray(500 + height_m * heights / 6, dtype=np.float32)


def changed(vehicle: Vehicle, **figures: Any) -> Vehicle:
    """Return a vehicle with other figures."""
    return Vehicle(**{**vehicle.model_dump(), **figures})


def region_of(
    heights_m: NDArray[np.float32],
    cell_size_m: float,
    *,
    vehicle: Vehicle | str = "tractor",
    soil: NDArray[np.uint8] | None = None,
    zones: NDArray[np.bool_] | None = None,
    grey: NDArray[np.float32] | None = None,
    params: RankParams | None = None,
) -> Region:
    """Return a region whose north-west corner lies at (1000, 9000) metres."""
    rows, columns = heights_m.shape
    machine = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    geometry = GridGeometry(rows, columns, cell_size_m, 1000.0, 9000.0)
    return Region(geometry, heights_m, machine, soil, grey, zones, params or RankParams())


def region_of_mask(suitable: NDArray[np.bool_], cell_size_m: float = 10.0) -> Region:
    """Return level ground that is closed by zones where the mask is False."""
    return region_of(np.full(suitable.shape, 100.0, dtype=np.float32), cell_size_m, zones=~suitable)


LEVEL_CENTRE = GridGeometry(30, 40, 10.0, 1000.0, 9000.0).position_of
WEST_SIDE, EAST_SIDE = LEVEL_CENTRE(Cell(15, 5)), LEVEL_CENTRE(Cell(15, 34))


def flat_region(**layers: Any) -> Region:
    """Return 30 x 40 level cells of 10 m with the layers given."""
    elevation = layers.pop("elevation", np.zeros((30, 40), dtype=np.float32))
    return region_of(elevation, 10.0, **layers)


def closed_zone(rows: slice, columns: slice) -> NDArray[np.bool_]:
    """Return the zones of a flat region with one block closed."""
    zones = np.zeros((30, 40), dtype=np.bool_)
    zones[rows, columns] = True
    return zones


def steps_of(neighbours: int) -> list[tuple[int, int]]:
    near = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if (row, column) != (0, 0)]
    knights = [(r, c) for r in (-2, -1, 1, 2) for c in (-2, -1, 1, 2) if abs(r) != abs(c)]
    return near + (knights if neighbours == 16 else [])


@cache
def crossed(step: tuple[int, int]) -> dict[tuple[int, int], float]:
    """Return the cells that a step crosses with their share of its length, by sampling it."""
    middles = (np.arange(4000) + 0.5) / 4000
    cells, counts = np.unique(np.floor(np.outer(middles, step) + 0.5).astype(int), axis=0, return_counts=True)
    return {(int(row), int(column)): count / 4000 for (row, column), count in zip(cells, counts, strict=True)}


def graph_of(costs: NDArray[np.float64], cell_size_m: float, neighbours: int, corners: str) -> scipy.sparse.csr_array:
    """Return the directed graph that shortest_path documents, built step by step over the whole grid."""
    rows, columns = costs.shape
    closed = np.where(np.isfinite(costs), costs, np.inf)
    padded = np.pad(closed, 2, constant_values=np.inf)

    def shifted(row: int, column: int) -> NDArray[np.float64]:
        return padded[2 + row : 2 + row + rows, 2 + column : 2 + column + columns]

    number = np.arange(rows * columns).reshape(rows, columns)
    sources, targets, weights = [], [], []
    for step in steps_of(neighbours):
        metres = cell_size_m * math.hypot(*step)
        mean = sum(share * shifted(*cell) for cell, share in crossed(step).items())
        if corners == "keep" and abs(step[0]) == abs(step[1]) == 1:
            mean = np.where(np.isinf(shifted(step[0], 0) + shifted(0, step[1])), np.inf, mean)
        weight = metres * np.asarray(mean)
        open_edges = np.isfinite(weight)
        sources.append(number[open_edges])
        targets.append(number[open_edges] + step[0] * columns + step[1])
        weights.append(weight[open_edges])
    ends = (np.concatenate(sources), np.concatenate(targets))
    return scipy.sparse.csr_array((np.concatenate(weights), ends), shape=(costs.size, costs.size))


def random_world(seed: int, rows: int, columns: int) -> World:
    """Draw costs of 0 to 9 with closed cells of every kind, start and goal open."""
    draw = np.random.default_rng(seed)
    costs = draw.uniform(0.2, 9, (rows, columns))
    kind = draw.random((rows, columns))
    costs[kind < 0.12] = np.nan
    costs[(kind >= 0.12) & (kind < 0.24)] = np.inf
    costs[(kind >= 0.24) & (kind < 0.27)] = 0.0
    ends = [Cell(int(draw.integers(rows)), int(draw.integers(columns))) for _ in range(2)]
    for end in ends:
        costs[end] = 1.5
    return World(costs, *ends)


HILL_CELL_M = 30.0


def steep_hills(seed: int) -> Region:
    """Return smooth hills of which about a third is too steep for the tractor."""
    return region_of(smooth_hills(seed, 70, 90, height_m=190, cell_size_m=HILL_CELL_M, wave_m=1400), HILL_CELL_M)


def ends_of(region: Region, seed: int) -> tuple[Position, Position]:
    """Draw two cell centres far apart in the largest nest."""
    answer = plan(region, *[region.geometry.position_of(Cell(0, 0))] * 2, method="exact")
    assert answer.nests is not None
    cells = np.argwhere(answer.nests.labels == 1 + int(np.argmax(answer.nests.sizes)))
    draw = np.random.default_rng(seed)
    pairs = [cells[draw.integers(len(cells), size=2)] for _ in range(50)]
    a, b = max(pairs, key=lambda pair: math.dist(*pair))
    return region.geometry.position_of(Cell(*map(int, a))), region.geometry.position_of(Cell(*map(int, b)))


class Driven:
    """A region with a planned route on it."""

    def __init__(self, seed: int, **options: Any) -> None:
        self.region = steep_hills(seed)
        self.start, self.goal = ends_of(self.region, seed)
        self.answer = plan(self.region, self.start, self.goal, **options)

    @property
    def route(self) -> Route:
        assert self.answer.route is not None, self.answer.reason
        return self.answer.route

    def heights_m(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the heights at map positions, bilinear between the centres of cells."""
        geometry = self.region.geometry
        row = (geometry.north_m - xy_m[..., 1]) / geometry.cell_size_m - 0.5
        column = (xy_m[..., 0] - geometry.west_m) / geometry.cell_size_m - 0.5
        heights: NDArray[np.float64] = scipy.ndimage.map_coordinates(
            self.region.elevation_m.astype(np.float64), [row, column], order=1, mode="nearest"
        )
        return heights


def grades_along(driven: Driven, start: Position, end: Position) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the grades along and across a straight line at every tenth of a cell."""
    run_m = math.dist(start, end)
    share = np.linspace(0, 1, max(2, math.ceil(run_m / HILL_CELL_M * 10)) + 1)
    line = np.asarray(start) + share[:, None] * np.subtract(end, start)
    along = np.diff(driven.heights_m(line)) / (run_m / (len(share) - 1))
    left = np.asarray([start.y_m - end.y_m, end.x_m - start.x_m]) / run_m * HILL_CELL_M / 2
    across = (driven.heights_m(line + left) - driven.heights_m(line - left)) / HILL_CELL_M
    return along, across
