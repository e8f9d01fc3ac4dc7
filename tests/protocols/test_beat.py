"""The sign of life of a process: it comes while another thread of the process keeps the interpreter lock."""

from __future__ import annotations

from typing import Final

import numpy as np
import pytest

from counterflex.core.arrays import Int
from counterflex.core.jit import kernel
from counterflex.protocols.processes.control_array import CONTROL, Life
from counterflex.protocols.processes.living import Beat
from counterflex.protocols.system.system_calls import _nanosleep, unlocked_beat

WAITS: Final = 20_000
"""Milliseconds that a beat is waited for at most: only where none comes at all."""


@kernel("int64(int64[::1], int64, int64, int64, int64[::1])", entry=True)
def seen_with_the_lock(words: Int, place: int, most: int, enough: int, work: Int) -> int:
    """Count the changes of a word, ``most`` times a millisecond apart; no other Python thread runs meanwhile."""
    last, seen = words[place], 0
    for _ in range(most):
        work[0], work[1] = 0, 1_000_000
        _nanosleep(work.ctypes.data, 0)
        if words[place] != last:
            last, seen = words[place], seen + 1
            if seen >= enough:
                break
    return seen


@pytest.mark.parametrize("unlocked", [False, True])
def test_a_beat_needs_the_interpreter_lock_only_until_it_is_unlocked(unlocked: bool) -> None:
    control: Int = np.zeros(CONTROL, dtype=np.int64)
    beat = Beat(control, Life.RUN_NS, Life.RUN_PID)
    beat_on = unlocked_beat() if unlocked else None
    if beat_on is not None:
        beat.unlock(beat_on)
        for _ in range(3):  # the first may still be one of Python
            last = int(control[Life.RUN_NS])
            while control[Life.RUN_NS] == last:
                pass
    work: Int = np.zeros(2, dtype=np.int64)
    seen = seen_with_the_lock(control, int(Life.RUN_NS), WAITS if beat_on is not None else 60, 5, work)
    beat.close()
    assert seen == (5 if beat_on is not None else 0)
