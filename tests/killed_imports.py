"""Imports killed at random moments: what a store holds then, and whether the import goes on.

    python tests/killed_imports.py URL ROUNDS [SEED]

prints a table. Each round a child process replaces a layer and is killed (SIGKILL) after a random part of the time that
this takes; then the store is opened anew, must hold the old layer or the new one, and the same import is given again.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import stored
from swathe.grid import Window
from swathe.soil import SoilClass
from swathe.store import open_store

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

ROWS, COLUMNS, POLYGONS = 1100, 1300, 4000


def heights(version: int) -> NDArray[np.float32]:
    """Return one of two elevations."""
    row, column = np.mgrid[0:ROWS, 0:COLUMNS]
    made: NDArray[np.float32] = (1000 * version + row * 0.5 + np.sin(column / 9)).astype(np.float32)
    return made


def soils(version: int) -> list[Any]:
    """Return one of two soil maps."""
    kinds = [SoilClass.SAND, SoilClass.CLAY] if version else [SoilClass.ROCK, SoilClass.SILT]
    return [stored.polygon(stored.box(n // 60 * 10, n % 60 * 20, 9, 19), kinds[n % 2], cat=n) for n in range(POLYGONS)]


ELEVATIONS = [heights(0), heights(1)]
SOILS = [soils(0), soils(1)]
OF = ("a", "b")


def import_elevation(url: str, version: int) -> None:
    """Replace the elevation."""
    with (
        open_store(url) as store,
        store.begin_import("valley", "elevation", stored.provenance(OF[version]), details=stored.DETAILS) as session,
    ):
        if not session.is_current:
            for (row, column), tile in stored.tiles(ELEVATIONS[version]).items():
                if (row, column) not in session.have():
                    session.write_tile(row, column, tile)
            session.commit()


def import_soil(url: str, version: int) -> None:
    """Replace the soil map."""
    pieces = SOILS[version]
    batches = (pieces[n : n + 250] for n in range(0, POLYGONS, 250))
    with open_store(url) as store:
        store.write_soil_polygons("valley", batches, stored.provenance(OF[version]), details=stored.legend())


def file_readings(url: str, version: int) -> None:
    """File readings one by one, and tell of each that was accepted."""
    with open_store(url) as store:
        for n in range(40):
            name = f"{version}-{os.getpid()}-{n}"
            store.add_readings("valley", [stored.push(name, 5 + n, 5)])
            os.write(1, f"accepted {name}\n".encode())


def held_elevation(url: str) -> int | None:
    """Return which elevation a store holds, None for a mixture."""
    with open_store(url) as store:
        found = store.read_window("valley", "elevation", Window(0, 0, ROWS, COLUMNS))
        digest = store.region("valley").layers["elevation"].provenance.digest
    for version, whole in enumerate(ELEVATIONS):
        if np.array_equal(found, whole) and digest == stored.provenance(OF[version]).digest:
            return version
    return None


def held_soil(url: str) -> int | None:
    """Return which soil map a store holds, None for a mixture."""
    with open_store(url) as store:
        found = list(store.soil_polygons("valley"))
        digest = store.region("valley").layers["soil"].provenance.digest
    for version, pieces in enumerate(SOILS):
        if found == pieces and digest == stored.provenance(OF[version]).digest:
            return version
    return None


@dataclass(frozen=True)
class Outcome:
    """What one round came to."""

    what: str
    killed: bool
    held: str
    resumed: bool


def child(work: Callable[[str, int], None], url: str, version: int, kill_after_s: float | None) -> tuple[bool, float]:
    """Do work in a child process and return whether it was killed, and how long it lasted."""
    began = time.perf_counter()
    number = os.fork()
    if number == 0:
        code = 1
        try:
            work(url, version)
            code = 0
        finally:
            os._exit(code)
    ended, status = 0, 0
    if kill_after_s is not None:
        while not ended and time.perf_counter() < began + kill_after_s:
            ended, status = os.waitpid(number, os.WNOHANG)
            time.sleep(0.001)
        if not ended:
            os.kill(number, signal.SIGKILL)
    if not ended:
        _, status = os.waitpid(number, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) != 0:
        raise RuntimeError(f"{work.__name__} failed in the child")
    return os.WIFSIGNALED(status), time.perf_counter() - began


def rounds(url: str, count: int, seed: int = 0) -> list[Outcome]:
    """Kill so many imports of elevation, and as many of soil, and return what became of each."""
    with open_store(url, create=True) as store:
        store.create_region("valley", stored.frame(ROWS, COLUMNS))
    draw = random.Random(seed)
    outcomes = []
    for what, work, held in (
        ("elevation", import_elevation, held_elevation),
        ("soil", import_soil, held_soil),
    ):
        whole_s = min(child(work, url, version, None)[1] for version in (0, 1))
        now = 1
        for _ in range(count):
            new = 1 - now
            killed, lasted_s = child(work, url, new, draw.uniform(0, 1.2 * whole_s))
            if not killed:
                # Other work on the machine has ended: so long an import lasts now.
                whole_s = min(whole_s, lasted_s)
            found = held(url)
            word = {now: "old", new: "new"}.get(found, "mixture") if found is not None else "mixture"
            child(work, url, new, None)
            outcomes.append(Outcome(what, killed, word, held(url) == new))
            now = new
    return outcomes


def table(outcomes: list[Outcome]) -> str:
    """Return the outcomes as a table."""
    lines = ["| import of | killed | finished before | held the old | held the new | a mixture | went on to the new |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- |")
    for what in ("elevation", "soil"):
        own = [outcome for outcome in outcomes if outcome.what == what]
        held = Counter(outcome.held for outcome in own)
        killed, resumed = sum(outcome.killed for outcome in own), sum(outcome.resumed for outcome in own)
        cells = [what, killed, len(own) - killed, held["old"], held["new"], held["mixture"], resumed]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(rounds(sys.argv[1], int(sys.argv[2]), int((sys.argv + ["0"])[3]))))  # noqa: T201, RUF005
