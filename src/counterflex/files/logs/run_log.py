"""The run log (``counterflex-run-log``, version 2): MCAP segments that read back after power loss or ``kill -9``.

Each segment begins with what the run was made of (settings, hashes of the inputs); records follow in small chunks,
flushed every 100 ms. The file is held as long as it is written to, so that nobody takes one for cut short that is not.
Every chunk that is whole can be read, also from a segment that was never finished, and behind a
stretch that is damaged. A full disk ends a segment; a new one is begun when there is room again. Every few seconds the
whole state of the loop stands beside the records, so that they can be computed again from there.
"""

from __future__ import annotations

import contextlib
import errno
import os
import time
from collections.abc import Callable, Mapping
from io import BufferedWriter
from pathlib import Path
from typing import Any, Final

from mcap.writer import Writer

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError
from counterflex.core.held import boot_id, own
from counterflex.evaluate.run_digest import DigestMaker
from counterflex.files.logs.place import LOOKED_S, LogBefore, LogGone, LogPlace
from counterflex.files.logs.segment import (
    KIND,
    VERSION,
    add_about,
    add_action,
    add_digest,
    add_record,
    add_state,
    begin_segment,
)
from counterflex.runtime.state_slots import LoopState

FLUSH_S: Final = 0.06
"""With the recorder's own period less than 100 ms of records are lost with it."""
SYNC_S: Final = 1.0
SEGMENT_BYTES: Final = 64 << 20
BOOT_KEY: Final = "held"
"""Key of the start of the computer on which a segment was held (:mod:`counterflex.core.held`) while it was written."""
LAYOUT: Final = "state_layout"
"""Key of what the words of a recorded state mean: name, kind and count of each stretch
(:mod:`counterflex.runtime.state.memory_layout`)."""
UNKNOWN: Final = "unknown"
"""Key of what a segment is made of where nothing of that can be read."""
_RETRY_S: Final = 1.0


