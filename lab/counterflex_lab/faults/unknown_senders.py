"""Others on the line: a second loop, another program that answers, datagrams from elsewhere: R30 and R31."""

from __future__ import annotations

import socket
import time
from typing import Final

import numpy as np

from counterflex.core.errors import OutputError
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.network.impairment import Impairment
from counterflex_lab.devices import RsiLink, answer_writer
from counterflex_lab.faults.aftermath import Aftermath, described, settled
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.rig import rigged
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario


def _second(effort: Effort) -> Outcome:
    """A second loop on the port of the first."""
    with rigged(effort) as rig:
        rig.activate()
        message = ""
        for host in ("127.0.0.1", "0.0.0.0"):
            try:
                RsiLink(rig.config, host=host, port=rig.link.address[1]).close()
            except OutputError as fault:
                message = str(fault).split(": ", 1)[-1].split(".")[0]
            else:
                return Outcome(False, f"a second loop could listen at {host}")
        after = Aftermath(rig)
        rig.run(200)
    return Outcome(rig.state == State.ACTIVE, f"refused ({message}); the first one goes on", after.step_m)


def _other_answers(effort: Effort) -> Outcome:
    """Another program answers the robot where the loop does not; its answers are good ones that ask for zero."""
    with rigged(effort, Impairment(loss=0.02)) as rig:
        writer = answer_writer(rig.config)
        after = settled(rig, 50)
        writer.values[:] = 0.0
        rig.other = writer.telegram
        lost = rig.link.counters.lost
        while rig.state != State.FAULT and rig.cycle_count < after.begin + 3_000:
            rig.cycle()
    unexplained, path = rig.link.counters.lost - lost, rig.seen.path(after.begin - 50)
    return Outcome(
        rig.loop.cause == Cause.FOREIGN_PEER,
        f"fault after {unexplained} cycles that the loop did not answer and the controller did not count; "
        f"{described(path)}",
        None,
        (rig.cycle_count - after.begin) * PERIOD_S,
    )


def _strangers(effort: Effort) -> Outcome:
    """Good telegrams and rubbish from another address, 40 in every cycle: 10 000 a second."""
    cycles = effort.pick(1_000, 200)
    paths, foreign = [], 0
    taken_s = 0.0
    for disturbed in (False, True):
        with rigged(effort) as rig, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.bind(("127.0.0.1", 0))
            after = Aftermath(rig.activate())
            forged = rig.next_telegram().replace(b"<IPOC>4", b"<IPOC>3")
            for _ in range(cycles):
                for k in range(40 * disturbed):
                    rig.to_loop(forged if k % 2 else b"rubbish", stranger)
                rig.cycle()
            paths.append(np.array(rig.seen.correction_m))
            foreign = rig.link.counters.foreign
            answered = int(np.sum(np.array(rig.seen.age[after.begin :]) == 0))
            if disturbed:
                for k in range(200):
                    rig.to_loop(forged if k % 2 else b"rubbish", stranger)
                start = time.perf_counter()
                rig.link.wait(0.0)
                taken_s = (time.perf_counter() - start) / 200
    same = bool(np.array_equal(paths[0], paths[1]))
    return Outcome(
        same and foreign == 40 * cycles and answered == cycles,
        f"{foreign} dropped unread and counted, {answered} of {cycles} telegrams answered in their cycle, corrections "
        f"{'the same bit for bit' if same else 'DIFFERENT'}",
        after.step_m,
        None,
        {"drop_us": round(taken_s * 1e6, 2)},
    )


SCENARIOS: Final = (
    Scenario("R30", "second-loop", "a second loop is started on the same port", "refused", _second),
    Scenario(
        "R30",
        "other-answers",
        "2 % of the telegrams lost; another program answers in their place",
        "fault",
        _other_answers,
    ),
    Scenario(
        "R31",
        "strangers",
        "10 000 datagrams a second from another address",
        "dropped unread, counted; every telegram answered, output unchanged",
        _strangers,
    ),
)
