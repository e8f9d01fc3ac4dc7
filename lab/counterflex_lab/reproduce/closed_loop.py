"""The simulated cell and the loop, each in a process of its own, in lockstep, joined by sockets and files only."""

from __future__ import annotations

import contextlib
import multiprocessing
import socket
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from counterflex.app.long_jobs.workers import end_with_parent, interrupts_deferred
from counterflex.app.run import run as online, session as online_session
from counterflex.app.run.status import Status
from counterflex.app.simulated_cell import cell as live
from counterflex.core.errors import CounterflexError, SimulationError
from counterflex.core.progress import Progress, silent

_HOST = "127.0.0.1"
_WAIT_S = 120.0
_END_S = 60.0
_COMPILES_S = 900.0
"""How long the cell waits for the loop: the first one on a computer compiles, several at a time even longer."""


@dataclass(frozen=True)
class Sensors:
    """Instruments that are wired."""

    force: bool = True  # force sensor (Net F/T)
    tracker: bool = False  # laser tracker
    holder: bool = False  # strain amplifiers of the instrumented holder


def free_port(kind: socket.SocketKind) -> int:
    """A port of this computer that nothing listens on at the moment."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind((_HOST, 0))
        return int(probe.getsockname()[1])


def run(
    cell: live.LiveSettings,
    part: Path,
    loop: online_session.RunSettings,
    log: Path,
    *,
    sensors: Sensors,
    cycles: int = 0,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run a program on the simulated cell with the loop beside it, on free ports of the loopback interface.

    Args:
        cell: The simulated cell; its addresses are filled in here.
        part: Folder for what it writes.
        loop: The loop; its addresses are filled in here.
        log: Folder of the run log.
        sensors: Which instruments are wired.
        cycles: How many cycles are expected, for the progress; 0 is not known.
        progress: Progress callback, fraction 0 to 1; may raise ``Interrupted``.

    Returns:
        Summary of the loop.

    Raises:
        CounterflexError: What either side raised.
    """
    rsi = free_port(socket.SOCK_DGRAM)
    wired = (sensors.force, sensors.tracker, sensors.holder)
    peers = [(_HOST, free_port(socket.SOCK_DGRAM)) if there else None for there in wired]
    force, tracker, strain = (peer and peer[1] for peer in peers)
    http = free_port(socket.SOCK_STREAM) if sensors.force else 80
    cell = replace(
        cell,
        peer=(_HOST, rsi),
        force_port=force,
        force_http_port=http,
        tracker_peer=peers[1],
        strain_peer=peers[2],
        timing=replace(cell.timing, wait_s=_COMPILES_S),
    )
    loop = replace(
        loop,
        port=rsi,
        force=peers[0],
        force_http_port=http,
        tracker_port=tracker,
        strain_port=strain,
        lockstep=True,
        force_wait_s=_WAIT_S,
        quiet_s=_WAIT_S,
    )
    context = multiprocessing.get_context("spawn")
    parent, child = context.Pipe(duplex=False)
    process = context.Process(target=_cell_process, args=(cell, part, child), daemon=True)
    watch = partial(_watch, process, parent, progress, part.name, cycles)
    try:
        with interrupts_deferred():
            process.start()
        outcome = online.run(loop, log, watch=watch, ended=lambda: not process.is_alive())
        process.join(_END_S)
        _raise_fault(parent)
        if process.exitcode != 0:
            raise SimulationError("the simulated cell ended silently", value=process.exitcode)
    finally:
        if process.is_alive():
            process.terminate()
            process.join()
        parent.close()
    return outcome


def _raise_fault(pipe: Connection) -> None:
    if pipe.poll() and isinstance(fault := pipe.recv(), BaseException):
        raise fault


def _watch(process: BaseProcess, pipe: Connection, progress: Progress, name: str, cycles: int, status: Status) -> None:
    if cycles:
        progress(min(0.99, status.cycles / cycles), f"{name}: {status.state.name.lower()}")
    if not process.is_alive():
        _raise_fault(pipe)


def _cell_process(settings: live.LiveSettings, out: Path, pipe: Any) -> None:
    """Process of the simulated cell: a fault goes to the parent instead of the terminal."""
    end_with_parent()
    try:
        live.run(settings, out)
    except CounterflexError as fault:
        with contextlib.suppress(OSError):
            pipe.send(fault)
