"""The soil feed: records in JSON lines, some of them broken, in a file that grows."""

from __future__ import annotations

import itertools
import json
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swathe.errors import InvalidParameterError, MissingFileError
from swathe.news import FedNews
from swathe.soil import SoilClass
from swathe.soil_feed import SoilFeed, SoilUpdate, parse_update

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
    # The last line has no end yet, but its record is whole.
    assert [update.time_s for update in feed.due(99.0)] == [25.0, 30.0]
    feed.finish()
    assert feed.due(99.0) == []
    assert len(feed.refused) == 2


def test_a_record_whose_line_has_not_ended_is_taken_once(tmp_path: Path) -> None:
    path = tmp_path / "feed.jsonl"
    path.write_text(json.dumps(FLOOD), encoding="utf-8")
    feed = SoilFeed(path)
    assert [update.polygon for update in feed.due(99.0)] == [7]
    for more, polygons in (
        ("", []),
        (" \r", []),
        ("\n", []),
        (json.dumps({**FLOOD, "polygon": 8}) + "\n" + json.dumps({**FLOOD, "polygon": 9})[:-1], [8]),
        ("}", [9]),
        ("\n\n" + json.dumps({**FLOOD, "polygon": 10}), [10]),
    ):
        with path.open("a", encoding="utf-8") as file:
            file.write(more)
        assert [update.polygon for update in feed.due(99.0)] == polygons, more
    feed.finish()
    assert feed.due(99.0) == []
    assert feed.refused == []
    # What follows a record on its own line is no record, and is told with that line's number.
    for more in ("x", json.dumps(FLOOD), "\n[1]"):
        with path.open("a", encoding="utf-8") as file:
            file.write(more)
        assert feed.due(99.0) == []
    feed.finish()
    assert [line for line, _ in feed.refused] == [5, 6]
    assert "more follows" in feed.refused[0][1]


@given(
    lines=st.lists(
        st.sampled_from(
            [
                json.dumps(FLOOD),
                json.dumps({**FLOOD, "source": "Pegel Göttingen {}"}, ensure_ascii=False),
                '{"time_s": 1}',
                "{",
                "}",
                '"{}"',
                "[1]",
                "12",
                "",
            ]
        ),
        max_size=6,
    ),
    end=st.sampled_from(["\n", "\r\n", " \n"]),
    ends_well=st.booleans(),
    cuts=st.lists(st.floats(0, 1), max_size=8),
)
def test_however_a_file_grows_the_same_is_taken_from_it(
    lines: list[str], end: str, cuts: list[float], *, ends_well: bool
) -> None:
    content = end.join([*lines, ""] if ends_well else lines).encode()
    places = sorted({0, len(content), *(round(cut * len(content)) for cut in cuts)})
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for at, pieces in enumerate((places, [0, len(content)])):
            path = Path(folder) / f"feed-{at}.jsonl"
            path.write_bytes(b"")
            feed = SoilFeed(path)
            updates = []
            for first, last in itertools.pairwise(pieces):
                with path.open("ab") as file:
                    file.write(content[first:last])
                updates += feed.due(99.0)
            feed.finish()
            assert feed.due(99.0) == []
            found.append((updates, feed.refused))
    assert found[0] == found[1]
    assert len(found[0][0]) == sum("polygon" in line for line in lines)


def test_a_line_that_never_becomes_whole_is_refused_when_the_feed_is_finished(tmp_path: Path) -> None:
    path = tmp_path / "feed.jsonl"
    path.write_text('{"time_s": 1, "pol', encoding="utf-8")
    feed = SoilFeed(path)
    assert feed.due(9.0) == []
    assert feed.refused == []
    feed.finish()
    assert feed.refused[0][0] == 1


def test_news_of_a_file_tell_once_what_its_last_line_lacks(tmp_path: Path) -> None:
    path = tmp_path / "feed.jsonl"
    path.write_text("nonsense\n" + json.dumps(FLOOD), encoding="utf-8")
    news = FedNews(SoilFeed(path))
    updates, refused = news.due(99.0)
    assert updates == [parse_update(json.dumps(FLOOD))]
    assert [told["line"] for told in refused] == [1]
    with path.open("a", encoding="utf-8") as file:
        file.write("\n" + json.dumps(FLOOD)[:20])
    assert news.due(99.0) == ([], [])
    (last,) = news.finish()
    assert (last["line"], "not JSON" in last["reason"]) == (3, True)
    assert news.finish() == []
    path.unlink()
    (gone,) = news.finish()
    assert "cannot be read" in gone["reason"]


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
