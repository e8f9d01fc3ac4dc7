"""The loop in a process of its own, in real time: R1, R2 and R11. What is measured shows this machine, too."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import SimulationError
from counterflex.protocols.processes.control_array import CONTROL, Request
from counterflex.protocols.system.realtime import prepare
from counterflex.runtime.state.supervisor import State
from counterflex_lab.devices import OK, FakeRsi, NetftServer, RsiContext, RsiLink, answer_reader
from counterflex_lab.faults.aftermath import LARGEST_STEP_M
from counterflex_lab.faults.demonstration import (
    PERIOD_S,
    demo_config,
    force_only,
    open_session,
    reported,
    sensor_link,
    sensor_reading,
)
from counterflex_lab.faults.rig import PATIENT, square
from counterflex_lab.faults.scenario import Effort, Outcome, Scenario
from counterflex_lab.faults.seen import named

_SETTLE_CYCLES: Final = 200
_LONGEST_S: Final = 60.0
_COMPUTE_P99_S: Final = 1.0e-3
_COMPUTE_MAX_S: Final = 2.5e-3


@dataclass(eq=False)
class RealRun:
    """The loop as the controller saw it, a row per cycle, and its times."""

    age: Int = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (n,) cycles since an answer was accepted
    correction_m: Float = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) in force
    stale: int = 0  # answers that were not to the newest telegram
    stopped: str = ""  # why the controller stopped, or empty
    late_s: Float = field(default_factory=lambda: np.zeros(0))  # (n,) by how much the controller itself came late
    compute_s: Float = field(default_factory=lambda: np.zeros(0))  # time of each of the loop's cycles
    states: tuple[str, ...] = ()  # of the loop, each once, in order
    fifo: bool = False  # both had real-time priority

    @property
    def step_m(self) -> float:
        """Largest change of the correction in force from cycle to cycle."""
        return float(np.linalg.norm(np.diff(self.correction_m, axis=0), axis=1).max())

    @property
    def worst_run(self) -> int:
        """Most cycles in a row without an answer in time."""
        return int(self.age.max())


def _loop(pipe: Any, sensor: tuple[str, int], control: Any) -> None:
    """The loop's process."""
    shared: Int = np.frombuffer(control, dtype=np.int64)
    link = RsiLink(demo_config(), port=0)
    session = open_session(link, sensor_link(sensor), force_only(), control=shared)
    granted = prepare()
    pipe.send(link.address)
    compute: list[float] = []
    states, names = [State.IDLE], ["idle"]
    end = time.monotonic() + _LONGEST_S
    while not shared[Request.END] and time.monotonic() < end:
        session.cycle(session.patience_s if session.cycles else 0.1)
        compute.append(session.compute_ns * 1e-9)
        if session.loop.state != states[-1]:
            states.append(session.loop.state)
            names.append(named(session.loop.state, session.loop.cause))
    pipe.send((np.array(compute[_SETTLE_CYCLES:]), tuple(names), granted.fifo))


def _received(own: socket.socket, due: float) -> list[bytes]:
    """Datagrams that come until then."""
    out: list[bytes] = []
    while (remaining := due - time.perf_counter()) > 0.0:
        own.settimeout(remaining)
        with contextlib.suppress(TimeoutError):
            out.append(own.recv(65536))
    return out


def _robot(pipe: Any, control: Any, cycles: int, timeout: int, stop: tuple[int, int] | None) -> None:
    """The controller's process, with the sensor; it stops and continues the loop's process by itself, on time."""
    shared: Int = np.frombuffer(control, dtype=np.int64)
    config = demo_config()
    robot = FakeRsi(config, RsiContext(timeout=timeout), {"Enable": 0.0})
    reader, reading = answer_reader(config), sensor_reading()
    rng = np.random.default_rng(0)
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.bind(("127.0.0.1", 0))
    server = NetftServer(http_port=None)
    pipe.send(server.address)
    peer, loop_pid = pipe.recv()
    ages, corrections, lates, age, stale = [], [], [], 0, 0
    granted = prepare()
    due = time.perf_counter()
    for k in range(_SETTLE_CYCLES + cycles):
        lates.append(max(0.0, time.perf_counter() - due))
        due += PERIOD_S
        if stop is not None and k == _SETTLE_CYCLES + stop[0]:
            os.kill(loop_pid, signal.SIGSTOP)
        if k == _SETTLE_CYCLES // 2:
            shared[Request.ARM] = 1
        acting = k >= _SETTLE_CYCLES
        robot.frees["Enable"] = float(acting)
        if not robot.stopped:
            own.sendto(robot.telegram(reported(robot, k, acting)), peer)
        if stop is not None and k == _SETTLE_CYCLES + stop[0] + stop[1]:
            os.kill(loop_pid, signal.SIGCONT)
        server.poll()
        force = square((k - _SETTLE_CYCLES) * PERIOD_S) if acting else np.zeros(3)
        w = reading @ np.concatenate([force, np.zeros(3)])
        for _ in range(4):
            server.send(w + rng.standard_normal(6) * [0.3, 0.3, 0.3, 0.03, 0.03, 0.03])
        datagrams = _received(own, due)
        stale += sum(reader.read_bytes(data) == OK and reader.counter != robot.counter for data in datagrams)
        answer = datagrams[-1] if datagrams else None
        if not robot.stopped:
            robot.answer(answer)
            age = age + 1 if robot.refused else 0
        ages.append(age)
        corrections.append(robot.correction[:3].copy())
    shared[Request.END] = 1
    pipe.send((np.array(ages), np.array(corrections), np.array(lates), stale, robot.stopped, granted.fifo))
    own.close()
    server.close()


