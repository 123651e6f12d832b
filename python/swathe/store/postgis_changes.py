"""Changes of a region in PostGIS: read by revision, and heard of by LISTEN and NOTIFY."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import psycopg

from swathe.store.interface import Change, Subscription
from swathe.store.postgis_regions import region_row
from swathe.store.queries import query

if TYPE_CHECKING:
    from swathe.store.postgis_server import Connection, Server

#: Longest wait for one notification; a server that went away without a word is noticed by the question after it.
_LONGEST_WAIT_S = 1.0


def read_changes(connection: Connection, region_id: int, since: int) -> list[Change]:
    """Return every change after a revision, in order."""
    return [Change(*row) for row in connection.execute(query("read_changes"), (region_id, since))]


class PostgisSubscription(Subscription):
    """Hears of changes of one region. It has a connection of its own, opened anew where it was lost.

    A notification only wakes it: what it returns is read from the table, so that nothing is lost while nobody listened.
    """

    def __init__(self, server: Server, region: str, since: int | None) -> None:
        self._server = server
        self._name = region
        self._connection: Connection | None = None
        connection = self._listening()
        try:
            with server.told(connection):
                row = region_row(connection, region)
        except BaseException:
            connection.close()
            raise
        self._region_id = row.id
        self._since = row.revision if since is None else since

    def _listening(self) -> Connection:
        connection = self._connection
        if connection is None or connection.closed:
            connection = self._connection = self._server.connect()
            with self._server.told(connection):
                connection.execute(query("listen"))
        return connection

    def poll(self, timeout_s: float = 0.0) -> list[Change]:
        """Return the changes since the last call in order, after waiting at most so long for the first.

        Raises:
            StoreUnavailableError: the server is away; a later call goes on where this one was.
        """
        until = time.monotonic() + timeout_s
        connection = self._listening()
        try:
            with self._server.told(connection):
                while True:
                    found = read_changes(connection, self._region_id, self._since)
                    left_s = until - time.monotonic()
                    if found:
                        self._since = found[-1].revision
                        return found
                    if left_s <= 0:
                        return []
                    for _ in connection.notifies(timeout=min(left_s, _LONGEST_WAIT_S), stop_after=1):
                        pass
        except BaseException as error:
            if isinstance(error.__cause__, psycopg.Error):
                connection.close()
            raise

    def close(self) -> None:
        """Stop listening."""
        if self._connection is not None:
            self._connection.close()
