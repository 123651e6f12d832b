"""The map of one plan: shaded ground by rank, the swathe, the nests, the arc and the route.

Importing this module is quick; matplotlib is loaded by the first drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import InvalidParameterError, ShapeMismatchError
from swathe.report.palette import BEST_RANK

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from swathe.grid import GridGeometry

# The shape beyond which the map is stretched so that a strip can still be seen.
MAX_RATIO = 5.0


@dataclass(frozen=True)
class MapPicture:
    """What the map shows. Coordinates are map metres; layers have the shape of ``geometry``.

    ``rank`` holds 0 unknown, 1 no-go, 2..10. ``nest_rings`` are closed (n, 2) outlines, exteriors and holes alike.
    ``swathe`` is true in the cells of the corridor. ``blocked_xy_m`` is where a refusal says that the way is blocked.
    ``lonlat_of`` turns x, y into longitude, latitude in degrees, where the frame has them.
    """

    geometry: GridGeometry
    elevation_m: NDArray[np.float32]
    rank: NDArray[np.uint8]
    title: str
    subtitle: str = ""
    nest_rings: Sequence[NDArray[np.float64]] = ()
    swathe: NDArray[np.bool_] | None = None
    arc_xy_m: NDArray[np.float64] | None = None
    route_xy_m: NDArray[np.float64] | None = None
    start_xy_m: tuple[float, float] | None = None
    goal_xy_m: tuple[float, float] | None = None
    blocked_xy_m: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()
    lonlat_of: (
        Callable[[NDArray[np.float64], NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]] | None
    ) = None

    def __post_init__(self) -> None:
        for name, layer in (("elevation_m", self.elevation_m), ("rank", self.rank), ("swathe", self.swathe)):
            if layer is not None and layer.shape != self.geometry.shape:
                raise ShapeMismatchError(
                    f"The map's {name} has the shape {layer.shape}, its geometry {self.geometry.shape}.",
                    "Give layers of one geometry.",
                )
        if self.rank.dtype != np.uint8 or int(self.rank.max()) > BEST_RANK:
            raise InvalidParameterError(
                "The map's rank holds other codes than 0 to 10 in 8 bits.", "Give a rank map of this package."
            )

    @property
    def has_route(self) -> bool:
        """Whether there is a route of more than one point: a start that is the goal has none to draw."""
        return self.route_xy_m is not None and len(self.route_xy_m) > 1 and bool(np.ptp(self.route_xy_m, axis=0).any())

    @property
    def is_stretched(self) -> bool:
        """Whether the map is so long and narrow that it is drawn with different scales along and across."""
        ratio = self.geometry.columns / self.geometry.rows
        return max(ratio, 1 / ratio) > MAX_RATIO


def draw_map(path: Path | str, picture: MapPicture, *, metadata: Mapping[str, str] | None = None) -> None:
    """Draw the map as PNG at ``path``, replacing it in one step; equal input gives equal bytes.

    Raises:
        OutputError: the file cannot be written.
    """
    from swathe.report.map_sheet import draw_sheet

    draw_sheet(path, picture, metadata or {})
