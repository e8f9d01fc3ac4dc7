"""Cycle of a session between the reading of its telegram and its answer: what is judged before the sensors, and after.

::

    telegram ── watched ── angles ── (sensors: senses_kernel) ── this side: log, processes, job ── flags ── step

A cause that is found first stands, but for those of the force sensor that the estimator does without.
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, reals, to_pointer, wholes
from counterflex.core.entry_calls import at_address
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record
from counterflex.protocols.processes.control_array import Kept, Life, Panel, Request
from counterflex.protocols.session.senses_kernel import SENSES, overdue
from counterflex.protocols.session.snapshot_kernel import THERE, panel_state
from counterflex.protocols.session.telegram_watch import WATCH, received, restart, silent
from counterflex.runtime import record_ring
from counterflex.runtime.cycle import ARRAYS as LOOP_ARRAYS, cycle
from counterflex.runtime.plausibility import axis_check_kernel as axes
from counterflex.runtime.primitives.causes import can_yield
from counterflex.runtime.state.loop_record import LOOP
from counterflex.runtime.state.states import Cause, State
from counterflex.runtime.step.place import FAULT_LOST

_LOG_LATE_ROWS: Final = 125
"""Records that may wait before the loop is armed: half a second."""
_LOG_ROWS: Final = record_ring.MOST
_READY, _ARMED = int(State.READY), int(State.ARMED)
_RESTARTED, _CLAMPED = int(Cause.SESSION_RESTARTED), int(Cause.CLAMPED_BY_ROBOT)
_INTERNAL, _LOG_LOST, _WRONG_JOB = int(Cause.INTERNAL), int(Cause.LOG_LOST), int(Cause.WRONG_JOB)
_RUN_LOST, _PANEL_LOST, _NOT_CLOSED = int(Cause.RUN_LOST), int(Cause.PANEL_LOST), int(Cause.NOT_CLOSED)
_TRACKER_LOST, _FORCE_STALE = int(Cause.TRACKER_LOST), int(Cause.FORCE_STALE)
_SCATTERED, _STOPPED = int(Cause.TELEGRAMS_SCATTERED), int(Cause.TELEGRAMS_STOPPED)
_ARM, _STOP, _RESET = int(Request.ARM), int(Request.STOP), int(Request.RESET)
_TAKEN, _TROUBLE = int(Kept.TAKEN), int(Kept.TROUBLE)
_RUN, _GONE, _PANEL = int(Life.RUN_NS), int(Life.GONE), int(Panel.NS)

SESSION: Final = record(
    settle=int,  # good telegrams in a row before it may be armed
    tracker_stale=int,  # cycles
    needs_tracker=int,  # 1: the correction needs it
    job=int,  # that the program must say it is of; -1: not tested
    run_silent_ns=int,  # so long the process that started the loop may be silent; -1: not tested
    hold_without_log=int,
    hold_without_panel=int,
    shared=int,  # 1: other processes share the control array
    angles=int,  # 1: axis angles are held against the poses
    silent_cycles=int,  # cycles without a telegram, up to now
    cycles=int,  # telegrams answered or passed over in silence
    hard=int,  # cause of a fault of this cycle, or 0
    run=int,  # where kernels of other modules lie (:func:`counterflex.core.entry_calls.address_of`)
    agree=int,
)
"""What a session is set to and knows, beside its senses."""
ARRAYS: Final = addresses("session", "senses", "watch", "loop", "loop_table", "axes", "stand", "control")

_run = at_address(cycle)
_agree = at_address(axes.angles_agree)


@kernel("Session[::1](Arrays)", Session=SESSION, Arrays=ARRAYS)
def _session(table: Record) -> Records:
    out: Records = carray(to_pointer(table.session.place), (1,), SESSION)
    return out


@kernel("Senses[::1](Arrays)", Senses=SENSES, Arrays=ARRAYS)
def _senses(table: Record) -> Records:
    out: Records = carray(to_pointer(table.senses.place), (1,), SENSES)
    return out


@kernel("Watch[::1](Arrays)", Watch=WATCH, Arrays=ARRAYS)
def _watch(table: Record) -> Records:
    out: Records = carray(to_pointer(table.watch.place), (1,), WATCH)
    return out


@kernel("Loop[::1](Arrays)", Loop=LOOP, Arrays=ARRAYS)
def _loop(table: Record) -> Records:
    out: Records = carray(to_pointer(table.loop.place), (1,), LOOP)
    return out


@kernel("void(Arrays[::1], int64)", Arrays=ARRAYS, entry=True)
def judge_silence(tables: Records, malformed: int) -> None:
    """Judge a cycle in which no telegram came; causes of a hold and of a fault are written.

    Args:
        tables: (1,) ARRAYS.
        malformed: Unreadable telegrams in a row.
    """
    table = tables[0]
    session, senses = _session(table)[0], _senses(table)[0]
    session.silent_cycles += 1
    senses.soft, session.hard = silent(_watch(table), malformed)


@kernel("void(Arrays, int64, int64)", Arrays=ARRAYS)
def _judge_angles(table: Record, commanded_is: int, measured_is: int) -> None:
    """Hold the angles of a telegram against its poses; those that do not agree are replaced."""
    session, loop = _session(table)[0], _loop(table)[0]
    given = loop.given
    measured = given.nominal[:] if measured_is == axes.ABSENT else reals(table.stand)
    checks = carray(to_pointer(table.axes.place), (1,), axes.ARRAYS)
    cause = _agree(
        session.agree, checks, given.q[:], loop.result.correction[:], given.nominal[:], measured,
        commanded_is, measured_is, int(loop.result.state <= _READY),
    )  # fmt: skip
    if cause != 0:
        _senses(table)[0].soft = cause


@kernel(
    "void(Arrays[::1], boolean, int64, float64, int64, int64, int64, boolean, int64, int64)",
    Arrays=ARRAYS,
    entry=True,
)
def judge(
    tables: Records,
    another: bool,
    elapsed: int,
    offset_ns: float,
    late: int,
    malformed: int,
    repeated: int,
    answered: bool,
    commanded_is: int,
    measured_is: int,
) -> None:
    """Judge this cycle's telegram and those before it, and its angles before a sensor is read by them.

    Causes of a hold and of a fault are written.

    Args:
        tables: (1,) ARRAYS.
        another: It is of another session than the one before.
        elapsed: Cycles since the telegram before.
        offset_ns: This computer's clock when it came, less the controller's.
        late: The controller's count of late answers.
        malformed: Unreadable telegrams in a row.
        repeated: Telegrams since the one before that could not be read and were answered all the same.
        answered: The one before was answered.
        commanded_is: How the commanded pose belongs to the angles.
        measured_is: Likewise the measured one.
    """
    table = tables[0]
    session, senses, watches = _session(table)[0], _senses(table)[0], _watch(table)
    session.silent_cycles = session.hard = 0
    if another:
        restart(watches[0])
        session.hard = _RESTARTED
    senses.soft, hard = received(watches, elapsed, offset_ns, late, malformed, answered, repeated)
    if session.hard == 0:
        session.hard = hard
    if session.angles == 1:
        _judge_angles(table, commanded_is, measured_is)


@kernel("int64(Arrays, int64, int64, boolean, boolean)", Arrays=ARRAYS)
def _watch_this_side(table: Record, now_ns: int, written: int, armed: bool, not_closed: bool) -> int:
    """Cause of a hold after that of telegrams and sensors: log, panel, processes."""
    session, soft, control = _session(table)[0], _senses(table)[0].soft, wholes(table.control)
    settings, state = _loop(table)[0].settings, _loop(table)[0].result.state
    if session.shared == 1:
        waiting = written - control[_TAKEN]
        looked_at = written >= 0 and (session.hold_without_log == 1 or not armed)
        lost = control[_TROUBLE] != 0 or waiting > (_LOG_ROWS if armed else _LOG_LATE_ROWS)
        if looked_at and lost and (soft == 0 or can_yield(settings, soft)):
            soft = _LOG_LOST
        if session.hold_without_panel == 1 and (soft == 0 or can_yield(settings, soft)):
            soft = _PANEL_LOST if panel_state(control[_PANEL], now_ns) != THERE else soft
    if not_closed and (armed or (state <= _READY and control[_RESET] == 0)):
        soft = _NOT_CLOSED  # before what else keeps it from being armed: the robot may be in the cut
    if session.shared == 1:
        last_ns, longest = control[_RUN], session.run_silent_ns
        if control[_GONE] != 0 or (longest >= 0 and last_ns != 0 and now_ns - last_ns > longest):
            soft = _RUN_LOST  # before all else: nobody may be there to see what else is wrong
    return int(soft)


@kernel("int64(Arrays)", Arrays=ARRAYS)
def _lacking(table: Record) -> int:
    """Cause against arming: a sensor that is needed is silent, or the telegrams do not come steadily; or 0."""
    session, senses, settings = _session(table)[0], _senses(table)[0], _loop(table)[0].settings
    if session.needs_tracker == 1 and senses.tracker_age >= session.tracker_stale:
        return _TRACKER_LOST
    if senses.needs_force == 1 and overdue(senses) >= settings.stale:
        return _FORCE_STALE
    settle = session.settle
    if session.silent_cycles > 0:  # none comes: nothing is scattered
        return _STOPPED if session.silent_cycles >= FAULT_LOST else 0
    return _SCATTERED if _watch(table)[0].good < settle < session.cycles - 2 * settle else 0


@kernel("void(Arrays, boolean)", Arrays=ARRAYS)
def _fill_flags(table: Record, zero_known: bool) -> None:
    """Write what is known of the sensors into the inputs of the step."""
    session, senses, given = _session(table)[0], _senses(table)[0], _loop(table)[0].given
    late = overdue(senses)
    given.force_age = late if senses.needs_force == 1 or senses.has_force == 0 else 0
    given.tracker_age, given.current_age, given.sources = senses.tracker_age, senses.current_age, senses.sources
    force = senses.needs_force == 0 or (zero_known and late == 0)
    tracker = session.needs_tracker == 0 or senses.tracker_age < session.tracker_stale
    given.healthy = int(_watch(table)[0].good >= session.settle and force and tracker)


@kernel(
    "boolean(Arrays[::1], int64, int64, int64, int64, int64, boolean, boolean, boolean, boolean, boolean)",
    Arrays=ARRAYS,
    entry=True,
)
def decide(
    tables: Records,
    now_ns: int,
    written: int,
    elapsed: int,
    enable: int,
    job: int,
    clamped: bool,
    failed: bool,
    not_closed: bool,
    zero_known: bool,
    arm: bool,
) -> bool:
    """Take what was found in this cycle together, and do the step.

    Args:
        tables: (1,) ARRAYS.
        now_ns: When the telegram came, monotonic.
        written: Records handed to the recorder; -1: there is none.
        elapsed: Cycles since the telegram before; 0: none came.
        enable: 1: the robot program wants the correction; -1: as it was.
        job: Number that the program says; 0: none.
        clamped: The controller limits the correction.
        failed: The loop's own program failed.
        not_closed: The loop before this one did not end by itself.
        zero_known: The force sensor has a zero.
        arm: Arm again, behind a change of tools.

    Returns:
        Whether a person has asked to reset.
    """
    table = tables[0]
    session, senses, loops, control = _session(table)[0], _senses(table)[0], _loop(table), wholes(table.control)
    given, settings, result = loops[0].given, loops[0].settings, loops[0].result
    armed, resetting = result.state > _ARMED, control[_RESET] != 0
    yields = senses.soft == 0 or can_yield(settings, senses.soft)
    if clamped and yields:
        senses.soft = _CLAMPED
        yields = can_yield(settings, _CLAMPED)
    if failed and session.hard == 0 and not resetting:
        session.hard = _INTERNAL
    if session.job >= 0 and job != 0 and job != session.job:
        if armed:
            session.hard = _WRONG_JOB if session.hard == 0 else session.hard
        elif yields:
            senses.soft = _WRONG_JOB
    soft = _watch_this_side(table, now_ns, written, armed, not_closed)
    if soft == 0 and result.state <= _READY:
        soft = _lacking(table)
    _fill_flags(table, zero_known)
    given.elapsed = elapsed
    given.arm, given.stop, given.reset = int(control[_ARM] != 0 or arm), control[_STOP], int(resetting)
    if enable >= 0:
        given.enable = enable
    given.soft, given.hard = soft, session.hard
    _run(session.run, loops, carray(to_pointer(table.loop_table.place), (1,), LOOP_ARRAYS))
    if result.state >= _ARMED:  # served, or overtaken by what happened: it must not arm later by itself
        control[_ARM] = 0
    control[_RESET] = 0
    return bool(resetting)
