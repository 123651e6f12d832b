"""``swathe doctor``: is everything here that is needed, and what could be added."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
from importlib import metadata
from typing import Any

from swathe.errors import SwatheError

_LIBRARIES = ("numpy", "rasterio", "pyogrio", "pyproj", "shapely", "matplotlib", "typer", "rich", "pydantic")

#: Libraries that one can do without, and what they are for.
_EXTRAS = {"psycopg": "for stores in PostGIS: `--store postgresql://...`; pip install 'swathe[postgis]'"}

#: Programs that one can do without, and what is missing then.
_OPTIONAL = {
    "grass": "for grass: maps; apt-get install --no-install-recommends grass-core",
    "gdaldem": "for tests; apt-get install gdal-bin",
    "chromium": "for tests; apt-get install chromium",
}


def examine(*, as_json: bool) -> int:
    """Print every check and return 0 when all that is needed is here, else 4."""
    from swathe.cli import say

    checks = [_core(), *(_library(name) for name in _LIBRARIES), _terrain(), _memory(), _folder()]
    checks += [_extra(name, purpose) for name, purpose in _EXTRAS.items()]
    for program, how in _OPTIONAL.items():
        found = shutil.which(program)
        checks.append({"name": program, "ok": True, "found": found or f"not here ({how})"})
    healthy = all(check["ok"] for check in checks)
    lines = [f"{'ok ' if check['ok'] else 'NO '} {check['name']:16} {check['found']}" for check in checks]
    lines.append("Everything that is needed is here." if healthy else "Run `make build` to mend what is marked NO.")
    answer = {"status": "done" if healthy else "error", "python": platform.python_version(), "checks": checks}
    if not healthy:
        answer |= {"kind": "doctor", "message": "A part is missing.", "remedy": "Run `make build`."}
    say.line(answer, "\n".join(lines), as_json=as_json)
    return 0 if healthy else 4


def _core() -> dict[str, Any]:
    try:
        core = importlib.import_module("swathe._core")
    except ImportError as error:
        return {"name": "compiled core", "ok": False, "found": str(error)}
    threads = os.environ.get("RAYON_NUM_THREADS") or os.cpu_count()
    return {"name": "compiled core", "ok": True, "found": f"{core.__version__}, {threads} threads"}


def _library(name: str) -> dict[str, Any]:
    try:
        return {"name": name, "ok": True, "found": metadata.version(name)}
    except metadata.PackageNotFoundError:
        return {"name": name, "ok": False, "found": "not installed"}


def _extra(name: str, purpose: str) -> dict[str, Any]:
    try:
        # Only trying shows whether the library that it is made of is there too.
        found = f"{importlib.import_module(name).__version__} ({purpose.partition(';')[0]})"
    except ImportError:
        found = f"not here ({purpose})"
    return {"name": name, "ok": True, "found": found}


def _terrain() -> dict[str, Any]:
    from swathe.io.elevation import open_elevation

    try:
        with open_elevation(["bundled:jacksboro"]) as source:
            geometry = source.frame.geometry
    except SwatheError as error:
        return {"name": "bundled terrain", "ok": False, "found": str(error)}
    return {"name": "bundled terrain", "ok": True, "found": f"{geometry.rows} x {geometry.columns} cells"}


def _memory() -> dict[str, Any]:
    from swathe.io.memory import BYTES_PER_CELL, available_bytes

    free = available_bytes()
    cells = free * 0.8 / BYTES_PER_CELL
    return {
        "name": "memory",
        "ok": True,
        "found": f"{free / 1e9:.1f} GB free, maps of up to {cells / 1e6:,.0f} million cells",
    }


def _folder() -> dict[str, Any]:
    writable = os.access(".", os.W_OK)
    return {
        "name": "this folder",
        "ok": True,
        "found": "can be written" if writable else "cannot be written; use --out",
    }
