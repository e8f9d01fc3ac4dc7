"""Sensors of a cycle, from readings to the inputs of the step: compiled, in steps and all in one call.

::

    reading ── spikes ── process wrench ── zero ── wrench of the step         poses ── tool ── pose of the step
       │                  (at an address, or by a caller of Python between two steps)
       └── fast samples of the monitor

Each rule stands in one kernel. :func:`read_force` calls them one after the other; a caller whose wrench is computed in
Python, or whose zero is being taken, calls :func:`take_reading` and :func:`use_wrench` with its own work between.
"""

from __future__ import annotations

import math
from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, matrix, reals, to_pointer
from counterflex.core.arrays import Float
from counterflex.core.entry_calls import at_address
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record
from counterflex.core.units import MS, NS
from counterflex.protocols.session.spikes import GATE, clean
from counterflex.protocols.tracker.kernel import tool_pose
from counterflex.runtime.cycle import ARRAYS as LOOP_ARRAYS, take_fast
from counterflex.runtime.primitives.hand import BACK, turned_load
from counterflex.runtime.sensing import sensor_wrench as flange
from counterflex.runtime.state.loop_record import LOOP
from counterflex.runtime.state.states import Cause, State
from counterflex.signals.arrival import ARRIVAL, age

FORGET_CYCLES: Final = 10_000
"""Age of what has never come."""
_READY: Final = int(State.READY)
_SATURATED, _OFFSET = int(Cause.FORCE_SATURATED), int(Cause.FORCE_OFFSET)
_LONGEST_PAUSE: Final = 4.0
"""Longest usual pause of a force sensor, cycles: 100 Hz leaves out 2 at 4 ms."""
_PAUSE_KEPT: Final = 0.995
"""Share of the longest pause that is kept from reading to reading: what was longer once is forgotten in a second."""
_ROUNDED: Final = 0.2
"""Pause that is none any more."""

SENSES: Final = record(
    pause=float,  # cycles that the force sensor usually leaves out between two readings
    needs_force=int,  # 1: the correction needs it
    has_force=int,
    sources=int,  # bits of Source
    force_age=int,  # cycles since the last good reading, as the next two
    tracker_age=int,
    current_age=int,
    soft=int,  # cause of a hold of this cycle, or 0
    take_fast=int,  # where kernels of other modules lie (:func:`counterflex.core.entry_calls.address_of`)
    wrench=int,
)
"""What a session knows of its sensors from cycle to cycle."""
ARRAYS: Final = addresses(
    *("senses", "gate", "loop", "loop_table", "wrench", "zero", "samples", "w_sensor", "w_part"),
    *("arrival", "T_part_tracker", "T_tracker_target", "T_target_tcp"),
)
NONE, WHOLE, CLEANED = range(3)
"""Of a reading: not to be used; its mean is; the mean of what is left of it without spikes is."""

_take_fast = at_address(take_fast)
_flange_wrench = at_address(flange.sensor_wrench)


@kernel("Loop[::1](Arrays)", Loop=LOOP, Arrays=ARRAYS)
def _loop(table: Record) -> Records:
    out: Records = carray(to_pointer(table.loop.place), (1,), LOOP)
    return out


@kernel("LoopArrays[::1](Arrays)", Arrays=ARRAYS, LoopArrays=LOOP_ARRAYS)
def _loop_table(table: Record) -> Records:
    out: Records = carray(to_pointer(table.loop_table.place), (1,), LOOP_ARRAYS)
    return out


@kernel("Gate[::1](Arrays)", Gate=GATE, Arrays=ARRAYS)
def _gate(table: Record) -> Records:
    out: Records = carray(to_pointer(table.gate.place), (1,), GATE)
    return out


@kernel("Senses[::1](Arrays)", Senses=SENSES, Arrays=ARRAYS)
def _senses(table: Record) -> Records:
    out: Records = carray(to_pointer(table.senses.place), (1,), SENSES)
    return out


@kernel("int64(Senses)", Senses=SENSES)
def overdue(s: Record) -> int:
    """Cycles by which the force reading is older than those of this sensor usually get."""
    return int(max(0, s.force_age - math.ceil(s.pause - _ROUNDED)))


