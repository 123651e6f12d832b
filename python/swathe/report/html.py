"""One self-contained HTML page about a run's folder: everything inlined, nothing loaded, no scripts."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swathe.errors import InputError, MissingFileError, UnreadableFileError
from swathe.export.folder import DRIVE_PICTURES, RUN_LOG
from swathe.report.output import replacing
from swathe.report.page import page

if TYPE_CHECKING:
    from swathe.episode import Event

_SIGNATURES = {".png": b"\x89PNG\r\n\x1a\n", ".gif": b"GIF89a"}


@dataclass(frozen=True)
class RunFolder:
    """What a run left behind; parts that it did not write are empty or None.

    ``events`` and ``cut`` are those of a drive's log, ``drive_base64`` its pictures by the names of their files.
    """

    summary: dict[str, Any]
    legs: tuple[dict[str, Any], ...] = ()
    nests: tuple[dict[str, Any], ...] = ()
    map_base64: str | None = None
    profile_base64: str | None = None
    events: tuple[Event, ...] = ()
    cut: str | None = None
    drive_base64: dict[str, str] = field(default_factory=dict)


def write_html(folder: Path | str, *, log: Path | None = None) -> Path:
    """Write ``report.html`` into a run's folder from its summary, route, nests and pictures, and return its path.

    ``log`` is the log of a drive where it is not in the folder. Only ``summary.json`` must be there. The page is
    written in one step and holds no time of writing, so that equal folders give equal pages.

    Raises:
        MissingFileError: the folder does not exist or holds no ``summary.json``.
        UnreadableFileError: a file of the folder is broken.
        OutputError: the page cannot be written.
    """
    root = Path(folder)
    text = page(read_run_folder(root, log))
    target = root / "report.html"
    with replacing(target) as stream:
        stream.write(text.encode("utf-8"))
    return target


def read_run_folder(folder: Path, log: Path | None = None) -> RunFolder:
    """Read a run's folder; ``log`` as in ``write_html``.

    Raises:
        MissingFileError, InputError, UnreadableFileError: as ``write_html``.
    """
    remedy = "Give a folder that a swathe command has written and completed."
    try:
        if not folder.exists():
            raise MissingFileError(f"The folder {folder} does not exist.", remedy)
        if not folder.is_dir():
            raise InputError(f"{folder} is not a folder.", remedy)
    except (OSError, ValueError) as error:
        raise InputError(f"The folder {folder} cannot be read: {error}.", remedy) from error
    summary = _read_json(folder / "summary.json")
    if summary is None:
        raise MissingFileError(f"The folder {folder} holds no summary.json, which marks a complete run.", remedy)
    if not isinstance(summary, dict):
        raise UnreadableFileError(f"{folder / 'summary.json'} is not a summary of a run.", remedy)
    from swathe.runlog import RunLog

    logged = folder / RUN_LOG if log is None else log
    drive = RunLog.read(logged) if logged.exists() else None
    pictures = {name: _read_picture(folder / name) for name in DRIVE_PICTURES}
    return RunFolder(
        summary=summary,
        legs=_properties(_read_json(folder / "route.geojson")),
        nests=_properties(_read_json(folder / "nests.geojson")),
        map_base64=_read_picture(folder / "map.png"),
        profile_base64=_read_picture(folder / "profile.png"),
        events=() if drive is None else tuple(drive.events),
        cut=None if drive is None else drive.cut,
        drive_base64={name: content for name, content in pictures.items() if content is not None},
    )


def _read_bytes(path: Path) -> bytes | None:
    """Return the content, or None where there is no such file."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UnreadableFileError(
            f"{path} cannot be read: {error.strerror or error}.", "Check the file and its permissions."
        ) from error


def _read_json(path: Path) -> object:
    content = _read_bytes(path)
    if content is None:
        return None
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:  # a decoding error is a ValueError
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise UnreadableFileError(f"{path} is not valid JSON: {reason}.", "Run the command again.") from error


def _properties(collection: object) -> tuple[dict[str, Any], ...]:
    """Return the properties of each feature of a GeoJSON collection, in order."""
    features = collection.get("features") if isinstance(collection, dict) else None
    if not isinstance(features, list):
        return ()
    found = (feature.get("properties") for feature in features if isinstance(feature, dict))
    return tuple(properties for properties in found if isinstance(properties, dict))


def _read_picture(path: Path) -> str | None:
    content = _read_bytes(path)
    if content is None:
        return None
    if not content.startswith(_SIGNATURES[path.suffix]):
        raise UnreadableFileError(f"{path} is not a {path.suffix[1:].upper()} picture.", "Run the command again.")
    return base64.b64encode(content).decode("ascii")
