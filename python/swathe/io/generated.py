"""Terrain that is made by rule: ``bundled:heath``, ``bundled:paper`` and ``bundled:fields``, for drives without files.

No such places exist. Heights are sums of smooth noise that depends on nothing but a cell's row and column, so that
every machine makes the same map; soil follows from the heights by the rule beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from swathe.io.noise import hashed, smooth_noise
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a map is made.

    ``waves`` are lengths in metres and the height in metres that each adds; ``gully_m`` is the depth of a winding gully
    from the north edge to three quarters of the way south, 0 for none; ``first`` moves the noise to another place.
    ``parcels_m`` is the width of parcels whose soil has nothing to do with the heights; 0 lets it follow from them.
    """

    cells: int
    cell_size_m: float
    waves: tuple[tuple[float, float], ...]
    gully_m: float
    first: int
    parcels_m: float = 0.0


GENERATED = {
    # A rolling heath, 320 m wide, with a gully that a small robot must go around.
    "heath": Recipe(320, 1.0, ((130.0, 7.0), (48.0, 2.4), (14.0, 0.25)), 2.5, 0),
    # A ground like the paper's: 128 m of hills, fine enough for groups of 8 x 8 pixels.
    "paper": Recipe(512, 0.25, ((60.0, 5.0), (22.0, 1.5)), 0.0, 40_000),
    # Gentle farmland, 320 m wide, with a soil survey of parcels of gravel, sand and silt.
    "fields": Recipe(320, 1.0, ((130.0, 4.0), (48.0, 1.0)), 0.0, 80_000, 42.0),
}
#: Soils of parcels and their shares.
_PARCELS = ((SoilClass.GRAVEL, 0.25), (SoilClass.SAND, 0.40), (SoilClass.SILT, 0.35))
_GULLY_HALF_WIDTH_M = 5.0
_BASE_M = 100.0


@cache
def generated_elevation(name: str) -> NDArray[np.float32]:
    """Return the heights of a generated map in metres."""
    recipe = GENERATED[name]
    shape = (recipe.cells, recipe.cells)
    heights_m = np.full(shape, _BASE_M)
    for turn, (length_m, height_m) in enumerate(recipe.waves):
        heights_m += height_m * smooth_noise(shape, length_m / recipe.cell_size_m, recipe.first + 1000 * turn)
    if recipe.gully_m > 0:
        heights_m -= recipe.gully_m * _gully(recipe)
    found = heights_m.astype(np.float32)
    found.setflags(write=False)
    return found


@cache
def generated_soil(name: str) -> NDArray[np.uint8]:
    """Return the soil class code of every cell of a generated map.

    Sand everywhere, silt where the ground lies low, clay in the lowest places, gravel on the heights, and a few patches
    of rock. With parcels, gravel, sand and silt by parcel.
    """
    recipe = GENERATED[name]
    if recipe.parcels_m > 0:
        return _parcels(recipe)
    heights_m = generated_elevation(name).astype(np.float64)
    shape = heights_m.shape
    noise = smooth_noise(shape, 18.0 / recipe.cell_size_m, recipe.first + 7000)
    span = np.quantile(heights_m, [0.06, 0.22, 0.80])
    wobble_m = 0.25 * (span[2] - span[1]) * noise
    soil = np.full(shape, SoilClass.SAND, dtype=np.uint8)
    soil[heights_m + wobble_m > span[2]] = SoilClass.GRAVEL
    soil[heights_m + wobble_m < span[1]] = SoilClass.SILT
    soil[heights_m + wobble_m < span[0]] = SoilClass.CLAY
    soil[smooth_noise(shape, 26.0 / recipe.cell_size_m, recipe.first + 9000) > 0.72] = SoilClass.ROCK
    soil.setflags(write=False)
    return soil


def _parcels(recipe: Recipe) -> NDArray[np.uint8]:
    """Return the soil of parcels: the cells nearest to each point of a lattice whose points are moved by chance."""
    side = int(np.ceil(recipe.cells * recipe.cell_size_m / recipe.parcels_m)) + 2
    lattice = np.arange(side, dtype=np.uint64) + np.uint64(recipe.first)
    shifted = [
        (np.indices((side, side))[axis] - 0.5 + 0.4 * hashed(lattice, lattice + np.uint64(1000 * (axis + 1)))).ravel()
        for axis in (0, 1)
    ]
    share = np.cumsum([part for _, part in _PARCELS])
    drawn = 0.5 + 0.5 * hashed(lattice, lattice + np.uint64(3000)).ravel()
    codes = np.array([soil for soil, _ in _PARCELS], dtype=np.uint8)[np.minimum(np.searchsorted(share, drawn), 2)]
    middles = (np.arange(recipe.cells) + 0.5) * recipe.cell_size_m / recipe.parcels_m
    points = np.column_stack(shifted)
    places = np.stack(np.meshgrid(middles, middles, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = ((places[:, None, :] - points[None, :, :]) ** 2).sum(axis=2).argmin(axis=1)
    soil: NDArray[np.uint8] = codes[nearest].reshape(recipe.cells, recipe.cells)
    soil.setflags(write=False)
    return soil


def _gully(recipe: Recipe) -> NDArray[np.float64]:
    """Return the share 0..1 of the gully's depth at every cell."""
    along_m = (np.arange(recipe.cells) + 0.5) * recipe.cell_size_m
    side_m = recipe.cells * recipe.cell_size_m
    middle_m = 0.5 * side_m + 14.0 * smooth_noise((recipe.cells, 1), 70.0 / recipe.cell_size_m, recipe.first + 5000)
    away_m = np.abs(along_m[None, :] - middle_m)
    across = np.clip(1.0 - away_m / _GULLY_HALF_WIDTH_M, 0.0, 1.0)
    ends = np.clip((0.75 * side_m - along_m) / 20.0, 0.0, 1.0)
    share: NDArray[np.float64] = across * across * (3 - 2 * across) * ends[:, None]
    return share
