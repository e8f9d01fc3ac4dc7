"""A figure derived from a whole cell that shows mistakes of units: how far its tool tip yields (R25)."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell
from counterflex.robot.elasticity.compliance import deflection

LEAST_M_PER_N: Final = 0.1 * UM
MOST_M_PER_N: Final = 30.0 * UM
_POSES_DEG: Final = (
    (0.0, -90.0, 90.0, 0.0, 45.0, 0.0),
    (0.0, -70.0, 110.0, 0.0, 50.0, 0.0),
    (0.0, -110.0, 120.0, 0.0, 60.0, 0.0),
)


def softest(cell: Cell) -> Float:
    """Compliance of the tool tip in its softest direction at three poses, (3,) m/N.

    The largest singular value of the translational 3 x 3 compliance. Published figures of milling robots lie between
    0.5 and 10 um/N (Denkena2018, Berger2013).
    """
    out = np.zeros(len(_POSES_DEG))
    for k, pose in enumerate(_POSES_DEG):
        columns = [deflection(cell.chain, np.radians(pose), np.eye(6)[axis])[:3] for axis in range(3)]
        out[k] = float(np.linalg.norm(np.array(columns).T, 2))
    return out


def require_plausible(cell: Cell) -> None:
    """Refuse a cell that no milling robot can be.

    Raises:
        ModelError: The compliance at one of three poses is outside of 0.1 to 30 um/N.
    """
    weakest = softest(cell)
    if np.all((weakest >= LEAST_M_PER_N) & (weakest <= MOST_M_PER_N)):
        return
    worst = weakest[int(np.argmax(np.abs(np.log(np.maximum(weakest, 1e-30) / np.sqrt(LEAST_M_PER_N * MOST_M_PER_N)))))]
    raise ModelError(
        "the tool tip yields as no milling robot does",
        where=str(cell.path),
        value=f"{worst / UM:.3g} um/N",
        limit=f"{LEAST_M_PER_N / UM:g} to {MOST_M_PER_N / UM:g} um/N",
        hint="Is a compliance given in another unit?",
    )
