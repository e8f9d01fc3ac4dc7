"""Senses of a session: sensors drained into the inputs of the step, and how old the reading of each is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MS, NS
from counterflex.geometry import pose
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session.spikes import SpikeGate
from counterflex.protocols.session.tare import Tare
from counterflex.protocols.session.tool_change import ToolChange
from counterflex.protocols.tracker.kernel import tool_pose
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.sensing.motor_torque import MotorTorque
from counterflex.runtime.sensing.pair_wrench import PairWrench
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.sensing.spindle_inertia import SpindleInertia
from counterflex.runtime.sensing.strain_wrench import StrainWrench
from counterflex.runtime.settings import ForceMode, TrackerMode
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.place import FAULT_LOST
from counterflex.signals.arrival import ArrivalClock

_FORGET_CYCLES = 10_000
_READY = int(State.READY)
_SATURATED, _OFFSET = int(Cause.FORCE_SATURATED), int(Cause.FORCE_OFFSET)
_TRACKER_LOST, _FORCE_STALE = int(Cause.TRACKER_LOST), int(Cause.FORCE_STALE)
_SCATTERED, _STOPPED = int(Cause.TELEGRAMS_SCATTERED), int(Cause.TELEGRAMS_STOPPED)
_LONGEST_PAUSE: Final = 4
"""Longest usual pause of a force sensor, cycles: 100 Hz leaves out 2 at 4 ms."""
_PAUSE_KEPT: Final = 0.995
"""Share of the longest pause that is kept from reading to reading: what was longer once is forgotten in a second."""
_ROUNDED: Final = 0.2
"""Pause that is none any more."""


ProcessWrench: TypeAlias = SensorWrench | StrainWrench | PairWrench
"""What makes a process wrench of a reading."""


@dataclass(frozen=True, eq=False)
class Sensing:
    """Sensors of an online session, beside the robot's telegrams."""

    force: ForceSource | None = None  # force sensor, or None
    wrench: ProcessWrench | None = None  # its reading as process wrench; needed with ``force``
    tare: Tare | None = None  # how its zero is taken; None: of the wrench
    tools: ToolChange | None = None  # tools of the plan, where it has several; None: one and the same
    inertia: SpindleInertia | None = None  # takes the inertia of the spindle out of it, or None
    # torque of the motor currents that the robot sends, for the estimator; None leaves them
    currents: MotorTorque | None = None
    angles: AxisCheck | None = None  # holds the axis angles of each telegram against its poses; None: they are believed
    tracker: TrackerLink | None = None
    T_part_tracker: Float | None = None  # (4, 4) tracker in the part frame; needed with ``tracker``
    T_target_tcp: Float | None = None  # (4, 4) tool tip in the tracker's target; needed with ``tracker``


