"""Laws of single axes: each yields by its own torque, counts either way alike, and each of its limits is checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.axis_sag import TERMS, AxisSag, unit_turns
from counterflex.robot.elasticity.chain import ElasticChain, axis_deflections, frames, jacobian, rigid_axes
from counterflex.robot.elasticity.compliance import (
    cartesian_compliance,
    deflection,
    element_jacobians,
    element_loads,
    linear_gap,
    shares,
)
from counterflex.robot.elasticity.gravity import sag
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Play, Robot, Segment, Servo

QUICK = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
seed = st.integers(0, 2**31)
some_axes = st.lists(st.integers(0, 5), min_size=1, max_size=6, unique=True)
KR300 = catalog.load("kuka_kr300_r2500_ultra")


def drawn(number: int) -> tuple[Float, Float]:
    """Angles and a wrench on the tool."""
    rng = np.random.default_rng(number)
    q = rng.uniform(-1.0, 1.0, 6) + np.array([0.0, -1.5, 1.6, 0.0, 0.5, 0.0])
    return q, rng.normal(size=6) * [300.0, 300.0, 300.0, 40.0, 40.0, 40.0]


@QUICK
@given(seed, some_axes)
def test_an_axis_yields_by_its_own_torque_whichever_others_are_asked_for(
    haehn: ElasticChain, number: int, axes: list[int]
) -> None:
    """(k, 3) per stiffness of 1: column of the Jacobian times the torque that the load makes about this axis."""
    q, w = drawn(number)
    J = jacobian(haehn, q)
    found = axis_deflections(haehn, q, w, tuple(axes))
    for k, axis in enumerate(axes):
        np.testing.assert_allclose(found[k], J[:3, axis] * (J[:, axis] @ w), rtol=1e-9)
    assert rigid_axes(haehn) == ()


@QUICK
@given(seed, st.floats(0.2, 5.0))
def test_every_segment_scaled_alike_scales_the_deflection(heavy: ElasticChain, number: int, factor: float) -> None:
    """Linear in the compliance of each, in the load, and the shares add up to the whole."""
    q, w = drawn(number)
    softer = replace(heavy, compliance=factor * heavy.compliance)
    one, other = shares(heavy, q, w), shares(softer, q, w)
    np.testing.assert_allclose(other, factor * one, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(shares(heavy, q, -w), -one, rtol=1e-9, atol=1e-18)
    gap, doubled = (linear_gap(heavy, q, s * w) for s in (1.0, 0.5))
    assert np.linalg.norm(doubled[:3]) < 0.3 * np.linalg.norm(gap[:3]) + 1e-12


@QUICK
@given(seed)
def test_the_load_of_an_element_does_the_work_of_the_load_on_the_tool(heavy: ElasticChain, number: int) -> None:
    """By virtual work: what a unit of the element moves at the tool, times the wrench there."""
    q, w = drawn(number)
    loads = element_loads(heavy, q, w)
    np.testing.assert_allclose(loads, np.einsum("nij,i->nj", element_jacobians(heavy, q), w), rtol=1e-9, atol=1e-9)


@QUICK
@given(seed)
def test_the_gap_is_what_the_linear_form_lacks(heavy: ElasticChain, number: int) -> None:
    """The product of compliance and load, and the gap, make up the whole deflection."""
    q, w = drawn(number)
    whole = cartesian_compliance(heavy, q) @ w + linear_gap(heavy, q, w)
    np.testing.assert_allclose(whole, deflection(heavy, q, w), rtol=1e-12, atol=1e-15)


@QUICK
@given(seed, st.integers(0, 5), st.sampled_from([-1.0, 1.0]), st.integers(0, 3), st.integers(0, 3))
def test_one_point_beyond_an_elastic_model_is_refused_among_others(
    heavy: ElasticChain, number: int, row: int, sign: float, before: int, behind: int
) -> None:
    """Wherever it stands, whichever way it deflects, and as it is alone."""
    q, w = drawn(number)
    C = cartesian_compliance(heavy, q)[row]
    beyond = sign * C / (C @ C) * (1.2 if row < 3 else 0.25)
    loads = np.stack([*[w] * before, beyond, *[-w] * behind])
    with pytest.raises(ModelError, match="beyond any elastic model"):
        deflection(heavy, np.tile(q, (len(loads), 1)), loads, nonlinear=False)
    deflection(heavy, np.tile(q, (len(loads), 1)), np.where(loads == beyond, w, loads), nonlinear=False)


def carrying(bodies: list[tuple[float, Float]]) -> ElasticChain:
    """The robot with rigid bodies on its flange: mass and centre of gravity of each, in flange axes."""
    segments, T_before = [], np.eye(4)
    for k, (mass_kg, p_flange_com) in enumerate(bodies):
        T = pose.make(rotation.exp(np.array([0.3, -0.2, 0.5]) * (k + 1)), np.array([0.01, 0.02, 0.03]) * (k + 1))
        segments.append(
            Segment(
                f"body{k}", pose.inverse(T_before) @ T, mass_kg=mass_kg,
                p_seg_com=pose.transform(pose.inverse(T), p_flange_com),
            )
        )  # fmt: skip
        T_before = T
    tip = pose.make(p=np.array([0.1, 0.0, 0.3]))
    return ElasticChain.build(KR300, EndEffector(tuple(segments), pose.inverse(T_before) @ tip))


@QUICK
@given(seed, st.lists(st.floats(1.0, 60.0), min_size=2, max_size=4))
def test_bodies_on_one_link_weigh_as_one_in_their_common_centre(number: int, masses: list[float]) -> None:
    q, w = drawn(number)
    places = np.random.default_rng(number).uniform(-0.2, 0.2, (len(masses), 3))
    apart = carrying(list(zip(masses, places, strict=True)))
    as_one = carrying([(sum(masses), np.average(places, axis=0, weights=masses))])
    np.testing.assert_allclose(sag(apart, q), sag(as_one, q), rtol=1e-7, atol=1e-12)
    for gravity in (True, False):
        one, other = (deflection(chain, q, w, gravity=gravity) for chain in (apart, as_one))
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-12)


def unweighted() -> ElasticChain:
    """An arm whose masses are not known."""
    chain = ElasticChain.build(KR300)
    return replace(chain, mass=np.zeros_like(chain.mass))


ARM = unweighted()
moments = st.lists(st.floats(-5e-3, 5e-3), min_size=6, max_size=6)


@QUICK
@given(seed, moments, moments)
def test_the_terms_of_a_sag_add_up(number: int, one: list[float], other: list[float]) -> None:
    q, _ = drawn(number)
    turns = [AxisSag(ARM, np.array(m)).turns(q) for m in (one, other, np.add(one, other))]
    np.testing.assert_allclose(turns[2], turns[0] + turns[1], atol=1e-15)
    each = unit_turns(ARM, q) * np.array(one)
    for axis in range(6):
        own = sum(each[k] for k, (turned, _, _) in enumerate(TERMS) if turned == axis)
        assert turns[0][axis] == pytest.approx(own, abs=1e-15)


@QUICK
@given(seed, st.sampled_from([1, 2]), moments)
def test_an_axis_that_counts_the_other_way_sags_the_same_way(number: int, axis: int, moment: list[float]) -> None:
    """Drive and angle with the other sign are the same arm: its turn has the other sign, those of others stay."""
    q, _ = drawn(number)
    sign, offset = ARM.sign.copy(), ARM.offset.copy()
    sign[np.flatnonzero(ARM.joint == axis)[0]] *= -1.0
    other = replace(ARM, sign=sign, offset=offset)
    q_other = q.copy()
    q_other[axis] *= -1.0
    np.testing.assert_allclose(frames(other, q_other), frames(ARM, q), atol=1e-12)
    plain, turned = AxisSag(ARM, np.array(moment)).turns(q), AxisSag(other, np.array(moment)).turns(q_other)
    plain[axis] *= -1.0
    np.testing.assert_allclose(turned, plain, atol=1e-12)


@QUICK
@given(seed)
def test_a_sag_of_an_upright_arm_is_that_of_the_moment_of_its_weight(number: int) -> None:
    """A mass on a link pulls the axis down by the moment of a unit force along gravity, about that axis."""
    q, _ = drawn(number)
    T = frames(ARM, q)
    first = {axis: int(np.flatnonzero(ARM.joint == axis)[0]) for axis in (1, 2)}
    for k, (axis, link, direction) in enumerate(TERMS):
        arm = T[first[link], :3, "xyz".index(direction)]
        moment = np.cross(arm, np.array([0.0, 0.0, -1.0])) @ T[first[axis], :3, 2]
        sign = ARM.sign[first[axis]]
        assert unit_turns(ARM, q)[k] == pytest.approx(sign * moment, abs=1e-12)


@pytest.mark.parametrize("axis", range(6))
def test_limits_of_every_axis_are_checked(axis: int) -> None:
    limits = KR300.joint_limits_rad.copy()
    limits[axis] = limits[axis, ::-1]
    with pytest.raises(ModelError, match="lower joint limit"):
        ElasticChain.build(replace(KR300, joint_limits_rad=limits))


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (Play(half_band_rad=0.02), "half_band_rad"),
        (Play(half_band_rad=-1e-6), "half_band_rad"),
        (Play(friction_nm=(10.0, 2e5), slip_rad=(1e-4, 1e-4)), "friction_nm"),
        (Play(friction_nm=(10.0, -1.0), slip_rad=(1e-4, 1e-4)), "friction_nm"),
        (Play(friction_nm=(10.0, 10.0), slip_rad=(1e-4, 0.02)), "slip_rad"),
        (Play(friction_nm=(10.0, 10.0), slip_rad=(1e-9, 1e-4)), "slip_rad"),
    ],
)
def test_play_of_every_axis_and_element_is_checked(axis: int, wrong: Play, name: str) -> None:
    play = tuple(wrong if k == axis else None for k in range(6))
    with pytest.raises(ModelError, match=rf"play of axis {axis + 1}: {name} is out of range"):
        ElasticChain.build(replace(KR300, play=play))


def limited(axis: int, low: float, high: float) -> Robot:
    limits = KR300.joint_limits_rad.copy()
    limits[axis] = low, high
    return replace(KR300, joint_limits_rad=limits)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(("low", "high"), [(-1001.0, 1.0), (-1.0, 1001.0), (0.5, 0.5)])
def test_limits_in_degrees_are_refused_on_either_side(axis: int, low: float, high: float) -> None:
    with pytest.raises(ModelError, match="limit"):
        ElasticChain.build(limited(axis, low, high))
    ElasticChain.build(limited(axis, max(low, -1000.0), min(high, 1000.0) + 1e-3 * (high == low)))


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("speed", [0.0, -1.0])
def test_every_axis_can_move(axis: int, speed: float) -> None:
    speeds = np.full(6, 2.0)
    ElasticChain.build(replace(KR300, joint_speeds_rad_s=speeds))
    speeds[axis] = speed
    with pytest.raises(ModelError, match="not positive"):
        ElasticChain.build(replace(KR300, joint_speeds_rad_s=speeds))


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("speed_gain_nm_s", 1e-3, 1e9),
        ("position_gain_per_s", 0.1, 1e4),
        ("integral_time_s", 1e-4, 100.0),
        ("friction_nm", 0.0, 1e5),
        ("slip_rad", 1e-7, 1e-2),
    ],
)
def test_gains_of_every_axis_are_checked_at_both_ends(axis: int, name: str, low: float, high: float) -> None:
    """Whether those of other axes are known or not; both ends belong to the range."""
    good = Servo(1e4, 20.0, 0.05)
    for others in (None, good):
        for value, fits in ((low, True), (high, True), (low - 1e-3 * (low or 1.0), False), (1.001 * high, False)):
            robot = replace(
                KR300, servo=tuple(replace(good, **{name: value}) if k == axis else others for k in range(6))
            )
            if fits:
                ElasticChain.build(robot)
                continue
            with pytest.raises(ModelError, match=f"servo of axis {axis + 1}: {name} is out of range"):
                ElasticChain.build(robot)


@pytest.mark.parametrize("direction", range(6))
@pytest.mark.parametrize("place", range(3))
def test_compliances_of_every_segment_are_checked_in_every_direction(direction: int, place: int) -> None:
    largest = 1e-4 if direction < 3 else 1e-2
    for value, said in ((-1e-12, "negative"), (1.001 * largest, "implausibly large"), (largest, "")):
        compliance = np.zeros(6)
        compliance[direction] = value
        segments = tuple(
            Segment(f"s{k}", np.eye(4), compliance=compliance if k == place else np.zeros(6)) for k in range(3)
        )
        tool = EndEffector(segments, pose.make(p=np.array([0.0, 0.0, 0.2])))
        if said:
            with pytest.raises(ModelError, match=said):
                ElasticChain.build(KR300, tool)
        else:
            ElasticChain.build(KR300, tool)
