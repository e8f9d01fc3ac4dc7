"""Truth files: the simulated cell, made from a cell file and with documented random deviations (seeded)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import Job, setting_of
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import MM, MS
from counterflex.cutting.coefficients import H_KIENZLE_M, ForceLaw, KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import ClassStiffness
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED, tool_orientation
from counterflex.plan.inputs import Setting
from counterflex.plan.relative_motion import hand_poses
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.robot.model.class_prior import arm_over_axis
from counterflex.robot.model.description import EndEffector, Robot
from counterflex.twin.plant.plant import STEP_S, Plant
from counterflex.twin.truth.family import MILD, Family
from counterflex.twin.truth.file import write_truth
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.perturb import described, perturbed
from counterflex.twin.truth.truth import CuttingTruth, SensorPlace, Truth

_ABOUT_Z = 5


def cutting_truth(law: ForceLaw) -> CuttingTruth:
    """Force constants of a truth that agrees with a law.

    Raises:
        ModelError: The linear-edge law has no counterpart in the twin.
    """
    if not isinstance(law, KienzleLaw):
        raise ModelError("the simulated cell cuts by Kienzle's law", value=type(law).__name__, limit="law = kienzle")
    return CuttingTruth(
        k_pa=law.k11_pa(), exponent=(law.mc, law.mr, law.ma), edge_n_m=law.edge_n_m, h_ref_m=H_KIENZLE_M
    )


def truth_of(cell: Cell, seed: int | None, family: Family = MILD) -> Truth:
    """The truth of a cell: nominal for None, otherwise put off by seed and family.

    Where the cell stands on the median of the robot's class, the truth of a seed is a robot of that class: axes that
    nothing is known of get a stiffness drawn from it, on top of what the family puts off.

    Play, friction and loop gains of a seeded truth are those that the twin gives a robot of that size, put off by seed
    and family: what a planner says of them in its cell file moves no truth. Without a seed the truth agrees with the
    cell file in these too.
    """
    robot = cell.nominal_robot if seed is None else replace(cell.nominal_robot, play=None, servo=None)
    truth = nominal_truth(robot, cell.nominal_end_effector, cutting_truth(cell.force_law), name=cell.name)
    table = cell.tables.sensor
    if table is not None:
        truth = replace(truth, sensor=SensorPlace(table.segment, table.matrix()))
    if seed is None:
        return truth
    return perturbed(
        truth if cell.class_stiffness is None else _of_class(truth, cell.class_stiffness, seed), seed, family
    )


def _of_class(truth: Truth, given: ClassStiffness, seed: int) -> Truth:
    """The truth with stiffnesses about the axes drawn from the class in place of its median.

    These springs stand for the whole arm, but friction holds a twist in the gears alone: so that it holds as much as it
    does there, the friction of the link is that of the gear's share.
    """
    drawn, share = given.prior.drawn(1, seed)[0], arm_over_axis()
    bodies = []
    for body in truth.bodies:
        compliance = np.array(body.compliance)
        if body.joint in given.axes:
            compliance[_ABOUT_Z] = 1.0 / drawn[body.joint]
        bodies.append(replace(body, compliance=compliance))
    drives = [
        replace(drive, link_friction_nm=tuple(share[axis] * friction for friction in drive.link_friction_nm))
        if axis in given.axes
        else drive
        for axis, drive in enumerate(truth.drives)
    ]
    return replace(truth, bodies=tuple(bodies), drives=tuple(drives))


def make_truth(cell: Cell, seed: int | None, out: str | Path, family: Family = MILD) -> Truth:
    """Write the truth of a cell to a file.

    Raises:
        InputError: Axes of the cell have no stiffness: the simulated robot would be rigid.
    """
    require_stiffness(cell)
    truth = truth_of(cell, seed, family)
    write_truth(out, truth)
    return truth


def knowing(cell: Cell, truth: Truth) -> tuple[ElasticChain, ForceLaw]:
    """The truth's exact constants as a planner takes them: elastic chain and force law.

    Inertia of the motors has no place in a cell file and stays unknown.
    """
    robot, end_effector = _exact(cell, truth)
    law = cell.force_law
    if not isinstance(law, KienzleLaw):
        return ElasticChain.build(robot, end_effector), law
    kc, kr, ka = truth.cutting.k_pa
    at_reference = KienzleLaw(
        kc_ref_pa=kc,
        mc=truth.cutting.exponent[0],
        kr_ref_pa=kr,
        mr=truth.cutting.exponent[1],
        ka_ref_pa=ka,
        ma=truth.cutting.exponent[2],
        h_ref_m=truth.cutting.h_ref_m,
        h_min_m=law.h_min_m,
        h_max_m=law.h_max_m,
        source="truth file",
        status="truth",
        edge_n_m=truth.cutting.edge_n_m,
    )
    return ElasticChain.build(robot, end_effector), at_reference


def _exact(cell: Cell, truth: Truth) -> tuple[Robot, EndEffector]:
    return described(truth, cell.nominal_robot, cell.nominal_end_effector)


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
    """Elastic chain, force law, runout of the tools and lead of corrections of a truth.

    All but the last are written in the truth. The lead is none of its numbers: it is measured on the truth as a shop
    would measure it (:mod:`counterflex.app.proof.truth`), in the middle of the program.

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
    shaping = replace(setting.shaping, lead_s=command_lead(cell, truth, q))
    return replace(setting, shaping=shaping, cutter_of=partial(_clamped, cell, truth))


def _clamped(cell: Cell, truth: Truth, number: int) -> Cutter:
    return replace(cell.cutter(number), runout_m=truth.cutting.runout_m)
