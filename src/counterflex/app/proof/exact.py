"""The setting of a planner that knows the truth: the error it leaves is that of the method alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.app.inputs import Job, setting_of
from counterflex.app.proof.truth import knowing
from counterflex.core.arrays import Float
from counterflex.core.units import MM, MS
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED, tool_orientation
from counterflex.plan.inputs import Setting
from counterflex.plan.relative_motion import hand_poses
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.twin.plant.plant import STEP_S, Plant
from counterflex.twin.truth.truth import Truth

# What a shop would measure with the drives on: how a simulated cell answers a force and a command.
# Two tests at one posture: a force that sets in over :data:`RISE_S`, and a command that does. Both move the tool by the
# same amount in the end. The lead is the time by which the command has to come earlier to answer most like the force.

MOVE_M: Final = 1.0 * MM
RISE_S: Final = 0.1
TIME_S: Final = 1.0
LEADS_S: Final = np.arange(0.0, 30.5, 0.5) * MS


def responses(cell: Cell, truth: Truth, q: Float, axis: int) -> tuple[Float, Float]:
    """Motion of the tool along a part axis under a force and under a command, both settling at :data:`MOVE_M`.

    Args:
        q: (6,) rad.
        axis: 0..2 of the part, of the base where the robot holds the part.

    Returns:
        Two of (n,) m at steps of the simulation.
    """
    direction = np.eye(3)[axis] if cell.holds_part else cell.T_base_part[:3, axis]
    force = np.zeros(6)
    force[:3] = np.linalg.solve(cartesian_compliance(cell.chain, q)[:3, :3], direction * MOVE_M)
    dq = np.linalg.solve(jacobian(cell.chain, q), np.concatenate([direction * MOVE_M, np.zeros(3)]))
    x = np.minimum(1.0, np.arange(round(TIME_S / STEP_S)) * STEP_S / RISE_S)
    out = []
    for command in (0.0, 1.0):
        plant = Plant(truth)
        plant.reset(q)
        start, moved = plant.p_base_tcp.copy(), np.empty(len(x))
        rates = command * 6.0 * x * (1.0 - x) / RISE_S
        for k, share in enumerate(x * x * (3.0 - 2.0 * x)):
            plant.step(q + command * share * dq, rates[k] * dq, (1.0 - command) * share * force)
            moved[k] = (plant.p_base_tcp - start) @ direction
        out.append(moved)
    return out[0], out[1]


def best_lead(answers: list[tuple[Float, Float]]) -> tuple[float, float]:
    """Lead at which commands answer most like forces.

    Args:
        answers: By force and by command, each as :func:`responses` returns them.

    Returns:
        The lead, s, and how much they then differ by, rms over :data:`MOVE_M`.
    """
    t = np.arange(len(answers[0][0])) * STEP_S
    square = [
        np.mean([np.mean((force - np.interp(t + lead, t, command)) ** 2) for force, command in answers])
        for lead in LEADS_S
    ]
    k = int(np.argmin(square))
    return float(LEADS_S[k]), float(np.sqrt(square[k])) / MOVE_M


def command_lead(cell: Cell, truth: Truth, q: Float) -> float:
    """The lead in all three directions together, s."""
    return best_lead([responses(cell, truth, q, axis) for axis in range(3)])[0]


def exact_setting(job: Job, cell: Cell, truth: Truth) -> Setting:
    """Elastic chain, force law and lead of corrections of a truth.

    The first two are written in the truth. The lead is none of its numbers: it is measured on the truth as a shop would
    measure it (:mod:`counterflex.app.proof.exact`), in the middle of the program.

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
