"""The online session against a controller and a force sensor: real sockets, a virtual clock, a bad network in between.

Robot, network, loop and sensor take turns in one process, ordered by their virtual times, so that a run depends on its
seed alone and takes as long as its sums do. The controller judges: what counts is the correction that it has in force.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, Self

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.core.units import MS, NS
from counterflex.protocols.processes.control_array import CONTROL, Request
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.twin.devices.commanded_motion import Report
from counterflex.twin.network.impairment import Impairment, Schedule
from counterflex_lab.devices import FakeRsi, NetftServer, RsiConfig, RsiContext, RsiLink
from counterflex_lab.faults.demonstration import (
    PERIOD_S,
    demo_config,
    force_only,
    open_session,
    reported,
    sensor_link,
    sensor_reading,
)
from counterflex_lab.faults.scenario import Effort
from counterflex_lab.faults.seen import Seen
from counterflex_lab.faults.tracked_tool import SimulatedTracker

PATIENT: Final = 10**9
"""Timeout of a controller that is never to stop, so that all of a run can be looked at."""
_SAMPLES: Final = 4
_NOISE: Final = 0.3 * np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
"""N and N m."""
_WIRE_S: Final = 0.1e-3
_REPLY_S: Final = 0.2e-3
_TELEGRAM, _ANSWER = 0, 1
_LAST_COUNTER: Final = 0xFFFFFFFF


def square(time_s: float) -> Float:
    """Force (3,) N on the tool, part axes: on and off every half second, faster than a correction may follow."""
    return np.array([0.0, 450.0 if time_s % 1.0 < 0.5 else 0.0, 0.0])


class Rig:
    """A robot with RSI, a network, a loop and a force sensor.

    Args:
        telegrams: What the network does on the way from the robot.
        answers: On the way back.
        seed: Of network and sensor.
        context: Settings of the controller; None: one that never stops by itself.
        settings: Of the loop; None: the measured force is undone within the default limits.
        force: Force (3,) N on the tool by virtual time, once the program runs; part axes.
        config: RSI configuration; None: the demonstration's.
        holds_feed: The robot stands while a feed hold is asked for, and no force acts then; else it goes on.
        sensors: One of :data:`counterflex_lab.faults.scenario.SENSORS`; with a tracker its integrator
            corrects what is left, or the estimator of all sources takes it.
        chosen: Changes of the other arguments of :class:`OnlineSession`.

    Attributes:
        robot: The controller.
        session: The loop's side.
        link: Its link.
        sensor: The force sensor's side.
        tracker: The tracker's side, or None.
        seen: See :class:`Seen`.
        cycle_count: Cycles of the controller so far.
        sense: The force sensor sends.
        frozen: The loop's process is stopped: it neither waits nor answers.
        enable: The robot program wants the correction.
        feed: The robot program runs: the force acts.
        clock_offset_s: By how much the clock of the loop's computer is off.
        clock_rate: Seconds of that clock per second.
        paused: The controller sends nothing.
        other: What another program answers to the robot in every cycle in which the loop does not, or None.
        spoil: What becomes of every telegram before it is sent, or None.
        wrap: The controller's counter begins again at 0 behind ``2^32 - 1``.
        wrapped_at: In which cycle it did.
        gone: Cycles in which the robot went on.
        shown: What becomes of what the controller shows of itself before it is sent, or None.
        sensed: What becomes of a sensor's reading (6,) before it is sent, or None.
        says: What the robot program sets Enable to: 1, or the number of its job.
        idle: (3,) N that the sensor shows without a cut, part axes.
    """

    def __init__(
        self,
        telegrams: Impairment | None = None,
        answers: Impairment | None = None,
        *,
        seed: int = 0,
        context: RsiContext | None = None,
        settings: OnlineSettings | None = None,
        force: Callable[[float], Float] = square,
        config: RsiConfig | None = None,
        holds_feed: bool = True,
        sensors: str = "force",
        **chosen: Any,
    ) -> None:
        self.config = demo_config() if config is None else config
        self.settings = force_only() if settings is None else settings
        self.tracker = SimulatedTracker(seed) if sensors == "both" else None
        if self.tracker is not None:
            if self.settings.force != ForceMode.FUSED:
                self.settings = replace(self.settings, tracker=TrackerMode.INTEGRATOR)
            chosen = {**self.tracker.arguments(), **chosen}
        self.robot_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.robot_socket.bind(("127.0.0.1", 0))
        self.robot_socket.setblocking(False)
        self.link = RsiLink(self.config, port=0, peer=self.robot_socket.getsockname())
        self.context = RsiContext(timeout=PATIENT) if context is None else context
        self.robot = FakeRsi(self.config, self.context, {"Enable": 0.0})
        self.sensor, self.force_link = self._instrument()
        self._reading = sensor_reading()
        self.control = np.zeros(CONTROL, dtype=np.int64)
        self.now_s = self.clock_offset_s = 0.0
        self.clock_rate = 1.0
        chosen = {"control": self.control, "clock_ns": self.clock_ns, **chosen}
        self.session = open_session(self.link, self.force_link, self.settings, **chosen)
        self.loop = self.session.loop
        self.ways = (Schedule(telegrams or Impairment(), seed, 0), Schedule(answers or Impairment(), seed, 1))
        self.seen = Seen()
        self.cycle_count = self.run_cycles = 0
        self.force_scale = 1.0
        self.idle: Float = np.zeros(3)
        self._holds_feed = holds_feed
        self.frozen = self.feed = self.enable = self.paused = self.wrap = False
        self.wrapped_at = 0
        self.other: Callable[[int], bytes] | None = None
        self.spoil: Callable[[bytes], bytes] | None = None
        self.shown: Callable[[Report], Report] | None = None
        self.sensed: Callable[[Float], Float] | None = None
        self.sense = True
        self._force = force
        self._noise = np.random.default_rng([seed, 2])
        self._events: list[tuple[float, int, int, bytes]] = []
        self._tie = itertools.count()
        self._due = 0.0
        self._sent = [0, 0]
        self._age = 0
        self._sessions = 0
        self._arrived: list[bytes] = []
        self._feed_begin = 0.0

    def __enter__(self) -> Self:
        """The rig."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free the sockets."""
        self.close()

    def close(self) -> None:
        """Free the sockets."""
        self.link.close()
        self.force_link.close()
        self.sensor.close()
        self.robot_socket.close()
        if self.tracker is not None:
            self.tracker.close()

    def clock_ns(self) -> int:
        """The monotonic clock of the loop's computer."""
        return round((self.clock_rate * self.now_s + self.clock_offset_s) / NS)

    @property
    def state(self) -> State:
        """Of the loop."""
        return self.loop.state

    @property
    def step_limit_m(self) -> float:
        """Largest step that the loop may make in one cycle."""
        return self.settings.translation.speed * self.settings.period_s

    def activate(self, most: int = 600) -> Self:
        """Let everything settle over a good network, arm, let the program run.

        Raises:
            SimulationError: The loop did not become active.
        """
        ways = self.ways
        self.ways = (Schedule(Impairment()), Schedule(Impairment()))
        self.control[Request.ARM] = 1
        for _ in range(most):
            if self.state == State.ARMED:
                self.enable = True
            if self.state == State.ACTIVE:
                break
            self.cycle()
        else:
            raise SimulationError("the loop did not become active", value=self.state.name)
        self.feed, self._feed_begin = True, self.now_s
        self.ways, self._sent = ways, [0, 0]
        return self

    @property
    def running(self) -> bool:
        """The controller sends telegrams."""
        return not (self.paused or self.robot.stopped)

    @property
    def stands(self) -> bool:
        """The robot holds its feed, or has stopped."""
        return (self._holds_feed and self.robot.feed_hold) or bool(self.robot.stopped)

    def run(self, cycles: int) -> Self:
        """Go on for some cycles."""
        for _ in range(cycles):
            self.cycle()
        return self

    def restart_robot(self, counter: int, *, empty_first: bool = False) -> None:
        """The controller begins another session: nothing is in force, its counter begins anew."""
        self.context = replace(self.context, first_counter=counter, empty_first=empty_first)
        self.robot = FakeRsi(self.config, self.context, {"Enable": 0.0})
        self._sessions += 1
        self._age = 0

    def restart_numbers(self) -> None:
        """Count the datagrams of both ways from 0 again: what the network does is told by their number."""
        self._sent = [0, 0]

    def cycle(self) -> None:
        """One cycle of the controller."""
        begin = self.cycle_count * PERIOD_S
        self.now_s = begin
        self.run_cycles += not self.stands
        if self.running:
            self.robot.frees["Enable"] = self.force_scale * self.enable
            if self.wrap and self.robot.counter + round(PERIOD_S / MS) > _LAST_COUNTER:
                self.robot.counter -= _LAST_COUNTER + 1
                self.wrapped_at = self.cycle_count
            report = self._report()
            data = self.robot.telegram(report if self.shown is None else self.shown(report))
            self._send(_TELEGRAM, data if self.spoil is None else self.spoil(data), begin + _WIRE_S)
        if self.sense:
            self.read_sensor()
        if self.tracker is not None:
            self.tracker.measure(self._report().T_part_actual, self.force_now(), self.now_s)
        self._until(begin + PERIOD_S)
        self._finish()
        self.cycle_count += 1

    def _instrument(self) -> tuple[Any, Any]:
        """The force sensor's side (``poll``, ``send``, ``close``), and ours: a source of forces."""
        sensor = NetftServer(http_port=None)
        return sensor, sensor_link(sensor.address)

    def force_now(self) -> Float:
        """(3,) N on the tool, part axes."""
        acts = self.feed and not self.stands
        return self._force(self.now_s - self._feed_begin) if acts else np.zeros(3)

    def read_sensor(self) -> None:
        """The sensor's samples of one cycle."""
        self.sensor.poll()
        force = self.force_now() if self.feed and not self.stands else self.idle
        w = self._reading @ np.concatenate([force, np.zeros(3)])
        for noise in self._noise.standard_normal((_SAMPLES, 6)) * _NOISE:
            self.sensor.send(w + noise if self.sensed is None else self.sensed(w + noise))

    def to_loop(self, data: bytes, sender: socket.socket | None = None) -> None:
        """Put a datagram into the loop's socket at once; from the robot's own address unless another one sends it."""
        with contextlib.suppress(ConnectionError, BlockingIOError):
            (self.robot_socket if sender is None else sender).sendto(data, self.link.address)

    def next_telegram(self) -> bytes:
        """The controller's telegram of its next cycle."""
        data = self.robot.telegram(self._report())
        self.robot.counter -= round(PERIOD_S / MS)
        return data

    def _report(self) -> Report:
        return reported(self.robot, self.cycle_count, self.feed, self.run_cycles)

    def _send(self, kind: int, data: bytes, time_s: float) -> None:
        number = self._sent[kind]
        self._sent[kind] += 1
        for delivery in self.ways[kind].decide(number):
            heapq.heappush(self._events, (time_s + delivery.delay_s, next(self._tie), kind, delivery.of(data)))

    def _until(self, end_s: float) -> None:
        """Let the network deliver and the loop act until a time."""
        while True:
            arrival = self._events[0][0] if self._events else np.inf
            if min(arrival, np.inf if self.frozen else self._due) >= end_s:
                return
            if not self.frozen and self._due < arrival:
                self.now_s = max(self.now_s, self._due)
                self.act(due=True)
                continue
            self.now_s = max(self.now_s, arrival)
            received = False
            while self._events and self._events[0][0] <= arrival:
                _, _, kind, data = heapq.heappop(self._events)
                if kind == _ANSWER:
                    self._arrived.append(data)
                else:
                    self.to_loop(data)
                    received = True
            if received and not self.frozen:
                self.act()

    def act(self, *, due: bool = False) -> None:
        """The loop takes what is there and answers; where that is nothing, it waits on, unless its patience is due."""
        received = self.link.wait(0.0)
        if not received and not due:
            return
        self.session.handle_cycle(received)
        self._due = self.now_s + self.session.patience_s
        while True:
            try:
                data = self.robot_socket.recv(65536)
            except (BlockingIOError, ConnectionError):
                return
            self._send(_ANSWER, data, self.now_s + _REPLY_S)

    def _finish(self) -> None:
        mark = f"<IPOC>{self.robot.counter}</IPOC>".encode("ascii")
        if self.running:
            fitting = [data for data in self._arrived if mark in data]
            if not fitting and self.other is not None:
                fitting = [self.other(self.robot.counter)]
            self.robot.answer(fitting[-1] if fitting else self._arrived[-1] if self._arrived else None)
            self._age = self._age + 1 if self.robot.refused else 0
        self._arrived.clear()
        seen = self.seen
        seen.age.append(self._age)
        seen.correction_m.append(self.robot.correction[:3].copy())
        seen.state.append(self.loop.state)
        seen.cause.append(self.loop.cause)
        seen.session.append(self._sessions)
        seen.running.append(not self.robot.stopped)
        seen.run_cycles.append(self.run_cycles)
        result = self.loop.result
        seen.reported.append(Cause(int(result.cause or result.soft or result.degraded)))


def rigged(effort: Effort, *ways: Impairment | None, **given: Any) -> Rig:
    """A rig with seed and sensors as asked for; arguments as those of :class:`Rig`."""
    return Rig(*ways, **{"seed": effort.seed, "sensors": effort.sensors, **given})
