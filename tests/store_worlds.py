"""Small regions for tests of stores, and a program that imports one, to be killed."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.belief import PenetrometerReading
from swathe.grid import GridGeometry
from swathe.io.crs import Frame, parse_crs
from swathe.store import TILE_SIZE, Provenance, StoredReading, open_store, postgis_rasters

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from swathe.store import ImportSession, TerrainStore

UTM = parse_crs("EPSG:32632").to_wkt()


def frame(rows: int = 600, columns: int = 700, cell_size_m: float = 10.0) -> Frame:
    """Return a frame whose edges cut tiles."""
    return Frame(GridGeometry(rows, columns, cell_size_m, 500_000.0, 5_000_000.0), UTM)


def heights(rows: int, columns: int, seed: int) -> NDArray[np.float32]:
    """Return heights that tell their seed in every cell."""
    return np.random.default_rng(seed).normal(1000.0 * seed, 50.0, (rows, columns)).astype(np.float32)


def provenance(name: str) -> Provenance:
    """Return where a layer comes from that is called ``name``."""
    return Provenance(((name, f"sha256-of-{name}"),), author="tests", licence="none")


def tiles(layer: NDArray[Any]) -> Iterator[tuple[int, int, NDArray[Any]]]:
    """Yield a layer in tiles."""
    for row in range(-(-layer.shape[0] // TILE_SIZE)):
        for column in range(-(-layer.shape[1] // TILE_SIZE)):
            top, left = row * TILE_SIZE, column * TILE_SIZE
            yield row, column, layer[top : top + TILE_SIZE, left : left + TILE_SIZE]


def fill(session: ImportSession, layer: NDArray[Any]) -> int:
    """Write the tiles that are not there yet and return how many."""
    have, written = session.have(), 0
    for row, column, tile in tiles(layer):
        if (row, column) not in have:
            session.write_tile(row, column, tile)
            written += 1
    return written


def import_heights(
    store: TerrainStore, region: str, heights_m: NDArray[np.float32], name: str, *, layer: str = "elevation"
) -> None:
    """Import heights as a layer of a region."""
    with store.begin_import(region, layer, provenance(name)) as session:
        fill(session, heights_m)
        session.commit()


def reading(number: int, author: str = "rover", **more: Any) -> StoredReading:
    """Return a reading that lies inside ``frame()``."""
    push = PenetrometerReading(500_005.0 + number % 6000, 4_999_995.0, (0.05, 0.1), (300.0, 450.0 + number))
    values: dict[str, Any] = {"time": "2026-05-01T10:00:00Z", "instrument": "cone-1", **more}
    return StoredReading(f"{author}-{number}", push, author, **values)


def main(url: str, region: str, rows: str, columns: str, seed: str) -> None:
    """Import heights of a seed, as a process of its own that tells every step before it takes it."""
    # A few tiles at a time, so that a kill finds some of them kept.
    postgis_rasters.TILES_PER_COMMIT = 5
    layer = heights(int(rows), int(columns), int(seed))
    with open_store(url) as store, store.begin_import(region, "elevation", provenance(f"seed {seed}")) as session:
        for row, column, tile in tiles(layer):
            _tell("tile")
            if (row, column) not in session.have():
                session.write_tile(row, column, tile)
        _tell("commit")
        session.commit()


def _tell(step: str) -> None:
    sys.stdout.write(f"{step}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
