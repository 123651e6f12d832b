"""What tests need from outside this repository, and whether its absence is a skip or a failure.

``SWATHE_REQUIRE`` names what must be there: ``all``, or some of ``browser``, ``data``, ``gdal``, ``git``, ``grass`` and
``postgis`` with commas between. What is named and missing fails the test; what is only missing skips it, with the line
that would help.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import NoReturn

import pytest

ROOT = Path(__file__).resolve().parent.parent
KNOWN = frozenset({"browser", "data", "gdal", "git", "grass", "postgis"})


def required_names(switch: str) -> frozenset[str]:
    """Return the names that ``switch`` (the text of SWATHE_REQUIRE) asks for; ValueError for a name nobody knows."""
    names = frozenset(word.strip() for word in switch.split(",") if word.strip())
    if names == {"all"}:
        return KNOWN
    unknown = sorted(names - KNOWN)
    if unknown:
        raise ValueError(
            f"SWATHE_REQUIRE names {', '.join(unknown)}. It may be: all, or some of {', '.join(sorted(KNOWN))}."
        )
    return names


def skip_or_fail(name: str, reason: str, remedy: str) -> NoReturn:
    """End the running test: as failed when SWATHE_REQUIRE asks for ``name``, else as skipped."""
    text = f"{reason} {remedy}"
    if name in required_names(os.environ.get("SWATHE_REQUIRE", "")):
        pytest.fail(f"{text} (SWATHE_REQUIRE asks for {name}.)", pytrace=False)
    pytest.skip(text)


def program(name: str, candidates: tuple[str, ...], package: str) -> Path:
    """Return the first of the programs ``candidates`` on the search path, or end the test saying what to install."""
    for candidate in candidates:
        found = shutil.which(candidate)
        if found:
            return Path(found)
    skip_or_fail(
        name, f"{candidates[0]} is not installed.", f"Run: sudo apt-get install --no-install-recommends {package}"
    )


def data_folder() -> Path:
    """Return the folder that SWATHE_DATA names (a relative one counts from the repository's root), or end the test."""
    named = os.environ.get("SWATHE_DATA", "")
    if not named:
        skip_or_fail("data", "SWATHE_DATA is not set.", "Set it to the folder with the real terrain.")
    folder = (ROOT / named).resolve()
    if not folder.is_dir():
        skip_or_fail("data", f"SWATHE_DATA names {named}, which is not a folder.", "Name the folder that holds dem/.")
    return folder
