"""Motor currents as the controller of a story shows them: weight, process, friction; and what falsifies them.

``c i = -(weight + J^T w + friction)``, as :mod:`counterflex.runtime.sensing.motor_torque` reads them.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.elasticity.play import axis_torque
from counterflex.runtime.sensing.motor_torque import MotorTorque
from counterflex.twin.plant.drives import DATA_SHEET_NM_A, MotorCurrents
from counterflex_lab.composed import bench
from counterflex_lab.composed.story import Active
from counterflex_lab.faults.demonstration import demo_cell

_FRICTION_NM: Final = np.array([60.0, 60.0, 60.0, 20.0, 20.0, 20.0])
_WEIGHED: Final = 0.02
"""Standard deviation of the true weight about the model's, as a share."""


@functools.cache
def _weight() -> Float:
    """(n, 6) N m of the weight at each row of the program."""
    return axis_torque(demo_cell().chain, bench.program().q)


@functools.cache
def _per_force() -> Float:
    """(n, 6, 3) N m about the axes per N on the tool, part axes."""
    own = bench.program()
    J = jacobian(demo_cell().chain, own.q)
    out: Float = np.swapaxes(J[:, :3], 1, 2) @ own.T_base_part[:3, :3]
    return out


def read_back() -> MotorTorque:
    """Torques of the currents, by the data sheet, as the loop takes them."""
    return MotorTorque(demo_cell().chain, np.array(DATA_SHEET_NM_A))


class Motors(MotorCurrents):
    """The drives.

    Args:
        seed: Of the story.
        active: Faults that act.
        rng: Its chance.
    """

    def __init__(self, seed: int, active: Active, rng: np.random.Generator) -> None:
        super().__init__(seed)
        self._active, self._chance = active, rng
        self._heavier = 1.0 + _WEIGHED * float(rng.standard_normal())
        self._before = 0
        self._turned: Float = np.zeros(6)
        self._shown: Float | None = None
        self._axis = int(rng.integers(0, 6))

    def torque(self, row: int, force: Float) -> Float:
        """(6,) N m of the drives on the link side.

        Args:
            row: Of the program.
            force: (3,) N on the tool, part axes.
        """
        if row != self._before:
            q = bench.program().q
            self._turned, self._before = np.sign(q[row] - q[self._before]), row
        out: Float = -(self._heavier * _weight()[row] + _per_force()[row] @ force + _FRICTION_NM * self._turned)
        return out

    def __call__(self, drive_torque: Float) -> Float:
        """(6,) A, as the controller sends them."""
        now, size = self._active.now, self._active.size
        out = super().__call__(drive_torque)
        if "currents-unit" in now:
            out = out * size("currents-unit")
        if "currents-off" in now:
            out[self._axis] += size("currents-off")
        if "currents-frozen" in now and self._shown is not None:
            return self._shown
        self._shown = out
        return out

    def left_out(self, telegram: bytes) -> bytes:
        """The telegram without the currents, where they are to be missing."""
        if "currents-missing" not in self._active.now or self._chance.random() >= self._active.size("currents-missing"):
            return telegram
        begin = telegram.find(b"<MACur")
        return telegram if begin < 0 else telegram[:begin] + telegram[telegram.index(b">", begin) + 1 :]
