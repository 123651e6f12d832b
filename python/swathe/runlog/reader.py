"""Reading a log back into the arrays that an episode gave."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.episode import (
    STATUSES,
    CertaintyMap,
    Commands,
    Event,
    Grids,
    Histogram,
    Line,
    Motion,
    Movers,
    Reading,
    Scans,
    Sonar,
)
from swathe.errors import UnreadableFileError
from swathe.runlog import cdr
from swathe.runlog.content import LogContent, Message, read_bytes, read_content
from swathe.runlog.writer import MOST_CERTAIN, UNSEEN
from swathe.sensor import PenetrometerReading

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from swathe.runlog.writer import LogHeader


@dataclass(frozen=True, slots=True, eq=False)
class RunLog:
    """A drive as it was logged, over its whole length; the parts are those of ``swathe.episode.Second``.

    Angles and ranges of scans are as exact as ROS keeps them (32 bits). Scans of different lengths are filled up with
    NaN.

    Attributes:
        header: what stood in the log before the drive began.
        cut: why the log ends early, in a sentence; None for a complete one.
        outcome: how the drive ended; None in a log that was cut before.
        seconds: how many seconds (chunks) were read.
    """

    header: LogHeader
    cut: str | None
    outcome: dict[str, Any] | None
    seconds: int
    scans: Scans
    sonar: Sonar
    odometry: Motion
    truth: Motion
    commands: Commands
    events: list[Event]
    ways: list[Line]
    routes: list[Line]
    maps: list[CertaintyMap]
    histograms: list[Histogram]
    movers: Movers
    readings: list[Reading]
    grids: Grids

    @property
    def is_complete(self) -> bool:
        """Whether the log was closed in order."""
        return self.cut is None

    @property
    def scenario(self) -> str:
        """The scenario as TOML."""
        return self.header.scenario

    @classmethod
    def read(cls, path: Path | str) -> RunLog:
        """Read a log, also one that was cut at any byte: all whole seconds before the cut.

        Raises:
            MissingFileError: there is no such file.
            UnreadableFileError: it is no run log, or is cut before its scenario.
        """
        target = Path(path)
        content = read_content(target, read_bytes(target))
        try:
            return _run_log(content)
        except (ValueError, KeyError, TypeError, IndexError, struct.error) as error:
            raise UnreadableFileError(
                f"The run log {target} holds a message that cannot be read: {error}.", "Drive again."
            ) from error


def _run_log(content: LogContent) -> RunLog:
    ended = _json(content, "/outcome")
    return RunLog(
        header=content.header,
        cut=content.cut,
        outcome=ended[-1]["fields"] if ended else None,
        seconds=sum(any(message.topic != "/outcome" for message in chunk) for chunk in content.chunks),
        scans=_scans(content),
        sonar=_sonar(content),
        odometry=_motion(content.messages("/odom"), cdr.BODY_FRAME),
        truth=_motion(content.messages("/truth"), cdr.TRUE_BODY_FRAME),
        commands=_commands(content),
        events=[Event(told["time_s"], told["kind"], told["fields"]) for told in _json(content, "/events")],
        ways=_paths(content, "/local_plan"),
        routes=_paths(content, "/plan"),
        maps=[_map(message) for message in content.messages("/map")],
        histograms=[Histogram(told["time_s"], told["fields"]) for told in _json(content, "/histogram")],
        movers=_movers(_json(content, "/movers")),
        readings=[_reading(told) for told in _json(content, "/readings")],
        grids=_grids(_json(content, "/grids")),
    )


def _json(content: LogContent, topic: str) -> list[dict[str, Any]]:
    return [json.loads(message.body) for message in content.messages(topic)]


def _times_s(messages: Sequence[Message]) -> NDArray[np.float64]:
    return np.array([message.published_ns for message in messages], np.float64) / 1e9


def scan_row(body: bytes) -> NDArray[np.void]:
    """Return a LaserScan as a row of its layout; ValueError when its length fits no number of beams."""
    beams, rest = divmod(len(body) - cdr.scan_layout(0).dtype.itemsize, 4)
    if rest or beams < 0:
        raise ValueError("a scan's length is that of no number of beams")
    row: NDArray[np.void] = cdr.scan_layout(beams).read([body])[0]
    return row


def _scans(content: LogContent) -> Scans:
    messages = content.messages("/scan")
    arrivals_s = np.array([message.logged_ns for message in messages], np.float64) / 1e9
    mount = _mounts(content).get(cdr.LASER_FRAME, (0.0, 0.0, 0.0))
    lengths = {len(message.body) for message in messages}
    if len(lengths) == 1:
        beams = len(scan_row(messages[0].body)["ranges"])
        rows = cdr.scan_layout(beams).read([message.body for message in messages])
        ranges, first = rows["ranges"].copy(), rows[0]
    else:
        each = [scan_row(message.body) for message in messages]
        ranges = np.full((len(each), max((len(row["ranges"]) for row in each), default=0)), np.nan, np.float32)
        for place, row in enumerate(each):
            ranges[place, : len(row["ranges"])] = row["ranges"]
        first = each[0] if each else cdr.scan_layout(0).template[0]
    return Scans(
        _times_s(messages),
        arrivals_s,
        ranges,
        angle_min_rad=float(first["angle_min"]),
        angle_increment_rad=float(first["angle_increment"]),
        range_min_m=float(first["range_min"]),
        range_max_m=float(first["range_max"]),
        mount=mount,
    )


def mount_row(body: bytes) -> NDArray[np.void]:
    """Return a TFMessage of a sensor's place on the body as a row; ValueError when it fits no sensor."""
    for child in (cdr.LASER_FRAME, cdr.cone_frame(0)):
        layout = cdr.transform_layout(cdr.BODY_FRAME, child)
        if len(body) == layout.dtype.itemsize:
            row: NDArray[np.void] = layout.read([body])[0]
            if int(row["child length"]) == len(child) + 1:
                return row
    raise ValueError("a transform is to no sensor")


