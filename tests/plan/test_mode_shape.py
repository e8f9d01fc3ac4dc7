"""Motion of the arm's points in a mode: the tip's is that of the Jacobian, joints alone are forward kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.modes import modes, point_motion
from counterflex.robot.elasticity.chain import forward, frames

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
Q = np.radians([10.0, -95.0, 105.0, 15.0, 40.0, -20.0])


def test_the_tip_moves_as_its_jacobian_says() -> None:
    chain = read_cell(CELL).chain
    M, stiffness, J, _ = matrices(chain, Q)
    shapes = modes(M, stiffness).shapes[:, :5]
    points, moved = point_motion(chain, Q, shapes)
    np.testing.assert_allclose(points[-1], forward(chain, Q)[:3, 3], atol=1e-12)
    np.testing.assert_allclose(moved[-1], (J @ shapes)[:3], atol=1e-12)
    np.testing.assert_array_equal(moved[0], 0.0)


def test_points_follow_the_joints() -> None:
    chain = read_cell(CELL).chain
    step, turn = 1e-6, np.array([1.0, -0.5, 0.7, 2.0, -1.5, 0.3])
    shape = np.zeros((len(matrices(chain, Q)[1]), 1))
    shape[:6, 0] = turn
    points, moved = point_motion(chain, Q, shape)
    flange = chain.flange_segment + 2
    own = [k for k in range(1, len(points) - 1) if k != flange]
    far, near = (frames(chain, Q + s * turn)[:, :3, 3] for s in (step, -step))
    np.testing.assert_allclose(moved[own, :, 0], (far - near) / (2.0 * step), atol=1e-8)


def test_shapes_of_another_chain_are_refused() -> None:
    with pytest.raises(InputError, match="another chain"):
        point_motion(read_cell(CELL).chain, Q, np.zeros((3, 1)))
