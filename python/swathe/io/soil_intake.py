"""A soil map in pieces of bounded size, for putting it into a store: polygons in batches, or rows of cells in bands.

What comes out, laid over cells, is what ``swathe.io.soil.read_soil`` gives for the whole frame.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from swathe.errors import NoOverlapError, SoilFieldError, UnreadableFileError
from swathe.grid import Window
from swathe.io.soil import LAYER_MARK, VECTOR_SUFFIXES, bundled_values
from swathe.io.soil_legend import Legend, Meaning, read_legend
from swathe.io.soil_raster import sample_values
from swathe.io.soil_vector import (
    Polygons,
    as_text,
    choose_field,
    is_vector,
    meanings_of,
    sorted_values,
    textures_of,
)
from swathe.io.sources import BUNDLED_PREFIX, Source, single
from swathe.io.tile import open_dataset
from swathe.io.window import WHOLE_MAP_CELLS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from swathe.io.crs import Frame

BATCH = 10_000
#: Features that are read at once: to begin in the middle of a file costs as much as to read up to there.
READ_AT_ONCE = 50_000
#: The field that says the soil is chosen by so many polygons.
FIELD_SAMPLE = 200_000
CATEGORY = "cat"


class PolygonSoil:
    """A vector of soils.

    ``field`` is the attribute that says the soil, ``values`` its different values and ``meanings`` what they mean;
    ``left_out`` counts the features without area near the frame, once ``batches`` has been read to its end.
    """

    def __init__(
        self, source: Source, layer: str | None, frame: Frame, field: str | None, legend: Legend | None
    ) -> None:
        self.source = source
        self._near = Polygons(source, layer, frame)
        self._near.require_field(field)
        self.crs_wkt = self._near.crs_wkt
        _, sample = self._near.read(None if field is None else [field], most=FIELD_SAMPLE, geometry=False)
        if not sample or not len(next(iter(sample.values()))):
            raise self._near.nowhere
        self.field, _ = choose_field(source, sample, field, legend)
        wanted = [self.field] if self.field in sample else self.field.split(", ")
        _, columns = self._near.read(wanted, geometry=False)
        self.values = sorted_values(self._texts(columns))
        self.meanings = meanings_of(source, self.field, self.values, legend, columns)
        if not any(meaning.understood for meaning in self.meanings):
            raise SoilFieldError(
                f"None of the soils in {source.name} was understood: {', '.join(map(repr, self.values[:5]))}.",
                "Say what they mean with `--soil-legend CSV`, or choose another attribute with `--soil-field`.",
            )
        self.count = len(next(iter(columns.values())))
        self.left_out = 0

    def batches(self) -> Iterator[list[tuple[bytes, str, Meaning, int | None, dict[str, Any]]]]:
        """Yield polygons that have an area: WKB, value, its meaning, category, attributes."""
        meaning = dict(zip(self.values, self.meanings, strict=True))
        self.left_out = 0
        for wkb, columns in read_in_batches(self._near, self.count):
            polygons, numbers = areas(self._near, wkb)
            self.left_out += len(wkb) - len(polygons)
            texts = self._texts(columns)
            names = {name.lower(): name for name in columns}
            cats = columns.get(names.get(CATEGORY, ""))
            rows = zip(numbers.tolist(), shapely.to_wkb(polygons), strict=True)
            yield [
                (
                    geometry,
                    texts[n],
                    meaning[texts[n]],
                    None if cats is None else whole_number(cats[n]),
                    {name: plain(values[n]) for name, values in columns.items()},
                )
                for n, geometry in rows
            ]

    def _texts(self, columns: dict[str, NDArray[Any]]) -> list[str]:
        if self.field in columns:
            return as_text(columns[self.field])
        return textures_of([columns[name] for name in self.field.split(", ")])


class RasterSoil:
    """A raster of soils, read in bands of whole rows of a frame.

    ``values`` are all values of the map inside the frame and ``meanings`` what they mean.
    """

    field = None

    def __init__(self, source: Source, frame: Frame, legend: Legend | None) -> None:
        self.source, self._frame, self._legend = source, frame, legend
        self.is_bundled = source.path.startswith(BUNDLED_PREFIX)
        self.name = source.name
        known: dict[str, Meaning] = {}
        for _, numbers, values, meanings in self._bands(256):
            for number in np.unique(numbers[numbers >= 0]).tolist():
                known.setdefault(values[number], meanings[number])
        if not known:
            raise NoOverlapError(f"{source.name} has no soil inside the map.", "Name a soil map of the same region.")
        self.values = sorted_values(known)
        self.meanings = [known[value] for value in self.values]
        if not any(meaning.understood for meaning in self.meanings):
            raise SoilFieldError(
                f"None of the soils in {source.name} was understood: {', '.join(map(repr, self.values[:5]))}.",
                "Say what they mean with `--soil-legend CSV`.",
            )

    def bands(self, tile_size: int) -> Iterator[tuple[Window, NDArray[np.uint16]]]:
        """Yield bands of whole rows of tiles: where they lie, and the number of each cell's value (from 1; 0 none)."""
        place = {value: n for n, value in enumerate(self.values, start=1)}
        for window, numbers, values, _ in self._bands(tile_size):
            table = np.array([0, *(place.get(value, 0) for value in values)], dtype=np.uint16)
            yield window, table[numbers + 1]

    def _bands(self, tile_size: int) -> Iterator[tuple[Window, NDArray[np.int32], list[str], list[Meaning]]]:
        rows, columns = self._frame.geometry.shape
        # A map that a plan reads whole is read whole: resampling may differ in the last digit from band to band.
        high = max(tile_size, WHOLE_MAP_CELLS // columns // tile_size * tile_size)
        for top in range(0, rows, high):
            window = Window(top, 0, min(high, rows - top), columns)
            band = self._frame.window(window)
            try:
                if self.is_bundled:
                    self.name, numbers, values, meanings = bundled_values(self.source.path, band)
                else:
                    numbers, values, meanings = sample_values(self.source, band, None, self._legend)
            except NoOverlapError:
                numbers, values, meanings = np.full((window.rows, columns), -1, dtype=np.int32), [], []
            yield window, numbers, values, meanings


def open_soil(
    source: str, frame: Frame, *, field: str | None = None, legend: str | None = None
) -> PolygonSoil | RasterSoil:
    """Open a soil map. Arguments and errors are those of ``swathe.io.soil.read_soil``."""
    meanings = None if legend is None else read_legend(legend)
    if source.startswith(BUNDLED_PREFIX):
        return RasterSoil(Source(source, source), frame, meanings)
    path, _, layer = source.partition(LAYER_MARK)
    file = single(path)
    if layer or PurePath(path.split("?")[0]).suffix.lower() in VECTOR_SUFFIXES:
        return PolygonSoil(file, layer or None, frame, field, meanings)
    try:
        open_dataset(file).close()
    except UnreadableFileError as refusal:
        if not is_vector(file):
            raise refusal from refusal.__cause__
        return PolygonSoil(file, None, frame, field, meanings)
    if field is not None:
        raise SoilFieldError(f"{file.name} is a raster and has no fields.", "Leave out `--soil-field`.")
    return RasterSoil(file, frame, meanings)


def read_in_batches(near: Polygons, count: int) -> Iterator[tuple[NDArray[Any], dict[str, NDArray[Any]]]]:
    """Yield the geometries of ``count`` features near a frame, and their attributes, in batches."""
    for first in range(0, count, READ_AT_ONCE):
        wkb, columns = near.read(None, first=first, most=READ_AT_ONCE)
        for start in range(0, len(wkb), BATCH):
            part = slice(start, start + BATCH)
            yield wkb[part], {name: values[part] for name, values in columns.items()}


def areas(near: Polygons, wkb: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Return those geometries that have an area in the frame, as polygons, and their places in ``wkb``."""
    polygons, present = near.laid(wkb)
    numbers = np.flatnonzero(present)
    kept = ~shapely.is_empty(polygons) & (shapely.area(polygons) > 0)
    return polygons[kept], numbers[kept]


def plain(value: Any) -> Any:  # noqa: ANN401 - attributes are of any type
    """Return an attribute as a value of JSON."""
    if value is None or value != value:  # noqa: PLR0124 - NaN
        return None
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, bool | int | float | str) else str(value)


def whole_number(value: Any) -> int | None:  # noqa: ANN401 - attributes are of any type
    """Return a category as a whole number, or None."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return int(number) if number.is_integer() and abs(number) < 2**53 else None
