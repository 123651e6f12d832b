"""Where a region is kept so that one vehicle's measurements serve the next: a project folder, or PostGIS.

``open_store`` opens either behind the same ``TerrainStore``. Whatever is read comes from a finished import; a
writer that dies, at any moment, leaves the old or the new.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from swathe.errors import MissingExtraError, StoreUnavailableError
from swathe.store.interface import (
    TILE_SIZE,
    Change,
    ImportSession,
    LayerInfo,
    Provenance,
    RegionInfo,
    SoilPolygon,
    StoredReading,
    StoredRoute,
    StoredRun,
    Subscription,
    TerrainStore,
    Zone,
)

if TYPE_CHECKING:
    from os import PathLike

__all__ = [
    "TILE_SIZE",
    "Change",
    "ImportSession",
    "LayerInfo",
    "Provenance",
    "RegionInfo",
    "SoilPolygon",
    "StoredReading",
    "StoredRoute",
    "StoredRun",
    "Subscription",
    "TerrainStore",
    "Zone",
    "open_store",
]

_SERVER_SCHEMES = ("postgresql", "postgres")


def open_store(url: str | PathLike[str], *, create: bool = False) -> TerrainStore:
    """Open a store.

    Args:
        url: ``postgresql://[user@]host[:port]/database`` for PostGIS; a path, or a ``file:`` address, for a project
            folder. Passwords belong into the environment (``PGPASSWORD``) or ``~/.pgpass``.
        create: make the folder, or the tables, when they are not there yet.

    Raises:
        StoreUnavailableError: there is no store there, or its server does not answer.
        StoreSchemaError: the store was made by a newer version, or is no store of ours.
        MissingExtraError: the address is one of PostgreSQL and psycopg is not installed.
    """
    address = os.fspath(url)
    scheme = address.partition("://")[0].lower() if "://" in address else ""
    if scheme in _SERVER_SCHEMES:
        try:
            server = importlib.import_module("swathe.store.postgis")
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "psycopg":
                raise
            raise MissingExtraError(
                "PostgreSQL needs the library psycopg, which is not installed.",
                "Install it with `pip install 'swathe[postgis]'`, or use a project folder.",
            ) from error
        store: TerrainStore = server.PostgisStore(address, create=create)
        return store
    if scheme and scheme != "file":
        raise StoreUnavailableError(
            f"A store cannot be reached by {scheme}.", "Give a folder, or an address that begins with postgresql://."
        )
    from swathe.store.files import FileStore

    return FileStore(_path(address), create=create)


def _path(address: str) -> Path:
    if not address.lower().startswith("file:"):
        return Path(address).expanduser()
    return Path(unquote(urlsplit(address).path))
