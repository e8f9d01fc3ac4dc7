"""What the loop knew at an instant that has passed: rows of the ring by their time, linear in between."""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.runtime.state import layout as at

SPAN: Final = 25
"""Cycles of the loop over which a motion is looked for: 0.1 s at 4 ms."""
STANDS_M: Final = 20e-6


@kernel("boolean(float64[:, ::1], int64, float64, float64[::1])")
def row_at(ring: Float, newest: int, clock: float, out: Float) -> bool:
    """Row of the ring at an instant.

    Positions, corrections and deflections between two cycles are linear; rotations and directions are those of the
    nearer one.

    Args:
        ring: (RING_ROWS, RING), one row per cycle of the loop.
        newest: Row written last.
        clock: Instant in cycles of the controller, as in ``RING_CLOCK``.
        out: (RING,) written.

    Returns:
        False where the instant is before the oldest row, or after the newest by more than a cycle; then ``out`` is not
        written.
    """
    later = newest
    if clock > ring[later, at.RING_CLOCK] + 1.0:
        return False
    for back in range(at.RING_ROWS - 1):
        earlier = (newest - back + at.RING_ROWS) % at.RING_ROWS
        stamp = ring[earlier, at.RING_CLOCK]
        if stamp <= 0.0:
            return False
        if stamp <= clock:
            span = ring[later, at.RING_CLOCK] - stamp
            u = min(1.0, (clock - stamp) / span) if span > 0.0 else 0.0
            near = earlier if u < 0.5 else later
            for k in range(at.RING):
                turning = k < at.RING_NOMINAL + 9 or at.RING_FRAME <= k < at.RING_FRAME + 9
                if turning:
                    out[k] = ring[near, k]
                else:
                    out[k] = (1.0 - u) * ring[earlier, k] + u * ring[later, k]
            return True
        later = earlier
    return False


@kernel("boolean(float64[:, ::1], int64, float64[::1])")
def moves(ring: Float, here: int, nominal: Float) -> bool:
    """Whether the program goes on, and did two spans ago: only then does the force say something of the plan's.

    A program that is paused in the cut leaves no force, whatever the plan says; one that goes on again has none before
    the robot follows and the filters have forgotten the pause.

    Args:
        ring: Of the last cycles.
        here: Row of this cycle; it need not be written.
        nominal: (12,) commanded pose now.
    """
    one = ring[(here - SPAN + at.RING_ROWS) % at.RING_ROWS]
    two = ring[(here - 2 * SPAN + at.RING_ROWS) % at.RING_ROWS]
    three = ring[(here - 3 * SPAN + at.RING_ROWS) % at.RING_ROWS]
    now = before = 0.0
    for k in range(at.RING_NOMINAL + 9, at.RING_NOMINAL + 12):
        now += (nominal[k - at.RING_NOMINAL] - one[k]) ** 2
        before += (two[k] - three[k]) ** 2
    return min(now, before) > STANDS_M * STANDS_M


@kernel("boolean(float64[:, ::1], int64, float64[::1])")
def stands(ring: Float, here: int, nominal: Float) -> bool:
    """Whether the program stands: the commanded point has not moved by more than STANDS_M within SPAN cycles.

    Args:
        ring: Of the last cycles.
        here: Row of this cycle; it need not be written.
        nominal: (12,) commanded pose now, without correction.
    """
    for back in (SPAN // 2, SPAN):
        row = ring[(here - back + at.RING_ROWS) % at.RING_ROWS]
        way = 0.0
        for k in range(at.RING_NOMINAL + 9, at.RING_NOMINAL + 12):
            way += (nominal[k - at.RING_NOMINAL] - row[k]) ** 2
        if not way <= STANDS_M * STANDS_M:
            return False
    return True
