"""Part frame measured with a sagging robot, and the tool frame along the path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.plan.sag_and_play import sag_deviation, true_part_frame

DATUM: Float = np.array([[0.0, 0, 0.04], [0.2, 0, 0.04], [0.2, 0.15, 0.04], [0, 0.15, 0.04]])
POINTS: Float = np.array([[0.05, 0.02, 0.03], [0.1, 0.1, 0.0], [0.19, 0.14, 0.04]])


def part() -> Float:
    out: Float = pose.make(rotation.from_zyx(np.array([0.3, -0.1, 0.05])), np.array([1.3, -0.2, 1.0]))
    return out


def test_the_same_sag_everywhere_cancels() -> None:
    sag: Float = np.array([2e-4, -1e-4, -3e-3])
    true = true_part_frame(part(), DATUM, np.tile(sag, (4, 1)))
    left = sag_deviation(part(), true, POINTS, np.tile(sag, (3, 1)))
    assert np.abs(left).max() < 1e-15


def test_a_rigid_motion_of_sag_cancels_too() -> None:
    """Sag that turns with the place like a rigid body leaves nothing after the frame was touched."""
    turn: Float = np.array([1e-3, -2e-3, 5e-4])
    R = rotation.exp(turn)

    def sag(p_part: Float) -> Float:
        p = pose.transform(part(), p_part)
        out: Float = p @ R.T + np.array([1e-4, 0, -2e-3]) - p
        return out

    true = true_part_frame(part(), DATUM, sag(DATUM))
    assert np.abs(sag_deviation(part(), true, POINTS, sag(POINTS))).max() < 1e-14


def test_what_is_left_is_how_sag_varies_across_the_part() -> None:
    def sag(p_part: Float) -> Float:
        """More sag farther out, down in base axes."""
        out: Float = np.zeros_like(p_part)
        out[:, 2] = -1e-3 - 2e-2 * (p_part[:, 0] - 0.1) ** 2
        return out

    flat = pose.make(p=np.array([1.3, 0.0, 1.0]))
    true = true_part_frame(flat, DATUM, sag(DATUM))
    left = sag_deviation(flat, true, POINTS, sag(POINTS))
    # At the datum points the curved part is the same; what is left is its difference to them.
    expected = -2e-2 * ((POINTS[:, 0] - 0.1) ** 2 - 0.1**2)
    assert left[:, 2] == pytest.approx(expected, abs=1e-9)
    assert np.abs(left[:, :2]).max() < 1e-7


def test_a_frame_measured_from_outside_keeps_the_whole_sag() -> None:
    sag: Float = np.array([[2e-4, -1e-4, -3e-3]])
    left = sag_deviation(part(), part(), POINTS[:1], sag)
    assert left == pytest.approx(sag @ part()[:3, :3], abs=1e-15)


axes = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(axes, st.floats(-6.3, 6.3))
@settings(max_examples=100, deadline=None)
def test_tool_frame_is_right_handed_and_looks_along_the_tool(axis: tuple[float, ...], angle: float) -> None:
    unit: Float = np.array([axis]) / np.linalg.norm(axis)
    R = tool_orientation(unit, angle)[0]
    assert pytest.approx(np.eye(3), abs=1e-12) == R.T @ R
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert R[:, 2] == pytest.approx(-unit[0])
    # The free angle turns the frame right-handed about the axis and nothing else.
    turned = rotation.exp(unit * angle)[0] @ tool_orientation(unit, 0.0)[0]
    assert turned == pytest.approx(R, abs=1e-12)


def test_tool_frame_of_a_vertical_tool() -> None:
    up: Float = np.array([[0.0, 0.0, 1.0]])
    assert tool_orientation(up, 0.0)[0] == pytest.approx(np.diag([1.0, -1.0, -1.0]))
    assert tool_orientation(up, 0.5 * np.pi)[0][:, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)


def test_tool_poses_chain_part_and_tool() -> None:
    R = tool_orientation(np.tile([0.0, 0.0, 1.0], (3, 1)), 0.4)
    Ts = tool_poses(part(), POINTS, R)
    assert Ts[:, :3, 3] == pytest.approx(pose.transform(part(), POINTS))
    assert Ts[:, :3, :3] == pytest.approx(part()[:3, :3] @ R)
