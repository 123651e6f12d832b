"""Running the program as a user does: in a process of its own, or inside the test where that is enough."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import raster_files
from swathe import cli

if TYPE_CHECKING:
    from collections.abc import Mapping

PROGRAM = Path(sys.executable).with_name("swathe")

#: Every file of a plan with a route.
PLAN_FILES = {"map.png", "nests.geojson", "profile.png", "rank.tif", "report.html", "route.geojson", "summary.json"}

#: Points well inside ``raster_files.hills`` of 80 x 90 cells, easting,northing, in one nest.
START, GOAL = "740500,4049500", "742200,4048000"


@dataclass(frozen=True)
class Finished:
    """How a command ended and what it printed."""

    code: int
    out: str
    err: str

    @property
    def answer(self) -> dict[str, Any]:
        """The one JSON object on stdout; nothing else may stand there."""
        answer = json.loads(self.out)
        assert isinstance(answer, dict)
        assert self.out.count("\n") == 1, "one object on one line"
        return answer


def environment(extra: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the variables of this process without what would change how text is laid out."""
    kept = {name: value for name, value in os.environ.items() if name not in {"COLUMNS", "NO_COLOR", "FORCE_COLOR"}}
    return {**kept, "NO_COLOR": "1", **(extra or {})}


def start(*words: str, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> subprocess.Popen[str]:
    """Start the program and leave it running."""
    return subprocess.Popen(
        [PROGRAM, *words],
        cwd=cwd,
        env=environment(env),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_interrupts,
    )


def hear_interrupts() -> None:
    """Undo what a shell does to programs in the background: they would ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def run(*words: str, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Finished:
    """Run the program in a process of its own."""
    done = subprocess.run([PROGRAM, *words], cwd=cwd, env=environment(env), capture_output=True, text=True, check=False)
    return Finished(done.returncode, done.stdout, done.stderr)


def run_here(capsys: pytest.CaptureFixture[str], *words: str) -> Finished:
    """Run the program inside this process, which is quicker."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        cli.main(list(words))
    printed = capsys.readouterr()
    code = end.value.code
    assert isinstance(code, int)
    return Finished(code, printed.out, printed.err)


def hills(folder: Path, rows: int = 80, columns: int = 90) -> Path:
    """Write rolling hills of 30 m cells in UTM zone 16 and return the file."""
    return raster_files.write(folder / "hills.tif", raster_files.hills(rows, columns))


def way(dem: Path | str, *more: str, from_to: tuple[str, str] = (START, GOAL)) -> tuple[str, ...]:
    """Return the words of a plan over an elevation, with points in its own coordinates."""
    return (
        "plan", "--dem", str(dem), "--points-crs", "native", "--start", from_to[0], "--goal", from_to[1], *more
    )  # fmt: skip
