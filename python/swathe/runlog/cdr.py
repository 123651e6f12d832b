"""ROS 2 messages as bytes and back: many messages of one size at once, as rows of a numpy array.

CDR aligns every number to its own size from the start of the message's body, so a message whose texts and sequences
have known lengths is a fixed layout: a structured dtype.
"""

from __future__ import annotations

import math
import struct
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Rows = NDArray[np.void]

MAP_FRAME, BODY_FRAME, TRUE_BODY_FRAME, LASER_FRAME = "map", "base_link", "base_link_truth", "laser"

#: Little-endian CDR, the four bytes before every body.
_ENCAPSULATION = b"\x00\x01\x00\x00"
_HEADER = (("stamp", "stamp", 1), ("frame", "text", MAP_FRAME))
_NS = 1_000_000_000

_Field = tuple[str, str, int | str]


class Layout:
    """The bytes of a message of one size: ``dtype`` of a row, and a row in which all but the figures is filled in."""

    def __init__(self, fields: tuple[_Field, ...]) -> None:
        """Lay out fields.

        A field is (name, "text", its text), (name, "stamp", 1), or (name, dtype of a number, how many); with ``[]``
        behind the dtype it is a sequence of so many.
        """
        names, formats, offsets = ["encapsulation"], [np.dtype("V4")], [0]
        constants: dict[str, Any] = {"encapsulation": _ENCAPSULATION}
        end = 4

        def add(name: str, kind: str, alignment: int) -> None:
            nonlocal end
            at = end + -(end - 4) % alignment
            names.append(name)
            formats.append(np.dtype(kind))
            offsets.append(at)
            end = at + formats[-1].itemsize

        for name, kind, size in fields:
            if isinstance(size, str):
                text = size.encode() + b"\0"
                add(f"{name} length", "<u4", 4)
                add(name, f"V{len(text)}", 1)
                constants |= {f"{name} length": len(text), name: text}
            elif kind == "stamp":
                add(name, "2<u4", 4)
            elif kind.endswith("[]"):
                add(f"{name} length", "<u4", 4)
                constants[f"{name} length"] = size
                number = np.dtype(kind[:-2])
                # An empty sequence aligns nothing.
                add(name, f"({size},){number.str}", number.itemsize if size else 1)
            else:
                number = np.dtype(kind)
                add(name, number.str if size == 1 else f"({size},){number.str}", number.itemsize)
        self.dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})
        self.template = np.zeros(1, self.dtype)
        for name, value in constants.items():
            self.template[name] = value

    def rows(self, count: int) -> Rows:
        """Return messages in which all but the figures is filled in."""
        # Zeros first: copies and assignments leave the gaps between fields as they are.
        rows = np.zeros(count, self.dtype)
        rows[:] = self.template
        return rows

    def read(self, bodies: list[bytes]) -> Rows:
        """Return messages of this layout as rows; ValueError when one has another size or other texts."""
        if any(len(body) != self.dtype.itemsize for body in bodies):
            raise ValueError("a message has another size")
        return np.frombuffer(b"".join(bodies), self.dtype)


@lru_cache
def scan_layout(beams: int) -> Layout:
    """Return the layout of a LaserScan."""
    figures = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
    return Layout(
        (
            ("stamp", "stamp", 1),
            ("frame", "text", LASER_FRAME),
            *((name, "<f4", 1) for name in figures),
            ("ranges", "<f4[]", beams),
            ("intensities", "<f4[]", 0),
        )
    )


def cone_frame(cone: int) -> str:
    """Return the frame of a cone of the sonar ring; all names are of one length."""
    return f"sonar_{cone:02d}"


@lru_cache
def range_layout() -> Layout:
    """Return the layout of a Range; its ``frame`` is that of the first cone."""
    figures = ("field_of_view", "min_range", "max_range", "range")
    return Layout(
        (
            ("stamp", "stamp", 1),
            ("frame", "text", cone_frame(0)),
            ("radiation_type", "u1", 1),
            *((name, "<f4", 1) for name in figures),
        )
    )


@lru_cache
def odometry_layout(child: str) -> Layout:
    """Return the layout of an Odometry of a body."""
    return Layout(
        (
            *_HEADER,
            ("child", "text", child),
            ("position", "<f8", 3),
            ("orientation", "<f8", 4),
            ("pose_covariance", "<f8", 36),
            ("linear", "<f8", 3),
            ("angular", "<f8", 3),
            ("twist_covariance", "<f8", 36),
        )
    )


