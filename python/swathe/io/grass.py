"""GRASS locations as inputs: ``grass:PATH/LOCATION/MAPSET/NAME`` or ``grass:PATH/LOCATION/NAME@MAPSET``.

A map is exported by GRASS itself, in a location of links that stands in a temporary folder: nothing is written into the
user's location, a mapset that somebody works in can be read, and a mask or region set there changes nothing. Rasters
come as GeoTIFF on their own cells, vectors as the areas of a GeoPackage with ``cat`` and the attributes beside it.
After the name may follow ``?region=NAME`` (a saved region, or ``current``), ``?layer=NUMBER`` and
``?type=raster|vector``, with ``&`` between.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import threading
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, NoReturn
from urllib.parse import parse_qsl
from weakref import WeakValueDictionary, finalize

from swathe.errors import GrassError
from swathe.io.grass_session import run_in

PREFIX = "grass:"
EXAMPLE = "Write grass:PATH/LOCATION/MAPSET/NAME or grass:PATH/LOCATION/NAME@MAPSET."
# Fast to write, and large maps fit; tiles let a plan read the part that it needs.
GEOTIFF = "TILED=YES,COMPRESS=ZSTD,ZSTD_LEVEL=1,BIGTIFF=IF_SAFER"
# GRASS's own null of whole numbers, so that it can never be a value.
NULL_CELL = -(2**31)
CURRENT_REGION = "current"
OPTIONS = ("region", "layer", "type")
PERMANENT = "PERMANENT"
# What a map says of the server that it lies on: libpq's words, with blanks or commas between.
CONNECTION = re.compile(r"\b(host|port|user)\s*=\s*(?:'([^']*)'|([^\s,;|']+))")

Kind = Literal["raster", "vector"]


@dataclass(frozen=True, slots=True)
class GrassMap:
    """A map that exists: ``folder`` is its mapset's; ``region`` and ``layer`` as the address says."""

    location: Path
    mapset: str
    name: str
    kind: Kind
    region: str | None = None
    layer: str = "1"

    @property
    def folder(self) -> Path:
        """The mapset's folder."""
        return self.location / self.mapset

    @property
    def full_name(self) -> str:
        """The name as GRASS qualifies it."""
        return f"{self.name}@{self.mapset}"

    @property
    def shown(self) -> str:
        """The name that outputs and messages carry."""
        return f"{PREFIX}{self.location.name}/{self.full_name}"

    def files(self) -> list[Path]:
        """Return the files that hold the map, sorted."""
        if self.kind == "vector":
            folders = [self.folder / "vector" / self.name, self.folder / "sqlite", self.folder / "dbf"]
            single: list[Path] = []
        else:
            folders = [self.folder / "cell_misc" / self.name]
            single = [self.folder / element / self.name for element in ("cell", "fcell", "cellhd", "cats")]
        inside = [path for folder in folders for path in listing(folder) if _is_file(path)]
        return sorted([path for path in single if _is_file(path)] + inside)


class Exported:
    """A map as a file that GDAL reads, for as long as somebody holds this."""

    def __init__(self, path: Path, stamp: object) -> None:
        self.path = path
        self.stamp = stamp
        finalize(self, shutil.rmtree, path.parent, ignore_errors=True)


_exports: WeakValueDictionary[GrassMap, Exported] = WeakValueDictionary()
_lock = threading.Lock()


def find_map(address: str, kind: Kind | None = None) -> GrassMap:
    """Return the map that an address names; ``kind`` is what is wanted when the name is that of a raster and a vector.

    Raises:
        GrassError: the location, mapset or map is not there (the nearest names are told), or may not be read.
    """
    path, _, query = address.removeprefix(PREFIX).partition("?")
    options = _options(address, query)
    # Not Path.expanduser, which fails on a user that does not exist.
    given = Path(os.path.expanduser(path))  # noqa: PTH111
    name, marked, mapset = given.name.rpartition("@")
    if marked:
        location = given.parent
    else:
        name, mapset, location = given.name, given.parent.name, given.parent.parent
    if not name or not mapset or location == given or "\0" in path:
        raise GrassError(f"{address} names no map.", EXAMPLE)
    location = location.absolute()
    require_location(location)
    if mapset not in (there := mapsets(location)):
        raise GrassError(f"The location {location.name} has no mapset {mapset!r}.", suggestion(mapset, there))
    kinds = {which: maps_in(location / mapset, which) for which in ("raster", "vector")}
    wanted = options.get("type") or kind
    found: list[Kind] = [which for which in kinds if name in kinds[which] and wanted in (None, which)]  # type: ignore[misc]
    if not found:
        _refuse_map(location, mapset, name, wanted, kinds)
    if len(found) > 1:
        raise GrassError(
            f"The mapset {mapset} has a raster and a vector {name!r}.", "Add ?type=raster or ?type=vector to the name."
        )
    if (out_of_place := "layer" if found[0] == "raster" else "region") in options:
        raise GrassError(
            f"{address} is a {found[0]}, for which there is no {out_of_place}.", f"Leave out {out_of_place}."
        )
    return GrassMap(location, mapset, name, found[0], options.get("region"), options.get("layer", "1"))


