"""The soil map of a region joined to its cells, whether it is kept as polygons or as a raster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from swathe.belief import Unit, units_of_classes
from swathe.errors import InvalidParameterError, MissingLayerError, StoreBusyError
from swathe.grid import Window
from swathe.io.soil import SoilLayer, layer_of_values
from swathe.io.soil_legend import Meaning
from swathe.io.soil_vector import BURN_ORDER, burn, burn_areas, burn_numbers
from swathe.soil import SoilClass
from swathe.store.interface import SOIL, ZONES, require_window

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from swathe.io.crs import Frame
    from swathe.store.interface import Join, LayerInfo, RegionInfo, TerrainStore

#: Raster soils hold the number of a value in the legend, counted from 1; 0 is none.
_FIRST = 1


def legend_details(name: str, field: str | None, values: Sequence[str], meanings: Sequence[Meaning]) -> dict[str, Any]:
    """Return what a soil layer keeps of its legend."""
    entries = [
        [value, meaning.label, meaning.soil_class.name.lower(), meaning.understood]
        for value, meaning in zip(values, meanings, strict=True)
    ]
    return {"source": name, "field": field, "legend": entries}


def soil_layer(store: TerrainStore, region: str, window: Window, *, join: Join = "centre") -> SoilLayer | None:
    """Return the soil of a window with its report; see ``TerrainStore.soil_layer``."""
    info = store.region(region)
    require_window(info.frame.geometry, window)
    return None if SOIL not in info.layers else soil_of_frame(store, info, info.frame.window(window), join=join)


def soil_of_frame(store: TerrainStore, info: RegionInfo, frame: Frame, *, join: Join = "centre") -> SoilLayer:
    """Return the soil of a frame inside the region, whose cells may be larger than the region's.

    Raises:
        MissingLayerError: the region has no soil map.
        NoOverlapError: it has no soil inside the frame.
    """
    layer = _required(store, info)
    indexes, disputed, values, meanings = _joined(store, info, layer, frame, join)
    details = layer.details
    return layer_of_values(details["source"], details["field"], indexes, values, meanings, disputed_cells=disputed)


def soil_codes(store: TerrainStore, region: str, window: Window, *, join: Join = "centre") -> NDArray[np.uint8]:
    """Return the codes of a window; see ``TerrainStore.soil_window``."""
    info = store.region(region)
    require_window(info.frame.geometry, window)
    return _codes(store, info, info.frame.window(window), join)


def _codes(store: TerrainStore, info: RegionInfo, frame: Frame, join: Join = "centre") -> NDArray[np.uint8]:
    indexes, _, _, meanings = _joined(store, info, _required(store, info), frame, join)
    codes = np.array([SoilClass.UNKNOWN, *(meaning.soil_class for meaning in meanings)], dtype=np.uint8)
    return codes[indexes + 1]


def soil_units(store: TerrainStore, info: RegionInfo, frame: Frame) -> tuple[NDArray[np.uint32], dict[int, Unit]]:
    """Return the number of the polygon of every cell of a frame (0 = none) and the polygons as units of a belief."""
    layer = _required(store, info)
    if layer.kind == "raster":
        return units_of_classes(_codes(store, info, frame))
    values, meanings = _legend(layer)
    polygons, numbers = _polygons(store, info, layer, frame)
    worst_last = sorted(range(len(polygons)), key=lambda n: (BURN_ORDER.index(meanings[numbers[n]].soil_class), -n))
    units = burn_numbers(polygons[worst_last], frame) + 1
    found: dict[int, Unit] = {}
    for place in np.unique(units[units > 0]).tolist():
        value = int(numbers[worst_last[place - 1]])
        soil_class = meanings[value].soil_class
        if soil_class is SoilClass.UNKNOWN:
            units[units == place] = 0
        else:
            found[place] = Unit(soil_class, values[value])
    return units.astype(np.uint32), found


def closed_by_zones(store: TerrainStore, info: RegionInfo, frame: Frame) -> NDArray[np.bool_] | None:
    """Return which cells of a frame a zone touches, or None where the region has no zones."""
    if ZONES not in info.layers:
        return None
    geometry = frame.geometry
    bounds = (geometry.west_m, geometry.south_m, geometry.east_m, geometry.north_m)
    shapes = shapely.from_wkb(np.array([zone.wkb for zone in store.zones(info.name, bounds)], dtype=object))
    return burn_numbers(shapes, frame, all_touched=True) >= 0


def _required(store: TerrainStore, info: RegionInfo) -> LayerInfo:
    layer = info.layers.get(SOIL)
    if layer is None:
        raise MissingLayerError(
            f"The region {info.name!r} of {store.address} has no soil.", "Import it with `swathe import soil`."
        )
    return layer


def _legend(layer: LayerInfo) -> tuple[list[str], list[Meaning]]:
    entries = layer.details["legend"]
    return [str(entry[0]) for entry in entries], [
        Meaning(str(label), SoilClass[str(word).upper()], bool(understood)) for _, label, word, understood in entries
    ]


def _joined(
    store: TerrainStore, info: RegionInfo, layer: LayerInfo, frame: Frame, join: Join
) -> tuple[NDArray[np.int32], int, list[str], list[Meaning]]:
    """Return the number of the value of every cell (-1 = none), disputed cells, values and meanings."""
    if join not in {"centre", "area"}:
        raise InvalidParameterError(f"Soil cannot be joined by {join!r}.", "Give centre or area.")
    values, meanings = _legend(layer)
    if layer.kind == "raster":
        return _numbers(store, info, frame).astype(np.int32) - _FIRST, 0, values, meanings
    polygons, of_value = _polygons(store, info, layer, frame)
    indexes, disputed = (burn if join == "centre" else burn_areas)(polygons, of_value, meanings, frame)
    return indexes, disputed, values, meanings


def _numbers(store: TerrainStore, info: RegionInfo, frame: Frame) -> NDArray[Any]:
    """Return what a raster soil holds at the centres of a frame's cells."""
    whole, part = info.frame.geometry, frame.geometry
    step = round(part.cell_size_m / whole.cell_size_m)
    row = round((whole.north_m - part.north_m) / whole.cell_size_m)
    column = round((part.west_m - whole.west_m) / whole.cell_size_m)
    numbers = store.read_window(info.name, SOIL, Window(row, column, part.rows * step, part.columns * step))
    # The centre of an even group is a corner of cells: that to the south-east holds it, as with files.
    return numbers[step // 2 :: step, step // 2 :: step]


def _polygons(
    store: TerrainStore, info: RegionInfo, layer: LayerInfo, frame: Frame
) -> tuple[NDArray[Any], NDArray[np.int32]]:
    """Return the polygons near a frame, and the number of each one's value."""
    geometry = frame.geometry
    place = {value: n for n, value in enumerate(_legend(layer)[0])}
    wkb, numbers = [], []
    bounds = (geometry.west_m, geometry.south_m, geometry.east_m, geometry.north_m)
    for polygon in store.soil_polygons(info.name, bounds):
        if polygon.value not in place:
            raise StoreBusyError(
                f"The soil of {info.name!r} was replaced while it was read.", "Give the command again."
            )
        wkb.append(polygon.wkb)
        numbers.append(place[polygon.value])
    return shapely.from_wkb(np.array(wkb, dtype=object)), np.array(numbers, dtype=np.int32)
