"""A run's folder: everything is made beside it and appears in one step, the summary last."""

from __future__ import annotations

import json
import secrets
import shutil
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from swathe.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SUMMARY = "summary.json"

#: Every file that a run may leave; a folder that holds anything else is not ours.
OUR_FILES = frozenset(
    {SUMMARY, "route.geojson", "nests.geojson", "rank.tif", "map.png", "profile.png", "report.html"}
)

_STAGING = ".swathe-part-"


@contextmanager
def run_folder(out: Path) -> Iterator[Path]:
    """Give a new folder for a run's files; when the block ends well they replace those of ``out``.

    An error or Ctrl-C leaves ``out`` as it was. The old summary goes first and the new one comes last, so that a folder
    with a summary is always complete.

    Raises:
        OutputError: ``out`` is not ours (holds files that no run makes), may not be written, or is full.
    """
    existed = out.exists()
    try:
        require_ours(out)
        out.mkdir(parents=True, exist_ok=True)
        staging = out / f"{_STAGING}{secrets.token_hex(4)}"
        staging.mkdir()
    except OSError as error:
        raise _refusal(out, error) from error
    try:
        yield staging
        _swap(staging, out)
    except OSError as error:
        raise _refusal(out, error) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        if not existed:
            with suppress(OSError):
                out.rmdir()


def require_ours(out: Path) -> None:
    """Raise OutputError when ``out`` is a file, or a folder with files that no run makes."""
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out} is a file, not a folder.", "Choose another folder with `--out`.")
    if not out.is_dir():
        return
    alien = sorted(
        entry.name
        for entry in out.iterdir()
        if entry.name not in OUR_FILES and not entry.name.startswith(_STAGING)
    )
    if alien:
        raise OutputError(
            f"The folder {out} holds {alien[0]}, which no run of Swathe made.",
            "Choose an empty folder, or one of an earlier run, with `--out`.",
        )
    summary = out / SUMMARY
    if summary.exists():
        try:
            ours = "command" in json.loads(summary.read_text(encoding="utf-8"))
        except (ValueError, TypeError):
            ours = False
        if not ours:
            raise OutputError(
                f"The folder {out} holds a {SUMMARY} that is not ours.", "Choose another folder with `--out`."
            )


def require_ours_or_runs(out: Path, names: tuple[str, ...]) -> None:
    """Raise OutputError when ``out`` holds anything but folders of runs with these names."""
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out} is a file, not a folder.", "Choose another folder with `--out`.")
    alien = sorted(entry.name for entry in out.iterdir() if entry.name not in names) if out.is_dir() else []
    if alien:
        raise OutputError(
            f"The folder {out} holds {alien[0]}, which no demo of Swathe made.",
            "Choose an empty folder, or one of an earlier demo, with `--out`.",
        )


def _swap(staging: Path, out: Path) -> None:
    new = sorted(entry.name for entry in staging.iterdir())
    (out / SUMMARY).unlink(missing_ok=True)
    for name in OUR_FILES - set(new):
        (out / name).unlink(missing_ok=True)
    for name in sorted(new, key=lambda name: (name == SUMMARY, name)):
        (staging / name).replace(out / name)


def _refusal(out: Path, error: OSError) -> OutputError:
    return OutputError(
        f"The folder {out} cannot be written: {error.strerror or error}.",
        "Check permissions and free space, or choose another folder with `--out`.",
    )


def write_text(path: Path, text: str) -> None:
    """Write a text file into a staging folder, or raise OutputError (a full disk among others)."""
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise _refusal(path.parent.parent, error) from error


def to_json(value: object) -> str:
    """Return a value as readable JSON; numbers that are not finite become null, as JSON has none."""
    return json.dumps(finite(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def finite(value: Any) -> Any:  # noqa: ANN401 - JSON values are of any type
    """Return a JSON value with null in place of numbers that are not finite."""
    if isinstance(value, dict):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    if isinstance(value, float) and value - value != 0:
        return None
    return value
