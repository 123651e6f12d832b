"""Writing a drive's log: each second of an episode becomes one chunk on disk."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import asdict, dataclass, field, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.records import Attachment, Channel, Metadata, Schema

from swathe import _core
from swathe.episode import STATUSES
from swathe.errors import InvalidParameterError
from swathe.runlog import cdr
from swathe.runlog.definitions import TOPICS, message_definition
from swathe.runlog.mcap_file import MESSAGE_PREFIX, Batch, ChunkedFile

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from types import TracebackType
    from typing import Self

    from numpy.typing import NDArray

    from swathe.episode import CertaintyMap, Outcome, Second, Sonar
    from swathe.runlog.cdr import Layout

CHANNELS = {topic: number for number, topic in enumerate(TOPICS, 1)}
#: The one figure of an outcome that a clock measures.
_MEASURED = "longest_step_s"
_MESSAGE = 5  # the opcode
_PREFIX = struct.Struct("<BQHIQQ")
_JSON = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False, allow_nan=False)
#: The greatest certainty of a cell.
MOST_CERTAIN = 15
#: What stands for a cell that was never seen.
UNSEEN = 255
#: ROS's occupancy of every certainty: to 100, and -1 where nothing is known.
_OCCUPANCY = np.full(UNSEEN + 1, -1, np.int8)
_OCCUPANCY[: MOST_CERTAIN + 1] = np.rint(np.arange(MOST_CERTAIN + 1) * (100 / MOST_CERTAIN))


@dataclass(frozen=True, slots=True, kw_only=True)
class LogHeader:
    """What stands at the start of a log: all that is needed to run the drive again, even when the log is cut.

    Attributes:
        seed: the seed of the drive.
        scenario: the scenario as TOML.
        vehicle: name of the vehicle.
        vehicle_toml: its figures as TOML, where they are not those of the bundled vehicle.
        body: what was driven: ``sim`` or the name of another simulator.
        inputs: name of each input and the SHA-256 of its content.
        files: other files that a second run needs, by name.
        version: the version that wrote the log.
    """

    seed: int
    scenario: str
    vehicle: str
    vehicle_toml: str = ""
    body: str = "sim"
    inputs: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    version: str = _core.__version__


class RunLogWriter:
    """Writes ``run.mcap`` while a drive goes on: whatever ends it, all seconds written so far can be read.

    Close it with the outcome; a log that is left without (an error, a ``with`` block that ends) counts as cut.
    """

    def __init__(self, file: Path | str, header: LogHeader) -> None:
        """Start a log, replacing the file.

        Raises:
            OutputError: the file cannot be written.
            InvalidParameterError: a file of the header has the name of one that every log holds.
        """
        if taken := {"scenario.toml", "vehicle.toml"} & set(header.files):
            raise InvalidParameterError(f"The log has a file {min(taken)} of its own.", "Give it another name.")
        self._file = ChunkedFile(Path(file))
        self._status: int | None = None
        self._has_mount = self._has_ring = False
        self._end_s = 0.0
        facts = {
            "version": header.version,
            "seed": str(header.seed),
            "vehicle": header.vehicle,
            "body": header.body,
        }
        texts = {"scenario.toml": header.scenario, "vehicle.toml": header.vehicle_toml}
        files = {name: text.encode() for name, text in texts.items() if text or name == "scenario.toml"}
        schemas, channels = _schemas_and_channels()
        self._file.begin(
            f"swathe {header.version}",
            [Metadata("swathe", facts), Metadata("inputs", dict(header.inputs))],
            [_attachment(name, content) for name, content in {**files, **header.files}.items()],
            schemas,
            channels,
        )

    def write(self, second: Second) -> None:
        """Write a second as one chunk.

        Raises:
            OutputError: the disk is full, or the log is closed; all chunks before can be read.
        """
        batches = (*self._motion(second), *self._sensed(second), *self._lines(second), *self._json(second))
        self._file.write_chunk(sorted((batch for batch in batches if batch), key=lambda batch: batch.channel))
        self._end_s = second.end_s

    def close(self, outcome: Outcome | Mapping[str, Any]) -> None:
        """Write how the drive ended and the index, and close the file.

        Raises:
            OutputError: the disk is full, or the log is closed.
        """
        fields = asdict(outcome) if is_dataclass(outcome) else dict(outcome)
        fields.pop(_MEASURED, None)
        batch = self._messages("/outcome", [(self._end_s, {"fields": fields})])
        self._file.write_chunk([batch] if batch else [])
        self._file.finish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _motion(self, second: Second) -> Iterator[Batch | None]:
        clock = _clock(second.odometry.times_s)
        for topic, motion, child in (
            ("/odom", second.odometry, cdr.BODY_FRAME),
            ("/truth", second.truth, cdr.TRUE_BODY_FRAME),
        ):
            rows, message = self._rows(topic, cdr.odometry_layout(child), clock)
            turns = cdr.quaternions(motion.heading_rad, motion.pitch_rad, motion.roll_rad)
            places = message["position"]
            places[:, 0], places[:, 1], message["orientation"] = motion.x_m, motion.y_m, turns
            message["linear"][:, 0], message["angular"][:, 2] = motion.speed_mps, motion.turn_rate_radps
            yield _batch(topic, rows)
            if topic == "/odom":
                rows, message = self._rows("/tf", cdr.transform_layout(cdr.MAP_FRAME, child), clock)
                message["transforms"], message["translation"], message["rotation"] = 1, places, turns
                yield _batch("/tf", rows)
        commands = second.commands
        rows, message = self._rows("/cmd_vel", cdr.twist_layout(), clock)
        message["linear"][:, 0], message["angular"][:, 2] = commands.speed_mps, commands.turn_rate_radps
        yield _batch("/cmd_vel", rows)

    def _sensed(self, second: Second) -> Iterator[Batch | None]:
        scans = second.scans
        beams = scans.ranges_m.shape[1] if scans.ranges_m.ndim == 2 else 0
        taken = _clock(scans.times_s)
        rows, message = self._rows("/scan", cdr.scan_layout(beams), taken, arrived_ns=_ns(scans.arrivals_s))
        for name, value in (
            ("angle_min", scans.angle_min_rad),
            ("angle_max", scans.angle_min_rad + (beams - 1) * scans.angle_increment_rad),
            ("angle_increment", scans.angle_increment_rad),
            ("range_min", scans.range_min_m),
            ("range_max", scans.range_max_m),
            ("ranges", scans.ranges_m),
        ):
            message[name] = value
        yield _batch("/scan", rows)
        if len(taken.times_ns) and not self._has_mount:
            self._has_mount = True
            layout = cdr.transform_layout(cdr.BODY_FRAME, cdr.LASER_FRAME)
            rows, message = self._rows("/tf_static", layout, _clock(scans.times_s[:1]))
            _set_mounts(message, [scans.mount])
            yield _batch("/tf_static", rows)
        yield from self._heard(second.sonar)

    def _heard(self, sonar: Sonar) -> Iterator[Batch | None]:
        if not len(sonar.times_s):
            return
        clock = _clock(sonar.times_s)
        rows, message = self._rows("/sonar", cdr.range_layout(), clock, arrived_ns=_ns(sonar.arrivals_s))
        frames = _frames(len(sonar.mounts))
        message["frame"] = frames[sonar.cones]
        message["radiation_type"] = 0  # ultrasound
        for name, value in (
            ("field_of_view", sonar.cone_rad),
            ("min_range", sonar.range_min_m),
            ("max_range", sonar.range_max_m),
            ("range", sonar.ranges_m),
        ):
            message[name] = value
        yield _batch("/sonar", rows)
        if not self._has_ring:
            self._has_ring = True
            layout = cdr.transform_layout(cdr.BODY_FRAME, cdr.cone_frame(0))
            rows, message = self._rows("/tf_static", layout, _clock(sonar.times_s[:1].repeat(len(sonar.mounts))))
            message["child"] = frames
            _set_mounts(message, sonar.mounts)
            yield _batch("/tf_static", rows)

    def _lines(self, second: Second) -> Iterator[Batch | None]:
        for topic, lines in (("/plan", second.routes), ("/local_plan", second.ways)):
            times_ns = [round(line.time_s * 1e9) for line in lines]
            bodies = [cdr.path_body(at, line.points_m) for at, line in zip(times_ns, lines, strict=True)]
            yield self._bodies(topic, times_ns, bodies)
        maps = [_map_body(window) for window in second.maps]
        yield self._bodies("/map", [round(window.time_s * 1e9) for window in second.maps], maps)

    def _json(self, second: Second) -> Iterator[Batch | None]:
        yield self._messages("/events", [(at, {"kind": kind, "fields": fields}) for at, kind, fields in second.events])
        yield self._messages("/status", list(self._changes(second)))
        yield self._messages("/histogram", [(at, {"fields": fields}) for at, fields in second.histograms])
        movers = second.movers
        if movers.radii_m.size:
            discs = (
                [[*place, radius] for place, radius in zip(places, movers.radii_m.tolist(), strict=True)]
                for places in movers.positions_m.tolist()
            )
            told = [(at, {"discs": all_}) for at, all_ in zip(movers.times_s.tolist(), discs, strict=True)]
            yield self._messages("/movers", told)
        yield self._messages("/readings", [(at, asdict(reading)) for at, reading in second.readings])
        grids = second.grids
        if len(grids.times_s):
            answers = ["".join("01"[said] for said in column) for column in grids.answers.T.astype(int).tolist()]
            navigable = "".join("01"[said] for said in grids.navigable.astype(int).tolist())
            said = {"times_s": grids.times_s.tolist(), "answers": answers, "navigable": navigable}
            yield self._messages("/grids", [(float(grids.times_s[-1]), said)])

    def _changes(self, second: Second) -> Iterator[tuple[float, dict[str, Any]]]:
        codes = second.commands.status
        if not len(codes):
            return
        before = np.concatenate([[-1 if self._status is None else self._status], codes[:-1]])
        for at in np.flatnonzero(codes != before).tolist():
            yield float(second.commands.times_s[at]), {"status": STATUSES[int(codes[at])]}
        self._status = int(codes[-1])

    def _rows(
        self, topic: str, layout: Layout, clock: _Clock, *, arrived_ns: NDArray[np.uint64] | None = None
    ) -> tuple[NDArray[np.void], NDArray[np.void]]:
        """Return a row a message with all but its figures filled in, and the view of the messages in them."""
        dtype, template = _record(layout, CHANNELS[topic])
        # Bytes, because an assignment of rows leaves the gaps between their fields as they are.
        rows = np.frombuffer(bytearray(template * len(clock.times_ns)), dtype)
        prefix, message = rows["prefix"], rows["message"]
        first = self._file.count(CHANNELS[topic])
        prefix["sequence"] = np.arange(first, first + len(rows))
        prefix["log_time"] = clock.times_ns if arrived_ns is None else arrived_ns
        prefix["publish_time"] = clock.times_ns
        message["stamp"] = clock.stamps
        return rows, message

    def _messages(self, topic: str, told: Sequence[tuple[float, dict[str, Any]]]) -> Batch | None:
        """Return JSON messages of a topic."""
        bodies = [_json_text({"time_s": time_s, **fields}).encode() for time_s, fields in told]
        return self._bodies(topic, [round(time_s * 1e9) for time_s, _ in told], bodies)

    def _bodies(self, topic: str, times_ns: Sequence[int], bodies: Sequence[bytes]) -> Batch | None:
        """Return messages of different lengths."""
        if not bodies:
            return None
        channel = CHANNELS[topic]
        first = self._file.count(channel)
        parts, starts, end = [], [], 0
        for place, (time_ns, body) in enumerate(zip(times_ns, bodies, strict=True)):
            length = _PREFIX.size - 9 + len(body)
            parts += [_PREFIX.pack(_MESSAGE, length, channel, first + place, time_ns, time_ns), body]
            starts.append(end)
            end += length + 9
        return Batch(channel, np.array(times_ns, np.uint64), np.array(starts, np.uint64), b"".join(parts))


class _Clock(NamedTuple):
    """Times of rows in nanoseconds, and as ROS's stamps."""

    times_ns: NDArray[np.uint64]
    stamps: NDArray[np.uint32]


