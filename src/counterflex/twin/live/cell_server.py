"""The whole simulated cell on real sockets: controller, force sensor, tracker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.protocols.tracker.telegram import BEAM_BROKEN
from counterflex.twin.devices.commanded_motion import RobotController
from counterflex.twin.devices.datagram_sender import TrackerSender
from counterflex.twin.devices.force_device import ForceDevice
from counterflex.twin.devices.robot_server import RobotServer
from counterflex.twin.devices.strain import StrainSender
from counterflex.twin.laboratory.laboratory import Laboratory
from counterflex.twin.live.live_cell import LiveCell
from counterflex.twin.network.faults import FaultSchedule
from counterflex.twin.plant.force_sensor import ForceSensor
from counterflex.twin.plant.strain_holder import StrainStream

_STEPS_PER_SAMPLE = 2  # integration steps of 0.5 ms per sample of the instruments: 1 kHz


@dataclass(eq=False)
class Instruments:
    """Instruments that read the cell every millisecond."""

    laboratory: Laboratory  # noise, and where the tracker and its target truly are
    force_sensor: ForceSensor | None = None  # as it truly is; or None
    device: ForceDevice | None = None  # what sends its readings; or None
    tracker_peer: tuple[str, int] | None = None  # where poses go; or None
    beam_broken: bool = False  # the tracker does not see its target
    temperature_c: float = 20.0  # of the force sensor
    tracker_faults: FaultSchedule = field(default_factory=FaultSchedule)  # scripted
    tracker_every_s: float = 1e-3  # time between two poses; photogrammetry takes its time
    holder: StrainStream | None = None  # bridges of the instrumented spindle holder, or None
    strain: StrainSender | None = None  # where their readings go
    strain_steps: int = 2  # integration steps for each of their readings

    def __post_init__(self) -> None:
        """Take a noise stream of its own for each instrument."""
        self._force_noise = self.laboratory.noise("live force")
        self._force_scale: Float = np.repeat([self.laboratory.force_n, self.laboratory.moment_nm], 3)
        self._tracker_noise = self.laboratory.noise("live tracker")
        self._tracker: TrackerSender | None = None
        if self.tracker_peer is not None:
            self._tracker = TrackerSender(self.tracker_peer, self.tracker_faults)
        self._tracker_due = 0.0
        self._force_sum: Float = np.zeros(6)
        self._force_count = 0
        self._load: Float = np.zeros(6)
        self._loads = 0

    def step(self, time_s: float) -> None:
        """After each integration step: the amplifiers of the bridges average over the time between their readings."""
        if self.holder is None or self.strain is None:
            return
        self._load += self.holder.load()
        self._loads += 1
        if self._loads == self.strain_steps:
            self.strain.send(*self.holder.sample(self._load / self._loads, time_s), time_s)
            self._load[:], self._loads = 0.0, 0

    def sample(self, cell: LiveCell, time_s: float) -> None:
        """Read and send."""
        if self.force_sensor is not None:
            true = self.force_sensor.true_wrench(cell.plant, cell.plant.truth.gravity_base)
            w = self.force_sensor.reading(true, time_s, self.temperature_c)
            w = w + self._force_scale * self._force_noise.standard_normal(6)
            self._force_sum += w
            self._force_count += 1
            if self.device is not None:
                self.device.send(w, time_s)
        if self._tracker is not None and time_s > self._tracker_due - 1e-9:
            self._tracker_due = max(self._tracker_due + self.tracker_every_s, time_s)
            self._send_pose(self._tracker, cell, time_s)
        elif self._tracker is not None:
            self._tracker.idle(time_s)

    def mean_force(self) -> Float | None:
        """(6,) N, N m: mean reading of the force sensor since the last call; None where there was none."""
        if self._force_count == 0:
            return None
        mean: Float = self._force_sum / self._force_count
        self._force_sum, self._force_count = np.zeros(6), 0
        return mean

    def _send_pose(self, tracker: TrackerSender, cell: LiveCell, time_s: float) -> None:
        lab = self.laboratory
        T = pose.inverse(lab.T_base_tracker) @ cell.plant.tcp_pose() @ lab.T_tcp_target
        T[:3, 3] += lab.tracker_m * self._tracker_noise.standard_normal(3)
        T[:3, :3] = rotation.exp(lab.tracker_rad * self._tracker_noise.standard_normal(3)) @ T[:3, :3]
        tracker.send(T, time_s, status=BEAM_BROKEN if self.beam_broken else 0, sigma_m=lab.tracker_m)

    def close(self) -> None:
        """Free the sockets."""
        if self._tracker is not None:
            self._tracker.close()
        if self.device is not None:
            self.device.close()
        if self.strain is not None:
            self.strain.close()


class CellServer(RobotServer):
    """Runs a live cell behind its protocols until the program has ended.

    Args:
        controller: Its side of the protocol.
        peer: Where telegrams go: host and port of the sensor program.
        own_force: Told once per telegram what the force sensor showed, for a controller that sends it itself.
        settings: Further arguments of :class:`counterflex.twin.devices.robot_server.RobotServer`.
    """

    def __init__(
        self,
        cell: LiveCell,
        controller: RobotController,
        peer: tuple[str, int],
        instruments: Instruments | None = None,
        own_force: Callable[[Float], None] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(cell, controller, peer, **settings)
        self.cell, self.instruments, self._own_force = cell, instruments, own_force
        if instruments is not None:
            cell.on_step = self._on_step  # type: ignore[method-assign]

    def _on_step(self, i: int) -> None:
        if self.instruments is None:
            return
        time_s = self.cell.time_s + (i + 1) * self.cell.plant.step_s
        self.instruments.step(time_s)
        if (i + 1) % _STEPS_PER_SAMPLE == 0:
            self.instruments.sample(self.cell, time_s)

    def poll(self) -> None:
        """Take what was asked of the instruments, and hand on what the controller measures itself."""
        if self.instruments is not None and self._own_force is not None:
            mean = self.instruments.mean_force()
            if mean is not None:
                self._own_force(mean)
        if self.instruments is not None and self.instruments.device is not None:
            self.instruments.device.poll()

    def close(self) -> None:
        """Free the sockets."""
        super().close()
        if self.instruments is not None:
            self.instruments.close()
