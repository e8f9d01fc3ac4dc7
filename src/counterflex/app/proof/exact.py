"""The setting of a planner that knows the truth: the error it leaves is that of the method alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from counterflex.app.inputs import Job, setting_of
from counterflex.app.proof.response import command_lead
from counterflex.app.proof.truth import knowing
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED, tool_orientation
from counterflex.plan.inputs import Setting
from counterflex.plan.relative_motion import hand_poses
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.twin.truth.truth import Truth


def exact_setting(job: Job, cell: Cell, truth: Truth) -> Setting:
    """Elastic chain, force law and lead of corrections of a truth.

    The first two are written in the truth. The lead is none of its numbers: it is measured on the truth as a shop would
    measure it (:mod:`counterflex.app.proof.response`), in the middle of the program.

    Args:
        job: The program.
        cell: What else is planned with.
        truth: The truth.

    Raises:
        ReachError: The middle of the program is out of reach.
    """
    chain, law = knowing(cell, truth)
    setting = setting_of(cell, chain=chain, law=law, orientation=job.words is not None, part_may_be_held=True)
    fed = np.flatnonzero(job.path.kind == FEED)
    row = [fed[len(fed) // 2] if len(fed) else 0]
    Rs_part_tcp = tool_orientation(job.path.axis_part[row], setting.rotation_about_tool_rad)
    Ts_part_tcp = pose.make(Rs_part_tcp, job.path.p_part_tcp[row])
    Ts_base_hand = hand_poses(setting.T_base_part, setting.T_base_tcp, Ts_part_tcp)
    q = inverse_path(setting.controller_chain, Ts_base_hand, setting.branch).q[0]
    return replace(setting, shaping=replace(setting.shaping, lead_s=command_lead(cell, truth, q)))
