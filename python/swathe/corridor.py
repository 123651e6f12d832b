"""The arc from start to goal and the swathe of cells around it, in which everything after happens."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swathe.grid import GridGeometry


@dataclass(frozen=True, slots=True)
class CorridorParams:
    """How the arc is laid and how wide the swathe is.

    Attributes:
        arc: ``relaid`` (the cheapest way over what is known so far, laid anew whenever more is known; there is no fixed
            swathe), ``spine`` (a search on eight times coarser cells), ``circle`` (the paper's arc) or ``line``.
        sagitta_m: height of the circle over its chord, positive to the left; a tenth of the distance when None.
        width_m: width of the swathe; a quarter of the distance, at least 20 cells, when None; doubled whenever start
            and goal do not connect. A width fixes the arc.
    """

    arc: Literal["relaid", "spine", "circle", "line"] = "relaid"
    sagitta_m: float | None = None
    width_m: float | None = None


@dataclass(frozen=True, eq=False)
class Corridor:
    """An arc, (n, 2) map metres from start to goal, and the width of the swathe around it."""

    arc_xy_m: NDArray[np.float64]
    width_m: float
    sagitta_m: float | None = None
    widened: int = 0

    def cells(self, geometry: GridGeometry) -> NDArray[np.bool_]:
        """Return the cells whose centre is at most half the width from the arc."""
        inside = np.zeros(geometry.shape, dtype=np.bool_)
        columns = geometry.west_m + (np.arange(geometry.columns) + 0.5) * geometry.cell_size_m
        rows = geometry.north_m - (np.arange(geometry.rows) + 0.5) * geometry.cell_size_m
        half_m = self.width_m / 2
        points = self.arc_xy_m if len(self.arc_xy_m) > 1 else np.repeat(self.arc_xy_m, 2, axis=0)
        for a, b in itertools.pairwise(points):
            # Only the box around a segment can hold cells within reach of it; a cell more, lest rounding decides.
            reach_m = half_m + geometry.cell_size_m
            low, high = np.minimum(a, b) - reach_m, np.maximum(a, b) + reach_m
            wide = slice(*np.searchsorted(columns, (low[0], high[0])))
            tall = slice(*np.searchsorted(-rows, (-high[1], -low[1])))
            x_m, y_m = columns[wide][None, :], rows[tall][:, None]
            along = b - a
            length_squared = float(along @ along)
            share: NDArray[np.float64] | float = 0.0
            if length_squared > 0:
                share = np.clip(((x_m - a[0]) * along[0] + (y_m - a[1]) * along[1]) / length_squared, 0, 1)
            inside[tall, wide] |= np.hypot(x_m - a[0] - share * along[0], y_m - a[1] - share * along[1]) <= half_m
        return inside
