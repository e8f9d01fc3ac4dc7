"""One cycle of a session in one call: wait, telegram, sensors, step, answer; what is not usual is left to Python.

::

    wait ── one datagram of the robot, the next one of its session ── judge ── sensors ── step ── answer ── sent
      └── else: the number of datagrams, untouched, for :meth:`.session.OnlineSession.handle_cycle`

The rules stand in the kernels that both ways call.
"""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import (
    addresses,
    byte_matrix,
    matrix,
    reals,
    to_pointer,
    to_whole,
    whole_matrix,
    wholes,
)
from counterflex.core.arrays import Int
from counterflex.core.entry_calls import at_address
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record
from counterflex.core.units import MM
from counterflex.protocols.processes.last_answer import NUMBER_AT, SLOTS, fill_answer
from counterflex.protocols.robot.compiled_link import DRAINED, TELEGRAM, answer_telegram, drain_force, read_telegram
from counterflex.protocols.session import cycle_kernel as cycles, senses_kernel as senses
from counterflex.protocols.system.system_calls import WINDOW, await_datagrams, now_ns, sleep_until_near
from counterflex.protocols.tracker import kernel as tracker
from counterflex.protocols.tracker.drain_kernel import ARRAYS as TRACKER_ARRAYS, drain_poses
from counterflex.runtime.cycle import ARRAYS as LOOP_ARRAYS
from counterflex.runtime.monitoring.records import MEMORY
from counterflex.runtime.state.loop_record import LOOP

_REHEARSAL_NS: Final = 150_000
"""So long before the polling the cycle is rehearsed: it takes 60 to 150 us where caches are cold."""
ANSWERED: Final = -1
"""Returned for a cycle that is done."""
WHOLE: Final = record(
    # Where code and its arrays lie, and sockets; -1: there is no such socket.
    read=int,
    read_table=int,
    answer=int,
    answer_table=int,
    drain=int,
    drain_table=int,
    fill_kept=int,
    fd=int,
    force_fd=int,
    tracker_fd=int,
    reports=int,  # 1: the controller reports its pose
    axes=int,  # 1: axis corrections are sent
    commanded_is=int,  # how the pose belongs to the angles
    measured_is=int,
    keeps=int,  # 1: each answer is kept for the next loop
    # Of this cycle, before it.
    taken=int,  # 1: a rehearsal: nothing is received
    timeout_ns=int,
    sender=int,  # who is answered
    written=int,  # records handed to the recorder; -1: there is none
    repeated=int,  # telegrams that could not be read and were answered all the same, since the last one
    answered=int,  # 1: the last one was answered
    not_closed=int,  # 1: the loop before this one did not end by itself
    zero_known=int,  # 1: the force sensor has a zero
    refusals=int,  # zeros refused in a row
    zero_ns=int,  # when the sensor's zero was set
    # After it.
    received_ns=int,  # when the telegram came, monotonic
    sent_ns=int,  # when the answer was out
    reset=int,  # 1: a person has asked to reset
    sent=int,  # bytes of the answer
)
"""Numbers of the call, beside what the tables of telegrams and sensors hold."""
ARRAYS: Final = addresses(
    *("whole", "cycle", "senses", "telegram", "drained", "tracker", "kept", "kept_number"),
    *("heads", "names", "lengths", "senders", "inbox", "window", "blocks", "undone"),
)
"""``cycle``, ``senses``, ``tracker``: tables of :mod:`.cycle_kernel`, :mod:`.senses_kernel` and of the tracker's drain;
``kept``, ``kept_number``: last answer for the next loop; then those of :func:`.await_datagrams`. ``blocks``: (n, 2)
addresses and numbers of 64 bits of what a cycle changes; ``undone``: room for all of it."""

_fill = at_address(fill_answer)


@kernel("Window[::1](Arrays)", Window=WINDOW, Arrays=ARRAYS)
def _window(table: Record) -> Records:
    out: Records = carray(to_pointer(table.window.place), (1,), WINDOW)
    return out


@kernel("void(Arrays, Whole)", Arrays=ARRAYS, Whole=WHOLE)
def _read_senses(table: Record, w: Record) -> None:
    """Drain force sensor and tracker into the inputs of the step."""
    own = carray(to_pointer(table.senses.place), (1,), senses.ARRAYS)
    s = carray(to_pointer(own[0].senses.place), (1,), senses.SENSES)[0]
    given = carray(to_pointer(own[0].loop.place), (1,), LOOP)[0].given
    counter = carray(to_pointer(table.telegram.place), (1,), TELEGRAM)[0].counter
    given.tracker_new = 0
    if w.drain != 0:
        drained = carray(to_pointer(table.drained.place), (1,), DRAINED)
        drain_force(w.drain, w.drain_table, w.force_fd, w.taken != 0, drained)
        d = drained[0]
        age_s = (now_ns(_window(table)) - w.zero_ns) * 1e-9
        senses.read_force(own, d.good, d.good, d.first, d.saturated != 0, d.frozen != 0, age_s, w.refusals)
    fresh, stamp_ns, sigma_m = False, 0, 0.0
    if w.tracker_fd >= 0:
        poses = carray(to_pointer(table.tracker.place), (1,), TRACKER_ARRAYS)
        fresh = drain_poses(w.tracker_fd, w.taken != 0, poses)
        if fresh:
            r = carray(to_pointer(poses[0].received.place), (1,), tracker.RECEIVED)[0]
            stamp_ns, sigma_m = r.pose_ns, r.values[7] * MM
    given.tracker_new = senses.read_pose(own, fresh, counter, stamp_ns, sigma_m)
    s.current_age += 1


