"""A run's folder: everything is made beside it and appears in one step, the summary last."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swathe.errors import MissingFileError, OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator

SUMMARY = "summary.json"

#: The pictures of ``swathe figures`` in the order in which a reader meets them.
FIGURES = (
    "swarm-flow.png",
    "nest-flow.png",
    "height-map.png",
    "terrain-3d.png",
    "soil.png",
    "grid.png",
    "overlapping-grids.png",
    "grid-gain.png",
    "nests.png",
    "global-path.png",
)

#: The log of a drive: it alone grows in place, and is readable up to where it was cut.
RUN_LOG = "run.mcap"

#: The pictures of a drive in the order in which a reader meets them.
DRIVE_PICTURES = ("drive-map.png", "drive.gif", "drive-frames.png", "drive-profile.png")

#: Logs of the worst of many drives.
WORST_LOGS = tuple(f"worst-{number}.mcap" for number in range(1, 11))

#: Every file that a run may leave; a folder that holds anything else is not ours.
OUR_FILES = frozenset(
    {
        SUMMARY,
        RUN_LOG,
        "route.geojson",
        "drivable.geojson",
        "nests.geojson",
        "rank.tif",
        "map.png",
        "profile.png",
        "report.html",
        "animation.gif",
        "animation.html",
        *DRIVE_PICTURES,
        *WORST_LOGS,
        "trials.csv",
        "trials.png",
        "index.html",
        *FIGURES,
    }
)

_STAGING = ".swathe-part-"


def begin_log(out: Path) -> Path:
    """Make room for the log of a drive in ``out``, whose old summary no longer holds then, and return its path.

    Raises:
        OutputError: the folder cannot be written.
    """
    try:
        (out / SUMMARY).unlink(missing_ok=True)
    except OSError as error:
        raise _refusal(out, error) from error
    return out / RUN_LOG


def log_of(run: Path) -> Path:
    """Return the log of a drive, given its folder or the log itself.

    Raises:
        MissingFileError: there is none.
    """
    log = run / RUN_LOG if run.is_dir() else run
    if not log.is_file():
        raise MissingFileError(f"There is no log {log}.", f"Give a drive's folder or its {RUN_LOG}.")
    return log


def require_not_in(out: Path, log: Path) -> None:
    """Raise OutputError when ``out`` holds a log that is still to be read, or a link to it: a run would replace it."""
    try:
        if out.is_dir() and any(entry.is_file() and entry.samefile(log) for entry in out.iterdir()):
            raise OutputError(
                f"The folder {out} holds the log that is replayed, which the new drive would overwrite.",
                "Choose another folder with `--out`.",
            )
    except OSError as error:
        raise _refusal(out, error) from error


@contextmanager
def run_folder(out: Path, *, logs: bool = False) -> Iterator[Path]:
    """Give a new folder for a run's files; when the block ends well they replace those of ``out``.

    An error or Ctrl-C leaves ``out`` as it was. The old summary goes first and the new one comes last, so that a folder
    with a summary is always complete. A run that ``logs`` keeps the log that it writes into ``out`` itself.

    Raises:
        OutputError: ``out`` is not ours (holds files that no run makes), may not be written, or is full.
    """
    staging = out / f"{_STAGING}{os.getpid()}-{secrets.token_hex(4)}"
    made = _make(staging, out)
    try:
        yield staging
        _swap(staging, out, OUR_FILES - {RUN_LOG} if logs else OUR_FILES)
        made = []
    except OutputError as error:
        raise OutputError(error.message.replace(str(staging), str(out)), error.remedy) from error
    except OSError as error:
        if error.filename is not None and not Path(os.fsdecode(error.filename)).is_relative_to(out):
            raise  # it is about something else
        raise _refusal(out, error) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        _remove(made)


def _make(staging: Path, out: Path) -> list[Path]:
    """Make the staging folder and return the folders that had to be made for it, innermost first."""
    made: list[Path] = []
    try:
        require_ours(out)
        made = [folder for folder in (out, *out.parents) if not folder.exists()]
        staging.mkdir(parents=True)
    except OSError as error:
        _remove(made)
        raise _refusal(out, error) from error
    return made


def _remove(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # somebody else may have put something there
            folder.rmdir()


def require_ours(out: Path) -> None:
    """Raise OutputError when ``out`` is a file, or a folder with files that no run makes."""
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out} is a file, not a folder.", "Choose another folder with `--out`.")
    if not out.is_dir():
        return
    alien = sorted(
        entry.name for entry in out.iterdir() if entry.name not in OUR_FILES and not entry.name.startswith(_STAGING)
    )
    if alien:
        raise OutputError(
            f"The folder {out} holds {alien[0]}, which no run of Swathe made.",
            "Choose an empty folder, or one of an earlier run, with `--out`.",
        )
    present = sorted(entry.name for entry in out.iterdir())
    if SUMMARY in present and not _is_ours(out / SUMMARY):
        raise OutputError(
            f"The folder {out} holds a {SUMMARY} that is not ours.", "Choose another folder with `--out`."
        )
    # Without a summary only a run that was killed explains such files: one that left its staging folder or its log.
    if present and SUMMARY not in present and not any(name.startswith((_STAGING, RUN_LOG)) for name in present):
        raise OutputError(
            f"The folder {out} holds {present[0]} but no {SUMMARY} of a run.",
            "Choose an empty folder, or one of an earlier run, with `--out`.",
        )


def _is_ours(summary: Path) -> bool:
    try:
        content = json.loads(summary.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return False
    return isinstance(content, dict) and {"command", "version", "inputs"} <= content.keys()


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


def _swap(staging: Path, out: Path, replaced: frozenset[str]) -> None:
    """Put the files of ``staging`` in the place of those ``replaced`` in ``out``, or leave these as they are."""
    new = sorted((entry.name for entry in staging.iterdir()), key=lambda name: (name == SUMMARY, name))
    former = staging / "former"
    former.mkdir()
    try:
        for name in sorted(replaced, key=lambda name: (name != SUMMARY, name)):
            if (out / name).exists():
                (out / name).replace(former / name)
        for name in new:
            (staging / name).replace(out / name)
    except BaseException:  # Ctrl-C too
        for name in new:
            if not (staging / name).exists():
                (out / name).unlink(missing_ok=True)
        for entry in former.iterdir():
            entry.replace(out / entry.name)
        raise
    for left in _leftovers(out):
        shutil.rmtree(left, ignore_errors=True)


def _leftovers(out: Path) -> list[Path]:
    """Return what runs that were killed have left in ``out``."""
    return [entry for entry in out.iterdir() if entry.name.startswith(_STAGING) and not _is_running(entry.name)]


def _is_running(staging: str) -> bool:
    number = staging.removeprefix(_STAGING).partition("-")[0]
    try:
        os.kill(int(number), 0)
    except PermissionError:  # it runs, for somebody else
        return True
    except (OSError, ValueError, OverflowError):
        return False
    return True


def _refusal(out: Path, error: OSError) -> OutputError:
    return OutputError(
        f"The folder {out} cannot be written: {error.strerror or error}.",
        "Check permissions and free space, or choose another folder with `--out`.",
    )


def write_text(path: Path, text: str) -> None:
    """Write a text file into a staging folder, or raise OutputError (a full disk among others)."""
    try:
        # Names of files may hold what is no text; the escape is valid JSON.
        path.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")
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
