"""Truth files: the simulated cell, made from a cell file and with documented random deviations (seeded)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.errors import ModelError
from counterflex.cutting.coefficients import H_KIENZLE_M, ForceLaw, KienzleLaw
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import ClassStiffness
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.class_prior import arm_over_axis
from counterflex.robot.model.description import EndEffector, Robot
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

    Inertia and runout have no place in a cell file and stay unknown.
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
