"""The connection to a PostgreSQL server, and what its refusals mean to a user.

Passwords come from ``PGPASSWORD``, ``~/.pgpass`` or a service file, where libpq finds them by itself; none passes
through this program, so that none can be shown or logged.
"""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import psycopg
from psycopg import errors as refusals
from psycopg.conninfo import conninfo_to_dict

from swathe.errors import (
    InvalidParameterError,
    MissingRegionError,
    StoreBusyError,
    StoreDamagedError,
    StoreError,
    StoreFullError,
    StoreReadOnlyError,
    StoreSchemaError,
    StoreUnavailableError,
    SwatheError,
)
from swathe.store.queries import query

if TYPE_CHECKING:
    from collections.abc import Iterator

    Connection = psycopg.Connection[tuple[Any, ...]]

SCHEMA = "swathe"
#: Seconds after which a connection that lay idle is tried before it is used.
_TRUSTED_S = 5.0
#: How long a question may take where the user has set no limit; who writes a layer may need longer.
_ANSWER_WITHIN, _NO_LIMIT = "120s", "0"
#: A server that falls silent is noticed within two minutes.
_LIBPQ_DEFAULTS = {
    "application_name": "swathe",
    "connect_timeout": "10",
    "keepalives_idle": "30",
    "keepalives_interval": "10",
    "keepalives_count": "3",
    "tcp_user_timeout": "60000",
}


class Server:
    """A database of a server. ``address`` is fit to be shown.

    Raises:
        InvalidParameterError: the address is none, or holds a password.
    """

    def __init__(self, url: str) -> None:
        self._conninfo = _parsed(url)
        self.address = _shown(self._conninfo)
        self._connection: Connection | None = None
        self._used_at = 0.0
        self._lock = threading.RLock()

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
            self._connection = None

    def connect(self, *, patient: bool = False) -> Connection:
        """Return a connection of one's own that commits every statement by itself; ``patient`` for long work.

        Raises:
            StoreError: the server cannot be reached or lets nobody in.
        """
        try:
            connection = psycopg.connect("", autocommit=True, **self._conninfo)
        except psycopg.Error as error:
            # Its text may come from anywhere, so that nothing of it is kept but what it means.
            raise self._closed_door(error) from None
        try:
            connection.execute(query("begin_session"), (_NO_LIMIT if patient else _ANSWER_WITHIN,))
        except psycopg.Error as error:
            connection.close()
            raise self.meaning(error) from error
        return connection

    @contextmanager
    def use(self) -> Iterator[Connection]:
        """Give the connection that all share, one user at a time, opened anew where it was lost meanwhile."""
        with self._lock:
            connection = self._living()
            with self.told(connection):
                yield connection
            self._used_at = time.monotonic()

    @contextmanager
    def told(self, connection: Connection | None = None) -> Iterator[None]:
        """Turn what the server refuses into errors that say what to do."""
        try:
            yield
        except psycopg.Error as error:
            raise self.meaning(error, connection) from error

    def _living(self) -> Connection:
        connection = self._connection
        idle = time.monotonic() - self._used_at > _TRUSTED_S
        if connection is not None and not connection.closed and idle:
            try:
                connection.execute("")
            except psycopg.Error:
                connection.close()
        if connection is None or connection.closed:
            connection = self._connection = self.connect()
        return connection

    def _closed_door(self, error: psycopg.Error) -> StoreError:
        """Return why there is no connection; libpq tells it in words alone."""
        text = str(error).lower()
        user = self._conninfo.get("user", "")
        who = f"the user {user}" if user else "you"
        if "password" in text or "authentication failed" in text or "pg_hba" in text:
            return StoreUnavailableError(
                f"{self.address} does not let {who} in.",
                "Check the user's name, and the password in PGPASSWORD or ~/.pgpass (which nobody else may read).",
            )
        if "does not exist" in text and "role" in text:
            return StoreUnavailableError(
                f"{self.address} does not know {who}.", "Name a user in the address: postgresql://USER@HOST/DATABASE."
            )
        if "does not exist" in text and "database" in text:
            return StoreUnavailableError(
                f"There is no database {self.address}.", "Make it with `createdb`, or check the name."
            )
        if "too many" in text or "remaining connection slots" in text:
            return StoreBusyError(f"{self.address} has no connection left.", "Try again later.")
        return StoreUnavailableError(
            f"{self.address} does not answer.", "Check that the server runs, its host and port, and the network."
        )

    def meaning(self, error: psycopg.Error, connection: Connection | None = None) -> SwatheError:
        """Return what an error of the server means, with what to do about it."""
        said = error.diag.message_primary or type(error).__name__
        lost = connection is not None and connection.broken
        for kinds, make, message, remedy in _MEANINGS:
            if isinstance(error, kinds):
                return make(message.format(address=self.address, said=said), remedy)
        if lost or (isinstance(error, psycopg.OperationalError) and error.sqlstate is None):
            return _lost(self.address)
        return StoreError(f"{self.address} refused: {said}.", "Check the server's log, or import the layer anew.")