@lru_cache
def twist_layout() -> Layout:
    """Return the layout of a TwistStamped."""
    return Layout((("stamp", "stamp", 1), ("frame", "text", BODY_FRAME), ("linear", "<f8", 3), ("angular", "<f8", 3)))


@lru_cache
def transform_layout(parent: str, child: str) -> Layout:
    """Return the layout of a TFMessage with one transform."""
    return Layout(
        (
            ("transforms", "<u4", 1),
            ("stamp", "stamp", 1),
            ("frame", "text", parent),
            ("child", "text", child),
            ("translation", "<f8", 3),
            ("rotation", "<f8", 4),
        )
    )


@lru_cache
def grid_layout(cells: int) -> Layout:
    """Return the layout of an OccupancyGrid."""
    return Layout(
        (
            *_HEADER,
            ("load_time", "stamp", 1),
            ("resolution", "<f4", 1),
            ("width", "<u4", 1),
            ("height", "<u4", 1),
            ("position", "<f8", 3),
            ("orientation", "<f8", 4),
            ("data", "<i1[]", cells),
        )
    )


_PATH_HEAD = struct.Struct("<4sIII4sI")
# Alignment pads the first pose of a Path alone, so what follows is equal blocks: a pose, and the next one's header.
_FIRST_POSE_HEADER = struct.Struct("<III4s4x")
_POSE = np.dtype([("pose", "<f8", 7), ("stamp", "<u4", 2), ("length", "<u4"), ("frame", "V4")])
_POSE_HEADER_BYTES = 16


def path_body(time_ns: int, points_m: NDArray[np.float64]) -> bytes:
    """Return a Path through points (k, 2)."""
    seconds, nanoseconds = divmod(time_ns, _NS)
    text = MAP_FRAME.encode() + b"\0"
    header = (seconds, nanoseconds, len(text), text)
    head = _PATH_HEAD.pack(_ENCAPSULATION, *header, len(points_m))
    if len(points_m) == 0:
        return head
    rows = np.zeros(len(points_m), _POSE)
    rows["pose"][:, :2] = points_m
    rows["pose"][:, 6] = 1.0
    rows["stamp"], rows["length"], rows["frame"] = (seconds, nanoseconds), len(text), text
    return head + _FIRST_POSE_HEADER.pack(*header) + rows.tobytes()[:-_POSE_HEADER_BYTES]


def read_path(body: bytes) -> NDArray[np.float64]:
    """Return the points (k, 2) of a Path; ValueError when its length does not fit."""
    count = _PATH_HEAD.unpack_from(body)[-1]
    if count == 0:
        return np.zeros((0, 2))
    rows = np.frombuffer(body[_PATH_HEAD.size + _FIRST_POSE_HEADER.size :] + bytes(_POSE_HEADER_BYTES), _POSE)
    if len(rows) != count:
        raise ValueError("a path has another number of poses than it says")
    return rows["pose"][:, :2].copy()


def stamps(times_ns: NDArray[np.uint64]) -> NDArray[np.uint32]:
    """Return nanoseconds as rows of seconds and nanoseconds."""
    found = np.empty((len(times_ns), 2), np.uint32)
    found[:, 0] = seconds = times_ns // _NS
    found[:, 1] = times_ns - seconds * _NS
    return found


def quaternions(
    heading_rad: NDArray[np.float64], pitch_rad: NDArray[np.float64], roll_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return rows x, y, z, w of attitudes with nose up and right side down positive.

    ROS turns about axes ahead, left and up, so that its pitch has the other sign.
    """
    (cos_h, sin_h), (cos_p, sin_p), (cos_r, sin_r) = map(_half_angle, (heading_rad, -pitch_rad, roll_rad))
    found = np.empty((len(heading_rad), 4))
    found[:, 0] = sin_r * cos_p * cos_h - cos_r * sin_p * sin_h
    found[:, 1] = cos_r * sin_p * cos_h + sin_r * cos_p * sin_h
    found[:, 2] = cos_r * cos_p * sin_h - sin_r * sin_p * cos_h
    found[:, 3] = cos_r * cos_p * cos_h + sin_r * sin_p * sin_h
    return found


def _half_angle(angles_rad: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return cosine and sine of half of each angle; by the C library, for numpy's differ from machine to machine."""
    halves = (0.5 * angles_rad).tolist()
    return np.array([math.cos(half) for half in halves]), np.array([math.sin(half) for half in halves])


def attitude(quaternions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return heading, pitch and roll of rows x, y, z, w: the way back of ``quaternions``."""
    x, y, z, w = quaternions.T
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = -np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return heading, pitch, roll
