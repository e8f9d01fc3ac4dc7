"""The loop in a process of its own, as a run starts it, with a recorder in another; robot and sensor are played here.

The robot waits for every answer, so that nothing depends on the speed of the machine but what is timed on purpose.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import socket
import time
from collections.abc import Callable
from importlib import resources
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from counterflex.app.run.process import loop_process
from counterflex.app.run.session import RunSettings
from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.machine_file import machine_file
from counterflex.protocols.processes.control_array import CONTROL, Kept, Life, Request
from counterflex.protocols.processes.living import Beat
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.runtime.record_ring import RecordRing, column
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.devices import FakeRsi, NetftServer, RsiContext
from counterflex_lab.faults.demonstration import PERIOD_S, Q, demo_config, standing

_ONLINE: Final = """
[sensor]
segment = "sensor"
mass_kg = 0
com_mm = [0, 0, 0]

[online]
force = "measured"
along_feed = true
"""
PRELOAD: Final = ["counterflex_lab.faults.loaded_rig"]
"""Modules of the process that those of a rig are forked from: there are hundreds, and kernels take seconds to read."""
_POLL_S: Final = 0.02
_SAMPLES: Final = 4
_PATIENCE_S: Final = 10.0


def write_files(folder: Path) -> tuple[Path, Path]:
    """A cell that corrects by the measured force alone, and its RSI configuration."""
    with resources.as_file(resources.files("counterflex.app") / "demo") as demo:
        text = (demo / "cell.toml").read_text(encoding="utf-8")
        shutil.copy(demo / "rsi.xml", folder / "rsi.xml")
    (folder / "cell.toml").write_text(text + _ONLINE, encoding="utf-8")
    return folder / "cell.toml", folder / "rsi.xml"


def keep_log(ring_name: str, folder: str, words: Path, largest_file: int) -> None:
    """A recorder's process: takes what the loop hands over, until it is killed.

    Args:
        ring_name: Of the ring.
        folder: Of the log.
        words: Shared with the loop, which is told what was taken and which process this is.
        largest_file: Bytes that a file may have before the operating system refuses more; 0: no limit.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if largest_file:
        import resource

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
    control = SharedWords(CONTROL, words).words
    control[Life.RECORDER_PID] = os.getpid()
    reader = RecordRing(ring_name)
    reader.rewind()
    log = RunLogWriter(folder, {})
    while True:
        log.add(reader.take(), state=reader.states.take())
        control[Kept.TAKEN], control[Kept.TROUBLE] = reader.taken, int(bool(log.trouble))
        time.sleep(_POLL_S)


