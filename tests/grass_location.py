"""Real GRASS locations that tests make, fill and look into with GRASS itself."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path


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