def _clock(times_s: NDArray[np.float64]) -> _Clock:
    times_ns = _ns(times_s)
    return _Clock(times_ns, cdr.stamps(times_ns))


@lru_cache
def _record(layout: Layout, channel: int) -> tuple[np.dtype[np.void], bytes]:
    """Return how a message of a channel lies in a chunk, and the bytes of one without its figures."""
    dtype = np.dtype([("prefix", MESSAGE_PREFIX), ("message", layout.dtype)])
    row = np.zeros(1, dtype)
    row["prefix"]["opcode"], row["prefix"]["channel"], row["prefix"]["length"] = _MESSAGE, channel, dtype.itemsize - 9
    row["message"] = layout.template
    return dtype, row.tobytes()


def _batch(topic: str, rows: NDArray[np.void]) -> Batch | None:
    if not len(rows):
        return None
    starts = np.arange(len(rows), dtype=np.uint64) * np.uint64(rows.dtype.itemsize)
    return Batch(CHANNELS[topic], rows["prefix"]["log_time"], starts, rows.tobytes())


def _frames(cones: int) -> NDArray[np.void]:
    """Return the name of every cone's frame as it stands in messages."""
    names = [cdr.cone_frame(cone).encode() + b"\0" for cone in range(cones)]
    return np.frombuffer(b"".join(names), f"V{len(cdr.cone_frame(0)) + 1}")


