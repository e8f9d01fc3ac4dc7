"""Segments of a run log read back, also those that were cut short or are damaged, and the runs that they belong to."""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Metadata, MetadataIndex, Statistics, SummaryOffset

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.evaluate.run_digest import Digest, read_digest
from counterflex.files.logs import segment as form
from counterflex.files.logs.mcap_salvage import MAGIC, Chunk, Salvaged, message, parsed, salvage, uniform_data
from counterflex.files.logs.run_log import LAYOUT, UNKNOWN
from counterflex.files.logs.segment import columns_of, placed, require_all
from counterflex.runtime.record_ring import COLUMNS, CYCLE
from counterflex.runtime.state_slots import LoopState

_HEAD: Final = struct.Struct("<BQ")
_TAIL: Final = _HEAD.size + 20 + len(MAGIC)  # Footer, and the magic at the end
_MOST_BYTES: Final = 16 << 20


@dataclass(frozen=True, eq=False)
class Indexed:
    """Places that the index of a file leads to."""

    metadata: list[Metadata]  # In the order of the file; of what the run was made of one copy
    messages: dict[int, int]

    def metadata_named(self, name: str) -> Iterator[dict[str, Any]]:
        """Readable metadata records of a name."""
        read = (form.read_metadata(one) for one in self.metadata if one.name == name)
        return (values for values in read if values is not None)


def indexed(stream: BinaryIO, count: Callable[[int], None]) -> Indexed | None:
    """Follow the index of a file; None where it was not finished, or where something of the index cannot be read.

    Args:
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
    """Return what the run was made of is written again and again, as long each time: its first copy will do."""
    seen: set[tuple[str, int]] = set()
    out = []
    for one in index:
        if one.name != form.ABOUT or (one.name, one.length) not in seen:
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


@dataclass(frozen=True, eq=False)
class LogSegment:
    """One file of a run log."""

    name: str
    rows: Float  # (n, WIDTH) records: all that stand in sound chunks
    about: dict[str, Any]  # What the run was made of; empty where nothing of it can be read
    finished: bool  # It ends as a finished file does; else it was cut short, or is being written
    states: tuple[LoopState, ...] = ()  # Of the loop, in order
    damage: tuple[form.Unreadable, ...] = ()
    # Records behind the last one that can be read, as far as the file's own index still names them
    lost_at_end: int = 0
    absent: tuple[str, ...] = ()  # Columns that older code did not record: 0 in counts and flags, else not a number
    actions: tuple[dict[str, Any], ...] = ()  # What operators did meanwhile, with ``time_ns``
    # What stands in place of records that were not read: `rows` are those that it keeps; None where all were
    digest: Digest | None = None

    @property
    def records(self) -> int:
        """Number of its records, also of those that were not read."""
        return len(self.rows) if self.digest is None else int(self.digest.sums["records"])

    @property
    def whole(self) -> bool:
        """It was finished and all of it can be read."""
        return self.finished and not self.damage

    @property
    def run(self) -> int:
        """Number of the first segment of the run it belongs to: a folder can hold several runs."""
        return int(self.about.get("run", 0))


def read_segment(path: str | Path) -> LogSegment:
    """Read a segment, also one that was cut short or is damaged: every record that stands in a sound chunk.

    Raises:
        FileFormatError: Missing, not a run log, newer than this program reads, or without a single sound record.
    """
    file = Path(path)
    try:
        result = _salvaged(file)
    except FileNotFoundError as fault:
        raise FileFormatError("no such file", where=str(file)) from fault
    except OSError as fault:
        raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault
    about = form.read_about(result)
    if about.get("format", form.KIND) != form.KIND:
        raise FileFormatError("not a run log", where=str(file), value=about["format"])
    if about.get("version", 0) > form.VERSION:
        raise FileFormatError(
            "the run log is newer than this program reads", where=str(file), value=about["version"], limit=form.VERSION
        )
    layout = tuple((str(name), str(kind), int(count)) for name, kind, count in about.get(LAYOUT, ()))
    columns = columns_of(result, str(about.get("counterflex", UNKNOWN)), file)
    states: list[LoopState] = []
    rows = [_read_chunk(chunk, len(columns), layout, states, file) for chunk in result.chunks]
    before = np.cumsum([0, *map(len, rows)]).tolist()  # records before each chunk
    if not about and not before[-1]:
        text, hint = form.unreadable_reason(result, file.stat().st_size)
        raise FileFormatError(text, where=str(file), nothing=True, hint=hint)
    damage = tuple(form.Unreadable(d.begin, d.end, before[d.chunks]) for d in result.damage)
    table = placed(np.concatenate(rows) if rows else np.zeros((0, len(columns))), columns)
    absent = tuple(name for name in COLUMNS if name not in columns)
    lost = form.lost_at_end(result, table) + int(about.get("repaired", {}).get("missing_at_end", 0))
    actions = tuple(form.read_actions(result))
    return LogSegment(file.name, table, about, result.finished, tuple(states), damage, lost, absent, actions)


def _read_chunk(
    chunk: Chunk, columns: int, layout: tuple[tuple[str, str, int], ...], states: list[LoopState], file: Path
) -> Float:
    """Records (n, columns) of a chunk; adds its states."""
    together = uniform_data(chunk.content, form.CYCLE_CHANNEL, 8 * columns)
    if together is not None:
        return np.frombuffer(together, dtype="<f8").reshape(-1, columns)
    rows = []
    for opcode, content in chunk.records():
        channel, _, data = message(content) if opcode == Opcode.MESSAGE else (None, None, b"")
        if opcode == Opcode.CHANNEL:
            form.require_ours(parsed(Channel, content), str(file))
        elif channel == form.STATE_CHANNEL and len(data) >= form.STATE_HEAD.size:
            words = np.frombuffer(data, dtype="<i8", offset=form.STATE_HEAD.size)
            cycle, time_ns = form.STATE_HEAD.unpack_from(data)
            states.append(LoopState(cycle, time_ns, words, layout))
        elif channel == form.CYCLE_CHANNEL and len(data) == 8 * columns:
            rows.append(np.frombuffer(data, dtype="<f8"))
    return np.stack(rows) if rows else np.zeros((0, columns))


def _salvaged(file: Path) -> Salvaged:
    with file.open("rb") as stream:
        if os.fstat(stream.fileno()).st_size == 0:
            return Salvaged()
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return salvage(data)


def read_brief(path: str | Path, count: Callable[[int], None] = lambda _: None) -> LogSegment | None:
    """Read the digest of a segment in place of its records: some kilobytes from the end of the file.

    The index of the file and the checksums of what is read are looked at, its chunks are not.

    Args:
        count: Told how many bytes are read, each time.

    Returns:
        The segment; None where it was not finished, has no digest, or one of another version.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            index = indexed(stream, count)
    except OSError:
        return None
    if index is None:
        return None
    about, table = (next(index.metadata_named(name), None) for name in (form.ABOUT, form.DIGEST))
    digest = None if table is None else read_digest(table[form.DIGEST])
    if about is None or digest is None or about.get("format") != form.KIND or about.get("version", 0) > form.VERSION:
        return None
    if index.messages.get(form.CYCLE_CHANNEL, 0) != digest.sums["records"]:
        return None
    lost = int(about.get("repaired", {}).get("missing_at_end", 0))
    actions = tuple(index.metadata_named(form.ACTION))
    return LogSegment(file.name, digest.rows, about, True, lost_at_end=lost, actions=actions, digest=digest)


