"""A further correction of a plan: what parts made by it were measured to be off is taken back.

The displacement that is taken back is shaped in time as every correction is (:func:`.shaped`), held in holes, and
begins early, see :func:`lead_s`. ``measured_part`` of the plan is that part of its correction; what the parts showed
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
ENTRY_LEAD_S: Final = 0.12
"""The same while the tool enters the cut. There the plan's own correction has just driven the axes one way, and a
further one turns them back: they stand until the friction has turned round. With class drives in the plan, groove,
tuning seeds 1, 2 of ``wide`` and ``other``: 30 ms left 80, 58, 91, 49 um, 120 ms 42, 62, 55, 51, 250 ms 63, 83, 57, 69.
No longer lead was better in the rest of the cut, nor along other directions, nor in later corrections, which find the
axes turned round already."""
ENTRY_S: Final = (0.7, 1.1)
"""From contact on the lead of the entry holds for the first time, and is that of the rest at the second."""


LEAVING_S: Final = 0.5
"""So long before the tool leaves the cut its exit begins: the radius of a cutter at usual feeds."""


def lead_s(time_s: Float, group: Int, contact: Bool) -> Float:
    """(n,) s, by how much earlier a further correction is sent.

    :data:`ENTRY_LEAD_S` from :data:`.APPROACH_S` before the tool meets the part, from there falling as
    :data:`ENTRY_S` says, :data:`LEAD_S` otherwise. The tool meets the part where it cuts and has not for
    :data:`.APPROACH_S`, or where a run begins.

    Args:
        time_s: (n,) s, non-decreasing.
        group: (n,) number of the run of feed.
        contact: (n,) True where the segment that ends here cuts.
    """
    out = np.full(len(time_s), LEAD_S)
    for number in np.unique(group[contact]):
        rows = np.flatnonzero(group == number)
        cuts = rows[contact[rows]]
        meets = cuts[np.diff(time_s[cuts], prepend=-np.inf) > static_correction.APPROACH_S]
        for at in time_s[meets]:
            since = time_s[rows] - at
            own = np.interp(since, ENTRY_S, (ENTRY_LEAD_S, LEAD_S))
            out[rows] = np.where(since < -static_correction.APPROACH_S, out[rows], np.maximum(out[rows], own))
    return out


def earlier(displacement_m: Float, time_s: Float, group: Int, early_s: Float) -> Float:
    """A displacement (n, 3) as it is ``early_s`` (n,) s later within its group of rows, (n, 3) m."""
    out = displacement_m.copy()
    for number in np.unique(group):
        rows = np.flatnonzero(group == number)
        for axis in range(3):
            out[rows, axis] = np.interp(time_s[rows] + early_s[rows], time_s[rows], displacement_m[rows, axis])
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
    time_s, run = inputs.path.time_s, loaded.feed_run
    before, driven = _measured(plan), _driven(plan, loaded, further_m)
    lead = lead_s(time_s, run, loaded.cut.contact)
    ahead = earlier(further_m - driven, time_s, run, np.full(len(time_s), LEAD_S)) + earlier(driven, time_s, run, lead)
    change = -loaded.shaped(np.pad(ahead, ((0, 0), (0, 3))), np.zeros((len(ahead), 6)))[:, :3]
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
        measured_part=before + change,
        deviation_compensated_part=remaining_m if predicted else plan.deviation_compensated_part,
    )


def _measured(plan: Plan) -> Float:
    """(n, 3) m, the part of a plan's correction that came from parts."""
    return np.zeros_like(plan.correction_part) if plan.measured_part is None else plan.measured_part


def _driven(plan: Plan, loaded: static_correction.LoadedRobot, displacement_m: Float) -> Float:
    """The part of a displacement along what the plan's own correction drives the tool by in each run."""
    # None once parts have changed the plan: its axes have turned round, and a further change goes on from there.
    run, contact, out = loaded.feed_run, loaded.cut.contact, np.zeros_like(displacement_m)
    if plan.measured_part is not None:
        return out
    for number in np.unique(run[contact]):
        along = np.sum(plan.correction_part[contact & (run == number)], axis=0)
        along /= max(float(np.linalg.norm(along)), 1e-30)
        out[run == number] = (displacement_m[run == number] @ along)[:, None] * along
    return out


def leaving_share(time_s: Float, group: Int, contact: Bool) -> Float:
    """(n,) 1 where the tool leaves the cut: from half of :data:`LEAVING_S` before the end of contact, rising from 0."""
    out = np.zeros(len(time_s))
    for number in np.unique(group[contact]):
        rows = np.flatnonzero(group == number)
        cuts = rows[contact[rows]]
        ends = cuts[np.diff(time_s[cuts], append=np.inf) > static_correction.APPROACH_S]
        for at in time_s[ends]:
            before = at - time_s[rows]
            own = np.interp(before, (0.5 * LEAVING_S, LEAVING_S), (1.0, 0.0))
            out[rows] = np.maximum(out[rows], np.where(before < -static_correction.APPROACH_S, 0.0, own))
    return out
