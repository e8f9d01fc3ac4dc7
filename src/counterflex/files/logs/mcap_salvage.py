"""Read every sound record of an MCAP file that was cut, overwritten or otherwise damaged.

MCAP is a row of records: opcode (1 byte), length (8 bytes), content; messages stand in chunks that carry a CRC-32 of
their content. Where a record is not sound, the next one is looked for: first where this one says that it ends, then at
every place that looks like the beginning of a record. So a damaged record costs itself and nothing behind it.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from mmap import mmap
from typing import Any, Final

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC: Final = b"\x89MCAP0\r\n"
MOST_BYTES: Final = 128 << 20
"""Largest chunk, and largest content of a chunk, that is believed."""
_MOST_ELSE: Final = 16 << 20  # of any other record
_HEAD: Final = struct.Struct("<BQ")
_CHUNK: Final = struct.Struct("<QQQII")  # first time, last time, size, CRC-32, length of the name of the compression
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, time, time of publishing
_BEGINNING: Final = re.compile(rb"(?=[\x01-\x0f].{4}\x00{4})", re.DOTALL)
_READ: Final[dict[int, Any]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
    Opcode.FOOTER: Footer,
}
_KNOWN: Final = frozenset(_READ) | {Opcode.MESSAGE_INDEX}
_INDEX: Final = struct.Struct("<HI")
_BAD: Final = (McapError, EOFError, ValueError, struct.error, OverflowError, MemoryError, zstandard.ZstdError)


@dataclass(frozen=True)
class Chunk:
    """A sound chunk."""

    begin: int  # Byte of the file at which it begins
    content: bytes  # Its records, as written; their CRC-32 was right

    def records(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of each of its records."""
        at, content = 0, self.content
        while at + _HEAD.size <= len(content):
            opcode, length = _HEAD.unpack_from(content, at)
            at += _HEAD.size
            yield opcode, content[at : at + length]
            at += length


@dataclass(frozen=True, eq=False)
class MessageTimes:
    """The index of a chunk's messages, which stands outside of it."""

    channel: int
    time_ns: np.ndarray[Any, np.dtype[np.uint64]]  # (n,) when they were logged


@dataclass(frozen=True)
class Damage:
    """A stretch of the file without a sound record, with sound ones behind it."""

    begin: int  # First byte
    end: int  # First byte behind it
    chunks: int  # Sound chunks before it


@dataclass(eq=False)
class Salvaged:
    """Records that were found."""

    chunks: list[Chunk] = field(default_factory=list)  # In the order of the file
    records: list[Any] = field(default_factory=list)
    # Stretches that could not be read, with sound records behind them
    damage: list[Damage] = field(default_factory=list)
    finished: bool = False  # The file ends as a finished one does
    magic: bool = False

    def add_damage(self, begin: int, end: int) -> None:
        """Add a stretch; it is one with the last where no sound chunk stands between them."""
        if self.damage and self.damage[-1].chunks == len(self.chunks):
            begin = self.damage.pop().begin
        self.damage.append(Damage(begin, end, len(self.chunks)))


def salvage(data: bytes | mmap) -> Salvaged:
    """Read every sound record of an MCAP file.

    A chunk is sound when lengths and CRC-32 of its content are right; another record when it can be read and is exactly
    as long as it says, unless no sound record follows and a sound chunk begins within it. A bit that is wrong within a
    name or a time of such a record is not seen.
    """
    out = Salvaged(magic=data[: len(MAGIC)] == MAGIC)
    size = len(data)
    at = len(MAGIC) if out.magic else 0
    unchecked: int | None = None  # where the last record begins, when it has no checksum
    while at < size:
        if size - at == len(MAGIC) and data[at:] == MAGIC:
            last = out.records[-1] if out.records else None
            out.finished = isinstance(last, Footer) and max(last.summary_start, last.summary_offset_start) < at
            break
        result = _sound(data, at)
        if result is None:
            within = None if unchecked is None else _chunk_within(data, unchecked, at)
            begin, after = at, _next(data, at) if within is None else within
            if within is not None and unchecked is not None:
                out.records.pop()
                begin, unchecked = unchecked, None
            if after is None:
                break
            out.add_damage(begin, after)
            at = after
            continue
        record, end = result
        (out.chunks if isinstance(record, Chunk) else out.records).append(record)
        unchecked = None if isinstance(record, Chunk) else at
        at = end
    return out


