"""The paper's table: a row for every group of 8 x 8 cells, with its grey level, height and soil.

It is made in bands, so that memory stays flat; what is in it is what ``swathe.terrain`` makes of the whole map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import AllVoidError
from swathe.grid import GridGeometry, Window
from swathe.store.interface import ELEVATION, SOIL
from swathe.store.soil import soil_of_frame
from swathe.terrain import block_max, group_mean, height_map, slope

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from swathe.io.soil import SoilLayer
    from swathe.store.interface import RegionInfo, TerrainStore

#: The paper averages groups of 8 x 8 pixels.
GROUP = 8
_CELLS_PER_BAND = 4_000_000


@dataclass(frozen=True, eq=False)
class CellTable:
    """The table as layers of its groups.

    Attributes:
        geometry: where the groups lie; incomplete ones at the south and east edge are left out.
        height: mean grey levels, 0 (lowest of the region) to 255 (highest), NaN unknown.
        elevation_m: mean heights, NaN unknown.
        steepest_grade: greatest slope inside each group, rise over run.
        soil: soil codes with their report; None without a soil map.
    """

    geometry: GridGeometry
    height: NDArray[np.float32]
    elevation_m: NDArray[np.float32]
    steepest_grade: NDArray[np.float32]
    soil: SoilLayer | None


def make_table(store: TerrainStore, info: RegionInfo) -> CellTable | None:
    """Return the table of a region, worked out from its layers; None when it is smaller than one group.

    Raises:
        AllVoidError: no height is known.
    """
    whole = info.frame.geometry
    rows, columns = whole.rows // GROUP, whole.columns // GROUP
    if min(rows, columns) < 1:
        return None

    def read(top: int, bottom: int) -> NDArray[np.float32]:
        return store.read_window(info.name, ELEVATION, Window(top, 0, bottom - top, whole.columns))

    step = max(1, _CELLS_PER_BAND // (GROUP * whole.columns)) * GROUP
    bands = [(top, min(top + step, whole.rows)) for top in range(0, whole.rows, step)]
    given = info.layers[ELEVATION].details.get("height_range_m")
    grey_range = _known_range(read, bands) if given is None else (float(given[0]), float(given[1]))
    geometry = GridGeometry(rows, columns, whole.cell_size_m * GROUP, whole.west_m, whole.north_m)
    height, elevation_m, steepest_grade = (np.empty((rows, columns), np.float32) for _ in range(3))
    for top, bottom in bands:
        last = min(bottom // GROUP, rows)
        if top // GROUP < last:
            # A row more on either side, for the slope.
            first, end = max(0, top - 1), min(whole.rows, bottom + 1)
            around = read(first, end)
            band = np.ascontiguousarray(around[top - first : bottom - first])
            part = slice(top // GROUP, last)
            height[part] = group_mean(_levels(band, grey_range))
            elevation_m[part] = group_mean(band)
            steep = slope(around, whole.cell_size_m)[top - first : bottom - first]
            steepest_grade[part] = block_max(np.ascontiguousarray(steep))
    soil = None
    if SOIL in info.layers:
        soil = soil_of_frame(store, info, replace(info.frame, geometry=geometry))
    return CellTable(geometry, height, elevation_m, steepest_grade, soil)


def _known_range(read: Callable[[int, int], NDArray[np.float32]], bands: list[tuple[int, int]]) -> tuple[float, float]:
    low, high = np.inf, -np.inf
    for top, bottom in bands:
        band = read(top, bottom)
        known = band[np.isfinite(band)]
        if known.size:
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    if low > high:
        raise AllVoidError("The region holds no known elevation.", "Import another file.")
    return low, high


def _levels(band: NDArray[np.float32], grey_range: tuple[float, float]) -> NDArray[np.float32]:
    if grey_range[0] < grey_range[1]:
        if np.isnan(band).all():
            return band
        return height_map(band, grey_range)
    # A level plain is black.
    return np.where(np.isfinite(band), np.float32(0), np.float32(np.nan))
