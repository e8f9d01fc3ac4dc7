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
    """A check of a program and its worst place."""

    check: str  # what is checked
    # `fail` is a hard check that failed: the program is not to be run. `warning`: it runs, and less accurately or more
    # slowly than programmed. `not looked at`: the check was not made; `missing` names the key without which it cannot
    # be made, `what` another reason
    verdict: Verdict
    value: float | None = None  # the worst value, SI; None where there is none
    limit: float | None = None  # what it is compared with, SI, or None
    unit: str = ""  # SI unit of both, `""` for numbers
    point: int | None = None  # row of the path where it is worst, or None
    what: str = ""  # which axis, which bodies, how many
    missing: str = ""  # keys of the cell file without which the check cannot be made, for `not looked at`
    advice: str = ""  # what to do


@dataclass(frozen=True, eq=False)
class Bounds:
    """Limits that the checks compare with; None is not known."""

    joint_margin_rad: float  # least distance to a joint limit
    wrist_rad: float  # least angle between axes 4 and 6
    acceleration_m_s2: float  # of the tool along and across the path
    least_block_s: float  # shortest time in which the controller works off a block
    clearance_m: float  # least distance of coarse bodies; below it is a warning, contact is a failure
    joint_speeds_rad_s: Float | None = None  # (6,) of the drives, or None
    joint_accelerations_rad_s2: Float | None = None  # (6,) of the drives, or None
    # by axis 0..5, the largest angle to either side that its cables and hoses can follow
    cables_rad: dict[int, float] = field(default_factory=dict)
    look_ahead: int | None = None  # blocks that the controller looks ahead, or None
    blending_m: float = 0.0  # distance from a corner at which its rounding begins; 0 is an exact stop
    orientation_rad_s: float | None = None  # largest speed at which the tool frame turns, or None
    reversal_error_m: float = 50e-6  # largest lost motion at the tool of a reversal or unloading
    correction_m: float = 3e-3  # largest correction that compensation makes
    correction_rad: float = math.radians(1.0)  # largest correction of the orientation
    corner_error_m: float | None = None  # largest distance of a rounding from its corner, or None
    # keys of the cell file that it leaves at their defaults, of those that stand for the controller
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
