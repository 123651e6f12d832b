"""The tables of the PostGIS store: numbered migrations that go forward, under a lock, and refuse what is newer."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, LiteralString, NamedTuple

from psycopg import errors as refusals

from swathe.errors import StoreReadOnlyError, StoreSchemaError, StoreUnavailableError
from swathe.store.queries import query

if TYPE_CHECKING:
    from swathe.store.postgis_server import Connection, Server

_EXTENSIONS = ("postgis", "postgis_raster")
_GRANTS = "Open it once with a user who may change it: `swathe import` or `open_store(..., create=True)` does it."


class Migration(NamedTuple):
    """One step: its number, its name, and its SQL."""

    version: int
    name: str
    sql: LiteralString


@cache
def migrations() -> tuple[Migration, ...]:
    """Return all steps in order."""
    found = []
    for file in resources.files("swathe.store").joinpath("migrations").iterdir():
        match = re.fullmatch(r"(\d{4})_(\w+)\.sql", file.name)
        if match is not None:
            found.append(Migration(int(match[1]), match[2], file.read_text(encoding="utf-8")))
    return tuple(sorted(found))


def prepare(server: Server, *, create: bool) -> None:
    """Bring the tables to the present version; make them when there are none and ``create`` says so.

    Raises:
        StoreUnavailableError: there are none, and none shall be made.
        StoreSchemaError: they are newer, an extension is missing, or they are older and this user may not change them.
        StoreReadOnlyError: they shall be made and this user may not.
    """
    with server.use() as connection:
        version = _version(connection)
        latest = migrations()[-1].version
        if version == latest:
            return
        _require_known(server, version, latest)
        if version is None and not create:
            raise StoreUnavailableError(
                f"{server.address} holds no store of Swathe.", "Check the address, or make one with `swathe import`."
            )
    try:
        _migrate(server)
    except StoreReadOnlyError as error:
        if version is None:
            raise
        raise StoreSchemaError(
            f"{server.address} was made by an older version of Swathe and this user may not bring it up to date.",
            _GRANTS,
        ) from error


def _migrate(server: Server) -> None:
    latest = migrations()[-1].version
    with server.use() as connection:
        # Waiting for another who does the same may take a while.
        connection.execute(query("lock_schema"))
        try:
            version = _version(connection)
            _require_known(server, version, latest)
            _require_extensions(server, connection)
            for step in migrations():
                if version is None or step.version > version:
                    with connection.transaction():
                        if version is None and step.version == migrations()[0].version:
                            connection.execute(query("create_schema"))
                        connection.execute(step.sql)
                        connection.execute(query("note_version"), (step.version, step.name))
        finally:
            if not connection.closed:
                connection.execute(query("unlock_schema"))


def _version(connection: Connection) -> int | None:
    """Return the number of the last step that was taken, None without tables."""
    found = connection.execute(query("find_schema")).fetchone()
    if found is None or not found[0]:
        return None
    (version,) = connection.execute(query("read_version")).fetchone() or (None,)
    return None if version is None else int(version)


def _require_known(server: Server, version: int | None, latest: int) -> None:
    if version is not None and version > latest:
        raise StoreSchemaError(
            f"{server.address} was made by a newer version of Swathe (schema {version}, this one knows {latest}).",
            "Use that version.",
        )


def _require_extensions(server: Server, connection: Connection) -> None:
    present = {name for (name,) in connection.execute(query("list_extensions"), (list(_EXTENSIONS),))}
    missing = [name for name in _EXTENSIONS if name not in present]
    try:
        for name in missing:
            connection.execute(query(f"create_{name}"))
    except (refusals.InsufficientPrivilege, refusals.FeatureNotSupported, refusals.UndefinedFile) as error:
        commands = " ".join(f"CREATE EXTENSION {name};" for name in missing)
        raise StoreSchemaError(
            f"{server.address} lacks the extension {' and '.join(missing)}.",
            f"Install PostGIS on the server and have its administrator run: {commands}",
        ) from error
    if missing:
        # Their schema joins the search path.
        connection.execute(query("begin_session"), ("120s",))
