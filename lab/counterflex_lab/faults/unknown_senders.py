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
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.network import described
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario


def _second(effort: Effort) -> Outcome:
    """A second loop on the port of the first."""
    with Rig(seed=effort.seed, sensors=effort.sensors) as rig:
        rig.activate()
        message = ""
        for host in ("127.0.0.1", "0.0.0.0"):
            try:
                RsiLink(rig.config, host=host, port=rig.link.address[1]).close()
            except OutputError as fault:
                message = str(fault).split(": ", 1)[-1].split(".")[0]
            else:
                return Outcome(False, f"a second loop could listen at {host}")
        begin = rig.cycle_count
        rig.run(200)
        state = rig.state
        step = float(rig.seen.steps()[begin - 1 :].max())
    return Outcome(state == State.ACTIVE, f"refused ({message}); the first one goes on", step)


def _other_answers(effort: Effort) -> Outcome:
    """Another program answers the robot where the loop does not; its answers are good ones that ask for zero."""
    with Rig(Impairment(loss=0.02), seed=effort.seed, sensors=effort.sensors) as rig:
        writer = answer_writer(rig.config)
        begin = rig.activate().cycle_count
        rig.run(50)

        def zero(counter: int) -> bytes:
            writer.values[:] = 0.0
            return writer.telegram(counter)

        rig.other = zero
        since = rig.cycle_count
        lost = rig.link.counters.lost
        while rig.state != State.FAULT and rig.cycle_count < since + 3_000:
            rig.cycle()
        cause, unexplained = rig.loop.cause, rig.link.counters.lost - lost
        path = rig.seen.path(begin)
    return Outcome(
        cause == Cause.FOREIGN_PEER,
        f"fault after {unexplained} cycles that the loop did not answer and the controller did not count; "
        f"{described(path)}",
        None,
        (rig.cycle_count - since) * PERIOD_S,
    )


def _strangers(effort: Effort) -> Outcome:
    """Good telegrams and rubbish from another address, 40 in every cycle: 10 000 a second."""
    cycles = effort.pick(1_000, 200)
    paths, foreign = [], 0
    taken_s = 0.0
    for disturbed in (False, True):
        with (
            Rig(seed=effort.seed, sensors=effort.sensors) as rig,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        ):
            stranger.bind(("127.0.0.1", 0))
            begin = rig.activate().cycle_count
            forged = rig.next_telegram().replace(b"<IPOC>4", b"<IPOC>3")
            for _ in range(cycles):
                if disturbed:
                    for k in range(40):
                        rig.to_loop(forged if k % 2 else b"rubbish", stranger)
                rig.cycle()
            paths.append(np.array(rig.seen.correction_m))
            foreign = rig.link.counters.foreign
            answered = int(np.sum(np.array(rig.seen.age[begin:]) == 0))
            step = float(rig.seen.steps()[begin - 1 :].max())
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
        step,
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
