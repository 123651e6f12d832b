"""What a plan found, filed in the store that its ground came from: route, and ranks and nests for its vehicle."""

from __future__ import annotations

import uuid
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from swathe.store.interface import TILE_SIZE, Provenance, StoredRoute

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from swathe.grid import Window
    from swathe.io.crs import Frame
    from swathe.store.interface import TerrainStore

#: What of a summary makes two maps of ranks the same.
_MAKES_RANKS = ("version", "vehicle_figures", "rank_params", "method", "seed")


def keep_route(
    store: TerrainStore, region: str, xy_m: NDArray[np.float64], summary: Mapping[str, Any], author: str
) -> str:
    """File a route of at least two vertices with the summary of its plan, and return its id."""
    told = {key: value for key, value in summary.items() if key not in {"outputs", "timings_s"}}
    route = StoredRoute(
        uuid.uuid4().hex, shapely.to_wkb(shapely.LineString(xy_m)), str(summary["vehicle"]), told, author
    )
    store.add_route(region, route)
    return route.id


def keep_map(
    store: TerrainStore,
    region: str,
    frame: Frame,
    what: str,
    codes: NDArray[Any],
    *,
    summary: Mapping[str, Any],
    author: str,
) -> bool:
    """File a map of ranks or nests on the cells of ``frame`` as the layer "WHAT of VEHICLE"; False if not possible.

    It is not when the cells of the frame are not those of the region. Cells outside the frame are 0, unknown.
    """
    window = _window(store.region(region).frame, frame)
    if window is None:
        return False
    made = repr([summary[key] for key in _MAKES_RANKS])
    inputs = tuple((str(entry["name"]), str(entry["sha256"])) for entry in summary["inputs"])
    options = {"made": made, "window": repr(tuple(window))}
    provenance = Provenance(inputs, author=author, options=options)
    details = {"vehicle": summary["vehicle"], "rank_params": summary["rank_params"], "window": list(window)}
    layer = f"{what} of {summary['vehicle']}"
    with store.begin_import(region, layer, provenance, dtype=codes.dtype, details=details) as session:
        if not session.is_current:
            tops = range(window.row // TILE_SIZE, -(-(window.row + window.rows) // TILE_SIZE))
            lefts = range(window.column // TILE_SIZE, -(-(window.column + window.columns) // TILE_SIZE))
            for top in tops:
                for left in lefts:
                    session.write_tile(top, left, _tile(codes, window, top * TILE_SIZE, left * TILE_SIZE))
        session.commit()
    return True


def _window(whole: Frame, part: Frame) -> Window | None:
    """Return where a frame lies on the lattice of another, or None when its cells are not those."""
    from swathe.grid import Window

    one, other = whole.geometry, part.geometry
    if one.cell_size_m != other.cell_size_m:
        return None
    row = round((one.north_m - other.north_m) / one.cell_size_m)
    column = round((other.west_m - one.west_m) / one.cell_size_m)
    return Window(row, column, other.rows, other.columns)


def _tile(codes: NDArray[Any], window: Window, top: int, left: int) -> NDArray[Any]:
    """Return the whole tile that begins at a row and column of the region."""
    tile = np.zeros((TILE_SIZE, TILE_SIZE), dtype=codes.dtype)
    row, column = max(top, window.row), max(left, window.column)
    bottom, right = (
        min(top + TILE_SIZE, window.row + window.rows),
        min(left + TILE_SIZE, window.column + window.columns),
    )
    tile[row - top : bottom - top, column - left : right - left] = codes[
        row - window.row : bottom - window.row, column - window.column : right - window.column
    ]
    return tile
