"""A streamed path: on the points, at the feed, within the acceleration; held and resumed softly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.path.path_speed import PoseStream, build_track, time_as_run
from counterflex.path.toolpath import FEED, RAPID, ToolPath

PERIOD = 4e-3


def tool_path(p: Float, Rs: Float, feed: Float, kind: Int | None = None, time: Float | None = None) -> ToolPath:
    n = len(p)
    step = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    return ToolPath(
        p_part_tcp=p,
        axis_part=-Rs[:, :, 2],
        kind=np.full(n, FEED, dtype=np.int64) if kind is None else kind,
        feed_m_s=feed,
        spindle_rad_s=np.zeros(n),
        time_s=np.cumsum(step / feed) if time is None else time,
        motion=np.arange(n),
        tool=np.ones(n, dtype=np.int64),
    )


def zigzag(seed: int, n: int = 6) -> tuple[Float, ToolPath]:
    rng = np.random.default_rng(seed)
    p = np.cumsum(rng.uniform(-5e-3, 5e-3, (n, 3)), axis=0)
    Rs = rotation.exp(rng.uniform(-0.5, 0.5, (n, 3))) @ rotation.about_x(np.pi)
    path = tool_path(p, Rs, np.full(n, 0.03))
    return pose.make(Rs, p), path


def from_chords(points: Float, p: Float) -> float:
    """Distance of a point from the polyline through ``points``, m."""
    a, d = points[:-1], np.diff(points, axis=0)
    share = np.clip(np.sum((p - a) * d, axis=1) / np.maximum(np.sum(d * d, axis=1), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(a + share[:, None] * d - p, axis=1).min())


@settings(max_examples=25)
@given(st.integers(0, 10_000))
@example(1094)
def test_it_visits_every_corner_within_feed_and_acceleration(seed: int) -> None:
    Ts, path = zigzag(seed)
    stream = PoseStream(Ts, path, period_s=PERIOD, acceleration_m_s2=0.5, blending_m=0.0)
    poses = np.array([stream.pose(float(k)) for k in range(len(stream))])
    for T in Ts:
        k = int(np.argmin(np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1)))
        # A corner below 3 degrees is run through at full speed: between two samples, off their chord by its sagitta.
        sagitta = 0.25 * 0.03 * PERIOD * np.sin(np.radians(3.0))
        assert from_chords(poses[:, :3, 3], T[:3, 3]) < 0.5 * 0.5 * PERIOD**2 + sagitta + 1e-12
        assert np.linalg.norm(rotation.log(poses[k, :3, :3] @ T[:3, :3].T)) < 0.02
    np.testing.assert_allclose(poses[0], Ts[0], atol=1e-12)
    np.testing.assert_allclose(poses[-1], Ts[-1], atol=1e-9)
    v = np.diff(poses[:, :3, 3], axis=0) / PERIOD
    assert np.linalg.norm(v, axis=1).max() < 0.03 + 1e-9
    assert np.linalg.norm(np.diff(v, axis=0), axis=1).max() / PERIOD < 2.0 * 0.5 + 1e-6
    turns = rotation.log(poses[1:, :3, :3] @ np.swapaxes(poses[:-1, :3, :3], -1, -2))
    assert np.linalg.norm(turns, axis=1).max() < 0.2  # no jump of the orientation


def test_a_rapid_is_run_at_its_own_speed_and_a_dwell_takes_its_time() -> None:
    p = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.05, 0, 0], [0.06, 0, 0]])
    Rs = np.tile(rotation.about_x(np.pi), (4, 1, 1))
    kind = np.array([RAPID, RAPID, FEED, FEED])
    path = tool_path(p, Rs, np.full(4, 0.02), kind, np.array([0.0, 0.5, 1.5, 2.0]))
    stream = PoseStream(pose.make(Rs, p), path, period_s=PERIOD, acceleration_m_s2=1.0, rapid_m_s=0.1)
    x = np.array([stream.pose(float(k))[0, 3] for k in range(len(stream))])
    assert np.max(np.diff(x[x < 0.05])) / PERIOD == pytest.approx(0.1, rel=1e-6)
    assert np.sum(np.abs(x - 0.05) < 1e-9) * PERIOD == pytest.approx(1.0, abs=0.02)
    assert stream.duration_s == pytest.approx(0.05 / 0.1 + 0.1 + 1.0 + 0.01 / 0.02 + 0.02, abs=0.02)


def test_twist_is_the_change_of_the_pose() -> None:
    Ts, path = zigzag(3)
    stream = PoseStream(Ts, path, period_s=PERIOD)
    while stream.at < 0.4 * len(stream):
        stream.advance()
    before = stream.pose()
    twist = stream.twist()
    stream.advance()
    after = stream.pose()
    np.testing.assert_allclose((after - before)[:3, 3], twist[:3] * PERIOD, atol=1e-5)
    turned = rotation.log(after[:3, :3] @ before[:3, :3].T)
    np.testing.assert_allclose(turned, twist[3:] * PERIOD, atol=1e-3)
    while not stream.finished:
        stream.advance()
    np.testing.assert_array_equal(stream.twist(), np.zeros(6))


@pytest.mark.parametrize("override", [0.5, 0.2])
def test_twist_at_a_lowered_override_is_what_the_tool_does(override: float) -> None:
    p = np.array([[0.0, 0, 0], [0.05, 0, 0]])
    Rs = rotation.exp(np.array([[0.0, 0, 0], [0.0, 0.3, 0]]))
    stream = PoseStream(pose.make(Rs, p), tool_path(p, Rs, np.full(2, 0.02)), period_s=PERIOD)
    while stream.at < 0.5 * len(stream):
        stream.advance(override)
    before, twist = stream.pose(), stream.twist()
    stream.advance(override)
    after = stream.pose()
    assert twist[0] == pytest.approx(override * 0.02, rel=1e-9)
    np.testing.assert_allclose((after - before)[:3, 3] / PERIOD, twist[:3], atol=1e-9)
    np.testing.assert_allclose(rotation.log(after[:3, :3] @ before[:3, :3].T) / PERIOD, twist[3:], atol=1e-9)


def test_roundings_share_a_segment_too_short_for_both() -> None:
    """Each takes half of it at most: the track never runs back, never is longer than the corners, and is continuous."""
    short = 0.2e-3
    p = np.array([[0.0, 0, 0], [0.03, 0, 0], [0.03, short, 0], [0.06, short, 0]])
    path = tool_path(p, np.tile(np.eye(3), (4, 1, 1)), np.full(4, 0.02))
    track = build_track(path, blending_m=0.5e-3, rapid_m_s=0.1, acceleration_m_s2=0.5)
    np.testing.assert_allclose(np.linalg.norm(np.diff(track.p, axis=0), axis=1), track.length_m[1:], atol=1e-12)
    assert np.all(np.diff(track.p[:, 0]) >= -1e-12)
    assert np.all(np.diff(track.p[:, 1]) >= -1e-12)
    assert track.length_m.sum() < 0.06 + short
    near = np.abs(track.p[:, 0] - 0.03) < 1e-3
    assert track.p[near, 0].min() == pytest.approx(0.03 - 0.5 * short)
    assert track.p[near, 0].max() == pytest.approx(0.03 + 0.5 * short)


def test_a_held_feed_comes_to_rest_on_the_path_and_goes_on_there() -> None:
    Ts, path = zigzag(5)
    held = PoseStream(Ts, path, period_s=PERIOD, hold_s=0.2)
    through = PoseStream(Ts, path, period_s=PERIOD, hold_s=0.2)
    rates = []
    for k in range(3 * len(held)):
        held.advance(0.0 if 60 < k < 160 else 1.0)
        rates.append(held.rate)
    assert min(rates[110:160]) == 0.0
    assert np.abs(np.diff(rates)).max() <= PERIOD / 0.2 + 1e-12
    while not through.finished:
        through.advance()
    assert held.finished
    np.testing.assert_allclose(held.pose(), through.pose(), atol=1e-12)


def test_what_does_not_move_cannot_be_streamed() -> None:
    p = np.zeros((3, 3))
    Rs = np.tile(np.eye(3), (3, 1, 1))
    with pytest.raises(InputError, match="does not move"):
        PoseStream(pose.make(Rs, p), tool_path(p, Rs, np.ones(3)), period_s=PERIOD)


def test_the_feed_takes_its_time_to_change() -> None:
    """10, then 30, then 10 mm/s along a line at 1 m/s2: (30 - 10) / 1 ms of speeding up and as much of braking."""
    p = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.02, 0.0, 0.0], [0.03, 0.0, 0.0]])
    path = tool_path(p, np.tile(rotation.about_x(np.pi), (4, 1, 1)), np.array([0.01, 0.01, 0.03, 0.01]))
    ramp_s, ramp_m = 0.02, 0.02 * 0.02
    middle = 2.0 * ramp_s + (0.01 - 2.0 * ramp_m) / 0.03
    slow = 0.01 + (0.01 - 0.5 * 0.01**2) / 0.01  # from rest or to it at the ends of the path, 10 ms each
    expected = path.time_s[0] + np.cumsum([0.0, slow, middle, slow])
    np.testing.assert_allclose(time_as_run(path, 0.0, 1.0), expected, rtol=1e-9)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_the_tool_is_at_the_points_when_it_is_said_to_be(seed: int) -> None:
    """Corners are exact stops here: what the controller samples passes the points at those times."""
    _, path = zigzag(seed)
    track = build_track(path, blending_m=0.0, rapid_m_s=0.03, acceleration_m_s2=1.0)
    t, p, _, _ = track.timed(1.0, 1e-4)
    due = time_as_run(path, 0.0, 1.0) - path.time_s[0]
    passed = np.stack([np.interp(due, t, column) for column in p.T], axis=1)
    np.testing.assert_allclose(passed, path.p_part_tcp, atol=2e-7)
