"""Snapshots of a loop's whole state in shared memory: written by the loop now and then, taken by the recorder.

Two slots are written in turn. The loop counts a snapshot before it begins to write it and again when it stands; a
reader takes the newest that stands, and keeps it only if the loop has not begun to write over it meanwhile. Nobody
waits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError
from counterflex.core.records import as_words
from counterflex.runtime.state.memory_layout import Arrays, Layout

WORDS: Final = 1 << 16
"""Numbers of 64 bits that a slot holds: 512 KiB."""
_HEAD: Final = 8  # numbers before the slots: begun, standing
_SLOT: Final = 4 + WORDS  # cycle, stamp, words, unused; the words
BYTES: Final = 8 * (_HEAD + 2 * _SLOT)


@dataclass(frozen=True, eq=False)
class LoopState:
    """A loop's memory between two cycles."""

    cycle: int  # the last one before it, by the loop's own count
    time_ns: int  # when the telegram of that cycle was received, monotonic
    words: Int  # (n,) all that the loop remembers, bit for bit, as whole numbers of 64 bits
    layout: Layout = ()  # what they mean; empty: as in logs that do not say it


class StateSlots:
    """The two slots.

    Args:
        memory: (BYTES // 8,) shared; zeros where nothing was written yet.
    """

    def __init__(self, memory: Int) -> None:
        self._memory = memory
        self._taken = 0

    def put(self, cycle: int, time_ns: int, arrays: Arrays) -> None:
        """Writer: copy a state.

        Args:
            cycle: See :class:`LoopState`.
            arrays: All that the loop remembers, in fixed order.

        Raises:
            InputError: They do not fit into a slot.
        """
        memory = self._memory
        number = int(memory[0]) + 1
        first = _HEAD + (number % 2) * _SLOT
        size = sum(array.nbytes for array in arrays.values()) // 8
        if size > WORDS:
            raise InputError("the loop's state does not fit into shared memory", value=size, limit=WORDS)
        memory[0] = number
        memory[first : first + 3] = cycle, time_ns, size
        at = first + 4
        for array in arrays.values():
            own = as_words(array)
            memory[at : at + own.size] = own
            at += own.size
        memory[1] = number

    def take(self) -> LoopState | None:
        """Reader: a copy of the newest state; None where there is none since the last call, or it was written over."""
        memory = self._memory
        number = int(memory[1])
        if number == self._taken:
            return None
        first = _HEAD + (number % 2) * _SLOT
        cycle, time_ns, size = (int(n) for n in memory[first : first + 3])
        words = memory[first + 4 : first + 4 + min(max(size, 0), WORDS)].copy()
        if int(memory[0]) > number + 1:
            return None
        self._taken = number
        return LoopState(cycle, time_ns, words)

    def rewind(self) -> None:
        """Reader: take also what was written before it joined."""
        self._taken = 0

    def skip(self) -> None:
        """Reader: leave what was written before."""
        self._taken = int(self._memory[1])
