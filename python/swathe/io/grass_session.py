"""Running GRASS without its windows: modules in a mapset, one after another, and what their failures mean."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from swathe.errors import GrassError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

INSTALL = "Install it with: sudo apt-get install --no-install-recommends grass-core"
# A session inside a session, and Python packages of this environment, would both be taken for GRASS's own.
FOREIGN = ("GISBASE", "GISDBASE", "GISRC", "LOCATION_NAME", "MAPSET", "PYTHONHOME", "PYTHONPATH", "VIRTUAL_ENV")
FOREIGN_PREFIXES = ("GRASS_", "WIND_")
# A password may stand in the connection that a map keeps.
PASSWORD = re.compile(r"(passw(?:or)?d\s*=\s*)('[^']*'|[^\s,;>&]+)|(://[^/\s:@]*:)([^@\s/]+)(?=@)", re.IGNORECASE)
# What GRASS 8 says, in the order in which it is looked for, and what it means.
MEANINGS: tuple[tuple[str, str, str], ...] = (
    (
        r"currently running GRASS|Concurrent use",
        "The mapset {mapset} is locked: somebody works in it.",
        "Close GRASS there, or name another mapset.",
    ),
    (
        r"too old to read|is not supported by this version",
        "{name} was written by a newer GRASS than the one installed here.",
        "Install that version, or export the map there as GeoTIFF or GeoPackage.",
    ),
    (
        r"Unable to open database|Connection failed|DBMI-\w+ driver error|Unable to describe table",
        "{name} keeps its attributes in a database that does not answer as it should: {detail}",
        "Start the server and check `db.connect`; a password belongs in PGPASSWORD or ~/.pgpass.",
    ),
    (
        r"\bPQ|PostGIS|PostgreSQL|OGR (?:layer|data)",
        "{name} lies in a database or file that cannot be opened: {detail}",
        "Start the server and check `v.external`; a password belongs in PGPASSWORD or ~/.pgpass.",
    ),
    (
        r"No space left|write error|[Ff]ailed to write",
        "There is no room for {name} in {work}.",
        "Make room, or set TMPDIR.",
    ),
    (
        r"topology|on level 2",
        "{name} has no valid topology.",
        "Build it in GRASS: v.build map={map}",
    ),
    (
        r"not (?:the )?owner|Permission denied|don't have permission|not allowed to (?:access|write)",
        "GRASS has no permission for {name}.",
        "Check who owns the mapset.",
    ),
    (
        r"[Pp]rojection of dataset|Coordinate reference system",
        "{name} lies in another coordinate reference system than the location.",
        "Name a location of its system, or a new one.",
    ),
)  # fmt: skip


def grass_program() -> str:
    """Return the program ``grass``. Raises GrassError when it is not installed."""
    found = shutil.which("grass")
    if found is None:
        raise GrassError("GRASS is not installed.", INSTALL)
    return found


def run_in(
    mapset: Path, commands: Sequence[Sequence[str]], name: str, work: Path, variables: Mapping[str, str] | None = None
) -> str:
    """Run modules in a mapset and return what they print; ``name`` is what they are about, ``work`` a folder of ours.

    ``variables``: of the surroundings, where the user has not set them.

    Raises:
        GrassError: GRASS is missing, a module failed or was killed; nothing of GRASS runs any more.
    """
    script = "\n".join(shlex.join(command) for command in commands)
    return call(
        ["--text", str(mapset), "--exec", "sh", "-e", "-c", script], name, work, mapset=mapset.name, variables=variables
    )


def call(
    words: Sequence[str], name: str, work: Path, *, mapset: str = "", variables: Mapping[str, str] | None = None
) -> str:
    """Run the program ``grass`` and return what it prints. Raises as ``run_in``."""
    program = grass_program()
    process = subprocess.Popen(  # noqa: S603 - words are quoted, and names were found in the location
        [program, *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        env={**(variables or {}), **_surroundings(work)},
        cwd=work,
        start_new_session=True,
    )
    try:
        printed, said = process.communicate()
    except BaseException:
        _end(process)
        raise
    if process.returncode != 0:
        raise _explained(process.returncode, said, name, mapset, work)
    return printed


def _end(process: subprocess.Popen[str]) -> None:
    """End GRASS and the modules that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def _surroundings(work: Path) -> dict[str, str]:
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in FOREIGN and not name.startswith(FOREIGN_PREFIXES)
    }
    own = str(Path(sys.executable).parent)
    kept["PATH"] = os.pathsep.join(part for part in kept.get("PATH", os.defpath).split(os.pathsep) if part != own)
    home = Path(kept.get("HOME", ""))
    # GRASS makes a folder of settings in its home, and stops when it cannot.
    if not kept.get("HOME") or not os.access(home, os.W_OK | os.X_OK):
        kept["HOME"] = str(work)
    kept.pop("LANGUAGE", None)
    return {
        **kept,
        "TMPDIR": str(work),
        "LC_ALL": "C.UTF-8",
        "GRASS_VERBOSE": "0",
        "GRASS_MESSAGE_FORMAT": "plain",
        "PGCONNECT_TIMEOUT": kept.get("PGCONNECT_TIMEOUT", "10"),
        # The same map gives the same bytes.
        "OGR_CURRENT_DATE": "1970-01-01T00:00:00.000Z",
    }


def _explained(code: int, said: str, name: str, mapset: str, work: Path) -> GrassError:
    number = -code if code < 0 else code - 128
    if code < 0 or code > 128:
        try:
            how = signal.Signals(number).name
        except ValueError:
            how = str(number)
        return GrassError(
            f"GRASS was killed ({how}) while it worked on {name}.",
            "If memory ran out, name a smaller part with ?region=; else run it again.",
        )
    words = scrubbed(" ".join(said.split()))
    detail = _detail(said)
    for pattern, message, remedy in MEANINGS:
        if re.search(pattern, words):
            facts = {"name": name, "mapset": mapset, "detail": detail, "work": work, "map": name.rpartition("/")[2]}
            return GrassError(message.format(**facts), remedy.format(**facts))
    return GrassError(
        f"GRASS cannot read {name}: {detail}",
        "The map is damaged, or written by a newer GRASS; check it with r.info or v.info.",
    )


def _detail(said: str) -> str:
    """Return the line of GRASS's words that says most, without secrets."""
    # GRASS breaks its lines at 80 signs and sets the rest in.
    whole = re.sub(r"\n {7,9}(?=\S)", " ", said)
    lines = [line.strip() for line in whole.splitlines() if line.strip()]
    telling = [line for line in lines if re.search(r"failed:|FATAL", line)]
    errors = [line for line in lines if line.startswith("ERROR")]
    best = (telling or errors or lines or ["it said nothing"])[0]
    words = scrubbed(best.removeprefix("ERROR:").strip())
    return words if words.endswith((".", "?", "!")) else f"{words}."


def scrubbed(text: str) -> str:
    """Return text without the passwords of database connections."""
    hidden = PASSWORD.sub(lambda found: (found[1] or found[3]) + "...", text)
    password = os.environ.get("PGPASSWORD")
    return hidden.replace(password, "...") if password and len(password) > 2 else hidden