def fetch(place: GrassMap) -> Exported:
    """Return a map as a file; the same file while somebody holds it and the map has not changed.

    Raises:
        GrassError: GRASS is missing, cannot read the map, or was killed.
    """
    with _lock:
        stamp = _stamp(place)
        known = _exports.get(place)
        if known is None or known.stamp != stamp:
            known = _exports[place] = _export(place, stamp)
        return known


def require_location(location: Path) -> None:
    """Raise GrassError when a folder is no GRASS location."""
    if not listing(location):
        siblings = [path.name for path in listing(location.parent) if _is_location(path)]
        raise GrassError(f"The GRASS location {location} does not exist.", suggestion(location.name, siblings, EXAMPLE))
    if not _is_location(location):
        inside = [path.name for path in listing(location) if _is_location(path)]
        remedy = f"It holds the locations {', '.join(inside[:5])}. {EXAMPLE}" if inside else EXAMPLE
        raise GrassError(f"{location} is not a GRASS location.", remedy)


def mapsets(location: Path) -> list[str]:
    """Return the names of a location's mapsets."""
    return [path.name for path in listing(location) if _is_file(path / "WIND")]


def maps_in(mapset: Path, kind: str) -> list[str]:
    """Return the names of the rasters or vectors of a mapset."""
    folder = mapset / ("cellhd" if kind == "raster" else "vector")
    return [path.name for path in listing(folder) if kind == "raster" or _is_file(path / "head")]


def suggestion(name: str, there: list[str], otherwise: str = "") -> str:
    """Return what to try in place of a name that is not there."""
    near = get_close_matches(name, there, 3) or get_close_matches(name.lower(), there, 3)
    if near:
        return f"Did you mean {' or '.join(near)}?"
    return f"There are {', '.join(there[:8])}{', ...' if len(there) > 8 else ''}." if there else otherwise


