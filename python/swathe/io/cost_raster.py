"""The user's factor on costs from a raster: every cell takes the value of the raster cell under its centre."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import InvalidParameterError
from swathe.io.crs import Frame, crs_from_wkt, horizontal
from swathe.io.soil_raster import local_from_file, nearest, read_near, require_system
from swathe.io.sources import single
from swathe.io.tile import declared_crs_wkt, gdal_settings, open_dataset, placed_transform

if TYPE_CHECKING:
    from numpy.typing import NDArray


def read_cost(path: str, frame: Frame) -> NDArray[np.float64]:
    """Return the first band of a raster on the cells of a frame; NaN, which closes, where it has no value.

    Raises:
        SwatheError: the file cannot be read, lies elsewhere, or holds no real numbers.
    """
    source = single(path)
    with open_dataset(source) as dataset, gdal_settings(source):
        if dataset.dtypes[0].startswith("complex"):
            raise InvalidParameterError(f"{source.name} holds complex numbers.", "Give a raster of factors.")
        transform, _ = placed_transform(dataset.transform, dataset.height)
        crs_wkt = declared_crs_wkt(dataset)
        require_system(source, frame, crs_wkt, "cost")
        if crs_wkt is not None:
            crs_wkt = horizontal(crs_from_wkt(crs_wkt)).to_wkt()
        else:
            transform = local_from_file(frame) @ transform
        numbers, transform = read_near(source, dataset, transform, crs_wkt, frame, what="cost")
        nodata = dataset.nodatavals[0]
    known = numbers.astype(np.float64)
    if nodata is not None and not np.isnan(nodata):
        known[numbers == nodata] = np.nan
    # Resampling tells numbers from "no value" by the number alone: what is there is looked up by its place instead.
    places = np.arange(known.size, dtype=np.int32).reshape(known.shape)
    found = nearest(places, transform, crs_wkt, frame, -1)
    return np.where(found >= 0, known.ravel()[found], np.nan)
