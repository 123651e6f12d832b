"""The shape of the ground: grey height map, height differences, slope, aspect, roughness.

Arrays are (rows, columns) with row 0 at the north edge; NaN is unknown, and unknown cells never count as flat ground.
Horn's weights (Proc. IEEE 69, 1981) give the gradient; beyond the map's edge heights continue in a straight line, as
with ``gdaldem -compute_edges`` (which repeats the edge's column beyond the four corners, where it differs).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from swathe import _core
from swathe.errors import InvalidParameterError, ShapeMismatchError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Group = Literal["8x8", "2x4", "none"]


def as_heights(layer: ArrayLike, name: str = "elevation") -> NDArray[np.float32]:
    """Return a layer as a contiguous float32 array of two dimensions.

    Infinite heights become NaN. xarray's arrays are accepted.

    Raises:
        ShapeMismatchError: the layer does not have two dimensions or has no cells.
        InvalidParameterError: it does not hold numbers.
    """
    try:
        array = np.ascontiguousarray(layer, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"The {name} does not hold numbers.", "Give an array of heights.") from error
    if array.ndim != 2 or array.size == 0:
        raise ShapeMismatchError(
            f"The {name} has the shape {np.shape(array)}.", "Give an array of rows and columns with at least one cell."
        )
    if np.isinf(array).any():
        array = np.where(np.isinf(array), np.float32(np.nan), array)
    return array


def require_length(value_m: float, name: str = "cell size") -> float:
    """Return a length in metres that is finite and above zero, or raise InvalidParameterError."""
    if not (math.isfinite(value_m) and value_m > 0):
        raise InvalidParameterError(f"The {name} of {value_m} m is not a length.", "Give a finite number above zero.")
    return float(value_m)


def slope(elevation_m: ArrayLike, cell_size_m: float) -> NDArray[np.float32]:
    """Return Horn's slope along the fall line as rise over run; NaN where the height is unknown."""
    return cast("NDArray[np.float32]", _core.slope(as_heights(elevation_m), require_length(cell_size_m)))


def aspect_rad(elevation_m: ArrayLike, cell_size_m: float) -> NDArray[np.float32]:
    """Return the downhill direction, counter-clockwise from east in radians; NaN where it is flat or unknown."""
    return cast("NDArray[np.float32]", _core.aspect_rad(as_heights(elevation_m), require_length(cell_size_m)))


def roughness_m(elevation_m: ArrayLike, cell_size_m: float) -> NDArray[np.float32]:
    """Return the root mean square distance in metres of the 3 x 3 heights from the plane fitted to them."""
    return cast("NDArray[np.float32]", _core.roughness_m(as_heights(elevation_m), require_length(cell_size_m)))


def height_map(elevation_m: ArrayLike, height_range_m: tuple[float, float] | None = None) -> NDArray[np.float32]:
    """Return the paper's grey levels: whole numbers 0 (lowest) to 255 (highest) as float32, NaN where unknown.

    ``height_range_m`` is what black and white stand for; the least and greatest known height when not given.

    Raises:
        AllVoidError: no height is known.
        InvalidParameterError: the range is not one.
    """
    return cast("NDArray[np.float32]", _core.height_map(as_heights(elevation_m), height_range_m))


def group_mean(layer: ArrayLike, group: Group = "8x8") -> NDArray[np.float32]:
    """Return means of groups of cells, counted from the north-west; a group with an unknown cell is unknown.

    ``8x8`` is our reading of the paper's "group of 8 pixels" that keeps cells square; ``2x4`` the literal count.
    """
    return cast("NDArray[np.float32]", _core.group_mean(as_heights(layer, "layer"), group))


def block_max(layer: ArrayLike, group: Group = "8x8") -> NDArray[np.float32]:
    """Return the greatest known value of each group of cells."""
    return cast("NDArray[np.float32]", _core.block_max(as_heights(layer, "layer"), group))


def directional_difference(layer: ArrayLike, direction: int) -> NDArray[np.float32]:
    """Return the height differences to the neighbour in a direction: 0 east, 2 north, counter-clockwise to 7."""
    if not 0 <= direction < 8:
        raise InvalidParameterError(f"Direction {direction} is not one of eight.", "Give 0 (east) to 7 (south-east).")
    return cast("NDArray[np.float32]", _core.directional_difference(as_heights(layer, "layer"), direction))
