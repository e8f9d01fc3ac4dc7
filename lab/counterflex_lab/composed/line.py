"""The network between controller and loop: what becomes of a datagram while faults act."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.units import MM
from counterflex_lab.composed.story import Active

WIRE_S: Final = 0.1e-3
"""Undisturbed."""
_OVERTAKEN: Final = 1.3
"""Cycles by which a datagram is late that the next one overtakes."""


class Line:
    """Both ways of the line.

    Args:
        active: Faults that act.
        rng: Its chance.
        period_s: Cycle of the controller.
    """

    def __init__(self, active: Active, rng: np.random.Generator, period_s: float) -> None:
        self._active, self._rng, self._period_s = active, rng, period_s

    def carried(self, data: bytes, *, answer: bool) -> list[tuple[float, bytes]]:
        """Delay and bytes of what arrives of a datagram, in order of sending.

        Args:
            data: As sent.
            answer: It is one of the loop's.
        """
        now, random = self._active.now, self._rng.random
        if not now:
            return [(WIRE_S, data)]
        size = self._active.size
        if "lost" in now and random() < size("lost"):
            return []
        if answer and "answers-lost" in now and random() < size("answers-lost"):
            return []
        delay = WIRE_S
        if "late" in now:
            delay += size("late") * float(random())
        if "reordered" in now and not answer and random() < size("reordered"):
            delay += _OVERTAKEN * self._period_s
        if "damaged" in now and not answer and random() < size("damaged"):
            data = self._damaged(data)
        out = [(delay, data)]
        if "repeated" in now and random() < size("repeated"):
            out.append((delay + 2.0 * self._period_s * float(random()), data))
        return out

    def _damaged(self, data: bytes) -> bytes:
        """Some bytes changed, or the end cut off."""
        if self._rng.random() < 0.3:
            return data[: int(self._rng.integers(0, len(data)))]
        out = bytearray(data)
        for at in self._rng.integers(0, len(out), size=int(self._rng.integers(1, 5))):
            out[at] = int(self._rng.integers(0, 256))
        return bytes(out)


STRANGE_M: Final = 7.0
"""How far from everything the pose in a stranger's telegrams lies: it must never be seen inside the loop."""


def strange(telegram: bytes) -> bytes:
    """A telegram of the controller as another computer sends it: whole, and of another place."""
    begin = telegram.find(b'<RSol X="')
    if begin < 0:
        return telegram
    begin += len(b'<RSol X="')
    end = telegram.index(b'"', begin)
    return telegram[:begin] + f"{STRANGE_M / MM:.4f}".encode("ascii") + telegram[end:]
