"""Senses of a session: sensors drained into the inputs of the step, and how old the reading of each is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float
from counterflex.core.entry_calls import address_of
from counterflex.core.records import attributes, records
from counterflex.geometry import pose
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session import senses_kernel as own
from counterflex.protocols.session.spikes import GATE
from counterflex.protocols.session.tare import Tare
from counterflex.protocols.session.tool_change import ToolChange
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.runtime.cycle import take_fast
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.sensing.motor_torque import MotorTorque
from counterflex.runtime.sensing.pair_wrench import PairWrench
from counterflex.runtime.sensing.sensor_wrench import ARRAYS as WRENCH_ARRAYS, SensorWrench, sensor_wrench
from counterflex.runtime.sensing.spindle_inertia import SpindleInertia
from counterflex.runtime.sensing.strain_wrench import StrainWrench
from counterflex.runtime.settings import ForceMode, TrackerMode
from counterflex.runtime.state.supervisor import State
from counterflex.signals.arrival import ArrivalClock

_READY = int(State.READY)


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
        records: (1,) :data:`counterflex.protocols.session.senses_kernel.SENSES`; ``now`` are the same numbers, read and
            written faster.
        at_once: The force sensor's reading becomes the wrench in one kernel, once its zero is known.
        table: Arrays of the kernels.
        needs_tracker: The correction needs the tracker.
        tracker_stale: Cycles without a pose from which on it is lost.
        since: Cycles of the robot since the inertia of the spindle was last taken out.
    """

    def __init__(
        self, sensing: Sensing, link: RobotLink, loop: Loop, tare: Tare, settle_cycles: int, clock_ns: Callable[[], int]
    ) -> None:
        force, tracker, currents = sensing.force, sensing.tracker, sensing.currents
        self._link, self._loop, self._force, self._tracker, self._tare = link, loop, force, tracker, tare
        self._wrench, self._inertia, self._motors = sensing.wrench, sensing.inertia, currents
        self._settle, self._clock_ns = settle_cycles, clock_ns
        self._given, self._result = loop.quick_given, loop.quick_result
        self._torque: Float = loop.given.torque
        self._q: Float = loop.given.q
        self._w: Float = loop.given.wrench
        self._nominal: Float = loop.given.nominal
        self._in_effect: Float = loop.step_state.in_effect[:3]
        self._stand: Float = np.zeros(12)
        fused = loop.settings.force == ForceMode.FUSED
        needs_force = loop.settings.force in (ForceMode.MEASURED, ForceMode.PILOT, ForceMode.SCALE)
        self.needs_tracker = loop.settings.tracker != TrackerMode.NONE or (fused and tracker is not None)
        sources = int(Source.FORCE) * (force is not None) | int(Source.TRACKER) * (tracker is not None)
        sources |= int(Source.CURRENTS) * (currents is not None)
        self._arrival = ArrivalClock(loop.settings.delays.tracker_s)
        stale_s = loop.settings.fusion.tracker_stale_s if fused else 0.0
        self.tracker_stale = max(loop.settings.stale_cycles, round(stale_s / loop.settings.period_s))
        self._gate = records(GATE)
        self._gate_now: Any = attributes(self._gate)
        self._cleaned: Float = self._gate[0].w
        self.records = records(own.SENSES)
        self.now: Any = attributes(self.records)
        self._begin(needs_force=needs_force or (fused and force is not None), sources=sources)
        self.table = self._table(sensing)
        # What else than a flange sensor makes the wrench, or goes on with it, is called between two kernels.
        self.at_once = isinstance(self._wrench, SensorWrench) and self._inertia is None
        self.since = 0
        self.time_zero_ns = clock_ns()

    def _begin(self, *, needs_force: bool, sources: int) -> None:
        now = self.now
        now.force_age = now.tracker_age = now.current_age = own.FORGET_CYCLES
        now.needs_force, now.has_force = int(needs_force), int(self._force is not None)
        now.sources = sources
        now.take_fast, now.wrench = address_of(take_fast), address_of(sensor_wrench)

    def _table(self, sensing: Sensing) -> ArrayTable:
        """Arrays of the kernels."""
        loop, force, tracker, wrench = self._loop, sensing.force, sensing.tracker, sensing.wrench
        loops, loop_rows = loop.rows
        T_part_tracker, T_target_tcp = (
            np.eye(4) if T is None else np.ascontiguousarray(T) for T in (sensing.T_part_tracker, sensing.T_target_tcp)
        )
        return ArrayTable(
            own.ARRAYS,
            senses=self.records,
            gate=self._gate,
            loop=loops,
            loop_table=loop_rows,
            wrench=wrench.rows if isinstance(wrench, SensorWrench) else records(WRENCH_ARRAYS),
            zero=self._tare.zero,
            samples=np.zeros((0, 6)) if force is None else force.samples,
            w_sensor=np.zeros(6) if force is None else force.w_sensor,
            w_part=wrench.w_part if isinstance(wrench, SensorWrench) else np.zeros(6),
            arrival=self._arrival.records,
            T_part_tracker=T_part_tracker,
            T_tracker_target=np.eye(4) if tracker is None else tracker.T_tracker_target,
            T_target_tcp=T_target_tcp,
        )

    @property
    def spikes(self) -> int:
        """Spikes of the force sensor that were left out."""
        return int(self._gate_now.count)

    @property
    def set_back(self) -> int:
        """Number of times that the tracker's clock was set back."""
        return self._arrival.set_back

    def read_force(self, good_telegrams: int) -> None:
        """Drain the force sensor into the wrench of the step; a cause of a hold is written.

        Args:
            good_telegrams: In a row; the sensor's zero is taken once there are enough.
        """
        force, tare = self._force, self._tare
        if force is None or self._wrench is None:
            return
        good = force.drain()
        due = not tare.accepted and self._result.state <= _READY and good_telegrams > self._settle // 2
        if self.at_once and not due:
            own.read_force(
                self.table.rows,
                good,
                force.good,
                force.first,
                force.saturated,
                force.frozen,
                self._age_s(),
                tare.refusals,
            )
        else:
            self._read_force_in_steps(force, self._wrench, good, due)

    def _age_s(self) -> float:
        """Time since the sensor's zero was set."""
        return (self._clock_ns() - self.time_zero_ns) * 1e-9

    def _read_force_in_steps(self, force: ForceSource, wrench: ProcessWrench, good: int, due: bool) -> None:
        """As :func:`.senses_kernel.read_force`, with what Python computes between its steps.

        Args:
            good: Good samples of the drain.
            due: The sensor's zero is being taken.
        """
        rows, now = self.table.rows, self.now
        kind = own.take_reading(rows, force.samples, good, force.good, force.first, force.saturated, force.frozen)
        if kind == own.NONE:
            return
        w = wrench(self._q, self._cleaned if kind == own.CLEANED else force.w_sensor, self._age_s())
        if wrench.doubt:
            now.force_age += 1
            now.soft = now.soft or wrench.doubt
            return
        if due:
            self._tare.take(w)
        own.use_wrench(rows, w, self._tare.refusals, self._inertia is None)
        if self._inertia is not None and self.since > 0:
            self._w[:] = self._without_inertia(self._inertia, w)

    def _without_inertia(self, inertia: SpindleInertia, w: Float) -> Float:
        """From where the motors stand: as the controller says, else as it should answer what was sent."""
        if not self._link.fill_actual(self._stand):
            self._stand[:] = self._nominal
            self._stand[9:] += self._in_effect
        since, self.since = self.since, 0
        return inertia(self._stand, w, self._loop.compliance, since)

    def read_tracker(self) -> int:
        """Drain the tracker into the tool's pose of the step: 1 where a new one came, else 0."""
        tracker, fresh, stamp_ns, sigma_m = self._tracker, False, 0, 0.0
        if tracker is not None and tracker.drain():
            fresh, stamp_ns, sigma_m = True, tracker.time_ns, tracker.sigma_m
        return own.read_pose(self.table.rows, fresh, self._link.counter, stamp_ns, sigma_m)

    def read_currents(self, received: bool) -> None:
        """Turn the motor currents of a telegram into torques, where they are used."""
        self.now.current_age += 1
        if received and self._motors is not None and self._link.fill_currents(self._motors.current):
            self._motors(self._q, self._torque)
            self.now.current_age = 0


def tracker_frames(T_base_part: Float, T_base_tracker: Float, T_tcp_target: Float) -> tuple[Float, Float]:
    """``T_part_tracker`` and ``T_target_tcp`` of identified frames."""
    T_part_tracker: Float = pose.inverse(T_base_part) @ T_base_tracker
    return T_part_tracker, pose.inverse(T_tcp_target)
