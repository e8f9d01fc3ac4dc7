"""Joint checks against closed forms: lines, arcs, corners, stops; what has no limit is said to be unknown."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float, Int
from counterflex.core.units import DEG, MM
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.preflight import joints
from counterflex.plan.preflight.row import CheckLimits
from counterflex.robot.model.controller_axes import AS_MODEL, room

SPEED = 0.05
"""m/s."""
PER_M = np.array([1.0, -2.0, 0.5, 0.0, 3.0, 0.0])
"""rad/m, joint angles of a made-up robot: the first three by x, the others by y."""
BOUNDS = CheckLimits(2.0 * DEG, 5.0 * DEG, acceleration_m_s2=1.0, least_block_s=0.012, clearance_m=0.02)


def path_through(p: Float, kind: int = FEED) -> ToolPath:
    length = np.linalg.norm(np.diff(p, axis=0), axis=1)
    n = len(p)
    return ToolPath(
        p_part_tcp=p,
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=np.full(n, kind),
        feed_m_s=np.full(n, SPEED),
        spindle_rad_s=np.zeros(n),
        time_s=np.concatenate([[0.0], np.cumsum(length / SPEED)]),
        motion=motion_of(p),
        tool=np.ones(n, dtype=np.int64),
    )


def motion_of(p: Float) -> Int:
    """A motion for each straight stretch and each arc: a new one where the direction turns by more than 20 deg."""
    step = np.diff(p, axis=0)
    size = np.linalg.norm(step, axis=1)
    unit = step / np.where(size > 0.0, size, 1.0)[:, None]
    turn = np.concatenate([[False, False], np.sum(unit[1:] * unit[:-1], axis=1) < np.cos(np.radians(20.0))])
    out: Int = np.cumsum(turn)
    return out


def angles(path: ToolPath) -> Float:
    q: Float = np.where(np.arange(6) < 3, path.p_part_tcp[:, :1], path.p_part_tcp[:, 1:2]) * PER_M
    return q


def line(*corners_mm: tuple[float, float], step_mm: float = 0.25) -> Float:
    ends = np.array([(x, y, 0.0) for x, y in corners_mm]) * MM
    pieces = [ends[:1]]
    for a, b in itertools.pairwise(ends):
        count = max(1, round(float(np.linalg.norm(b - a)) / (step_mm * MM)))
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)


def test_margin_is_to_the_nearer_limit() -> None:
    limits = np.tile([-1.0, 2.0], (6, 1))
    q = np.array([[0.0, -0.9, 1.8, -1.5, 2.5, 0.5]])
    assert room(AS_MODEL, limits, q)[0] == pytest.approx([1.0, 0.1, 0.2, -0.5, -0.5, 1.5])
    row = joints.limit_row(room(AS_MODEL, limits, q), 2.0 * DEG)
    assert (row.verdict, row.what) == ("fail", "axis 4 is out of its range")
    assert row.value == pytest.approx(-0.5)
    inside = joints.limit_row(room(AS_MODEL, limits, q[:, [0, 1, 2, 0, 0, 0]]), 2.0 * DEG)
    assert (inside.verdict, inside.what) == ("ok", "axis 2")


def test_straight_line_runs_at_constant_joint_speed() -> None:
    path = path_through(line((0, 0), (40, 0)))
    speeds = joints.joint_speeds(path, angles(path))
    assert speeds[1:, :3] == pytest.approx(np.tile(SPEED * PER_M[:3], (len(path) - 1, 1)), rel=1e-9)
    inner = joints.joint_accelerations(path, speeds, 1.0)[1:-1]
    assert np.max(np.abs(inner)) < 1e-9


def test_start_and_stop_take_the_acceleration_of_the_controller() -> None:
    path = path_through(line((0, 0), (40, 0)))
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 2.0)
    assert at[0, :3] == pytest.approx(2.0 * PER_M[:3], rel=1e-6)
    assert at[-1, :3] == pytest.approx(-2.0 * PER_M[:3], rel=1e-6)


def test_corner_takes_it_along_the_change_of_velocity_and_both_sides() -> None:
    """Back by 45 deg: an axis that goes by x brakes by a, one that goes by y gets sin 45 deg of a on both sides."""
    path = path_through(line((0, 0), (20, 0), (20 - 20 / np.sqrt(2.0), 20 / np.sqrt(2.0))))
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 1.0)
    corner = int(np.argmin(np.linalg.norm(path.p_part_tcp - [0.02, 0.0, 0.0], axis=1)))
    share = 1.0 / np.sqrt(2.0)
    change = np.array([-share - 1.0, share]) / np.hypot(share + 1.0, share)  # unit vector along dV
    assert abs(change[1]) < share
    assert at[corner, :3] == pytest.approx(-1.0 * PER_M[:3], rel=1e-9)
    assert at[corner, 4] == pytest.approx(share * PER_M[4], rel=1e-9)


def test_corner_square_to_the_path() -> None:
    """From +x to +y: the tool brakes along x and picks up speed along y."""
    path = path_through(line((0, 0), (20, 0), (20, 20)))
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 1.0)
    corner = int(np.argmin(np.linalg.norm(path.p_part_tcp - [0.02, 0.0, 0.0], axis=1)))
    assert at[corner] == pytest.approx(np.where(np.arange(6) < 3, -1.0, 1.0) * PER_M, rel=1e-9)


def test_arc_takes_the_acceleration_of_the_arc() -> None:
    radius = 10.0 * MM
    turn = np.linspace(0.0, np.pi, 2001)
    path = path_through(radius * np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1))
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 1.0)[1:-1]
    exact = (
        -(SPEED**2) / radius * np.where(np.arange(6) < 3, np.cos(turn)[1:-1, None], np.sin(turn)[1:-1, None]) * PER_M
    )
    assert at == pytest.approx(exact, abs=1e-3)


def test_a_tighter_arc_than_the_controller_can_follow_is_run_at_its_limit() -> None:
    """v^2 / r = 2.5 m/s2, but the controller changes the velocity by 1 m/s2 at most."""
    radius = 1.0 * MM
    turn = np.linspace(0.0, np.pi, 401)
    path = path_through(radius * np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1))
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 1.0)
    assert np.max(np.abs(at[1:-1, 4])) == pytest.approx(3.0, rel=1e-3)


def test_standing_time_needs_no_acceleration() -> None:
    """A dwell: rows that coincide while time passes; the drives stop for it once, and start once."""
    p = line((0, 0), (10, 0))
    stop = np.concatenate([p, p[-1:], line((10, 0), (20, 0))[1:]])
    path = path_through(stop)
    path.time_s[len(p) :] += 1.0
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 1.0)
    assert at[len(p) - 1, 0] == pytest.approx(-1.0, rel=1e-6)
    assert at[len(p), 0] == pytest.approx(1.0, rel=1e-6)
    assert np.max(np.abs(at)) == pytest.approx(2.0, rel=1e-6)  # axis 2


def test_a_slow_corner_is_no_softer_than_a_fast_one() -> None:
    """At 1 mm/s a step of the path takes longer than the change of velocity: the controller does not wait for it."""
    path = path_through(line((0, 0), (20, 0), (20, 20)))
    slow = replace(path, time_s=50.0 * path.time_s)
    at = joints.joint_accelerations(slow, joints.joint_speeds(slow, angles(slow)), 1.0)
    assert np.max(np.abs(at[1:-1, 4])) == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize(("limit", "verdict"), [(None, "not looked at"), (0.16, "ok"), (0.14, "fail")])
def test_speed_at_feed_against_its_limit(limit: float | None, verdict: str) -> None:
    path = path_through(line((0, 0), (0, 40)))
    bounds = CheckLimits(0.0, 0.0, 1.0, 0.01, 0.0, joint_speeds_rad_s=None if limit is None else np.full(6, limit))
    at_feed, rapid = joints.speed_rows(path, joints.joint_speeds(path, angles(path)), bounds)
    assert at_feed.verdict == verdict
    assert at_feed.value == pytest.approx(3.0 * SPEED)
    assert at_feed.what.startswith("axis 5")
    assert at_feed.missing == (joints.SPEED_KEY if limit is None else "")
    assert rapid.value == 0.0


def test_the_same_speed_in_a_rapid_is_a_warning() -> None:
    path = path_through(line((0, 0), (0, 40)), kind=RAPID)
    bounds = CheckLimits(0.0, 0.0, 1.0, 0.01, 0.0, joint_speeds_rad_s=np.full(6, 0.14))
    at_feed, rapid = joints.speed_rows(path, joints.joint_speeds(path, angles(path)), bounds)
    assert (at_feed.verdict, rapid.verdict) == ("ok", "warning")


def test_the_worst_axis_is_the_one_nearest_to_its_own_limit() -> None:
    path = path_through(line((0, 0), (40, 0)))
    limits = np.array([0.05, 1.0, 1.0, 1.0, 1.0, 1.0])
    bounds = CheckLimits(0.0, 0.0, 1.0, 0.01, 0.0, joint_speeds_rad_s=limits)
    row = joints.speed_rows(path, joints.joint_speeds(path, angles(path)), bounds)[0]
    assert row.what == "axis 1, 100.0 %"  # axis 2 is twice as fast, at 10 % of its limit


@pytest.mark.parametrize(("limit", "verdict"), [(None, "not looked at"), (2.9, "warning"), (3.1, "ok")])
def test_acceleration_against_its_limit(limit: float | None, verdict: str) -> None:
    path = path_through(line((0, 0), (0, 40)))
    bounds = CheckLimits(
        0.0, 0.0, 1.0, 0.01, 0.0, joint_accelerations_rad_s2=None if limit is None else np.full(6, limit)
    )
    at = joints.joint_accelerations(path, joints.joint_speeds(path, angles(path)), 1.0)
    row = joints.acceleration_row(path, at, bounds)
    assert row.verdict == verdict
    assert row.value == pytest.approx(3.0, rel=1e-6)


def test_cables_count_full_turns() -> None:
    q = np.zeros((3, 6))
    q[:, 3] = [0.0, 2.0, 4.0]
    q[:, 5] = [-3.0, -7.0, -5.0]
    four, six = joints.cable_rows(q, {5: 6.5})
    assert (four.verdict, four.value, four.missing) == ("not looked at", 4.0, "limits.cable_axis4_deg")
    assert (six.verdict, six.value, six.point) == ("fail", 7.0, 1)
    assert joints.cable_rows(q, {3: 4.5, 5: 7.5})[1].verdict == "ok"


def test_wrist_is_judged_by_its_angle() -> None:
    row = joints.wrist_row(np.abs(np.sin(np.radians([30.0, -4.0, 176.5]))), 5.0 * DEG)
    assert (row.verdict, row.point) == ("fail", 2)
    assert row.value == pytest.approx(3.5 * DEG)
    assert joints.wrist_row(np.sin(np.radians([30.0, 6.0])), 5.0 * DEG).verdict == "ok"
