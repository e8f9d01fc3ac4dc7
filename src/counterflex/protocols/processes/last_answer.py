"""Last answer of a loop, in shared memory that outlives its process: the next loop begins with the correction in it."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple, Self

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, OutputError
from counterflex.core.jit import kernel
from counterflex.protocols.processes.shared_words import SharedWords, kept_at

NUMBER_AT, _COUNTER, _CLOCK, _CORRECTION, _AXES, _WIDTH = 0, 1, 2, 3, 9, 16
SLOTS: Final = 2
"""Written in turn: a loop that is killed while it writes leaves the answer before."""


class Answered(NamedTuple):
    """An answer that a loop sent.

    Attributes:
        counter: Of the controller, ms.
        clock_ns: When, monotonic.
        correction: (6,) m and rotation vector, part axes.
        axes: (6,) the same as change of the axis angles, rad.
    """

    counter: int
    clock_ns: int
    correction: Float
    axes: Float


@kernel("void(float64[:, ::1], int64, int64, int64, float64[::1], float64[::1])", entry=True)
def fill_answer(memory: Float, number: int, counter: int, clock_ns: int, correction: Float, axes: Float) -> None:
    """Write an answer without its number.

    Called from another kernel by its address: code at an address is not mixed with what stands before and behind it, so
    that the number is put last there, too.

    Args:
        memory: See :class:`LastAnswer`.
        number: That it gets.
        counter: See :class:`Answered`, and the next.
    """
    slot = memory[number % SLOTS]
    slot[_COUNTER], slot[_CLOCK] = counter, clock_ns
    for k in range(6):
        slot[_CORRECTION + k], slot[_AXES + k] = correction[k], axes[k]


class LastAnswer:
    """Newest answer of a loop, and the last one of the loop before it.

    Args:
        memory: (2, 16) shared; zeros where nothing was answered. None: what was answered before is lost.

    Attributes:
        before: The newest answer in it; zero where nothing was answered, None where that is lost.
    """

    def __init__(self, memory: Float | None) -> None:
        self._memory: Float = np.zeros((SLOTS, _WIDTH)) if memory is None else memory
        newest = self._memory[int(np.argmax(self._memory[:, NUMBER_AT]))].copy()
        lost = memory is None or not np.isfinite(newest).all()
        self.before = (
            None
            if lost
            else Answered(int(newest[_COUNTER]), int(newest[_CLOCK]), newest[_CORRECTION:_AXES], newest[_AXES:15])
        )
        self.number: Int = np.array([0 if lost else newest[NUMBER_AT]], dtype=np.int64)  # (1,) of the newest answer
        self._words: SharedWords | None = None

    @classmethod
    def at_lock(cls, lock: Path, *, fresh: bool) -> Self:
        """Open the memory that belongs to a lock file, or make it.

        Args:
            lock: The lock file, held.
            fresh: Nothing of what stands in it counts.
        """
        path, size = kept_at(lock), SLOTS * _WIDTH
        lost, words = not fresh, None
        try:
            words = SharedWords(size, path)
            lost = False
        except InputError:
            try:
                path.unlink(missing_ok=True)
                words = SharedWords(size, path, make=True)
            except (OutputError, OSError):  # another user's: kept by this process alone
                return cls(None if lost else np.zeros((SLOTS, _WIDTH)))
        memory: Float = np.frombuffer(words.words, dtype=np.float64).reshape(SLOTS, _WIDTH)
        if fresh:
            memory[:] = 0.0
        last = cls(memory)
        last._words = words
        last.before = None if lost else last.before
        return last

    def put(self, counter: int, clock_ns: int, correction: Float, axes: Float) -> None:
        """Write an answer that is about to be sent; its number stands last."""
        self.number += 1
        number = int(self.number[0])
        slot = self._memory[number % SLOTS]
        slot[NUMBER_AT] = 0.0
        fill_answer(self._memory, number, counter, clock_ns, correction, axes)
        slot[NUMBER_AT] = number

    @property
    def memory(self) -> Float:
        """(2, 16) memory; the number of an answer stands first in its row."""
        return self._memory

    def close(self, *, keep: bool) -> None:
        """Leave the memory; it is removed unless the next loop needs it."""
        if self._words is not None:
            self._memory = np.zeros((SLOTS, _WIDTH))
            if not keep:
                self._words.remove()
            self._words.close()
            self._words = None
