"""Soil classes, and what the words of soil maps mean to them.

The tables stand in ``soil_labels.toml`` beside this module. A label that no table knows is not guessed: it stays
unknown and the report lists it.
"""

from __future__ import annotations

import math
import re
import tomllib
import unicodedata
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from swathe.errors import InvalidParameterError

if TYPE_CHECKING:
    from collections.abc import Iterable


class SoilClass(IntEnum):
    """The soil of a cell, by the code that layers and the Rust core use.

    ``NONE`` is no ground at all (water, peat): no-go for every vehicle. ``UNKNOWN`` is not mapped or not understood.
    """

    UNKNOWN = 0
    GRAVEL = 1
    SAND = 2
    CLAY = 3
    SILT = 4
    ROCK = 5
    NONE = 6


@dataclass(frozen=True, slots=True)
class SoilEntry:
    """One value of a soil map: its label, the class it was read as, whether that was understood, and its cells."""

    value: str
    label: str
    soil_class: SoilClass
    understood: bool
    cells: int


@dataclass(frozen=True, slots=True)
class SoilReport:
    """What a soil map was read as.

    ``field`` is the attribute that was read (None for rasters and generated soil), ``covered_fraction`` the share
    (0..1) of the map's cells over which the soil map has any value, understood or not. ``disputed_cells`` counts the
    cells where polygons of different classes overlap; the class that is worse to drive on was taken there.
    """

    source: str
    field: str | None
    entries: tuple[SoilEntry, ...]
    covered_fraction: float
    disputed_cells: int = 0

    @property
    def not_understood(self) -> tuple[SoilEntry, ...]:
        """The entries whose label no table knows; their cells are unknown."""
        return tuple(entry for entry in self.entries if not entry.understood)

    def as_dict(self) -> dict[str, object]:
        """Return the report as plain values for JSON."""
        return {
            "source": self.source,
            "field": self.field,
            "covered_fraction": self.covered_fraction,
            "disputed_cells": self.disputed_cells,
            "entries": [
                {
                    "value": entry.value,
                    "label": entry.label,
                    "soil_class": entry.soil_class.name.lower(),
                    "understood": entry.understood,
                    "cells": entry.cells,
                }
                for entry in self.entries
            ],
        }

    def lines(self) -> list[str]:
        """Return the report as plain lines of text for people."""
        field = f", field {self.field}" if self.field else ""
        lines = [f"Soil from {self.source}{field} covers {100 * self.covered_fraction:.1f} % of the map."]
        for entry in self.entries:
            label = "" if entry.label in ("", entry.value) else f" ({entry.label})"
            meaning = entry.soil_class.name.lower() if entry.understood else "not understood, unknown"
            lines.append(f"{entry.value}{label}: {meaning}, {entry.cells:,} cells")
        if self.disputed_cells:
            lines.append(f"{self.disputed_cells:,} cells lie in polygons of different soils; the worse soil was taken.")
        return lines


def classify_label(text: str) -> SoilClass | None:
    """Return the class that a soil label names, or None when it is not understood.

    Reads USDA textures and map unit names, USCS symbols, the paper's class names, and German and international soil
    types. The order within one part of a label: water, rock, coarse fragments, USCS, texture, material, type. Of "X-Y
    complex", "X and Y" and the like the first part that is understood decides.
    """
    whole = _words(text)
    if not whole:
        return None
    plain = _tables().classes.get(whole)
    if plain is not None:
        return plain
    symbol = classify_uscs(text)
    if symbol is not None:
        return symbol
    parts = [part for part in re.split(_SEPARATORS, re.sub(_HYPHENED_ADJECTIVE, r"\1 ", text)) if part.strip()]
    for part in parts if len(parts) > 1 else ():
        found = _classify_part(part)
        if found is not None:
            return found
    return _classify_part(text)


def classify_uscs(symbol: str) -> SoilClass | None:
    """Return the class of a symbol of the Unified Soil Classification System (``SM``, ``gp-gm``), or None."""
    parts = [part.strip() for part in re.split(r"[-/]", symbol.strip().upper())]
    table = _tables().uscs
    if len(parts) > 2 or any(part not in table for part in parts):
        return None
    return table.get("-".join(parts), table[parts[0]])


def classify_texture(sand_percent: float, silt_percent: float, clay_percent: float) -> tuple[str, SoilClass]:
    """Return the USDA texture class of a fine earth and what it is to a vehicle.

    The three shares are percent by mass and must add up to 100 (within 5, then scaled). Raises InvalidParameterError.
    Source: USDA Soil Survey Manual, texture triangle, tested from the coarse end.
    """
    shares = (sand_percent, silt_percent, clay_percent)
    total = math.fsum(shares)
    if not all(math.isfinite(share) and share >= 0 for share in shares) or abs(total - 100) > 5:
        raise InvalidParameterError(
            f"Sand {sand_percent:g} %, silt {silt_percent:g} % and clay {clay_percent:g} % are no texture.",
            "Give three shares from 0 to 100 that add up to 100.",
        )
    sand, silt, clay = (share * 100 / total for share in shares)
    name = _usda_texture(sand, silt, clay)
    if "clay" in name:
        return name, SoilClass.CLAY
    return name, SoilClass.SAND if "sand" in name else SoilClass.SILT


def _usda_texture(sand: float, silt: float, clay: float) -> str:
    rules = (
        ("sand", silt + 1.5 * clay < 15),
        ("loamy sand", silt + 2 * clay < 30),
        ("sandy loam", (7 <= clay < 20 and sand > 52) or (clay < 7 and silt < 50)),
        ("loam", 7 <= clay < 27 and 28 <= silt < 50 and sand <= 52),
        ("silt", silt >= 80 and clay < 12),
        ("silt loam", silt >= 50 and clay < 27),
        ("sandy clay loam", 20 <= clay < 35 and silt < 28 and sand > 45),
        ("clay loam", 27 <= clay < 40 and 20 < sand <= 45),
        ("silty clay loam", 27 <= clay < 40 and sand <= 20),
        ("sandy clay", clay >= 35 and sand > 45),
        ("silty clay", clay >= 40 and silt >= 40),
    )
    return next((name for name, holds in rules if holds), "clay")


