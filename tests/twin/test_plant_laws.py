"""Laws of the plant's parts: play on both sides, a hose that only pulls, slow changes, means in the middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.robot.model.description import ElasticRegion
from counterflex.twin.plant.controller import CommandedReference, Controller, as_it_is, moving_mean
from counterflex.twin.plant.friction import play_torque
from counterflex.twin.plant.mjcf import coordinates as coordinates_of
from counterflex.twin.plant.other_forces import PostureSprings, gear_torque, wind_up
from counterflex.twin.plant.process import LAG_CELLS, StockCutting, as_ground
from counterflex.twin.plant.slow_changes import Hose, SlowChanges
from counterflex.twin.truth.other import ControllerKind, HosePack, OtherPhysics, Thermal, ToolOff
from counterflex.twin.truth.truth import CuttingTruth, Truth

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
    leaves = T_tool[:3, :3] @ HOSE.tool_exit  # it turns the clamp towards where the hose goes, by the sine of the angle
    np.testing.assert_allclose(np.cross(w[3:], leaves) @ way, HOSE.bending_nm * (1.0 - (leaves @ way) ** 2), atol=1e-9)


def slow(truth: Truth, other: OtherPhysics) -> tuple[SlowChanges, tuple[Float, Float], list[tuple[str, Float, Float]]]:
    """Slow changes of a truth, the ends that they move, and the wrenches that they push with."""
    ends, pushed = (np.array([0.1, 0.2, 0.3]), np.array([-0.4, 0.5, 0.6])), []
    T_of = {
        truth.bodies[-1].name: pose.make(rotation.exp(np.array([0.4, -0.7, 0.2])), np.array([1.2, 0.1, 0.9])),
        truth.bodies[2].name: pose.make(rotation.exp(np.array([-0.3, 0.1, 0.8])), np.array([0.3, -0.1, 0.4])),
    }

    def push(body: str, place: Float, w: Float, _: Float) -> None:
        pushed.append((body, place, w))

    return SlowChanges(replace(truth, other=other), ends, T_of.__getitem__, push), ends, pushed


clamp = st.tuples(*[st.floats(-0.2, 0.2)] * 3)


@QUICK
@given(clamp, clamp, st.floats(0.0, 20.0), st.floats(0.0, 1.5), st.floats(0.0, 40.0))
def test_a_hose_holds_nothing_but_its_weight(
    truth: Truth,
    far: tuple[float, float, float],
    near: tuple[float, float, float],
    mass_kg: float,
    slack_m: float,
    bending_nm: float,
) -> None:
    """What it does to both ends together is its own weight, half of it at each: in force and in moment."""
    arm = truth.bodies[2].name
    pack = HosePack(arm, far, near, mass_kg, slack_m, 300.0, bending_nm)
    changes, _, pushed = slow(truth, OtherPhysics(hose=pack))
    changes.pull(np.zeros(12))
    half = 0.5 * mass_kg * truth.gravity_base
    np.testing.assert_allclose(sum(w[:3] for _, _, w in pushed), 2.0 * half, atol=1e-9)
    moments = sum(w[3:] + np.cross(place, w[:3]) for _, place, w in pushed)
    np.testing.assert_allclose(moments, sum(np.cross(place, half) for _, place, _ in pushed), atol=1e-9)
    assert [name for name, _, _ in pushed] == [truth.bodies[-1].name, arm]


@QUICK
@given(
    st.lists(st.floats(0.0, 4000.0), min_size=1, max_size=5), clamp, st.floats(-50e-6, 50e-6),
    st.floats(10.0, 2000.0), st.floats(10.0, 2000.0), st.floats(-1e-3, 1e-3),
)  # fmt: skip
def test_warmth_depends_on_the_time_and_not_on_how_often_it_was_looked_at(
    truth: Truth, times: list[float], arm: tuple[float, float, float], spindle_m: float, spindle_s: float,
    arm_s: float, longer_m: float,
) -> None:  # fmt: skip
    """``end (1 - exp(-t / tau))``: the spindle grows along the tool out of it, the arm drifts from where it began."""
    changes, (tip, base), _ = slow(truth, OtherPhysics(thermal=Thermal(0.0, spindle_m, spindle_s, arm, arm_s)))
    changes.tool_growth_m = longer_m
    before = tip.copy(), base.copy()
    for time_s in times:
        changes.update(time_s)
    grown = longer_m + spindle_m * (1.0 - np.exp(-times[-1] / spindle_s))
    np.testing.assert_allclose(tip, before[0] + grown * truth.T_last_tcp[:3, 2], atol=1e-15)
    np.testing.assert_allclose(base, before[1] + (1.0 - np.exp(-times[-1] / arm_s)) * np.array(arm), atol=1e-15)


@QUICK
@given(
    st.lists(st.floats(-2.5, 2.5), min_size=2, max_size=5, unique_by=lambda x: round(x, 2)),
    st.lists(st.floats(0.3, 3.0), min_size=5, max_size=5), st.integers(0, 5), st.floats(-3.0, 3.0),
)  # fmt: skip
def test_a_spring_is_that_of_its_angle_and_fades_to_the_mean_beyond_its_range(
    truth: Truth, angles: list[float], factors: list[float], axis: int, q_axis: float
) -> None:
    """Between two angles by straight lines, from the end of the range to 10 degrees beyond it to the mean."""
    angles, factors = sorted(angles), factors[: len(angles)]
    region = ElasticRegion(truth.bodies[1].name, 5, axis, tuple(angles), tuple(factors))
    coordinates = coordinates_of(truth)
    springs = PostureSprings(replace(truth, regions=(region,)), coordinates)
    fade = np.radians(10.0)
    steps = [angles[0] - fade, *angles, angles[-1] + fade]
    q = np.full(6, 0.1)
    q[axis] = q_axis
    found, mean = springs.stiffness(q), coordinates.stiffness
    (place,) = np.flatnonzero((coordinates.body == 1) & (coordinates.kind == 5))
    assert mean[place] / found[place] == pytest.approx(np.interp(q_axis, steps, [1.0, *factors, 1.0]), rel=1e-9)
    others = np.arange(len(found)) != place
    np.testing.assert_array_equal(found[others], mean[others])
    assert springs.stiffest[place] == pytest.approx(mean[place] / min(1.0, *factors))


@pytest.mark.parametrize("smoothing_s", [0.0, 0.05])
def test_speeds_of_references_lie_at_their_own_time(controller: Controller, smoothing_s: float) -> None:
    """The speed at a cycle is that from the one before to the one behind it: neither ahead nor behind."""
    p = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.02, 0.01, 0.0], [0.0, 0.013, 0.004]])
    path = ToolPath(
        p, np.tile([0.0, 0.0, 1.0], (4, 1)), np.full(4, FEED), np.full(4, 0.05), np.full(4, 1000.0), np.arange(4.0),
        np.arange(4), np.ones(4, dtype=np.int64),
    )  # fmt: skip
    made = CommandedReference.interpolated(path, replace(controller, smoothing_s=smoothing_s))
    steps = np.diff(made.q_ref, axis=0) / controller.cycle_s
    np.testing.assert_allclose(made.qd_ref[1:-1], 0.5 * (steps[:-1] + steps[1:]), atol=1e-9)
    assert np.abs(np.diff(steps, axis=0)).max() > 1e-4


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


@QUICK
@given(st.floats(0.0, 3.0), st.floats(0.0, 0.1))
def test_a_controller_of_another_kind_blends_by_a_share_of_its_own(
    controller: Controller, share: float, smoothing_s: float
) -> None:
    blending_m = 3.0 * MM
    made = as_it_is(
        replace(controller, blending_m=blending_m), ControllerKind(blending_share=share, smoothing_s=smoothing_s)
    )
    assert made.blending_m == pytest.approx(share * blending_m)
    assert made.smoothing_s == smoothing_s
    assert replace(made, blending_m=controller.blending_m, smoothing_s=controller.smoothing_s) == controller
    assert as_it_is(controller, None) is controller


@settings(max_examples=15)
@given(seed)
def test_material_is_taken_out_a_few_cells_behind_the_tool(cutting: CuttingTruth, number: int) -> None:
    """Whatever the steps: what is farther behind than the lag is gone, what is nearer is there until the end."""
    rng, cell = np.random.default_rng(number), 0.5 * MM
    block = HeightMap.from_box((0.0, 0.0, 0.0), (40.0 * MM, 10.0 * MM, 5.0 * MM), cell)
    tool = Cutter(diameter_m=4.0 * MM)
    process = StockCutting(block, tool, cutting, 1e-3, np.eye(4))
    row, lag = int(np.argmin(np.abs(block.y_m() - 5.0 * MM))), LAG_CELLS * cell
    x = -3.0 * MM
    process.restart(np.array([x, 5.0 * MM, 3.0 * MM]))
    process.advance(np.array([x, 5.0 * MM, 3.0 * MM]))
    while x < 30.0 * MM:
        step = rng.uniform(0.05, 1.5) * MM
        x += step
        process.advance(np.array([x, 5.0 * MM, 3.0 * MM]))
        z = process.stock.z[row]
        gone = block.x_m() < x - lag - 1.6 * MM + tool.radius_m - cell
        kept = block.x_m() > x - lag + tool.radius_m + cell
        np.testing.assert_allclose(z[gone], 3.0 * MM, atol=1e-6)
        np.testing.assert_allclose(z[kept], 5.0 * MM, atol=1e-6)
    z = process.finish().z[row]
    np.testing.assert_allclose(z[block.x_m() < x + tool.radius_m - cell], 3.0 * MM, atol=1e-6)


@pytest.mark.parametrize("speed_rad_s", [20.0, 300.0, 1500.0])
def test_a_spindle_that_turns_left_remembers_as_long_as_one_that_turns_right(
    cutting: CuttingTruth, speed_rad_s: float
) -> None:
    """The time of one tooth, whichever way it turns; one that is too slow is refused either way."""
    block = HeightMap.from_box((0.0, 0.0, 0.0), (10.0 * MM, 10.0 * MM, 5.0 * MM), 0.5 * MM)
    process = StockCutting(block, Cutter(diameter_m=4.0 * MM), cutting, 1e-3, np.eye(4))
    process.spindle(speed_rad_s)
    right = process._delay
    process.spindle(-speed_rad_s)
    assert process._delay == right
    for way in (1.0, -1.0):
        with pytest.raises(InputError, match="turns too slowly"):
            process.spindle(way * 1e-3)
