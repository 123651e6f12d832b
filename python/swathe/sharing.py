"""A drive on the ground of a store: it hears at once what other vehicles measure there, and files its own readings."""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Self

from swathe.belief import PenetrometerReading
from swathe.errors import StoreError, SwatheError
from swathe.store import open_store
from swathe.store.interface import StoredReading, StoredRun

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType

    from swathe.episode import Second
    from swathe.news import NewsSource, Telling


class StoreNews:
    """What others measure, and news of another source beside it. A context manager.

    Only readings filed while the drive goes on are told: those before count in its plan. That some are withdrawn is
    told and counts from the next plan on.
    """

    def __init__(self, url: str, region: str, author: str | None, beside: NewsSource | None = None) -> None:
        """Open a store and listen from now on (``revision``); with an ``author`` the drive's own readings are filed.

        Raises:
            StoreError: the store or the region is not there.
        """
        self._store = open_store(url)
        self._region, self._author, self._beside = region, author, beside
        self._filed: set[str] = set()
        self._untold: list[dict[str, Any]] = []
        self.revision = max((change.revision for change in self._store.changes(region)), default=0)
        self._heard = self.revision
        self._subscription = self._store.subscribe(region, since=self._heard)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._subscription.close()
        self._store.close()

    def due(self, time_s: float) -> Telling:
        """Return what was filed since the last time."""
        found, refused = ([], []) if self._beside is None else self._beside.due(time_s)
        refused += self._untold
        self._untold = []
        try:
            changes = self._subscription.poll(0.0)
            told = [change for change in changes if change.kind in {"readings", "withdrawal"}]
            if not told:
                return found, refused
            readings = self._store.readings(self._region, since=self._heard)
        except StoreError as error:
            # A drive goes on without its store.
            return found, [*refused, {"store": self._store.address, "reason": error.message}]
        self._heard = max(change.revision for change in told)
        refused += [
            {"withdrawn": change.count, "reason": "Withdrawn readings no longer count from the next plan on."}
            for change in told
            if change.kind == "withdrawal"
        ]
        found += [stored.reading for stored in readings if stored.id not in self._filed]
        return found, refused

    def finish(self) -> list[dict[str, Any]]:
        """Return what the news beside the store still has to tell."""
        return [] if self._beside is None else self._beside.finish()

    def file(self, second: Second) -> None:
        """File the readings of a second, where there is an author; what cannot be filed is told as the next news."""
        if self._author is None or not second.readings:
            return
        filed = [
            StoredReading(
                uuid.uuid4().hex,
                PenetrometerReading(
                    reading.x_m, reading.y_m, reading.depths_m, reading.cone_indices_kpa, reading.refusal_depth_m
                ),
                self._author,
                datetime.now(UTC).isoformat(timespec="seconds"),
                f"penetrometer of {self._author}",
            )
            for _, reading in second.readings
        ]
        self._filed |= {stored.id for stored in filed}
        try:
            self._store.add_readings(self._region, filed)
        except SwatheError as error:
            self._untold.append({"store": self._store.address, "reason": error.message})

    def keep_run(self, log: Path, summary: Mapping[str, Any]) -> None:
        """File the drive, where there is an author: its summary and where its log lies.

        Raises:
            StoreError: it cannot be filed.
        """
        if self._author is None:
            return
        told = {key: value for key, value in summary.items() if key not in {"outputs", "timings_s"}}
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self._store.add_run(self._region, StoredRun(uuid.uuid4().hex, str(log.resolve()), told, self._author, now))
