"""History of the loop at an instant that has passed: rows of the ring by their time, linear in between."""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.memory import PAST_ROWS

SPAN: Final = 25
"""Cycles of the loop over which a motion is looked for: 0.1 s at 4 ms."""
STANDS_M: Final = 20e-6


@kernel("int64(int64, int64)")
def row_back(here: int, cycles: int) -> int:
    """Row of the ring that was written some cycles before row ``here``, at most PAST_ROWS."""
    return (here - cycles + PAST_ROWS) % PAST_ROWS


@kernel("void(Past, Past, float64, Past, Past)", **LOOP_TYPES)
def _between(earlier: Record, later: Record, u: float, near: Record, out: Record) -> None:
    """Numbers between two cycles, at ``u`` 0..1 on the way; rotations and directions of the nearer one."""
    v = 1.0 - u
    for k in range(9):
        out.nominal[k], out.frame[k] = near.nominal[k], near.frame[k]
    for k in range(9, 12):
        out.nominal[k] = v * earlier.nominal[k] + u * later.nominal[k]
    for k in range(6):
        out.sent[k] = v * earlier.sent[k] + u * later.sent[k]
        out.deflection[k] = v * earlier.deflection[k] + u * later.deflection[k]
        out.in_effect[k] = v * earlier.in_effect[k] + u * later.in_effect[k]
        out.contained[k] = v * earlier.contained[k] + u * later.contained[k]
    for k in range(18):
        out.bent[k] = v * earlier.bent[k] + u * later.bent[k]
    for k in range(3):
        out.stand[k] = v * earlier.stand[k] + u * later.stand[k]
    out.clock = v * earlier.clock + u * later.clock
    out.swing = v * earlier.swing + u * later.swing


@kernel("boolean(Past[::1], int64, float64, Past)", **LOOP_TYPES)
def row_at(ring: Records, newest: int, clock: float, out: Record) -> bool:
    """Row of the ring at an instant.

    Positions, corrections and deflections between two cycles are linear; rotations and directions are those of the
    nearer one.

    ``newest``: Row written last; ``clock``: instant in cycles of the controller, as in ``clock``.

    Returns:
        False where the instant is before the oldest row, or after the newest by more than a cycle; then ``out`` is not
        written.
    """
    later = newest
    if clock > ring[later].clock + 1.0:
        return False
    for back in range(PAST_ROWS - 1):
        earlier = row_back(newest, back)
        stamp = ring[earlier].clock
        if stamp <= 0.0:
            return False
        if stamp <= clock:
            span = ring[later].clock - stamp
            u = min(1.0, (clock - stamp) / span) if span > 0.0 else 0.0
            near = earlier if u < 0.5 else later
            _between(ring[earlier], ring[later], u, ring[near], out)
            return True
        later = earlier
    return False


@kernel("boolean(Past[::1], int64, float64[::1])", **LOOP_TYPES)
def moves(ring: Records, here: int, nominal: Float) -> bool:
    """Return whether the program goes on, and did two spans ago: only then does the force say something of the plan's.

    A program that is paused in the cut leaves no force, whatever the plan says; one that goes on again has none before
    the robot follows and the filters have forgotten the pause.

    Args:
        ring: Past cycles.
        here: Row of this cycle; it need not be written.
        nominal: (12,) commanded pose now.
    """
    one, two, three = row_back(here, SPAN), row_back(here, 2 * SPAN), row_back(here, 3 * SPAN)
    last, middle, first = ring[one], ring[two], ring[three]
    now = before = 0.0
    for k in range(9, 12):
        now += (nominal[k] - last.nominal[k]) ** 2
        before += (middle.nominal[k] - first.nominal[k]) ** 2
    return min(now, before) > STANDS_M * STANDS_M


@kernel("boolean(Past[::1], int64, float64[::1])", **LOOP_TYPES)
def stands(ring: Records, here: int, nominal: Float) -> bool:
    """Return whether the program stands: the commanded point has not moved by more than STANDS_M within SPAN cycles.

    Args:
        ring: Past cycles.
        here: Row of this cycle; it need not be written.
        nominal: (12,) commanded pose now, without correction.
    """
    for back in (SPAN // 2, SPAN):
        row = ring[row_back(here, back)]
        way = 0.0
        for k in range(9, 12):
            way += (nominal[k] - row.nominal[k]) ** 2
        if not way <= STANDS_M * STANDS_M:
            return False
    return True
