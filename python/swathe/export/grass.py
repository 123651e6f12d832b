"""A run's maps in a GRASS location: ranks with colours and categories, elevation, nests and route with attributes.

A new location or mapset appears whole or not at all. In a mapset that exists the maps are made under other names and
renamed at the end; names that are taken are refused unless ``overwrite`` is asked for.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import tempfile
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swathe.errors import GrassError, InvalidParameterError, MissingFileError, OutputError, UnreadableFileError
from swathe.export.folder import SUMMARY
from swathe.grid import Window
from swathe.io.crs import same_crs
from swathe.io.elevation import open_elevation
from swathe.io.geopackage import write_features
from swathe.io.grass import maps_in, mapsets, require_location
from swathe.io.grass_session import call, run_in
from swathe.io.raster import read_frame, write_raster

if TYPE_CHECKING:
    from collections.abc import Iterator

    from swathe.config import TerrainRequest
    from swathe.io.crs import Frame

MAPSET = "swathe"
PREFIX = "swathe"
#: Vectors of a run: file, number of a feature, and whether it lies on the corners of cells.
VECTORS = {"nests": ("nest", True), "route": ("leg", False), "drivable": ("arc", False)}
_LEGAL_LOCATION = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*")
_LEGAL_MAPSET = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_LEGAL_PREFIX = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_NO_GO, _WORST, _BEST = 1, 2, 10


@dataclass(frozen=True, slots=True)
class GrassTarget:
    """Where maps go: into ``mapset`` of ``location``, either of which is made when it is not there.

    Maps are called ``prefix`` and what they show, such as ``swathe_rank``. ``overwrite``: replace maps of these names.
    """

    location: Path
    mapset: str = MAPSET
    prefix: str = PREFIX
    overwrite: bool = False


@dataclass(frozen=True, slots=True)
class _Layer:
    """A map that is to be made, from a file."""

    kind: str
    what: str
    file: Path


def export_grass(folder: Path | str, target: GrassTarget, *, terrain: TerrainRequest | None = None) -> dict[str, str]:
    """Write a run's maps into a GRASS location; return the full name of each map by what it shows.

    ``folder`` is that of a finished run. ``terrain``: the elevation as it was given to the run (the cells under its
    ranks are written); without it no elevation is written, because a run's folder holds none.

    Raises:
        GrassError: GRASS is missing, names are taken, the mapset is locked, the location's system is another.
        InputError: the run or the elevation cannot be read, or the location cannot be written.
    """
    run = Path(folder).expanduser()
    summary = _summary(run)
    location = Path(os.path.expanduser(target.location)).absolute()  # noqa: PTH111 - Path's fails on unknown users
    _require_names(target, location)
    with tempfile.TemporaryDirectory(prefix="swathe-grass-") as made:
        work = Path(made)
        layers = _layers(run, terrain, work)
        note = f"Swathe {summary.get('version')}, seed {summary.get('seed')}, vehicle {summary.get('vehicle')}"
        if not location.exists() or (location.is_dir() and not any(location.iterdir())):
            _into_new_location(location, target, layers, note, work)
        elif target.mapset not in _mapsets(location, layers):
            _into_new_mapset(location, target, layers, note, work)
        else:
            _into_mapset(location / target.mapset, target, layers, note, work)
    return {layer.what: f"{_name(target, layer)}@{target.mapset}" for layer in layers}


def _summary(run: Path) -> dict[str, Any]:
    path = run / SUMMARY
    try:
        summary: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise MissingFileError(f"{run} is not the folder of a finished run.", "Make one with `swathe plan`.") from error
    except (OSError, ValueError) as error:
        raise UnreadableFileError(f"{path} cannot be read.", "Make the run again.") from error
    return summary


def _require_names(target: GrassTarget, location: Path) -> None:
    if not _LEGAL_LOCATION.fullmatch(location.name) and not location.exists():
        raise InvalidParameterError(
            f"{location.name!r} is no name that GRASS allows for a location.", "Use letters, digits, _ and -."
        )
    if not _LEGAL_MAPSET.fullmatch(target.mapset):
        raise InvalidParameterError(f"{target.mapset!r} is no name of a mapset.", "Use letters, digits and _.")
    if not _LEGAL_PREFIX.fullmatch(target.prefix):
        raise InvalidParameterError(
            f"{target.prefix!r} cannot begin the names of maps.", "Use letters, digits and _, a letter first."
        )


def _layers(run: Path, terrain: TerrainRequest | None, work: Path) -> list[_Layer]:
    """Return the maps of a run as files that GRASS imports."""
    rank = run / "rank.tif"
    if not rank.is_file():
        raise MissingFileError(f"{run} has no rank.tif.", "Export the folder of `swathe plan` or `swathe nests`.")
    frame, colours = read_frame(rank)
    layers = [_Layer("raster", "rank", rank.resolve())]
    (work / "colours").write_text(
        "".join(f"{value} {red}:{green}:{blue}\n" for value, (red, green, blue, _) in colours.items() if value <= _BEST)
        or f"{_NO_GO} 0:0:0\n{_BEST} 255:255:255\n",
        encoding="ascii",
    )
    labels = {_NO_GO: "no-go", **{value: f"rank {value}" for value in range(_WORST, _BEST + 1)}}
    labels |= {_WORST: f"rank {_WORST}, worst", _BEST: f"rank {_BEST}, best"}
    (work / "categories").write_text("".join(f"{value}|{text}\n" for value, text in labels.items()), encoding="ascii")
    if terrain is not None and terrain.dem:
        layers.append(_Layer("raster", "elevation", _elevation(terrain, frame, work)))
    for what, (_, on_corners) in VECTORS.items():
        source = run / f"{what}.geojson"
        if not source.is_file():
            continue
        try:
            collection = json.loads(source.read_text(encoding="utf-8"))
            file = work / f"{what}.gpkg"
            if write_features(file, collection, frame, what, on_corners=on_corners):
                layers.append(_Layer("vector", what, file))
        except (KeyError, TypeError, ValueError) as error:
            raise UnreadableFileError(f"{source} is not one of a run's files.", "Make the run again.") from error
    return layers


def _elevation(terrain: TerrainRequest, ranks: Frame, work: Path) -> Path:
    """Write the elevation under the ranks to a file, on its own cells."""
    with open_elevation(
        terrain.dem, cell_size_m=terrain.cell_size_m, crs=terrain.crs, height_range_m=terrain.height_range_m
    ) as source:
        frame = source.frame
        if not same_crs(frame.crs_wkt, ranks.crs_wkt):
            raise InvalidParameterError(
                f"The elevation lies in {frame.name}, the run in {ranks.name}.",
                "Give the elevation, `--crs` and `--cell-size` as they were given to the run.",
            )
        cells, under = frame.geometry, ranks.geometry
        size = cells.cell_size_m
        top, left = (
            max(0, round((cells.north_m - under.north_m) / size)),
            max(0, round((under.west_m - cells.west_m) / size)),
        )
        bottom = min(cells.rows, round((cells.north_m - under.south_m) / size))
        right = min(cells.columns, round((under.east_m - cells.west_m) / size))
        if top >= bottom or left >= right:
            raise InvalidParameterError(
                f"{', '.join(source.names)} lies outside the run's map.", "Give the elevation of the run."
            )
        window = Window(top, left, bottom - top, right - left)
        path = work / "elevation.tif"
        write_raster(path, source.read(window), frame.window(window), nodata=float("nan"))
    return path


def _is_local(layers: list[_Layer]) -> bool:
    """Return whether the run has no coordinate reference system; its ranks come first."""
    return read_frame(layers[0].file)[0].crs_wkt is None


def _mapsets(location: Path, layers: list[_Layer]) -> list[str]:
    """Return the mapsets of a location that exists. Raises GrassError when only it or the run has a system."""
    require_location(location)
    has_system = (location / "PERMANENT" / "PROJ_INFO").is_file()
    if has_system == _is_local(layers):
        raise GrassError(
            f"The location {location.name} has {'a' if has_system else 'no'} coordinate reference system "
            f"and the run has {'none' if has_system else 'one'}.",
            "Name a new location.",
        )
    return mapsets(location)


def _name(target: GrassTarget, layer: _Layer) -> str:
    return f"{target.prefix}_{layer.what}"


def _commands(layers: list[_Layer], names: list[str], note: str, work: Path) -> list[list[str]]:
    """Return the modules that import the layers under names."""
    commands = []
    # A map without a coordinate reference system only comes into a location without one, which GRASS cannot compare.
    as_it_is = ["-o"] if _is_local(layers) else []
    for layer, name in zip(layers, names, strict=True):
        if layer.kind == "raster":
            commands.append(["r.in.gdal", *as_it_is, f"input={layer.file}", f"output={name}"])
            if layer.what == "rank":
                commands += [
                    ["r.colors", f"map={name}", f"rules={work / 'colours'}"],
                    ["r.category", f"map={name}", "separator=pipe", f"rules={work / 'categories'}"],
                ]
            commands.append(["r.support", f"map={name}", f"title={layer.what}", f"source1={note}"])
        else:
            key = VECTORS[layer.what][0]
            commands += [
                ["v.in.ogr", *as_it_is, f"input={layer.file}", f"layer={layer.what}", f"output={name}", f"key={key}"],
                ["v.support", "-r", f"map={name}", f"map_name={layer.what}", f"comment={note}"],
            ]
    return commands


def _into_new_location(location: Path, target: GrassTarget, layers: list[_Layer], note: str, work: Path) -> None:
    with _beside(location) as part:
        staged = part / location.name
        ranks = layers[0].file
        like = "XY" if _is_local(layers) else str(ranks)
        call(["--text", "-c", like, "-e", str(staged)], str(location), work)
        names = [_name(target, layer) for layer in layers]
        mapset = staged / target.mapset
        if not mapset.is_dir():
            call(["--text", "-c", "-e", str(mapset)], str(location), work)
        # What is opened later begins on the map.
        commands = _commands(layers, names, note, work)
        run_in(mapset, [*commands, ["g.region", f"raster={names[0]}"]], str(location), work)
        if location.exists():
            location.rmdir()
        staged.rename(location)


def _into_new_mapset(location: Path, target: GrassTarget, layers: list[_Layer], note: str, work: Path) -> None:
    _require_writable(location)
    staged = location / f"swathe_part_{os.getpid()}_{secrets.token_hex(4)}"
    try:
        call(["--text", "-c", "-e", str(staged)], str(location), work)
        names = [_name(target, layer) for layer in layers]
        commands = _commands(layers, names, note, work)
        run_in(staged, [*commands, ["g.region", f"raster={names[0]}"]], str(location), work)
        try:
            staged.rename(location / target.mapset)
        except OSError as error:
            raise OutputError(
                f"The mapset {target.mapset} cannot be made in {location}: {error.strerror}.", "Try again."
            ) from error
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def _into_mapset(mapset: Path, target: GrassTarget, layers: list[_Layer], note: str, work: Path) -> None:
    _require_writable(mapset)
    finals = [_name(target, layer) for layer in layers]
    taken = [
        name
        for layer, name in zip(layers, finals, strict=True)
        if not target.overwrite and name in maps_in(mapset, layer.kind)
    ]
    if taken:
        raise GrassError(
            f"The mapset {target.mapset} of {mapset.parent.name} has {', '.join(taken)} already.",
            "Choose another `--prefix` or `--mapset`, or replace them with `--overwrite`.",
        )
    token = f"swathe_part_{secrets.token_hex(4)}"
    names = [f"{token}_{layer.what}" for layer in layers]
    renames = [
        ["g.rename", "--overwrite", f"{layer.kind}={name},{final}"]
        for layer, name, final in zip(layers, names, finals, strict=True)
    ]
    shown = f"{mapset.parent.name}/{mapset.name}"
    try:
        run_in(mapset, [*_commands(layers, names, note, work), *renames], shown, work)
    except BaseException:
        with suppress(GrassError):
            kinds = [["g.remove", "-f", f"type={kind}", f"pattern={token}_*"] for kind in ("raster", "vector")]
            run_in(mapset, kinds, shown, work)
        raise


def _require_writable(folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{folder} cannot be written: Permission denied.", "Check who owns the location.")


@contextmanager
def _beside(location: Path) -> Iterator[Path]:
    """Give a folder on the same disk as a location that is to be made, away again at the end."""
    if not location.parent.is_dir():
        raise OutputError(f"The folder {location.parent} does not exist.", "Make it, or choose another `--location`.")
    try:
        part = Path(tempfile.mkdtemp(prefix=f".{location.name}-", suffix=".part", dir=location.parent))
    except OSError as error:
        raise OutputError(f"{location} cannot be written: {error.strerror}.", "Choose another `--location`.") from error
    try:
        yield part
    except OSError as error:
        raise OutputError(f"{location} cannot be written: {error.strerror}.", "Choose another `--location`.") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
