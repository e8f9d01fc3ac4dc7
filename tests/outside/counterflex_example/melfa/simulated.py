"""The controller's side: the same lines, and no import of the link."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MS
from counterflex.geometry import rotation
from counterflex.twin.devices.commanded_motion import Report

from . import telegram

if TYPE_CHECKING:
    from counterflex.app.run.robot_links import ControllerOrder


class SimulatedMelfa:
    """One session; see :class:`counterflex.twin.devices.commanded_motion.RobotController`."""

    guides, only_sends, feed_hold, override = False, False, False, 1.0
    late, stopped, refused, stat, enabled = 0, "", "", 0, False

    def __init__(self, axes: Any, cycle_s: float, timeout_cycles: int) -> None:
        self.cycle_s, self._axes, self._timeout = cycle_s, axes, timeout_cycles
        self.counter = 1_000_000
        self.correction: Float = np.zeros(6)
        self.axes: Float = np.zeros(6)

    def telegram(self, report: Report) -> bytes:
        """The telegram of the next cycle."""
        self.counter += round(self.cycle_s / MS)
        T = report.T_part_nominal
        turns = rotation.to_zyx(T[:3, :3]) / DEG
        axes = self._axes.shown(report.q_command) / DEG
        return telegram.line("R", self.counter, [float(self.enabled), *(T[:3, 3] / MM), *turns, *axes])

    def answers(self, data: bytes) -> bool:
        """Whether a datagram carries the counter of the newest telegram."""
        return data.startswith(f"C {self.counter} ".encode("ascii"))

    def answer(self, data: bytes | None) -> None:
        """What came in the cycle, or None; the last correction stays in force without one."""
        found = None if data is None or not self.answers(data) else telegram.read("C", data, 7)
        self.refused = "" if found is not None else "no answer" if data is None else "unreadable"
        if found is None:
            self.late += 1
            self.stopped = "timeout" if self.late >= self._timeout else self.stopped
            return
        numbers = np.array(found[1])
        self.correction[:3], self.correction[3:] = numbers[:3] * MM, numbers[3:6] * DEG
        self.stat = int(bool(np.any(self.correction)))
        if numbers[6] > 0.5:
            self.stopped = "Stop"

    def pose_correction(self) -> Float:
        """(6,) m and rotation vector, part axes."""
        return self.correction.copy()

    def guided_pose(self) -> None:
        """None: a program is corrected."""


def controller(order: ControllerOrder) -> Any:
    """Controller of the simulated cell."""
    from counterflex.app.robot_axes import axes_in
    from counterflex.app.run.robot_links import SimulatedController

    online = order.cell.tables.online
    assert online is not None
    made = SimulatedMelfa(axes_in(order.cell, "melfa")[0], online.period_ms * MS, int(order.values["timeout_cycles"]))
    return SimulatedController(made, ("127.0.0.1", int(order.values["port"])))
