"""Soil from a vector: polygons near the frame, brought into its system, repaired, and burnt at cell centres."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio
import pyogrio.raw
import shapely
from affine import Affine
from pyogrio.errors import DataLayerError, DataSourceError, FieldError
from rasterio.features import rasterize

from swathe.errors import InvalidParameterError, NoOverlapError, SoilFieldError, UnreadableFileError
from swathe.io.crs import Frame, horizontal, parse_crs, transformer_between
from swathe.io.soil import SoilLayer, layer_of_values
from swathe.io.soil_legend import Legend, Meaning, label_meaning, meaning_of, plain_value
from swathe.io.soil_raster import frame_box, local_from_file, require_system
from swathe.soil import SoilClass, classify_texture

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from swathe.io.sources import Source

# From best to worst to drive on; where polygons overlap, the worse one counts. Unknown never hides a known class.
BURN_ORDER = (
    SoilClass.UNKNOWN,
    SoilClass.GRAVEL,
    SoilClass.SAND,
    SoilClass.CLAY,
    SoilClass.SILT,
    SoilClass.ROCK,
    SoilClass.NONE,
)
# Of fields that are understood equally well, those with such names come first.
TELLING_NAMES = ("class", "texture", "soil", "label", "boden")
# Straight edges bend in another projection; they are cut into this many pieces across the map first.
PIECES = 64
SHARES = ("sand", "silt", "clay")


def is_vector(source: Source) -> bool:
    """Return whether OGR can open a source."""
    try:
        return len(pyogrio.list_layers(source.path)) > 0
    except DataSourceError:
        return False


def burn_vector(source: Source, layer: str | None, frame: Frame, field: str | None, legend: Legend | None) -> SoilLayer:
    """Return the soil of a frame's cells from polygons. Raises as ``swathe.io.soil.read_soil``."""
    layer = _polygon_layer(source, layer)
    info = _ask(source, pyogrio.read_info, layer=layer)
    existing = [str(name) for name in info["fields"]]
    if field is not None and field not in existing:
        raise SoilFieldError(
            f"{source.name} has no field {field!r}; it has {', '.join(existing) or 'none'}.",
            "Name one of them with `--soil-field`.",
        )
    crs_wkt = None if not info["crs"] else horizontal(parse_crs(info["crs"])).to_wkt()
    surroundings = surroundings_of(source, frame, crs_wkt)
    meta, _, wkb, data = _ask(
        source,
        pyogrio.raw.read,
        layer=layer,
        bbox=surroundings.box,
        columns=None if field is None else [field],
        force_2d=True,
    )
    present = np.array([geometry is not None for geometry in wkb], dtype=bool)
    columns = {str(name): values[present] for name, values in zip(meta["fields"], data, strict=True)}
    return burn_polygons(source, surroundings.polygons(wkb[present]), columns, frame, field=field, legend=legend)


def burn_polygons(
    source: Source,
    polygons: NDArray[Any],
    columns: Mapping[str, NDArray[Any]],
    frame: Frame,
    *,
    field: str | None,
    legend: Legend | None,
) -> SoilLayer:
    """Return the soil of a frame's cells from polygons in its coordinates and their attributes by name.

    Raises as ``swathe.io.soil.read_soil``.
    """
    if len(polygons) == 0:
        raise NoOverlapError(f"{source.name} lies outside the map.", "Name a soil map of the same region.")
    chosen, values = _choose_field(source, columns, field, legend)
    distinct = sorted(set(values), key=lambda value: (len(value), value))
    meanings = _meanings(source, chosen, distinct, legend, columns)
    numbers = np.array([distinct.index(value) for value in values], dtype=np.int32)
    indexes, disputed = _burn(polygons, numbers, meanings, frame)
    return layer_of_values(source, chosen, indexes, distinct, meanings, disputed_cells=disputed)


