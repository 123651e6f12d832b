"""Whether a second run of a drive gave the same log, and if not, where they first part."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.runlog import cdr
from swathe.runlog.content import LogContent, Message, read_bytes, read_content
from swathe.runlog.definitions import TOPICS
from swathe.runlog.reader import map_row, mount_row, scan_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SHOWN = 40


@dataclass(frozen=True, slots=True)
class Difference:
    """Where two logs first part: at what simulated time, in which topic and field, and what either says."""

    time_s: float
    topic: str
    field: str
    logged: str
    again: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether two logs are equal, byte for byte; true when they are.

    Attributes:
        is_same: whether all bytes that were compared are equal.
        is_cut: whether the log was cut, so that only its whole chunks were compared.
        compared_bytes: how many bytes were compared.
        difference: where they first part.
        words: all of this in a sentence.
    """

    is_same: bool
    is_cut: bool
    compared_bytes: int
    difference: Difference | None
    words: str

    def __bool__(self) -> bool:
        return self.is_same


def verify(path: Path | str, again: Path | str) -> Verdict:
    """Compare a log with that of a second run: every byte, or of a log that was cut all its whole chunks.

    Raises:
        MissingFileError: a log does not exist.
        UnreadableFileError: one of them is no run log.
    """
    logged_bytes, again_bytes = read_bytes(Path(path)), read_bytes(Path(again))
    logged = read_content(Path(path), logged_bytes)
    is_cut = logged.cut is not None
    compared = logged.whole_bytes if is_cut else len(logged_bytes)
    if logged_bytes[:compared] == (again_bytes[:compared] if is_cut else again_bytes):
        what = f"All {compared:,} bytes before the cut" if is_cut else f"All {compared:,} bytes"
        return Verdict(True, is_cut, compared, None, f"{what} are the same.")
    difference = _header_difference(logged, other := read_content(Path(again), again_bytes))
    difference = difference or _message_difference(logged, other, is_cut=is_cut)
    if difference is None:
        return Verdict(False, is_cut, compared, None, "All messages are the same, the bytes around them are not.")
    words = (
        f"The runs part at {difference.time_s:.3f} s in {difference.topic}, {difference.field}: "
        f"{difference.logged} was logged, {difference.again} came now."
    )
    return Verdict(False, is_cut, compared, difference, words)


def _header_difference(logged: LogContent, again: LogContent) -> Difference | None:
    first, second = asdict(logged.header), asdict(again.header)
    for name, value in first.items():
        if value != second[name]:
            return Difference(0.0, "header", name, *_shown(value, second[name]))
    return None


def _message_difference(logged: LogContent, again: LogContent, *, is_cut: bool) -> Difference | None:
    """Return the earliest message that is not the same, in the first chunk where one is not."""
    for place, chunk in enumerate(logged.chunks):
        other = again.chunks[place] if place < len(again.chunks) else []
        if chunk != other:
            found = [
                difference
                for topic in TOPICS
                if (difference := _topic_difference(topic, *(_of(topic, messages) for messages in (chunk, other))))
            ]
            if found:
                return min(found, key=lambda difference: difference.time_s)
    if not is_cut and len(again.chunks) > len(logged.chunks):
        more = again.chunks[len(logged.chunks)][0]
        return Difference(more.logged_ns / 1e9, more.topic, "message", "none", "one more")
    return None


def _of(topic: str, messages: list[Message]) -> list[Message]:
    return [message for message in messages if message.topic == topic]


def _topic_difference(topic: str, logged: list[Message], again: list[Message]) -> Difference | None:
    for one, other in zip(logged, again, strict=False):
        if one == other:
            continue
        time_s = min(one.logged_ns, other.logged_ns) / 1e9
        if one[1:3] != other[1:3]:
            return Difference(time_s, topic, "time_s", f"{one.published_ns / 1e9!r}", f"{other.published_ns / 1e9!r}")
        first, second = fields_of(one), fields_of(other)
        for name in [*first, *(key for key in second if key not in first)]:
            if name not in first or name not in second or not _equal(first[name], second[name]):
                return Difference(time_s, topic, name, *_shown(first.get(name), second.get(name)))
        return Difference(time_s, topic, "bytes", one.body.hex()[:_SHOWN], other.body.hex()[:_SHOWN])
    if len(logged) != len(again):
        more = (logged if len(logged) > len(again) else again)[min(len(logged), len(again))]
        counts = (f"{len(logged)} messages", f"{len(again)} messages")
        return Difference(more.logged_ns / 1e9, topic, "message", *counts)
    return None


def fields_of(message: Message) -> dict[str, Any]:
    """Return the fields of a message of a run log, each of a nested one under its own name."""
    topic, body = message.topic, message.body
    kind = TOPICS[topic]
    if kind.json is not None:
        return _flat(json.loads(body))
    if kind.message == "nav_msgs/Path":
        return {"poses": cdr.read_path(body)}
    if kind.message == "sensor_msgs/LaserScan":
        row = scan_row(body)
    elif kind.message == "nav_msgs/OccupancyGrid":
        row = map_row(body)
    elif topic == "/tf_static":
        row = mount_row(body)
    else:
        row = _LAYOUTS[topic].read([body])[0]
    names = [name for name in row.dtype.names or () if row[name].dtype.kind != "V" and not name.endswith("length")]
    return {name: row[name] for name in names}


_LAYOUTS = {
    "/odom": cdr.odometry_layout(cdr.BODY_FRAME),
    "/truth": cdr.odometry_layout(cdr.TRUE_BODY_FRAME),
    "/cmd_vel": cdr.twist_layout(),
    "/tf": cdr.transform_layout(cdr.MAP_FRAME, cdr.BODY_FRAME),
    "/sonar": cdr.range_layout(),
}


def _flat(told: dict[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in told.items():
        found |= _flat(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
    return found


def _equal(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray | np.generic) and isinstance(other, np.ndarray | np.generic):
        return one.shape == other.shape and one.tobytes() == other.tobytes()
    return bool(one == other)


def _shown(one: object, other: object) -> tuple[str, str]:
    """Return both values shortly: of arrays the first place where they differ."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.ndim and one.shape == other.shape:
        place = _first_unequal(one, other)
        return f"{one[place]!s} at {list(map(int, place))}", f"{other[place]!s}"
    return _short(one), _short(other)


def _first_unequal(one: NDArray[Any], other: NDArray[Any]) -> tuple[int, ...]:
    size = one.dtype.itemsize
    raw = [np.frombuffer(values.tobytes(), f"V{size}") for values in (one, other)]
    return tuple(int(at) for at in np.unravel_index(int(np.flatnonzero(raw[0] != raw[1])[0]), one.shape))


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"
