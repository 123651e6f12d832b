"""The run log: what was written comes back, other programs read it, and a cut costs only what lies beyond."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from drives import HEADER, OUTCOME, made_log, made_second
from swathe.episode import STATUSES, Event, Motion, Reading
from swathe.errors import MissingFileError, OutputError, UnreadableFileError
from swathe.runlog import LogHeader, RunLog, RunLogWriter, cdr, verify
from swathe.runlog.definitions import TOPICS, message_definition
from swathe.sensor import PenetrometerReading

if TYPE_CHECKING:
    from swathe.episode import Second

ROS = get_typestore(Stores.ROS2_HUMBLE)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


def joined(seconds: list[Second], part: str, name: str) -> Any:
    return np.concatenate([getattr(getattr(second, part), name) for second in seconds])


def test_what_was_written_comes_back(tmp_path: Path) -> None:
    made = made_log(tmp_path / "run.mcap")
    log = RunLog.read(tmp_path / "run.mcap")
    assert (log.is_complete, log.cut, log.seconds, log.outcome) == (True, None, 3, OUTCOME)
    assert log.header == HEADER
    assert log.scenario == HEADER.scenario
    assert np.array_equal(log.scans.ranges_m, joined(made, "scans", "ranges_m"), equal_nan=True)
    for part, name in (
        *(("scans", name) for name in ("times_s", "arrivals_s")),
        *(("sonar", name) for name in ("times_s", "arrivals_s", "cones")),
        *((part, name) for part in ("odometry", "truth") for name in ("times_s", "x_m", "y_m", "speed_mps")),
        *(("commands", name) for name in ("times_s", "speed_mps", "turn_rate_radps", "status")),
        *(("grids", name) for name in ("times_s", "answers", "navigable")),
        *(("movers", name) for name in ("times_s", "positions_m")),
    ):
        wanted, found = joined(made, part, name), getattr(getattr(log, part), name)
        assert wanted.shape == found.shape, (part, name)
        assert np.abs(wanted.astype(float) - found).max() <= 1e-9, (part, name)  # times are kept in nanoseconds
    assert log.scans.mount == pytest.approx(made[0].scans.mount)
    assert np.array_equal(log.sonar.ranges_m, joined(made, "sonar", "ranges_m"), equal_nan=True)
    assert np.allclose(log.sonar.mounts, made[0].sonar.mounts)
    assert (log.sonar.cone_rad, log.sonar.range_min_m, log.sonar.range_max_m) == (0.5, 0.125, 5.0)
    assert log.events == [event for second in made for event in second.events]
    assert log.histograms == [histogram for second in made for histogram in second.histograms]
    assert log.readings == [reading for second in made for reading in second.readings]
    for lines, wanted_lines in (
        (log.ways, [w for s in made for w in s.ways]),
        (log.routes, [r for s in made for r in s.routes]),
    ):
        assert [line.time_s for line in lines] == pytest.approx([line.time_s for line in wanted_lines])
        assert all(np.array_equal(a.points_m, b.points_m) for a, b in zip(lines, wanted_lines, strict=True))
    for found_map, wanted_map in zip(log.maps, [m for s in made for m in s.maps], strict=True):
        assert np.array_equal(found_map.certainty, wanted_map.certainty)
        assert found_map[2:] == pytest.approx(wanted_map[2:])


@given(angles=st.tuples(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3)))
def test_attitudes_come_back(angles: tuple[float, float, float]) -> None:
    found = cdr.attitude(cdr.quaternions(*np.array(angles)[:, None]))
    assert [float(angle[0]) for angle in found] == pytest.approx(angles, abs=1e-6)


def test_a_nose_up_is_a_negative_pitch_in_ros() -> None:
    x, y, z, w = cdr.quaternions(*np.array([[0.0], [0.2], [0.0]]))[0]
    # Turning the body's forward axis by the quaternion lifts it.
    assert 2 * (x * z - w * y) == pytest.approx(np.sin(0.2))


def test_every_definition_is_that_of_ros() -> None:
    mine = get_typestore(Stores.EMPTY)
    for message in {topic.message for topic in TOPICS.values() if topic.json is None}:
        mine.register(get_types_from_msg(message_definition(message), message.replace("/", "/msg/")))
    for name in mine.fielddefs:
        if name in ROS.fielddefs:
            assert mine.hash_rihs01(name) == ROS.hash_rihs01(name), name
    assert "sensor_msgs/msg/LaserScan" in mine.fielddefs


def ros_message(topic: str, body: bytes) -> Any:
    return ROS.deserialize_cdr(body, TOPICS[topic].message.replace("/", "/msg/"))


@settings(max_examples=40)
@given(
    steps=st.integers(0, 4),
    beams=st.integers(0, 5),
    points=st.lists(st.tuples(NUMBERS, NUMBERS), max_size=4),
    shape=st.tuples(st.integers(0, 4), st.integers(0, 4)),
    seed=st.integers(0, 999),
    start_s=st.integers(0, 10**6),
)
def test_messages_are_the_bytes_that_another_serializer_makes(
    tmp_path_factory: pytest.TempPathFactory,
    steps: int,
    beams: int,
    points: list[tuple[float, float]],
    shape: tuple[int, int],
    seed: int,
    start_s: int,
) -> None:
    second = made_second(float(start_s + 1), steps=steps, beams=beams, seed=seed)
    line = second.routes[0]._replace(points_m=np.array(points, np.float64).reshape(-1, 2))
    window = second.maps[0]._replace(certainty=np.full(shape, 7, np.uint8))
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with RunLogWriter(path, HEADER) as log:
        log.write(replace(second, routes=[line], maps=[window]))
        log.close(OUTCOME)
    counted = 0
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if channel.message_encoding != "cdr":
                continue
            told = ros_message(channel.topic, message.data)
            again = ROS.serialize_cdr(told, TOPICS[channel.topic].message.replace("/", "/msg/"))
            assert bytes(again) == message.data, channel.topic
            counted += 1
            if channel.topic == "/plan":
                assert [(pose.pose.position.x, pose.pose.position.y) for pose in told.poses] == points
            if channel.topic == "/scan":
                stamp = told.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == message.publish_time
            if channel.topic == "/sonar":
                assert told.header.frame_id in {"sonar_00", "sonar_01", "sonar_02"}
                assert (told.radiation_type, told.field_of_view, told.max_range) == (told.ULTRASOUND, 0.5, 5.0)
    # Five messages a step, three cones in at most four shots, the places of laser and cones, and the lines and the map.
    assert counted == 5 * steps + 3 * min(steps, 4) + 4 * bool(steps) + 3 + 1 + 1


def test_independent_readers_agree_on_every_count(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    made = made_log(path, 4)
    linear: dict[int, int] = {}
    with path.open("rb") as stream:
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Message):
                linear[record.channel_id] = linear.get(record.channel_id, 0) + 1
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.channel_message_counts == linear
        assert sum(1 for _ in reader.iter_messages()) == sum(linear.values())
        assert {record.name: record.metadata for record in reader.iter_metadata()}["swathe"]["seed"] == "7"
        files = {record.name: record.data for record in reader.iter_attachments()}
        assert files["scenario.toml"].decode() == HEADER.scenario
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg", "jsonschema"}
        # A search by time through the index finds what a walk through the file finds.
        found = [m.log_time for _, _, m in reader.iter_messages("/scan", starting_at=10**9, ending_before=2 * 10**9)]
        assert len(found) == 35
    with AnyReader([path]) as bag:
        counts = {connection.id: connection.msgcount for connection in bag.connections if connection.msgcount}
        assert counts == linear
        scans = [c for c in bag.connections if c.topic == "/scan"]
        ranges = [bag.deserialize(raw, c.msgtype).ranges for c, _, raw in bag.messages(scans)]  # type: ignore[attr-defined]
    assert np.array_equal(np.array(ranges), joined(made, "scans", "ranges_m"), equal_nan=True)


def test_json_channels_hold_what_their_schemas_say(tmp_path: Path) -> None:
    made_log(tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        schemas = {
            schema.name: json.loads(schema.data)
            for schema in summary.schemas.values()
            if schema.encoding == "jsonschema"
        }
        seen = set()
        for _, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                told, schema = json.loads(message.data), schemas[channel.metadata["schema"]]
                assert set(told) == set(schema["properties"]), channel.topic
                assert told["time_s"] == pytest.approx(message.log_time / 1e9)
                seen.add(channel.topic)
    assert seen == {topic for topic, kind in TOPICS.items() if kind.json}


def test_equal_drives_are_equal_bytes_and_other_drives_are_not(tmp_path: Path) -> None:
    for name, seconds in (("a", 2), ("b", 2), ("c", 3)):
        made_log(tmp_path / name, seconds)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert (tmp_path / "a").read_bytes() != (tmp_path / "c").read_bytes()


def test_what_a_clock_measured_stays_out(tmp_path: Path) -> None:
    for name, longest in (("a", 0.1), ("b", 0.2)):
        with RunLogWriter(tmp_path / name, HEADER) as log:
            log.close({**OUTCOME, "longest_step_s": longest})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@settings(max_examples=60)
@given(data=st.data())
def test_a_log_cut_at_any_byte_is_read_up_to_the_cut(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    made_log(folder / "whole", 4, steps=3, beams=4)
    whole = (folder / "whole").read_bytes()
    with (folder / "whole").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = [
        (index.chunk_start_offset, index.chunk_start_offset + index.chunk_length) for index in summary.chunk_indexes
    ]
    at = data.draw(st.integers(0, len(whole) - 1))
    (folder / "cut").write_bytes(whole[:at])
    if at < chunks[0][0]:
        # A killed drive has no such log: what stands before the first chunk is one write.
        if _readable(folder / "cut"):
            assert RunLog.read(folder / "cut").seconds == 0
        return
    log = RunLog.read(folder / "cut")
    assert not log.is_complete
    assert f"{at:,}" in (log.cut or "")
    ends = [end for _, end in chunks[:4]]
    assert log.seconds == sum(end <= at for end in ends)
    assert len(log.odometry.times_s) == 3 * log.seconds
    assert log.scenario == HEADER.scenario
    assert (log.outcome is not None) == (at >= chunks[-1][1])
    verdict = verify(folder / "cut", folder / "whole")
    assert verdict
    assert verdict.is_cut
    assert ends[log.seconds - 1] * bool(log.seconds) <= verdict.compared_bytes <= at


def read_by_another(path: Path) -> tuple[list[tuple[str, int, bytes]], bool]:
    """Walk through a log with mcap's reader that needs no index: the messages, and whether it came to the end."""
    found = []
    with path.open("rb") as stream:
        try:
            for _, channel, message in NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False):
                found.append((channel.topic, message.log_time, message.data))
        except (EndOfFile, struct.error):  # what it raises in the middle of a record, and of a record's length
            return found, False
    return found, True