def _busy(ended: Any) -> None:
    while not ended.is_set():
        sum(range(10_000))


def real_run(cycles: int, *, timeout: int = PATIENT, busy: int = 0, stop: tuple[int, int] | None = None) -> RealRun:
    """Run loop and controller in processes of their own.

    Args:
        cycles: With the correction acting.
        timeout: Of the controller.
        busy: Further processes that only compute.
        stop: Stop the loop's process (SIGSTOP) at a cycle, for a number of cycles.

    Raises:
        SimulationError: This system cannot stop processes, or one of them died.
    """
    if stop is not None and not hasattr(signal, "SIGSTOP"):
        raise SimulationError("processes cannot be stopped on this system")
    context = multiprocessing.get_context("spawn")
    control = context.Array("q", CONTROL, lock=False)
    loop_pipe, loop_side = context.Pipe()
    robot_pipe, robot_side = context.Pipe()
    ended = context.Event()
    robot = context.Process(target=_robot, args=(robot_side, control, cycles, timeout, stop), daemon=True)
    processes: list[BaseProcess] = [robot]
    try:
        robot.start()
        sensor = _message(robot_pipe)
        loop = context.Process(target=_loop, args=(loop_side, sensor, control), daemon=True)
        processes.append(loop)
        loop.start()
        address = _message(loop_pipe)
        for _ in range(busy):
            processes.append(context.Process(target=_busy, args=(ended,), daemon=True))
            processes[-1].start()
        robot_pipe.send((address, loop.pid))
        ages, corrections, lates, stale, stopped, robot_fifo = _message(robot_pipe)
        compute, states, fifo = _message(loop_pipe)
    finally:
        ended.set()
        for process in processes:
            if process.is_alive():
                process.join(1.0)
            if process.is_alive():
                process.kill()
                process.join()
    n = _SETTLE_CYCLES
    return RealRun(ages[n:], corrections[n:], stale, stopped, lates[n:], compute, states, fifo and robot_fifo)


def _message(pipe: Any) -> Any:
    """Wait for a message of the other process.

    Raises:
        SimulationError: It does not.
    """
    try:
        if pipe.poll(_LONGEST_S):
            return pipe.recv()
    except (EOFError, ConnectionError):
        pass
    raise SimulationError("a process of the run said nothing any more", limit=f"{_LONGEST_S:g} s")


def _nominal(busy: int, share: float) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        result = real_run(effort.pick(5_000, 750), busy=busy)
        fresh = float(np.mean(result.age == 0))
        p50, p99 = (float(np.percentile(result.compute_s, q, method="higher")) for q in (50, 99))
        largest = float(result.compute_s.max())
        quick = busy > 0 or (result.worst_run <= 2 and p99 < _COMPUTE_P99_S and largest < _COMPUTE_MAX_S)
        return Outcome(
            fresh >= share and quick,
            f"{fresh:.3%} of {len(result.age)} telegrams answered in time, at most {result.worst_run} in a row not; "
            f"computing p50 {p50 * 1e6:.0f}, p99 {p99 * 1e6:.0f}, largest {largest * 1e6:.0f} us; "
            f"controller itself up to {result.late_s.max() * 1e3:.1f} ms late; "
            f"real-time priority {'yes' if result.fifo else 'no'}; " + ", ".join(result.states),
            result.step_m,
            None,
            {"in_time_share": fresh, "worst_run": float(result.worst_run), "compute_p99_us": round(p99 * 1e6, 1)},
        )

    return run


def _stopped_process(cycles: int, timeout: int) -> Callable[[Effort], Outcome]:
    def run(_: Effort) -> Outcome:
        begin = 150
        result = real_run(begin + cycles + 125, timeout=timeout, stop=(begin, cycles))
        missed = int(result.age[begin : begin + cycles + 25].max())
        stopped_early = result.stopped == "RSITimeout"
        fault = any(name.startswith("fault") for name in result.states)
        expected = missed <= cycles + 1 if timeout == PATIENT else stopped_early
        return Outcome(
            expected and fault and result.stale == 0 and result.step_m <= LARGEST_STEP_M,
            f"{missed} answers missed, {result.stale} sent to telegrams that were not the newest; controller: "
            f"{result.stopped or 'goes on'}; {', '.join(result.states)}",
            result.step_m,
            min(missed, timeout) * PERIOD_S,
            {"missed": float(missed)},
        )

    return run


SCENARIOS: Final = (
    Scenario(
        "R1",
        "nominal",
        "nothing, 250 Hz in real time",
        "99.99 % answered in their cycle, no 3 in a row not; computing p99 < 1.0 ms, largest < 2.5 ms",
        _nominal(0, 0.9999),
        realtime=True,
    ),
    Scenario(
        "R2",
        "load",
        "4 processes that only compute",
        "99.9 % answered in their cycle",
        _nominal(4, 0.999),
        realtime=True,
    ),
    Scenario(
        "R11",
        "sigstop-60ms",
        "the loop's process stopped for 60 ms (SIGSTOP), a controller that does not stop",
        "15 missed, queued telegrams never answered, fault",
        _stopped_process(15, PATIENT),
        realtime=True,
    ),
    Scenario(
        "R11",
        "sigstop-500ms",
        "the same for 500 ms, Timeout 10",
        "the controller has stopped by itself after 40 ms; queued telegrams never answered, fault",
        _stopped_process(125, 10),
        realtime=True,
    ),
)
