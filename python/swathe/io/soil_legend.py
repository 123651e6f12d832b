"""Legends: what the values of a soil map mean, from a CSV, from a raster's own category names, or from labels."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from swathe.errors import MissingFileError, SoilFieldError, UnreadableFileError
from swathe.soil import SoilClass, classify_label

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

CLASS_COLUMN = "class"
CLASS_NAMES = {soil_class.name.lower(): soil_class for soil_class in SoilClass}
DELIMITERS = ",;\t|:"


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a value stands for."""

    label: str
    soil_class: SoilClass
    understood: bool


@dataclass(frozen=True)
class Legend:
    """A legend: for every column that could hold the map's values, the meaning of each of them."""

    name: str
    columns: Mapping[str, Mapping[str, Meaning]] = field(default_factory=dict)

    def column_for(self, values: Iterable[str]) -> tuple[str, Mapping[str, Meaning]] | None:
        """Return the column (the first of the best) that explains most of the values, or None when none does."""
        wanted = {plain_value(value) for value in values}
        best = max(self.columns.items(), key=lambda item: len(wanted & item[1].keys()), default=None)
        return best if best is not None and wanted & best[1].keys() else None


def plain_value(value: object) -> str:
    """Return a value as legends write it: ``3.0`` and ``3`` are the same."""
    text = str(value).strip()
    try:
        number = float(text)
    except ValueError:
        return text
    return str(int(number)) if number.is_integer() else text


def meaning_of(value: str, legend: Mapping[str, Meaning] | None) -> Meaning:
    """Return what a value means: by the legend when it has it, else by the value's own words."""
    if legend is not None and (found := legend.get(plain_value(value))) is not None:
        return found
    return label_meaning(value)


def label_meaning(*labels: str) -> Meaning:
    """Return the meaning of the first label that is understood; else unknown under the longest label."""
    for label in labels:
        soil_class = classify_label(label)
        if soil_class is not None:
            return Meaning(label, soil_class, understood=True)
    return Meaning(max(labels, key=len, default=""), SoilClass.UNKNOWN, understood=False)


def read_legend(path: str) -> Legend:
    """Return the legend in a CSV file with a head line (comma, semicolon, tab, bar or colon between columns).

    Any column may hold the values; the text of the other columns says what they mean, and a column ``class`` says it
    outright. Raises MissingFileError, UnreadableFileError, or SoilFieldError for a class that does not exist.
    """
    file = Path(path).expanduser()
    if not file.is_file():
        raise MissingFileError(f"The soil legend {path} does not exist.", "Check the path.")
    try:
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        text = file.read_text(encoding="latin-1")
    except OSError as error:
        raise UnreadableFileError(f"The soil legend {path} cannot be read.", "Check its permissions.") from error
    if "\0" in text:
        raise UnreadableFileError(f"The soil legend {path} is not text.", "Give a CSV file with a head line.")
    head = text.partition("\n")[0]
    delimiter = max(DELIMITERS, key=head.count)
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text), delimiter=delimiter) if row]
    except csv.Error as error:
        raise UnreadableFileError(f"The soil legend {path} is not a CSV file.", "Check it.") from error
    if len(rows) < 2 or len(rows[0]) < 2:
        raise SoilFieldError(
            f"The soil legend {file.name} needs a head line, two columns and a line for every value.",
            "Write for example `value,class` and then `3,clay`.",
        )
    return _legend(file.name, rows[0], rows[1:])


def _legend(name: str, head: list[str], rows: list[list[str]]) -> Legend:
    lowered = [column.lower() for column in head]
    class_column = lowered.index(CLASS_COLUMN) if CLASS_COLUMN in lowered else None
    columns: dict[str, dict[str, Meaning]] = {}
    for own, column in enumerate(head):
        if own == class_column:
            continue
        values = columns.setdefault(column, {})
        for row in rows:
            if own < len(row) and row[own]:
                values.setdefault(plain_value(row[own]), _row_meaning(name, row, own, class_column))
    return Legend(name, columns)


def _row_meaning(name: str, row: list[str], own: int, class_column: int | None) -> Meaning:
    texts = [cell for number, cell in enumerate(row) if number not in (own, class_column) and _is_text(cell)]
    if class_column is not None and class_column < len(row) and row[class_column]:
        word = row[class_column].lower()
        if word not in CLASS_NAMES:
            raise SoilFieldError(
                f"The soil legend {name} gives {row[own]!r} the class {word!r}, which does not exist.",
                f"Use one of {', '.join(CLASS_NAMES)}.",
            )
        return Meaning(max(texts, key=len, default=row[own]), CLASS_NAMES[word], understood=True)
    # The value itself comes last: a short code says less than the words beside it.
    return label_meaning(*sorted(texts, key=len, reverse=True), *([row[own]] if _is_text(row[own]) else []))


def _is_text(cell: str) -> bool:
    return any(character.isalpha() for character in cell)
