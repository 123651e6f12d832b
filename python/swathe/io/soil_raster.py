"""Soil from a raster of class numbers: every cell takes the value of the raster cell under its centre."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
from affine import Affine
from rasterio.crs import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.windows import Window as RasterWindow

from swathe.errors import MissingCrsError, NoOverlapError, SoilFieldError
from swathe.io.crs import Frame, crs_from_wkt, crs_name, horizontal, transformer_between
from swathe.io.soil import SoilLayer, layer_of_values
from swathe.io.soil_legend import Legend, Meaning, label_meaning, meaning_of, plain_value
from swathe.io.tile import GDAL_ERRORS, declared_crs_wkt, gdal_settings, open_dataset, placed_transform
from swathe.io.warp import warp_array

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from swathe.io.sources import Source

# A map of soils has some dozens of classes; thousands of values are measurements.
MOST_VALUES = 4096
MARGIN_CELLS = 2
PROBES = 33


def sample_raster(source: Source, frame: Frame, field: str | None, legend: Legend | None) -> SoilLayer:
    """Return the soil of a frame's cells from a raster. Raises as ``swathe.io.soil.read_soil``."""
    return layer_of_values(source, None, *sample_values(source, frame, field, legend))


def sample_values(
    source: Source, frame: Frame, field: str | None, legend: Legend | None
) -> tuple[NDArray[np.int32], list[str], list[Meaning]]:
    """Return the number of the value of every cell of a frame (-1 = none), the values, and what they mean."""
    with open_dataset(source) as dataset, gdal_settings(source):
        _require_classes(source, dataset)
        if field is not None:
            raise SoilFieldError(f"{source.name} is a raster and has no fields.", "Leave out `--soil-field`.")
        transform, _ = placed_transform(dataset.transform, dataset.height)
        crs_wkt = declared_crs_wkt(dataset)
        require_system(source, frame, crs_wkt)
        if crs_wkt is not None:
            crs_wkt = horizontal(crs_from_wkt(crs_wkt)).to_wkt()
        else:
            transform = local_from_file(frame) @ transform
        numbers, transform = read_near(source, dataset, transform, crs_wkt, frame)
        names = _category_names(source)
        nodata = dataset.nodatavals[0]
    known = ~np.isnan(numbers) if numbers.dtype.kind == "f" else np.ones(numbers.shape, dtype=bool)
    if nodata is not None:
        known &= numbers != nodata
    found, inverse = np.unique(numbers[known], return_inverse=True)
    if len(found) > MOST_VALUES:
        raise SoilFieldError(
            f"{source.name} has {len(found)} different values: that is a measurement, not a map of soil classes.",
            "Name a raster of soil classes.",
        )
    indexes = np.full(numbers.shape, -1, dtype=np.int32)
    indexes[known] = inverse
    sampled = nearest(indexes, transform, crs_wkt, frame, -1)
    values = [plain_value(value) for value in found.tolist()]
    return sampled, values, _meanings(values, names, legend)


def nearest(codes: NDArray[Any], transform: Affine, crs_wkt: str | None, frame: Frame, outside: int) -> NDArray[Any]:
    """Return for every cell of a frame the code under its centre; ``outside`` where there is none."""
    geometry = frame.geometry
    place = Affine(geometry.cell_size_m, 0, geometry.west_m, 0, -geometry.cell_size_m, geometry.north_m)
    # In a local frame both sides are the same plane: any one system will do.
    target = CRS.from_wkt(frame.crs_wkt) if frame.crs_wkt is not None else CRS.from_epsg(32631)
    same = crs_wkt is None or crs_wkt == frame.crs_wkt
    return warp_array(
        codes,
        transform,
        target if same else CRS.from_wkt(crs_wkt),
        outside,
        place=place,
        crs=target,
        shape=geometry.shape,
        resampling=Resampling.nearest,
    )


def require_system(source: Source, frame: Frame, crs_wkt: str | None, what: str = "soil") -> None:
    """Raise MissingCrsError when only one of a layer and the elevation has a coordinate reference system."""
    if frame.crs_wkt is not None and crs_wkt is None:
        raise MissingCrsError(
            f"The {what} {source.name} has no coordinate reference system.",
            f"Give the file one (a .prj beside it will do): where the {what} lies cannot be guessed.",
        )
    if frame.crs_wkt is None and crs_wkt is not None:
        name = crs_name(crs_from_wkt(crs_wkt))
        raise MissingCrsError(
            f"The {what} {source.name} lies in {name}, but the elevation has no coordinate reference system.",
            f"Give the elevation's system with `--crs`, or a {what} map in the elevation's own coordinates.",
        )


def local_from_file(frame: Frame) -> Affine:
    """Return the way from coordinates that a file wrote down to those of a local frame."""
    x, y = frame.file_origin
    return Affine.scale(frame.file_unit_m) @ Affine.translation(-x, -y)


