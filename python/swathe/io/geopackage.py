"""Writing features as a GeoPackage in the metres of a map, for programs that import files."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio.raw
import shapely

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from swathe.io.crs import Frame

# GeoJSON keeps degrees to about a millimetre; what is that near to a corner of a cell was one.
NEAR_CELLS = 0.01


def write_features(
    path: Path, collection: Mapping[str, Any], frame: Frame, layer: str, *, on_corners: bool = False
) -> int:
    """Write the features of a GeoJSON collection of a run, all of one kind, into a new file; return how many.

    Longitude and latitude become metres of ``frame``. ``on_corners``: coordinates lie on corners of its cells, and are
    put there exactly. Properties become fields of whole numbers, numbers or text.
    """
    features: Sequence[Mapping[str, Any]] = collection["features"]
    shapes = shapely.from_geojson([_text(feature["geometry"]) for feature in features])
    geometry = frame.geometry

    def to_frame(points: NDArray[np.float64]) -> NDArray[np.float64]:
        if frame.has_lonlat:
            points = np.column_stack(frame.from_lonlat(points[:, 0], points[:, 1]))
        if not on_corners:
            return points
        corner = np.array([geometry.west_m, geometry.north_m])
        cells = (points - corner) / geometry.cell_size_m
        near = np.abs(cells - np.round(cells)) < NEAR_CELLS
        return np.where(near, corner + np.round(cells) * geometry.cell_size_m, points)

    placed = shapely.transform(shapes, to_frame)
    names = list(features[0]["properties"]) if features else []
    columns = [_column([feature["properties"][name] for feature in features]) for name in names]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided")
        pyogrio.raw.write(
            path,
            shapely.to_wkb(placed),
            [values for values, _ in columns],
            np.array(names, dtype=object),
            field_mask=[missing for _, missing in columns],
            layer=layer,
            driver="GPKG",
            crs=frame.crs_wkt,
            geometry_type="Unknown",
        )
    return len(features)


def _text(geometry: Mapping[str, Any]) -> str:
    import json

    return json.dumps(geometry)


def _column(values: Sequence[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return a field's values and where there is none."""
    missing = np.array([value is None for value in values], dtype=np.bool_)
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, int) and not isinstance(value, bool) for value in known):
        whole = np.array([0 if value is None else value for value in values], dtype=np.int64)
        fits = np.abs(whole).max() < 2**31
        return (whole.astype(np.int32) if fits else whole), missing
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in known):
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64), missing
    return np.array(["" if value is None else str(value) for value in values], dtype=object), missing
