"""The loop's own process: builds the session, says where it listens, cycles until it is asked to end or is alone."""

from __future__ import annotations

import contextlib
import functools
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.run.child import outlive_starter
from counterflex.app.run.session import RunSettings, open_session
from counterflex.core.arrays import Int
from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.units import NS
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.plausibility import unusual
from counterflex.files.machine_file import machine_file
from counterflex.files.summary_file import not_compared
from counterflex.protocols.processes.control_array import CONTROL, Course, Life, Request
from counterflex.protocols.processes.instance_lock import InstanceLock
from counterflex.protocols.processes.living import Beat, Living
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.processes.snapshot import snapshot_path
from counterflex.protocols.session.session import OnlineSession
from counterflex.protocols.system.realtime import prepare
from counterflex.protocols.system.signals import SIGNALS, hear_signals
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.state.supervisor import State


def about_run(settings: RunSettings, session: OnlineSession, out: Path) -> dict[str, Any]:
    """Describe a run.

    Args:
        out: Folder of its log.

    Returns:
        Plain values, SI: ``files`` by name (absolute), ``folder``, ``period_s``, ``limits`` of the correction,
        ``listens`` (address of telegrams), ``sources`` it measures with, ``planned``, ``compensated``, ``arm``, and the
        difference of wall clock and monotonic clock in ns.
    """
    loop = session.loop.settings
    files = {"cell": settings.cell, "plan": settings.plan, "program": settings.program, **settings.robot_files}
    radius, turn = loop.translation.radius, loop.rotation.radius
    return {
        "counterflex": __version__,
        "folder": str(out),
        "files": {name: str(Path(path).absolute()) for name, path in files.items() if path is not None},
        "period_s": loop.period_s,
        "limits": {
            "correction_m": radius,
            "correction_rad": turn,
            "hard_factor": loop.hard_factor,
            "ramp_m_s": loop.ramp_m_s,
            "speed_m_s": loop.translation.speed,
        },
        "listens": list(session.link.address),
        "protocol": (settings.robot or ("",))[0].upper(),
        "holds_feed": bool(session.link.holds_feed),
        "sources": {"force": session.force is not None, "tracker": session.tracker is not None},
        "force_mode": loop.force.name.lower(),
        "planned": session.loop.planned,
        "compensated": loop.compensated,
        "arm": settings.arm,
        "lockstep": settings.lockstep,
        "wall_minus_monotonic_ns": time.time_ns() - time.monotonic_ns(),
    }


END_S: Final = 5.0
"""How long ramping out may take before the loop ends all the same."""
_SLICE_S: Final = 0.05  # How long a loop in lockstep waits before it looks whether it is to end, or whether it is alone
_SILENT_S: Final = 0.1  # A robot that is told to stop and sends nothing any more has stopped
_ACTING: Final = (State.ACTIVE, State.HOLD, State.RAMP_OUT)
_GONE, _LOOP_NS, _END = int(Life.GONE), int(Life.LOOP_NS), int(Request.END)


