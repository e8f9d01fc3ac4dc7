"""Garbage through a whole online session: link, watch, step, supervisor and answer, over a loopback socket in lockstep.

A session is brought to ACTIVE with a correction of some hundredths of a millimetre; then good and damaged telegrams
follow each other at random, with long runs of damaged ones. After every cycle: no exception; the correction finite and
no farther from the last one than its speed allows; not ACTIVE with three unreadable telegrams in a row (R13), FAULT
with ten; and no way out of FAULT.

    python tools/fuzz_session.py --inputs 100000 --seed 1
"""

from __future__ import annotations

import argparse
import socket
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from counterflex.core.arrays import Float
from counterflex.integrations.kuka.link.config import RsiConfig
from counterflex.integrations.kuka.link.link import RsiLink
from counterflex.integrations.kuka.link.telegram import Writer, robot_writer
from counterflex.protocols.processes.control_array import Request
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession
from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model import catalog, load_cases
from counterflex.runtime.loop import Loop
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.supervisor import State
from counterflex.sensing.flange_sensor import FlangeSensor
from fuzz_mutations import Mutator
from fuzz_target import Finding
from fuzz_targets import config

_UP = 260
"""Cycles until the session is active and its correction stands."""
_ACTING = (State.ACTIVE, State.HOLD, State.RAMP_OUT)


class SteadyForce:
    """A force sensor that shows what it is told to."""

    def __init__(self) -> None:
        self.w_sensor: Float = np.zeros(6)
        self.samples: Float = np.zeros((1, 6))
        self.good, self.first, self.saturated, self.frozen = 1, -1, False, False

    def drain(self) -> int:
        """One sample."""
        return 1

    def close(self) -> None:
        """Nothing to free."""


class Trial:
    """A session, the controller's socket, and what must hold.

    Args:
        expect: The set-up of both sides.
    """

    def __init__(self, expect: RsiConfig) -> None:
        chain = ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"), load_cases.end_effector())
        settings = OnlineSettings(force=ForceMode.MEASURED, tracker=TrackerMode.NONE, normal_only=False)
        self.loop = Loop(chain, settings, np.eye(4), None)
        self.force = SteadyForce()
        self.wrench = SensorWrench(chain, FlangeSensor(chain.names[-2], np.eye(4), 0.0, np.zeros(3)), np.eye(4))
        self.writer: Writer = robot_writer(expect)
        self.expect = expect
        names = dict(zip(self.writer.names, range(len(self.writer.names)), strict=True))
        for name, value in {"RSol.X": 1500.0, "RSol.Z": 900.0, "RSol.B": 90.0, "ASPos.A2": -90.0, "ASPos.A3": 120.0,
                            "ASPos.A5": 30.0}.items():  # fmt: skip
            self.writer.values[names[name]] = value
        self._enable = names["Enable"]
        self.counter = 4000
        self.robot = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.robot.bind(("127.0.0.1", 0))
        self.robot.setblocking(False)
        self.begin()

    def begin(self) -> None:
        """Bring a new session to ACTIVE."""
        self.loop.reset()
        self.link = RsiLink(self.expect, port=0)
        self.session = OnlineSession(
            self.link, self.loop, sensing=Sensing(self.force, self.wrench), watch=WatchSettings(clock=False)
        )
        self.session.control[Request.ARM] = 1
        self.force.w_sensor[:] = 0.0
        for k in range(_UP):
            self.writer.values[self._enable] = float(k > 150)
            self.force.w_sensor[1] = 60.0 if k > 160 else 0.0
            self.cycle(self.good())
        if self.loop.state != State.ACTIVE or not np.linalg.norm(self.loop.correction[:3]) > 1e-6:
            raise Finding(f"the session did not become active: {self.loop.state}, {self.loop.cause}")

    def good(self) -> bytes:
        """The next telegram of the controller."""
        self.counter += 4
        return self.writer.telegram(self.counter)

    def cycle(self, data: bytes) -> None:
        """One datagram, one cycle of the session, and what must hold after it."""
        before, last = self.loop.state, self.loop.correction.copy()
        self.robot.sendto(data, self.link.address)
        self.session.cycle(0.0)
        try:
            while True:
                self.robot.recv(65536)
        except BlockingIOError:
            pass
        row, now = self.link.counters.malformed_in_a_row, self.loop.state
        settings = self.loop.settings
        most = 4.0 * settings.period_s * settings.translation.speed * 1.001
        if not np.all(np.isfinite(self.loop.correction)) or np.linalg.norm(self.loop.correction - last) > most:
            raise Finding(f"the correction went from {last} to {self.loop.correction}")
        if row >= 3 and now == State.ACTIVE:
            raise Finding(f"active with {row} unreadable telegrams in a row")
        if row >= 10 and before in _ACTING and now != State.FAULT:
            raise Finding(f"{now!r} with {row} unreadable telegrams in a row")
        if before == State.FAULT and now != State.FAULT:
            raise Finding(f"out of FAULT into {now!r} without a person")

    def close(self) -> None:
        """Free the sockets."""
        self.link.close()
        self.robot.close()


def run(inputs: int, seed: int) -> dict[str, Any]:
    """Fuzz; figures.

    Raises:
        Finding: Something did not hold; the message says after which input.
    """
    mutate = Mutator(seed, text=True)
    rng = np.random.default_rng(seed)
    trial = Trial(config())
    sessions, holds, faults = 1, 0, 0
    begin = time.perf_counter()
    damaged, length, number = False, 0, 0
    last = b""
    try:
        for number in range(inputs):  # noqa: B007 - said where something is found
            if length == 0:
                damaged, length = bool(rng.random() < 0.5), int(rng.integers(1, 14))
            length -= 1
            good = trial.good()
            last = mutate(good, good) if damaged else good
            before = trial.loop.state
            trial.cycle(last[:65000])
            holds += before == State.ACTIVE and trial.loop.state == State.HOLD
            if trial.loop.state not in _ACTING:
                faults += trial.loop.state == State.FAULT
                for _ in range(5):
                    trial.cycle(trial.good())
                trial.link.close()
                trial.begin()
                sessions += 1
    except Exception as fault:
        raise Finding(f"seed {seed}, input {number}: {type(fault).__name__}: {fault}: {last[:1000]!r}") from fault
    finally:
        trial.close()
    seconds = round(time.perf_counter() - begin, 1)
    return {"inputs": inputs, "seed": seed, "sessions": sessions, "holds": holds, "faults": faults, "seconds": seconds}


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line, fuzz, print; exit status 1 where something was found."""
    parser = argparse.ArgumentParser(description="Garbage through a whole online session")
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    try:
        print(run(given.inputs, given.seed))
    except Finding as found:
        print(f"FOUND {found}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
