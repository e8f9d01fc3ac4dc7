"""Parts of a segment of a run log (``counterflex-run-log``, version 2): its head, records and states in MCAP."""

from __future__ import annotations

import contextlib
import json
import re
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import CompressionType, Writer

from counterflex import __version__
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.logs.mcap_salvage import MessageTimes, Salvaged, parsed
from counterflex.runtime.record_ring import COLUMNS, is_whole
from counterflex.runtime.state_slots import LoopState

KIND: Final = "counterflex-run-log"
VERSION: Final = 2
_CHUNK: Final = 64 << 10
TOPIC: Final = "cycle"
STATES: Final = "state"
CYCLE_CHANNEL: Final = 1
STATE_CHANNEL: Final = 2
CYCLES: Final = "counterflex.cycle"
ABOUT: Final = "about"
ACTION: Final = "operator"
DIGEST: Final = "digest"
_CHECKSUM: Final = "crc32"
STATE_HEAD: Final = struct.Struct("<qq")


@dataclass(frozen=True)
class Unreadable:
    """A stretch of a segment that cannot be read; what is behind it can."""

    begin: int  # First byte
    end: int  # First byte behind it
    after: int  # Records of the segment before it


def begin_segment(stream: BinaryIO, about: Mapping[str, Any]) -> tuple[Writer, int, int]:
    """Write the head of a segment: what the run was made of and the columns.

    Args:
        about: With ``format``, ``version``, ``run`` and ``segment``.

    Returns:
        The writer, to be finished, the channel of the records, and that of the loop's states.
    """
    writer = Writer(stream, chunk_size=_CHUNK, compression=CompressionType.ZSTD)
    writer.start(profile=KIND, library="counterflex")
    add_about(writer, about)
    layout = json.dumps({"columns": COLUMNS, "type": "float64 little-endian"}).encode()
    schema = writer.register_schema(name=CYCLES, encoding="counterflex", data=layout)
    form = json.dumps({"type": "int64 little-endian: cycle, time ns, then the loop's memory bit for bit"}).encode()
    states = writer.register_schema(name="counterflex.state", encoding="counterflex", data=form)
    return (
        writer,
        writer.register_channel(topic=TOPIC, message_encoding="float64", schema_id=schema),
        writer.register_channel(topic=STATES, message_encoding="int64", schema_id=states),
    )


def add_about(writer: Writer, about: Mapping[str, Any]) -> None:
    """Add what the run was made of, with a checksum: outside a chunk MCAP has none."""
    values = {key: json.dumps(value) for key, value in about.items()}
    writer.add_metadata(ABOUT, {**values, _CHECKSUM: _checksum(values)})


def add_record(writer: Writer, channel: int, row: Float) -> None:
    """Add one record (WIDTH,), stamped with the time at which its telegram was received."""
    stamp = int(row[1])
    writer.add_message(channel, log_time=stamp, data=row.astype("<f8").tobytes(), publish_time=stamp)


def add_state(writer: Writer, channel: int, state: LoopState) -> None:
    """Add a state of the loop, stamped as the record of its cycle."""
    data = STATE_HEAD.pack(state.cycle, state.time_ns) + state.words.astype("<i8").tobytes()
    writer.add_message(channel, log_time=state.time_ns, data=data, publish_time=state.time_ns)


def add_action(writer: Writer, facts: Mapping[str, Any]) -> None:
    """Add what an operator did, as metadata with a checksum: readers that do not know it pass over it."""
    values = {key: json.dumps(value) for key, value in facts.items()}
    writer.add_metadata(ACTION, {**values, _CHECKSUM: _checksum(values)})


def add_digest(writer: Writer, table: Mapping[str, Any]) -> None:
    """Add the digest of all records of the segment, with a checksum, at its end."""
    values = {DIGEST: json.dumps(table)}
    writer.add_metadata(DIGEST, {**values, _CHECKSUM: _checksum(values)})


def read_metadata(record: Metadata) -> dict[str, Any] | None:
    """Values of metadata with a checksum; None where it is wrong."""
    values = dict(record.metadata)
    if values.pop(_CHECKSUM, None) != _checksum(values):
        return None
    with contextlib.suppress(ValueError):
        return {key: json.loads(value) for key, value in values.items()}
    return None


def read_actions(salvaged: Salvaged) -> list[dict[str, Any]]:
    """Return what operators did during a segment, in the order in which it was written; what is damaged is left out."""
    out = []
    for record in salvaged.records:
        if isinstance(record, Metadata) and record.name == ACTION:
            values = read_metadata(record)
            if values is not None:
                out.append(values)
    return out


def read_about(salvaged: Salvaged) -> dict[str, Any]:
    """Return what the run was made of: the first copy whose checksum is right; logs of before had one copy without."""
    for record in salvaged.records:
        if isinstance(record, Metadata) and record.name == ABOUT:
            values = dict(record.metadata)
            checksum = values.pop(_CHECKSUM, None)
            if checksum is None or checksum == _checksum(values):
                with contextlib.suppress(ValueError):
                    return {key: json.loads(value) for key, value in values.items()}
    return {}


def lost_at_end(salvaged: Salvaged, rows: Float) -> int:
    """Cycles that the indexes beside the chunks name behind the last record: the index of a chunk stands outside it."""
    last = int(rows[-1, 1]) if len(rows) else -1
    stamps: set[int] = set()
    for record in salvaged.records:
        if isinstance(record, MessageTimes) and record.channel == CYCLE_CHANNEL:
            stamps.update(record.time_ns[record.time_ns > last].tolist())
    return len(stamps)


