"""The run log (``counterflex-run-log``, version 2): MCAP segments that read back after power loss or ``kill -9``.

Each segment begins with what the run was made of (settings, hashes of the inputs); records follow in small chunks,
flushed every 100 ms. What stands before the last whole chunk can always be read, also from a segment that was never
finished. A full disk ends a segment; a new one is begun when there is room again. Every few seconds the whole state of
the loop stands beside the records, so that they can be computed again from there.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from zstandard import ZstdError

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, OutputError
from counterflex.runtime.record_ring import COLUMNS
from counterflex.runtime.state_slots import LoopState

KIND: Final = "counterflex-run-log"
VERSION: Final = 2
FLUSH_S: Final = 0.06
"""With the recorder's own period less than 100 ms of records are lost with it."""
SYNC_S: Final = 1.0
SEGMENT_BYTES: Final = 64 << 20
_CHUNK: Final = 64 << 10
_TOPIC: Final = "cycle"
_STATES: Final = "state"
_STATE_HEAD: Final = struct.Struct("<qq")
_RETRY_S: Final = 1.0


def begin_segment(stream: BinaryIO, about: Mapping[str, Any]) -> tuple[Writer, int, int]:
    """Write the head of a segment: what the run was made of and the columns.

    Args:
        stream: Buffered.
        about: With ``format``, ``version``, ``run`` and ``segment``.

    Returns:
        The writer, to be finished, the channel of the records, and that of the loop's states.
    """
    writer = Writer(stream, chunk_size=_CHUNK, compression=CompressionType.ZSTD)
    writer.start(profile=KIND, library="counterflex")
    writer.add_metadata("about", {key: json.dumps(value) for key, value in about.items()})
    layout = json.dumps({"columns": COLUMNS, "type": "float64 little-endian"}).encode()
    schema = writer.register_schema(name="counterflex.cycle", encoding="counterflex", data=layout)
    form = json.dumps({"type": "int64 little-endian: cycle, time ns, then the loop's memory bit for bit"}).encode()
    states = writer.register_schema(name="counterflex.state", encoding="counterflex", data=form)
    return (
        writer,
        writer.register_channel(topic=_TOPIC, message_encoding="float64", schema_id=schema),
        writer.register_channel(topic=_STATES, message_encoding="int64", schema_id=states),
    )


def add_record(writer: Writer, channel: int, row: Float) -> None:
    """Add one record (WIDTH,), stamped with the time at which its telegram was received."""
    stamp = int(row[1])
    writer.add_message(channel, log_time=stamp, data=row.astype("<f8").tobytes(), publish_time=stamp)


def add_state(writer: Writer, channel: int, state: LoopState) -> None:
    """Add a state of the loop, stamped as the record of its cycle."""
    data = _STATE_HEAD.pack(state.cycle, state.time_ns) + state.words.astype("<i8").tobytes()
    writer.add_message(channel, log_time=state.time_ns, data=data, publish_time=state.time_ns)