def uniform_data(content: bytes, channel: int, length: int) -> bytes | None:
    """Data of all messages of a chunk, one behind the other, where it holds nothing else; None where it does.

    Args:
        length: Bytes of data of each.
    """
    form = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("rest", "V20"), ("data", f"V{length}")])
    if not content or len(content) % form.itemsize:
        return None
    messages = np.frombuffer(content, dtype=form)
    same = (messages["opcode"] == Opcode.MESSAGE) & (messages["length"] == _MESSAGE.size + length)
    return messages["data"].tobytes() if bool(np.all(same & (messages["channel"] == channel))) else None


def message(content: bytes) -> tuple[int, int, bytes]:
    """Channel, time in ns and data of a message record.

    Raises:
        struct.error: It is too short.
    """
    channel, _, time_ns, _ = _MESSAGE.unpack_from(content)
    return channel, time_ns, content[_MESSAGE.size :]


def parsed(kind: Any, content: bytes) -> Any:
    """A record of a kind of :mod:`mcap.records`, or None where the content is none."""
    try:
        stream = ReadDataStream(BytesIO(content))
        record = kind.read(stream)
    except _BAD:
        return None
    return record if stream.count == len(content) else None


def _extent(data: bytes | mmap, at: int) -> tuple[int, int] | None:
    """Opcode and end of the record that begins here, where it can be one."""
    if at + _HEAD.size > len(data):
        return None
    opcode, length = _HEAD.unpack_from(data, at)
    end = at + _HEAD.size + length
    most = MOST_BYTES if opcode == Opcode.CHUNK else _MOST_ELSE if opcode in _KNOWN else -1
    return None if length > most or end > len(data) else (opcode, end)


def _sound(data: bytes | mmap, at: int) -> tuple[Any, int] | None:
    """The record that begins here and its end; None where there is no sound one."""
    extent = _extent(data, at)
    if extent is None:
        return None
    opcode, end = extent
    content = data[at + _HEAD.size : end]
    record: Any
    if opcode == Opcode.CHUNK:
        record = _chunk(at, content)
    elif opcode == Opcode.MESSAGE_INDEX:
        record = _message_times(content)
    else:
        record = parsed(_READ[opcode], content)
    return None if record is None else (record, end)


def _message_times(content: bytes) -> MessageTimes | None:
    """Times of a message index: channel, length in bytes, then a time and a place for each message."""
    if len(content) < _INDEX.size:
        return None
    channel, length = _INDEX.unpack_from(content)
    if length != len(content) - _INDEX.size or length % 16:
        return None
    return MessageTimes(channel, np.frombuffer(content, dtype="<u8", offset=_INDEX.size)[::2])


def _chunk(begin: int, content: bytes) -> Chunk | None:
    try:
        _, _, size, crc, named = _CHUNK.unpack_from(content)
        at = _CHUNK.size + named
        compression, (length,) = content[_CHUNK.size : at], struct.unpack_from("<Q", content, at)
        body = content[at + 8 :]
        if length != len(body) or size > MOST_BYTES:
            return None
        if compression == b"zstd":
            if zstandard.frame_content_size(body) != size:
                return None
            body = zstandard.decompress(body, max_output_size=size)
        elif compression:
            return None
    except _BAD:
        return None
    return Chunk(begin, body) if len(body) == size and zlib.crc32(body) == crc else None


def _chunk_within(data: bytes | mmap, begin: int, end: int) -> int | None:
    """Return where a sound chunk begins within a record without a checksum, after which no sound one follows.

    A record from which bytes are missing may still read well, with the first bytes of the next one as its last.
    """
    for place in _BEGINNING.finditer(data, begin + 1):
        if place.start() >= end:
            return None
        if data[place.start()] == Opcode.CHUNK and _sound(data, place.start()) is not None:
            return place.start()
    return None


def _next(data: bytes | mmap, at: int) -> int | None:
    """Return where the next sound record begins behind a place at which there is none."""
    extent = _extent(data, at)
    if extent is not None and (_sound(data, extent[1]) is not None or data[extent[1] :] == MAGIC):
        return extent[1]
    for place in _BEGINNING.finditer(data, at + 1):
        if _sound(data, place.start()) is not None:
            return place.start()
    return None