class RunLogWriter:
    """Writes records into segments ``run-000.mcap``, ``run-001.mcap``, ... of a folder.

    Args:
        about: What the run is made of; the first thing in every segment, with the number of the run's first segment.

    Attributes:
        lost: Records that could not be written, or whose file was removed while the run went on.
        trouble: Why writing does not work at the moment, or empty.
        trouble_number: Of the system's error, or :data:`counterflex.files.logs.place.GONE`; 0: it works.
        first: Number of the run's first segment.

    Raises:
        OutputError: The folder cannot be written at the start.
    """

    def __init__(
        self,
        folder: str | Path,
        about: Mapping[str, Any],
        *,
        opened: Callable[[Path], BufferedWriter] = lambda path: path.open("xb"),
    ) -> None:
        self.folder, self._opened = Path(folder), opened
        self._about = dict(about)
        self._facts: dict[str, Any] = {}
        self.written = self.lost = 0
        self.trouble, self.trouble_number = "", 0
        self._place: LogPlace | None = None
        self._number = self.first = self._here = 0  # the last: records in the present segment
        self._before = LogBefore()
        self._notes: list[dict[str, Any]] = []
        self._device: int | None = None
        self._stream: BufferedWriter | None = None
        self._writer: Writer | None = None
        self._digest = DigestMaker()
        self._channel = self._states = 0
        self._retry = self._flushed = self._synced = self._looked = 0.0
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            taken = [int(p.stem[4:]) for p in self.folder.glob("run-*.mcap") if p.stem[4:].isdigit()]
            self._number = self.first = max(taken, default=-1) + 1
            self._begin()
        except OSError as fault:
            raise OutputError(
                f"the run log cannot be written: {fault.strerror or fault}",
                where=str(folder),
                hint="Choose another --out, or make room there",
            ) from fault

    def _begin(self) -> None:
        device = self.folder.stat().st_dev
        if self._device not in (None, device):  # another disk, or none, where the log's was: not what was asked for
            raise LogGone
        self._device = device
        path, stream = self._next_file()
        try:
            if self._place is None:
                self.first = self._number
            self._facts = {"format": KIND, "version": VERSION, "run": self.first, "segment": self._number}
            self._facts.update(self._about)
            if own(stream.fileno()):
                self._facts[BOOT_KEY] = boot_id()
            writer, self._channel, self._states = begin_segment(stream, self._facts)
            writer.flush()
        except BaseException:
            with contextlib.suppress(OSError):
                stream.close()
            path.unlink(missing_ok=True)
            raise
        self._stream, self._writer = stream, writer
        self._digest = DigestMaker()
        self._place, self._here = LogPlace(path, stream.fileno()), 0
        self._number += 1
        self.trouble, self.trouble_number = "", 0
        self._write_notes()

    def _next_file(self) -> tuple[Path, BufferedWriter]:
        """A new file of the next number that is free: another run may write to the same folder."""
        while True:
            path = self.folder / f"run-{self._number:03d}.mcap"
            try:
                return path, self._opened(path)
            except FileExistsError:
                self._number += 1

    def add(self, rows: Float, now_s: float | None = None, *, state: LoopState | None = None) -> None:
        """Write records, flush when due, rotate when large or when the disk refuses; never raises for a full disk.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.
            now_s: Monotonic time; None is now.
            state: Of the loop, or None.
        """
        now = time.monotonic() if now_s is None else now_s
        remaining, look = len(rows), now - self._looked >= LOOKED_S
        if look:
            self._looked = now
            self._look_back()
        if self._writer is None:
            self._begin_again(remaining, now)
        writer, stream = self._writer, self._stream
        if writer is None or stream is None:
            return
        try:
            for row in rows:
                add_record(writer, self._channel, row)
            self._digest.add(rows)
            if state is not None:
                add_state(writer, self._states, state)
                add_about(writer, self._facts)  # again, so that a damaged beginning is not the only one
            self._flush(writer, stream, now)
            self.written += remaining
            self._here += remaining
            remaining = 0
            if self._place is not None and look:
                self._place.check()
            if stream.tell() > SEGMENT_BYTES:
                self._finish()
                self._leave()
                self._begin()
        except LogGone as fault:
            self._handle_lost(fault, now)
        except OSError as fault:
            self._fail(fault, remaining, now)

    def _begin_again(self, rows: int, now: float) -> None:
        """Begin a segment when it is time to try again; the rows are lost otherwise, and where that fails."""
        if now < self._retry:
            self.lost += rows
            return
        try:
            self._begin()
        except OSError as fault:
            self._fail(fault, rows, now)

    def _flush(self, writer: Writer, stream: BufferedWriter, now: float) -> None:
        """Flush when due, and once in a while to the disk."""
        if now - self._flushed < FLUSH_S:
            return
        writer.flush()
        stream.flush()
        self._flushed = now
        if now - self._synced >= SYNC_S:
            os.fsync(stream.fileno())
            self._synced = now

    def note(self, facts: Mapping[str, Any]) -> None:
        """Note what an operator did; while the log cannot be written it waits for the next segment.

        Args:
            facts: Plain values, with ``time_ns``.
        """
        self._notes.append(dict(facts))
        self._write_notes()

    def _write_notes(self) -> None:
        while self._notes and self._writer is not None:
            try:
                add_action(self._writer, self._notes[0])
            except OSError as fault:
                self._fail(fault, 0, time.monotonic())
                return
            del self._notes[0]

    def _handle_lost(self, fault: LogGone, now: float) -> None:
        """Count as lost what is not there any more; what was moved away is finished where it is now."""
        with contextlib.suppress(OSError):
            self._finish()
        lost, self._here = self._here, 0
        self.written -= lost
        self._look_back()
        self._fail(fault, lost, now)

    def _leave(self) -> None:
        """The present segment is closed: from now on it is one of those before."""
        if self._place is not None:
            self._before.add(self._place.path, self._here)
        self._here = 0

    def _look_back(self) -> None:
        """Count as lost the records of earlier segments that are not there any more."""
        lost = self._before.gone()
        self.written -= lost
        self.lost += lost

    def _fail(self, fault: OSError, rows: int, now: float) -> None:
        self.lost += rows
        self.trouble, self.trouble_number = fault.strerror or str(fault), fault.errno or errno.EIO
        self._retry = now + _RETRY_S
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()
        self._writer = self._stream = None
        self._leave()

    def _finish(self) -> None:
        if self._writer is not None and self._stream is not None:
            add_about(self._writer, self._facts)
            digest = self._digest.digest()
            if digest is not None:
                add_digest(self._writer, digest.plain())
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
            self._stream.close()
        self._writer = self._stream = None

    def close(self) -> None:
        """Finish the last segment; trouble is kept in :attr:`trouble`."""
        try:
            if self._place is not None and self._stream is not None:
                self._place.check()
            self._finish()
        except LogGone as fault:
            self._handle_lost(fault, 0.0)
        except OSError as fault:
            self._fail(fault, 0, 0.0)
        self._look_back()
