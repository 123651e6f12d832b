"""What a user may name as an input.

A file, a folder, a glob pattern, an http(s) address, ``bundled:NAME``, ``grass:MAP``, or a table ``postgresql:...``.
"""

from __future__ import annotations

import glob
import hashlib
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from urllib.parse import urlsplit, urlunsplit

from swathe.errors import InputError, InvalidParameterError, MissingFileError, UnreadableFileError

if TYPE_CHECKING:
    from collections.abc import Sequence

# Endings that are taken as rasters when a folder is named.
RASTER_SUFFIXES = (
    ".asc", ".bil", ".dem", ".dt0", ".dt1", ".dt2", ".flt", ".grd", ".hgt", ".hgt.zip", ".img", ".jp2", ".nc", ".png",
    ".sdat", ".tif", ".tiff", ".vrt",
)  # fmt: skip
# GDAL settings for addresses: never list the folder that a file lies in, and give up on a silent server.
REMOTE_SETTINGS = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_HTTP_CONNECTTIMEOUT": "15",
    "GDAL_HTTP_TIMEOUT": "60",
    "GDAL_HTTP_MAX_RETRY": "2",
    "GDAL_HTTP_RETRY_DELAY": "1",
}
BUNDLED_PREFIX = "bundled:"
GRASS_PREFIX = "grass:"
TABLE_PREFIXES = ("postgresql://", "postgres://")
HASH_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Source:
    """One input. ``name`` is fit to be shown and kept in outputs; ``path`` is what GDAL opens.

    ``keeper`` holds what the path needs to exist, such as a temporary file; ``sha256`` is that of what was fetched into
    it, where the bytes of the file would differ from time to time.
    """

    name: str
    path: str
    is_remote: bool = False
    keeper: object = field(default=None, repr=False, compare=False)
    sha256: str = ""

    def fingerprint(self) -> str:
        """Return the SHA-256 of the file's bytes, or the word ``remote`` for what is not a local file."""
        if self.sha256:
            return self.sha256
        path = Path(self.path)
        if self.is_remote or not path.is_file():
            return "remote"
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while chunk := file.read(HASH_CHUNK_BYTES):
                digest.update(chunk)
        return digest.hexdigest()

    def refusal(self, error: Exception) -> InputError:
        """Return the plain error for what GDAL or OGR said when it could not read this source."""
        detail = str(error.__cause__ or error)
        if not self.is_remote:
            if Path(self.path).is_file() and not os.access(self.path, os.R_OK):
                return UnreadableFileError(f"{self.name} may not be read.", "Check its permissions.")
            return UnreadableFileError(
                f"{self.name} cannot be read: it is damaged, cut short, or of an unknown format.",
                "Check the file, or fetch it again.",
            )
        if "404" in detail:
            return MissingFileError(f"{self.name} does not exist on its server.", "Check the address.")
        if "ange" in detail and "upport" in detail:  # Range downloading not supported
            return UnreadableFileError(
                f"The server of {self.name} cannot send parts of a file.", "Download the file and name the copy."
            )
        return UnreadableFileError(
            f"{self.name} cannot be read from its server.", "Check the address and the network, or name a local copy."
        )


@dataclass(frozen=True, slots=True)
class RecordedSource(Source):
    """An input that was read earlier and is known by name and content alone."""

    sha256: str = ""

    def fingerprint(self) -> str:
        """Return the SHA-256 that the file had."""
        return self.sha256


def expand(names: Sequence[str]) -> list[Source]:
    """Return every input that the given names stand for, in order, each once.

    Raises MissingFileError for what does not exist, UnreadableFileError for an empty file and a folder without rasters.
    """
    if isinstance(names, str) or not names:
        raise InvalidParameterError("No elevation was named.", "Give a sequence of at least one path.")
    found: dict[str, Source] = {}
    for name in names:
        for source in _expand_one(str(name), "raster"):
            found.setdefault(source.path, source)
    shown = [source.name for source in found.values()]
    # Files of one name in several folders are told apart by their paths.
    return [
        source if shown.count(source.name) == 1 or source.keeper else replace(source, name=source.path)
        for source in found.values()
    ]


def single(name: str) -> Source:
    """Return the one input that ``name`` stands for. Raises as ``expand`` and when it stands for several."""
    sources = _expand_one(name)
    if len(sources) != 1:
        raise UnreadableFileError(f"{name} holds {len(sources)} files, where one is needed.", "Name one of them.")
    return sources[0]


def _expand_one(name: str, kind: Literal["raster", "vector"] | None = None) -> list[Source]:
    if name.startswith((GRASS_PREFIX, *TABLE_PREFIXES)):
        return [_kept_elsewhere(name, kind)]
    if name.lower().startswith(("http://", "https://")):
        parts = urlsplit(name)
        # A signed address carries its password in the query: that stays out of everything we write.
        shown = urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))
        return [Source(shown, f"/vsicurl/{name}", is_remote=True)]
    if name.startswith((BUNDLED_PREFIX, "/vsi")):
        return [Source(name, name, is_remote=name.startswith("/vsi"))]
    # Not Path.expanduser, which fails on a user that does not exist.
    path = Path(os.path.expanduser(name))  # noqa: PTH111
    if path.is_dir():
        return _folder(path)
    if path.exists():
        return [_file(path)]
    if glob.has_magic(name):
        # Path.glob takes no absolute patterns.
        matches = sorted(Path(match) for match in glob.glob(str(path), recursive=True))  # noqa: PTH207
        files = [match for match in matches if match.is_file()]
        if not files:
            raise MissingFileError(f"No file matches {name}.", "Check the pattern.")
        return [_file(match) for match in files]
    if ":" in name and not path.parent.is_dir():  # a GDAL name such as NETCDF:"file.nc":height
        return [Source(name, name)]
    raise MissingFileError(f"{name} does not exist.", "Check the path.")


def _kept_elsewhere(name: str, kind: Literal["raster", "vector"] | None) -> Source:
    """Return what another program keeps."""
    if name.startswith(GRASS_PREFIX):
        from swathe.io.grass import fetch, find_map

        place = find_map(name, kind)
        exported = fetch(place)
        return Source(place.shown, str(exported.path), keeper=exported)
    if kind == "raster":
        raise InvalidParameterError("A table in PostgreSQL is no elevation.", "Name it as `--soil`.")
    from swathe.io.table import table_address

    return Source(table_address(name).shown, name, is_remote=True)


def _file(path: Path) -> Source:
    if path.stat().st_size == 0:
        raise UnreadableFileError(f"{path.name} is empty (0 bytes).", "Fetch the file again.")
    return Source(path.name, str(path))


def _folder(path: Path) -> list[Source]:
    if (path / "hdr.adf").is_file():  # an Arc/Info binary grid is a folder
        return [Source(path.name, str(path / "hdr.adf"))]
    files = sorted(file for file in path.iterdir() if file.is_file() and file.name.lower().endswith(RASTER_SUFFIXES))
    if not files:
        raise MissingFileError(f"The folder {path} holds no raster.", "Name a folder of elevation tiles, or a file.")
    return [_file(file) for file in files]
