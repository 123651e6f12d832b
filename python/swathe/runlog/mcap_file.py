"""An MCAP file that grows chunk by chunk and is readable up to its last whole chunk at every moment.

Chunks are not compressed, so that their bytes depend on nothing but what is in them; every record but chunks and their
indexes is laid out by the ``mcap`` package.
"""

from __future__ import annotations

import zlib
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from swathe.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"
#: What stands before a message's body in a chunk.
MESSAGE_PREFIX = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_OPCODE_AND_LENGTH = 9
_CHUNK_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("start", "<u8"),
        ("end", "<u8"),
        ("size", "<u8"),
        ("crc", "<u4"),
        ("compression", "<u4"),
        ("stored", "<u8"),
    ]
)
_INDEX_HEAD = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("bytes", "<u4")])
_INDEX_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])


class Batch:
    """Messages of one channel for a chunk: their records one after the other, and where each begins."""

    def __init__(self, channel: int, times_ns: NDArray[np.uint64], starts: NDArray[np.uint64], content: bytes) -> None:
        self.channel, self.times_ns, self.starts, self.content = channel, times_ns, starts, content


class _Output(Protocol):
    """What the file needs of a stream; ``open(path, "wb", buffering=0)`` gives it."""

    def write(self, data: memoryview, /) -> int | None: ...
    def truncate(self, size: int, /) -> int: ...
    def close(self) -> None: ...


class ChunkedFile:
    """Writes the records of an MCAP file in order; an error leaves the file at the end of its last whole part."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stream: _Output | None = None
        self._end = 0
        self._crc = 0
        self._chunks: list[ChunkIndex] = []
        self._schemas: Sequence[Schema] = ()
        self._channels: Sequence[Channel] = ()
        self._indexes: list[McapRecord] = []
        self._counts: dict[int, int] = {}
        try:
            self._stream = path.open("wb", buffering=0)
        except OSError as error:
            raise self._refusal(error) from error

    def begin(
        self,
        library: str,
        metadata: Sequence[Metadata],
        attachments: Sequence[Attachment],
        schemas: Sequence[Schema],
        channels: Sequence[Channel],
    ) -> None:
        """Write what stands before the first chunk."""
        content = MAGIC + _bytes_of(Header("ros2", library))
        records: list[Metadata | Attachment] = [*metadata, *attachments]
        for record in records:
            written = _bytes_of(record)
            self._indexes.append(_index_of(record, len(content), len(written)))
            content += written
        self._schemas, self._channels = schemas, channels
        self._counts = {channel.id: 0 for channel in channels}
        self._write(content + _bytes_of(*schemas, *channels))

    def count(self, channel: int) -> int:
        """Return how many messages of a channel were written."""
        return self._counts[channel]

    def write_chunk(self, batches: Sequence[Batch]) -> None:
        """Write messages as one chunk with its indexes; nothing where there are none."""
        if not batches:
            return
        content = b"".join(batch.content for batch in batches)
        start = min(int(batch.times_ns.min()) for batch in batches)
        end = max(int(batch.times_ns.max()) for batch in batches)
        body = _CHUNK_HEAD.itemsize + len(content)
        head = np.array(
            (Opcode.CHUNK, body - _OPCODE_AND_LENGTH, start, end, len(content), zlib.crc32(content), 0, len(content)),
            _CHUNK_HEAD,
        )
        parts = [head.tobytes(), content]
        offsets: dict[int, int] = {}
        at, inside = self._end + body, 0
        for batch in batches:
            entries = np.empty(len(batch.times_ns), _INDEX_ENTRY)
            entries["time"], entries["offset"] = batch.times_ns, batch.starts + np.uint64(inside)
            length = _INDEX_HEAD.itemsize - _OPCODE_AND_LENGTH + entries.nbytes
            index = np.array((Opcode.MESSAGE_INDEX, length, batch.channel, entries.nbytes), _INDEX_HEAD)
            parts += [index.tobytes(), entries.tobytes()]
            offsets[batch.channel] = at
            at += length + _OPCODE_AND_LENGTH
            inside += len(batch.content)
        chunk = ChunkIndex(
            chunk_length=body,
            chunk_start_offset=self._end,
            compression="",
            compressed_size=len(content),
            message_end_time=end,
            message_index_length=at - self._end - body,
            message_index_offsets=offsets,
            message_start_time=start,
            uncompressed_size=len(content),
        )
        self._write(b"".join(parts))
        self._chunks.append(chunk)
        for batch in batches:
            self._counts[batch.channel] += len(batch.times_ns)

    def finish(self) -> None:
        """Write the summary and close the file."""
        content = _bytes_of(DataEnd(self._crc))
        start = self._end + len(content)
        groups: list[Sequence[McapRecord]] = [self._schemas, self._channels, [self._statistics()], self._chunks]
        groups += [
            [record for record in self._indexes if isinstance(record, kind)]
            for kind in (AttachmentIndex, MetadataIndex)
        ]
        summary, offsets = b"", []
        for group in groups:
            written = _bytes_of(*group)
            if written:
                offsets.append(SummaryOffset(written[0], start + len(summary), len(written)))
            summary += written
        offsets_at = start + len(summary)
        summary += _bytes_of(*offsets)
        # The sum covers the footer up to itself.
        footer = _bytes_of(Footer(start, offsets_at, 0))[:-4]
        crc = zlib.crc32(summary + footer)
        self._write(content + summary + footer + crc.to_bytes(4, "little") + MAGIC)
        self.close()

    def close(self) -> None:
        """Close the file as it is; twice is once."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    def _statistics(self) -> Statistics:
        indexes = self._indexes
        return Statistics(
            attachment_count=sum(isinstance(record, AttachmentIndex) for record in indexes),
            channel_count=len(self._channels),
            channel_message_counts={channel: count for channel, count in self._counts.items() if count},
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=sum(isinstance(record, MetadataIndex) for record in indexes),
            schema_count=len(self._schemas),
        )

    def _write(self, content: bytes) -> None:
        """Write all of it or, on an error, nothing."""
        if self._stream is None:
            raise OutputError(f"The run log {self.path} is closed.", "Write to a log before it is closed.")
        try:
            left = memoryview(content)
            while left:
                # An unbuffered file may take a part, as a disk does that becomes full.
                left = left[self._stream.write(left) or 0 :]
        except OSError as error:
            with suppress(OSError):
                self._stream.truncate(self._end)
            with suppress(OSError):
                self.close()
            raise self._refusal(error) from error
        self._end += len(content)
        self._crc = zlib.crc32(content, self._crc)

    def _refusal(self, error: OSError) -> OutputError:
        kept = " What it holds up to there can be read." if self._end else ""
        return OutputError(
            f"The run log {self.path} cannot be written: {error.strerror or error}.{kept}",
            "Check that its folder exists, may be written and is not full.",
        )


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]  # the package leaves it open
    return content


def _index_of(record: Metadata | Attachment, offset: int, length: int) -> McapRecord:
    if isinstance(record, Metadata):
        return MetadataIndex(offset, length, record.name)
    return AttachmentIndex(
        offset, length, record.log_time, record.create_time, len(record.data), record.name, record.media_type
    )
