"""The real run log on a disk that fills up, is freed again, and loses the folder of the log; read back at the end."""

from __future__ import annotations

import errno
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segments import segments
from counterflex.runtime.record_ring import CYCLE
from counterflex.runtime.state_slots import LoopState
from counterflex_lab.composed.cell import KeptLog
from counterflex_lab.composed.story import Active, Story

_FAST: Final = Path("/dev/shm")
"""Files in memory where there are any: a story writes megabytes and keeps none."""


class Disk:
    """Room that a log may take, and where its folder is.

    Attributes:
        room: Bytes that are left; None: enough.
    """

    def __init__(self) -> None:
        self.room: int | None = None
        self._place = Path(tempfile.mkdtemp(prefix="counterflex-story-", dir=_FAST if _FAST.is_dir() else None))
        self.folder = self._place / "log"
        self._moved = 0

    def opened(self, path: Path) -> io.BufferedWriter:
        """A new file on it."""
        return io.BufferedWriter(_File(path, self))

    def lose_folder(self) -> None:
        """Move the folder of the log away."""
        if self.folder.is_dir():
            self._moved += 1
            self.folder.rename(self._place / f"moved-{self._moved}")

    def give_folder(self) -> None:
        """Make an empty one in its place."""
        self.folder.mkdir(exist_ok=True)

    def remove(self) -> None:
        """Remove all of it."""
        shutil.rmtree(self._place, ignore_errors=True)


class _File(io.FileIO):
    """A file that takes what there is room for, as a file system does: the last write of a full disk may be short."""

    def __init__(self, path: Path, disk: Disk) -> None:
        super().__init__(path, "xb")
        self._disk = disk

    def write(self, data: Any) -> int:
        """Write what fits.

        Raises:
            OSError: Nothing does.
        """
        room = self._disk.room
        if room is None:
            return super().write(data) or 0
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = super().write(memoryview(data)[:room]) or 0
        self._disk.room = room - count
        return count


class DiskLog(KeptLog):
    """The log of a run as the recorder writes it; what stands in it is computed again from its files.

    Args:
        story: Of the cell.
        active: Faults that act.
        clock_s: Virtual time.

    Attributes:
        unread: What was said to be written and cannot be read, or is not what was taken; empty if all is well.
    """

    def __init__(self, story: Story, active: Active, clock_s: Callable[[], float]) -> None:
        super().__init__(story, active)
        self._disk, self._clock_s, self._gone = Disk(), clock_s, False
        self._log = RunLogWriter(self._disk.folder, {"seed": story.seed}, opened=self._disk.opened)
        self._rows: list[Float] = []
        self.unread = ""

    def add(self, rows: Float, *, state: LoopState | None = None) -> None:
        """Take records."""
        self._fill()
        self._rows.append(rows.copy())
        self._log.add(rows, self._clock_s(), state=state)
        self.written, self.lost, self.trouble_number = self._log.written, self._log.lost, self._log.trouble_number

    def _fill(self) -> None:
        """What the faults that act make of the disk."""
        now, disk = self._active.now, self._disk
        if "disk-full" in now:
            disk.room = 0
        elif "disk-fills" in now:
            disk.room = round(self._active.size("disk-fills")) if disk.room is None else disk.room
        else:
            disk.room = None
        gone, self._gone = self._gone, "log-gone" in now
        if self._gone and not gone:
            disk.lose_folder()
        elif gone and not self._gone:
            disk.give_folder()

    def note(self, facts: Mapping[str, Any]) -> None:
        """Note what an operator did."""
        self._log.note(facts)

    def close(self) -> None:
        """Finish the log, read it back, compare it with what was taken, and compute it again."""
        self._disk.room = None
        self._log.close()
        self.written, self.lost = self._log.written, self._log.lost
        try:
            self._read()
        finally:
            self._disk.remove()

    def leave(self) -> None:
        """Remove what stands of it."""
        self._disk.room = None
        try:
            self._log.close()
        finally:
            self._disk.remove()

    def _read(self) -> None:
        taken = np.concatenate([np.zeros((0, self._rows[0].shape[1])), *self._rows]) if self._rows else None
        if taken is None:
            return
        read = 0
        try:
            for segment in segments(self._disk.folder):
                read += len(segment.rows)
                at = np.searchsorted(taken[:, CYCLE], segment.rows[:, CYCLE])
                same = at < len(taken)
                was, rows = taken[at[same]], segment.rows[same]
                same[same] = ((was == rows) | (np.isnan(was) & np.isnan(rows))).all(axis=1)
                if not same.all():
                    self.unread = f"{int((~same).sum())} records of {segment.name} are not those that were taken"
                self.replay(segment.rows, segment.states)
        except FileFormatError as fault:
            if self.written:
                self.unread = f"{self.written} records were said to be written: {fault}"
            return
        if read < self.written:
            self.unread = f"{read} of {self.written} records that were said to be written can be read"
        elif self.written + self.lost != len(taken):
            self.unread = f"{self.written} written and {self.lost} lost of {len(taken)} that were taken"
