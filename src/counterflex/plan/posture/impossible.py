"""Refusal where no posture is possible: which line of the program, and what the best posture fails by."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG, MM
from counterflex.plan.inputs import place
from counterflex.plan.posture.acceleration import TooFast
from counterflex.plan.posture.clearance import Surroundings
from counterflex.plan.posture.held import PostureTask
from counterflex.plan.posture.survey_kernel import ARM_SINGULAR, JOINT_LIMIT, OK, OUT_OF_REACH, WRIST_SINGULAR, Survey
from counterflex.plan.preflight.bodies import tool_of
from counterflex.plan.preflight.collision import Closest
from counterflex.robot.model.opw import BRANCHES

REASONS: Final = {
    OUT_OF_REACH: ("no posture reaches the point", "Move the part closer to the robot, or away from its foot"),
    ARM_SINGULAR: ("every posture that reaches the point stretches the arm", "Move the part closer to the robot"),
    JOINT_LIMIT: (
        "every posture that reaches the point breaks a joint limit",
        "Move the part; the margin is limits.joint_margin_deg, cables are limits.cable_axis4_deg and cable_axis6_deg",
    ),
    WRIST_SINGULAR: (
        "every posture within the joint limits comes too close to the wrist singularity",
        "Move or tilt the part; the distance is limits.wrist_singularity_deg",
    ),
}
"""What the best posture of a point fails by, and what to do."""
FAULTS: Final = {
    OUT_OF_REACH: "out of reach",
    ARM_SINGULAR: "arm stretched",
    JOINT_LIMIT: "joint limit or cable",
    WRIST_SINGULAR: "wrist singularity",
}
"""The same in few words."""


def require_possible(survey: Survey, task: PostureTask) -> None:
    """Refuse a path with a point at which no posture is possible.

    Raises:
        ReachError: There is one; ``reason`` of its data is the code of what the best posture fails by.
    """
    bad = np.flatnonzero(survey.failed[:, OK] == 0)
    if len(bad):
        row = int(bad[0])
        reason = int(np.flatnonzero(survey.failed[row])[-1])
        what, hint = REASONS[reason]
        raise ReachError(
            what,
            where=place(task.path, task.line, row),
            value=f"0 of {int(survey.failed[row].sum())} postures",
            hint=hint,
            point=row,
            reason=reason,
        )


def no_way(passed: Int, rows: Int, task: PostureTask, survey: Survey, *, turns: bool) -> ReachError:
    """Every point has a posture, but none leads from the first point to the last.

    ``passed``: (8,) edges that each branch could pass; ``rows``: (m + 1,) stations.
    """
    slot = int(np.argmax(passed))
    row = int(rows[min(passed[slot] + 1, len(rows) - 1)])
    counts = survey.failed[row]
    reasons = [
        f"{counts[code]} {FAULTS[code]}" for code in np.argsort(-counts).tolist() if code in FAULTS and counts[code]
    ]
    why = f"of {counts.sum()} postures there fail: {', '.join(reasons) or 'none; axes are too slow to come to them'}"
    how = " at the joint speeds and rates of turning that are allowed" if turns else " without turning the tool"
    return ReachError(
        f"no posture leads past this point{how}",
        where=place(task.path, task.line, row),
        value=f"{BRANCHES[slot]} comes to line {int(task.line[rows[passed[slot]]])}; {why}",
        limit="one posture from the first line to the last",
        hint="Move the part, or divide the program",
        point=row,
    )


def too_slow(fast: TooFast, task: PostureTask) -> ReachError:
    """Every posture that leads through the path asks an axis for more acceleration at feed than its drive has.

    Args:
        fast: In the posture that would be best otherwise.
    """
    return ReachError(
        f"in every posture that leads through the program an axis is too slow; in the best, axis {fast.axis + 1}",
        where=place(task.path, task.line, fast.point),
        value=f"{fast.acceleration_rad_s2 / DEG:.0f} deg/s2",
        limit=f"at most {fast.limit_rad_s2 / DEG:g} deg/s2 (limits.joint_acceleration_deg_s2)",
        hint="Lower the feed there or controller.acceleration_mm_s2, round the corner, or move the part",
        point=fast.point,
    )


def in_the_way(close: Closest, around: Surroundings, task: PostureTask) -> ReachError:
    """Every posture that leads through the path brings bodies too close to each other.

    ``close``: the pair, in the posture that would be best otherwise.
    """
    first, second = (around.bodies[k] for k in (close.first, close.second))
    guessed = [body.name for body in (first, second) if body.assumed]
    hint = "Move the part, or use a longer tool"
    if guessed:
        hint += f"; {' and '.join(guessed)}: size assumed, give it in [[cell.body]]"
    return ReachError(
        f"in every posture that leads through the program bodies come too close; in the best, {first.name} to "
        f"{second.name}",
        where=place(task.path, task.line, close.point),
        value=f"{close.distance_m / MM:.1f} mm",
        limit="no contact"
        if tool_of(first, second) is not None
        else f">= {around.clearance_m / MM:g} mm (limits.clearance_mm)",
        hint=hint,
        point=close.point,
    )
