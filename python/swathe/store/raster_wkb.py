"""Rasters as PostGIS stores them: the well-known binary form of one band, to numpy and back, bit for bit.

Source: ``raster/doc/RFC2-WellKnownBinaryFormat`` of PostGIS: a header of 61 bytes (byte order, version, number of
bands, scale, corner, skew, SRID, width, height), then for each band a byte of flags and pixel type, the value that
means "no data", and the pixels from the north-west by rows.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from swathe.errors import InvalidParameterError, UnreadableFileError

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEADER_BYTES = 61
LARGEST_SIDE = 65_535
_HEADER = "HHddddddiHH"
#: numpy's types by the number of the pixel type; whole numbers of less than 8 bits take a byte each.
_TYPES = {0: "u1", 1: "u1", 2: "u1", 3: "i1", 4: "u1", 5: "i2", 6: "u2", 7: "i4", 8: "u4", 10: "f4", 11: "f8"}
_NUMBERS = {"int8": 3, "uint8": 4, "int16": 5, "uint16": 6, "int32": 7, "uint32": 8, "float32": 10, "float64": 11}
_HAS_NODATA, _OFFLINE, _TYPE_BITS = 0x40, 0x80, 0x0F


@dataclass(frozen=True, eq=False)
class RasterTile:
    """One band and where it lies.

    Attributes:
        pixels: (rows, columns), row 0 in the north.
        west: x of the outer corner in the north-west, in the units of the system.
        north: y of that corner.
        scale_x: width of a pixel, eastward.
        scale_y: height of a pixel, negative for rows that run southward.
        srid: the system's number, 0 for none.
        nodata: the value of pixels that hold nothing, NaN allowed; None when all hold something.
    """

    pixels: NDArray[Any]
    west: float
    north: float
    scale_x: float
    scale_y: float
    srid: int = 0
    nodata: float | None = None


def encode(tile: RasterTile) -> bytes:
    """Return the binary form of a tile in the byte order of this machine's most likely server, little end first.

    Raises:
        InvalidParameterError: the pixels are not two-dimensional numbers that PostGIS has a type for, or too many.
    """
    pixels = np.asarray(tile.pixels)
    number = _NUMBERS.get(pixels.dtype.name)
    if number is None or pixels.ndim != 2:
        raise InvalidParameterError(
            f"Pixels of {pixels.dtype} and shape {pixels.shape} are no raster.", "Give rows and columns of numbers."
        )
    rows, columns = pixels.shape
    if max(rows, columns) > LARGEST_SIDE:
        raise InvalidParameterError(
            f"A raster of {rows} x {columns} pixels is too large.", f"Give at most {LARGEST_SIDE} on a side."
        )
    header = struct.pack(
        "<B" + _HEADER, 1, 0, 1, tile.scale_x, tile.scale_y, tile.west, tile.north, 0.0, 0.0, tile.srid, columns, rows
    )
    kind = pixels.dtype.newbyteorder("<")
    flags = number | (_HAS_NODATA if tile.nodata is not None else 0)
    nodata = np.array(0 if tile.nodata is None else tile.nodata, dtype=kind)
    body = np.ascontiguousarray(pixels, dtype=kind)
    return b"".join((header, bytes((flags,)), nodata.tobytes(), body.data))


def decode(wkb: bytes | memoryview) -> RasterTile:
    """Return the one band of a raster in binary form, in either byte order. The pixels are read-only.

    Raises:
        UnreadableFileError: it is cut short, of another version, rotated, without or with several bands, or kept in a
            file of the server.
    """
    if len(wkb) < HEADER_BYTES:
        raise _refusal("is cut short")
    order = "<" if wkb[0] == 1 else ">"
    fields = struct.unpack_from(order + _HEADER, wkb, 1)
    version, bands, scale_x, scale_y, west, north, skew_x, skew_y, srid, columns, rows = fields
    if version != 0:
        raise _refusal(f"has version {version}")
    if bands != 1:
        raise _refusal(f"has {bands} bands")
    if skew_x != 0 or skew_y != 0:
        raise _refusal("is rotated")
    if len(wkb) <= HEADER_BYTES:
        raise _refusal("is cut short")
    flags = wkb[HEADER_BYTES]
    name = _TYPES.get(flags & _TYPE_BITS)
    if name is None:
        raise _refusal(f"has pixels of type {flags & _TYPE_BITS}")
    if flags & _OFFLINE:
        raise _refusal("lies in a file of the server")
    kind = np.dtype(order + name)
    first = HEADER_BYTES + 1 + kind.itemsize
    if len(wkb) != first + rows * columns * kind.itemsize:
        raise _refusal("is cut short")
    nodata = float(np.frombuffer(wkb, kind, 1, HEADER_BYTES + 1)[0]) if flags & _HAS_NODATA else None
    pixels = np.frombuffer(wkb, kind, rows * columns, first).reshape(rows, columns)
    return RasterTile(pixels, west, north, scale_x, scale_y, srid, nodata)


def _refusal(what: str) -> UnreadableFileError:
    return UnreadableFileError(
        f"A raster of the database {what}.", "Import the layer anew, or name rasters of one band that are north up."
    )
