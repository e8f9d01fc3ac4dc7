"""One cycle of the loop in one call: what was found before, tests, step, play of the axes, tests, process, speed. Pure.

The arrays come as one table (:mod:`counterflex.core.array_table`), its rows in the order of the constants ``A_...``.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.array_table import matrix, reals, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml
from counterflex.runtime.monitoring.air_noise import swing_mass
from counterflex.runtime.monitoring.fast_force import take_samples
from counterflex.runtime.monitoring.monitor_kernel import hand_over, watch
from counterflex.runtime.monitoring.override_kernel import K_STEP, ask_speed
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
A_PROCESS: Final = 35  # 14: Monitor.arrays
ARRAYS: Final = 49


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
    process, watched = wholes(table, A_PROCESS + 6), matrix(table, A_PROCESS)
    process_choices, process_constants = wholes(table, A_PROCESS + 3), reals(table, A_PROCESS + 2)
    process_results, process_outcome = reals(table, A_PROCESS + 7), wholes(table, A_PROCESS + 8)
    hand_over(process, flags)
    constants, scratch = reals(table, A_CONSTANTS), matrix(table, A_ELASTIC + 3)
    before_step(
        given, flags, constants, choices, state, whole, ring, results, limits, times, memory, counts, work,
    )  # fmt: skip
    monitored = reals(table, A_PROCESS + 5)
    swing_kg = swing_mass(process_constants, monitored, process)
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
        swing_kg * monitored[ml.S_MOVED], memory, counts, work,
    )  # fmt: skip
    watch(
        given, flags, results, outcome, place, plan, watched, reals(table, A_PROCESS + 1), process_constants,
        process_choices, monitored, process, process_results, process_outcome,
        reals(table, A_PROCESS + 9),
    )  # fmt: skip
    speed, asked = reals(table, A_PROCESS + 4), reals(table, A_PROCESS + 10)
    planned = process_choices[ml.W_PLAN]
    ask_speed(results, outcome, watched, place, planned, speed, asked, process_results, process_outcome)
    if speed[K_STEP] > 0.0:  # the program's speed may be changed: the plan is read at it
        state[at.S_SPEED] = process_results[ml.R_SPEED]
        state[at.S_SLOWER] = process_results[ml.R_SPEED] ** process_constants[ml.C_EXPONENT]


@kernel("void(int64[:, ::1], float64[:, ::1], int64, int64)")
def take_fast(table: Int, samples: Float, count: int, number: int) -> None:
    """Hand over the force sensor's own samples since the last cycle, ahead of :func:`cycle`.

    Args:
        table: As for :func:`cycle`.
        samples: (n, >= 3) force in any fixed axes, N, in time.
        count: Samples that are new; those beyond the rows were not kept.
        number: Sequence number of the first.
    """
    state, plan, sampling = reals(table, A_STATE), matrix(table, A_PROCESS), reals(table, A_PROCESS + 13)
    turn_per_s, teeth = 0.0, 0
    if wholes(table, A_PROCESS + 3)[ml.W_PLAN] == 1:
        row = max(0, int(state[at.S_PLACE]))
        turn_per_s, teeth = plan[row, ml.P_TURN], int(plan[row, ml.P_TEETH])
    take_samples(
        samples,
        min(count, samples.shape[0]),
        number,
        turn_per_s,
        teeth,
        sampling[0],
        sampling[1],
        reals(table, A_PROCESS + 11),
        wholes(table, A_PROCESS + 12),
        reals(table, A_PROCESS + 1),
    )
