"""``counterflex run`` as a person starts it, in processes of its own; robot and force sensor are played here.

The robot sends a telegram every cycle and waits for the answer, so that a slow machine changes little; what is timed on
purpose is timed by the clock.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final, Self

import numpy as np

from counterflex.app.run.log import repair
from counterflex.app.run.missing import counted
from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.files.logs.repair import Repaired
from counterflex.files.machine_file import machine_file
from counterflex_lab.devices import FakeRsi, NetftServer, RsiContext
from counterflex_lab.faults.demonstration import PERIOD_S, demo_config, reported
from counterflex_lab.faults.process_rig import write_files

_COMMAND: Final = "import sys; from counterflex.cli.start import run; sys.argv[0] = 'counterflex'; run()"
_START_S: Final = 300.0
_PATIENCE_S: Final = 1.0
_SAMPLES: Final = 4
_PUSH_N: Final = 300.0
_ON_M: Final = 0.1e-3


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def command(*words: str) -> list[str]:
    """A command of counterflex as a new process is started with it."""
    return [sys.executable, "-c", _COMMAND, *words]


class RunRig:
    """The command with its processes, a robot and a sensor.

    Args:
        folder: For cell, configuration and log.
        seed: Of the sensor's noise.
        words: Further options of the command.

    Attributes:
        log: Folder of the run's log.
        process: Of the command.
        robot: The controller; judges what is in force.
        corrections: (n, 3) m in force, one for every cycle.
        held: Whether a feed hold was asked for, one for every cycle.
        times: Monotonic times of the ends of the cycles.
    """

    def __init__(self, folder: Path, seed: int = 0, words: tuple[str, ...] = ()) -> None:
        self.cell, rsi = write_files(folder)
        port = _free_port()
        rsi.write_text(rsi.read_text(encoding="utf-8").replace("<PORT>49152<", f"<PORT>{port}<"), encoding="utf-8")
        self._address = ("127.0.0.1", port)
        self.log = folder / "log"
        self.sensor = NetftServer()
        http = self.sensor.http_address
        self._noise = np.random.default_rng(seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.robot = FakeRsi(demo_config(), RsiContext(), {"Enable": 0.0})
        self.corrections: list[Float] = []
        self.feed_held: list[bool] = []
        self.times: list[float] = []
        self._run_cycles = 0
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process
        host, udp = self.sensor.address
        options = ["--cell", str(self.cell), "--rsi", str(rsi), "--arm", "-s", "local"]
        options += [
            "-s",
            f"force_sensor.address={host}:{udp}",
            "-s",
            f"force_sensor.http_port={http[1] if http else 0}",
        ]
        options += ["--out", str(self.log), *words]
        self.process = subprocess.Popen(
            command("run", *options), stdout=self._output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
        )

    def __enter__(self) -> Self:
        """The rig."""
        return self

    def __exit__(self, *_: object) -> None:
        """End what is left of it and free the sockets."""
        for number in (*self.children(), self.process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        self.process.wait(_PATIENCE_S)
        # A loop that was killed is told to the next one of this port, which the system may give to anybody.
        (machine_file().parent / f"robot-{self._address[1]}.lock").unlink(missing_ok=True)
        self.sensor.close()
        self._socket.close()
        self._output.close()

    def output(self) -> str:
        """Lines that the command has printed so far."""
        self._output.seek(0)
        return self._output.read().decode(errors="replace")

    def children(self) -> list[int]:
        """Process numbers of the command's own processes."""
        listed = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        try:
            return [int(word) for word in listed.read_text(encoding="ascii").split()]
        except OSError:
            return []

    def recorder(self) -> int:
        """Process number of the one that writes the log.

        Raises:
            SimulationError: None does.
        """
        for number in (*self.children(), self.process.pid):
            folder = Path(f"/proc/{number}/fd")
            with contextlib.suppress(OSError):
                if any(self.log.resolve() in entry.readlink().parents for entry in folder.iterdir()):
                    return number
        raise SimulationError("no process writes the log", where=str(self.log))

    def cycle(self, *, enable: bool, force_n: float = 0.0, patience_s: float | None = None) -> bool:
        """One cycle of the controller; returns whether an answer came.

        Args:
            enable: What the robot program says.
            force_n: On the tool, as long as the robot goes on.
            patience_s: How long to wait for the answer; None: a second while the command lives, else a cycle.
        """
        begin = time.monotonic()
        stands = self.robot.feed_hold or bool(self.robot.stopped)
        self._run_cycles += not stands
        self.sensor.poll()
        for _ in range(_SAMPLES):
            push = 0.0 if stands else force_n
            self.sensor.send(np.array([0.0, push, 0.0, 0.0, 0.0, 0.0]) + 0.3 * self._noise.standard_normal(6))
        self.robot.frees["Enable"] = float(enable)
        report = reported(self.robot, len(self.times), running=True, run_cycles=self._run_cycles, of_cell=True)
        answer = None
        with contextlib.suppress(ConnectionError):
            self._socket.sendto(self.robot.telegram(report), self._address)
            usual = _PATIENCE_S if self.process.poll() is None else PERIOD_S
            answer = self._answer(begin + (usual if patience_s is None else patience_s))
        self.robot.answer(answer)
        self.corrections.append(self.robot.correction[:3].copy())
        self.feed_held.append(self.robot.feed_hold)
        time.sleep(max(0.0, begin + PERIOD_S - time.monotonic()))
        self.times.append(time.monotonic())
        return answer is not None

    def _answer(self, end_s: float) -> bytes | None:
        mark = f"<IPOC>{self.robot.counter}</IPOC>".encode("ascii")
        while True:
            left = end_s - time.monotonic()
            if left <= 0.0:
                return None
            self._socket.settimeout(left)
            try:
                data = self._socket.recv(65536)
            except (TimeoutError, ConnectionError):
                continue
            if mark in data:
                return data

    def activate(self) -> None:
        """Wait until the command answers, let it arm, and cut until it corrects.

        Raises:
            SimulationError: It does not.
        """
        end = time.monotonic() + _START_S
        while not list(self.log.glob("run-*.mcap")):  # begun when the loop listens
            if time.monotonic() > end or self.process.poll() is not None:
                raise SimulationError("the run did not begin", value=self.output()[-300:])
            time.sleep(0.05)
        for k in range(2_000):
            self.cycle(enable=k > 250, force_n=_PUSH_N if k > 300 else 0.0)
            if k > 250 and k % 250 == 0:
                self.cycle(enable=False)  # an edge, where it was armed later
            if np.linalg.norm(self.robot.correction[:3]) > _ON_M:
                return
        raise SimulationError("the run did not correct", value=self.output()[-300:])

    def cut(self, cycles: int) -> None:
        """Go on cutting."""
        for _ in range(cycles):
            self.cycle(enable=True, force_n=_PUSH_N)

    def until_ended(self, most_s: float = 20.0) -> int | None:
        """Go on cutting until the command has ended; its exit status, or None where it does not end."""
        end = time.monotonic() + most_s
        while self.process.poll() is None and time.monotonic() < end:
            self.cycle(enable=True, force_n=_PUSH_N)
        return self.process.poll()

    def steps(self, first: int = 1) -> Float:
        """Change of the correction in force from cycle to cycle, m."""
        out: Float = np.linalg.norm(np.diff(np.array(self.corrections[first - 1 :]), axis=0), axis=1)
        return out

    def repaired(self) -> tuple[list[Repaired], int, int]:
        """Repair the log as a person does at once: what was done, records, cycles missing of its runs."""
        done, _ = repair(self.log)
        records, missing = counted(self.log)
        return done, records, missing