def require_ours(channel: Channel | None, where: str) -> None:
    """Check that a channel is one of a run log. Raises FileFormatError: it is another program's."""
    if channel is not None and (channel.id, channel.topic) not in ((CYCLE_CHANNEL, TOPIC), (STATE_CHANNEL, STATES)):
        raise FileFormatError("not a run log", where=where, value=channel.topic)


def unreadable_reason(salvaged: Salvaged, size: int) -> tuple[str, str]:
    """Return what a file is of which not one record can be read, and what to do.

    Args:
        size: Of the file, bytes.
    """
    remove = "Nothing in it can be saved: remove it, or move it out of this folder"
    if size == 0:
        return "empty", f"The run ended before it wrote, or its disk was full. {remove}"
    if salvaged.magic:
        return "not one record of a run can be read", f"It was truncated or overwritten after its beginning. {remove}"
    return "not an MCAP file", f"Give the folder that run wrote with --out; if this is it, it was overwritten. {remove}"


def _checksum(values: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(values, sort_keys=True).encode()):08x}"


_NEEDED: Final = ("cycle", "received_ns", "sent_ns", "out_state", "out_cause", "out_feed_hold", "elapsed")
"""Columns without which nothing can be said about a run."""


def columns_of(readable: Salvaged, made_by: str, file: Path) -> tuple[str, ...]:
    """Columns that the records of a segment have: those of today, or fewer where older code wrote it.

    Columns have only ever been added, so that a name stands for the same number in all logs.

    Raises:
        FileFormatError: Columns that this program does not know, or without which nothing can be said.
    """
    records = (record for chunk in readable.chunks for record in chunk.records())
    schemas = (parsed(Schema, content) for opcode, content in records if opcode == Opcode.SCHEMA)
    schema = next((one for one in schemas if one is not None and one.name == CYCLES), None)
    if schema is None:
        return COLUMNS
    columns = tuple(str(name) for name in json.loads(schema.data)["columns"])
    unknown = [f"with '{name}'" for name in columns if name not in COLUMNS]
    lacking = [f"without '{name}'" for name in _NEEDED if name not in columns]
    if wrong := [*unknown, *lacking, *(("one twice",) * (len(set(columns)) < len(columns)))]:
        raise FileFormatError(
            "the run log was written by another version of this program, whose columns mean something else",
            where=str(file),
            value=f"{len(columns)} columns of counterflex {made_by}, {wrong[0]}",
            limit=f"columns of counterflex {__version__}",
            hint="Read it with the version that wrote it: its log export writes CSV",
        )
    return columns


def placed(rows: Float, columns: tuple[str, ...]) -> Float:
    """Records (n, WIDTH) with the columns of today; what was not recorded is 0 in counts and flags, else NaN.

    Args:
        rows: (n, k) as recorded.
    """
    if columns == COLUMNS:
        return rows
    out = np.array([0.0 if is_whole(name) else np.nan for name in COLUMNS]) * np.ones((len(rows), 1))
    out[:, [COLUMNS.index(name) for name in columns]] = rows
    return out


def require_all(absent: Sequence[str], about: Mapping[str, Any], where: str, what: str) -> None:
    """Refuse a log of older code for a job that needs everything that is recorded today.

    Args:
        what: What cannot be done with it, for the message: ``computed again``.

    Raises:
        FileFormatError: It lacks columns.
    """
    if absent:
        raise FileFormatError(
            f"the run log was written by older code and cannot be {what}: not all that this takes was recorded then",
            where=where,
            value=f"{len(COLUMNS) - len(absent)} columns of counterflex {about.get('counterflex', '(unknown)')}",
            limit=f"{len(COLUMNS)} columns of counterflex {__version__}",
            hint="log show and log export read it; for the rest use the version that wrote it",
        )


_UNITS: Final = (
    (r"counter_ms", "ms"),
    (r"(received|sent)_ns", "ns"),
    (r"fast_(residual|turn|tooth|slower|change)", "N"),
    (r"(sensor|wrench|used|predicted|filtered)_f[xyz]", "N"),
    (r"(sensor|wrench|used|predicted|filtered)_m[xyz]|torque_\d", "N m"),
    (r"second_[fs][xyz]|pair_gap", "N"),
    (r"(force|expected)_(feed|across|tool|size|least|most)", "N"),
    (r"(nominal|actual|reported|correction|deflection|wanted|deviation|offset)_[xyz]", "m"),
    (r"(correction|deflection|wanted|deviation|offset)_r[xyz]|q\d|axis_\d", "rad"),
    (r"tracker_late", "s"),
    (r"tracker_sigma|path_distance|uncertain|cut_m|path_m", "m"),
    (r"(value|limit)_missing_cut", "m"),
    (r"(value|limit)_(overload|chatter)", "N"),
    (r"wear_trend(_sigma)?", "1/m"),
    (r"flag_(elapsed|(force|tracker|current)_age)|elapsed", "cycles"),
)


def unit_of(column: str) -> str:
    """Unit of a column of :data:`counterflex.runtime.record_ring.COLUMNS`; empty for ratios, bits and states."""
    return next((unit for pattern, unit in _UNITS if re.fullmatch(pattern, column)), "")


def headings() -> list[str]:
    """The columns in order, each with its unit in brackets where it has one: ``correction_x [m]``."""
    return [f"{name} [{unit_of(name)}]" if unit_of(name) else name for name in COLUMNS]