def keep_beating(words: Path) -> None:
    """The process that starts the others, played: says that it lives, until it is killed.

    Args:
        words: Shared with the loop.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    control: Any = SharedWords(CONTROL, words).words
    Beat(control, Life.RUN_NS, Life.RUN_PID)
    while True:
        time.sleep(_PATIENCE_S)


class ProcessRig:
    """Robot, sensor, loop, recorder and who started them; the first two here, the others in processes of their own.

    Args:
        folder: For cell, configuration and logs.
        seed: Of the sensor's noise.
        port: Of the loop; 0: the system chooses another one for each.

    Attributes:
        robot: The controller; judges what is in force.
        control: What the operator asks for.
        loop: The loop's process, or None.
        recorder: The recorder's process, or None.
        starter: The process that plays who started the others, or None.
        corrections: (n, 3) m in force, one for every cycle.
    """

    def __init__(self, folder: Path, seed: int = 0, port: int = 0) -> None:
        self.folder, self._port = folder, port
        self.cell, self.rsi = write_files(folder)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOAD)
        self._words = SharedWords(CONTROL)
        self.control = self._words.words
        self.ring = RecordRing()
        self._reader = RecordRing(self.ring.name)
        self.sensor = NetftServer()
        self._noise = np.random.default_rng(seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.robot = FakeRsi(demo_config(), RsiContext(), {"Enable": 0.0})
        self.loop: BaseProcess | None = None
        self.recorder: BaseProcess | None = None
        self.starter: BaseProcess | None = None
        self._address: tuple[str, int] = ("127.0.0.1", 0)
        self.corrections: list[Float] = []
        self._cycles = 0
        self.state = State.IDLE

    def __enter__(self) -> Self:
        """The rig."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes and free the sockets."""
        for process in (self.loop, self.recorder, self.starter):
            if process is not None and process.pid is not None:
                os.kill(process.pid, signal.SIGKILL) if process.is_alive() else None
                process.join(_PATIENCE_S)
        # A loop that was killed is told to the next one of this port.
        (machine_file().parent / f"robot-{self._port}.lock").unlink(missing_ok=True)
        self._reader.close()
        self.ring.close()
        self._words.remove()
        self._words.close()
        self.sensor.close()
        self._socket.close()

    def start_loop(self) -> None:
        """Start the loop's process, not armed.

        Raises:
            SimulationError: It did not begin.
        """
        pids = {Life.RECORDER_PID: self.recorder, Life.RUN_PID: self.starter}
        numbers = {place: process.pid for place, process in pids.items() if process is not None and process.is_alive()}
        for place in range(CONTROL):
            self.control[place] = 0
        for place, number in numbers.items():
            self.control[place] = number or 0
        document = self.sensor.http_address
        settings = RunSettings(
            self.cell,
            ("rsi", self.rsi),
            port=self._port,
            force=self.sensor.address,
            force_http_port=80 if document is None else document[1],
            lockstep=True,
            quiet_s=3600.0,
        )
        ours, theirs = self._context.Pipe()
        args = (settings, self.ring.name, self._words.path, self.folder, theirs)
        self.loop = self._context.Process(target=loop_process, args=args)
        self.loop.daemon = True
        self.loop.start()
        theirs.close()
        try:
            message: Any = ours.recv()
        except EOFError:
            raise SimulationError("the loop's process died") from None
        if isinstance(message, BaseException):
            raise message
        self._address = message[0]

    def start_recorder(self, name: str, largest_file: int = 0) -> Path:
        """Start a recorder's process; its log lies in the folder that is returned.

        Raises:
            SimulationError: It did not begin.
        """
        folder = self.folder / name
        self.recorder = self._context.Process(
            target=keep_log, args=(self.ring.name, str(folder), self._words.path, largest_file), daemon=True
        )
        self.recorder.start()
        end = time.monotonic() + 300.0
        while not list(folder.glob("run-*.mcap")):
            if time.monotonic() > end or not self.recorder.is_alive():
                raise SimulationError("the recorder did not begin")
            time.sleep(_POLL_S)
        return folder

    def start_starter(self) -> None:
        """Start the process that plays who started the others.

        Raises:
            SimulationError: It did not begin.
        """
        self.control[Life.RUN_PID] = 0
        self.starter = self._context.Process(target=keep_beating, args=(self._words.path,), daemon=True)
        self.starter.start()
        end = time.monotonic() + 300.0
        while self.control[Life.RUN_PID] == 0:
            if time.monotonic() > end or not self.starter.is_alive():
                raise SimulationError("the process that plays who started the loop did not begin")
            time.sleep(_POLL_S)

    def new_session(self) -> None:
        """The controller stops and begins another session: nothing is in force."""
        self.robot = FakeRsi(demo_config(), RsiContext(first_counter=self.robot.counter + 60_000), {"Enable": 0.0})
        self._cycles = 0

    def cycle(self, force_n: float = 0.0, *, patience_s: float = _PATIENCE_S) -> bool:
        """One cycle of the controller: sensor, telegram, answer.

        Returns:
            Whether an answer came; False at once where the loop's process is dead.
        """
        self.sensor.poll()
        for _ in range(_SAMPLES):
            self.sensor.send(np.array([0.0, force_n, 0.0, 0.0, 0.0, 0.0]) + 0.3 * self._noise.standard_normal(6))
        T = standing()
        corrected, offset = T.copy(), self.robot.pose_correction()
        corrected[:3, 3] += offset[:3]
        report = Report(self._cycles * PERIOD_S, T, corrected, Q, Q, force_n != 0.0, False)
        self._socket.sendto(self.robot.telegram(report), self._address)
        answer = self._answer(patience_s)
        self.robot.answer(answer)
        self.corrections.append(self.robot.correction[:3].copy())
        self._cycles += 1
        rows = self._reader.take()
        if len(rows):
            self.state = State(int(rows[-1, column("out_state")]))
        if self.recorder is None:  # whoever looks is the recorder
            self.control[Kept.TAKEN] = self._reader.taken
        return answer is not None

    def _answer(self, patience_s: float) -> bytes | None:
        mark = f"<IPOC>{self.robot.counter}</IPOC>".encode("ascii")
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            self._socket.settimeout(0.02)
            try:
                data = self._socket.recv(65536)
            except (TimeoutError, ConnectionError):
                if self.loop is None or not self.loop.is_alive():
                    return None
                continue
            if mark in data:
                return data
        return None

    def activate(self, most: int = 500) -> None:
        """Arm and let the program run.

        Raises:
            SimulationError: The loop did not become active.
        """
        self.control[Request.ARM] = 1
        for _ in range(most):
            self.robot.frees["Enable"] = float(self.state in (State.ARMED, State.ACTIVE))
            self.cycle()
            if self.state == State.ACTIVE:
                return
        raise SimulationError("the loop did not become active", value=self.state.name)

    def run(self, cycles: int, force: Callable[[int], float] = lambda _: 300.0, *, period_s: float = 0.0) -> None:
        """Go on for some cycles, as fast as both can, or one every ``period_s``."""
        due = time.monotonic()
        for k in range(cycles):
            self.cycle(force(k))
            due += period_s
            if period_s and due > time.monotonic():
                time.sleep(max(0.0, due - time.monotonic()))

    def steps(self, first: int = 0) -> Float:
        """Change of the correction in force from cycle to cycle, m."""
        out: Float = np.linalg.norm(np.diff(np.array(self.corrections[first:]), axis=0), axis=1)
        return out
