"""Soil from a vector: polygons near the frame, brought into its system, repaired, and burnt at cell centres."""

from __future__ import annotations

import re
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
from swathe.io.sources import TABLE_PREFIXES
from swathe.soil import SoilClass, classify_texture

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

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
# Polygon and multipolygon, as shapely numbers the types.
POLYGONAL = (3, 6)
SHARES = ("sand", "silt", "clay")


def is_vector(source: Source) -> bool:
    """Return whether OGR can open a source."""
    try:
        return len(pyogrio.list_layers(source.path)) > 0
    except DataSourceError:
        return False


def burn_vector(source: Source, layer: str | None, frame: Frame, field: str | None, legend: Legend | None) -> SoilLayer:
    """Return the soil of a frame's cells from polygons. Raises as ``swathe.io.soil.read_soil``."""
    near = Polygons(source, layer, frame)
    near.require_field(field)
    wkb, columns = near.read(None if field is None else [field])
    polygons, present = near.laid(wkb)
    if not present.any():
        raise near.nowhere
    columns = {name: values[present] for name, values in columns.items()}
    chosen, values = choose_field(source, columns, field, legend)
    distinct = sorted_values(values)
    meanings = meanings_of(source, chosen, distinct, legend, columns)
    numbers = np.array([distinct.index(value) for value in values], dtype=np.int32)
    indexes, disputed = burn(polygons, numbers, meanings, frame)
    return layer_of_values(source, chosen, indexes, distinct, meanings, disputed_cells=disputed)