def _mounts(content: LogContent) -> dict[str, tuple[float, float, float]]:
    """Return ahead, left and heading of every sensor on the body by its frame."""
    found = {}
    for message in content.messages("/tf_static"):
        row = mount_row(message.body)
        heading, _, _ = cdr.attitude(row["rotation"][None])
        frame = row["child"].tobytes().rstrip(b"\0").decode()
        found[frame] = (float(row["translation"][0]), float(row["translation"][1]), float(heading[0]))
    return found


def _sonar(content: LogContent) -> Sonar:
    messages = content.messages("/sonar")
    rows = cdr.range_layout().read([message.body for message in messages])
    mounts = {frame: mount for frame, mount in _mounts(content).items() if frame != cdr.LASER_FRAME}
    numbers = {frame.encode() + b"\0": number for number, frame in enumerate(sorted(mounts))}
    first = rows[0] if len(rows) else cdr.range_layout().template[0]
    return Sonar(
        _times_s(messages),
        np.array([message.logged_ns for message in messages], np.float64) / 1e9,
        np.array([numbers[row.tobytes()] for row in rows["frame"]], np.uint8),
        rows["range"].copy(),
        cone_rad=float(first["field_of_view"]),
        range_min_m=float(first["min_range"]),
        range_max_m=float(first["max_range"]),
        mounts=[mounts[frame] for frame in sorted(mounts)],
    )


def _motion(messages: list[Message], child: str) -> Motion:
    rows = cdr.odometry_layout(child).read([message.body for message in messages])
    places, heading = rows["position"], cdr.attitude(rows["orientation"])
    return Motion(
        _times_s(messages),
        places[:, 0].copy(),
        places[:, 1].copy(),
        *heading,
        rows["linear"][:, 0].copy(),
        rows["angular"][:, 2].copy(),
    )


def _commands(content: LogContent) -> Commands:
    messages = content.messages("/cmd_vel")
    rows = cdr.twist_layout().read([message.body for message in messages])
    changes = content.messages("/status")
    codes = np.array([STATUSES.index(json.loads(message.body)["status"]) for message in changes], np.uint8)
    since_ns = np.array([message.logged_ns for message in changes], np.uint64)
    at_ns = np.array([message.logged_ns for message in messages], np.uint64)
    if len(at_ns) and (not len(since_ns) or since_ns[0] > at_ns[0]):
        raise ValueError("the first command has no status")
    status = codes[np.searchsorted(since_ns, at_ns, side="right") - 1] if len(at_ns) else codes[:0]
    return Commands(_times_s(messages), rows["linear"][:, 0].copy(), rows["angular"][:, 2].copy(), status)


def _paths(content: LogContent, topic: str) -> list[Line]:
    return [Line(message.published_ns / 1e9, cdr.read_path(message.body)) for message in content.messages(topic)]


def map_row(body: bytes) -> NDArray[np.void]:
    """Return an OccupancyGrid as a row of its layout; ValueError when its length does not fit."""
    cells = len(body) - cdr.grid_layout(0).dtype.itemsize
    if cells < 0:
        raise ValueError("a map is too short")
    row: NDArray[np.void] = cdr.grid_layout(cells).read([body])[0]
    return row


def _map(message: Message) -> CertaintyMap:
    row = map_row(message.body)
    height, width, cell_size_m = int(row["height"]), int(row["width"]), float(row["resolution"])
    occupancy = row["data"].reshape(height, width)[::-1]
    # The cell size is kept in 32 bits, as short as it was written.
    cell_size_m = float(str(np.float32(cell_size_m)))
    west_m, south_m = float(row["position"][0]), float(row["position"][1])
    certainty = np.where(occupancy < 0, float(UNSEEN), np.rint(occupancy * (MOST_CERTAIN / 100))).astype(np.uint8)
    return CertaintyMap(message.published_ns / 1e9, certainty, west_m, south_m + height * cell_size_m, cell_size_m)


def _movers(told: list[dict[str, Any]]) -> Movers:
    if not told:
        return Movers(np.zeros(0), np.zeros((0, 0, 2)), np.zeros(0))
    discs = np.array([each["discs"] for each in told], np.float64).reshape(len(told), -1, 3)
    radii = discs[0, :, 2].copy()
    return Movers(np.array([each["time_s"] for each in told], np.float64), discs[:, :, :2].copy(), radii)


def _numbers(told: list[float | None]) -> tuple[float, ...]:
    """Return numbers of a log, where JSON has null for what is none."""
    return tuple(math.nan if number is None else number for number in told)


def _reading(told: dict[str, Any]) -> Reading:
    return Reading(
        told["time_s"],
        PenetrometerReading(
            told["x_m"],
            told["y_m"],
            _numbers(told["depths_m"]),
            _numbers(told["cone_indices_kpa"]),
            told["refusal_depth_m"],
        ),
    )


def _grids(told: list[dict[str, Any]]) -> Grids:
    if not told:
        return Grids(np.zeros(0), np.zeros((0, 0), np.bool_), np.zeros(0, np.bool_))
    times_s = np.concatenate([each["times_s"] for each in told])
    answers = np.concatenate([np.array([_bits(signs) for signs in each["answers"]]).T for each in told])
    return Grids(times_s, answers, np.concatenate([_bits(each["navigable"]) for each in told]))


def _bits(signs: str) -> NDArray[np.bool_]:
    return np.array([sign == "1" for sign in signs], np.bool_)
