"""Metadata of a finished MCAP file, found by the index at its end: nothing else of the file is read."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import Footer, Metadata, MetadataIndex, Statistics, SummaryOffset

from counterflex.files.logs.mcap_salvage import MAGIC, parsed
from counterflex.files.logs.segment import ABOUT

_HEAD: Final = struct.Struct("<BQ")
_TAIL: Final = _HEAD.size + 20 + len(MAGIC)
"""Footer, and the magic at the end."""
_MOST_BYTES: Final = 16 << 20


@dataclass(frozen=True, eq=False)
class Indexed:
    """What the index of a file leads to.

    Attributes:
        metadata: In the order of the file; of what the run was made of one copy.
        messages: Number of messages by channel.
    """

    metadata: list[Metadata]
    messages: dict[int, int]


def indexed(stream: BinaryIO, count: Callable[[int], None]) -> Indexed | None:
    """Follow the index of a file; None where it was not finished, or where something of the index cannot be read.

    Args:
        stream: Of the file.
        count: Told how many bytes are read, each time.
    """
    size = stream.seek(0, os.SEEK_END)
    if size < _TAIL:
        return None
    tail = _bytes(stream, size - _TAIL, _TAIL, count)
    footers = _records(tail[: -len(MAGIC)], Opcode.FOOTER, Footer)
    if not tail.endswith(MAGIC) or len(footers) != 1:
        return None
    begin, end = footers[0].summary_offset_start, size - _TAIL
    if not 0 < begin <= end:
        return None
    groups = _records(_bytes(stream, begin, end - begin, count), Opcode.SUMMARY_OFFSET, SummaryOffset)
    places = {one.group_opcode: (one.group_start, one.group_length) for one in groups}
    if Opcode.METADATA_INDEX not in places or Opcode.STATISTICS not in places:
        return None
    index = _records(_bytes(stream, *places[Opcode.METADATA_INDEX], count), Opcode.METADATA_INDEX, MetadataIndex)
    statistics = _records(_bytes(stream, *places[Opcode.STATISTICS], count), Opcode.STATISTICS, Statistics)
    out: list[Metadata] = []
    for one in _without_copies(index):
        read = _records(_bytes(stream, one.offset, one.length, count), Opcode.METADATA, Metadata)
        if len(read) != 1 or read[0].name != one.name:
            return None
        out += read
    return Indexed(out, dict(statistics[0].channel_message_counts)) if len(statistics) == 1 else None


def _without_copies(index: list[MetadataIndex]) -> list[MetadataIndex]:
    """What the run was made of is written again and again, as long each time: its first copy will do."""
    seen: set[tuple[str, int]] = set()
    out = []
    for one in index:
        if one.name != ABOUT or (one.name, one.length) not in seen:
            out.append(one)
        seen.add((one.name, one.length))
    return out


def _bytes(stream: BinaryIO, begin: int, length: int, count: Callable[[int], None]) -> bytes:
    """Bytes of a place; fewer where the file does not have them."""
    stream.seek(begin)
    data = stream.read(min(length, _MOST_BYTES))
    count(len(data))
    return data


def _records(data: bytes, opcode: int, kind: Any) -> list[Any]:
    """Records of one kind, one behind the other; nothing where something else stands there."""
    out, at = [], 0
    while at < len(data):
        if at + _HEAD.size > len(data):
            return []
        kind_of, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        record = parsed(kind, data[at : at + length]) if kind_of == opcode else None
        if record is None:
            return []
        out.append(record)
        at += length
    return out
