"""Tool against part: finite differences of poses, power, both ways of holding."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.plan.relative_motion import RelativeMotion, hand_poses, part_carried, tool_carried

RNG = np.random.default_rng(4)


def _pose() -> Float:
    return pose.make(rotation.exp(RNG.normal(size=3)), RNG.normal(size=3))


def _moved(T: Float, d: Float) -> Float:
    """A frame displaced by a small twist, base axes."""
    return pose.make(rotation.exp(d[3:]) @ T[:3, :3], T[:3, 3] + d[:3])


def _seen(T_before: Float, T_after: Float) -> Float:
    """Twist between two poses of the tool in the part, part axes."""
    turn = rotation.log(T_after[:3, :3] @ T_before[:3, :3].T)
    return np.concatenate([T_after[:3, 3] - T_before[:3, 3], turn])


@pytest.mark.parametrize("held", ["tool", "part"])
def test_the_matrix_is_the_derivative_of_the_pose_of_the_tool_in_the_part(held: str) -> None:
    T_other, Ts_part_tcp = _pose(), np.stack([_pose() for _ in range(3)])
    T_base_tcp = T_other if held == "part" else None
    relative = part_carried(T_other, Ts_part_tcp) if held == "part" else tool_carried(T_other)
    hands = hand_poses(T_other, T_base_tcp, Ts_part_tcp)
    for row, (hand, before) in enumerate(zip(hands, Ts_part_tcp, strict=True)):
        d = 1e-7 * RNG.normal(size=6)
        T = _moved(hand, d)
        after = pose.inverse(T) @ T_other if held == "part" else pose.inverse(T_other) @ T
        one = relative.rows(slice(row, row + 1))
        assert _seen(before, after) == pytest.approx(one.displacement(d[None])[0], abs=1e-12)


@pytest.mark.parametrize("held", ["tool", "part"])
def test_power_is_the_same_on_both_sides(held: str) -> None:
    T_other, Ts_part_tcp = _pose(), np.stack([_pose() for _ in range(4)])
    relative = part_carried(T_other, Ts_part_tcp) if held == "part" else tool_carried(T_other)
    w_part, d_base = RNG.normal(size=(4, 6)), RNG.normal(size=(4, 6))
    before = np.sum(w_part * relative.displacement(d_base), axis=1)
    assert np.sum(relative.load(w_part) * d_base, axis=1) == pytest.approx(before)
    if held == "part":  # what pushes the tool pushes the part the other way
        R_base_part = T_other[:3, :3] @ np.swapaxes(Ts_part_tcp[:, :3, :3], -1, -2)
        pushed = -(R_base_part @ w_part[:, :3, None])[..., 0]
        assert relative.load(w_part)[:, :3] == pytest.approx(pushed)


def test_compliance_is_that_of_displacement_and_load() -> None:
    Ts_part_tcp = np.stack([_pose() for _ in range(2)])
    relative: RelativeMotion = part_carried(_pose(), Ts_part_tcp)
    half = RNG.normal(size=(2, 6, 6))
    C = half @ np.swapaxes(half, -1, -2)
    w = RNG.normal(size=(2, 6))
    bent = relative.displacement((C @ relative.load(w)[..., None])[..., 0])
    assert (relative.compliance(C) @ w[..., None])[..., 0] == pytest.approx(bent)