@kernel("void(Arrays, Whole, int64)", Arrays=ARRAYS, Whole=WHOLE)
def _reply(table: Record, w: Record, counter: int) -> None:
    """Answer the telegram, unless the loop is silent on purpose."""
    own = carray(to_pointer(table.cycle.place), (1,), cycles.ARRAYS)[0]
    loop = carray(to_pointer(own.loop.place), (1,), LOOP)[0]
    loops = carray(to_pointer(own.loop_table.place), (1,), LOOP_ARRAYS)[0]
    result = loop.result
    w.sent = 0
    if result.silent != 0:
        return
    if w.keeps == 1:
        kept, numbers = matrix(table.kept), wholes(table.kept_number)
        numbers[0] += 1
        row = numbers[0] % SLOTS
        kept[row, NUMBER_AT] = 0.0
        _fill(w.fill_kept, kept, numbers[0], counter, now_ns(_window(table)), result.correction[:], result.axes[:])
        kept[row, NUMBER_AT] = numbers[0]
    speed = carray(to_pointer(loops.monitor_memory.place), (1,), MEMORY)[0].results.speed
    correction = result.axes[:] if w.axes == 1 else result.correction[:]
    w.sent = answer_telegram(
        w.answer, w.answer_table, w.fd, counter, correction, w.axes == 1, result.stop != 0, result.feed_hold != 0,
        speed, result.state,
    )  # fmt: skip


@kernel("boolean(Arrays, Whole, int64)", Arrays=ARRAYS, Whole=WHOLE)
def _cycle(table: Record, w: Record, received_ns: int) -> bool:
    """Make the cycle of the datagram in the first row; False: it is not usual, and nothing was done."""
    tables = carray(to_pointer(table.cycle.place), (1,), cycles.ARRAYS)
    telegrams = carray(to_pointer(table.telegram.place), (1,), TELEGRAM)
    given = carray(to_pointer(tables[0].loop.place), (1,), LOOP)[0].given
    data, length = byte_matrix(table.inbox), wholes(table.lengths)[0]
    nominal, q, reported, stand = given.nominal[:], given.q[:], given.reported[:], reals(tables[0].stand)
    if not read_telegram(w.read, w.read_table, data, length, telegrams, nominal, q, reported, stand):
        return False
    t = telegrams[0]
    given.is_reported = w.reports
    offset_ns = received_ns - t.counter * 1_000_000
    cycles.judge(
        tables, False, t.elapsed, offset_ns, t.late, 0, w.repeated, w.answered != 0, w.commanded_is, w.measured_is
    )
    _read_senses(table, w)
    w.reset = cycles.decide(
        tables, received_ns, w.written, t.elapsed, t.enable, t.job, t.clamped != 0, False, w.not_closed != 0,
        w.zero_known != 0, False,
    )  # fmt: skip
    _reply(table, w, t.counter)
    return True


@kernel("void(int64[:, ::1], int64[::1], boolean)")
def _keep(blocks: Int, kept: Int, back: bool) -> None:
    """Copy memory into ``kept``, or back."""
    at = 0
    for k in range(blocks.shape[0]):
        block = carray(to_whole(blocks[k, 0]), (blocks[k, 1],))
        here = kept[at : at + blocks[k, 1]]
        if back:
            block[:] = here
        else:
            here[:] = block
        at += blocks[k, 1]


@kernel("void(Arrays[::1], Arrays[::1])", Arrays=ARRAYS, entry=True)
def rehearse(tables: Records, rehearsals: Records) -> None:
    """Make the last cycle once more and undo it: then code and data of the next one are in the cache.

    Nothing is received or sent, and no other process sees anything of it: what they share is replaced by a copy.

    Args:
        tables: As for :func:`await_and_answer`; of these, ``blocks`` states all memory that a cycle changes.
        rehearsals: (1,) the same, but for what is shared.
    """
    blocks, kept = whole_matrix(tables[0].blocks), wholes(tables[0].undone)
    table = rehearsals[0]
    w = carray(to_pointer(table.whole.place), (1,), WHOLE)[0]
    telegram = carray(to_pointer(table.telegram.place), (1,), TELEGRAM)[0]
    _keep(blocks, kept, False)
    telegram.newest -= telegram.cycle_ms
    _cycle(table, w, w.received_ns)
    _keep(blocks, kept, True)


@kernel("int64(Arrays[::1], Arrays[::1])", Arrays=ARRAYS, waits=True, entry=True)
def await_and_answer(tables: Records, rehearsals: Records) -> int:
    """Wait for a telegram and answer it.

    Where the wait polls, the cycle is rehearsed shortly before the telegram is due.

    Args:
        tables: (1,) ARRAYS; WHOLE says what is known before the cycle.
        rehearsals: (1,) as for :func:`rehearse`.

    Returns:
        ANSWERED; else the number of datagrams that were taken, none of which was looked at, 0 where none came in time
        or a signal ended the wait.
    """
    table = tables[0]
    w, senders = carray(to_pointer(table.whole.place), (1,), WHOLE)[0], wholes(table.senders)
    if sleep_until_near(w.fd, w.timeout_ns, _REHEARSAL_NS, _window(table)):
        rehearse(tables, rehearsals)
    count = await_datagrams(
        w.fd, whole_matrix(table.heads), byte_matrix(table.names), wholes(table.lengths), senders, w.timeout_ns,
        _window(table),
    )  # fmt: skip
    w.received_ns = now_ns(_window(table))
    if count != 1 or senders[0] != w.sender or not _cycle(table, w, w.received_ns):
        return count
    w.sent_ns = now_ns(_window(table))
    return ANSWERED
