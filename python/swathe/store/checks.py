"""What every store checks at its door."""

from __future__ import annotations

import math
from datetime import datetime
from typing import TYPE_CHECKING

from swathe.belief import PenetrometerReading
from swathe.errors import InvalidParameterError, OutsideGridError
from swathe.grid import Position

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swathe.grid import GridGeometry
    from swathe.store.interface import StoredReading

LONGEST_NAME = 200


def require_name(name: str, what: str = "region") -> str:
    """Return a name that can be kept and shown.

    Raises:
        InvalidParameterError: it is empty, longer than 200 characters, or holds control characters.
    """
    if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
        shown = name if name.isprintable() else ascii(name)
        raise InvalidParameterError(
            f"A {what} cannot be called {shown[:LONGEST_NAME]!r}.",
            f"Give 1 to {LONGEST_NAME} characters without line breaks or other control characters.",
        )
    return name


def require_readings(readings: Sequence[StoredReading], geometry: GridGeometry) -> None:
    """Check what is to be filed.

    Raises:
        UsageError: one has no id, author or time, is not physical, or lies outside the region.
    """
    for stored in readings:
        reading = stored.reading
        where = f"The reading {stored.id!r}"
        if not (stored.id and stored.author):
            raise InvalidParameterError(f"{where} has no id or no author.", "Give both.")
        try:
            datetime.fromisoformat(stored.time)
        except ValueError:
            raise InvalidParameterError(
                f"{where} has the time {stored.time!r}.", "Give ISO 8601 in UTC, such as 2026-05-01T10:00:00Z."
            ) from None
        if stored.error is not None and not (math.isfinite(stored.error) and stored.error >= 0):
            raise InvalidParameterError(f"{where} has the error {stored.error}.", "Give at least 0, or leave it out.")
        if isinstance(reading, PenetrometerReading):
            reading.validate()
        if not (math.isfinite(reading.x_m) and math.isfinite(reading.y_m)):
            raise InvalidParameterError(f"{where} has no place.", "Give metres east and north.")
        if geometry.cell_at(Position(reading.x_m, reading.y_m)) is None:
            raise OutsideGridError(
                f"{where} at {reading.x_m:g}, {reading.y_m:g} lies outside the region.", "Give its place in the frame."
            )


def require_one_choice(*choices: object) -> None:
    """Check that exactly one of ``instrument``, ``author`` and ``ids`` says what is withdrawn.

    Raises:
        InvalidParameterError: none or several do.
    """
    if sum(choice is not None for choice in choices) != 1:
        raise InvalidParameterError("It is not clear which readings are meant.", "Name an instrument, author or ids.")
