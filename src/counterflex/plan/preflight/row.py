"""One line of the preflight's table: what was checked, how far from its limit, where, and what to do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float

Verdict = Literal["ok", "warning", "fail", "not looked at"]
NOT_LOOKED_AT: Final = "not looked at"
RANK: Final = {"ok": 0, NOT_LOOKED_AT: 1, "warning": 2, "fail": 3}
"""From harmless to what stops a program."""


@dataclass(frozen=True)
class Row:
    """A check of a program and its worst place.

    Attributes:
        check: What is checked.
        verdict: ``fail`` is a hard check that failed: the program is not to be run. ``warning``: it runs, and less
            accurately or more slowly than programmed. ``not looked at``: the check was not made; ``missing`` names the
            key without which it cannot be made, ``what`` another reason.
        value: The worst value, SI; None where there is none.
        limit: What it is compared with, SI, or None.
        unit: SI unit of both, ``""`` for numbers.
        point: Row of the path where it is worst, or None.
        what: Which axis, which bodies, how many.
        missing: Keys of the cell file without which the check cannot be made, for ``not looked at``.
        advice: What to do.
    """

    check: str
    verdict: Verdict
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    point: int | None = None
    what: str = ""
    missing: str = ""
    advice: str = ""


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the checks compare with; None is not known.

    Attributes:
        joint_margin_rad: Least distance to a joint limit.
        wrist_rad: Least angle between axes 4 and 6.
        joint_speeds_rad_s: (6,) of the drives, or None.
        joint_accelerations_rad_s2: (6,) of the drives, or None.
        cables_rad: By axis 0..5, the largest angle to either side that its cables and hoses can follow.
        clearance_m: Least distance of coarse bodies; below it is a warning, contact is a failure.
        acceleration_m_s2: Of the tool along and across the path.
        least_block_s: Shortest time in which the controller works off a block.
        look_ahead: Blocks that the controller looks ahead, or None.
        blending_m: Distance from a corner at which its rounding begins; 0 is an exact stop.
        orientation_rad_s: Largest speed at which the tool frame turns, or None.
        reversal_error_m: Largest lost motion at the tool of a reversal or unloading.
        correction_m: Largest correction that compensation makes.
        correction_rad: Largest correction of the orientation.
        corner_error_m: Largest distance of a rounding from its corner, or None.
        assumed: Keys of the cell file that it leaves at their defaults, of those that stand for the controller.
    """

    joint_margin_rad: float
    wrist_rad: float
    acceleration_m_s2: float
    least_block_s: float
    clearance_m: float
    joint_speeds_rad_s: Float | None = None
    joint_accelerations_rad_s2: Float | None = None
    cables_rad: dict[int, float] = field(default_factory=dict)
    look_ahead: int | None = None
    blending_m: float = 0.0
    orientation_rad_s: float | None = None
    reversal_error_m: float = 50e-6
    correction_m: float = 3e-3
    correction_rad: float = math.radians(1.0)
    corner_error_m: float | None = None
    assumed: frozenset[str] = frozenset()


def worst_of_axes(values: Float, largest: Float | None) -> tuple[int, int]:
    """Row and axis at which a value is largest, measured by its limit where there is one.

    Args:
        values: (n, 6), >= 0, n >= 1.
        largest: (6,) limits > 0, or None.
    """
    share = values if largest is None else values / largest
    row, axis = np.unravel_index(int(np.argmax(share)), share.shape)
    return int(row), int(axis)
