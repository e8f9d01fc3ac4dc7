"""A further correction of a plan: what parts made by it were measured to be off is taken back.

The displacement that is taken back is shaped in time as every correction is (:func:`.shaped`), held in holes, and
begins early, by :data:`LEAD_S`. ``measured_part`` of the plan is that part of its correction; what the parts showed
stands in the place of the plan's own prediction of what remains.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ModelError
from counterflex.core.units import UM
from counterflex.plan import static_correction
from counterflex.plan.plan import Plan, across
from counterflex.plan.sag_and_play import corrected_joints

LEAD_S: Final = 0.03
"""Time by which a further correction is sent earlier than it is wanted, beside ``correction_lead_ms`` of the cell: axes
that stand are held by friction until their integrators have answered. Of 0, 20, 30, 40, 80 and 120 ms the one
that left least in the mean of the tuning seeds 1 to 6 of the family ``wide``."""
ENTERING_S: Final = (0.7, 1.1)
"""An entry lasts so long from contact on, fading between the two: there the drives turn round."""
LEAVING_S: Final = (0.25, 0.5)
"""An exit begins so long before the tool leaves the cut: the radius of a cutter at usual feeds."""


def earlier(displacement_m: Float, time_s: Float, group: Int) -> Float:
    """A displacement (n, 3) as it is :data:`LEAD_S` later within its group of rows, (n, 3) m."""
    out = displacement_m.copy()
    for number in np.unique(group):
        rows = np.flatnonzero(group == number)
        for axis in range(3):
            out[rows, axis] = np.interp(time_s[rows] + LEAD_S, time_s[rows], displacement_m[rows, axis])
    return out


def with_measured(
    plan: Plan, loaded: static_correction.LoadedRobot, further_m: Float, remaining_m: Float, limit_m: float
) -> Plan:
    """The plan with a further correction.

    Args:
        plan: That the measured part was made by.
        loaded: The robot under load along its path.
        further_m: (n, 3) m, displacement that is taken back besides what the plan takes back already.
        remaining_m: (n, 3) m, deviation expected of the next part; not taken by a plan without predictions.
        limit_m: Largest change of a correction.

    Raises:
        ModelError: The change is beyond ``limit_m``, or the whole correction beyond the cell's limit.
    """
    setting, inputs = loaded.inputs.setting, loaded.inputs
    if setting.normal_only:
        further_m = across(further_m, inputs.path.p_part_tcp)
    ahead = earlier(further_m, inputs.path.time_s, loaded.feed_run)
    change = -static_correction.shaped(loaded, np.pad(ahead, ((0, 0), (0, 3))), np.zeros((len(ahead), 6)))[:, :3]
    change, turn = static_correction.held_in_holes(inputs.path, loaded.cut.contact, change, plan.rotvec_part)
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
    static_correction.check_corrections(static_correction.Command(correction, turn, q), plan.line, setting.limits)
    predicted = not np.all(np.isnan(plan.deviation_nominal_part))
    return replace(
        plan,
        correction_part=correction,
        measured_part=change if plan.measured_part is None else plan.measured_part + change,
        deviation_compensated_part=remaining_m if predicted else plan.deviation_compensated_part,
    )


def entering_share(time_s: Float, group: Int, contact: Bool) -> Float:
    """(n,) 1 where the tool enters the cut: for the first of :data:`ENTERING_S` from contact on, falling to 0."""
    return leaving_share(-time_s[::-1], -group[::-1], contact[::-1], ENTERING_S)[::-1]


def leaving_share(time_s: Float, group: Int, contact: Bool, lasts_s: tuple[float, float] = LEAVING_S) -> Float:
    """(n,) 1 where the tool leaves the cut: from ``lasts_s`` before the end of contact, rising from 0."""
    out = np.zeros(len(time_s))
    for number in np.unique(group[contact]):
        rows = np.flatnonzero(group == number)
        cuts = rows[contact[rows]]
        ends = cuts[np.diff(time_s[cuts], append=np.inf) > static_correction.APPROACH_S]
        for at in time_s[ends]:
            before = at - time_s[rows]
            own = np.interp(before, lasts_s, (1.0, 0.0))
            out[rows] = np.maximum(out[rows], np.where(before < -static_correction.APPROACH_S, 0.0, own))
    return out