class RunLog:
    """Writes records into segments ``run-000.mcap``, ``run-001.mcap``, ... of a folder.

    Args:
        folder: Made when missing.
        about: What the run is made of; the first thing in every segment, with the number of the run's first segment.

    Attributes:
        written: Records written.
        lost: Records that could not be written.
        trouble: Why writing does not work at the moment, or empty.

    Raises:
        OutputError: The folder cannot be written at the start.
    """

    def __init__(self, folder: str | Path, about: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        self._about = dict(about)
        self.written = self.lost = 0
        self.trouble = ""
        self._number = self._first = 0
        self._stream: BufferedWriter | None = None
        self._writer: Writer | None = None
        self._channel = self._states = 0
        self._retry = self._flushed = self._synced = 0.0
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            taken = [int(p.stem[4:]) for p in self.folder.glob("run-*.mcap") if p.stem[4:].isdigit()]
            self._number = self._first = max(taken, default=-1) + 1
            self._begin()
        except OSError as fault:
            raise OutputError(
                f"the run log cannot be written: {fault.strerror or fault}",
                where=str(folder),
                hint="Choose another --out or make room there",
            ) from fault

    def _begin(self) -> None:
        path = self.folder / f"run-{self._number:03d}.mcap"
        stream = path.open("wb")
        try:
            facts = {"format": KIND, "version": VERSION, "run": self._first, "segment": self._number, **self._about}
            writer, self._channel, self._states = begin_segment(stream, facts)
            writer.flush()
        except BaseException:
            with contextlib.suppress(OSError):
                stream.close()
            path.unlink(missing_ok=True)
            raise
        self._stream, self._writer = stream, writer
        self._number += 1
        self.trouble = ""

    def add(self, rows: Float, now_s: float | None = None, *, state: LoopState | None = None) -> None:
        """Write records, flush when due, rotate when large or when the disk refuses; never raises for a full disk.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.
            now_s: Monotonic time; None is now.
            state: Of the loop, or None.
        """
        now = time.monotonic() if now_s is None else now_s
        if self._writer is None:
            if now < self._retry:
                self.lost += len(rows)
                return
            try:
                self._begin()
            except OSError as fault:
                self._fail(fault, len(rows), now)
                return
        writer, stream = self._writer, self._stream
        if writer is None or stream is None:
            return
        try:
            for row in rows:
                add_record(writer, self._channel, row)
            if state is not None:
                add_state(writer, self._states, state)
            if now - self._flushed >= FLUSH_S:
                writer.flush()
                stream.flush()
                self._flushed = now
                if now - self._synced >= SYNC_S:
                    os.fsync(stream.fileno())
                    self._synced = now
            self.written += len(rows)
            if stream.tell() > SEGMENT_BYTES:
                self._finish()
                self._begin()
        except OSError as fault:
            self._fail(fault, len(rows), now)

    def _fail(self, fault: OSError, rows: int, now: float) -> None:
        self.lost += rows
        self.trouble = fault.strerror or str(fault)
        self._retry = now + _RETRY_S
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()
        self._writer = self._stream = None

    def _finish(self) -> None:
        if self._writer is not None and self._stream is not None:
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
            self._stream.close()
        self._writer = self._stream = None

    def close(self) -> None:
        """Finish the last segment; trouble is kept in :attr:`trouble`."""
        try:
            self._finish()
        except OSError as fault:
            self._fail(fault, 0, 0.0)


@dataclass(frozen=True, eq=False)
class Segment:
    """One file of a run log.

    Attributes:
        name: Of the file.
        rows: (n, WIDTH) records.
        about: What the run was made of; empty where the file was cut before it.
        whole: It was finished; else it was cut short, and the records before the cut are there.
        states: Of the loop, in order.
    """

    name: str
    rows: Float
    about: dict[str, Any]
    whole: bool
    states: tuple[LoopState, ...] = ()

    @property
    def run(self) -> int:
        """Number of the first segment of the run it belongs to: a folder can hold several runs."""
        return int(self.about.get("run", 0))


def read_segment(path: str | Path) -> Segment:
    """Read a segment, also one that was cut short.

    Args:
        path: MCAP file.

    Raises:
        FileFormatError: Missing, not a run log, newer than this program reads, or cut before its first record of facts.
    """
    file = Path(path)
    about: dict[str, Any] = {}
    rows: list[Float] = []
    states: list[LoopState] = []
    state_channels: set[int] = set()
    whole = False
    columns: list[str] | None = None
    try:
        with file.open("rb") as stream:
            if stream.read(8) != b"\x89MCAP0\r\n":
                raise FileFormatError("not an MCAP file", where=str(file), no_beginning=file.stat().st_size < 8)
            stream.seek(0)
            try:
                for record in StreamReader(stream, validate_crcs=True, record_size_limit=SEGMENT_BYTES * 2).records:
                    if isinstance(record, Metadata) and record.name == "about":
                        about = {key: json.loads(value) for key, value in record.metadata.items()}
                    elif isinstance(record, Schema) and record.name == "counterflex.cycle":
                        columns = json.loads(record.data)["columns"]
                    elif isinstance(record, Message) and record.channel_id in state_channels:
                        words = np.frombuffer(record.data, dtype="<i8", offset=_STATE_HEAD.size)
                        cycle, time_ns = _STATE_HEAD.unpack_from(record.data)
                        states.append(LoopState(cycle, time_ns, words))
                    elif isinstance(record, Message):
                        rows.append(np.frombuffer(record.data, dtype="<f8"))
                    elif isinstance(record, Footer):
                        whole = True
                    elif isinstance(record, Channel) and record.topic == _STATES:
                        state_channels.add(record.id)
                    elif isinstance(record, Channel) and record.topic != _TOPIC:
                        raise FileFormatError("not a run log", where=str(file), value=record.topic)
            except FileFormatError:
                raise
            except (McapError, EOFError, ValueError, KeyError, struct.error, ZstdError, MemoryError, OverflowError):
                whole = False  # cut short, or damaged: what came before stands
    except FileNotFoundError as fault:
        raise FileFormatError("no such file", where=str(file)) from fault
    except OSError as fault:
        raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault
    if about.get("format") != KIND:
        raise FileFormatError("not a run log, or cut before its beginning", where=str(file), no_beginning=True)
    if about.get("version", 0) > VERSION:
        raise FileFormatError(
            "the run log is newer than this program reads", where=str(file), value=about["version"], limit=VERSION
        )
    if columns is not None and tuple(columns) != COLUMNS:
        raise FileFormatError("the run log has other columns", where=str(file), value=len(columns), limit=len(COLUMNS))
    good = [row for row in rows if len(row) == len(COLUMNS)]
    return Segment(file.name, np.array(good).reshape(-1, len(COLUMNS)), about, whole, tuple(states))


def segments(folder: str | Path) -> Iterator[Segment]:
    """Segments of a folder in order, one at a time; a file cut before its beginning is a segment without records.

    Raises:
        FileFormatError: There is none, or one is no run log.
    """
    files = sorted(Path(folder).glob("run-*.mcap"))
    if not files:
        raise FileFormatError("there is no run log in this folder", where=str(folder), hint="Expected run-000.mcap")
    refused = None
    told = False
    for file in files:
        try:
            found = read_segment(file)
        except FileFormatError as fault:
            if not fault.data.get("no_beginning"):
                raise
            refused = fault
            yield Segment(file.name, np.zeros((0, len(COLUMNS))), {}, False)
            continue
        told = True
        yield found
    if refused is not None and not told:
        raise refused


def read_log(folder: str | Path) -> tuple[Float, dict[str, Any], list[str]]:
    """Read all segments of a folder in order.

    Returns:
        Records, facts of the first segment, and the names of segments that were cut short.

    Raises:
        FileFormatError: There is none, or one is no run log.
    """
    parts, cut = [], []
    about: dict[str, Any] = {}
    for segment in segments(folder):
        parts.append(segment.rows)
        about = about or segment.about
        if not segment.whole:
            cut.append(segment.name)
    return np.concatenate(parts), about, cut