def segments(folder: str | Path, *, brief: bool = False) -> Iterator[LogSegment]:
    """Segments of a folder in order, one at a time; a file of which nothing can be read is a segment without records.

    A segment that has lost what it was made of belongs to the run whose cycles it continues, else to one of its own.

    Args:
        brief: Take the digest of a segment, where it has one, in place of its records: :func:`read_brief`.

    Raises:
        FileFormatError: There is none, none can be read, or one is no run log.
    """
    files = sorted(Path(folder).glob("run-*.mcap"))
    if not files:
        raise FileFormatError("there is no run log in this folder", where=str(folder), hint="Expected run-000.mcap")
    refused = None
    before: LogSegment | None = None  # the last one with records
    read = False
    for file in files:
        try:
            result = (read_brief(file) if brief else None) or read_segment(file)
        except FileFormatError as fault:
            if not fault.data.get("nothing"):
                raise
            refused = refused or fault
            yield LogSegment(file.name, np.zeros((0, len(COLUMNS))), {}, False)
            continue
        result = result if result.about else replace(result, about=_likely(result, before))
        yield result
        read = True
        before = result if len(result.rows) else before
    if refused is not None and not read:
        raise refused


def _likely(segment: LogSegment, before: LogSegment | None) -> dict[str, Any]:
    """The run that a segment without its facts belongs to: the one before, whose cycles it continues, or its own."""
    number, rows = segment.name[4:].partition(".")[0], segment.rows
    own = int(number) if number.isdigit() else 0
    if before is not None and len(rows) and rows[0, CYCLE] > before.rows[-1, CYCLE]:
        return {**before.about, "segment": own}
    return {"run": own, "segment": own, UNKNOWN: True}


def read_log(folder: str | Path) -> tuple[Float, dict[str, Any], list[str]]:
    """Read all segments of a folder in order.

    Returns:
        Records, facts of the first segment, and the names of segments that were cut short or are damaged.

    Raises:
        FileFormatError: There is none, none can be read, one is no run log, or of older code that recorded less.
    """
    parts, cut = [], []
    about: dict[str, Any] = {}
    for segment in segments(folder):
        require_all(segment.absent, segment.about, str(folder), "computed again")
        parts.append(segment.rows)
        about = about or segment.about
        if not segment.whole:
            cut.append(segment.name)
    return np.concatenate(parts), about, cut
