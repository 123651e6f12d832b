"""Worlds that tests draw or make: maps as text, smooth hills, and regions of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swathe.grid import Cell, GridGeometry
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
    return np.array([list(row) for row in rows]) == "#"


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
