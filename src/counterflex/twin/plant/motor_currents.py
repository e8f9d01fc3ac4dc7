"""Motor currents of the simulated robot, as its controller shows them: torque constants, ripple, resolution.

The torque of a drive on the link side is its current times a constant: that of the motor times the gear ratio. The
data sheet's are :data:`DATA_SHEET_NM_A`; those of a robot differ by a few percent (magnets, temperature, efficiency).
"""

from __future__ import annotations

import random
from typing import Final

import numpy as np

from counterflex.core.arrays import Float

DATA_SHEET_NM_A: Final = (320.0, 340.0, 300.0, 190.0, 175.0, 110.0)
"""N m on the link side per A, of the axes 1 to 6: motors of 1.2 to 1.5 N m/A behind gears of 90 to 250."""
SHARE: Final = 0.03
"""Standard deviation of a robot's constants from the data sheet's."""
RIPPLE_A: Final = 0.05
"""Standard deviation of the mean over a cycle: cogging and the current sensor."""


class MotorCurrents:
    """What the controller of one robot shows."""

    def __init__(self, seed: int) -> None:
        rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-currents-1:{seed}").getrandbits(64)))
        self._per_nm: Float = 1.0 / (np.array(DATA_SHEET_NM_A) * (1.0 + SHARE * rng.standard_normal(6)))
        self._rng = rng

    def __call__(self, drive_torque: Float) -> Float:
        """(6,) A from the mean torque of the drives over a cycle (6,) N m, both positive with the axis."""
        current: Float = drive_torque * self._per_nm + RIPPLE_A * self._rng.standard_normal(6)
        return current