def _polygon_layer(source: Source, layer: str | None) -> str:
    layers = _ask(source, pyogrio.list_layers)
    names = [str(name) for name, _ in layers]
    if layer is not None:
        if layer not in names:
            raise SoilFieldError(f"{source.name} has no layer {layer!r}.", f"Name one of {', '.join(names)}.")
        return layer
    for name, kind in layers:
        if kind is not None and ("Polygon" in kind or kind in ("Unknown", "GeometryCollection")):
            return str(name)
    raise UnreadableFileError(f"{source.name} holds no polygons.", "Name a soil map of polygons, or a raster.")


def _ask(source: Source, question: Any, **options: Any) -> Any:  # noqa: ANN401 - pyogrio has no types
    """Return what pyogrio answers about a source, its errors made plain."""
    try:
        return question(source.path, **options)
    except (DataSourceError, DataLayerError, FieldError) as error:
        raise source.refusal(error) from error


@dataclass(frozen=True)
class Surroundings:
    """What lies near a frame in the system of a soil map: ``box`` is west, south, east, north there."""

    frame: Frame
    crs_wkt: str | None
    box: tuple[float, float, float, float]
    margin: float

    def polygons(self, wkb: NDArray[Any]) -> NDArray[Any]:
        """Return geometries of the soil map (as WKB) repaired, cut to the box, and in the coordinates of the frame."""
        polygons: NDArray[Any] = shapely.from_wkb(wkb, on_invalid="ignore")
        # Cutting comes after the repair: it takes no invalid polygons.
        broken = ~shapely.is_valid(polygons)
        polygons[broken] = shapely.make_valid(polygons[broken])
        polygons = shapely.clip_by_rect(polygons, *self.box)
        if self.crs_wkt is None:
            return _moved(polygons, local_from_file(self.frame))
        if self.crs_wkt != self.frame.crs_wkt:
            polygons = shapely.segmentize(polygons, self.margin)
            transformer = transformer_between(self.crs_wkt, str(self.frame.crs_wkt))

            def to_frame(points: NDArray[np.float64]) -> NDArray[np.float64]:
                return np.column_stack(transformer.transform(points[:, 0], points[:, 1]))

            polygons = shapely.transform(polygons, to_frame)
        return polygons


def surroundings_of(source: Source, frame: Frame, crs_wkt: str | None) -> Surroundings:
    """Return where in a soil map the surroundings of a frame lie.

    Raises:
        MissingCrsError: only one of the map and the frame has a coordinate reference system.
        NoOverlapError: the frame has no place in the system of the map.
    """
    require_system(source, frame, crs_wkt)
    box = frame_box(frame, crs_wkt)
    if box is None:
        raise NoOverlapError(f"{source.name} lies outside the map.", "Name a soil map of the same region.")
    if crs_wkt is None:
        inverse = ~local_from_file(frame)
        box = (*(inverse @ box[:2]), *(inverse @ box[2:]))
    west, south, east, north = box
    margin = max(east - west, north - south) / PIECES
    return Surroundings(frame, crs_wkt, (west - margin, south - margin, east + margin, north + margin), margin)


