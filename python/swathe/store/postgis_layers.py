"""A layer that is being written: its lock, its staged row, and the switch into the place of the old one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from psycopg import errors as refusals

from swathe.errors import StoreBusyError
from swathe.store.postgis_regions import layer_values, region_row
from swathe.store.queries import query

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from swathe.store.interface import LayerInfo
    from swathe.store.postgis_server import Server


class StagedLayer:
    """A context manager that holds a layer for one writer.

    It has a connection of its own, whose end (by whatever cause) lets go of the lock.

    Attributes:
        is_current: whether the finished layer is this very one.
        layer_id: the row that takes tiles or polygons; of the finished layer if that is this one.
    """

    def __init__(self, server: Server, region: str, layer: LayerInfo) -> None:
        self._server = server
        self.connection = server.connect(patient=True)
        try:
            with self.told():
                self.region = region_row(self.connection, region)
                self._values = layer_values(self.region.id, layer)
                self._take_lock(layer.name)
                self.is_current, self.layer_id = self._find()
        except BaseException:
            self.connection.close()
            raise

    def told(self) -> AbstractContextManager[None]:
        """Turn what the server refuses into plain errors."""
        return self._server.told(self.connection)

    def _take_lock(self, layer: str) -> None:
        try:
            with self.connection.transaction():
                # A process that was killed a moment ago may still be going down on the server.
                self.connection.execute(query("wait_a_moment"))
                self.connection.execute(query("lock_layer"), (self.region.id, layer))
        except refusals.LockNotAvailable as error:
            raise StoreBusyError(
                f"Somebody else is importing the layer {layer!r} of the region {self.region.name!r}.",
                "Try again when that is done.",
            ) from error

    def _find(self) -> tuple[bool, int]:
        with self.connection.transaction():
            current = self.connection.execute(query("current_layer_of_digest"), self._values).fetchone()
            if current is not None:
                return True, int(current[0])
            # What other sources left unfinished, and what a crash left behind after the last switch.
            self.connection.execute(query("sweep_layers"), self._values)
            staged = self.connection.execute(query("staged_layer_of_digest"), self._values).fetchone()
            return False, self._add() if staged is None else int(staged[0])

    def _add(self) -> int:
        (layer_id,) = self.connection.execute(query("add_layer"), self._values).fetchone() or (0,)
        return int(layer_id)

    def restart(self) -> None:
        """Forget what an earlier writer left."""
        with self.told(), self.connection.transaction():
            self.remove()
            self.layer_id = self._add()

    def remove(self) -> None:
        """Remove what was staged."""
        self.connection.execute(query("remove_staged"), (self.layer_id,))

    def switch(self) -> None:
        """Put it into the place of the old layer: at the end of the transaction, at once for every reader."""
        self.connection.execute(query("switch_layer"), (self.layer_id,))

    def sweep(self) -> None:
        """Remove the old layer's rows, which nobody reads any more."""
        with self.told():
            self.connection.execute(query("sweep_replaced"), self._values)

    def close(self) -> None:
        """Let go of the layer."""
        self.connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
