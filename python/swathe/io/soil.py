"""Laying a soil map over the terrain: any vector or raster, in any system, covering it wholly or in part.

What the map does not cover is unknown. Every value is reported with the class that it was read as.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from swathe.errors import NoOverlapError, SoilFieldError, UnreadableFileError
from swathe.io.sources import BUNDLED_PREFIX, TABLE_PREFIXES, Source, single
from swathe.soil import SoilClass, SoilEntry, SoilReport

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from swathe.io.crs import Frame
    from swathe.io.soil_legend import Meaning

# Endings that OGR reads as vectors and GDAL would not open, or not as soil.
VECTOR_SUFFIXES = {
    ".dxf", ".fgb", ".gdb", ".geojson", ".gml", ".gpkg", ".json", ".kml", ".mif", ".shp", ".sqlite", ".tab",
}  # fmt: skip
LAYER_MARK = "|layername="


@dataclass(frozen=True, slots=True)
class SoilLayer:
    """Soil class codes (``swathe.soil.SoilClass``, uint8) of the shape of a frame, and how they came about."""

    codes: NDArray[np.uint8]
    report: SoilReport


def read_soil(source: str, frame: Frame, *, field: str | None = None, legend: str | None = None) -> SoilLayer:
    """Return the soil of the cells of ``frame`` (which may be a window of the map).

    ``source``: a vector (burnt at cell centres) or raster (the nearest cell), a path or http(s) address; one layer of a
    vector is named by ``PATH|layername=NAME``; ``grass:...`` is a map of a GRASS location (``swathe.io.grass``) and
    ``postgresql://...?table=SCHEMA.NAME`` a table with a geometry column (``swathe.io.table``);
    ``bundled:jacksboro`` is generated from its elevation. ``field``: the
    attribute of a vector that names the soil; by default the one that is understood best. ``legend``: a CSV that says
    what values mean; its column ``class`` holds classes outright.

    Where polygons of different classes overlap, the class that is worse to drive on wins, whatever their order.

    Raises NoOverlapError when the map lies elsewhere, MissingCrsError when it does not say where it lies,
    SoilFieldError when the field is not there or nothing was understood, and an InputError for an unusable file.
    """
    if source.startswith(BUNDLED_PREFIX):
        return _bundled(source, frame)
    path, _, layer = source.partition(LAYER_MARK)
    file = single(path)
    from swathe.io.soil_legend import read_legend

    meanings = None if legend is None else read_legend(legend)
    if is_named_as_vector(file, layer):
        from swathe.io.soil_vector import burn_vector

        return burn_vector(file, layer or None, frame, field, meanings)
    from swathe.io.soil_raster import sample_raster

    try:
        return sample_raster(file, frame, field, meanings)
    except UnreadableFileError as refusal:
        from swathe.io.soil_vector import burn_vector, is_vector

        # Not every vector has a telling name.
        if not is_vector(file):
            raise refusal from refusal.__cause__
        return burn_vector(file, None, frame, field, meanings)


def is_named_as_vector(file: Source, layer: str) -> bool:
    """Return whether a soil map is a vector by its name; ``layer`` is the one that was chosen, or empty."""
    suffix = PurePath(file.path.split("?")[0]).suffix.lower()
    return bool(layer) or file.path.startswith(TABLE_PREFIXES) or suffix in VECTOR_SUFFIXES


def layer_of_values(
    source: Source | str,
    field: str | None,
    indexes: NDArray[np.integer],
    values: Sequence[str],
    meanings: Sequence[Meaning],
    *,
    disputed_cells: int = 0,
) -> SoilLayer:
    """Return the layer of cells that hold numbers of values, -1 where the map has none.

    Raises NoOverlapError when no cell has a value, and SoilFieldError when none of the values present is understood.
    """
    name = source if isinstance(source, str) else source.name
    counts = np.bincount(indexes.ravel() + 1, minlength=len(values) + 1)
    covered = int(counts[1:].sum())
    if covered == 0:
        raise NoOverlapError(f"{name} has no soil inside the map.", "Name a soil map of the same region.")
    codes_of_values = np.array([SoilClass.UNKNOWN, *(meaning.soil_class for meaning in meanings)], dtype=np.uint8)
    entries = [
        SoilEntry(value, meaning.label, meaning.soil_class, meaning.understood, int(cells))
        for value, meaning, cells in zip(values, meanings, counts[1:], strict=True)
        if cells > 0
    ]
    entries.sort(key=lambda entry: (-entry.cells, entry.value))
    if not any(entry.understood for entry in entries):
        shown = ", ".join(repr(entry.label or entry.value) for entry in entries[:5])
        raise SoilFieldError(
            f"None of the soils in {name} was understood: {shown}{', ...' if len(entries) > 5 else ''}.",
            "Say what they mean with `--soil-legend CSV`, or choose another attribute with `--soil-field`.",
        )
    report = SoilReport(name, field, tuple(entries), covered / indexes.size, disputed_cells)
    return SoilLayer(codes_of_values[indexes + 1], report)


def _bundled(source: str, frame: Frame) -> SoilLayer:
    name, numbers, names, meanings = bundled_values(source, frame)
    return layer_of_values(name, None, numbers, names, meanings)


def bundled_values(source: str, frame: Frame) -> tuple[str, NDArray[np.int32], list[str], list[Meaning]]:
    """Return what generated soil is called, the number of each cell's value (-1 = none), values and meanings."""
    from swathe.io.bundled import bundled_name, bundled_soil
    from swathe.io.soil_legend import Meaning
    from swathe.io.soil_raster import nearest

    bundled_name(source)  # for its refusal
    soil, transform, crs_wkt = bundled_soil(source)
    if (crs_wkt is None) != (frame.crs_wkt is None) or not (crs_wkt is None or frame.is_earth):
        raise NoOverlapError(f"{source} has no place in a {frame.name}.", "Use it with its own elevation.")
    codes = nearest(soil, transform, crs_wkt, frame, int(SoilClass.UNKNOWN))
    present = [SoilClass(code) for code in np.unique(codes) if code != SoilClass.UNKNOWN]
    numbers = np.full(len(SoilClass), -1, dtype=np.int32)
    numbers[[int(soil_class) for soil_class in present]] = np.arange(len(present))
    names = [soil_class.name.lower() for soil_class in present]
    meanings = [Meaning(name, soil_class, understood=True) for name, soil_class in zip(names, present, strict=True)]
    return f"{source} (generated from its elevation)", numbers[codes], names, meanings
