"""Snapshots of a loop in shared memory: it writes one in every cycle and waits for nobody; whoever may read, reads.

A ring of slots. Each holds the number of its snapshot and a check sum over all that it holds. The loop turns the number
of a slot below zero, writes, and puts the number back. A reader copies a slot and takes the copy only if number and
check sum are right: what was written over meanwhile is not taken, in whatever order memory becomes visible.
Readers open the memory for reading only; nothing that they do reaches the loop.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.held import share
from counterflex.core.records import Records
from counterflex.protocols.processes import snapshot_layout as layout
from counterflex.protocols.processes.shared_words import made_at

_SUFFIX: Final = "-snapshot"
_BYTES: Final = 8 * layout.WORDS
_FIRST: Final = layout.HEAD + layout.TEXT
_WEIGHTS: Final = 2 * np.arange(layout.NUMBERS - 1, dtype=np.int64) + 1


def snapshot_path(words: Path) -> Path:
    """Path of the snapshots of a run, by the path of its shared numbers."""
    return words.with_name(words.name + _SUFFIX)


def check_of(numbers: Int) -> Int:
    """Check sums of snapshots: of all numbers before it, each times an odd number of its own, without overflow errors.

    Args:
        numbers: (..., NUMBERS) as whole numbers of 64 bits.
    """
    out: Int = numbers[..., :-1] @ _WEIGHTS
    return out


class SnapshotMemory:
    """The run's side: makes the memory, and removes it.

    Args:
        words: Where the run's shared numbers are; the snapshots lie beside them.

    Raises:
        OutputError: There is no room.
    """

    def __init__(self, words: Path) -> None:
        self.path = snapshot_path(words)
        self._handle = made_at(self.path, _BYTES)

    def close(self) -> None:
        """Remove it; who reads goes on seeing what stood last."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
        os.close(self._handle)


class SnapshotSlots:
    """The loop's side.

    Args:
        about: What the run is, for its readers: plain values.

    Attributes:
        slots: (SLOTS,) SNAPSHOT, to be filled by :meth:`begin` and :meth:`commit`.
        numbers: The whole memory as whole numbers.

    Raises:
        InputError: No such memory, or ``about`` is too long.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self._memory = _mapped(path, os.O_RDWR, mmap.ACCESS_WRITE)
        self.numbers: Int = np.frombuffer(self._memory, dtype=np.int64)
        words = self.numbers
        text = json.dumps(about, allow_nan=False).encode()
        if len(text) > 8 * layout.TEXT:
            raise InputError(
                "what the run is does not fit beside its snapshots", value=len(text), limit=8 * layout.TEXT
            )
        words[: layout.HEAD] = 0
        words[layout.HEAD : _FIRST].view(np.uint8)[: len(text)] = np.frombuffer(text, dtype=np.uint8)
        words[_FIRST:] = 0
        self.slots: Records = words[_FIRST:].view(layout.SNAPSHOT)
        self._words = memoryview(self._memory).cast("q")
        self.number = 0
        head = self._words
        head[layout.VERSION_AT], head[layout.LAYOUT_AT] = layout.VERSION, layout.layout_number()
        head[layout.NUMBERS_AT], head[layout.SLOTS_AT], head[layout.TEXT_AT] = layout.NUMBERS, layout.SLOTS, len(text)
        head[layout.MAGIC_AT] = layout.MAGIC

    def begin(self) -> int:
        """Take the slot to be written; a reader then sees that it is not complete."""
        number = self.number + 1
        place = number % layout.SLOTS
        self._words[_FIRST + place * layout.NUMBERS] = -number
        return place

    def commit(self) -> None:
        """The slot stands, its check sum included; the number is put last."""
        self.number = number = self.number + 1
        self._words[_FIRST + number % layout.SLOTS * layout.NUMBERS] = number
        self._words[layout.COUNT_AT] = number

    def end(self) -> None:
        """The loop has ended by itself."""
        self._words[layout.ENDED_AT] = 1


class SnapshotReader:
    """Reads the snapshots of a run and can do nothing else.

    Attributes:
        about: What the run is.
        missed: Snapshots that were written over before they were read.

    Raises:
        FileFormatError: No snapshots there, or of another version of counterflex.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._memory = _mapped(path, os.O_RDONLY, mmap.ACCESS_READ)
        except InputError as fault:
            raise FileFormatError(
                "the run shows no snapshots", where=str(path), hint="Has it ended? Else it is of another counterflex"
            ) from fault
        self._numbers: Int = np.frombuffer(self._memory, dtype=np.int64)
        head = self._numbers[: layout.HEAD]
        own = (layout.MAGIC, layout.VERSION, layout.layout_number(), layout.NUMBERS, layout.SLOTS)
        if tuple(int(n) for n in head[: len(own)]) != own:
            started = int(head[layout.MAGIC_AT]) != 0
            raise FileFormatError(
                "the snapshots are of another version" if started else "the loop is still being prepared",
                where=str(path),
                value=int(head[layout.VERSION_AT]),
                limit=layout.VERSION,
                hint="Use the counterflex that the run was started with" if started else "Try again in a moment",
            )
        size = int(head[layout.TEXT_AT])
        text = self._numbers[layout.HEAD : _FIRST].view(np.uint8)[:size].tobytes()
        self.about: dict[str, Any] = json.loads(text)
        self._slots: Int = self._numbers[_FIRST:].reshape(layout.SLOTS, layout.NUMBERS)
        self._read = 0
        self.missed = 0

    @property
    def count(self) -> int:
        """Snapshots written so far."""
        return int(self._numbers[layout.COUNT_AT])

    @property
    def ended(self) -> bool:
        """The loop has ended by itself."""
        return bool(self._numbers[layout.ENDED_AT])

    def take(self) -> Records:
        """Snapshots that are new since the last call, in order; those written over meanwhile are left out."""
        count = self.count
        first = max(self._read, count - layout.MOST) + 1
        self.missed += first - 1 - self._read
        self._read = count
        requested = np.arange(first, count + 1)
        return self._sound(requested)

    def latest(self) -> Records:
        """(1,) the newest snapshot that stands, or none; :meth:`take` is not told of it."""
        count = self.count
        return self._sound(np.arange(max(1, count - 1), count + 1))[-1:]

    def _sound(self, requested: Int) -> Records:
        copies = self._slots[requested % layout.SLOTS]  # a copy: indexed by an array
        good = (copies[:, 0] == requested) & (copies[:, -1] == check_of(copies))
        self.missed += int(np.count_nonzero(~good))
        out: Records = np.ascontiguousarray(copies[good]).reshape(-1).view(layout.SNAPSHOT)
        return out

    def close(self) -> None:
        """Leave the memory."""
        del self._numbers, self._slots
        with contextlib.suppress(BufferError):
            self._memory.close()


def _mapped(path: Path, flags: int, access: int) -> mmap.mmap:
    try:
        handle = os.open(path, flags)
    except OSError as fault:
        raise InputError(f"no shared memory there: {fault.strerror or fault}", where=str(path)) from fault
    try:
        status = os.fstat(handle)
        if status.st_size != _BYTES or (hasattr(os, "getuid") and status.st_uid != os.getuid()) or not share(handle):
            raise InputError("not the snapshots of a run of yours", where=str(path), value=status.st_size, limit=_BYTES)
        return mmap.mmap(handle, _BYTES, access=access)
    finally:
        os.close(handle)
