"""The terrain store: importing a large DEM, against ``gdal_translate`` to a COG of the same compression.

Ours does more: it hashes the source, keeps checksums of all tiles, and reads the finished COG back before it counts.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import terrain_fields
from harness import Benchmark, Contender

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

CELL_SIZE_M = 10.0
#: Those of the store.
OPTIONS = ("COMPRESS=ZSTD", "LEVEL=1", "PREDICTOR=YES", "BLOCKSIZE=256")


def write_dem(side: int) -> Path:
    """Write a DEM of blocks, a band at a time, in a temporary folder of its own."""
    import rasterio
    from rasterio.transform import from_origin

    folder = Path(tempfile.mkdtemp(prefix="swathe-store-"))
    tile = terrain_fields.elevation(1000)
    profile = {"driver": "GTiff", "dtype": "float32", "count": 1, "height": side, "width": side, "tiled": True}
    place = from_origin(500_000.0, 5_000_000.0, CELL_SIZE_M, CELL_SIZE_M)
    with rasterio.open(folder / "dem.tif", "w", crs="EPSG:32632", transform=place, **profile) as target:
        for top in range(0, side, 1000):
            band = np.hstack([tile + np.float32(7 * top + left) / 1000 for left in range(0, side, 1000)])
            target.write(np.round(band[: side - top, :side], 2), 1, window=((top, min(side, top + 1000)), (0, side)))
    return folder


def import_it(folder: Path) -> Path:
    from swathe.store import open_store
    from swathe.store.imports import import_elevation

    with open_store(folder / "project", create=True) as store:
        import_elevation(store, "region", [str(folder / "dem.tif")])
    return next((folder / "project" / "elevation").iterdir())


def translate_it(folder: Path) -> Path:
    program = shutil.which("gdal_translate")
    if program is None:
        raise RuntimeError("GDAL's programs are not installed: sudo apt-get install --no-install-recommends gdal-bin")
    options = [word for option in OPTIONS for word in ("-co", option)]
    subprocess.run([program, "-q", "-of", "COG", *options, folder / "dem.tif", folder / "peer.tif"], check=True)
    return folder / "peer.tif"


def facts(folder: Path, made: Path) -> dict[str, float]:
    import rasterio

    with rasterio.open(made) as dataset:
        part: NDArray[np.float32] = dataset.read(1, window=((1500, 2500), (500, 1500)))
    shutil.rmtree(folder)
    return {"sum": float(part.sum(dtype=np.float64))}


def bench(side: int) -> Benchmark:
    """Return the benchmark of a square DEM."""
    prepare: Callable[[], Path] = lambda: write_dem(side)  # noqa: E731 - one expression
    return Benchmark(
        f"store-import-{side}",
        ours=Contender("swathe.store.imports.import_elevation", prepare, import_it, facts),
        peer=Contender("gdal_translate -of COG", prepare, translate_it, facts),
        must=0.5,
        goal=0.8,
    )


BENCHMARKS = [bench(10_000)]