def loop_process(settings: RunSettings, ring_name: str, words: Path, out: Path, pipe: Any) -> None:
    """The loop's own process: builds the session, says where it listens, cycles until it is asked to end.

    An interrupt from the keyboard is left to the process that started it, which asks the loop to end; a request to
    terminate, and a terminal that is closed, end it as an operator does: the correction is ramped out first. When one
    of the other processes of the run has died, the feed is held, the correction is ramped out where the robot stands,
    the robot is told to stop, and the loop ends.

    Args:
        settings: See :class:`RunSettings`.
        ring_name: Of the ring of records.
        words: Where the shared numbers of :data:`counterflex.protocols.processes.control_array.CONTROL` are.
        out: Folder of the log: its name stands in the lock file, so that an operator finds the run by it.
        pipe: Told the address, the loop's hash and the layout of its memory, what is unusual in the cell file, what
            monitoring cannot see in this program, and the log of the loop before that did not end by itself; or what
            went wrong.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        shared = SharedWords(CONTROL, words)
        control: Int = np.frombuffer(shared.words, dtype=np.int64)
        _end_on_request(control)
        hear_signals()
        starts = Beat(control, Life.LOOP_NS, Life.LOOP_PID)  # what it compiles may take minutes
        ring = RecordRing(ring_name)
        session = open_session(settings, ring=ring, control=control)
        port, given = session.link.address[1], settings.port != 0
        lock = InstanceLock(machine_file().parent, port, given=given, run=str(out), words=str(words))
        session.follow(lock.last, not_closed=bool(lock.not_closed))
        session.loop.run()
        session.loop.reset()
        warnings = [one.sentence() for one in unusual(read_cell(settings.cell).tables)]
        alone = None if settings.plan is None else not_compared(Path(settings.plan).parent)
        warnings += [] if alone is None else [alone]
        hidden = [] if session.force is None else [one.sentence for one in session.loop.monitor.hidden_teeth()]
        starts.close()
        shows = snapshot_path(words)
        publisher = session.publish(shows, about_run(settings, session, out)) if shows.exists() else None
        prepare()
    except BaseException as fault:
        _say(pipe, fault)
        return
    outlive_starter()
    living, run = Living(control, Life.RUN_PID, Life.RECORDER_PID), Living(control, Life.RUN_PID)
    control[Life.CANNOT_HOLD] = not session.link.holds_feed
    control[_LOOP_NS] = time.monotonic_ns()
    _say(pipe, (session.link.address, session.loop.sha256(), session.loop.layout, warnings, hidden, lock.not_closed))
    ended = False
    try:
        ended = cycle_on(session, settings, control, living, pipe)
        control[Life.ENDED] = 1
        if publisher is not None:
            publisher.end()
    except CounterflexError as fault:
        ended = _at_rest(session)  # a controller that was refused before anything was corrected leaves nothing behind
        _say(pipe, fault)
    session.link.close()
    if session.force is not None:
        session.force.close()
    lock.close(ended=ended, acknowledged=not session.not_closed)
    living.close()
    ring.close()
    if run.gone():
        shared.remove()  # who made it is not there any more
        shows.unlink(missing_ok=True)
    run.close()


def _end_on_request(control: Int) -> None:
    """Requests of the system to end are the operator's: ramped out first. A loop is not stopped by a key either."""
    end = functools.partial(_request_end, control)
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), end)
    if hasattr(signal, "SIGTSTP"):
        signal.signal(signal.SIGTSTP, signal.SIG_IGN)


def _request_end(control: Int, *_: object) -> None:
    control[_END] = 1


def _say(pipe: Any, what: object) -> None:
    """Tell the process that started this one, if it is still there."""
    with contextlib.suppress(OSError):
        pipe.send(what)


def cycle_on(
    session: OnlineSession,
    settings: RunSettings,
    control: Int,
    living: Living,
    pipe: Any,
    clock_ns: Callable[[], int] = time.monotonic_ns,
) -> bool:
    """Cycle until asked to end, until the telegrams stop, or until the loop is alone.

    A correction that is there is ramped out first.

    Args:
        session: The loop and its links.
        control: Shared, see :mod:`counterflex.protocols.processes.control_array`.
        living: The other processes of the run.
        pipe: Told what fails in the loop's own program.
        clock_ns: Monotonic.

    Returns:
        False where a correction is still in effect at a robot that goes on.
    """
    quiet = 0.0
    counters = session.link.counters
    malformed = counters.malformed
    end_ns = 0
    reported = ""
    while True:
        control[_LOOP_NS] = clock_ns()
        if session.trouble != reported:
            reported = _report(session, pipe)
        if _alone(control, living) and _ramped_out(session, quiet):
            return True
        if control[_END]:
            end_ns = end_ns or clock_ns() + round(END_S * 1e9)
            control[Request.STOP] = 1
            if _at_rest(session) or clock_ns() > end_ns:
                return _at_rest(session)
        if session.cycles == 0:
            session.cycle(_SLICE_S)
            continue
        if session.another_port:
            control[Course.ANOTHER_PORT] = session.another_port
            return True
        if settings.lockstep:
            received, waited = _in_lockstep(session, malformed), _SLICE_S
            malformed = counters.malformed
        else:
            waited = session.patience_s
            received = session.cycle(waited)
        quiet = 0.0 if received else quiet + waited
        if _is_over(settings, control, quiet, received=received):
            return True