class Polygons:
    """The polygons of a vector near a frame, all at once or in parts; made for the frame one by one.

    Raises NoOverlapError when they cannot lie there, MissingCrsError when it is not known where they lie.
    """

    def __init__(self, source: Source, layer: str | None, frame: Frame, what: str = "soil") -> None:
        if source.path.startswith(TABLE_PREFIXES):
            from swathe.io.table import fetch_near

            source = fetch_near(source, frame, what)
        self.source, self._frame = source, frame
        self.layer = _polygon_layer(source, layer)
        info = _ask(source, pyogrio.read_info, layer=self.layer)
        self.fields = [str(name) for name in info["fields"]]
        self.crs_wkt = None if not info["crs"] else horizontal(parse_crs(info["crs"])).to_wkt()
        require_system(source, frame, self.crs_wkt, what)
        self.nowhere = NoOverlapError(f"{source.name} lies outside the map.", f"Name a {what} map of the same region.")
        near = box_near(frame, self.crs_wkt)
        if near is None:
            raise self.nowhere
        self._box, self._margin = near
        self._local = local_from_file(frame)

    def require_field(self, field: str | None) -> None:
        """Raise SoilFieldError unless the attribute is there."""
        if field is not None and field not in self.fields:
            raise SoilFieldError(
                f"{self.source.name} has no field {field!r}; it has {', '.join(self.fields) or 'none'}.",
                "Name one of them with `--soil-field`.",
            )

    def read(
        self, columns: list[str] | None, *, first: int = 0, most: int | None = None, geometry: bool = True
    ) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
        """Return the geometries (WKB, or None) near the frame from the ``first`` on, and their attributes by name."""
        meta, _, wkb, data = _ask(
            self.source,
            pyogrio.raw.read,
            layer=self.layer,
            bbox=self._box,
            columns=columns,
            force_2d=True,
            skip_features=first,
            max_features=most,
            read_geometry=geometry,
        )
        values = {str(name): column for name, column in zip(meta["fields"], data, strict=True)}
        return (np.empty(0, dtype=object) if wkb is None else wkb), values

    def laid(self, wkb: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return the polygons in the frame, valid and cut to its neighbourhood, and which geometries they are of."""
        present = np.array([geometry is not None for geometry in wkb], dtype=bool)
        polygons = shapely.from_wkb(wkb[present], on_invalid="ignore")
        # Cutting comes after the repair: it takes no invalid polygons.
        broken = ~shapely.is_valid(polygons)
        polygons[broken] = shapely.make_valid(polygons[broken])
        polygons = shapely.clip_by_rect(polygons, *self._box)
        for n in np.flatnonzero(~np.isin(shapely.get_type_id(polygons), POLYGONAL)):
            # What repair and cutting leave of spikes: lines and points, without an area, that would yet be burnt.
            parts = shapely.get_parts(polygons[n])
            parts = parts[np.isin(shapely.get_type_id(parts), POLYGONAL)]
            polygons[n] = shapely.multipolygons(shapely.get_parts(parts))
        if self.crs_wkt is None:
            return _moved(polygons, self._local), present
        if self.crs_wkt != self._frame.crs_wkt:
            polygons = shapely.segmentize(polygons, self._margin)
            transformer = transformer_between(self.crs_wkt, str(self._frame.crs_wkt))

            def to_frame(points: NDArray[np.float64]) -> NDArray[np.float64]:
                return np.column_stack(transformer.transform(points[:, 0], points[:, 1]))

            polygons = shapely.transform(polygons, to_frame)
        return polygons, present


def box_near(frame: Frame, crs_wkt: str | None) -> tuple[tuple[float, float, float, float], float] | None:
    """Return west, south, east, north around a frame in another system, and the margin; None without a place there."""
    box = frame_box(frame, crs_wkt)
    if box is None:
        return None
    if crs_wkt is None:
        inverse = ~local_from_file(frame)
        box = (*(inverse @ box[:2]), *(inverse @ box[2:]))
    west, south, east, north = box
    margin = max(east - west, north - south) / PIECES
    return (west - margin, south - margin, east + margin, north + margin), margin


def sorted_values(values: Iterable[str]) -> list[str]:
    """Return the different values in the order in which they are numbered."""
    return sorted(set(values), key=lambda value: (len(value), value))


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


def _moved(polygons: NDArray[Any], way: Affine) -> NDArray[Any]:
    def move(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack((points[:, 0] * way.a + way.c, points[:, 1] * way.e + way.f))

    moved: NDArray[Any] = shapely.transform(polygons, move)
    return moved


def choose_field(
    source: Source, columns: Mapping[str, NDArray[Any]], field: str | None, legend: Legend | None
) -> tuple[str, list[str]]:
    """Return the name of the field that says the soil, and its text in every feature.

    Without a choice of the user it is the field most of whose features are understood; of equals a telling name, then
    the first. Figures of sand, silt and clay are taken when they say more than any text.
    """
    texts = {name: as_text(values) for name, values in columns.items()}
    if field is not None:
        return field, texts[field]
    scores = {name: _understood(values, legend) for name, values in texts.items()}
    shares = _share_columns(columns)
    best = max(scores, key=lambda name: (scores[name], _telling(name)), default=None)
    if shares is not None:
        textures = textures_of([columns[name] for name in shares])
        understood = float(np.mean([text != "" for text in textures]))
        if best is None or understood > scores[best]:
            return ", ".join(shares), textures
    if best is None or scores[best] == 0:
        raise SoilFieldError(
            f"None of the fields of {source.name} ({', '.join(columns) or 'it has none'}) is understood as soil.",
            "Name the field with `--soil-field` and say what its values mean with `--soil-legend CSV`.",
        )
    return best, texts[best]


def as_text(values: NDArray[Any]) -> list[str]:
    """Return the values of a field as legends write them; empty where there is none."""
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


def textures_of(shares: Sequence[NDArray[Any]]) -> list[str]:
    """Return the texture class of every sand, silt and clay; empty where they are none."""
    names: list[str] = []
    for sand, silt, clay in zip(*(column.astype(float).tolist() for column in shares), strict=True):
        try:
            names.append(classify_texture(sand, silt, clay)[0])
        except InvalidParameterError:
            names.append("")
    return names


def meanings_of(
    source: Source, field: str, values: Sequence[str], legend: Legend | None, columns: Mapping[str, NDArray[Any]]
) -> list[Meaning]:
    """Return what the values of a field mean, by the legend or by their own words."""
    found = None if legend is None or field not in columns else legend.column_for(values)
    if legend is not None and found is None and field in columns:
        raise SoilFieldError(
            f"The soil legend {legend.name} explains none of the values of field {field!r} of {source.name}.",
            "Name the field that it explains with `--soil-field`.",
        )
    return [label_meaning(value) if found is None else meaning_of(value, found[1]) for value in values]


def burn(
    polygons: NDArray[Any], numbers: NDArray[np.int32], meanings: Sequence[Meaning], frame: Frame
) -> tuple[NDArray[np.int32], int]:
    """Return the number of the value of every cell (-1 = none), and in how many cells classes disagree.

    ``numbers`` are those of the polygons' values among ``meanings``.
    """
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


def burn_areas(
    polygons: NDArray[Any], numbers: NDArray[np.int32], meanings: Sequence[Meaning], frame: Frame
) -> tuple[NDArray[np.int32], int]:
    """Return the same as ``burn`` by area: a cell takes the class that covers most of it, of equals the worse one.

    Ground that no polygon covers counts as one of them. Only cells on an outline are measured; the others lie wholly in
    what is at their centre.
    """
    indexes, disputed = burn(polygons, numbers, meanings, frame)
    usable = np.flatnonzero(~shapely.is_empty(polygons) & (shapely.area(polygons) > 0))
    if not len(usable):
        return indexes, disputed
    outlines = [(outline, 1) for outline in shapely.boundary(polygons[usable])]
    touched = _rasterized(outlines, frame, all_touched=True)
    rows, columns = np.nonzero(touched == 1)
    geometry = frame.geometry
    size, west, north = geometry.cell_size_m, geometry.west_m + columns * geometry.cell_size_m, geometry.north_m
    top = north - rows * size
    cells = shapely.box(west, top - size, west + size, top)
    tree = shapely.STRtree(polygons[usable])
    of_cell, of_polygon = tree.query(cells, predicate="intersects")
    shares = shapely.area(shapely.intersection(cells[of_cell], polygons[usable][of_polygon]))
    order = np.array([BURN_ORDER.index(meaning.soil_class) for meaning in meanings])
    found: dict[int, dict[int, float]] = {}
    for cell, polygon, share in zip(of_cell.tolist(), of_polygon.tolist(), shares.tolist(), strict=True):
        values = found.setdefault(cell, {})
        value = int(numbers[usable[polygon]])
        values[value] = values.get(value, 0.0) + share
    for cell, values in found.items():
        classes: dict[int, float] = {}
        for value, share in values.items():
            classes[int(order[value])] = classes.get(int(order[value]), 0.0) + share
        bare = size * size - sum(classes.values())
        worst = max(classes, key=lambda rank: (round(classes[rank] / size**2, 9), rank))
        inside = [value for value in values if order[value] == worst]
        best = max(inside, key=lambda value: (values[value], -value))
        indexes[rows[cell], columns[cell]] = -1 if bare > classes[worst] + 1e-9 * size**2 else best
    return indexes, disputed


def burn_numbers(polygons: NDArray[Any], frame: Frame, *, all_touched: bool = False) -> NDArray[np.int32]:
    """Return the place of the last polygon at the centre of every cell, or touching it; -1 = none."""
    usable = [int(n) for n in np.flatnonzero(~shapely.is_empty(polygons) & (shapely.area(polygons) > 0))]
    if not usable:
        return np.full(frame.geometry.shape, -1, dtype=np.int32)
    return _rasterized([(polygons[n], n) for n in usable], frame, all_touched=all_touched)


def _rasterized(shapes: list[tuple[Any, int]], frame: Frame, *, all_touched: bool = False) -> NDArray[np.int32]:
    geometry = frame.geometry
    place = Affine(geometry.cell_size_m, 0, geometry.west_m, 0, -geometry.cell_size_m, geometry.north_m)
    burnt: NDArray[np.int32] = rasterize(
        shapes, out_shape=geometry.shape, transform=place, fill=-1, all_touched=all_touched, dtype="int32"
    )
    return burnt
