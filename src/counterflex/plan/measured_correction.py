"""A further correction of a plan: what parts made by it were measured to be off is taken back.

The displacement that is taken back is shaped in time as every correction is (:func:`.shaped`), held in holes, and
begins :data:`LEAD_S` early. ``measured_part`` of the plan is that part of its correction; what the parts showed stands
in the place of the plan's own prediction of what remains.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import ModelError
from counterflex.core.units import UM
from counterflex.plan.plan import Plan, across
from counterflex.plan.sag_and_play import corrected_joints
from counterflex.plan.static_correction import (
    Command,
    LoadedRobot,
    check_corrections,
    held_in_holes,
    shaped,
)

LEAD_S: Final = 0.03
"""Time by which a further correction is sent earlier than it is wanted, beside ``correction_lead_ms`` of the cell: axes
that stand are held by friction until their integrators have answered. Of 0, 20, 30, 40, 80 and 120 ms the one
that left least in the mean of the tuning seeds 1 to 6 of the family ``wide``."""


def earlier(displacement_m: Float, time_s: Float, group: Int, lead_s: float = LEAD_S) -> Float:
    """A displacement (n, 3) as it is ``lead_s`` later within its group of rows, (n, 3) m."""
    out = displacement_m.copy()
    for number in np.unique(group):
        rows = np.flatnonzero(group == number)
        for axis in range(3):
            out[rows, axis] = np.interp(time_s[rows] + lead_s, time_s[rows], displacement_m[rows, axis])
    return out


def with_measured(plan: Plan, loaded: LoadedRobot, further_m: Float, remaining_m: Float, limit_m: float) -> Plan:
    """The plan with a further correction.

    Args:
        plan: That the measured part was made by.
        loaded: The robot under load along its path.
        further_m: (n, 3) m, displacement that is taken back besides what the plan takes back already.
        remaining_m: (n, 3) m, deviation expected of the next part; not taken by a plan without predictions.
        limit_m: Largest change of a correction.

    Returns:
        The plan, joint angles and predicted deviation with it.

    Raises:
        ModelError: The change is beyond ``limit_m``, or the whole correction beyond the cell's limit.
    """
    setting, inputs = loaded.inputs.setting, loaded.inputs
    if setting.normal_only:
        further_m = across(further_m, inputs.path.p_part_tcp)
    ahead = earlier(further_m, inputs.path.time_s, loaded.feed_run)
    change = -shaped(loaded, np.pad(ahead, ((0, 0), (0, 3))), np.zeros((len(ahead), 6)))[:, :3]
    change, turn = held_in_holes(inputs.path, loaded.cut.contact, change, plan.rotvec_part)
    size = np.linalg.norm(change, axis=1)
    row = int(np.argmax(size))
    if size[row] > limit_m:
        raise ModelError(
            "what the part shows would change the correction by more than is allowed at a time",
            where=f"line {int(plan.line[row])}",
            value=f"{size[row] / UM:.0f} um",
            limit=f"<= {limit_m / UM:g} um (--limit-um)",
            hint="Look whether it is the scan of this part, well placed; then allow more",
        )
    correction = plan.correction_part + change
    q = corrected_joints(setting.controller_chain, loaded.robot.relative, inputs.q, correction, turn)
    check_corrections(Command(correction, turn, q), plan.line, setting.limits)
    predicted = not np.all(np.isnan(plan.deviation_nominal_part))
    before = np.zeros_like(change) if plan.measured_part is None else plan.measured_part
    return replace(
        plan,
        correction_part=correction,
        measured_part=before + change,
        deviation_compensated_part=remaining_m if predicted else plan.deviation_compensated_part,
    )
