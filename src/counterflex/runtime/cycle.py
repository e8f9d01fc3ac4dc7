"""One cycle of the online loop in one call: tests before the step, step, play, tests after it, monitor, speed. Pure.

The loop's own numbers come as one record; the arrays whose size depends on cell, plan and filters come as one table
(:mod:`counterflex.core.array_table`), its rows in the order of the constants ``A_...``.
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import matrix, reals, to_pointer, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.runtime.monitoring.air_noise import swing_mass
from counterflex.runtime.monitoring.fast_force import take_samples
from counterflex.runtime.monitoring.monitor_kernel import hand_over, watch
from counterflex.runtime.monitoring.override_kernel import ask_speed
from counterflex.runtime.monitoring.records import MEMORY, PLAN_ROW, SETTINGS
from counterflex.runtime.plausibility.before_and_after import after_step, before_step
from counterflex.runtime.plausibility.force_step import believe_force
from counterflex.runtime.state.loop_record import LOOP
from counterflex.runtime.step.axis_play_kernel import PLAY, PLAYED, play_after
from counterflex.runtime.step.step import step

# Arrays beside the loop's record.
A_PLAN: Final = 0
A_ELASTIC: Final = 1  # 6: chain, its kinds, output, frame, delta and scratch of the elastic step
A_FILTER: Final = 7  # 7: coefficients; memory, ring and place of the measured wrench, then of the predicted one
A_PLAY: Final = 14  # 3: AxisPlay.arrays
A_PROCESS: Final = 17  # 3: Monitor.records
ARRAYS: Final = 20


@kernel("PlanRow[::1](int64[:, ::1])", PlanRow=PLAN_ROW)
def _watched_plan(table: Int) -> Records:
    out: Records = carray(to_pointer(table[A_PROCESS, 0]), (table[A_PROCESS, 1],), PLAN_ROW)
    return out


@kernel("Settings[::1](int64[:, ::1])", Settings=SETTINGS)
def _monitor_settings(table: Int) -> Records:
    out: Records = carray(to_pointer(table[A_PROCESS + 1, 0]), (1,), SETTINGS)
    return out


@kernel("Memory[::1](int64[:, ::1])", Memory=MEMORY)
def _monitor_memory(table: Int) -> Records:
    out: Records = carray(to_pointer(table[A_PROCESS + 2, 0]), (1,), MEMORY)
    return out


@kernel("Play[::1](int64[:, ::1])", Play=PLAY)
def _plays(table: Int) -> Records:
    out: Records = carray(to_pointer(table[A_PLAY, 0]), (table[A_PLAY, 1],), PLAY)
    return out


@kernel("Played[::1](int64[:, ::1])", Played=PLAYED)
def _played(table: Int) -> Records:
    out: Records = carray(to_pointer(table[A_PLAY + 1, 0]), (table[A_PLAY + 1, 1],), PLAYED)
    return out


@kernel("void(Loop[::1], int64[:, ::1])", Loop=LOOP)
def cycle(loops: Records, table: Int) -> None:
    """One cycle; see :class:`counterflex.runtime.loop.Loop`, which owns record and arrays.

    Args:
        loops: (1,) LOOP; changed.
        table: (ARRAYS, 3) of the arrays; what the step and the monitor change is changed.
    """
    loop = loops[0]
    given, settings, state, ring, result = loop.given, loop.settings, loop.state, loop.ring[:], loop.result
    limits, tests, work = loop.limits, loop.tests, loop.work
    plan, place, scratch = matrix(table, A_PLAN), state.place[:], matrix(table, A_ELASTIC + 5)
    watched, monitors, memories = _watched_plan(table), _monitor_settings(table), _monitor_memory(table)
    monitor, monitored = monitors[0], memories[0]
    hand_over(monitored, given)
    before_step(given, settings, state, ring, result, limits, tests, work)
    swing_kg = swing_mass(monitored, monitor)
    believe_force(given, settings, plan, state, ring, scratch[1], swing_kg, limits, tests, work)
    elastic = (
        matrix(table, A_ELASTIC),
        whole_matrix(table, A_ELASTIC + 1),
        reals(table, A_ELASTIC + 2),
        matrix(table, A_ELASTIC + 3),
        matrix(table, A_ELASTIC + 4),
        scratch,
    )
    low_pass, f = reals(table, A_FILTER), A_FILTER
    measured = low_pass, matrix(table, f + 1), matrix(table, f + 2), wholes(table, f + 3)
    predicted = low_pass, matrix(table, f + 4), matrix(table, f + 5), wholes(table, f + 6)
    step(given, settings, state, ring, plan, loop.cycle, result, elastic, measured, predicted)
    play_after(given, result, _plays(table), _played(table), wholes(table, A_PLAY + 2))
    after_step(given, settings, state, ring, result, limits, swing_kg * monitored.acceleration, tests, work)
    watch(given, result, place, plan, watched, monitors, memories)
    ask_speed(result, place, watched, monitors, memories)
    if monitor.speed_step > 0.0:  # the program's speed may be changed: the plan is read at it
        state.speed = monitored.results.speed
        state.force_at_speed = monitored.results.speed**monitor.exponent


@kernel("void(Loop[::1], int64[:, ::1], float64[:, ::1], int64, int64)", Loop=LOOP)
def take_fast(loops: Records, table: Int, samples: Float, count: int, number: int) -> None:
    """Hand over the force sensor's own samples since the last cycle, ahead of :func:`cycle`.

    Args:
        loops: As for :func:`cycle`.
        table: Likewise.
        samples: (n, >= 3) force in any fixed axes, N, in time.
        count: Samples that are new; those beyond the rows were not kept.
        number: Sequence number of the first.
    """
    row = _watched_plan(table)[max(0, int(loops[0].state.place[0]))]
    count = min(count, samples.shape[0])
    settings, memories = _monitor_settings(table), _monitor_memory(table)
    take_samples(samples, count, number, row.turn_per_s, int(row.teeth), settings, memories)
