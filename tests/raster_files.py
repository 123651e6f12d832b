"""Small raster files that the tests of reading write for themselves."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import rasterio
from affine import Affine
from rasterio.errors import NotGeoreferencedWarning

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

UTM16 = "EPSG:32616"
# A plane and a wave: no two cells alike, smooth enough to be resampled.
WEST, NORTH, CELL = 740_000.0, 4_050_000.0, 30.0
PLACE = Affine(CELL, 0, WEST, 0, -CELL, NORTH)


def hills(rows: int, columns: int) -> NDArray[np.float32]:
    """Return heights between 300 and 700 m."""
    row, column = np.mgrid[0:rows, 0:columns]
    heights = 500 + 150 * np.sin(row / 17) * np.cos(column / 23) + 0.1 * row + 0.05 * column
    return np.asarray(heights, dtype=np.float32)


def write(
    path: Path,
    bands: NDArray[Any],
    *,
    crs: str | None = UTM16,
    transform: Affine | None = PLACE,
    prepare: Callable[[Any], None] | None = None,
    **options: Any,
) -> Path:
    """Write one band (2-D) or several (3-D) to a file and return its path."""
    stack = bands[None] if bands.ndim == 2 else bands
    options.setdefault("driver", "GTiff")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path,
            "w",
            count=stack.shape[0],
            height=stack.shape[1],
            width=stack.shape[2],
            dtype=stack.dtype,
            crs=crs,
            transform=transform,
            **options,
        ) as dataset:
            dataset.write(stack)
            if prepare is not None:
                prepare(dataset)
    return path