_PLURALS = frozenset({"clays", "gravels", "loams", "rocks", "sands", "silts"})
# "Sandy-clay loam" is one texture, not two components.
_HYPHENED_ADJECTIVE = r"(?i)\b(sandy|silty|clayey|loamy|gravelly|fine|coarse|very)-(?=\w)"
# A hyphen parts names only between words ("Butche-Stovho complex"), a stroke, a plus and these words always.
_SEPARATORS = r"(?i)(?<=\w)-(?=\w)|[/+;&]|\b(?:and|over|with|above|und|mit|ueber|über|auf|aus|from)\b"


@dataclass(frozen=True, slots=True)
class _Tables:
    """The tables of ``soil_labels.toml``, with phrases in padded lower case so that whole words match."""

    water: _Section
    rock: _Section
    fragments: dict[str, SoilClass]
    texture: dict[str, SoilClass]
    material: dict[str, SoilClass]
    types: dict[str, SoilClass]
    adjective: dict[str, SoilClass]
    uscs: dict[str, SoilClass]
    classes: dict[str, SoilClass]


@dataclass(frozen=True, slots=True)
class _Section:
    anywhere: tuple[str, ...]
    ending: tuple[str, ...]

    def matches(self, words: str) -> bool:
        return any(phrase in words for phrase in self.anywhere) or words.endswith(self.ending)


@cache
def _tables() -> _Tables:
    text = resources.files("swathe").joinpath("soil_labels.toml").read_text(encoding="utf-8")
    stored = tomllib.loads(text)

    def padded(phrases: Iterable[str]) -> tuple[str, ...]:
        return tuple(_words(phrase) for phrase in phrases)

    def by_class(section: str) -> dict[str, SoilClass]:
        return {
            phrase: SoilClass[name.upper()] for name, phrases in stored[section].items() for phrase in padded(phrases)
        }

    own_names = {_words(soil.name): soil for soil in SoilClass}
    return _Tables(
        water=_Section(padded(stored["none"]["any"]), padded(stored["none"]["ending"])),
        rock=_Section(padded(stored["rock"]["any"]), padded(stored["rock"]["ending"])),
        fragments=by_class("fragments"),
        texture=by_class("texture"),
        material=by_class("material"),
        types=by_class("type"),
        adjective=by_class("adjective"),
        uscs={symbol: SoilClass[name.upper()] for name, symbols in stored["uscs"].items() for symbol in symbols},
        classes=by_class("class") | own_names,
    )


def _words(text: str) -> str:
    """Return a text as lower-case words between single spaces, one at either end; empty for none."""
    folded = text.casefold()  # turns ß into ss
    for umlaut, plain in (("ä", "ae"), ("ö", "oe"), ("ü", "ue")):
        folded = folded.replace(umlaut, plain)
    bare = "".join(c for c in unicodedata.normalize("NFKD", folded) if not unicodedata.combining(c))
    words = re.findall(r"[a-z0-9]+", bare)
    singular = (word[:-1] if word in _PLURALS else word for word in words)
    return f" {' '.join(singular)} " if words else ""


def _classify_part(text: str) -> SoilClass | None:
    words = _words(text)
    if not words:
        return None
    tables = _tables()
    if tables.water.matches(words):
        return SoilClass.NONE
    if tables.rock.matches(words):
        return SoilClass.ROCK
    found = _longest(words, tables.fragments) or _symbol_in(text, tables.uscs)
    return (
        found
        or _longest(words, tables.texture)
        or _last(words, tables.material)
        or _last(words, tables.types)
        or _last(words, tables.adjective)
    )


def _symbol_in(text: str, uscs: dict[str, SoilClass]) -> SoilClass | None:
    """Return the class of a USCS symbol in brackets or at the end of a label: "silty sand (SM)"."""
    match = re.search(r"\(\s*([A-Z]{2}(?:-[A-Z]{2})?)\s*\)|[\s,:;-]([A-Z]{2}(?:-[A-Z]{2})?)\s*$", text)
    if match is None:
        return None
    symbol = match.group(1) or match.group(2)
    return uscs.get(symbol) or uscs.get(symbol.partition("-")[0])


def _longest(words: str, table: dict[str, SoilClass]) -> SoilClass | None:
    found = max((phrase for phrase in table if phrase in words), key=len, default=None)
    return None if found is None else table[found]


def _last(words: str, table: dict[str, SoilClass]) -> SoilClass | None:
    found = max(((words.rfind(phrase) + len(phrase), phrase) for phrase in table if phrase in words), default=None)
    return None if found is None else table[found[1]]


def soil_goodness(soil_class: SoilClass, *, table: str = "text") -> int:
    """Return the goodness 5 (best) to 1 of a class by the paper's ``text`` (silt 2) or its ``table2`` (silt 3)."""
    from swathe import _core

    return int(_core.soil_goodness(int(soil_class), table == "table2"))


def rating_cone_index_kpa(soil_class: SoilClass, moisture_percent: float) -> float | None:
    """Return the strength of a soil at a gravimetric moisture of 1 to 200 %, or None where it does not apply.

    Source: FASST, ERDC/CRREL SR-04-1, pp. 70-71; gravel takes the cap of 300 psi.
    """
    from swathe import _core

    return _core.rating_cone_index_kpa(int(soil_class), moisture_percent)
