"""What the words, symbols and figures of soil maps are read as."""

from __future__ import annotations

import tomllib
from importlib import resources

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.errors import InvalidParameterError
from swathe.soil import SoilClass, SoilEntry, SoilReport, classify_label, classify_texture, classify_uscs

GRAVEL, SAND, CLAY, SILT, ROCK, NONE = (SoilClass(code) for code in range(1, 7))


def test_the_codes_are_those_of_the_core() -> None:
    assert [(soil.name, soil.value) for soil in SoilClass] == [
        ("UNKNOWN", 0),
        ("GRAVEL", 1),
        ("SAND", 2),
        ("CLAY", 3),
        ("SILT", 4),
        ("ROCK", 5),
        ("NONE", 6),
    ]


@pytest.mark.parametrize(
    ("label", "soil"),
    [
        # The paper's names, in any case.
        ("gravel", GRAVEL), ("Sand", SAND), ("CLAY", CLAY), ("silt", SILT), ("rock", ROCK), ("Rocks", ROCK),
        ("none", NONE), ("unknown", SoilClass.UNKNOWN),
        # USDA textures, long and short, hyphened or not, singular or plural.
        ("loamy sand", SAND), ("fine sandy loam", SAND), ("loam", SILT), ("silt loam", SILT), ("Sandy clay loam", CLAY),
        ("silty_clay_loam", CLAY), ("Sandy-clay loam", CLAY), ("SICL", CLAY), ("VFSL", SAND), ("sandy loams", SAND),
        ("clayey sand", SAND), ("sandy clay", CLAY), ("sandy gravel", GRAVEL),
        # USCS beats texture; CL-ML is a silt.
        ("SM", SAND), ("gp-gm", GRAVEL), ("CL-ML", SILT), ("Pt", NONE), ("Silty clay (SC)", SAND),
        # Coarse fragments beat texture from "very" on.
        ("gravelly loam", SILT), ("very gravelly sandy loam", GRAVEL), ("GRV-SL", GRAVEL),
        # Map units as surveys print them.
        ("Kyle clay, KaA", CLAY), ("Nunn clay loam, 0 to 2 percent slopes", CLAY), ("Dumps, mine, Cc", ROCK),
        ("Pits, gravel", GRAVEL), ("Dune land", SAND), ("Beaches", SAND), ("Badland", ROCK), ("Stony loam", ROCK),
        ("Rock outcrop-Citadel complex", ROCK), ("Citadel-Rock outcrop complex", ROCK), ("sand-clay complex", SAND),
        ("loess over gravel", SILT), ("clay and loess", CLAY), ("silt and sand", SILT), ("peat over sand", NONE),
        # Names of places and series are not soils.
        ("Clear Lake clay", CLAY), ("Rock River loam", SILT), ("Clayton sandy loam", SAND), ("Houston clay", CLAY),
        # No ground.
        ("Water", NONE), ("Salt lake", NONE), ("mucky peat", NONE), ("Moor", NONE), ("HMoor", NONE),
        # German words and soil types.
        ("Löss", SILT), ("Schluff", SILT), ("Ton, schluffig", CLAY), ("lehmiger Sand", SAND), ("Kies", GRAVEL),
        ("Fels", ROCK), ("Auenboden", SILT), ("Parabraunerde", SILT), ("Pelosol", CLAY), ("Regosol", SAND),
        ("Rendzina", ROCK), ("Pararendzina", SILT), ("Gewässer", NONE),
        # Adjectives decide where nothing else does.
        ("sandy material", SAND), ("clayey derivatives", CLAY),
    ],
)  # fmt: skip
def test_a_label_is_read(label: str, soil: SoilClass) -> None:
    assert classify_label(label) is soil


@pytest.mark.parametrize(
    "label",
    [
        "",
        "  ",
        "A",
        "12",
        "3.5",
        "Mixed Forest",
        "Barren Land",
        "Canton series",
        "Sandstone",
        "Urban land",
        "sandpiper",
    ],
)
def test_what_is_not_understood_is_not_guessed(label: str) -> None:
    assert classify_label(label) is None


@given(st.text(max_size=60))
def test_no_label_breaks_the_reader(label: str) -> None:
    assert classify_label(label) in (None, *SoilClass)