def _lost(address: str) -> StoreUnavailableError:
    return StoreUnavailableError(
        f"{address} went away in the middle.", "Run the same command again: what was finished stands, the rest resumes."
    )


_TOO_SLOW = "Try again, or allow more time: set statement_timeout for the user, or in PGOPTIONS."
_MEANINGS: tuple[tuple[tuple[type[psycopg.Error], ...], type[SwatheError], str, str], ...] = (
    (
        (refusals.ReadOnlySqlTransaction, refusals.InsufficientPrivilege),
        StoreReadOnlyError,
        "{address} does not allow that: {said}.",
        "Use a user with the right to it; docs/store.md shows the grants.",
    ),
    ((refusals.QueryCanceled,), StoreUnavailableError, "{address} took too long.", _TOO_SLOW),
    (
        (refusals.LockNotAvailable, refusals.DeadlockDetected, refusals.SerializationFailure),
        StoreBusyError,
        "Somebody else is writing to {address}.",
        "Try again when that is done.",
    ),
    ((refusals.TooManyConnections,), StoreBusyError, "{address} has no connection left.", "Try again later."),
    (
        (refusals.DiskFull, refusals.OutOfMemory),
        StoreFullError,
        "{address} is full: {said}.",
        "Make room on the server and run the same command again: it resumes.",
    ),
    (
        (refusals.AdminShutdown, refusals.CrashShutdown, refusals.CannotConnectNow, refusals.ConnectionException),
        StoreUnavailableError,
        "{address} went away in the middle.",
        "Run the same command again: what was finished stands, the rest resumes.",
    ),
    (
        (refusals.UndefinedTable, refusals.UndefinedColumn, refusals.UndefinedFunction, refusals.InvalidSchemaName),
        StoreSchemaError,
        "{address} is not as this version left it: {said}.",
        "Open it with the version of Swathe that made it, or use another database.",
    ),
    (
        (refusals.ForeignKeyViolation,),
        MissingRegionError,
        "The region was removed from {address} meanwhile.",
        "Import it anew.",
    ),
    (
        (refusals.DataCorrupted, refusals.IndexCorrupted),
        StoreDamagedError,
        "{address} is damaged: {said}.",
        "Restore a backup of the database.",
    ),
    (
        (psycopg.DataError,),
        InvalidParameterError,
        "{address} cannot keep that: {said}.",
        "Leave out null characters, and give valid geometries and finite numbers.",
    ),
)


def _parsed(url: str) -> dict[str, Any]:
    try:
        conninfo = conninfo_to_dict(url)
    except psycopg.Error:
        raise InvalidParameterError(
            "The address of the store is none of PostgreSQL.", "Write postgresql://USER@HOST:PORT/DATABASE."
        ) from None
    secrets = [conninfo.pop(name, None) for name in ("password", "sslpassword")]
    if secrets != [None, None]:
        raise InvalidParameterError(
            f"The address {_shown(conninfo)} holds a password, which others on this machine can read.",
            "Leave it out of the address and put it into PGPASSWORD or ~/.pgpass.",
        )
    return {**_LIBPQ_DEFAULTS, **conninfo}


def _shown(conninfo: dict[str, Any]) -> str:
    """Return an address without a password or options."""
    user, host, port = (str(conninfo.get(part) or "") for part in ("user", "host", "port"))
    shown_host = "" if host.startswith("/") else host
    place = (f"{user}@" if user else "") + shown_host + (f":{port}" if port else "")
    return f"postgresql://{place}/{conninfo.get('dbname') or user}"
