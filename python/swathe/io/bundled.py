"""Terrain that needs no files: ``bundled:jacksboro``, 30 km of ridges and valleys around Jacksboro, Tennessee.

The elevation is the USGS model of the Jacksboro fault that the matplotlib wheel carries (344 x 403 cells of 3
arc-seconds). The file gives its north and south edges with their names swapped; row 0 is the north edge. Nobody has
mapped the soil of it for us: the soil is generated from the elevation by the rule in ``generate_soil`` and says so.
Two more maps (``generated``) are made by rule altogether.
"""

from __future__ import annotations

import hashlib
import importlib.util
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from affine import Affine

from swathe.errors import MissingFileError
from swathe.io.crs import WGS84, crs_from_wkt
from swathe.io.generated import GENERATED, generated_elevation, generated_soil
from swathe.io.noise import smooth_noise
from swathe.io.sources import BUNDLED_PREFIX, Source
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from numpy.typing import NDArray

BUNDLED = {"jacksboro": "jacksboro_fault_dem.npz"}
# Three arc-seconds are 93 m north-south and 74 m east-west here; the map keeps the longer side.
DEFAULT_CELL_SIZE_M = 90.0

# The rule for the generated soil, tuned to look like a soil survey of ridge and valley country.
POSITION_RADIUS_M = 900.0  # neighbourhood that says whether a place lies low or high
CONVEXITY_RADIUS_M = 200.0
CLAY_BELOW_M, CLAY_GRADE = -19.0, 0.15
SILT_BELOW_M, SILT_GRADE = 8.0, 0.24
ROCK_ABOVE_M, ROCK_GRADE = 2.0, 0.10
GRAVEL_GRADE = 0.28
NOISE_WAVELENGTHS_M = (1500.0, 600.0)
NOISE_POSITION_M = 8.0  # how far noise moves the limits of low and high
NOISE_GRADE = 0.08  # how far it moves the limits of grade
TIDY_PASSES = 2


def bundled_name(source: str) -> str:
    """Return the name behind ``bundled:``. Raises MissingFileError when there is no such terrain."""
    name = source.removeprefix(BUNDLED_PREFIX)
    if name not in BUNDLED and name not in GENERATED:
        raise MissingFileError(
            f"There is no bundled terrain called {name!r}.",
            f"Use {', '.join(BUNDLED_PREFIX + known for known in (*BUNDLED, *GENERATED))}.",
        )
    return name


def bundled_fingerprint(source: Source) -> str:
    """Return the SHA-256 of the file behind a bundled name, or of the heights where there is none."""
    name = bundled_name(source.path)
    if name in GENERATED:
        return hashlib.sha256(generated_elevation(name).tobytes()).hexdigest()
    return Source(source.name, str(_stored(source))).fingerprint()


def default_cell_size_m(source: Source) -> float:
    """Return the size of the cells when nobody asks for another."""
    name = bundled_name(source.path)
    return GENERATED[name].cell_size_m if name in GENERATED else DEFAULT_CELL_SIZE_M


def _stored(source: Source) -> Path:
    """Return the file behind a bundled name. Raises MissingFileError when it is not installed."""
    name = bundled_name(source.path)
    # Looked up, not imported: matplotlib takes half a second that reading a file does not need.
    spec = importlib.util.find_spec("matplotlib")
    if spec is None or spec.origin is None:
        raise MissingFileError(f"{source.name} comes with matplotlib, which is not installed.", "Install matplotlib.")
    path = Path(spec.origin).parent / "mpl-data" / "sample_data" / BUNDLED[name]
    if not path.is_file():
        raise MissingFileError(
            f"{source.name} is not in the installed matplotlib.", "Install matplotlib from its wheel."
        )
    return path


class ArrayTile:
    """A tile whose heights are in memory."""

    is_picture = False

    def __init__(self, source: Source, heights_m: NDArray[np.float32], transform: Affine, crs_wkt: str | None) -> None:
        self.source = source
        self.rows, self.columns = heights_m.shape
        self.transform = transform
        self.crs_wkt = crs_wkt
        self._heights_m = heights_m

    def read(self, row: int, column: int, rows: int, columns: int) -> NDArray[np.float32]:
        """Return the heights of a block that lies inside, metres."""
        return self._heights_m[row : row + rows, column : column + columns].copy()


def bundled_elevation(source: Source) -> ArrayTile:
    """Return the elevation of a bundled terrain, in degrees (WGS 84) or in a frame of its own.

    Raises MissingFileError when there is none of that name.
    """
    name = bundled_name(source.path)
    if name in GENERATED:
        return ArrayTile(source, generated_elevation(name), _own_transform(name), None)
    with np.load(_stored(source)) as stored:
        heights_m = stored["elevation"].astype(np.float32)
        west = float(stored["xmin"])
        north = max(float(stored["ymin"]), float(stored["ymax"]))
        transform = Affine(float(stored["dx"]), 0.0, west, 0.0, -float(stored["dy"]), north)
    return ArrayTile(source, heights_m, transform, crs_from_wkt(WGS84).to_wkt())


