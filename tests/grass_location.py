"""Real GRASS locations that tests make, fill and look into with GRASS itself."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyogrio.raw
import shapely

import raster_files
from raster_files import CELL, NORTH, WEST

if TYPE_CHECKING:
    from collections.abc import Iterator

ROWS, COLUMNS = 80, 90
#: Corners of soil areas, as rows and columns of cells; the last is an island in the first.
AREAS = {
    (0, 0, 80, 30): "sand",
    (0, 30, 40, 90): "clay",
    (40, 30, 80, 60): "silt",
    (40, 60, 60, 90): "gravel",
    (20, 5, 40, 20): "rock",
}


def heights_with_holes() -> np.ndarray[Any, Any]:
    heights = raster_files.hills(ROWS, COLUMNS)
    heights[5:9, 70:80] = np.nan
    heights[0, 0] = np.nan
    return heights


def write_soils(path: Path) -> Path:
    """Write the areas as polygons with a number, a name and columns that a GeoPackage keeps for itself."""
    boxes = [
        shapely.box(WEST + left * CELL, NORTH - bottom * CELL, WEST + right * CELL, NORTH - top * CELL)
        for top, left, bottom, right in AREAS
    ]
    boxes[0] = boxes[0].difference(boxes[-1])
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(boxes, dtype=object)),
        [np.arange(1, 6, dtype=np.int32), np.array(list(AREAS.values()), dtype=object), np.arange(5.0)],
        np.array(["number", "texture", "geom_fid"], dtype=object),
        layer="soils",
        crs=raster_files.UTM16,
        geometry_type="Polygon",
        driver="GPKG",
        VERSION="1.2",
    )
    return path


@contextmanager
def as_nobody(folder: Path) -> Iterator[None]:
    """Drop the rights of root, who may read and write everywhere, where ``folder`` can be reached by everybody."""
    me = os.geteuid()
    if me == 0:
        # Not above the folder of all temporary files.
        for parent in (folder, *folder.parents):
            if parent in (Path(tempfile.gettempdir()), Path("/")):
                break
            parent.chmod(parent.stat().st_mode | 0o055)
        os.seteuid(65534)
    try:
        yield
    finally:
        if me == 0:
            os.seteuid(0)


class Location:
    """A location in a folder; ``run`` runs shell lines in one of its mapsets."""

    def __init__(self, program: Path, folder: Path, like: str | Path) -> None:
        """Make it: ``like`` is a file with a coordinate reference system, ``EPSG:n`` or ``XY``."""
        self._program = program
        self.folder = folder
        self._call("-c", str(like), "-e", str(folder))

    @property
    def name(self) -> str:
        return self.folder.name

    def address(self, name: str, mapset: str = "PERMANENT") -> str:
        return f"grass:{self.folder / mapset / name}"

    def new_mapset(self, name: str) -> None:
        self._call("-c", "-e", str(self.folder / name))

    def run(self, *lines: str | list[str], mapset: str = "PERMANENT") -> str:
        script = "\n".join(line if isinstance(line, str) else shlex.join(line) for line in lines)
        return self._call(str(self.folder / mapset), "--exec", "sh", "-e", "-c", script)

    def read_raster(self, name: str, into: Path, mapset: str = "PERMANENT") -> Path:
        """Export a raster by hand, as anybody would."""
        full = f"{name}@{mapset}"
        self.run(f"g.region raster={full}", ["r.out.gdal", "-c", f"input={full}", f"output={into}"])
        return into

    def _call(self, *words: str) -> str:
        own = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"}
        env = {name: value for name, value in os.environ.items() if name not in own}
        here = str(Path(sys.executable).parent)
        env["PATH"] = os.pathsep.join(part for part in env["PATH"].split(os.pathsep) if part != here)
        env |= {"GRASS_VERBOSE": "0", "LC_ALL": "C.UTF-8"}
        done = subprocess.run([self._program, "--text", *words], env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def contents(self) -> dict[str, tuple[int, int]]:
        """Every file of the location with its size and time of change."""
        return {
            str(path.relative_to(self.folder)): (path.stat().st_size, path.stat().st_mtime_ns)
            for path in sorted(self.folder.rglob("*"))
        }


def hills_location(program: Path, folder: Path) -> Location:
    """Make a location ``hills`` with elevation, soil as areas and as categories, and a second mapset.

    What went into it stands beside it as ``dem.tif`` and ``soils.gpkg``.
    """
    raster_files.write(folder / "dem.tif", heights_with_holes(), nodata=np.nan)
    write_soils(folder / "soils.gpkg")
    made = Location(program, folder / "hills", folder / "dem.tif")
    names = "\n".join(f"{number}|{name}" for number, name in enumerate(AREAS.values(), start=1))
    (folder / "labels").write_text(names + "\n", encoding="ascii")
    made.run(
        ["r.in.gdal", f"input={folder / 'dem.tif'}", "output=dem"],
        ["v.in.ogr", f"input={folder / 'soils.gpkg'}", "layer=soils", "output=soils", "key=number"],
        "g.region raster=dem",
        "v.to.rast input=soils output=soil_classes use=cat",
        ["r.category", "map=soil_classes", "separator=pipe", f"rules={folder / 'labels'}"],
    )
    made.new_mapset("other")
    made.run(f"g.region n={NORTH} s={NORTH - 300} w={WEST} e={WEST + 600} save=corner", mapset="other")
    return made