def _moved(polygons: NDArray[Any], way: Affine) -> NDArray[Any]:
    def move(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack((points[:, 0] * way.a + way.c, points[:, 1] * way.e + way.f))

    moved: NDArray[Any] = shapely.transform(polygons, move)
    return moved


def _choose_field(
    source: Source, columns: Mapping[str, NDArray[Any]], field: str | None, legend: Legend | None
) -> tuple[str, list[str]]:
    """Return the name of the field that says the soil, and its text in every feature.

    Without a choice of the user it is the field most of whose features are understood; of equals a telling name, then
    the first. Figures of sand, silt and clay are taken when they say more than any text.
    """
    texts = {name: _as_text(values) for name, values in columns.items()}
    if field is not None:
        return field, texts[field]
    scores = {name: _understood(values, legend) for name, values in texts.items()}
    shares = _share_columns(columns)
    best = max(scores, key=lambda name: (scores[name], _telling(name)), default=None)
    if shares is not None:
        textures = _textures([columns[name] for name in shares])
        understood = float(np.mean([text != "" for text in textures]))
        if best is None or understood > scores[best]:
            return ", ".join(shares), textures
    if best is None or scores[best] == 0:
        raise SoilFieldError(
            f"None of the fields of {source.name} ({', '.join(columns) or 'it has none'}) is understood as soil.",
            "Name the field with `--soil-field` and say what its values mean with `--soil-legend CSV`.",
        )
    return best, texts[best]


def _as_text(values: NDArray[Any]) -> list[str]:
    return ["" if value is None or value != value else plain_value(value) for value in values.tolist()]  # noqa: PLR0124 - NaN


def _telling(name: str) -> int:
    lowered = name.lower()
    return max((len(TELLING_NAMES) - n for n, word in enumerate(TELLING_NAMES) if word in lowered), default=0)


def _understood(values: Sequence[str], legend: Legend | None) -> float:
    """Return the share of features whose value is understood."""
    found = None if legend is None else legend.column_for(values)
    meanings = {value: meaning_of(value, None if found is None else found[1]) for value in set(values)}
    hits = [meanings[value].understood and meanings[value].soil_class != SoilClass.UNKNOWN for value in values]
    return float(np.mean(hits)) if hits else 0.0


def _share_columns(columns: Mapping[str, NDArray[Any]]) -> list[str] | None:
    """Return the names of the numeric columns of sand, silt and clay, or None unless there is one of each."""
    names: list[str] = []
    for share in SHARES:
        numeric = (name for name, values in columns.items() if values.dtype.kind in "iuf")
        found = next((name for name in numeric if re.match(share, name.lower())), None)
        if found is None:
            return None
        names.append(found)
    return names


def _textures(shares: Sequence[NDArray[Any]]) -> list[str]:
    names: list[str] = []
    for sand, silt, clay in zip(*(column.astype(float).tolist() for column in shares), strict=True):
        try:
            names.append(classify_texture(sand, silt, clay)[0])
        except InvalidParameterError:
            names.append("")
    return names


def _meanings(
    source: Source, field: str, values: Sequence[str], legend: Legend | None, columns: Mapping[str, NDArray[Any]]
) -> list[Meaning]:
    found = None if legend is None or field not in columns else legend.column_for(values)
    if legend is not None and found is None and field in columns:
        raise SoilFieldError(
            f"The soil legend {legend.name} explains none of the values of field {field!r} of {source.name}.",
            "Name the field that it explains with `--soil-field`.",
        )
    return [label_meaning(value) if found is None else meaning_of(value, found[1]) for value in values]


def _burn(
    polygons: NDArray[Any], numbers: NDArray[np.int32], meanings: Sequence[Meaning], frame: Frame
) -> tuple[NDArray[np.int32], int]:
    """Return the number of the value of every cell (-1 = none), and in how many cells classes disagree."""
    rank = np.array([BURN_ORDER.index(meaning.soil_class) for meaning in meanings])[numbers]
    usable = [int(n) for n in np.flatnonzero(~shapely.is_empty(polygons) & (shapely.area(polygons) > 0))]
    if not usable:
        return np.full(frame.geometry.shape, -1, dtype=np.int32), 0
    # GDAL burns in order and the last stays; within a class the first feature of the file stays.
    worst_last = sorted(usable, key=lambda n: (rank[n], -n))
    top = _rasterized([(polygons[n], int(numbers[n])) for n in worst_last], frame)
    bottom = _rasterized([(polygons[n], int(numbers[n])) for n in reversed(worst_last)], frame)
    classes = np.array([0, *(meaning.soil_class for meaning in meanings)])
    return top, int(np.count_nonzero(classes[top + 1] != classes[bottom + 1]))


def _rasterized(shapes: list[tuple[Any, int]], frame: Frame) -> NDArray[np.int32]:
    geometry = frame.geometry
    place = Affine(geometry.cell_size_m, 0, geometry.west_m, 0, -geometry.cell_size_m, geometry.north_m)
    burnt: NDArray[np.int32] = rasterize(
        shapes, out_shape=geometry.shape, transform=place, fill=-1, all_touched=False, dtype="int32"
    )
    return burnt