def test_another_reader_walks_through_a_cut_log_up_to_its_last_whole_chunk(tmp_path: Path) -> None:
    made_log(tmp_path / "whole", 4)
    whole = (tmp_path / "whole").read_bytes()
    messages, is_whole = read_by_another(tmp_path / "whole")
    assert is_whole
    with (tmp_path / "whole").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = [(index.chunk_start_offset, index.chunk_length) for index in summary.chunk_indexes]
    assert len(chunks) == 5, "one a second, and the outcome's"
    before = 0
    for number, (begin, length) in enumerate(chunks, 1):
        told = []
        # At a chunk's first byte, in its head, in its middle, before its last byte, and where it ends.
        for at in (begin, begin + 5, begin + length // 2, begin + length - 1, begin + length):
            (tmp_path / "cut").write_bytes(whole[:at])
            found, is_whole = read_by_another(tmp_path / "cut")
            assert not is_whole, at
            assert found == messages[: len(found)], at
            told.append(len(found))
        assert told[:4] == [before] * 4
        assert told[4] > before, "every whole chunk is read"
        before = told[4]
        seconds = RunLog.read(tmp_path / "cut").seconds
        assert seconds == min(number, 4), "as many as our own reader finds"
    assert before == len(messages)


@settings(max_examples=60)
@given(at=st.integers(0, 10**9), bit=st.integers(0, 7))
def test_a_damaged_log_is_said_to_be_damaged(tmp_path_factory: pytest.TempPathFactory, at: int, bit: int) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    made_log(folder / "whole", 2, steps=3, beams=4)
    content = bytearray((folder / "whole").read_bytes())
    content[at % len(content)] ^= 1 << bit
    (folder / "damaged").write_bytes(content)
    if not _readable(folder / "damaged"):
        return
    log, whole = RunLog.read(folder / "damaged"), RunLog.read(folder / "whole")
    assert not log.is_complete
    assert not verify(folder / "whole", folder / "damaged")
    if at % len(content) > 16_000:  # behind the channels: what was read before the damage is as it was
        assert np.array_equal(log.odometry.x_m, whole.odometry.x_m[: len(log.odometry.x_m)])


def _readable(path: Path) -> bool:
    try:
        RunLog.read(path)
    except UnreadableFileError:
        return False
    return True


def changed(second: Second, part: str, name: str, place: tuple[int, ...]) -> Second:
    values = getattr(getattr(second, part), name).copy()
    values[place] += 1
    return replace(second, **{part: replace(getattr(second, part), **{name: values})})


@pytest.mark.parametrize(
    ("part", "name", "topic", "field"),
    [
        ("scans", "ranges_m", "/scan", "ranges"),
        ("sonar", "ranges_m", "/sonar", "range"),
        ("odometry", "x_m", "/odom", "position"),
        ("truth", "speed_mps", "/truth", "linear"),
        ("commands", "turn_rate_radps", "/cmd_vel", "angular"),
    ],
)
def test_the_first_difference_is_named(tmp_path: Path, part: str, name: str, topic: str, field: str) -> None:
    made = made_log(tmp_path / "a")
    values = getattr(getattr(made[1], part), name)
    row = 10 if part == "sonar" else 20
    made[1] = changed(made[1], part, name, (row, 3)[: values.ndim])
    with RunLogWriter(tmp_path / "b", HEADER) as log:
        for second in made:
            log.write(second)
        log.close(OUTCOME)
    assert verify(tmp_path / "a", tmp_path / "a")
    verdict = verify(tmp_path / "a", tmp_path / "b")
    assert not verdict
    assert verdict.difference is not None
    arrivals_s = getattr(getattr(made[1], part), "arrivals_s", made[1].odometry.times_s)
    assert verdict.difference.time_s == pytest.approx(arrivals_s[row])
    assert (verdict.difference.topic, verdict.difference.field) == (topic, field)
    assert topic in verdict.words


def test_other_endings_scenarios_and_events_are_named(tmp_path: Path) -> None:
    made = made_log(tmp_path / "a")

    def verdict_on(header: LogHeader, seconds: list[Second], outcome: dict[str, Any]) -> tuple[str, str]:
        with RunLogWriter(tmp_path / "b", header) as log:
            for second in seconds:
                log.write(second)
            log.close(outcome)
        found = verify(tmp_path / "a", tmp_path / "b").difference
        assert found is not None
        return found.topic, found.field

    assert verdict_on(replace(HEADER, seed=8), made, OUTCOME) == ("header", "seed")
    assert verdict_on(replace(HEADER, scenario="x = 1"), made, OUTCOME) == ("header", "scenario")
    assert verdict_on(HEADER, made, {**OUTCOME, "distance_m": 1.0}) == ("/outcome", "fields.distance_m")
    other = replace(made[0], events=[Event(0.25, "obstacle_seen", made[0].events[0].fields)])
    assert verdict_on(HEADER, [other, *made[1:]], OUTCOME) == ("/events", "time_s")
    other = replace(made[0], events=[*made[0].events, *made[0].events])
    assert verdict_on(HEADER, [other, *made[1:]], OUTCOME) == ("/events", "message")
    assert verdict_on(HEADER, made[:2], OUTCOME)[1] == "message"
    assert verdict_on(HEADER, [*made, made_second(3.0)], OUTCOME)[1] == "message"


def test_a_second_run_that_ends_sooner_than_a_cut_log_is_another(tmp_path: Path) -> None:
    made_log(tmp_path / "cut", 3, close=False)
    made_log(tmp_path / "short", 2)
    made_log(tmp_path / "long", 4)
    assert not verify(tmp_path / "cut", tmp_path / "short")
    assert verify(tmp_path / "cut", tmp_path / "long")


def test_the_status_of_every_command_comes_back(tmp_path: Path) -> None:
    seconds = [made_second(float(at)) for at in range(2)]
    for second in seconds:
        second.commands.status[:] = np.arange(35) // 9 % len(STATUSES)
    with RunLogWriter(tmp_path / "a", HEADER) as log:
        for second in seconds:
            log.write(second)
    found = RunLog.read(tmp_path / "a").commands.status
    assert np.array_equal(found, np.concatenate([second.commands.status for second in seconds]))


def test_a_log_without_anything_in_it_is_one(tmp_path: Path) -> None:
    nothing = Motion(*(np.zeros(0) for _ in fields(Motion)))
    second = made_second(
        steps=0, odometry=nothing, truth=nothing, events=[], ways=[], routes=[], maps=[], histograms=[], readings=[]
    )
    with RunLogWriter(tmp_path / "a", HEADER) as log:
        log.write(second)
    log_read = RunLog.read(tmp_path / "a")
    assert (log_read.seconds, len(log_read.odometry.times_s), log_read.is_complete) == (0, 0, False)


def test_what_a_broken_instrument_told_is_no_number_in_the_log(tmp_path: Path) -> None:
    reading = PenetrometerReading(1.0, 2.0, (0.1, 0.2), (math.nan, math.inf), None)
    with RunLogWriter(tmp_path / "a", HEADER) as log:
        log.write(made_second(readings=[Reading(0.2, reading)]))
    [found] = RunLog.read(tmp_path / "a").readings
    assert found.reading.depths_m == (0.1, 0.2)
    assert all(math.isnan(number) for number in found.reading.cone_indices_kpa)


def test_a_full_disk_is_said_and_the_log_stays_readable(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: it takes a part of the last chunk, as a disk does."""
    code = f"""
import resource, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from drives import HEADER, made_second
from swathe.errors import OutputError
from swathe.runlog import RunLogWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, resource.RLIM_INFINITY))
log = RunLogWriter(sys.argv[1], HEADER)
for at in range(100):
    try:
        log.write(made_second(float(at), seed=at))
    except OutputError as error:
        print(at, error)
        break
