"""What a choice of postures is made from: branches, deflection in a direction, torque; beside library and matrix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.files.cell.cell import read_cell
from counterflex.plan.inputs import CorrectionLimits
from counterflex.plan.posture.branches_kernel import arm_record, branch_angles
from counterflex.plan.posture.burden_kernel import burdens
from counterflex.plan.posture.deflection_kernel import deflection_sizes
from counterflex.plan.posture.survey import RobotHere
from counterflex.plan.posture.survey_kernel import ARM_SINGULAR, OK, within
from counterflex.robot.elasticity.chain import ElasticChain, flange, jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.elasticity.play import axis_torque
from counterflex.robot.model import catalog, opw

CELL = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_small.toml"


@pytest.mark.parametrize("robot", ["kuka_kr300_r2500_ultra", "abb_irb6640_185_280", "abb_irb4600_60_205"])
def test_branches_are_those_of_the_library(robot: str) -> None:
    chain = ElasticChain.build(catalog.load(robot))
    assert chain.opw is not None
    Ts_base_flange = flange(chain, np.random.default_rng(3).uniform(-2.5, 2.5, (200, 6)))
    expected = opw.branches(chain.opw, Ts_base_flange)
    arm, q = arm_record(chain.opw), np.empty((8, 6))
    for T, rows in zip(Ts_base_flange, expected, strict=True):
        branch_angles(arm, T[:3, :3].ravel().copy(), T[:3, 3] - chain.opw.c4_m * T[:3, 2], q)
        np.testing.assert_array_equal(np.isnan(q), np.isnan(rows))
        off = q - rows
        assert np.nanmax(np.abs(off - opw.TURN * np.round(off / opw.TURN))) < 1e-9


def test_a_stretched_elbow_and_a_wrist_over_axis_1_are_left_out() -> None:
    cell = read_cell(CELL)
    chain = cell.controller_chain
    grid = RobotHere(chain, chain, np.eye(4), CorrectionLimits()).grid(np.zeros(1))
    arm, geometry = grid.arms[0], chain.opw
    assert geometry is not None
    good = np.radians([0.0, -100.0, 120.0, 10.0, 40.0, 0.0])
    assert within(arm, grid, good.copy()) == OK
    stretched = good.copy()
    stretched[2] = -np.arctan2(geometry.a2_m, geometry.c3_m) + 0.01
    assert within(arm, grid, stretched) == ARM_SINGULAR
    folded = good.copy()  # bring the wrist over axis 1
    folded[1] = -np.pi / 2.0
    forearm = np.hypot(geometry.a2_m, geometry.c3_m)
    folded[2] = np.pi + np.arcsin(geometry.a1_m / forearm) - np.arctan2(geometry.a2_m, geometry.c3_m)
    assert within(arm, grid, folded) == ARM_SINGULAR


def test_a_pose_out_of_reach_has_no_branch() -> None:
    geometry = catalog.load("kuka_kr300_r2500_ultra").opw
    assert geometry is not None
    q = np.zeros((8, 6))
    branch_angles(arm_record(geometry), np.eye(3).ravel(), np.array([9.0, 0.0, 1.0]), q)
    assert np.isnan(q).all()


def test_deflection_in_directions_is_that_of_the_compliance_matrix() -> None:
    chain, rng = read_cell(CELL).chain, np.random.default_rng(5)
    q, w = rng.uniform(-2.0, 2.0, (50, 6)), rng.normal(size=(50, 6)) * 100.0
    normals = np.ascontiguousarray(np.linalg.qr(rng.normal(size=(50, 3, 3)))[0][:, :2])
    out = np.empty(50)
    deflection_sizes(chain.compact, q, w, normals, out, 0, 50)
    moved = (cartesian_compliance(chain, q) @ w[..., None])[:, :3]
    np.testing.assert_allclose(out, np.linalg.norm((normals @ moved)[..., 0], axis=1), rtol=1e-12)


def test_burdens_are_torque_and_lever_of_the_axes() -> None:
    chain, rng = read_cell(CELL).chain, np.random.default_rng(7)
    q = rng.uniform([-1, -2, 0, -2, -2, -2], [1, -1, 2, 2, 2, 2], (20, 1, 6))
    w, normals = rng.normal(size=(20, 6)) * 100.0, np.tile(np.eye(3)[:2], (20, 1, 1))
    torque, gain = np.zeros((20, 1, 6)), np.zeros((20, 1, 6))
    burdens(chain.compact, q, w[:, None], normals[:, None], np.zeros((0, 3)), torque, gain)
    np.testing.assert_allclose(torque[:, 0], axis_torque(chain, q[:, 0], w), rtol=1e-9, atol=1e-6)
    J = jacobian(chain, q[:, 0])
    np.testing.assert_allclose(gain[:, 0], np.linalg.norm(J[:, :2], axis=1), rtol=1e-12)
