"""Axis angles against the pose of the same telegram: what is consistent is believed, what is not is told at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.runtime.plausibility.axis_check import ABOUT, EXACT, AxisCheck
from counterflex.runtime.plausibility.limits import AxisTolerance
from counterflex.runtime.state.states import Cause

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
BEGIN = np.radians([2.0, -90.0, 120.0, 5.0, 30.0, -8.0])
END = np.radians([20.0, -75.0, 105.0, 25.0, 45.0, 20.0])
NO_CORRECTION = np.zeros(6)
PERIOD_S = 4e-3
A2 = 1


def along(n: int = 600) -> Float:
    """(n, 6) rad, a motion of all axes, the tool turned by tens of degrees."""
    out: Float = BEGIN + np.linspace(0.0, 1.0, n)[:, None] * (END - BEGIN)
    return out


def controller_poses(q: Float, *, base: Float | None = None, tool: Float | None = None) -> Float:
    """(n, 12) poses as a controller with another BASE and TOOL shows them, part frame."""
    chain = CELL.controller_chain
    T = pose.inverse(CELL.T_base_part) @ forward(chain, q)
    T = T if tool is None else T @ tool
    T = T if base is None else base @ T
    out: Float = np.concatenate([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]], axis=1)
    return out


def learnt(check: AxisCheck, q: Float, shown: Float, cycles: int = 60) -> int:
    """What is said after standing for some cycles before arming."""
    told = 0
    for _ in range(cycles):
        told = check(q.copy(), shown, NO_CORRECTION, learn=True)
    return told


def small(x_mm: float, turn_deg: float) -> Float:
    return pose.make(rotation.about_z(turn_deg * DEG), np.array([x_mm, -0.5 * x_mm, 0.3 * x_mm]) * MM)


@pytest.mark.parametrize(
    ("base", "tool"),
    [(None, None), (None, small(5.0, 0.5)), (small(12.0, 1.0), None), (small(8.0, -0.7), small(5.0, 1.0))],
)
def test_a_constant_offset_of_base_and_tool_is_no_disagreement(base: Float | None, tool: Float | None) -> None:
    """Learnt at the first posture, held along a path on which the tool turns by tens of degrees."""
    q = along()
    shown = controller_poses(q, base=base, tool=tool)
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    assert learnt(check, q[0], shown[0]) == Cause.NONE
    told = {check(angles.copy(), at, NO_CORRECTION, learn=False) for angles, at in zip(q, shown, strict=True)}
    assert told == {Cause.NONE}


def test_geometry_of_the_controller_may_differ_by_tenths() -> None:
    """A chain whose segments are displaced by up to 0.3 mm and 0.01 deg each against the description."""
    rng = np.random.default_rng(4)
    chain = CELL.controller_chain
    off = chain.fixed.copy()
    for i in range(chain.n):
        off[i] = off[i] @ pose.make(rotation.exp(rng.uniform(-0.01, 0.01, 3) * DEG), rng.uniform(-0.3, 0.3, 3) * MM)
    other: ElasticChain = replace(chain, fixed=off)
    q = along()
    shown = controller_poses(q)
    check = AxisCheck(other, CELL.T_base_part, PERIOD_S)
    assert learnt(check, q[0], shown[0]) == Cause.NONE
    assert {check(a.copy(), p, NO_CORRECTION, learn=False) for a, p in zip(q, shown, strict=True)} == {Cause.NONE}


Wrong = Callable[[Float], Float]


def _plus_20(q: Float) -> Float:
    out: Float = q + 20.0 * DEG * np.eye(6)[A2]
    return out


def _sign(q: Float) -> Float:
    out: Float = q * np.where(np.arange(6) == 3, -1.0, 1.0)
    return out


def _degrees(q: Float) -> Float:
    return q / DEG


def _radians_as_degrees(q: Float) -> Float:
    return q * DEG


def _swapped(q: Float) -> Float:
    return q[[0, 2, 1, 3, 4, 5]]


WRONG: list[Wrong] = [_plus_20, _sign, _degrees, _radians_as_degrees, _swapped]


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_angles_in_one_telegram_are_told_in_it_and_not_used(wrong: Wrong) -> None:
    """The last angles that agreed stand in their place; the next telegram is believed again."""
    q = along()
    shown = controller_poses(q, tool=small(5.0, 0.0))
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    learnt(check, q[0], shown[0])
    for k in range(300):
        assert check(q[k].copy(), shown[k], NO_CORRECTION, learn=False) == Cause.NONE
    given = wrong(q[300])
    assert check(given, shown[300], NO_CORRECTION, learn=False) == Cause.AXIS_ANGLES
    assert np.array_equal(given, q[299])
    assert check(q[301].copy(), shown[301], NO_CORRECTION, learn=False) == Cause.NONE


@pytest.mark.parametrize("wrong", WRONG)
def test_angles_that_were_never_right_are_told_before_arming(wrong: Wrong) -> None:
    q = along()[300]
    shown = controller_poses(q[None])[0]
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    assert learnt(check, wrong(q), shown) != Cause.NONE


def test_the_least_that_is_seen() -> None:
    """3 mm of the pose, and 0.3 deg of it, in one telegram; 1 mm and 0.1 deg are within the calibration."""
    q = along()
    shown = controller_poses(q)
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    learnt(check, q[0], shown[0])
    for axis, told in ((9, Cause.AXIS_ANGLES), (10, Cause.AXIS_ANGLES), (11, Cause.AXIS_ANGLES)):
        moved = shown[0].copy()
        moved[axis] += 1.0 * MM
        assert check(q[0].copy(), moved, NO_CORRECTION, learn=False) == Cause.NONE
        moved[axis] += 2.0 * MM
        assert check(q[0].copy(), moved, NO_CORRECTION, learn=False) == told
    for turned, said in ((0.1, Cause.NONE), (0.3, Cause.AXIS_ANGLES)):
        other = shown[0].copy()
        other[:9] = (rotation.about_x(turned * DEG) @ other[:9].reshape(3, 3)).reshape(-1)
        assert check(q[0].copy(), other, NO_CORRECTION, learn=False) == said


def test_a_wrong_base_is_told() -> None:
    """30 mm beside the cell file's part frame; with a larger limit it is a frame offset like any other."""
    q = along()
    shown = controller_poses(q, base=pose.make(p=np.array([0.03, 0.0, 0.0])))
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    assert learnt(check, q[0], shown[0]) == Cause.FRAME_OFFSET
    assert check.offset[:3] == pytest.approx([0.03, 0.0, 0.0], abs=1e-6)
    wide = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S, AxisTolerance(offset_m=0.05))
    assert learnt(wide, q[0], shown[0]) == Cause.NONE