def test_every_phrase_of_the_tables_is_read_as_its_table_says() -> None:
    tables = tomllib.loads(resources.files("swathe").joinpath("soil_labels.toml").read_text(encoding="utf-8"))
    wrong = [
        (phrase, name)
        for section in ("fragments", "texture", "material", "type", "adjective", "uscs", "class")
        for name, phrases in tables[section].items()
        for phrase in phrases
        if classify_label(phrase) is not SoilClass[name.upper()]
    ]
    for section, soil in (("none", NONE), ("rock", ROCK)):
        wrong += [
            (p, section) for kind in ("any", "ending") for p in tables[section][kind] if classify_label(p) is not soil
        ]
    assert wrong == []


@pytest.mark.parametrize(
    ("symbol", "soil"),
    [
        ("GW", GRAVEL),
        ("sp", SAND),
        ("SW-SM", SAND),
        ("ML/CL", SILT),
        ("CH", CLAY),
        ("OL", SILT),
        ("PT", NONE),
        ("CL-ML", SILT),
    ],
)
def test_a_uscs_symbol_is_read(symbol: str, soil: SoilClass) -> None:
    assert classify_uscs(symbol) is soil


@pytest.mark.parametrize("symbol", ["", "XX", "SW-", "SW-SM-GW", "sand"])
def test_other_symbols_are_not(symbol: str) -> None:
    assert classify_uscs(symbol) is None


@pytest.mark.parametrize(
    ("sand", "silt", "clay", "name", "soil"),
    [
        (92, 5, 3, "sand", SAND),
        (82, 12, 6, "loamy sand", SAND),
        (65, 25, 10, "sandy loam", SAND),
        (40, 40, 20, "loam", SILT),
        (5, 88, 7, "silt", SILT),
        (20, 65, 15, "silt loam", SILT),
        (60, 13, 27, "sandy clay loam", CLAY),
        (32, 34, 34, "clay loam", CLAY),
        (10, 56, 34, "silty clay loam", CLAY),
        (52, 6, 42, "sandy clay", CLAY),
        (6, 47, 47, "silty clay", CLAY),
        (20, 20, 60, "clay", CLAY),
        (41, 41, 20, "loam", SILT),  # adds up to 102 and is scaled
    ],
)
def test_the_usda_triangle(sand: float, silt: float, clay: float, name: str, soil: SoilClass) -> None:
    assert classify_texture(sand, silt, clay) == (name, soil)


@given(st.floats(0, 100), st.floats(0, 100))
def test_every_texture_has_a_name_that_is_read_as_its_class(one: float, two: float) -> None:
    low, high = sorted((one, two))
    name, soil = classify_texture(low, high - low, 100 - high)
    assert classify_label(name) is soil


@pytest.mark.parametrize("shares", [(50, 50, 50), (-10, 60, 50), (float("nan"), 50, 50), (0, 0, 0)])
def test_shares_that_are_no_texture_are_refused(shares: tuple[float, float, float]) -> None:
    with pytest.raises(InvalidParameterError, match="add up to 100"):
        classify_texture(*shares)


def test_a_report_says_what_was_read_as_what() -> None:
    entries = (
        SoilEntry("1", "clay and loess", CLAY, understood=True, cells=12_345),
        SoilEntry("9", "Urban land", SoilClass.UNKNOWN, understood=False, cells=7),
    )
    report = SoilReport("soil.gpkg", "label", entries, 0.5, disputed_cells=3)
    assert report.not_understood == entries[1:]
    assert report.lines() == [
        "Soil from soil.gpkg, field label covers 50.0 % of the map.",
        "1 (clay and loess): clay, 12,345 cells",
        "9 (Urban land): not understood, unknown, 7 cells",
        "3 cells lie in polygons of different soils; the worse soil was taken.",
    ]
    assert report.as_dict() == {
        "source": "soil.gpkg",
        "field": "label",
        "covered_fraction": 0.5,
        "disputed_cells": 3,
        "entries": [
            {"value": "1", "label": "clay and loess", "soil_class": "clay", "understood": True, "cells": 12345},
            {"value": "9", "label": "Urban land", "soil_class": "unknown", "understood": False, "cells": 7},
        ],
    }
