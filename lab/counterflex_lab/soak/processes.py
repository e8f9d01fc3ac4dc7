"""Processes of a long run: the simulated cell, the loop with its recorder, and a do-nothing echo beside them."""

from __future__ import annotations

import multiprocessing
import signal
import socket
import threading
import time
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final

from counterflex.app.run import run as online, session as online_session
from counterflex.core.errors import OutputError
from counterflex.protocols.system import timing_probe
from counterflex.protocols.system.realtime import prepare
from counterflex_lab.devices import FakeRsi, NetftServer, RsiContext, read_config
from counterflex_lab.soak.recorded_cell import ReplayedCell
from counterflex_lab.soak.recorded_pass import RecordedPass

PERIOD_S: Final = 4e-3
BLOCK: Final = round(60.0 / PERIOD_S)
"""Cycles of a minute, which the cell tells together."""
SAMPLE_S: Final = 5.0
_LAST_CYCLES: Final = 50
_LATENESS_ALLOWED: Final = 1 << 30
"""Timeout of the simulated controller, cycles: late answers are counted, they do not end the run."""


def end_processes(started: list[Any], echo: Any) -> None:
    """Wait for the processes, and end those that do not end; the echo waits for nobody."""
    for process in started:
        if process.pid is not None:
            process.join(3.0 if process is not echo else 0.0)
            process.terminate()
            process.join()


def next_message(pipe: Any, process: BaseProcess) -> Any:
    """Wait for the next message of a process.

    Raises:
        OutputError: It ended silently, or by what would be taken for an interruption of this process.
        Exception: What it says went wrong.
    """
    while not pipe.poll(0.2):
        if not process.is_alive() and not pipe.poll(0.0):
            raise OutputError("a process of the run ended early", value=f"exit status {process.exitcode}")
    message = pipe.recv()
    if isinstance(message, BaseException):
        if isinstance(message, Exception) and not isinstance(message, EOFError):
            raise message
        raise OutputError("a process of the run was ended", value=f"{type(message).__name__} {message}".strip())
    return message


def echo_process(own: socket.socket) -> None:
    """Send every datagram back."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    prepare()
    timing_probe.echo(own)


def cell_process(rsi: Path, played: RecordedPass, cycles: int, pipe: Any, halt: Any) -> None:
    """The simulated cell's side, in real time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        netft = NetftServer()
        fake = FakeRsi(read_config(rsi), RsiContext(timeout=_LATENESS_ALLOWED))
        cell = ReplayedCell(played, fake, netft)
        pipe.send((netft.address, netft.http_address))
        while not pipe.poll(0.02):
            netft.poll()
        peer, tracker, echo = pipe.recv()
        prepare()
        # A pipe that nobody reads for a while must not hold up the robot; the thread has this process' priority.
        tell: SimpleQueue[Any] = SimpleQueue()
        threading.Thread(target=_tell, args=(tell, pipe), daemon=True).start()
    except BaseException as fault:
        pipe.send(fault)
        return
    try:
        cell.run(peer, cycles, tracker=tracker, echo=echo, block=BLOCK, on_block=tell.put, ended=halt.is_set)
        tell.put(None)
        while not pipe.poll(0.0):  # a robot does not fall silent before the loop has ended
            cell.run(peer, _LAST_CYCLES, tracker=tracker)
    except BaseException as fault:
        tell.put(fault)
        time.sleep(SAMPLE_S)


def _tell(queue: SimpleQueue[Any], pipe: Any) -> None:
    while True:
        pipe.send(queue.get())


def _tell_started(pipe: Any, address: tuple[str, int]) -> None:
    pipe.send((address, {process.name: process.pid for process in multiprocessing.active_children()}))


def run_process(settings: online_session.RunSettings, log: Path, pipe: Any, ended: Any) -> None:
    """Starts loop and recorder: what the command ``run`` does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        pipe.send(online.run(settings, log, started=partial(_tell_started, pipe), ended=ended.is_set))
    except BaseException as fault:
        pipe.send(fault)
