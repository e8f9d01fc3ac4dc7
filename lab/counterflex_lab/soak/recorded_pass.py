"""One uncorrected pass of the simulated cell, kept cycle by cycle, so that it can be played for hours at no cost."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.geometry import pose, rotation
from counterflex.twin.laboratory.laboratory import Laboratory
from counterflex.twin.live.live_cell import LiveCell, Report
from counterflex.twin.plant.force_sensor import ForceSensor
from counterflex.twin.plant.plant import Plant

SAMPLES: Final = 4
"""Readings of the instruments in a cycle of 4 ms."""
_LONGEST_LAG: Final = 50
"""Cycles by which a robot may trail its program."""


@dataclass(frozen=True, eq=False)
class RecordedPass:
    """Reports of a controller and its instruments over n cycles of 4 ms."""

    T_part_nominal: Float  # (n, 4, 4) commanded pose
    T_part_actual: Float  # (n, 4, 4) pose by the encoders
    q_command: Float  # (n, 6) rad
    q_actual: Float  # (n, 6) rad
    w_sensor: Float  # (n, 4, 6) N, N m: readings with noise
    p_tracker_target: Float  # (n, 4, 3) m: readings with noise
    quat_wxyz: Float  # (n, 4, 4) of the same readings
    R_tracker_part: Float  # (3, 3) to turn a correction into the tracker's frame

    @property
    def cycles(self) -> int:
        """Number of cycles."""
        return len(self.q_command)

    def there_and_back(self, k: int) -> int:
        """Row of cycle ``k`` when the pass is played to its end, back to its start, and so on."""
        turn = max(1, 2 * (self.cycles - 1))
        k %= turn
        return k if k < self.cycles else turn - k

    @functools.cached_property
    def lag(self) -> int:
        """Cycles by which the robot trails its program: where the actual path lies nearest to the commanded one."""
        nominal, actual = self.T_part_nominal[:, :3, 3], self.T_part_actual[:, :3, 3]
        most = min(_LONGEST_LAG, self.cycles - 1)
        off = [np.mean((actual[d:] - nominal[: self.cycles - d]) ** 2) for d in range(most + 1)]
        return int(np.argmin(off))

    def reached(self, k: int) -> int:
        """Row that shows the robot where the program is in cycle ``k``: :attr:`lag` rows later, also on the way back.

        Backwards, the recorded rows as they are would show a robot that is ahead of its program.
        """
        return min(self.cycles - 1, self.there_and_back(k) + self.lag)


class _Readings:
    """Force and pose by the instruments, one each every ``steps`` steps of the plant."""

    def __init__(
        self, plant: Plant, sensor: ForceSensor, laboratory: Laboratory, T_tracker_base: Float, steps: int
    ) -> None:
        self._plant, self._sensor, self._laboratory, self._steps = plant, sensor, laboratory, steps
        self._T_tracker_base, self._noise = T_tracker_base, laboratory.noise("pass")
        self._spread = np.r_[np.full(3, laboratory.force_n), np.full(3, laboratory.moment_nm)]
        self.w: list[Float] = []
        self.p: list[Float] = []
        self.quat: list[Float] = []

    def after_step(self, i: int) -> None:
        if (i + 1) % self._steps:
            return
        plant, laboratory, noise = self._plant, self._laboratory, self._noise
        true = self._sensor.true_wrench(plant, plant.truth.gravity_base)
        self.w.append(self._sensor.reading(true, 0.0, 20.0) + self._spread * noise.standard_normal(6))
        T_tracker_target = self._T_tracker_base @ plant.tcp_pose() @ laboratory.T_tcp_target
        self.p.append(T_tracker_target[:3, 3] + laboratory.tracker_m * noise.standard_normal(3))
        turn = rotation.exp(laboratory.tracker_rad * noise.standard_normal(3))
        self.quat.append(rotation.quat_wxyz(turn @ T_tracker_target[:3, :3]))


def record_pass(
    cell: LiveCell, sensor: ForceSensor, laboratory: Laboratory, most_cycles: int, progress: Progress = silent
) -> RecordedPass:
    """Run a cell without correction from shortly before the first contact on.

    Args:
        cell: With a cycle of 4 ms, not started.
        sensor: Force sensor on it.
        laboratory: Its tracker, and the noise of both.
        most_cycles: End there, or with the program.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        InputError: Another cycle.
    """
    steps = round(cell.period_s / (SAMPLES * cell.plant.step_s))
    if abs(cell.period_s - 4e-3) > 1e-9:
        raise InputError("cycle of the cell", value=cell.period_s, limit="4 ms")
    T_tracker_base = pose.inverse(laboratory.T_base_tracker)
    readings = _Readings(cell.plant, sensor, laboratory, T_tracker_base, steps)
    cell.on_step = readings.after_step  # type: ignore[method-assign]
    cell.skip_to_contact()
    cell.start()
    nothing = np.zeros(6)
    reports: list[Report] = []
    while len(reports) < most_cycles:
        report = cell.advance(nothing)
        reports.append(report)
        if len(reports) % 100 == 0:
            progress(len(reports) / most_cycles, "recording a pass")
        if report.finished:
            break
    n = len(reports)
    return RecordedPass(
        T_part_nominal=np.array([r.T_part_nominal for r in reports]),
        T_part_actual=np.array([r.T_part_actual for r in reports]),
        q_command=np.array([r.q_command for r in reports]),
        q_actual=np.array([r.q_actual for r in reports]),
        w_sensor=np.array(readings.w).reshape(n, SAMPLES, 6),
        p_tracker_target=np.array(readings.p).reshape(n, SAMPLES, 3),
        quat_wxyz=np.array(readings.quat).reshape(n, SAMPLES, 4),
        R_tracker_part=T_tracker_base[:3, :3] @ cell.T_base_part[:3, :3],
    )
