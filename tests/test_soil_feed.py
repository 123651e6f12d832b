"""The soil feed: records in JSON lines, some of them broken, in a file that grows."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.errors import InvalidParameterError, MissingFileError
from swathe.soil import SoilClass
from swathe.soil_feed import SoilFeed, SoilUpdate, parse_update

if TYPE_CHECKING:
    from pathlib import Path

FLOOD = {"time_s": 12.5, "polygon": 7, "class": "none", "source": "gauge"}


def test_a_record_becomes_an_update() -> None:
    record = {
        "time_s": 3,
        "x_m": 10,
        "y_m": -4.5,
        "radius_m": 20,
        "probabilities": {"sand": 0.75, "Clay": 0.25},
        "cone_index_kpa": 300,
    }
    assert parse_update(json.dumps(record)) == SoilUpdate(
        time_s=3.0,
        disc=(10.0, -4.5, 20.0),
        probabilities={SoilClass.SAND: 0.75, SoilClass.CLAY: 0.25},
        cone_index_kpa=300.0,
    )
    assert parse_update(json.dumps(FLOOD)) == SoilUpdate(12.5, 7, soil_class=SoilClass.NONE, source="gauge")
    cells = parse_update('{"time_s": 0, "cells": [[1, 2], [3, 4]], "class": "sand"}')
    assert cells.cells == [(1, 2), (3, 4)]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("{", "not JSON"),
        ("[1]", "not an object"),
        ('{"polygon": 1, "class": "sand"}', "time_s is missing"),
        ('{"time_s": NaN, "polygon": 1, "class": "sand"}', "finite"),
        ('{"time_s": 1e999, "polygon": 1, "class": "sand"}', "finite"),
        ('{"time_s": true, "polygon": 1, "class": "sand"}', "finite"),
        ('{"time_s": 1, "class": "sand"}', "where"),
        ('{"time_s": 1, "polygon": 1, "cells": [[0, 0]], "class": "sand"}', "where"),
        ('{"time_s": 1, "polygon": 1}', "what is said"),
        ('{"time_s": 1, "polygon": 1, "class": "sand", "probabilities": {"sand": 1}}', "what is said"),
        ('{"time_s": 1, "polygon": 1, "class": "unknown"}', "one of"),
        ('{"time_s": 1, "polygon": 1, "class": "mud"}', "one of"),
        ('{"time_s": 1, "polygon": 1.5, "class": "sand"}', "whole number"),
        ('{"time_s": 1, "polygon": -1, "class": "sand"}', "no number of a polygon"),
        ('{"time_s": 1, "x_m": 0, "y_m": 0, "class": "sand"}', "radius_m"),
        ('{"time_s": 1, "cells": [[0]], "class": "sand"}', "cells must be"),
        ('{"time_s": 1, "cells": [[0, -1]], "class": "sand"}', "cells must be"),
        ('{"time_s": 1, "polygon": 1, "probabilities": {"sand": 0.5}}', "sum to 1"),
        ('{"time_s": 1, "polygon": 1, "probabilities": []}', "an object"),
        ('{"time_s": 1, "polygon": 1, "class": "sand", "speed": 3}', "unknown fields: speed"),
        ('{"time_s": 1, "polygon": 1, "class": "sand", "source": 3}', "source"),
        ("[" * 100_000, "not JSON"),
    ],
)
def test_a_broken_record_says_why(line: str, why: str) -> None:
    with pytest.raises(InvalidParameterError, match=why):
        parse_update(line)


@given(st.text(max_size=200) | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_any_line_is_an_update_or_a_reason(line: str) -> None:
    with suppress(InvalidParameterError):
        parse_update(line).row()


def test_a_growing_file_is_followed_and_broken_lines_are_told_by_number(tmp_path: Path) -> None:
    path = tmp_path / "feed.jsonl"
    path.write_bytes(b"")
    feed = SoilFeed(path)
    assert feed.due(100.0) == []
    with path.open("ab") as file:
        file.write(json.dumps(FLOOD).encode() + b"\n\nnonsense\n\xff\xfe\n")
        file.write(json.dumps({**FLOOD, "time_s": 30}).encode()[:25])
    assert feed.due(10.0) == []
    assert [update.time_s for update in feed.due(20.0)] == [12.5]
    assert [line for line, _ in feed.refused] == [3, 4]
    with path.open("ab") as file:
        file.write(json.dumps({**FLOOD, "time_s": 30}).encode()[25:] + b"\n")
        file.write(json.dumps({**FLOOD, "time_s": 25}).encode())
    assert [update.time_s for update in feed.due(99.0)] == [30.0]
    # The last line has no end yet: it may still grow.
    feed.finish()
    assert [update.time_s for update in feed.due(99.0)] == [25.0]
    assert feed.due(99.0) == []
    assert len(feed.refused) == 2


def test_a_line_that_never_ends_is_refused_when_the_feed_is_finished(tmp_path: Path) -> None:
    path = tmp_path / "feed.jsonl"
    path.write_text('{"time_s": 1, "pol', encoding="utf-8")
    feed = SoilFeed(path)
    assert feed.due(9.0) == []
    assert feed.refused == []
    feed.finish()
    assert feed.refused[0][0] == 1


def test_a_file_that_was_replaced_is_read_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "feed.jsonl"
    path.write_text("x" * 300 + "\n", encoding="utf-8")
    feed = SoilFeed(path)
    assert feed.due(99.0) == []
    path.write_text(json.dumps(FLOOD) + "\n", encoding="utf-8")
    assert [update.polygon for update in feed.due(99.0)] == [7]


def test_a_feed_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        SoilFeed(tmp_path / "none.jsonl")