try:
    log.write(made_second(100.0))
except OutputError as error:
    print(error)
"""
    path = tmp_path / "run.mcap"
    run = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    first, second = run.stdout.splitlines()
    written = int(first.split()[0])
    assert written > 1
    assert "cannot be written" in first
    assert "can be read" in first
    assert "is closed" in second
    log = RunLog.read(path)
    assert log.seconds == written
    assert path.stat().st_size < 400_000
    made_log(tmp_path / "again", 100)
    assert verify(path, tmp_path / "again")


def test_files_that_cannot_be_written_or_read_are_plain_errors(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        RunLogWriter(tmp_path / "no" / "run.mcap", HEADER)
    with pytest.raises(OutputError, match="cannot be written"):
        RunLogWriter("/dev/full", HEADER)
    with pytest.raises(MissingFileError):
        RunLog.read(tmp_path / "no.mcap")
    (tmp_path / "text").write_text("hello")
    with pytest.raises(UnreadableFileError, match="no run log"):
        RunLog.read(tmp_path / "text")
    with pytest.raises(UnreadableFileError, match="cannot be read"):
        RunLog.read(tmp_path)
    log = RunLogWriter(tmp_path / "run.mcap", HEADER)
    log.close(OUTCOME)
    with pytest.raises(OutputError, match="is closed"):
        log.write(made_second())
    assert RunLog.read(tmp_path / "run.mcap").outcome == OUTCOME


def test_a_killed_drive_leaves_every_second_that_was_written(tmp_path: Path) -> None:
    code = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from drives import HEADER, made_second
from swathe.runlog import RunLogWriter
log = RunLogWriter(sys.argv[1], HEADER)
for at in range(3):
    log.write(made_second(float(at), seed=at))
os.kill(os.getpid(), signal.SIGKILL)
"""
    run = subprocess.run([sys.executable, "-c", code, tmp_path / "run.mcap"], capture_output=True, check=False)
    assert run.returncode == -9
    log = RunLog.read(tmp_path / "run.mcap")
    assert (log.seconds, log.is_complete) == (3, False)


def test_what_json_cannot_hold_becomes_null(tmp_path: Path) -> None:
    event = Event(0.5, "measured", {"clearance_m": float("inf"), "cells": np.arange(3), "share": np.float32(0.5)})
    made = made_second(events=[event])
    with RunLogWriter(tmp_path / "a", HEADER) as log:
        log.write(made)
    told = RunLog.read(tmp_path / "a").events[0].fields
    assert told == {"clearance_m": None, "cells": [0, 1, 2], "share": 0.5}
