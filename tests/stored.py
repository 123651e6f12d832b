"""What tests of terrain stores share: small regions, and ways to fill them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

import raster_files
from swathe.belief import ClassReading, PenetrometerReading
from swathe.grid import GridGeometry
from swathe.io.crs import Frame, parse_crs
from swathe.soil import SoilClass
from swathe.store import TILE_SIZE, Provenance, SoilPolygon, StoredReading, TerrainStore

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

WEST, NORTH, CELL = raster_files.WEST, raster_files.NORTH, raster_files.CELL
UTM16 = parse_crs(raster_files.UTM16).to_wkt()
#: What an elevation tells its readers.
DETAILS: dict[str, Any] = {
    "source_crs_wkt": UTM16,
    "warped": False,
    "native_cell_size_m": CELL,
    "height_range_m": None,
}


def frame(rows: int, columns: int, cell_m: float = CELL) -> Frame:
    """Return a frame in UTM zone 16."""
    return Frame(GridGeometry(rows, columns, cell_m, WEST, NORTH), UTM16)


def provenance(of: str, **options: str) -> Provenance:
    """Return the provenance of a file whose hash is made of a letter."""
    return Provenance(((f"{of}.tif", of[0] * 64),), UTM16, "no licence needed", "tester", options=options)


def tiles(layer: NDArray[Any]) -> dict[tuple[int, int], NDArray[Any]]:
    """Return a layer in tiles."""
    rows, columns = layer.shape
    return {
        (top // TILE_SIZE, left // TILE_SIZE): layer[top : top + TILE_SIZE, left : left + TILE_SIZE]
        for top in range(0, rows, TILE_SIZE)
        for left in range(0, columns, TILE_SIZE)
    }


def put(
    store: TerrainStore,
    region: str,
    layer: str,
    numbers: NDArray[Any],
    of: str = "a",
    details: Mapping[str, Any] | None = None,
) -> None:
    """Make a region of the shape of a raster, if there is none, and import the raster."""
    store.create_region(region, frame(*numbers.shape))
    with store.begin_import(region, layer, provenance(of), dtype=numbers.dtype, details=details or DETAILS) as session:
        for (row, column), tile in tiles(numbers).items():
            session.write_tile(row, column, tile)
        session.commit()


def box(row: int, column: int, rows: int, columns: int) -> Any:
    """Return the outline of a block of cells."""
    west, north = WEST + column * CELL, NORTH - row * CELL
    return shapely.box(west, north - rows * CELL, west + columns * CELL, north)


def polygon(shape: Any, soil: SoilClass, value: str = "", cat: int | None = None) -> SoilPolygon:
    """Return a piece of soil."""
    return SoilPolygon(shapely.to_wkb(shape), value or soil.name.lower(), soil, cat, {"grün": "ja", "n": 1.5})


def legend(*soils: SoilClass, source: str = "soil.gpkg") -> dict[str, Any]:
    """Return the details of a soil map whose values are the names of its classes."""
    return {
        "source": source,
        "field": "soil",
        "legend": [[soil.name.lower(), soil.name.lower(), soil.name.lower(), True] for soil in soils],
    }


def push(name: str, row: float, column: float, cone_kpa: float = 400.0, **more: Any) -> StoredReading:
    """Return a push of the cone at a place in cells."""
    reading = PenetrometerReading(
        WEST + column * CELL, NORTH - row * CELL, (0.05, 0.10, 0.15), (cone_kpa, cone_kpa * 1.1, cone_kpa * 1.25)
    )
    return _filed(name, reading, more)


def word(name: str, row: float, column: float, soil: SoilClass, **more: Any) -> StoredReading:
    """Return somebody's word on the soil at a place in cells."""
    return _filed(name, ClassReading(WEST + column * CELL, NORTH - row * CELL, soil), more)


def _filed(name: str, reading: PenetrometerReading | ClassReading, more: dict[str, Any]) -> StoredReading:
    rest: dict[str, Any] = {"author": "rover 1", "time": "2026-05-01T12:00:00Z", "instrument": "CP-17", "error": 0.3}
    return StoredReading(name, reading, **(rest | more))


def two_soils(store: TerrainStore, region: str = "valley", rows: int = 40, columns: int = 60) -> None:
    """Make a region that is sand in the west half and clay in the east."""
    put(store, region, "elevation", np.zeros((rows, columns), dtype=np.float32))
    half = columns // 2
    west, east = box(0, 0, rows, half), box(0, half, rows, columns - half)
    shapes = [polygon(west, SoilClass.SAND, cat=1), polygon(east, SoilClass.CLAY, cat=2)]
    store.write_soil_polygons(region, [shapes], provenance("s"), details=legend(SoilClass.SAND, SoilClass.CLAY))
