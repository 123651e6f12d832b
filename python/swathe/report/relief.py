"""The shaded picture under the map: rank colours, hillshade, unknown ground and the swathe, as one RGB image.

Rasters larger than the picture are first averaged in blocks, strip by strip, so that memory stays near that of the
picture; smaller ones are enlarged, cells staying sharp and the shading smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from swathe.report.palette import RANK_COLOURS, UNKNOWN_RANK

if TYPE_CHECKING:
    from numpy.typing import NDArray

_Pixels = TypeVar("_Pixels", bound=np.generic)

# Sides above this are averaged: more pixels than any print of the page shows.
MAX_SIDE = 2000
_RANK_RGB = np.array([RANK_COLOURS[code][:3] for code in sorted(RANK_COLOURS)], dtype=np.uint8)

_SUN_AZIMUTH_RAD = math.radians(315)
_FILL_AZIMUTH_RAD = math.radians(225)
_SUN_ALTITUDE_RAD = math.radians(45)
_FILL_SHARE = 0.25
# The steep tenth of the map is shaded as if it had this grade, so that plains and mountains both show their form.
_SHOWN_STEEP_GRADE = 0.75
_EXAGGERATION_RANGE = (0.6, 15.0)
_SHADOW_DEPTH = 0.62
_HIGHLIGHT_STRENGTH = 0.45

_OUTSIDE_SATURATION = 0.25
_OUTSIDE_FADE = 0.52
_PAPER = 244.0
_BORDER_RGB = (40.0, 44.0, 52.0)


@dataclass(frozen=True)
class _Layers:
    """The layers of the map at the resolution of the picture or coarser."""

    colour: NDArray[np.float32]  # (h, w, 3), 0..255
    elevation_m: NDArray[np.float32]  # (h, w), NaN unknown
    unknown: NDArray[np.bool_]  # (h, w)
    inside: NDArray[np.bool_] | None  # (h, w), cells of the swathe
    row_step: int
    column_step: int


def draw_relief(
    rank: NDArray[np.uint8],
    elevation_m: NDArray[np.float32],
    swathe: NDArray[np.bool_] | None,
    *,
    cell_size_m: float,
    target_shape: tuple[int, int],
) -> tuple[NDArray[np.uint8], int, int]:
    """Return the image (h, w, 3) and the rows and columns of cells that it covers.

    The image may cover up to one block of cells more than the raster in the south and east. ``target_shape`` is the
    size in pixels at which it will be seen; ``rank`` holds codes 0..10.
    """
    layers = _reduced(rank, elevation_m, swathe)
    rows, columns = layers.unknown.shape
    row_zoom = max(1, round(target_shape[0] / rows))
    column_zoom = max(1, round(target_shape[1] / columns))
    light = _hillshade(layers, cell_size_m)

    image = _enlarged(layers.colour, row_zoom, column_zoom)
    unknown = _enlarged(layers.unknown, row_zoom, column_zoom)
    stroke = max(1, round(rows * row_zoom / max(target_shape[0], 1)))
    _hatch(image, unknown, stroke)
    _shade(image, _smoothly_enlarged(light, row_zoom, column_zoom))
    if layers.inside is not None:
        _fade_outside(image, _enlarged(layers.inside, row_zoom, column_zoom), stroke)
    image += 0.5
    np.clip(image, 0, 255, out=image)
    return image.astype(np.uint8), rows * layers.row_step, columns * layers.column_step


def _reduced(rank: NDArray[np.uint8], elevation_m: NDArray[np.float32], swathe: NDArray[np.bool_] | None) -> _Layers:
    rows, columns = rank.shape
    row_step = math.ceil(rows / MAX_SIDE)
    column_step = math.ceil(columns / MAX_SIDE)
    starts = np.arange(0, columns, column_step)
    widths = np.diff(np.append(starts, columns))
    shape = (math.ceil(rows / row_step), len(starts))
    colour = np.empty((*shape, 3), np.float32)
    elevation = np.empty(shape, np.float32)
    unknown = np.empty(shape, np.bool_)
    inside = None if swathe is None else np.empty(shape, np.bool_)

    def block_sums(strip: NDArray[np.float32] | NDArray[np.uint32]) -> NDArray[np.float32]:
        sums: NDArray[np.float32] = np.add.reduceat(strip, starts, axis=0).astype(np.float32)
        return sums

    for out, top in enumerate(range(0, rows, row_step)):
        strip = slice(top, top + row_step)
        codes = rank[strip]
        cells = (widths * len(codes)).astype(np.float32)
        colour[out] = block_sums(_RANK_RGB[codes].sum(axis=0, dtype=np.uint32)) / cells[:, None]
        unknown[out] = block_sums((codes == UNKNOWN_RANK).sum(axis=0, dtype=np.uint32)) * 2 > cells
        heights = elevation_m[strip]
        known = np.isfinite(heights)
        count = block_sums(known.sum(axis=0, dtype=np.uint32))
        total = block_sums(np.where(known, heights, 0).sum(axis=0, dtype=np.float32))
        elevation[out] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        if inside is not None and swathe is not None:
            inside[out] = block_sums(swathe[strip].sum(axis=0, dtype=np.uint32)) * 2 >= cells
    return _Layers(colour, elevation, unknown, inside, row_step, column_step)


def _hillshade(layers: _Layers, cell_size_m: float) -> NDArray[np.float32]:
    """Return light per cell: 1 on flat or unknown ground, less in shadow, more towards the sun in the north-west."""
    heights = layers.elevation_m
    known = np.isfinite(heights)
    flat = np.ones(heights.shape, np.float32)
    if not known.any():
        return flat
    filled = np.where(known, heights - heights[known].mean(), 0).astype(np.float32)
    north_south, west_east = layers.row_step * cell_size_m, layers.column_step * cell_size_m
    # Row 0 is north, so the height rises northwards where it falls with the row.
    rise_north = -np.gradient(filled, north_south, axis=0) if heights.shape[0] > 1 else np.zeros_like(filled)
    rise_east = np.gradient(filled, west_east, axis=1) if heights.shape[1] > 1 else np.zeros_like(filled)
    # A cell beside unknown ground has no true gradient: leave it flat instead of drawing a cliff.
    solid = known.copy()
    solid[1:] &= known[:-1]
    solid[:-1] &= known[1:]
    solid[:, 1:] &= known[:, :-1]
    solid[:, :-1] &= known[:, 1:]
    if not solid.any():
        return flat
    steep = float(np.quantile(np.hypot(rise_north, rise_east)[solid], 0.9))
    exaggeration = float(np.clip(_SHOWN_STEEP_GRADE / steep, *_EXAGGERATION_RANGE)) if steep > 0 else 1.0
    rise_north *= exaggeration
    rise_east *= exaggeration
    up = 1 / np.sqrt(1 + rise_north**2 + rise_east**2)
    light = np.zeros(heights.shape, np.float32)
    for azimuth, share in ((_SUN_AZIMUTH_RAD, 1 - _FILL_SHARE), (_FILL_AZIMUTH_RAD, _FILL_SHARE)):
        towards = -(rise_east * math.sin(azimuth) + rise_north * math.cos(azimuth)) / math.tan(_SUN_ALTITUDE_RAD)
        light += np.float32(share) * np.maximum((1 + towards) * up, 0)
    return np.where(solid, light, flat).astype(np.float32)


def _enlarged(layer: NDArray[_Pixels], row_zoom: int, column_zoom: int) -> NDArray[_Pixels]:
    for axis, zoom in ((0, row_zoom), (1, column_zoom)):
        if zoom > 1:
            layer = layer.repeat(zoom, axis=axis)
    return layer


def _smoothly_enlarged(layer: NDArray[np.float32], row_zoom: int, column_zoom: int) -> NDArray[np.float32]:
    for axis, zoom in ((0, row_zoom), (1, column_zoom)):
        if zoom == 1:
            continue
        last = layer.shape[axis] - 1
        at = np.clip((np.arange(layer.shape[axis] * zoom) + 0.5) / zoom - 0.5, 0, last)
        before = np.floor(at).astype(np.intp)
        share = (at - before).astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
        layer = layer.take(before, axis) * (1 - share) + layer.take(np.minimum(before + 1, last), axis) * share
    return layer


def _hatch(image: NDArray[np.float32], unknown: NDArray[np.bool_], stroke: int) -> None:
    rows = np.arange(image.shape[0])[:, None]
    columns = np.arange(image.shape[1])[None, :]
    stripes = (rows + columns) % (9 * stroke) < 2 * stroke
    image[unknown & stripes] -= 22


def _shade(image: NDArray[np.float32], light: NDArray[np.float32]) -> None:
    shadow = 1 - _SHADOW_DEPTH * np.maximum(1 - light, 0)
    shine = _HIGHLIGHT_STRENGTH * np.clip(light - 1, 0, 1)
    for channel in range(3):  # one at a time: the picture is the largest thing in memory
        plane = image[:, :, channel]
        plane *= shadow
        plane += (255 - plane) * shine


def _fade_outside(image: NDArray[np.float32], inside: NDArray[np.bool_], stroke: int) -> None:
    outside = ~inside
    faded = image[outside]
    grey = faded @ np.array([0.299, 0.587, 0.114], np.float32)
    faded = grey[:, None] + (faded - grey[:, None]) * _OUTSIDE_SATURATION
    image[outside] = faded + (_PAPER - faded) * _OUTSIDE_FADE
    edge = np.zeros_like(inside)
    for shift in range(1, stroke + 1):
        edge[:-shift] |= outside[:-shift] & inside[shift:]
        edge[shift:] |= outside[shift:] & inside[:-shift]
        edge[:, :-shift] |= outside[:, :-shift] & inside[:, shift:]
        edge[:, shift:] |= outside[:, shift:] & inside[:, :-shift]
    image[edge] = image[edge] * 0.25 + np.array(_BORDER_RGB, np.float32) * 0.75
