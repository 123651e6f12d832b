"""Tiles that share one lattice, read as one raster; only the tiles under a block are touched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from affine import Affine

from swathe.io.crs import same_crs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from swathe.io.tile import Tile

# Tiles whose corners differ from one lattice by less than this share of a cell are on it: more than rounding in
# file headers, less than what a slope would show.
LATTICE_TOLERANCE = 0.05


@dataclass(frozen=True)
class PlacedTile:
    """A tile and the row and column of the mosaic where it begins."""

    tile: Tile
    row: int
    column: int


class Mosaic:
    """Tiles of one coordinate reference system on one lattice. Where tiles overlap, the first that knows wins."""

    def __init__(self, tiles: Sequence[Tile]) -> None:
        first = tiles[0]
        offsets = [_offset(first, tile) for tile in tiles]
        top = min(row for row, _ in offsets)
        left = min(column for _, column in offsets)
        self.placed = [
            PlacedTile(tile, row - top, column - left) for tile, (row, column) in zip(tiles, offsets, strict=True)
        ]
        self.rows = max(place.row + place.tile.rows for place in self.placed)
        self.columns = max(place.column + place.tile.columns for place in self.placed)
        self.crs_wkt = first.crs_wkt
        self.transform = first.transform @ Affine.translation(left, top)

    def read(self, row: int, column: int, rows: int, columns: int) -> NDArray[np.float32]:
        """Return the heights of a block, metres; NaN where unknown and outside every tile."""
        heights = np.full((rows, columns), np.nan, dtype=np.float32)
        for place in self.placed:
            top, bottom = max(row, place.row), min(row + rows, place.row + place.tile.rows)
            left, right = max(column, place.column), min(column + columns, place.column + place.tile.columns)
            if top >= bottom or left >= right:
                continue
            target = heights[top - row : bottom - row, left - column : right - column]
            unknown = np.isnan(target)
            if unknown.any():
                block = place.tile.read(top - place.row, left - place.column, bottom - top, right - left)
                np.copyto(target, block, where=unknown)
        return heights


def group_into_mosaics(tiles: Sequence[Tile]) -> list[Mosaic]:
    """Return as few mosaics as hold all tiles, in the order in which their first tiles were given."""
    groups: list[list[Tile]] = []
    for tile in tiles:
        for group in groups:
            if _on_lattice(group[0], tile):
                group.append(tile)
                break
        else:
            groups.append([tile])
    return [Mosaic(group) for group in groups]


def _on_lattice(first: Tile, other: Tile) -> bool:
    one, two = first.transform, other.transform
    if is_rotated(one) or is_rotated(two) or not same_crs(first.crs_wkt, other.crs_wkt):
        return False
    if abs(one.a - two.a) * other.columns > LATTICE_TOLERANCE * abs(one.a):
        return False
    if abs(one.e - two.e) * other.rows > LATTICE_TOLERANCE * abs(one.e):
        return False
    column, row = ~one @ (two.c, two.f)
    return bool(max(abs(column - round(column)), abs(row - round(row))) < LATTICE_TOLERANCE)


def _offset(first: Tile, other: Tile) -> tuple[int, int]:
    if other is first:
        return (0, 0)
    column, row = ~first.transform @ (other.transform.c, other.transform.f)
    return (round(row), round(column))


def is_rotated(transform: Affine) -> bool:
    """Return whether rows of a raster do not run along one coordinate."""
    return bool(transform.b != 0 or transform.d != 0)