def _set_mounts(message: NDArray[np.void], mounts: Sequence[tuple[float, float, float]]) -> None:
    """Fill in transforms to sensors: where each sits on the body."""
    ahead_m, left_m, heading_rad = np.array(mounts, np.float64).reshape(-1, 3).T
    message["transforms"] = 1
    message["translation"] = np.column_stack([ahead_m, left_m, np.zeros_like(left_m)])
    message["rotation"] = cdr.quaternions(heading_rad, np.zeros_like(heading_rad), np.zeros_like(heading_rad))


def _map_body(window: CertaintyMap) -> bytes:
    height, width = window.certainty.shape
    message = cdr.grid_layout(height * width).rows(1)
    message["stamp"] = message["load_time"] = cdr.stamps(_ns(np.array([window.time_s])))
    message["resolution"], message["width"], message["height"] = window.cell_size_m, width, height
    message["position"] = (window.west_m, window.north_m - height * window.cell_size_m, 0.0)
    message["orientation"] = (0.0, 0.0, 0.0, 1.0)
    # ROS counts rows from the south.
    message["data"] = _OCCUPANCY[window.certainty[::-1]].ravel()
    return message.tobytes()


def _ns(times_s: NDArray[np.float64]) -> NDArray[np.uint64]:
    return np.rint(np.maximum(times_s, 0.0) * 1e9).astype(np.uint64)


