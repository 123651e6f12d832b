"""News of the soil while a drive is on: records in JSON lines, read from a file that may still grow.

One line is one record: ``time_s`` (when it was true, on the drive's clock), where it holds (``polygon``, a number of
the soil map's polygon; ``x_m``, ``y_m`` and ``radius_m``; or ``cells``, a list of [row, column]), what is said
(``class``, or ``probabilities`` by class name, summing to 1), ``source`` (who says so) and, where it was measured,
``cone_index_kpa``. A line that cannot be used is skipped and told by its number. A record counts as soon as it is
whole, also before its line has ended.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swathe.belief import CLASSES
from swathe.errors import InvalidParameterError, MissingFileError, UnreadableFileError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from swathe.soil import SoilClass

_MOST_LINE_BYTES = 1_000_000
_NAMES = {soil.name.lower(): soil for soil in CLASSES}
_FIELDS = frozenset(
    {
        "time_s",
        "polygon",
        "x_m",
        "y_m",
        "radius_m",
        "cells",
        "class",
        "probabilities",
        "source",
        "cone_index_kpa",
    }
)


@dataclass(frozen=True, slots=True)
class SoilUpdate:
    """News of the soil of an area: a newer map of it. Where areas overlap the latest counts.

    Give one of ``polygon``, ``disc`` and ``cells``, and one of ``soil_class`` and ``probabilities``.

    Attributes:
        time_s: when it was true, on the drive's clock.
        polygon: number of a polygon of the soil map.
        disc: (x, y, radius) in metres.
        cells: (row, column) of terrain cells.
        soil_class: what the ground is, as on a map.
        probabilities: probability of each class; those that are left out have none. They sum to 1.
        source: who says so.
        cone_index_kpa: a cone index that holds for all of it, above 0 and at most 100 000 kPa.
    """

    time_s: float = 0.0
    polygon: int | None = None
    disc: tuple[float, float, float] | None = None
    cells: Sequence[tuple[int, int]] | None = None
    soil_class: SoilClass | None = None
    probabilities: Mapping[SoilClass, float] | None = None
    source: str = ""
    cone_index_kpa: float | None = None

    def row(self) -> tuple[Any, ...]:
        """Return the update as the core takes it.

        Raises:
            InvalidParameterError: where or what is missing, or given twice.
        """
        if sum(given is not None for given in (self.polygon, self.disc, self.cells)) != 1:
            raise InvalidParameterError(
                "It is not clear where the update holds.", "Give one of polygon, place with radius, and cells."
            )
        if (self.soil_class is None) == (self.probabilities is None):
            raise InvalidParameterError("It is not clear what is said.", "Give one of class and probabilities.")
        cells = None if self.cells is None else [(int(row), int(column)) for row, column in self.cells]
        low, high = (0, 0xFFFFFFFF)
        if self.polygon is not None and not low <= self.polygon <= high:
            raise InvalidParameterError(f"{self.polygon} is no number of a polygon.", "Polygons count from 1.")
        if cells is not None and any(min(cell) < 0 for cell in cells):
            raise InvalidParameterError("A cell lies outside the map.", "Rows and columns count from 0.")
        shares = None
        if self.probabilities is not None:
            shares = [float(self.probabilities.get(soil, 0.0)) for soil in CLASSES]
        code = None if self.soil_class is None else int(self.soil_class)
        where = (self.polygon, self.disc, cells)
        return float(self.time_s), self.source, where, (code, shares), self.cone_index_kpa


def parse_update(line: str) -> SoilUpdate:
    """Return the update that a line of JSON holds.

    Raises:
        InvalidParameterError: it holds none; the message says why.
    """
    try:
        record = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise _refuse("it is not JSON") from error
    if not isinstance(record, dict):
        raise _refuse("it is not an object")
    unknown = sorted(record.keys() - _FIELDS)
    if unknown:
        raise _refuse(f"unknown fields: {', '.join(unknown[:5])}")
    if "time_s" not in record:
        raise _refuse("time_s is missing")
    polygon = record.get("polygon")
    if polygon is not None and (not isinstance(polygon, int) or isinstance(polygon, bool)):
        raise _refuse("polygon must be a whole number")
    disc = None
    if any(name in record for name in ("x_m", "y_m", "radius_m")):
        x, y, radius = (_number(record, name) for name in ("x_m", "y_m", "radius_m"))
        disc = (x, y, radius)
    source = record.get("source", "")
    if not isinstance(source, str):
        raise _refuse("source must be a text")
    update = SoilUpdate(
        time_s=_number(record, "time_s"),
        polygon=polygon,
        disc=disc,
        cells=_cells(record.get("cells")),
        soil_class=None if "class" not in record else _soil_class(record["class"]),
        probabilities=_probabilities(record.get("probabilities")),
        source=source,
        cone_index_kpa=None if record.get("cone_index_kpa") is None else _number(record, "cone_index_kpa"),
    )
    update.row()
    return update


def _refuse(why: str) -> InvalidParameterError:
    return InvalidParameterError(f"The record of the soil feed cannot be used: {why}.", "See swathe.soil_feed.")


def _number(record: dict[str, Any], name: str) -> float:
    value = record.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e300 or not math.isfinite(value):
        raise _refuse(f"{name} must be a finite number")
    return float(value)


def _soil_class(name: object) -> SoilClass:
    if isinstance(name, str) and name.lower() in _NAMES:
        return _NAMES[name.lower()]
    raise _refuse(f"class must be one of {', '.join(_NAMES)}")


def _cells(given: object) -> list[tuple[int, int]] | None:
    if given is None:
        return None
    cells = []
    for cell in given if isinstance(given, list) else [given]:
        pair = cell if isinstance(cell, list) else []
        if len(pair) != 2 or not all(isinstance(n, int) and not isinstance(n, bool) and 0 <= n < 2**32 for n in pair):
            raise _refuse("cells must be a list of [row, column]")
        cells.append((pair[0], pair[1]))
    return cells


def _probabilities(given: object) -> dict[SoilClass, float] | None:
    if given is None:
        return None
    if not isinstance(given, dict):
        raise _refuse("probabilities must be an object of class names")
    shares = {_soil_class(name): _number(given, name) for name in given}
    if min(shares.values(), default=-1.0) < 0 or abs(sum(shares.values()) - 1) > 1e-6:
        raise _refuse("probabilities must be at least 0 and sum to 1")
    return shares


def _is_whole(line: bytes) -> bool:
    """Return whether a line that has not ended holds a whole object already: one that is cut is no JSON."""
    if len(line) > _MOST_LINE_BYTES or not line.rstrip().endswith(b"}"):
        return False
    try:
        return isinstance(json.loads(line.decode("utf-8-sig")), dict)
    except (ValueError, RecursionError):
        return False


@dataclass(slots=True)
class SoilFeed:
    """Updates from a file of JSON lines, which may grow while it is read.

    Attributes:
        path: the file.
        refused: number and reason of every line that was skipped.
    """

    path: str | Path
    refused: list[tuple[int, str]] = field(default_factory=list)
    _offset: int = 0
    _line: int = 0
    _rest: bytes = b""
    _is_taken: bool = False
    """Whether the record of the line that has not ended yet was taken; ``_rest`` is then what follows it."""
    _waiting: list[SoilUpdate] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Check that the file is there.

        Raises:
            MissingFileError: the file does not exist.
        """
        self.path = Path(self.path).expanduser()
        if not self.path.is_file():
            raise MissingFileError(f"The soil feed {self.path} does not exist.", "Check the path; it may be empty.")

    def due(self, time_s: float) -> list[SoilUpdate]:
        """Return the updates that came true up to a time and were not returned before, the earliest first.

        Raises:
            UnreadableFileError: the file can no longer be read.
        """
        self._read()
        due = [update for update in self._waiting if update.time_s <= time_s]
        self._waiting = [update for update in self._waiting if update.time_s > time_s]
        return sorted(due, key=lambda update: update.time_s)

    def finish(self) -> None:
        """Refuse what still waits for the rest of its line; call it when nothing more is to come.

        Raises:
            UnreadableFileError: the file can no longer be read.
        """
        self._read()
        rest, self._rest = self._rest, b""
        if rest.strip():
            self._take(rest)

    def _read(self) -> None:
        path = Path(self.path)
        try:
            size = path.stat().st_size
            if size < self._offset:
                # Another file took its place: it is read from its beginning.
                self._offset, self._line, self._rest, self._is_taken = 0, 0, b"", False
            if size == self._offset:
                return
            with path.open("rb") as file:
                file.seek(self._offset)
                more = file.read()
        except OSError as error:
            raise UnreadableFileError(f"The soil feed {path} cannot be read.", "Check the file.") from error
        self._offset += len(more)
        *lines, self._rest = (self._rest + more).split(b"\n")
        for line in lines:
            self._take(line)
        if not self._is_taken and _is_whole(self._rest):
            self._take(self._rest)
            self._is_taken, self._rest = True, b""

    def _take(self, line: bytes) -> None:
        if self._is_taken:
            self._is_taken = False
            if line.strip():
                self.refused.append((self._line, _refuse("more follows it on its line").message))
            return
        self._line += 1
        if not line.strip():
            return
        try:
            if len(line) > _MOST_LINE_BYTES:
                raise _refuse("the line is too long")
            text = line.decode("utf-8-sig")
        except UnicodeDecodeError:
            self.refused.append((self._line, "The record of the soil feed cannot be used: it is not UTF-8."))
            return
        except InvalidParameterError as error:
            self.refused.append((self._line, error.message))
            return
        try:
            self._waiting.append(parse_update(text))
        except InvalidParameterError as error:
            self.refused.append((self._line, error.message))
