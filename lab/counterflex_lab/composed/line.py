"""The network between controller and loop: what becomes of a datagram while faults act."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex_lab.composed.story import Active

WIRE_S: Final = 0.1e-3
"""Undisturbed."""
_OVERTAKEN: Final = 1.3
"""Cycles by which a datagram is late that the next one overtakes."""

_DAMAGED: Final = ("damaged", "message-damaged")


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
        for kind in _DAMAGED:
            if kind in now and not answer and random() < size(kind):
                data = damaged(data, self._rng)
        out = [(delay, data)]
        if "repeated" in now and random() < size("repeated"):
            out.append((delay + 2.0 * self._period_s * float(random()), data))
        return out

    def others(self, sent: Sequence[bytes], rng: np.random.Generator) -> list[tuple[float, bytes, bool]]:
        """Delay and bytes of telegrams that come beside the controller's newest, and whether a stranger sends them.

        Args:
            sent: Telegrams of the controller so far.
            rng: Their chance.
        """
        now, size = self._active.now, self._active.size
        out: list[tuple[float, bytes, bool]] = []
        if "stranger" in now:
            out += [(self._period_s * float(rng.random()), sent[-1], True) for _ in range(round(size("stranger")))]
        if "replayed" in now and rng.random() < 0.3:
            back = min(len(sent), round(size("replayed") / self._period_s))
            out.append((self._period_s * float(rng.random()), sent[-back], False))
        return out


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes changed, or the end cut off."""
    if rng.random() < 0.3:
        return data[: int(rng.integers(0, len(data)))]
    out = bytearray(data)
    for at in rng.integers(0, len(out), size=int(rng.integers(1, 5))):
        out[at] = int(rng.integers(0, 256))
    return bytes(out)
