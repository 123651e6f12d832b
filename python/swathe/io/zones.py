"""Zones from a vector: polygons near a frame in its coordinates, with a name and their attributes, in batches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import shapely

from swathe.errors import NoOverlapError
from swathe.io.soil_intake import areas, plain, read_in_batches
from swathe.io.soil_vector import Polygons, as_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from swathe.io.crs import Frame
    from swathe.io.sources import Source


class ZonePolygons:
    """A vector of zones; ``count`` features lie near the frame, ``left_out`` of them have no area in it."""

    def __init__(self, source: Source, layer: str | None, frame: Frame) -> None:
        self._near = Polygons(source, layer, frame, "zones")
        self.crs_wkt = self._near.crs_wkt
        wkb, _ = self._near.read([])
        self.count, self.left_out = len(wkb), 0
        if not self.count:
            raise NoOverlapError(f"{source.name} lies outside the region.", "Name zones of the same region.")

    def batches(self) -> Iterator[list[tuple[bytes, str, dict[str, Any]]]]:
        """Yield zones that have an area: WKB, name, attributes."""
        self.left_out = 0
        for wkb, columns in read_in_batches(self._near, self.count):
            polygons, numbers = areas(self._near, wkb)
            self.left_out += len(wkb) - len(polygons)
            named = {name.lower(): name for name in columns}.get("name")
            names = None if named is None else as_text(columns[named])
            yield [
                (
                    geometry,
                    "" if names is None else names[n],
                    {name: plain(values[n]) for name, values in columns.items()},
                )
                for n, geometry in zip(numbers.tolist(), shapely.to_wkb(polygons), strict=True)
            ]
