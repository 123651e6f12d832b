"""A PostgreSQL server with PostGIS as a child of the benchmark, so that its work counts with ours.

Its CPU seconds are those of a child once it has been stopped and waited for.
"""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote

_USER, _DATABASE = "postgres", "bench"
#: As a careful administrator would have them; acknowledged means on disk.
_SETTINGS = {"listen_addresses": "", "fsync": "on", "synchronous_commit": "on", "max_wal_size": "4GB"}


class Server:
    """A cluster of one's own with an empty database that has the extensions; it runs between ``start`` and ``stop``."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="swathe-bench-"))
        self._programs = _programs()
        self._as_user: dict[str, Any] = {}
        if os.geteuid() == 0:
            account = pwd.getpwnam(_USER)
            os.chown(self.folder, account.pw_uid, account.pw_gid)
            self._as_user = {"user": _USER, "group": _USER, "extra_groups": []}
        self.folder.chmod(0o755)
        self._process: subprocess.Popen[bytes] | None = None
        data = self.folder / "data"
        self._call("initdb", "-A", "trust", "-U", _USER, "--no-sync", "-E", "UTF8", "--locale=C", "-D", str(data))
        self.start()
        with self.connect("postgres") as connection:
            connection.execute(f"CREATE DATABASE {_DATABASE}")
        with self.connect() as connection:
            connection.execute("CREATE EXTENSION postgis")
            connection.execute("CREATE EXTENSION postgis_raster")

    @property
    def url(self) -> str:
        """The address of the database."""
        return f"postgresql://{_USER}@/{_DATABASE}?host={quote(str(self.folder), safe='')}"

    def connect(self, database: str = _DATABASE) -> Any:  # noqa: ANN401 - psycopg is imported when it is needed
        """Return a connection that commits every statement."""
        import psycopg

        return psycopg.connect(host=str(self.folder), dbname=database, user=_USER, autocommit=True)

    def start(self) -> None:
        """Start the server and wait until it answers."""
        import psycopg

        options = [part for name, value in _SETTINGS.items() for part in ("-c", f"{name}={value}")]
        command = [str(self._programs / "postgres"), "-D", str(self.folder / "data"), "-k", str(self.folder), *options]
        with (self.folder / "server.log").open("ab") as log:
            self._process = subprocess.Popen(command, cwd="/", stdout=log, stderr=log, **self._as_user)
        for _ in range(600):
            try:
                self.connect("postgres").close()
            except psycopg.OperationalError:
                time.sleep(0.05)
            else:
                return
        raise RuntimeError("The server does not start.")

    def stop(self) -> None:
        """Stop the server, everything on disk."""
        if self._process is not None:
            self._process.send_signal(signal.SIGINT)
            self._process.wait()
            self._process = None

    def restart(self) -> None:
        """Stop and start, so that what was done before does not count."""
        self.stop()
        self.start()

    def remove(self) -> None:
        """Stop the server and remove all that it kept."""
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _call(self, program: str, *arguments: str) -> None:
        command = [str(self._programs / program), *arguments]
        subprocess.run(command, cwd="/", check=True, stdout=subprocess.DEVNULL, **self._as_user)


def _programs() -> Path:
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not found:
        raise RuntimeError(
            "PostGIS is not installed: sudo apt-get install --no-install-recommends postgresql-15-postgis-3 "
            "postgresql-15-postgis-3-scripts postgis"
        )
    return found[-1].parent