@kernel(
    "int64(Arrays[::1], float64[:, ::1], int64, int64, int64, boolean, boolean)",
    Arrays=ARRAYS,
    entry=True,
)
def take_reading(
    tables: Records, samples: Float, good: int, kept: int, first: int, saturated: bool, frozen: bool
) -> int:
    """Take what the force sensor has shown since the last cycle.

    Args:
        tables: (1,) ARRAYS; the cause of a hold is written into SENSES.
        samples: (m, 6) the good ones in time.
        good: Good ones, of any of the sensors where there are several.
        kept: Those of ``samples``, and of what was not kept.
        first: Sequence number of the first; -1 where they do not come at 1 kHz.
        saturated: One of them was beyond the range.
        frozen: The sensor shows the same numbers again and again.

    Returns:
        NONE, WHOLE or CLEANED.
    """
    table = tables[0]
    s, loops = _senses(table)[0], _loop(table)
    if first >= 0:
        _take_fast(s.take_fast, loops, _loop_table(table), samples, kept, first)
    if saturated or frozen or good == 0:
        s.force_age += 1  # where there is a plan, the step goes on by it for a while, then holds
        if s.soft == 0 and saturated:
            s.soft = _SATURATED
        return NONE
    if loops[0].result.state <= _READY and s.force_age < FORGET_CYCLES:
        s.pause = max(min(float(s.force_age), _LONGEST_PAUSE), _PAUSE_KEPT * s.pause)
    count = min(good, samples.shape[0])
    left_out = clean(samples, count, _gate(table))
    if left_out == count > 0:  # the last one goes on
        s.force_age = 0
        return NONE
    return CLEANED if left_out > 0 else WHOLE


@kernel("void(Arrays[::1], float64[::1], int64, boolean)", Arrays=ARRAYS, entry=True)
def use_wrench(tables: Records, w: Float, refusals: int, ends: bool) -> None:
    """Take the sensor's zero off a process wrench.

    Args:
        tables: (1,) ARRAYS; the wrench of the step is written.
        w: (6,) on what the hand holds about the end of the chain; changed.
        refusals: Zeros refused in a row.
        ends: It is the wrench of the step; else the caller goes on with ``w``.
    """
    table = tables[0]
    s, loops, zero = _senses(table)[0], _loop(table), reals(table.zero)
    s.force_age = 0
    if s.soft == 0 and s.needs_force == 1 and refusals > 0:
        s.soft = _OFFSET
    for k in range(6):
        w[k] -= zero[k]
    if ends:
        given = loops[0].given
        for k in range(6):
            given.wrench[k] = w[k]
        turned_load(loops[0].settings, given.nominal[:], given.wrench[:], 0, BACK)


@kernel("void(Arrays[::1], int64, int64, int64, boolean, boolean, float64, int64)", Arrays=ARRAYS, entry=True)
def read_force(
    tables: Records, good: int, kept: int, first: int, saturated: bool, frozen: bool, time_s: float, refusals: int
) -> None:
    """A flange sensor's reading into the wrench of the step, whose zero is known: all in one call.

    Args:
        tables: As for :func:`take_reading`, and ``good`` to ``frozen``.
        time_s: Since the sensor's zero.
        refusals: As for :func:`use_wrench`.
    """
    table = tables[0]
    kind = take_reading(tables, matrix(table.samples), good, kept, first, saturated, frozen)
    if kind == NONE:
        return
    s, wrench = _senses(table)[0], carray(to_pointer(table.wrench.place), (1,), flange.ARRAYS)
    shown = _gate(table)[0].w[:] if kind == CLEANED else reals(table.w_sensor)
    _flange_wrench(s.wrench, wrench, _loop(table)[0].given.q[:], shown, time_s, math.nan)
    use_wrench(tables, reals(table.w_part), refusals, True)


@kernel("int64(Arrays[::1], boolean, int64, int64, float64)", Arrays=ARRAYS, entry=True)
def read_pose(tables: Records, fresh: bool, counter_ms: int, stamp_ns: int, sigma_m: float) -> int:
    """A tracker's pose into that of the tool.

    Args:
        tables: (1,) ARRAYS; inputs of the step are written.
        fresh: There is a new good one.
        counter_ms: The controller's clock.
        stamp_ns: The tracker's clock, of the pose.
        sigma_m: Standard deviation that the tracker states.

    Returns:
        1 where there is a new one, else 0.
    """
    table = tables[0]
    s, given = _senses(table)[0], _loop(table)[0].given
    s.tracker_age += 1
    if not fresh:
        return 0
    s.tracker_age = 0
    T = matrix(table.T_tracker_target)
    tool_pose(matrix(table.T_part_tracker), T, matrix(table.T_target_tcp), given.actual[:], 0)
    arrivals = carray(to_pointer(table.arrival.place), (1,), ARRIVAL)
    given.tracker_late = age(arrivals, counter_ms * MS, stamp_ns * NS)
    given.tracker_sigma = sigma_m
    return 1
