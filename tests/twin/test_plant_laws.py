"""Laws of the plant's parts: play and gears on both sides, a hose that only pulls, means that lie in the middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.geometry import pose, rotation
from counterflex.twin.plant.controller import moving_mean
from counterflex.twin.plant.friction import play_torque
from counterflex.twin.plant.gear_curves import gear_torque, wind_up
from counterflex.twin.plant.hose import Hose
from counterflex.twin.plant.process import as_ground
from counterflex.twin.truth.other import ToolOff

QUICK = settings(max_examples=60)
seed = st.integers(0, 2**31)
angle = st.floats(-3e-3, 3e-3)
CURVE = np.array([100.0, 400.0, 0.5, 0.8, 1.3, 0.0, 0.0, 1.0])
"""Knees at 100 and 400 N m; half, four fifths and 1.3 times the stiffness."""


@QUICK
@given(angle, st.floats(0.0, 1e-3))
def test_play_holds_back_on_both_sides_alike(x: float, band: float) -> None:
    torque = play_torque(x, 1e6, band)
    assert play_torque(-x, 1e6, band) == -torque
    assert torque == pytest.approx(-1e6 * np.sign(x) * max(abs(x) - band, 0.0), abs=1e-9)


@QUICK
@given(angle, st.floats(0.0, 1e-3))
def test_a_gear_holds_back_on_both_sides_alike_and_winds_up_by_its_inverse(x: float, band: float) -> None:
    torque = float(gear_torque(x, 1e6, band, CURVE))
    assert float(gear_torque(-x, 1e6, band, CURVE)) == -torque
    assert torque * x <= 0.0
    beyond = np.sign(x) * max(abs(x) - band, 0.0)
    assert wind_up(-torque, 1e6, CURVE) == pytest.approx(beyond, abs=1e-12)


@QUICK
@given(st.floats(-2000.0, 2000.0))
def test_the_slope_of_a_gear_is_that_of_its_stretch(torque: float) -> None:
    load = abs(torque)
    if min(abs(load - 100.0), abs(load - 400.0)) < 2.0:
        return
    share = 0.5 if load < 100.0 else 0.8 if load < 400.0 else 1.3
    slope = (wind_up(torque + 1.0, 1e6, CURVE) - wind_up(torque - 1.0, 1e6, CURVE)) / 2.0
    if load > 1.0:
        assert slope == pytest.approx(1.0 / (share * 1e6), rel=1e-6)


HOSE = Hose(np.array([0.0, 0.0, 0.1]), np.array([0.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
GRAVITY = np.array([0.0, 0.0, -9.81])


@QUICK
@given(seed, st.floats(0.1, 1.5))
def test_a_hose_pulls_when_it_is_taut_and_never_pushes(number: int, distance: float) -> None:
    """Along its chord, by what it is longer than its slack; half of its weight hangs on each end in any posture."""
    rng = np.random.default_rng(number)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    T_tool = pose.make(rotation.exp(rng.normal(size=3)), rng.normal(size=3))
    near = pose.transform(T_tool, HOSE.p_tool_clamp)
    R_arm = rotation.exp(rng.normal(size=3))
    T_arm = pose.make(R_arm, near + distance * way - R_arm @ HOSE.p_arm_clamp)
    place, w = HOSE.on_tool(T_arm, T_tool, GRAVITY)
    np.testing.assert_allclose(place, near, atol=1e-12)
    pull = w[:3] - 0.5 * HOSE.mass_kg * GRAVITY
    np.testing.assert_allclose(pull, HOSE.pull_n_m * max(0.0, distance - HOSE.slack_m) * way, atol=1e-9)
    np.testing.assert_allclose(w[3:] @ way, 0.0, atol=1e-12)


@QUICK
@given(seed, st.integers(0, 8), st.integers(20, 60))
def test_a_smoothed_command_lies_in_the_middle_of_its_window(number: int, half: int, n: int) -> None:
    """A reversed command is smoothed to the reversed result: it comes neither early nor late."""
    q = np.cumsum(np.random.default_rng(number).normal(size=(n, 6)), axis=0)
    out = moving_mean(q, 2 * half + 1)
    np.testing.assert_allclose(moving_mean(q[::-1], 2 * half + 1)[::-1], out, atol=1e-9)
    for k in range(half, n - half):
        np.testing.assert_allclose(out[k], q[k - half : k + half + 1].mean(axis=0), atol=1e-9)
    assert out.shape == q.shape


@pytest.mark.parametrize("off", [-0.2 * MM, 0.3 * MM])
def test_a_tool_ground_to_another_diameter_keeps_its_kind(off: float) -> None:
    ball = Cutter(diameter_m=10.0 * MM, corner_radius_m=5.0 * MM)
    flat, bull = replace(ball, corner_radius_m=0.0), replace(ball, corner_radius_m=1.0 * MM)
    made = [as_ground(one, ToolOff(1, 0.0, off)) for one in (ball, flat, bull)]
    assert [one.diameter_m for one in made] == pytest.approx([10.0 * MM + off] * 3)
    assert made[0].is_ball
    assert [one.corner_radius_m for one in made[1:]] == [0.0, 1.0 * MM]