def _is_over(settings: RunSettings, control: Int, quiet_s: float, *, received: bool) -> bool:
    """Return whether no telegrams come any more; in lockstep that the loop is to end is enough."""
    return quiet_s >= settings.quiet_s or bool(settings.lockstep and not received and control[_END])


def _in_lockstep(session: OnlineSession, malformed: int) -> bool:
    """Make the cycle of a telegram: a robot that waits is never late, so there is none without one."""
    received = session.link.wait(_SLICE_S)
    if received or session.link.counters.malformed != malformed:
        session.handle_cycle(received)
    return received


def _report(session: OnlineSession, pipe: Any) -> str:
    """Tell what fails in the loop's own program, if anything does."""
    if session.trouble:
        _say(pipe, session.trouble)
    return session.trouble


def _alone(control: Int, living: Living) -> bool:
    """Return whether one of the other processes of the run has died; it stays so."""
    if not (control[_GONE] or living.gone()):
        return False
    control[_GONE] = 1
    return True


def _ramped_out(session: OnlineSession, quiet_s: float) -> bool:
    """Return whether a loop that is alone has nothing more to do for a robot that was silent so long."""
    return _at_rest(session) or quiet_s >= (END_S if session.loop.state in _ACTING else _SILENT_S)


def _at_rest(session: OnlineSession) -> bool:
    """Nothing is corrected, and the robot is not being told to stop any more: it is told so to the end."""
    return not (session.loop.state in _ACTING or session.loop.result.stop)


SILENT_S: Final = 60.0
"""A process that has not said for so long that it lives does not come up; importing all it needs takes 2 to 10 s."""
READY_S: Final = 600.0
"""Longest time of one that lives: the first start compiles, for a minute or two."""
_POLL_S: Final = 0.1
_HINT: Final = (
    "Nothing was sent to the robot. Look whether the machine stands still (a full memory, a disk or network drive that"
    " does not answer, a stopped process), then start again; counterflex doctor compiles without a robot"
)


@contextlib.contextmanager
def signals_wait() -> Iterator[None]:
    """Within, a signal that asks to end waits, and processes that are started are started with it blocked.

    So a process is never interrupted half started, where it could only show a traceback. It hears what waits when it
    calls :func:`counterflex.protocols.system.signals.hear_signals`; this one hears it at the end of the block.
    """
    pending: list[int] = []
    later: Callable[[int, FrameType | None], None] = lambda number, _: pending.append(number)  # noqa: E731
    main = threading.current_thread() is threading.main_thread()
    handled = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)] if main else []
    before = {number: signal.signal(number, later) for number in handled}
    masked = hasattr(signal, "pthread_sigmask")
    if masked:
        resource_tracker.ensure_running()  # its start would let the signals through again
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        if masked:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in pending[:1]:
            signal.raise_signal(number)


def first_word(
    process: BaseProcess,
    pipe: Any,
    who: str,
    lived_ns: Callable[[], int],
    waiting: Callable[[float], None] = lambda _: None,
) -> Any:
    """Wait for what a process says when it is ready.

    Args:
        process: Started.
        pipe: On which it says it.
        who: What it is called in a message.
        lived_ns: When it last said that it lives, monotonic; 0: never.
        waiting: Told again and again for how many seconds it has been waited for.

    Returns:
        What it said.

    Raises:
        CounterflexError: What it could not do, if it says so.
        OutputError: It died, has not said that it lives for :data:`SILENT_S`, or is not ready after :data:`READY_S`.
    """
    begin_ns = time.monotonic_ns()
    try:
        while not pipe.poll(_POLL_S):
            now_ns = time.monotonic_ns()
            silent_s, waited_s = ((now_ns - then) * NS for then in (max(lived_ns(), begin_ns), begin_ns))
            waiting(waited_s)
            if silent_s > SILENT_S:
                raise OutputError(f"{who} does not come up", value=f"silent for {silent_s:.0f} s", hint=_HINT)
            if waited_s > READY_S:
                raise OutputError(f"{who} does not get ready", value=f"waited for {waited_s:.0f} s", hint=_HINT)
        message = pipe.recv()
    except (EOFError, ConnectionError):
        process.join(END_S)
        raise OutputError(f"{who} died before it began", value=process.exitcode) from None
    if isinstance(message, BaseException):
        raise message
    return message
