"""Hand readings of a penetrometer from a CSV file.

One line is one push. The head line names the columns: ``lon,lat`` in degrees or ``x,y`` in the map's own coordinates
(or in a system that the caller names); the cone index at each depth under ``ci_5cm`` or ``ci_5cm_kpa``, in kPa
(``ci_2in_psi`` likewise in inches and psi); sleeve friction as ``fs_5cm``; ``refusal_cm``; and ``class``, somebody's
word on the soil, instead of depths. Empty fields are not measured. Other columns are left alone.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from swathe.belief import ClassReading, PenetrometerReading
from swathe.errors import InvalidParameterError, MissingFileError, ReadingFileError, UnreadableFileError, UsageError
from swathe.soil import SoilClass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from swathe.io.crs import Frame

_MAX_FILE_BYTES = 50_000_000
_DELIMITERS = ",;\t|"
_KPA_PER_PSI = 6.894757
_METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}
_COLUMN = re.compile(r"(ci|fs)_([0-9]+(?:[.][0-9]+)?)(mm|cm|m|in)(?:_(kpa|mpa|psi))?")
_KPA = {None: 1.0, "kpa": 1.0, "mpa": 1000.0, "psi": _KPA_PER_PSI}
_CLASSES = {soil.name.lower(): soil for soil in SoilClass if soil is not SoilClass.UNKNOWN}
_FORM = "Write for example `lon,lat,ci_5cm,ci_10cm,ci_15cm,refusal_cm`."


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where the figures of a line stand."""

    x: int
    y: int
    lonlat: bool
    cone: tuple[tuple[float, float, int], ...]
    """Depth in metres, kPa for one unit, place; by depth."""
    sleeve: Mapping[float, tuple[float, int]]
    refusal: int | None
    soil_class: int | None


def read_readings(
    path: str | Path, frame: Frame, *, points_crs: str | None = None, source_crs_wkt: str | None = None
) -> list[PenetrometerReading | ClassReading]:
    """Return the readings of a CSV file in the metres of a frame, in the file's order.

    Args:
        path: the file; a head line, then one push on each line.
        frame: the map's frame.
        points_crs: what columns ``x,y`` are in: None or ``native`` for the map's own, else a system such as EPSG:25832.
        source_crs_wkt: the elevation's own system, where that differs from the frame's.

    Raises:
        MissingFileError: the file does not exist.
        UnreadableFileError: it is not text, or too large.
        ReadingFileError: a column is missing or a line cannot be used; the message names the file and the line.
    """
    file = Path(path).expanduser()
    rows = _rows(file)
    columns = _columns(file.name, rows[0][1])
    crs = None if columns.lonlat else points_crs or "native"
    readings: list[PenetrometerReading | ClassReading] = []
    for line, row in rows[1:]:
        where = f"{file.name}, line {line}"
        if len(row) > len(rows[0][1]) and any(row[len(rows[0][1]) :]):
            raise ReadingFileError(f"{where} has more fields than the head line.", _FORM)
        x, y = (_number(where, row, place, name) for place, name in ((columns.x, "x"), (columns.y, "y")))
        if x is None or y is None:
            raise ReadingFileError(f"{where} has no place.", "Give both coordinates.")
        try:
            at = frame.from_points(x, y, crs, source_crs_wkt)
        except UsageError as error:
            raise ReadingFileError(f"{where}: {error.message}", error.remedy) from error
        readings.append(_reading(where, row, columns, at.x_m, at.y_m))
    return readings


def _rows(file: Path) -> list[tuple[int, list[str]]]:
    """Return the lines that hold anything, with their numbers."""
    if not file.is_file():
        raise MissingFileError(f"The file of readings {file} does not exist.", "Check the path.")
    try:
        if file.stat().st_size > _MAX_FILE_BYTES:
            raise UnreadableFileError(f"{file} is too large for hand readings.", "Give at most 50 MB.")
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFileError(f"{file} is not text in UTF-8.", "Save it as CSV in UTF-8.") from error
    except OSError as error:
        raise UnreadableFileError(f"The file of readings {file} cannot be read.", "Check its permissions.") from error
    head = text.partition("\n")[0]
    reader = csv.reader(io.StringIO(text), delimiter=max(_DELIMITERS, key=head.count))
    rows = []
    try:
        for row in reader:
            fields = [cell.strip() for cell in row]
            if any(fields):
                rows.append((reader.line_num, fields))
    except csv.Error as error:
        raise ReadingFileError(f"{file.name}, line {reader.line_num} is no CSV: {error}.", "Correct it.") from error
    if len(rows) < 2:
        raise ReadingFileError(f"{file.name} needs a head line and a line for every reading.", _FORM)
    return rows