class Senses:
    """Reads the sensors of a session, once per cycle each.

    Args:
        loop: The step whose inputs are filled.
        tare: Zero of the force sensor.
        settle_cycles: Good telegrams in a row before the correction may be armed.
        clock_ns: Monotonic clock.

    Attributes:
        force_age: Cycles since the last good reading of the force sensor.
        tracker_age: The same of the tracker.
        current_age: The same of the motor currents.
        since: Cycles of the robot since the inertia of the spindle was last taken out.
    """

    def __init__(
        self, sensing: Sensing, link: RobotLink, loop: Loop, tare: Tare, settle_cycles: int, clock_ns: Callable[[], int]
    ) -> None:
        force, tracker, currents = sensing.force, sensing.tracker, sensing.currents
        T_part_tracker, T_target_tcp = sensing.T_part_tracker, sensing.T_target_tcp
        self._link, self._loop, self._force, self._tracker, self._tare = link, loop, force, tracker, tare
        self._wrench, self._inertia, self._motors = sensing.wrench, sensing.inertia, currents
        self._settle, self._clock_ns = settle_cycles, clock_ns
        self._given = loop.quick_given
        self._torque: Float = loop.given.torque
        self._q: Float = loop.given.q
        self._w: Float = loop.given.wrench
        self._nominal: Float = loop.given.nominal
        self._actual: Float = loop.given.actual
        self._in_effect: Float = loop.step_state.in_effect[:3]
        self._stand: Float = np.zeros(12)
        self._T_part_tracker = np.eye(4) if T_part_tracker is None else np.ascontiguousarray(T_part_tracker)
        self._T_target_tcp = np.eye(4) if T_target_tcp is None else np.ascontiguousarray(T_target_tcp)
        fused = loop.settings.force == ForceMode.FUSED
        self._needs_force = loop.settings.force in (ForceMode.MEASURED, ForceMode.PILOT, ForceMode.SCALE)
        self._needs_force |= fused and force is not None
        self._needs_tracker = loop.settings.tracker != TrackerMode.NONE or (fused and tracker is not None)
        self._sources = int(Source.FORCE) * (force is not None) | int(Source.TRACKER) * (tracker is not None)
        self._sources |= int(Source.CURRENTS) * (currents is not None)
        self._arrival = ArrivalClock(loop.settings.delays.tracker_s)
        stale_s = loop.settings.fusion.tracker_stale_s if fused else 0.0
        self._tracker_stale = max(loop.settings.stale_cycles, round(stale_s / loop.settings.period_s))
        self.force_age = self.tracker_age = self.current_age = _FORGET_CYCLES
        self.since = 0
        self._spikes, self._pause = SpikeGate(), 0.0
        self._time_zero_ns = clock_ns()

    @property
    def spikes(self) -> int:
        """Spikes of the force sensor that were left out."""
        return self._spikes.count

    @property
    def set_back(self) -> int:
        """Number of times that the tracker's clock was set back."""
        return self._arrival.set_back

    def fill_ages(self) -> None:
        """Write into the inputs of the step which sensors there are, and how old their readings are."""
        given = self._given
        given.force_age = self._overdue if self._needs_force or self._force is None else 0
        given.tracker_age, given.current_age = self.tracker_age, self.current_age
        given.sources = self._sources

    def read_force(self, soft: int, good_telegrams: int) -> int:
        """Drain the force sensor into the wrench of the step.

        Args:
            soft: Cause of a hold that is known already, or 0.
            good_telegrams: In a row; the sensor's zero is taken once there are enough.

        Returns:
            Cause of a hold, or 0.
        """
        if self._force is None or self._wrench is None:
            return soft
        force = self._force
        good = force.drain()
        if force.first >= 0:
            self._loop.take(force.samples, force.good, force.first)
        if force.saturated or force.frozen or good == 0:
            self.force_age += 1  # where there is a plan, the step goes on by it for a while, then holds
            return soft or (_SATURATED if force.saturated else 0)
        self._learn_pause()
        w_sensor = self._spikes.cleaned(force.w_sensor, force.samples, good)
        if w_sensor is None:  # the last one goes on
            self.force_age = 0
            return soft
        age = (self._clock_ns() - self._time_zero_ns) * 1e-9
        w = self._wrench(self._q, w_sensor, age)
        if self._wrench.doubt:
            self.force_age += 1
            return soft or self._wrench.doubt
        self.force_age = 0
        soft = self._watch_zero(w, soft, good_telegrams)
        w -= self._tare.zero
        if self._inertia is None:
            self._w[:] = w
            self._loop.on_tool(self._w)
        elif self.since > 0:
            self._w[:] = self._without_inertia(self._inertia, w)
        return soft

    def _watch_zero(self, w: Float, soft: int, good_telegrams: int) -> int:
        """Take the sensor's zero while the loop is idle; cause of a hold where the zero was refused, else ``soft``."""
        tare, idle = self._tare, self._loop.quick_result.state <= _READY
        if not tare.accepted and idle and good_telegrams > self._settle // 2:
            tare.take(w)
        return _OFFSET if soft == 0 and self._needs_force and tare.refusals else soft

    def _learn_pause(self) -> None:
        """Learn how many cycles a slow sensor leaves out between two readings, before the loop is armed."""
        if self._loop.quick_result.state > _READY or self.force_age >= _FORGET_CYCLES:
            return
        self._pause = max(float(min(self.force_age, _LONGEST_PAUSE)), _PAUSE_KEPT * self._pause)

    @property
    def _overdue(self) -> int:
        """Cycles by which the reading is older than those of this sensor usually get."""
        return max(0, self.force_age - math.ceil(self._pause - _ROUNDED))

    def _without_inertia(self, inertia: SpindleInertia, w: Float) -> Float:
        """From where the motors stand: as the controller says, else as it should answer what was sent."""
        if not self._link.fill_actual(self._stand):
            self._stand[:] = self._nominal
            self._stand[9:] += self._in_effect
        since, self.since = self.since, 0
        return inertia(self._stand, w, self._loop.compliance, since)

    def read_tracker(self) -> int:
        """Drain the tracker into the tool's pose of the step: 1 where a new one came, else 0."""
        self.tracker_age += 1
        if self._tracker is None or not self._tracker.drain():
            return 0
        self.tracker_age = 0
        tool_pose(self._T_part_tracker, self._tracker.T_tracker_target, self._T_target_tcp, self._actual, 0)
        self._given.tracker_late = self._arrival.age(self._link.counter * MS, self._tracker.time_ns * NS)
        self._given.tracker_sigma = self._tracker.sigma_m
        return 1

    def read_currents(self, received: bool) -> None:
        """Turn the motor currents of a telegram into torques, where they are used."""
        self.current_age += 1
        if received and self._motors is not None and self._link.fill_currents(self._motors.current):
            self._motors(self._q, self._torque)
            self.current_age = 0

    def lacking(self, good_telegrams: int, cycles: int, silent_cycles: int = 0) -> int:
        """Cause against arming: a sensor that is needed is silent, or the telegrams do not come steadily; or 0."""
        if self._needs_tracker and self.tracker_age >= self._tracker_stale:
            return _TRACKER_LOST
        if self._needs_force and self._overdue >= self._loop.settings.stale_cycles:
            return _FORCE_STALE
        settle = self._settle
        if silent_cycles > 0:  # none comes: nothing is scattered
            return _STOPPED if silent_cycles >= FAULT_LOST else 0
        return _SCATTERED if good_telegrams < settle < cycles - 2 * settle else 0

    def healthy(self, good_telegrams: int) -> int:
        """1 where telegrams and every sensor that is needed are as they must be for arming, else 0."""
        force = not self._needs_force or (self._tare.accepted and self._overdue == 0)
        tracker = not self._needs_tracker or self.tracker_age < self._tracker_stale
        return int(good_telegrams >= self._settle and force and tracker)


def tracker_frames(T_base_part: Float, T_base_tracker: Float, T_tcp_target: Float) -> tuple[Float, Float]:
    """``T_part_tracker`` and ``T_target_tcp`` of identified frames."""
    T_part_tracker: Float = pose.inverse(T_base_part) @ T_base_tracker
    return T_part_tracker, pose.inverse(T_tcp_target)
