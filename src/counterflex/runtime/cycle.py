"""One cycle of the loop in one call: what was found before, tests, step, play of the axes, tests, process, speed. Pure.

The arrays come as one table (:mod:`counterflex.core.array_table`), its rows in the order of the constants ``A_...``.
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
from counterflex.runtime.state import layout as at
from counterflex.runtime.step.axis_play_kernel import play_after
from counterflex.runtime.step.step import step

# Arrays of the step, in the order of its arguments.
A_GIVEN: Final = 0
A_FLAGS: Final = 1
A_CONSTANTS: Final = 2
A_CHOICES: Final = 3
A_SUPERVISOR: Final = 4
A_PLAN: Final = 5
A_REAL: Final = 6
A_KIND: Final = 7
A_STATE: Final = 8
A_WHOLE: Final = 9
A_RING: Final = 10
A_FILTER: Final = 11  # 7: coefficients; memory, ring and place of the measured wrench, then of the predicted one
A_ELASTIC: Final = 18  # 5: output, frame, delta, scratch, load of the elastic step
A_RESULTS: Final = 23
A_OUTCOME: Final = 24
A_WORK: Final = 25
A_TESTS: Final = 26  # 6: PlausibilityStage.arrays
A_PLAY: Final = 32  # 3: AxisPlay.arrays
A_PROCESS: Final = 35  # 3: Monitor.records
ARRAYS: Final = 38


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


@kernel("void(int64[:, ::1])")
def cycle(table: Int) -> None:
    """One cycle; see :class:`counterflex.runtime.loop.Loop`, which owns the arrays.

    Args:
        table: (ARRAYS, 3) of the arrays; what the step, the tests and the monitor change is changed.
    """
    given, flags = reals(table, A_GIVEN), wholes(table, A_FLAGS)
    choices, state, whole = wholes(table, A_CHOICES), reals(table, A_STATE), wholes(table, A_WHOLE)
    ring, results, outcome = matrix(table, A_RING), reals(table, A_RESULTS), wholes(table, A_OUTCOME)
    plan, place = matrix(table, A_PLAN), state[at.S_PLACE : at.S_PLACE + 2]
    limits, times = reals(table, A_TESTS), wholes(table, A_TESTS + 1)
    memory, counts, work = reals(table, A_TESTS + 2), wholes(table, A_TESTS + 3), matrix(table, A_TESTS + 4)
    watched, settings, memories = _watched_plan(table), _monitor_settings(table), _monitor_memory(table)
    monitor, monitored = settings[0], memories[0]
    hand_over(memories, flags)
    constants, scratch = reals(table, A_CONSTANTS), matrix(table, A_ELASTIC + 3)
    before_step(
        given, flags, constants, choices, state, whole, ring, results, limits, times, memory, counts, work,
    )  # fmt: skip
    swing_kg = swing_mass(monitored, monitor)
    believe_force(
        given, flags, choices, constants, plan, state, whole, ring, scratch[1], swing_kg, limits, times, memory,
        counts, work,
    )  # fmt: skip
    step(
        given,
        flags,
        constants,
        choices,
        wholes(table, A_SUPERVISOR),
        plan,
        matrix(table, A_REAL),
        whole_matrix(table, A_KIND),
        state,
        whole,
        ring,
        reals(table, A_FILTER),
        matrix(table, A_FILTER + 1),
        matrix(table, A_FILTER + 2),
        wholes(table, A_FILTER + 3),
        matrix(table, A_FILTER + 4),
        matrix(table, A_FILTER + 5),
        wholes(table, A_FILTER + 6),
        reals(table, A_ELASTIC),
        matrix(table, A_ELASTIC + 1),
        matrix(table, A_ELASTIC + 2),
        scratch,
        reals(table, A_ELASTIC + 4),
        results,
        outcome,
        matrix(table, A_WORK),
    )
    play_after(
        given, flags, results, outcome, matrix(table, A_PLAY), matrix(table, A_PLAY + 1), wholes(table, A_PLAY + 2)
    )
    after_step(
        given, flags, choices, state, whole, ring, results, outcome, limits, times, wholes(table, A_TESTS + 5)[0],
        swing_kg * monitored.acceleration, memory, counts, work,
    )  # fmt: skip
    watch(given, flags, results, outcome, place, plan, watched, settings, memories)
    ask_speed(results, outcome, place, watched, settings, memories)
    if monitor.speed_step > 0.0:  # the program's speed may be changed: the plan is read at it
        state[at.S_SPEED] = monitored.results.speed
        state[at.S_SLOWER] = monitored.results.speed**monitor.exponent


@kernel("void(int64[:, ::1], float64[:, ::1], int64, int64)")
def take_fast(table: Int, samples: Float, count: int, number: int) -> None:
    """Hand over the force sensor's own samples since the last cycle, ahead of :func:`cycle`.

    Args:
        table: As for :func:`cycle`.
        samples: (n, >= 3) force in any fixed axes, N, in time.
        count: Samples that are new; those beyond the rows were not kept.
        number: Sequence number of the first.
    """
    row = _watched_plan(table)[max(0, int(reals(table, A_STATE)[at.S_PLACE]))]
    count = min(count, samples.shape[0])
    settings, memories = _monitor_settings(table), _monitor_memory(table)
    take_samples(samples, count, number, row.turn_per_s, int(row.teeth), settings, memories)
