"""Corrections known ahead of any measurement: for the lag behind the program, and for play where axes turn round.

The lag is undone by a filter on speed and acceleration of the program, see
:mod:`counterflex.runtime.design.tracker`. Both come from the commanded poses of the last telegrams, so they hold
at any override.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.primitives.frames import across, pose_deviation
from counterflex.runtime.primitives.history import row_at
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

SPAN: Final = 2
"""Cycles over which a rate is taken; two of them lie behind an acceleration."""


@kernel("boolean(Past[::1], float64[::1], float64, State, float64[::1], float64[::1])", **LOOP_TYPES)
def rates(ring: Records, nominal: Float, period: float, state: Record, zero: Float, work: Float) -> bool:
    """Speed and acceleration of the commanded pose now, from differences over :data:`SPAN` cycles of the controller.

    The mean speed of the last span belongs to its middle; the acceleration of two spans carries it to now. Poses of
    telegrams that were lost are taken as linear in between.

    Args:
        ring: Past cycles, this one's pose and clock written.
        nominal: (12,) commanded pose now.
        period: Cycle, s.
        state: Of the step; ``path_rate`` and ``path_acceleration`` are written.
        zero: (6,) zeros.
        work: (12,) work space.

    Returns:
        False where the past is not long enough: rates are zero then.
    """
    here, clock, one, two = state.ring_row, state.clock, state.past, state.earlier
    rate, second = state.path_rate[:], state.path_acceleration[:]
    known = row_at(ring, here, clock - SPAN, one) and row_at(ring, here, clock - 2.0 * SPAN, two)
    if not known:
        for k in range(6):
            rate[k] = second[k] = 0.0
        return False
    pose_deviation(nominal, 0, one.nominal[:], zero, work[:6])
    pose_deviation(one.nominal[:], 0, two.nominal[:], zero, work[6:12])
    span = SPAN * period
    for k in range(6):
        last, before = work[k] / span, work[6 + k] / span
        second[k] = (last - before) / span
        # The mean of a span is the speed half a span ago; that half is as long as the lag this is to undo.
        rate[k] = last + 0.5 * span * second[k]
    return True


@kernel("float64(float64[::1], float64[::1], float64[::1], float64, float64[::1], float64[::1])")
def lag_correction(rate: Float, second: Float, filter_: Float, largest: float, memory: Float, out: Float) -> float:
    """Correction that undoes the lag behind the program, (6,) written; no larger than allowed, direction kept.

    Args:
        rate: (6,) m/s, rad/s.
        second: (6,) m/s2, rad/s2.
        filter_: (8,) of :func:`counterflex.runtime.design.tracker.lag_filter`.
        largest: Largest translation, m.
        memory: (12,) of the filter; changed.
        out: (6,) m, rad.

    Returns:
        Share 0..1 of it that is given; below 1 the program runs too fast for it.
    """
    size = 0.0
    for k in range(6):
        v, a = rate[k], second[k]
        y = filter_[0] * v + filter_[3] * a + memory[2 * k]
        memory[2 * k] = filter_[1] * v + filter_[4] * a - filter_[6] * y + memory[2 * k + 1]
        memory[2 * k + 1] = filter_[2] * v + filter_[5] * a - filter_[7] * y
        out[k] = y
        size += y * y if k < 3 else 0.0
    size = math.sqrt(size)
    share = largest / size if size > largest else 1.0
    for k in range(6):
        out[k] *= share
    return share


@kernel("void(Plan[::1], float64[::1], float64[::1])", **LOOP_TYPES)
def add_play_compensation(plan: Records, place: Float, out: Float) -> None:
    """Correction of the plan that undoes play, (3,) m, part axes, added to ``out``.

    ``place``: (2,) of :func:`counterflex.runtime.primitives.localize.follow`; ``out``: (3,) at least.
    """
    i, u = int(place[0]), place[1]
    first, last = plan[i].play[:], plan[i + 1].play[:]
    for k in range(3):
        out[k] += (1.0 - u) * first[k] + u * last[k]


@kernel(
    "float64(Plan[::1], Past[::1], float64[::1], Settings, boolean, State, float64[::1], float64[::1])", **LOOP_TYPES
)
def known_ahead(
    plan: Records,
    ring: Records,
    nominal: Float,
    settings: Record,
    planned: bool,
    state: Record,
    work: Float,
    zero: Float,
) -> float:
    """Correction known ahead of any measurement, written into the state: lag behind the program, then play.

    ``nominal``: (12,) commanded pose now; ``work``: (12,) work space; ``zero``: (6,) zeros.

    Returns:
        Share of the lag that could be undone, see :func:`lag_correction`.
    """
    forward = state.known_ahead[:]
    for k in range(6):
        forward[k] = 0.0
    share = 1.0
    if settings.undo_lag == 1:
        rates(ring, nominal, settings.period, state, zero, work)
        share = lag_correction(
            state.path_rate[:],
            state.path_acceleration[:],
            settings.lag[:],
            settings.lag_most,
            state.lag_filter[:],
            forward,
        )
    if settings.undo_play == 1 and planned:
        add_play_compensation(plan, state.place[:], forward)
    if settings.normal_only == 1 and planned:
        across(forward, 0, plan, int(state.place[0]))
    return share
