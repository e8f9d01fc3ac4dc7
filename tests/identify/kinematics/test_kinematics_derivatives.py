"""Residuals of the geometry: exact derivatives, agreement with the elastic chain, and inverse maps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.app.identification.cell_model import model_of
from counterflex.core.errors import InputError, ModelError
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.geometry.rotation import inverse_left_jacobian, left_jacobian
from counterflex.identify.geometry.arm_geometry import displaced_arm
from counterflex.identify.geometry.arm_parameters import ArmModel, ArmPriors, arm_model, sag_of
from counterflex.identify.geometry.fiducials import FiducialResiduals
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals
from counterflex.identify.kinematics.distance_residuals import (
    DistanceResiduals,
    PlaneResiduals,
    find_anchor,
    find_plane,
)
from counterflex.identify.solver.residuals import Residuals
from counterflex.robot.elasticity.chain import ElasticChain, forward_elastic
from counterflex.robot.elasticity.drive_error import DriveError, DriveErrors
from counterflex.robot.model.calibration import calibrated
from derivative_check import convergence_order

CELL = model_of(read_cell("examples/cells/kr300_d10_ball.toml"))
RNG = np.random.default_rng(3)
Q = RNG.uniform(-0.5, 0.5, (7, 6)) + np.array([0.0, -1.5, 1.5, 0.0, 0.5, 0.0])


def _arm(sag: str) -> ArmModel:
    model = arm_model(CELL, ArmPriors(), sag=sag, base=True, flange=True, tool=True)
    return model.with_periodic(2, [1, 3], 3e-4)


def _blocks(model: ArmModel) -> tuple[list[Residuals], int]:
    p = len(model.parameters)
    arm, m = model.at(Q), len(Q)
    T = pose.make(rotation.exp(RNG.normal(size=(m, 3))), RNG.normal(size=(m, 3)))
    frame = PlacedFrame(T[0], np.arange(p, p + 6))
    target = PlacedFrame(T[1], np.arange(p + 6, p + 12))
    group = np.arange(m)
    axes = np.linalg.qr(RNG.normal(size=(m, 3, 3)))[0]
    rows = np.tile(np.arange(p + 12, p + 15), (m, 1))
    return [
        TrackerResiduals("poses", group, np.full((m, 6), 0.1), arm, frame, target, T[:, :3, 3], T[:, :3, :3]),
        TrackerResiduals("points", group, np.full((m, 3), 0.1), arm, frame, target, T[:, :3, 3], None),
        DistanceResiduals("bar", group, np.full((m, 1), 0.1), arm, np.ones(m), None, T[:, :3, 3], rows),
        DistanceResiduals(
            "two", group, np.full((m, 1), 0.1), arm, np.ones(m), model.at(np.roll(Q, 1, axis=0)), T[:, :3, 3], rows
        ),
        PlaneResiduals("plane", group, np.full((m, 1), 0.1), arm, T[:, :3, 3], axes, rows),
        FiducialResiduals("fiducials", group, np.full((m, 3), 0.1), frame, T[:, :3, 3], T[::-1, :3, 3]),
    ], p + 15


@pytest.mark.long
@pytest.mark.parametrize("sag", ["masses", "torsion"])
def test_derivatives_are_exact_by_their_order_of_convergence(sag: str) -> None:
    model = _arm(sag)
    blocks, count = _blocks(model)
    x = 1e-2 * RNG.normal(size=count)
    steps = np.full(count, 3e-2)
    for i, item in enumerate(model.parameters):
        if item.unit not in ("m", "rad"):
            x[i] = item.nominal * 1.1
            steps[i] = 0.5 * item.nominal if item.nominal else 1e-8
    for block in blocks:
        assert np.all(convergence_order(block, x, steps) > 1.8), block.name


def test_subset_keeps_rows() -> None:
    blocks, count = _blocks(_arm("masses"))
    keep = np.arange(len(Q)) % 2 == 0
    x = np.zeros(count)
    for item, place in zip(_arm("masses").parameters, range(count), strict=False):
        x[place] = item.nominal
    for block in blocks:
        np.testing.assert_allclose(block.subset(keep).evaluate(x), block.evaluate(x)[keep])
        np.testing.assert_allclose(block.subset(keep).jacobian(x), block.jacobian(x)[keep])


def test_sagging_displaced_arm_is_the_calibrated_elastic_chain() -> None:
    moves = {name: 1e-3 * RNG.normal(size=6) for name in ("base", "axis2", "axis5", "spindle", "tcp")}
    robot, end_effector = calibrated(CELL.nominal_robot, CELL.nominal_end_effector, moves)
    expected = forward_elastic(ElasticChain.build(robot, end_effector), Q, gravity=True, equilibrium=True)
    off = pose.difference(expected, displaced_arm(CELL.nominal_chain, Q, moves).poses(np.zeros(0)))
    assert np.max(np.abs(off[:, :3])) < 1e-6
    assert np.max(np.abs(off[:, 3:])) < 1e-6


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.lists(st.floats(-1e-6, 1e-6), min_size=3, max_size=3))
def test_left_jacobian_is_the_derivative_of_the_rotation_vector(r: list[float], d: list[float]) -> None:
    a, b = np.array(r), np.array(d)
    turned = (Rotation.from_rotvec(a + b) * Rotation.from_rotvec(a).inv()).as_rotvec()
    np.testing.assert_allclose(turned, left_jacobian(a) @ b, atol=1e-11)
    if np.linalg.norm(a) < 6.0:
        np.testing.assert_allclose(inverse_left_jacobian(a) @ left_jacobian(a), np.eye(3), atol=1e-9)


@settings(max_examples=30)
@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_drive_errors_invert(q: list[float]) -> None:
    errors = DriveErrors((DriveError(0, 1, 2e-3, -1e-3), DriveError(0, 20, 3e-4, 2e-4), DriveError(4, 3, 1e-3, 0.0)))
    angles = np.array(q)
    np.testing.assert_allclose(errors.controller_angles(errors.link_angles(angles)), angles, atol=1e-12)
    assert errors.link_angles(np.zeros(6)) == pytest.approx(np.zeros(6))


def test_drive_errors_merge_and_refuse_what_turns_back() -> None:
    one = DriveErrors((DriveError(2, 4, 1e-4, 2e-4),))
    both = one.merged([DriveError(2, 4, 1e-4, 0.0), DriveError(1, 1, 1e-5, 0.0)])
    q = np.linspace(-1.0, 1.0, 6)
    np.testing.assert_allclose(
        both.link_angles(q)[2] - q[2], 2e-4 * np.sin(4 * q[2]) + 2e-4 * (np.cos(4 * q[2]) - 1.0), atol=1e-15
    )
    with pytest.raises(ModelError, match="far too large"):
        DriveErrors((DriveError(2, 10, 0.1, 0.0),))


def test_sag_follows_what_the_cell_knows() -> None:
    chain = CELL.nominal_chain
    assert sag_of(chain, "auto") == "masses"
    ur10 = model_of(read_cell("examples/cells/ur10_ipa_tmac.toml")).nominal_chain
    assert sag_of(ur10, "auto") == "torsion"
    with pytest.raises(InputError, match="no masses or no compliances"):
        sag_of(ur10, "cell")
    with pytest.raises(InputError, match="unknown treatment"):
        sag_of(chain, "some")


def test_anchor_and_plane_are_found_from_points_with_gross_errors() -> None:
    p = RNG.uniform(-0.5, 0.5, (60, 3)) + np.array([1.5, 0.0, 1.0])
    anchor = np.array([1.2, -0.3, 0.4])
    length = np.linalg.norm(p - anchor, axis=1)
    np.testing.assert_allclose(find_anchor(p, length, "here"), anchor, atol=1e-9)
    with pytest.raises(InputError, match="fixed end of the ball bar"):
        find_anchor(p * np.array([1.0, 1.0, 0.0]), length, "here")
    flat = p.copy()
    flat[:, 2] = 0.3 + 0.1 * flat[:, 0]
    flat[::10, 2] += 0.5
    centre, axes = find_plane(flat, "here")
    normal = np.array([-0.1, 0.0, 1.0]) / np.hypot(1.0, 0.1)
    assert abs(axes[:, 0] @ normal) == pytest.approx(1.0, abs=1e-9)
    assert centre[2] == pytest.approx(0.3 + 0.1 * centre[0], abs=1e-9)
    with pytest.raises(InputError, match="lie on one line"):
        find_plane(p[:1] + np.linspace(0, 1, 8)[:, None] * np.array([[1.0, 0.0, 0.0]]), "here")
