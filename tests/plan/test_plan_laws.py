"""Laws of plans over uneven times and both directions: uncertain force, force at points, checks of spindle and axes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from counterflex.core.arrays import Int
from counterflex.core.errors import ModelError, ProgramError
from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan import cut as cutting
from counterflex.plan.chip_range import outside, uncertainty
from counterflex.plan.play_compensation import arrival
from counterflex.plan.preflight import joints
from counterflex.plan.preflight.approximation import Corners, corners_of
from counterflex.plan.preflight.held_speed import HeldSpeed, SpeedCause, held_speed
from counterflex.plan.preflight.preflight import Preflight
from counterflex.plan.preflight.row import CheckLimits, Row, Verdict, worst_of_axes
from counterflex.plan.preflight.spacing import blocks_of
from counterflex.plan.static_correction import LoadedRobot

QUICK = settings(max_examples=60)
LAW = KienzleLaw.from_k11(
    780e6, 0.27, kr11_pa=273e6, mr=0.27, ka11_pa=117e6, ma=0.27, h_min_m=0.01 * MM, h_max_m=0.1 * MM,
    source="test", status="assumed",
)  # fmt: skip
seed = st.integers(0, 2**31)


def path_of(rng: np.random.Generator, n: int, kind: Int | None = None) -> ToolPath:
    """Steps of uneven length and time, some rows without either."""
    moves = rng.random(n) < 0.85
    p = np.cumsum(rng.normal(size=(n, 3)) * 0.01 * moves[:, None], axis=0)
    passed = np.where(rng.random(n) < 0.9, rng.uniform(0.05, 1.5, n), 0.0) * moves
    return ToolPath(
        p, np.tile([0.0, 0.0, 1.0], (n, 1)), np.full(n, FEED) if kind is None else kind, np.full(n, 0.05),
        np.full(n, 100.0), np.cumsum(passed), np.cumsum(rng.random(n) < 0.3), np.ones(n, dtype=np.int64),
    )  # fmt: skip


# ---- force ---------------------------------------------------------------------------------------------------------


@QUICK
@given(seed, st.integers(3, 12))
def test_shares_of_a_force_are_those_of_its_impulse(number: int, n: int) -> None:
    """Summed row by row; a row that is divided unevenly in time changes none of them."""
    rng = np.random.default_rng(number)
    chip, contact = 10.0 ** rng.uniform(-5.5, -3.5, n), rng.random(n) < 0.8
    w, time_s = rng.normal(size=(n, 6)) * 100.0, np.cumsum(rng.uniform(0.01, 2.0, n))
    found = outside(LAW, chip, contact, w, time_s)
    total = uncertain = beyond = 0.0
    for k in range(1, n):
        force = float(np.linalg.norm(w[k, :3])) * (time_s[k] - time_s[k - 1])
        total += force * contact[k]
        uncertain += force * contact[k] * uncertainty(LAW, chip[k : k + 1])[0]
        beyond += force * contact[k] * (not 0.01 * MM <= chip[k] <= 0.1 * MM)
    assume(total > 0.0)
    assert found.uncertain_share == pytest.approx(uncertain / total)
    assert found.force_share == pytest.approx(beyond / total)
    out = [not 0.01 * MM <= thickness <= 0.1 * MM for thickness in chip]
    assert found.rows.tolist() == [bool(touches and beyond) for touches, beyond in zip(contact, out, strict=True)]
    np.testing.assert_array_equal(found.row_share > 0.0, found.rows)
    k = int(rng.integers(1, n))
    between = time_s[k - 1] + 0.2 * (time_s[k] - time_s[k - 1])
    twice = np.insert(np.arange(n), k, k)
    divided = outside(LAW, chip[twice], contact[twice], w[twice], np.insert(time_s, k, between))
    assert (divided.uncertain_share, divided.force_share) == pytest.approx((found.uncertain_share, found.force_share))


@QUICK
@given(seed, st.integers(2, 12))
def test_force_at_a_point_is_the_mean_of_both_segments_that_meet_there(number: int, n: int) -> None:
    """Row k is the segment that ends at point k; at the ends of a stretch one segment is all there is."""
    rng = np.random.default_rng(number)
    w, contact = rng.normal(size=(n, 6)), rng.random(n) < 0.7
    found = cutting.at_points(w, contact)
    for k in range(n):
        meeting = [w[j] for j in (k, k + 1) if j < n and contact[j]]
        np.testing.assert_allclose(found[k], np.mean(meeting, axis=0) if contact[k] else np.zeros(6), atol=1e-15)


@QUICK
@given(seed, st.integers(2, 12))
def test_a_spindle_must_turn_clockwise_wherever_a_feed_takes_material(number: int, n: int) -> None:
    rng = np.random.default_rng(number)
    kind = np.where(rng.random(n) < 0.7, FEED, RAPID)
    spindle = rng.choice([-100.0, 0.0, 100.0, 100.0, 100.0], n)
    volume = np.where(rng.random(n) < 0.5, 1e-9, 0.0)
    path = replace(path_of(rng, n, kind), spindle_rad_s=spindle)
    cuts = (kind == FEED) & (volume > 0.0)
    if np.any(cuts & (spindle == 0.0)):
        with pytest.raises(ProgramError, match="spindle stopped") as caught:
            cutting._check_spindle(path, kind, volume)
        row = int(np.flatnonzero(cuts & (spindle == 0.0))[0])
        assert f"motion {path.motion[row]}, at {np.round(path.p_part_tcp[row] / MM, 3).tolist()} mm" in str(
            caught.value
        )
    elif np.any(cuts & (spindle < 0.0)):
        with pytest.raises(ModelError, match="clockwise"):
            cutting._check_spindle(path, kind, volume)
    else:
        cutting._check_spindle(path, kind, volume)


@QUICK
@given(seed, st.integers(1, 8), st.floats(-0.02, 0.06))
def test_a_tool_is_far_above_only_where_all_of_its_way_is(number: int, n: int, lift_m: float) -> None:
    rng = np.random.default_rng(number)
    stock = HeightMap.from_box((0.0, 0.0, 0.0), (0.02, 0.02, 0.01), 0.001)
    stock.z[1, 2] = 0.02
    points, axis = rng.uniform(-0.01, 0.03, (n, 3)), rng.normal(size=(n, 3))
    points[:, 2] += lift_m
    axis[:, 2] += 1.5
    expected = all(p[2] > 0.02 and a[2] >= 0.0 for p, a in zip(points, axis, strict=True))
    assert cutting._far_above(points, axis, stock) == expected


@QUICK
@given(seed, st.integers(3, 12))
def test_a_tool_that_is_pushed_back_is_late_by_the_time_of_its_way(number: int, n: int) -> None:
    """Every row by its own direction and speed; a place that was left is not left again."""
    rng = np.random.default_rng(number)
    path, deflection = path_of(rng, n), rng.normal(size=(n, 3)) * 1e-3
    found, latest = arrival(path.p_part_tcp, path.time_s, deflection), -np.inf
    for k in range(n):
        step = path.p_part_tcp[k] - path.p_part_tcp[k - 1] if k else np.zeros(3)
        passed, length = (path.time_s[k] - path.time_s[k - 1] if k else 0.0), float(np.linalg.norm(step))
        late = -(deflection[k] @ step / length) / (length / passed) if length > 0.0 and passed > 0.0 else 0.0
        latest = max(latest, path.time_s[k] + late)
        assert found[k] == pytest.approx(latest)


@QUICK
@given(seed, st.integers(2, 14))
def test_a_place_is_judged_by_what_is_left_across_it_where_it_touches(number: int, n: int) -> None:
    """By the mean of the fourth power over 0.4 s, here of many instants; a step has the mean of its ends."""
    rng = np.random.default_rng(number)
    path = path_of(rng, n)
    path = replace(path, time_s=0.02 + np.cumsum(rng.uniform(0.005, 0.15, n)))
    contact, deviation = rng.random(n) < 0.7, rng.normal(size=(n, 6))
    loaded: Any = SimpleNamespace(inputs=SimpleNamespace(path=path), cut=SimpleNamespace(contact=contact))
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    power = [
        float(np.linalg.norm(np.cross(d[:3], s / np.linalg.norm(s)) if np.any(s != 0.0) else d[:3])) ** 4 * touches
        for d, s, touches in zip(deviation, step, contact, strict=True)
    ]
    for k, size in enumerate(LoadedRobot.size_about(loaded, deviation)):
        begin, end = np.clip(path.time_s[k] + np.array([-0.2, 0.2]), path.time_s[0], path.time_s[-1])
        instants = begin + (end - begin) * (np.arange(4000) + 0.5) / 4000
        after = np.searchsorted(path.time_s, instants)
        between = 0.5 * (np.array(power)[after - 1] + np.array(power)[after])
        assert size == pytest.approx(np.mean(between), rel=0.05, abs=1e-3)


# ---- axes ----------------------------------------------------------------------------------------------------------

ROBOT = np.random.default_rng(5).normal(size=(3, 6)) * 3.0
"""rad/m, angles of a made-up robot by the place of its tool."""
BOUNDS = CheckLimits(0.04, 0.09, acceleration_m_s2=1.0, least_block_s=1e-6, clearance_m=0.02, blending_m=0.0)


def backwards(path: ToolPath) -> ToolPath:
    """The same way the other way round; a row ends its segment, so what belongs to segments moves on by one."""

    def of_segments(values: Int) -> Int:
        return np.concatenate([values[-1:], values[1:][::-1]])

    return replace(
        path, p_part_tcp=path.p_part_tcp[::-1].copy(), time_s=path.time_s[-1] - path.time_s[::-1],
        motion=of_segments(path.motion.max() - path.motion), kind=of_segments(path.kind),
    )  # fmt: skip


@QUICK
@given(seed, st.integers(3, 12))
def test_a_way_asks_the_same_of_the_axes_in_both_directions(number: int, n: int) -> None:
    """Speeds change their sign, accelerations do not: braking forwards is speeding up backwards."""
    path = path_of(np.random.default_rng(number), n)
    other = backwards(path)
    speeds, back = (joints.joint_speeds(one, one.p_part_tcp @ ROBOT) for one in (path, other))
    np.testing.assert_allclose(back[1:], -speeds[1:][::-1], rtol=1e-9, atol=1e-12)
    step = np.diff(path.time_s, prepend=path.time_s[:1])
    assume(np.all(step[1:] > 0.0))  # a place that is passed twice has two rows
    here, there = (joints.joint_accelerations(one, v, 2.0) for one, v in ((path, speeds), (other, back)))
    np.testing.assert_allclose(np.abs(there[::-1]), np.abs(here), rtol=1e-9, atol=1e-9)


@QUICK
@given(seed, st.integers(3, 10))
def test_within_a_motion_an_axis_changes_its_speed_over_half_of_both_segments(number: int, n: int) -> None:
    rng = np.random.default_rng(number)
    path = replace(path_of(rng, n), motion=np.zeros(n, dtype=np.int64), time_s=np.cumsum(rng.uniform(0.2, 2.0, n)))
    speeds = joints.joint_speeds(path, path.p_part_tcp @ ROBOT)
    found = joints.joint_accelerations(path, speeds, 1e6)
    for k in range(1, n - 1):
        time_s = 0.5 * (path.time_s[k + 1] - path.time_s[k - 1])
        np.testing.assert_allclose(found[k], (speeds[k + 1] - speeds[k]) / time_s, rtol=1e-9, atol=1e-12)


@QUICK
@given(seed, st.integers(3, 12), st.booleans())
def test_rows_of_axes_show_the_worst_of_either_sign_where_it_is(number: int, n: int, known: bool) -> None:
    """By the share of the own limit where limits are known; feeds and rapids apart; cables to either side."""
    rng = np.random.default_rng(number)
    path = path_of(rng, n, np.where(rng.random(n) < 0.6, FEED, RAPID))
    speeds, limits = rng.normal(size=(n, 6)), rng.uniform(0.5, 3.0, 6)
    bounds = replace(BOUNDS, joint_speeds_rad_s=limits if known else None)
    for row, kind in zip(joints.speed_rows(path, speeds, bounds), (FEED, RAPID), strict=True):
        values = {(k, a): abs(speeds[k, a]) for k in range(n) for a in range(6) if path.kind[k] == kind}
        if not values:
            continue
        place = max(values, key=lambda at: values[at] / (limits[at[1]] if known else 1.0))
        assert row.point == place[0]
        assert row.value == pytest.approx(values[place])
        assert row.what.startswith(f"axis {place[1] + 1}")
        if known:
            beyond = values[place] > limits[place[1]]
            assert row.verdict == ("ok" if not beyond else "fail" if kind == FEED else "warning")
            assert row.what.endswith(f"{100 * values[place] / limits[place[1]]:.1f} %")
    margin = rng.normal(size=(n, 6)) + 0.5
    limit = joints.limit_row(margin, 0.1)
    assert (limit.value, margin[limit.point].min()) == (margin.min(), margin.min())
    assert limit.verdict == ("ok" if margin.min() >= 0.1 else "fail")
    assert f"axis {int(np.argmin(margin[limit.point])) + 1}" in limit.what
    assert ("out of its range" in limit.what) == (margin.min() < 0.0)
    q = rng.normal(size=(n, 6)) * 3.0
    for row, axis in zip(joints.cable_rows(q, {3: 4.0}), (3, 5), strict=True):
        largest = max(abs(angle) for angle in q[:, axis])
        assert (row.value, abs(q[row.point, axis])) == (largest, largest)
        assert row.verdict == ("not looked at" if axis == 5 else "fail" if largest > 4.0 else "ok")
        assert f"by {np.degrees(max(q[:, axis]) - min(q[:, axis])):.0f} deg" in row.what
    wrist = np.abs(rng.normal(size=n))
    near = joints.wrist_row(wrist, 0.3)
    assert near.value == pytest.approx(np.arcsin(min(1.0, wrist.min())))
    assert near.value is not None
    assert (near.verdict == "ok") == (near.value >= 0.3)
    assert worst_of_axes(np.abs(speeds), limits) == divmod(int(np.argmax(np.abs(speeds) / limits)), 6)


def held(path: ToolPath, bounds: CheckLimits) -> HeldSpeed:
    blocks = blocks_of(path)
    corners: Corners = corners_of(path, blocks, np.full(int(path.motion.max()) + 1, float("nan")), bounds.blending_m)
    return held_speed(path, path.p_part_tcp @ ROBOT, np.zeros(len(path)), blocks, corners, bounds)


@QUICK
@given(seed, st.integers(3, 9), st.sampled_from([0.0, 2e-3]), st.booleans(), st.booleans())
def test_a_way_takes_as_long_in_both_directions(
    number: int, n: int, blending_m: float, limited: bool, slow: bool
) -> None:
    """Segment by segment: what is braked for in front of a place is sped up from behind it."""
    rng = np.random.default_rng(number)
    p = np.cumsum(rng.normal(size=(n, 3)) * rng.uniform(0.001, 0.03, (n, 1)), axis=0)
    length = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    motion = np.cumsum(rng.random(n) < rng.choice([0.0, 0.5, 1.0]))  # within one the path bends without a corner
    path = replace(path_of(rng, n), p_part_tcp=p, motion=motion, time_s=np.cumsum(length / 0.05))
    bounds = replace(
        BOUNDS, blending_m=blending_m, acceleration_m_s2=10.0 ** rng.uniform(-2.5, 0.0),
        joint_accelerations_rad_s2=rng.uniform(0.5, 5.0, 6) if limited else None,
        joint_speeds_rad_s=rng.uniform(0.05, 0.5, 6) if slow else None,
    )  # fmt: skip
    here, there = held(path, bounds), held(backwards(path), bounds)
    for name in ("mean_m_s", "lowest_m_s", "duration_s", "length_m", "programmed_m_s"):
        np.testing.assert_allclose(getattr(there, name)[1:][::-1], getattr(here, name)[1:], rtol=1e-7, err_msg=name)
    np.testing.assert_allclose(there.at_m_s[::-1], here.at_m_s, rtol=1e-6, atol=1e-9)
    assert np.all(here.duration_s[1:] >= length[1:] / 0.05 * (1.0 - 1e-9))
    if slow and bounds.joint_speeds_rad_s is not None:
        q = np.abs(np.diff(p @ ROBOT, axis=0, prepend=p[:1] @ ROBOT)) / bounds.joint_speeds_rad_s
        named = (here.cause == SpeedCause.JOINT_SPEED) & (here.mean_m_s > 0.0)
        own = named & (here.lowest_m_s >= here.length_m / np.maximum(q.max(axis=1), 1e-12) * (1.0 - 1e-9))
        np.testing.assert_array_equal(here.axis[own], q.argmax(axis=1)[own])


@QUICK
@given(seed, st.integers(3, 9))
def test_a_tool_that_turns_is_slowed_on_its_own_segments(number: int, n: int) -> None:
    """On a line, without ramps: the smaller of feed and turning speed, each segment by its own turn."""
    rng = np.random.default_rng(number)
    way = rng.uniform(0.002, 0.02, n)
    p = np.cumsum(way)[:, None] * np.array([[0.6, 0.0, 0.8]])
    path = replace(path_of(rng, n), p_part_tcp=p, motion=np.zeros(n, dtype=np.int64), time_s=np.cumsum(way / 0.05))
    turned = rng.uniform(0.0, 0.5, n)
    bounds = replace(BOUNDS, acceleration_m_s2=1e4, orientation_rad_s=1.0)
    blocks = blocks_of(path)
    found = held_speed(path, p @ ROBOT, turned, blocks, corners_of(path, blocks, np.array([np.nan]), 0.0), bounds)
    np.testing.assert_allclose(found.mean_m_s[1:], np.minimum(0.05, way / turned)[1:], rtol=1e-2)


@QUICK
@given(st.lists(st.sampled_from(["ok", "warning", "fail", "not looked at"]), max_size=6))
def test_one_failed_check_fails_the_whole(verdicts: list[Verdict]) -> None:
    path = path_of(np.random.default_rng(0), 3)
    rows = tuple(Row(f"check {k}", verdict) for k, verdict in enumerate(verdicts))
    whole = Preflight(rows, path, np.zeros((3, 6)), np.zeros((3, 6)), (), None, BOUNDS)
    assert whole.failed == ("fail" in verdicts)
