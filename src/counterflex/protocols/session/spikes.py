"""Spikes of a force sensor: single samples far off those about them, as a loose plug or a radio makes them.

A force of the process lasts longer than a sample; one that is far off the last one is therefore held back, and used
where the next ones are there, too. A step of the force is late by two samples so, where a cycle has several, else by
one.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record

LEAST_N: Final = 60.0
"""Change from one sample to the next that is never a spike: a cutter enters at full depth within some samples."""
USUAL: Final = 5.0
"""Usual changes above which a change is far off: one in 300 of normal noise is above 3."""
_SHARE: Final = 0.05
"""Of a new change in the usual one."""
_SEVERAL: Final = 3
"""Samples in a cycle from which on two are held back."""


GATE: Final = record(
    last=(float, 3),  # N, last sample that was used
    usual=float,  # N, usual change from one sample to the next
    w=(float, 6),  # N, N m, mean of the samples of a cycle that were used
    known=int,  # 1: there is a last one
    held=int,  # samples held back so far
    count=int,  # spikes so far
)


@kernel("boolean(Gate, float64, float64, float64, int64)", Gate=GATE)
def _takes(g: Record, x: float, y: float, z: float, most: int) -> bool:
    change = math.sqrt((x - g.last[0]) ** 2 + (y - g.last[1]) ** 2 + (z - g.last[2]) ** 2)
    limit = max(LEAST_N, USUAL * g.usual)
    if g.known == 1 and change > limit and g.held < most:
        g.held += 1
        return False
    if change <= limit:
        g.count += g.held
    g.held = 0
    g.usual = g.usual + _SHARE * (min(change, limit) - g.usual) if g.known == 1 else 0.0
    g.last[0], g.last[1], g.last[2] = x, y, z
    g.known = 1
    return True


@kernel("int64(float64[:, ::1], int64, Gate[::1])", Gate=GATE, entry=True)
def clean(samples: Float, count: int, gates: Records) -> int:
    """Leave out samples of a cycle that are far off; the mean of the others is written where there are both.

    Args:
        samples: (m, 6) in time.
        count: How many of its rows.
        gates: (1,) :data:`GATE`; changed.

    Returns:
        Samples that were left out.
    """
    g, used = gates[0], 0
    most = 2 if count >= _SEVERAL else 1
    g.w[:] = 0.0
    for row in range(count):
        if _takes(g, samples[row, 0], samples[row, 1], samples[row, 2], most):
            used += 1
            for k in range(6):
                g.w[k] += samples[row, k]
    if 0 < used < count:
        for k in range(6):
            g.w[k] /= used
    return count - used