def generate_soil(elevation_m: NDArray[np.float32], cell_size_m: float) -> NDArray[np.uint8]:
    """Return a plausible soil class code for every cell of an elevation (unknown where that is unknown).

    Valley floors hold silt, and clay nearest the valley line; flanks sand, and gravel where they steepen; steep convex
    ground is rock. Smooth noise that depends on nothing but the cell's row and column keeps the limits from following
    contour lines. No survey stands behind it.
    """
    known = ~np.isnan(elevation_m)
    height_m = _box_mean(elevation_m.astype(np.float64), known, 1)
    position_m = height_m - _box_mean(elevation_m.astype(np.float64), known, _cells(POSITION_RADIUS_M, cell_size_m))
    convexity_m = height_m - _box_mean(elevation_m.astype(np.float64), known, _cells(CONVEXITY_RADIUS_M, cell_size_m))
    north, east = np.gradient(np.where(np.isnan(height_m), 0.0, height_m), cell_size_m)
    grade = np.hypot(north, east)
    noise = np.mean([smooth_noise(elevation_m.shape, length / cell_size_m) for length in NOISE_WAVELENGTHS_M], axis=0)
    low_m = position_m + NOISE_POSITION_M * noise
    steep = grade + NOISE_GRADE * noise

    soil = np.full(elevation_m.shape, SoilClass.SAND, dtype=np.uint8)
    soil[steep > GRAVEL_GRADE] = SoilClass.GRAVEL
    soil[(convexity_m > ROCK_ABOVE_M) & (steep > ROCK_GRADE)] = SoilClass.ROCK
    soil[(low_m < SILT_BELOW_M) & (grade < SILT_GRADE)] = SoilClass.SILT
    soil[(low_m < CLAY_BELOW_M) & (grade < CLAY_GRADE)] = SoilClass.CLAY
    for _ in range(TIDY_PASSES):
        soil = _majority(soil)
    soil[~known] = SoilClass.UNKNOWN
    return soil


@cache
def bundled_soil(source: str) -> tuple[NDArray[np.uint8], Affine, str | None]:
    """Return generated soil codes of a bundled terrain, where their cells lie, and in which system (WKT), if any.

    It is made once on the terrain's default lattice, so that soil does not depend on the window or cell size asked for.
    """
    from swathe.io.elevation import open_elevation

    name = bundled_name(source)
    if name in GENERATED:
        return generated_soil(name), _own_transform(name), None
    with open_elevation([source]) as elevation:
        geometry = elevation.frame.geometry
        soil = generate_soil(elevation.read(), geometry.cell_size_m)
    transform = Affine(geometry.cell_size_m, 0, geometry.west_m, 0, -geometry.cell_size_m, geometry.north_m)
    soil.setflags(write=False)
    return soil, transform, str(elevation.frame.crs_wkt)


def _own_transform(name: str) -> Affine:
    recipe = GENERATED[name]
    return Affine(recipe.cell_size_m, 0, 0, 0, -recipe.cell_size_m, recipe.cells * recipe.cell_size_m)


def _cells(length_m: float, cell_size_m: float) -> int:
    return max(1, round(length_m / cell_size_m))


def _box_mean(values: NDArray[np.float64], known: NDArray[np.bool_], radius: int) -> NDArray[np.float64]:
    """Return the mean of the known cells of a square around every cell; NaN where there are none."""
    total = _box_sum(np.where(known, values, 0.0), radius)
    count = _box_sum(known.astype(np.float64), radius)
    mean: NDArray[np.float64] = np.divide(total, count, out=np.full(values.shape, np.nan), where=count > 0.5)
    return mean


def _box_sum(values: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """Return the sum of a square of ``2 radius + 1`` cells around every cell; beyond the edge is 0."""
    for axis in (0, 1):
        width = [(0, 0), (0, 0)]
        width[axis] = (radius + 1, radius)
        summed = np.cumsum(np.pad(values, width), axis=axis)
        length = summed.shape[axis]
        span = 2 * radius + 1
        high = np.take(summed, range(span, length), axis=axis)
        values = high - np.take(summed, range(length - span), axis=axis)
    return values


def _majority(soil: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the class that most of the 3 x 3 cells around have; the cell's own decides a tie."""
    counts = np.stack([_box_sum((soil == code).astype(np.float64), 1) + 0.5 * (soil == code) for code in SoilClass])
    winner: NDArray[np.uint8] = np.argmax(counts, axis=0).astype(np.uint8)
    return winner