def _columns(name: str, head: list[str]) -> _Columns:
    places: dict[str, int] = {}
    for place, column in enumerate(column.lower() for column in head):
        if column and column in places:
            raise ReadingFileError(f"{name} has the column {column!r} twice.", "Leave one.")
        places[column] = place
    lonlat = {"lon", "lat"} <= places.keys()
    pair = ("lon", "lat") if lonlat else ("x", "y")
    if not set(pair) <= places.keys():
        raise ReadingFileError(f"{name} has neither the columns lon,lat nor x,y.", _FORM)
    cone: dict[float, tuple[float, int]] = {}
    sleeve: dict[float, tuple[float, int]] = {}
    for column, place in places.items():
        match = _COLUMN.fullmatch(column)
        if match is None:
            if re.match(r"(ci|fs)_", column):
                raise ReadingFileError(f"{name} has the column {column!r}, which names no depth.", _FORM)
            continue
        kind = cone if match[1] == "ci" else sleeve
        depth_m = round(float(match[2]) * _METRES[match[3]], 6)
        if depth_m in kind:
            raise ReadingFileError(f"{name} has two columns for the depth of {depth_m:g} m.", "Leave one.")
        kind[depth_m] = (_KPA[match[4]], place)
    refusal, soil_class = places.get("refusal_cm"), places.get("class")
    if not cone and refusal is None and soil_class is None:
        raise ReadingFileError(f"{name} has no column with a reading.", _FORM)
    if not sleeve.keys() <= cone.keys():
        raise ReadingFileError(f"{name} has sleeve friction at a depth without cone index.", "Give both at one depth.")
    by_depth = tuple((depth, unit, place) for depth, (unit, place) in sorted(cone.items()))
    return _Columns(places[pair[0]], places[pair[1]], lonlat, by_depth, sleeve, refusal, soil_class)


def _reading(
    where: str, row: list[str], columns: _Columns, x_m: float, y_m: float
) -> PenetrometerReading | ClassReading:
    word = "" if columns.soil_class is None else _field(row, columns.soil_class).lower()
    depths, cone, sleeve = [], [], []
    for depth_m, unit_kpa, place in columns.cone:
        value = _number(where, row, place, f"cone index at {depth_m:g} m")
        if value is None:
            continue
        depths.append(depth_m)
        cone.append(value * unit_kpa)
        friction_kpa, friction_place = columns.sleeve.get(depth_m, (1.0, None))
        friction = (
            None if friction_place is None else _number(where, row, friction_place, f"sleeve friction at {depth_m:g} m")
        )
        if friction is not None:
            sleeve.append(friction * friction_kpa)
    refusal_cm = None if columns.refusal is None else _number(where, row, columns.refusal, "refusal depth")
    if word and (depths or refusal_cm is not None):
        raise ReadingFileError(f"{where} has both a class and a profile.", "Give one of them on a line.")
    if word:
        if word not in _CLASSES:
            raise ReadingFileError(
                f"{where} has the class {word!r}, which does not exist.", f"Use one of {', '.join(_CLASSES)}."
            )
        return ClassReading(x_m, y_m, _CLASSES[word])
    if sleeve and len(sleeve) != len(depths):
        raise ReadingFileError(f"{where} lacks sleeve friction at some depths.", "Give it at all depths or at none.")
    reading = PenetrometerReading(
        x_m,
        y_m,
        tuple(depths),
        tuple(cone),
        None if refusal_cm is None else refusal_cm / 100,
        tuple(sleeve) or None,
    )
    try:
        reading.validate()
    except InvalidParameterError as error:
        raise ReadingFileError(f"{where}: {error.message}", error.remedy) from error
    return reading


def _field(row: list[str], place: int) -> str:
    return row[place] if place < len(row) else ""


def _number(where: str, row: list[str], place: int, name: str) -> float | None:
    text = _field(row, place)
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ReadingFileError(f"{where}: the {name} {text!r} is not a number.", "Write it like 412.5.")
    return value