def test_a_correction_in_the_set_angles_is_no_disagreement() -> None:
    """Whether set angles contain it differs between controllers: 2 mm are sent, the pose is 3.5 mm off."""
    q = along()
    shown = controller_poses(q)
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    learnt(check, q[0], shown[0])
    moved, sent = shown[0].copy(), np.zeros(6)
    moved[10] += 3.5 * MM
    assert check(q[0].copy(), moved, sent, learn=False) == Cause.AXIS_ANGLES
    sent[1] = 2.0 * MM
    assert check(q[0].copy(), moved, sent, learn=False) == Cause.NONE


def test_a_measured_pose_may_trail_the_commanded_one_but_not_lie_beside_it() -> None:
    """60 ms behind set angles is drive lag; RIst negated or turned is not, at a standstill or on the way."""
    q = along()
    shown = controller_poses(q)
    lag = 15
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)

    def told(k: int, measured: Float, *, learn: bool = False) -> int:
        return check(
            q[k].copy(), shown[k], NO_CORRECTION, learn=learn, commanded_is=EXACT, measured=measured, measured_is=ABOUT
        )

    for _ in range(60):
        told(0, shown[0], learn=True)
    assert {told(k, shown[max(0, k - lag)]) for k in range(400)} == {Cause.NONE}
    negated = shown[399 - lag].copy()
    negated[9:] *= -1.0
    assert told(400, negated) == Cause.AXIS_ANGLES
    turned = shown[400 - lag].copy()
    turned[:9] = (rotation.about_z(90.0 * DEG) @ turned[:9].reshape(3, 3)).reshape(-1)
    assert told(401, turned) == Cause.AXIS_ANGLES


def test_a_pose_that_jumps_beside_measured_angles_stays_told() -> None:
    """RIst as the only pose beside set angles: 100 mm for a second are told in every cycle, then it goes on."""
    q = along()
    shown = controller_poses(q)
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)

    def told(k: int, at: Float, *, learn: bool = False) -> int:
        return check(q[k].copy(), at, NO_CORRECTION, learn=learn, commanded_is=ABOUT)

    for _ in range(60):
        assert told(0, shown[0], learn=True) == Cause.NONE
    assert {told(k, shown[max(0, k - 15)]) for k in range(200)} == {Cause.NONE}
    jumped = shown[185].copy()
    jumped[10] += 0.1
    assert {told(200, jumped) for _ in range(250)} == {Cause.AXIS_ANGLES}
    assert told(200, shown[185]) == Cause.NONE


def test_what_is_no_number_is_left_to_the_step() -> None:
    check = AxisCheck(CELL.controller_chain, CELL.T_base_part, PERIOD_S)
    q = BEGIN.copy()
    q[2] = np.nan
    assert check(q, controller_poses(BEGIN[None])[0], NO_CORRECTION, learn=False) == Cause.NONE
    assert np.isnan(q[2])


def test_tolerances_are_above_zero() -> None:
    with pytest.raises(InputError, match="axis check: position_m"):
        AxisTolerance(position_m=0.0)
