"""What a log's bytes hold, up to where they end or make no more sense."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

from swathe.errors import MissingFileError, UnreadableFileError
from swathe.runlog.mcap_file import MAGIC
from swathe.runlog.writer import LogHeader

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQQ")
_REMEDY = "Give a drive's folder or its run.mcap."
_TEXT_FILES = ("scenario.toml", "vehicle.toml")


class Message(NamedTuple):
    """A message as it stands in the file; ``published_ns`` is its own time, ``logged_ns`` that of its arrival."""

    topic: str
    logged_ns: int
    published_ns: int
    body: bytes


@dataclass(slots=True)
class LogContent:
    """What was found.

    Attributes:
        header: what stands before the first chunk.
        chunks: the messages of each whole chunk.
        whole_bytes: up to where the records are whole.
        cut: why there is no more, in a sentence; None for a complete log.
    """

    header: LogHeader
    chunks: list[list[Message]]
    whole_bytes: int
    cut: str | None

    def messages(self, topic: str) -> list[Message]:
        """Return all messages of a topic in order."""
        return [message for chunk in self.chunks for message in chunk if message.topic == topic]


@dataclass(slots=True)
class _Found:
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[list[Message]] = field(default_factory=list)
    has_footer: bool = False


def read_bytes(path: Path) -> bytes:
    """Return a file's bytes.

    Raises:
        MissingFileError: there is no such file.
        UnreadableFileError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise MissingFileError(f"The run log {path} does not exist.", _REMEDY) from error
    except OSError as error:
        raise UnreadableFileError(
            f"The run log {path} cannot be read: {error.strerror or error}.", "Check the file and its permissions."
        ) from error


def read_content(path: Path, content: bytes) -> LogContent:
    """Return what a log's bytes hold up to where they are cut or damaged.

    Raises:
        UnreadableFileError: this is no run log, or one that is cut before its scenario.
    """
    if not content.startswith(MAGIC):
        raise UnreadableFileError(f"{path} is no run log: it does not begin as MCAP files do.", _REMEDY)
    found, whole_bytes, cut = _Found(), len(MAGIC), None
    try:
        for opcode, body, end in _records(content):
            _take(found, opcode, body)
            whole_bytes = end
    except _CutError as error:
        cut = str(error)
    except (McapError, ValueError, struct.error, IndexError, UnicodeError) as error:
        cut = f"It is damaged at byte {whole_bytes:,}: {error}."
    if cut is None and not found.has_footer:
        cut = f"It ends at byte {len(content):,} without an index."
    elif cut is None and content[whole_bytes:] != MAGIC:
        cut = f"It ends at byte {len(content):,} before its last sign."
    if "scenario.toml" not in found.files or not found.channels:
        if cut is None:
            raise UnreadableFileError(f"{path} is an MCAP file but no run log of a drive.", _REMEDY)
        raise UnreadableFileError(f"{path} holds no drive. {cut}", "Drive again.")
    return LogContent(_header(found), found.chunks, whole_bytes, cut)


class _CutError(Exception):
    """The bytes end within a record."""


def _records(content: bytes) -> Iterator[tuple[int, memoryview, int]]:
    """Yield each whole record up to the footer: its opcode, its body and where it ends."""
    at, view = len(MAGIC), memoryview(content)
    while at < len(content):
        end = at + _RECORD.size
        opcode, length = _RECORD.unpack_from(content, at) if end <= len(content) else (0, 0)
        if end + length > len(content) or opcode == 0:
            raise _CutError(f"It is cut at byte {len(content):,}.")
        yield opcode, view[end : end + length], end + length
        at = end + length
        if opcode == Opcode.FOOTER:
            return


def _take(found: _Found, opcode: int, body: memoryview) -> None:
    """Add what a record says."""
    if opcode == Opcode.CHUNK:
        stream, size = get_chunk_data_stream(Chunk.read(_stream(body)), validate_crc=True)
        found.chunks.append(_messages(stream.read(size), found))
    elif opcode == Opcode.METADATA:
        record = Metadata.read(_stream(body))
        found.facts[record.name] = record.metadata
    elif opcode == Opcode.ATTACHMENT:
        attachment = Attachment.read(_stream(body))
        found.files[attachment.name] = attachment.data
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(_stream(body))
        found.channels[channel.id] = channel
    elif opcode == Opcode.SCHEMA:
        Schema.read(_stream(body))
    elif opcode == Opcode.FOOTER:
        found.has_footer = True


def _messages(content: bytes, found: _Found) -> list[Message]:
    messages, at = [], 0
    while at < len(content):
        opcode, length = _RECORD.unpack_from(content, at)
        end = at + _RECORD.size + length
        if end > len(content):
            raise ValueError("a message is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            _, _, channel, _, logged_ns, published_ns = _MESSAGE.unpack_from(content, at)
            if channel not in found.channels:
                raise ValueError(f"there is no channel {channel}")
            topic = found.channels[channel].topic
            messages.append(Message(topic, logged_ns, published_ns, content[at + _MESSAGE.size : end]))
        else:  # other programs put channels into chunks
            _take(found, opcode, memoryview(content)[at + _RECORD.size : end])
        at = end
    return messages


def _stream(body: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _header(found: _Found) -> LogHeader:
    facts = found.facts.get("swathe", {})
    return LogHeader(
        seed=int(facts.get("seed", "0")),
        scenario=found.files["scenario.toml"].decode(),
        vehicle=facts.get("vehicle", ""),
        vehicle_toml=found.files.get("vehicle.toml", b"").decode(),
        body=facts.get("body", ""),
        inputs=found.facts.get("inputs", {}),
        files={name: content for name, content in found.files.items() if name not in _TEXT_FILES},
        version=facts.get("version", ""),
    )
