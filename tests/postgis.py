"""A throw-away PostgreSQL cluster with PostGIS, for tests: on a private socket, away again at the end.

PostgreSQL refuses to run as root, so that a test run as root starts it as the user ``postgres``.
"""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import requirement

if TYPE_CHECKING:
    from collections.abc import Iterator

PACKAGES = "postgresql-15-postgis-3 postgresql-15-postgis-3-scripts"
SUPERUSER = "postgres"
#: What the user ``guarded`` must show; every other user of the socket is trusted.
GUARDED, PASSWORD = "guarded", "open-sesame-4711"
TEMPLATE = "swathe_template"
QUICK = ("-F", "-c", "synchronous_commit=off", "-c", "full_page_writes=off")


class Cluster:
    """A running cluster. ``quick`` gives up safety against power cuts, which a test of speed or loss must not."""

    def __init__(self, binaries: Path, folder: Path, *, quick: bool = True) -> None:
        self._binaries = binaries
        self.folder = folder
        self._data = folder / "data"
        self._quick = quick
        self._numbers = count(1)
        self._user: dict[str, Any] = (
            {"user": SUPERUSER, "group": SUPERUSER, "extra_groups": []} if os.geteuid() == 0 else {}
        )
        if self._user:
            account = pwd.getpwnam(SUPERUSER)
            os.chown(folder, account.pw_uid, account.pw_gid)
        # The socket must be found by whoever runs the tests.
        folder.chmod(0o755)
        self._run("initdb", "-A", "trust", "-U", SUPERUSER, "--no-sync", "-E", "UTF8", "--locale=C", "-D", self._data)
        rules = f"local all {GUARDED} scram-sha-256\nlocal all all trust\n"
        hba = self._data / "pg_hba.conf"
        hba.write_text(rules, encoding="ascii")
        self.start()
        self._make_template()

    def _run(self, program: str, *arguments: object) -> None:
        command = [str(self._binaries / program), *map(str, arguments)]
        # Not a pipe: the server would hold it open for as long as it runs.
        with (self.folder / f"{program}.log").open("ab") as log:
            run = subprocess.run(
                command, cwd="/", stdin=subprocess.DEVNULL, stdout=log, stderr=log, check=False, **self._user
            )
        if run.returncode != 0:
            log_text = (self.folder / f"{program}.log").read_text(encoding="utf-8", errors="replace")
            raise RuntimeError(f"{program} ended with status {run.returncode}:\n{log_text[-2000:]}")

    def start(self) -> None:
        """Start the server and wait until it answers."""
        more = QUICK if self._quick else ()
        options = " ".join((*more, "-c", "listen_addresses=''", "-c", "max_connections=60", "-k", str(self.folder)))
        log = self._data / "server.log"
        self._run("pg_ctl", "-D", self._data, "-l", log, "-w", "-t", "60", "-o", options, "start")

    @property
    def pid(self) -> int:
        """The process of the server."""
        return int((self._data / "postmaster.pid").read_text(encoding="ascii").split()[0])

    @property
    def log(self) -> str:
        """What the server said so far."""
        return (self._data / "server.log").read_text(encoding="utf-8", errors="replace")

    def kill(self) -> None:
        """End the server at once, as a failing machine would, and wait until it is gone."""
        pid = self.pid
        os.kill(pid, signal.SIGQUIT)
        for _ in range(600):
            if not _lives(pid):
                return
            time.sleep(0.05)
        raise RuntimeError("The server does not end.")

    def is_running(self) -> bool:
        """Tell whether the server runs."""
        return (self._data / "postmaster.pid").exists() and _lives(self.pid)

    def url(self, database: str, user: str = SUPERUSER) -> str:
        """Return the address of a database."""
        return f"postgresql://{quote(user)}@/{quote(database)}?host={quote(str(self.folder), safe='')}"

    def connect(self, database: str = SUPERUSER, user: str = SUPERUSER) -> Any:
        """Return a connection that commits every statement."""
        import psycopg

        return psycopg.connect(self.url(database, user), autocommit=True)

    def _make_template(self) -> None:
        with self.connect() as connection:
            connection.execute(f"CREATE DATABASE {TEMPLATE}")
            connection.execute(f"CREATE ROLE {GUARDED} LOGIN PASSWORD '{PASSWORD}'")
        with self.connect(TEMPLATE) as connection:
            connection.execute("CREATE EXTENSION postgis")
            connection.execute("CREATE EXTENSION postgis_raster")

    def new_database(self, *, template: str = TEMPLATE) -> str:
        """Make a database with the extensions and return its name."""
        name = f"swathe_{next(self._numbers)}"
        with self.connect() as connection:
            connection.execute(f"CREATE DATABASE {name} TEMPLATE {template}")
        return name

    def drop(self, database: str) -> None:
        """Remove a database, whoever is still connected."""
        with self.connect() as connection:
            connection.execute(f"DROP DATABASE IF EXISTS {database} WITH (FORCE)")


def binaries() -> Path:
    """Return the folder of PostgreSQL's programs, PostGIS being there too, or end the test saying what to install."""
    remedy = f"Run: sudo apt-get install --no-install-recommends {PACKAGES}"
    config = shutil.which("pg_config")
    folder = share = None
    if config is not None:
        asked = subprocess.run([config, "--bindir", "--sharedir"], capture_output=True, text=True, check=True)
        folder, share = map(Path, asked.stdout.split("\n")[:2])
    if folder is None or not (folder / "initdb").exists():
        # Debian puts pg_config into a package of its own, and the programs beside their version.
        folder = max(Path("/usr/lib/postgresql").glob("*/bin/initdb"), default=Path("/none"), key=_version).parent
        share = Path("/usr/share/postgresql") / folder.parent.name
    if not (folder / "initdb").exists() or share is None:
        requirement.skip_or_fail("postgis", "PostgreSQL is not installed.", remedy)
    if not (share / "extension" / "postgis_raster.control").exists():
        requirement.skip_or_fail("postgis", "PostGIS is not installed.", remedy)
    return folder


def _lives(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    # In a container nobody may be there to bury it.
    return state != "Z"


def _version(initdb: Path) -> tuple[int, ...]:
    return tuple(int(part) for part in initdb.parent.parent.name.split(".") if part.isdigit())


@contextmanager
def running_cluster(*, quick: bool = True) -> Iterator[Cluster]:
    """Give a cluster of one's own and take it away at the end."""
    programs = binaries()
    # Not pytest's folders: under root nobody else may enter them, and a socket's path must be short.
    folder = Path(tempfile.mkdtemp(prefix="swathe-pg-"))
    cluster = None
    try:
        cluster = Cluster(programs, folder, quick=quick)
        yield cluster
    finally:
        if cluster is not None and cluster.is_running():
            cluster.kill()
        shutil.rmtree(folder, ignore_errors=True)


def read_with_gdal(cluster: Cluster, database: str, where: str, folder: Path) -> Path:
    """Let GDAL's own driver read rasters of a database and return the GeoTIFF that it made of them."""
    program, made = requirement.program("gdal", ("gdal_translate",), "gdal-bin"), folder / "seen.tif"
    name = f"PG:host={cluster.folder} dbname={database} user={SUPERUSER} {where}"
    subprocess.run([program, "-q", "-of", "GTiff", name, made], capture_output=True, text=True, check=True)
    return made
