"""One cycle of the online loop in one call: tests before the step, step, play, tests after it, monitor, speed. Pure.

The loop's own numbers come as one record; the arrays whose size depends on cell, plan and filters come as one table
(:mod:`counterflex.core.array_table`).
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, matrix, reals, to_pointer, wholes
from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.records import REGION, STATION, STEP, SURROUNDINGS, WORK, Compact, Elastic
from counterflex.runtime.monitoring.air_noise import swing_mass
from counterflex.runtime.monitoring.fast_force import take_samples
from counterflex.runtime.monitoring.monitor_kernel import hand_over, watch
from counterflex.runtime.monitoring.override_kernel import ask_speed
from counterflex.runtime.monitoring.records import MEMORY, MONITOR_TYPES, PLAN_ROW, SETTINGS
from counterflex.runtime.plausibility.before_and_after import after_step, before_step
from counterflex.runtime.plausibility.force_step import believe_force
from counterflex.runtime.plausibility.plan_check import hold_against_plan
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.loop_record import LOOP
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.step.axis_pid_kernel import PID, PID_STATE
from counterflex.runtime.step.axis_play_kernel import PLAY, PLAYED, play_after
from counterflex.runtime.step.step import step

ARRAYS: Final = addresses(
    "plan",
    *("stations", "surroundings", "regions", "elastic", "frame", "delta", "work"),
    *("low_pass", "measured_memory", "measured_ring", "measured_place"),
    *("predicted_memory", "predicted_ring", "predicted_place"),
    *("plays", "played", "play_begun", "pids", "pid_states"),
    *("watched_plan", "monitor_settings", "monitor_memory"),
)
"""Arrays beside the loop's record: the plan; chain, results and work arrays of the elastic step; coefficients of the
force filter, and its memory, ring and place for the measured wrench and the predicted one; AxisPlay.arrays;
AxisPid.arrays; Monitor.records."""


@kernel("Plan[::1](Arrays)", Arrays=ARRAYS, **LOOP_TYPES)
def _plan(table: Record) -> Records:
    out: Records = carray(to_pointer(table.plan.place), (table.plan.rows,), PLAN)
    return out


@kernel("Elastic(Arrays)", Arrays=ARRAYS, **LOOP_TYPES)
def _elastic(table: Record) -> Elastic:
    stations, surroundings, regions = table.stations, table.surroundings, table.regions
    chain = Compact(
        carray(to_pointer(stations.place), (stations.rows,), STATION),
        carray(to_pointer(surroundings.place), (1,), SURROUNDINGS),
        carray(to_pointer(regions.place), (regions.rows,), REGION),
    )
    results = carray(to_pointer(table.elastic.place), (1,), STEP)
    works = carray(to_pointer(table.work.place), (1,), WORK)
    return Elastic(chain, results, matrix(table.frame), matrix(table.delta), works)


@kernel("PlanRow[::1](Arrays)", Arrays=ARRAYS, **MONITOR_TYPES)
def _watched_plan(table: Record) -> Records:
    out: Records = carray(to_pointer(table.watched_plan.place), (table.watched_plan.rows,), PLAN_ROW)
    return out


@kernel("Settings[::1](Arrays)", Arrays=ARRAYS, **MONITOR_TYPES)
def _monitor_settings(table: Record) -> Records:
    out: Records = carray(to_pointer(table.monitor_settings.place), (1,), SETTINGS)
    return out


@kernel("Memory[::1](Arrays)", Arrays=ARRAYS, **MONITOR_TYPES)
def _monitor_memory(table: Record) -> Records:
    out: Records = carray(to_pointer(table.monitor_memory.place), (1,), MEMORY)
    return out


@kernel("Play[::1](Arrays)", Play=PLAY, Arrays=ARRAYS)
def _plays(table: Record) -> Records:
    out: Records = carray(to_pointer(table.plays.place), (table.plays.rows,), PLAY)
    return out


@kernel("Played[::1](Arrays)", Played=PLAYED, Arrays=ARRAYS)
def _played(table: Record) -> Records:
    out: Records = carray(to_pointer(table.played.place), (table.played.rows,), PLAYED)
    return out


@kernel("Pid[::1](Arrays)", Pid=PID, Arrays=ARRAYS)
def _pids(table: Record) -> Records:
    out: Records = carray(to_pointer(table.pids.place), (table.pids.rows,), PID)
    return out


@kernel("Kept[::1](Arrays)", Kept=PID_STATE, Arrays=ARRAYS)
def _pid_states(table: Record) -> Records:
    out: Records = carray(to_pointer(table.pid_states.place), (table.pid_states.rows,), PID_STATE)
    return out


@kernel("void(Loop[::1], Arrays[::1])", Loop=LOOP, Arrays=ARRAYS, entry=True)
def cycle(loops: Records, tables: Records) -> None:
    """One cycle; see :class:`counterflex.runtime.loop.Loop`, which owns record and arrays.

    Args:
        loops: (1,) LOOP; changed.
        tables: (1,) ARRAYS; what the step and the monitor change is changed.
    """
    loop, table = loops[0], tables[0]
    given, settings, state, ring, result = loop.given, loop.settings, loop.state, loop.ring[:], loop.result
    limits, tests, work = loop.limits, loop.tests, loop.work
    plan, place, elastic = _plan(table), state.place[:], _elastic(table)
    watched, monitors, memories = _watched_plan(table), _monitor_settings(table), _monitor_memory(table)
    monitor, monitored = monitors[0], memories[0]
    hand_over(monitored, settings, given)
    before_step(given, settings, state, ring, result, limits, tests, work)
    swing_kg = swing_mass(monitored, monitor)
    believe_force(given, settings, plan, state, ring, elastic.works[0].jacobian[:], swing_kg, limits, tests, work)
    low_pass = reals(table.low_pass)
    measured = low_pass, matrix(table.measured_memory), matrix(table.measured_ring), wholes(table.measured_place)
    predicted = low_pass, matrix(table.predicted_memory), matrix(table.predicted_ring), wholes(table.predicted_place)
    pids, kept = _pids(table), _pid_states(table)
    step(given, settings, state, ring, plan, loop.cycle, result, elastic, measured, predicted, pids, kept)
    play_after(given, result, _plays(table), _played(table), wholes(table.play_begun))
    after_step(given, settings, state, ring, loop.cycle, result, limits, swing_kg * monitored.acceleration, tests, work)
    watch(given, result, place, plan, watched, monitors, memories)
    ask_speed(result, place, watched, monitors, memories)
    if settings.has_plan == 1:
        feed = monitored.rate / max(0.01, monitored.results.speed)
        hold_against_plan(state, result, feed, monitored.results.ratio, limits, tests)
    if monitor.speed_step > 0.0:  # the program's speed may be changed: the plan is read at it
        state.speed = monitored.results.speed
        state.force_at_speed = monitored.results.speed**monitor.exponent


@kernel("void(Loop[::1], Arrays[::1], float64[:, ::1], int64, int64)", Loop=LOOP, Arrays=ARRAYS, entry=True)
def take_fast(loops: Records, tables: Records, samples: Float, count: int, number: int) -> None:
    """Hand over the force sensor's own samples since the last cycle, ahead of :func:`cycle`.

    Args:
        loops: As for :func:`cycle`.
        samples: (n, >= 3) force in any fixed axes, N, in time.
        count: Samples that are new; those beyond the rows were not kept.
        number: Sequence number of the first.
    """
    table = tables[0]
    row = _watched_plan(table)[max(0, int(loops[0].state.place[0]))]
    count = min(count, samples.shape[0])
    settings, memories = _monitor_settings(table), _monitor_memory(table)
    take_samples(samples, count, number, row.turn_per_s, int(row.teeth), settings, memories)