def _schemas_and_channels() -> tuple[list[Schema], list[Channel]]:
    """Return a schema for every kind of message, and a channel for every topic.

    A JSON channel says by name which schema it follows, not by number: rosbags opens no file in which a channel refers
    to a schema that is not ROS's.
    """
    schemas: dict[str, Schema] = {}
    channels = []
    for topic, (message, json_schema) in TOPICS.items():
        if message not in schemas:
            name = message if json_schema else message.replace("/", "/msg/")
            text = _json_text(json_schema) if json_schema else message_definition(message)
            encoding = "jsonschema" if json_schema else "ros2msg"
            schemas[message] = Schema(id=len(schemas) + 1, name=name, encoding=encoding, data=text.encode())
        channels.append(
            Channel(id=CHANNELS[topic], topic=topic, message_encoding="json", metadata={"schema": message}, schema_id=0)
            if json_schema
            else Channel(
                id=CHANNELS[topic],
                topic=topic,
                message_encoding="cdr",
                metadata={"offered_qos_profiles": ""},
                schema_id=schemas[message].id,
            )
        )
    return list(schemas.values()), channels


def _attachment(name: str, content: bytes) -> Attachment:
    kind = "application/toml" if name.endswith(".toml") else "application/octet-stream"
    return Attachment(create_time=0, log_time=0, name=name, media_type=kind, data=content)


def _json_text(value: object) -> str:
    try:
        return _JSON.encode(value)
    except (TypeError, ValueError):
        return _JSON.encode(_plain(value))


def _plain(value: object) -> object:
    """Return what JSON can hold: numpy's numbers and arrays as plain ones, and null for what is no number."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