def listing(folder: Path) -> list[Path]:
    """Return what a folder holds, sorted; nothing when it does not exist. Raises GrassError when it may not be read."""
    try:
        return sorted(folder.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise GrassError(f"{folder} may not be read: {error.strerror}.", "Check its permissions.") from error


def _is_location(folder: Path) -> bool:
    return _is_file(folder / PERMANENT / "DEFAULT_WIND")


def _is_file(path: Path) -> bool:
    """Return whether a file is there for us: a location may have mapsets that others keep to themselves."""
    try:
        return path.is_file()
    except PermissionError:
        return False


def _options(address: str, query: str) -> dict[str, str]:
    options = dict(parse_qsl(query, keep_blank_values=True))
    for name, value in options.items():
        if name not in OPTIONS or not value:
            raise GrassError(f"{address} has an option {name!r} that is not known.", f"Use {', '.join(OPTIONS)}.")
    if options.get("type") not in (None, "raster", "vector"):
        raise GrassError(f"{address} asks for the type {options['type']!r}.", "Use raster or vector.")
    return options


def _refuse_map(location: Path, mapset: str, name: str, kind: str | None, kinds: dict[str, list[str]]) -> NoReturn:
    other = next((which for which in kinds if which != kind and name in kinds[which]), None)
    if other is not None:
        raise GrassError(f"{name}@{mapset} in {location.name} is a {other}, where a {kind} is needed.", "Name another.")
    what = "map" if kind is None else kind
    wanted = [kind] if kind else list(kinds)
    elsewhere = [
        f"{name}@{one}" for one in mapsets(location) if any(name in maps_in(location / one, which) for which in wanted)
    ]
    near = suggestion(name, [one for which in wanted for one in kinds[which]], f"The mapset has no {what}s.")
    raise GrassError(
        f"The mapset {mapset} of {location.name} has no {what} {name!r}.",
        f"There is {', '.join(elsewhere)}." if elsewhere else near,
    )


def _stamp(place: GrassMap) -> tuple[tuple[str, int, int], ...]:
    """Return what changes when a map does, as far as files tell."""
    stamp = []
    try:
        for path in place.files():
            with path.open("rb"):
                pass  # GRASS would say less clearly that it may not
            status = path.stat()
            stamp.append((str(path), status.st_mtime_ns, status.st_size))
    except PermissionError as error:
        raise GrassError(f"{place.shown} may not be read: {error.strerror}.", "Check its permissions.") from error
    except OSError as error:
        raise GrassError(f"{place.shown} cannot be read: {error.strerror}.", "Check the location.") from error
    return tuple(stamp)


def _export(place: GrassMap, stamp: object) -> Exported:
    work = Path(tempfile.mkdtemp(prefix="swathe-grass-"))
    try:
        here = _linked(place, work)
        result = work / f"{place.name}{'.tif' if place.kind == 'raster' else '.gpkg'}"
        commands = _raster_commands(place, result) if place.kind == "raster" else _vector_commands(place, result)
        run_in(here, commands, place.shown, work, _server(place))
        _require_content(result, place)
        shutil.rmtree(here.parent)
        return Exported(result, stamp)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        raise


def _require_content(result: Path, place: GrassMap) -> None:
    import pyogrio

    if place.kind == "vector" and not (result.is_file() and pyogrio.read_info(result)["features"]):
        raise GrassError(
            f"{place.shown} holds no areas with a category in layer {place.layer}.",
            "Name a vector of areas, a raster, or another layer with ?layer=NUMBER.",
        )


def _server(place: GrassMap) -> dict[str, str]:
    """Return how PostgreSQL's library finds the server of a vector that lies there or has its attributes there.

    GRASS itself takes host, port and user of attributes from `db.login` alone.
    """
    told: dict[str, str] = {}
    for name in ("frmt", "dbln"):
        try:
            text = (place.folder / "vector" / place.name / name).read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        for line in text.splitlines():
            if name == "frmt" or line.endswith("|pg"):
                for key, quoted, plain in CONNECTION.findall(line):
                    told.setdefault(f"PG{key.upper()}", quoted or plain)
    return told


def _linked(place: GrassMap, work: Path) -> Path:
    """Make a location of links to the mapsets of the map's, with a mapset of its own, and return that."""
    location = work / place.location.name
    location.mkdir()
    own = "swathe"
    for name in mapsets(place.location):
        (location / name).symlink_to(place.location / name, target_is_directory=True)
        own += "_" if name == own else ""
    here = location / own
    here.mkdir()
    window = place.folder / "WIND" if place.region == CURRENT_REGION else place.location / PERMANENT / "DEFAULT_WIND"
    try:
        shutil.copyfile(window, here / "WIND")
    except OSError as error:
        raise GrassError(f"{place.location} cannot be read: {error.strerror}.", "Check its permissions.") from error
    return here


def _raster_commands(place: GrassMap, result: Path) -> list[list[str]]:
    region = ["g.region", f"raster={place.full_name}"]
    if place.region is not None:
        if place.region != CURRENT_REGION and place.region not in (
            saved := [path.name for path in listing(place.folder / "windows")]
        ):
            raise GrassError(
                f"The mapset {place.mapset} has no saved region {place.region!r}.",
                suggestion(place.region, saved, f"Save one with g.region, or use {CURRENT_REGION}."),
            )
        region = ["g.region", f"align={place.full_name}"]
        if place.region != CURRENT_REGION:
            region.append(f"region={place.region}@{place.mapset}")
    kind, nodata = _cell_kind(place)
    export = ["r.out.gdal", "-c", f"input={place.full_name}", f"output={result}", "format=GTiff"]
    export += [f"type={kind}", f"nodata={nodata}", f"createopt={GEOTIFF}"]
    # The names of categories go beside the file, where a legend is looked for.
    return [region, [*export, "-t"] if kind == "Int32" else export]


def _cell_kind(place: GrassMap) -> tuple[str, str]:
    """Return GDAL's name of a raster's type of cell, and the number that stands for null."""
    try:
        text = (place.folder / "cell_misc" / place.name / "f_format").read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return "Int32", str(NULL_CELL)
    return ("Float64" if "double" in text else "Float32"), "nan"


def _vector_commands(place: GrassMap, result: Path) -> list[list[str]]:
    # Columns of the user's may be called fid and geom, GeoPackage's own names for its own.
    names = "lco=FID=swathe_fid,GEOMETRY_NAME=swathe_geometry"
    export = ["v.out.ogr", f"input={place.full_name}", f"layer={place.layer}", "type=area", f"output={result}"]
    return [[*export, "format=GPKG", f"output_layer={place.name}", names]]
