"""GRASS as a peer: a location made in a temporary folder, and modules run in it, files in and files out."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

#: Easting and northing of the south-west corner of every benchmark map.
WEST_M, SOUTH_M = 500_000.0, 5_000_000.0
_CRS = "EPSG:32632"
#: As much as r.cost and r.walk need to keep the whole map in memory at 4000 x 4000.
_MEMORY_MB = 8000


def write_geotiff(path: Path, values: NDArray[np.float32], cell_size_m: float) -> None:
    """Write one band as a plain tiled GeoTIFF."""
    import rasterio
    from rasterio.transform import from_origin

    rows, columns = values.shape
    transform = from_origin(WEST_M, SOUTH_M + rows * cell_size_m, cell_size_m, cell_size_m)
    profile = {"driver": "GTiff", "dtype": "float32", "count": 1, "height": rows, "width": columns, "tiled": True}
    with rasterio.open(path, "w", crs=_CRS, transform=transform, **profile) as target:
        target.write(values, 1)


def read_geotiff(path: Path) -> NDArray[np.float32]:
    """Return the only band of a GeoTIFF."""
    import rasterio

    with rasterio.open(path) as source:
        band: NDArray[np.float32] = source.read(1)
        return band


def corner_points(side: int, cell_size_m: float) -> tuple[str, str]:
    """Return the centres of the north-west and the south-east cell as GRASS writes coordinates."""
    half_m, far_m = cell_size_m / 2, (side - 0.5) * cell_size_m
    return f"{WEST_M + half_m},{SOUTH_M + far_m}", f"{WEST_M + far_m},{SOUTH_M + half_m}"


class Location:
    """A GRASS location in a temporary folder, linked to its maps, which lasts as long as the object."""

    def __init__(self, maps: dict[str, NDArray[np.float32]], cell_size_m: float) -> None:
        """Write the maps as GeoTIFFs and make a location that reads them where they are."""
        grass = shutil.which("grass")
        if grass is None:
            raise RuntimeError("GRASS is not installed: sudo apt-get install --no-install-recommends grass-core")
        self._grass = grass
        self._home = tempfile.TemporaryDirectory(prefix="swathe-grass-")
        self.folder = Path(self._home.name)
        for name, values in maps.items():
            write_geotiff(self.folder / f"{name}.tif", values, cell_size_m)
        self._place = self.folder / "location"
        self._call([self._grass, "--text", "-c", _CRS, "-e", str(self._place)])
        links = [f"r.external --quiet -o input={self.folder / name}.tif output={name}" for name in maps]
        self.run(*links, f"g.region raster={next(iter(maps))}")

    def run(self, *commands: str) -> None:
        """Run shell commands inside the location."""
        self._call([self._grass, str(self._place / "PERMANENT"), "--exec", "sh", "-e", "-c", "\n".join(commands)])

    def route(self, module: str, start: str, goal: str, output: Path) -> NDArray[np.int64]:
        """Run r.cost or r.walk with its options, trace the path, and return it as rows and columns of its vertices."""
        self.run(
            f"{module} --overwrite --quiet output=cumulated outdir=direction start_coordinates={start} "
            f"stop_coordinates={goal} memory={_MEMORY_MB}",
            f"r.path --overwrite --quiet input=direction format=degree vector_path=path start_coordinates={goal}",
            f"v.out.ascii --overwrite --quiet input=path type=line format=standard output={output}",
        )
        return self._cells(output.read_text(encoding="ascii").splitlines())

    def _cells(self, lines: Iterable[str]) -> NDArray[np.int64]:
        """Return the cells of the only line of a vector in GRASS's standard ASCII form, start first."""
        rows = iter(lines)
        # "L <vertices> <categories>", then a vertex a line.
        count = next(int(row.split()[1]) for row in rows if row.startswith("L "))
        points = np.array([[float(x) for x in next(rows).split()] for _ in range(count)])
        region = self._region()
        columns = np.floor((points[:, 0] - region["w"]) / region["ewres"])
        down = np.floor((region["n"] - points[:, 1]) / region["nsres"])
        cells = np.column_stack([down, columns]).astype(np.int64)
        return cells if cells[0].sum() < cells[-1].sum() else cells[::-1]

    def _region(self) -> dict[str, float]:
        text = self._call([self._grass, str(self._place / "PERMANENT"), "--exec", "g.region", "-g"])
        pairs = (line.partition("=") for line in text.splitlines() if "=" in line)
        return {key: float(value) for key, _, value in pairs if key in ("n", "w", "nsres", "ewres")}

    def _call(self, command: list[str]) -> str:
        surroundings = {**os.environ, "GRASS_VERBOSE": "0", "HOME": str(self.folder)}
        # GRASS's own Python scripts must not see this environment's packages.
        for name in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"):
            surroundings.pop(name, None)
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=surroundings)
        if done.returncode != 0:
            raise RuntimeError(f"GRASS failed: {' '.join(command)}\n{done.stderr[-2000:]}")
        return done.stdout