def frame_box(frame: Frame, crs_wkt: str | None) -> tuple[float, float, float, float] | None:
    """Return (west, south, east, north) of a frame in another system, its inside followed; None without a place."""
    geometry = frame.geometry
    x, y = np.meshgrid(
        np.linspace(geometry.west_m, geometry.east_m, PROBES), np.linspace(geometry.south_m, geometry.north_m, PROBES)
    )
    if crs_wkt is not None and crs_wkt != frame.crs_wkt:
        x, y = transformer_between(str(frame.crs_wkt), crs_wkt).transform(x, y)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return None
    return (float(x[known].min()), float(y[known].min()), float(x[known].max()), float(y[known].max()))


def read_near(
    source: Source,
    dataset: Any,  # noqa: ANN401 - rasterio has no types
    transform: Affine,
    crs_wkt: str | None,
    frame: Frame,
    *,
    what: str = "soil",
) -> tuple[NDArray[Any], Affine]:
    """Return the part of a raster around a frame, and where it lies."""
    box = frame_box(frame, crs_wkt)
    nowhere = NoOverlapError(f"{source.name} lies outside the map.", f"Name a {what} map of the same region.")
    if box is None:
        raise nowhere
    west, south, east, north = box
    inverse = ~transform
    corners = [inverse @ (x, y) for x in (west, east) for y in (south, north)]
    columns, rows = [corner[0] for corner in corners], [corner[1] for corner in corners]
    left, right = max(int(min(columns)) - MARGIN_CELLS, 0), min(int(max(columns)) + MARGIN_CELLS + 1, dataset.width)
    top, bottom = max(int(min(rows)) - MARGIN_CELLS, 0), min(int(max(rows)) + MARGIN_CELLS + 1, dataset.height)
    if left >= right or top >= bottom:
        raise nowhere
    try:
        numbers = dataset.read(1, window=RasterWindow(left, top, right - left, bottom - top))
    except GDAL_ERRORS as error:
        raise source.refusal(error) from error
    return numbers, transform @ Affine.translation(left, top)


def _require_classes(source: Source, dataset: Any) -> None:  # noqa: ANN401 - rasterio has no types
    colours = {ColorInterp.red, ColorInterp.green, ColorInterp.blue}
    if dataset.count > 1 and colours & set(dataset.colorinterp):
        raise SoilFieldError(
            f"{source.name} is a colour picture, not a map of soil classes.", "Name a raster of classes."
        )
    if dataset.dtypes[0].startswith("complex"):
        raise SoilFieldError(f"{source.name} holds complex numbers, not soil classes.", "Name a raster of classes.")


def _meanings(values: Sequence[str], names: dict[str, str], legend: Legend | None) -> list[Meaning]:
    found = None if legend is None else legend.column_for(values)
    if legend is not None and found is None:
        raise SoilFieldError(
            f"The soil legend {legend.name} explains none of the values {', '.join(values[:5])}.",
            "Give a legend of this map: one column holds its values.",
        )
    table = None if found is None else found[1]
    own = {value: label_meaning(name) for value, name in names.items()}
    # A legend that the user gave overrides what the file says of itself.
    return [meaning_of(value, own | dict(table or {})) for value in values]


def _category_names(source: Source) -> dict[str, str]:
    """Return the names of values that a raster carries beside it (``.aux.xml``) or inside it (VRT)."""
    from pathlib import Path

    names: dict[str, str] = {}
    for path in (Path(source.path), Path(source.path + ".aux.xml")):
        if source.is_remote or not path.is_file() or path.suffix not in (".vrt", ".xml"):
            continue
        try:
            root = ET.fromstring(path.read_text(encoding="utf-8"))  # noqa: S314 - a local file that the user named
        except (ET.ParseError, UnicodeDecodeError):
            continue
        for number, category in enumerate(root.iterfind(".//CategoryNames/Category")):
            if category.text:
                names[str(number)] = category.text.strip()
        names |= _table_names(root)
    return names


def _table_names(root: ET.Element) -> dict[str, str]:
    """Return the names in a raster attribute table: the first column of whole numbers is the value."""
    names: dict[str, str] = {}
    for table in root.iterfind(".//GDALRasterAttributeTable"):
        kinds = [field.findtext("Type") for field in table.iterfind("FieldDefn")]
        usages = [field.findtext("Usage") for field in table.iterfind("FieldDefn")]
        numeric = (number for number, kind in enumerate(kinds) if kind == "0")
        value_column = usages.index("5") if "5" in usages else next(numeric, None)
        texts = [number for number, kind in enumerate(kinds) if kind == "2"]
        if value_column is None or not texts:
            continue
        for row in table.iterfind("Row"):
            cells = [cell.text or "" for cell in row.iterfind("F")]
            label = label_meaning(*(cells[number].strip() for number in texts if number < len(cells))).label
            if value_column < len(cells) and label:
                names[plain_value(cells[value_column])] = label
    return names
