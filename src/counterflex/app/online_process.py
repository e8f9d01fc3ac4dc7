"""The loop's own process: builds the session, says where it listens, cycles until it is asked to end."""

from __future__ import annotations

import signal
import time
from typing import Any, Final

import numpy as np

from counterflex.app.online_session import RunSettings, open_session
from counterflex.core.arrays import Int
from counterflex.core.errors import CounterflexError
from counterflex.files.cell import read_cell
from counterflex.files.machine_file import machine_file
from counterflex.files.plausible import unusual
from counterflex.links.control_array import Request
from counterflex.links.instance_lock import InstanceLock
from counterflex.links.realtime import prepare
from counterflex.links.session import OnlineSession
from counterflex.runtime.layout import O_STOP
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.supervisor import State

END_S: Final = 5.0
"""How long ramping out may take before the loop ends all the same."""
_SLICE_S: Final = 0.1
"""How long a loop in lockstep waits before it looks whether it is to end."""
_ACTING: Final = (State.ACTIVE, State.HOLD, State.RAMP_OUT)


def loop_process(settings: RunSettings, ring_name: str, control: Any, pipe: Any) -> None:
    """The loop's own process: builds the session, says where it listens, cycles until it is asked to end.

    An interrupt from the keyboard is left to the recorder, which asks the loop to end.

    Args:
        settings: See :class:`RunSettings`.
        ring_name: Of the ring of records.
        control: Shared array of :data:`counterflex.links.session.CONTROL` numbers.
        pipe: Told the address, the loop's hash and what is unusual in the cell file, or what went wrong.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        ring = RecordRing(ring_name)
        shared: Int = np.frombuffer(control, dtype=np.int64)
        session = open_session(settings, ring=ring, control=shared)
        lock = InstanceLock(machine_file().parent, session.link.address[1])
        session.loop.run()
        session.loop.reset()
        prepare()
    except BaseException as fault:
        pipe.send(fault)
        return
    told = [one.said() for one in unusual(read_cell(settings.cell).tables)]
    pipe.send((session.link.address, session.loop.sha256(), told))
    try:
        _cycle_on(session, settings, shared, pipe)
    except CounterflexError as fault:
        pipe.send(fault)
    session.link.close()
    if session.force is not None:
        session.force.close()
    lock.close()
    ring.close()


def _cycle_on(session: OnlineSession, settings: RunSettings, control: Int, pipe: Any) -> None:
    """Cycle until asked to end, or until the telegrams stop. A correction that is there is ramped out first."""
    quiet = 0.0
    end_ns = 0
    told = ""
    while True:
        if session.trouble != told:
            told = session.trouble
            if told:
                pipe.send(told)
        if control[Request.END]:
            end_ns = end_ns or time.monotonic_ns() + round(END_S * 1e9)
            control[Request.STOP] = 1
            outcome = session.loop.outcome  # a robot that is being told to stop is told so to the end
            if not (session.loop.state in _ACTING or outcome[O_STOP]) or time.monotonic_ns() > end_ns:
                return
        if session.cycles == 0:
            session.cycle(0.1)
            continue
        if settings.lockstep:  # a robot that waits is never late: no cycle without a telegram
            came, waited = session.link.wait(_SLICE_S), _SLICE_S
            if came:
                session.deal(True)
        else:
            waited = session.patience_s
            came = session.cycle(waited)
        quiet = 0.0 if came else quiet + waited
        if quiet >= settings.quiet_s or (settings.lockstep and not came and control[Request.END]):
            return
