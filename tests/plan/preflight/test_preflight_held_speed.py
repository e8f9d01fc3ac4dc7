"""Path speed that is held, by closed forms: lines, ramps, corners, arcs, a circle past a singular point."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.preflight.approximation import corners_of
from counterflex.plan.preflight.held_speed import HeldSpeed, SpeedCause, held_speed
from counterflex.plan.preflight.row import CheckLimits, Row
from counterflex.plan.preflight.spacing import blocks_of
from counterflex.plan.preflight.speed_row import speed_row

SPEED = 0.05
"""m/s."""
PER_M = np.array([1.0, -2.0, 0.5, 0.0, 3.0, 0.0])
"""rad/m, joint angles of a made-up robot: the first three by x, the others by y."""
BOUNDS = CheckLimits(
    2.0 * DEG, 5.0 * DEG, acceleration_m_s2=1.0, least_block_s=1e-6, clearance_m=0.02, blending_m=2 * MM
)


def path_of_pieces(*pieces: Float) -> ToolPath:
    """A motion for each piece of points; the first one begins the path."""
    p = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    motion = np.concatenate([np.zeros(len(pieces[0])), *(np.full(len(v) - 1, k) for k, v in enumerate(pieces) if k)])
    length = np.linalg.norm(np.diff(p, axis=0), axis=1)
    n = len(p)
    return ToolPath(
        p_part_tcp=p,
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=np.full(n, FEED),
        feed_m_s=np.full(n, SPEED),
        spindle_rad_s=np.zeros(n),
        time_s=np.concatenate([[0.0], np.cumsum(length / SPEED)]),
        motion=motion.astype(np.int64),
        tool=np.ones(n, dtype=np.int64),
    )


def line(a: tuple[float, float], b: tuple[float, float], step_mm: float = 0.25) -> Float:
    ends = np.array([(*a, 0.0), (*b, 0.0)]) * MM
    count = round(float(np.linalg.norm(ends[1] - ends[0])) / (step_mm * MM))
    out: Float = ends[0] + (ends[1] - ends[0]) * np.linspace(0.0, 1.0, count + 1)[:, None]
    return out


def lines(*corners: tuple[float, float]) -> ToolPath:
    return path_of_pieces(*(line(a, b) for a, b in itertools.pairwise(corners)))


def angles(path: ToolPath) -> Float:
    q: Float = np.where(np.arange(6) < 3, path.p_part_tcp[:, :1], path.p_part_tcp[:, 1:2]) * PER_M
    return q


def held(path: ToolPath, bounds: CheckLimits = BOUNDS, *, q: Float | None = None, turned: Float | None = None,
         own_m: float = float("nan")) -> HeldSpeed:  # fmt: skip
    blocks = blocks_of(path)
    corners = corners_of(path, blocks, np.full(int(path.motion.max()) + 1, own_m), bounds.blending_m)
    turned = np.zeros(len(path)) if turned is None else turned
    return held_speed(path, angles(path) if q is None else q, turned, blocks, corners, bounds)


def row(path: ToolPath, result: HeldSpeed, bounds: CheckLimits = BOUNDS, cutting: Bool | None = None) -> Row:
    return speed_row(result, np.ones(len(path), dtype=np.bool_) if cutting is None else cutting, bounds)


def test_a_line_is_run_at_its_feed_but_for_both_ramps() -> None:
    """40 mm at 50 mm/s and 1 m/s2: L / v + v / a; ramps of v^2 / 2a = 1.25 mm."""
    path = lines((0, 0), (40, 0))
    result = held(path)
    assert result.duration_s.sum() == pytest.approx(0.040 / SPEED + SPEED / 1.0)
    station = path.p_part_tcp[:, 0]
    assert result.at_m_s**2 == pytest.approx(np.minimum(SPEED**2, 2.0 * np.minimum(station, 0.040 - station)))
    slow = result.slower(0.999)
    assert station[slow].max() == pytest.approx(0.040)
    assert result.length_m[slow].sum() == pytest.approx(2.5 * MM)
    assert set(result.cause[slow]) == {SpeedCause.STANDSTILL}


def test_the_axis_that_is_too_slow_sets_the_speed() -> None:
    """3 rad/m at 0.12 rad/s: 40 mm/s."""
    path = lines((0, 0), (0, 40))
    result = held(path, replace(BOUNDS, joint_speeds_rad_s=np.full(6, 0.12)))
    middle = len(path) // 2
    assert result.mean_m_s[middle] == pytest.approx(0.04)
    assert (result.cause[middle], result.axis[middle]) == (SpeedCause.JOINT_SPEED, 4)
    assert held(path, replace(BOUNDS, joint_speeds_rad_s=np.full(6, 0.16))).mean_m_s[middle] == pytest.approx(SPEED)


def test_a_tool_that_turns_is_no_faster_than_it_may_turn() -> None:
    """0.25 mm with 0.5 deg each at 60 deg/s: 30 mm/s."""
    path = lines((0, 0), (40, 0))
    turned = np.full(len(path), 0.5 * DEG)
    result = held(path, replace(BOUNDS, orientation_rad_s=60.0 * DEG), turned=turned)
    assert result.mean_m_s[80] == pytest.approx(0.030)
    assert result.cause[80] == SpeedCause.REORIENTATION


def test_corner_speed_is_that_of_the_parabola() -> None:
    """90 deg from 2 mm on, 1 m/s2: v^2 = a 2 d cos^2(45 deg) / sqrt 2, held on the rounding, ramps on both sides."""
    path = lines((0, 0), (20, 0), (20, 20))
    result = held(path)
    square = 1.0 * 2.0 * 0.002 * 0.5 / np.sqrt(2.0)
    station = np.cumsum(result.length_m)
    beside = np.abs(station - 0.020)
    expected = np.minimum(square + 2.0 * np.maximum(beside - 0.002, 0.0), SPEED**2)
    inner = (station > 0.002) & (station < 0.038)
    assert result.at_m_s[inner] ** 2 == pytest.approx(expected[inner])
    corner = int(np.argmin(beside))
    assert result.cause[corner] == SpeedCause.TOOL_ACCELERATION
    assert np.sqrt(square) < SPEED


def test_speed_of_the_rounding_takes_the_acceleration_of_the_tool_and_no_more() -> None:
    """Second differences of the parabola, run at the corner speed, are a at its apex."""
    d, turn = 0.002, 1.1
    v = np.sqrt(1.0 * 2.0 * d * np.cos(0.5 * turn) ** 2 / (2.0 * np.sin(0.5 * turn)))
    end = 20.0 * np.array([np.cos(turn), np.sin(turn)]) + [20.0, 0.0]
    path = lines((0, 0), (20, 0), (float(end[0]), float(end[1])))
    corner = int(np.argmin(np.linalg.norm(path.p_part_tcp - [0.020, 0.0, 0.0], axis=1)))
    assert held(path).at_m_s[corner] == pytest.approx(min(v, SPEED), rel=1e-9)
    u = np.array([[1.0, 0.0], [np.cos(turn), np.sin(turn)]])
    t = np.linspace(0.499, 0.501, 3)[:, None]
    p = (1 - t) ** 2 * (-d * u[0]) + t**2 * (d * u[1])
    dt = np.linalg.norm(p[1:] - p[:-1], axis=1).mean() / v
    assert np.linalg.norm(np.diff(p, 2, axis=0)[0]) / dt**2 == pytest.approx(1.0, rel=1e-3)


def test_a_short_side_makes_the_corner_slower() -> None:
    """Sides of 2 mm leave 1 mm of 2: the speed falls by the root of 2."""
    wide, narrow = lines((0, 0), (20, 0), (20, 20)), lines((0, 0), (20, 0), (20, 2))
    at = [held(path).at_m_s[80] for path in (wide, narrow)]
    assert at[0] / at[1] == pytest.approx(np.sqrt(2.0))


def test_an_axis_that_accelerates_too_slowly_slows_the_corner_and_the_ramps() -> None:
    """Axis 5 goes from 0 to 3 rad/m: v^2 = 1 rad/s2 2 d cos^2 / 3; along y it speeds up with 1/3 m/s2."""
    path = lines((0, 0), (20, 0), (20, 20))
    result = held(path, replace(BOUNDS, acceleration_m_s2=50.0, joint_accelerations_rad_s2=np.full(6, 1.0)))
    square = 2.0 * 0.002 * 0.5 / 3.0
    assert result.at_m_s[80] ** 2 == pytest.approx(square)
    assert (result.cause[80], result.axis[80]) == (SpeedCause.JOINT_ACCELERATION, 4)
    behind = 88 + np.arange(1, 4)  # rows of 0.25 mm behind the rounding
    assert result.at_m_s[behind] ** 2 == pytest.approx(square + 2.0 / 3.0 * 0.25 * MM * np.arange(1, 4))


@pytest.mark.parametrize(("own", "blending"), [(0.0, 2 * MM), (float("nan"), 0.0)])
def test_without_approximation_the_corner_is_a_stop(own: float, blending: float) -> None:
    path = lines((0, 0), (20, 0), (20, 20))
    result = held(path, replace(BOUNDS, blending_m=blending), own_m=own)
    assert result.at_m_s[80] == 0.0
    assert result.cause[80] == SpeedCause.EXACT_STOP
    assert result.duration_s.sum() == pytest.approx(2 * (0.020 / SPEED + SPEED / 1.0))


def test_an_exact_stop_on_a_straight_line_stops_and_an_approximated_point_does_not() -> None:
    path = lines((0, 0), (20, 0), (40, 0))
    assert held(path, own_m=0.0).at_m_s[80] == 0.0
    assert held(path).at_m_s[80] == pytest.approx(SPEED)


def test_an_arc_is_run_at_the_root_of_a_r() -> None:
    """A radius of 1 mm at 1 m/s2: 31.6 mm/s of 50, as far as the ramps reach."""
    turn = np.linspace(0.0, 4.0 * np.pi, 2001)
    path = path_of_pieces(MM * np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1))
    result = held(path)
    assert result.at_m_s[1000] == pytest.approx(np.sqrt(1.0 * MM), rel=1e-6)
    assert result.cause[1000] == SpeedCause.TOOL_ACCELERATION


def test_a_circle_past_a_singular_point_is_slowest_where_it_is_nearest() -> None:
    """Axis 4 points from the singular point to the tool: at the distance h it turns by 1 / h, so v = omega h.

    Everywhere else by ``|r x u| / r^2``, as a wrist does whose axis 5 is near zero (axes 4 and 6 turn against each
    other).
    """
    radius, h, omega = 20.0 * MM, 2.0 * MM, 8.0
    turn = np.linspace(0.0, 2.0 * np.pi, 4001)
    p = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    path = path_of_pieces(p)
    away = p[:, :2] - [0.0, radius + h]
    q = np.zeros((len(p), 6))
    q[:, 3] = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    q[:, 5] = -q[:, 3]
    limits = np.array([9.0, 9.0, 9.0, omega, 9.0, 2.0 * omega])
    result = held(path, replace(BOUNDS, joint_speeds_rad_s=limits, acceleration_m_s2=1e3), q=q)
    nearest = 1000
    assert result.mean_m_s[nearest] == pytest.approx(omega * h, rel=2e-3)
    assert (result.cause[nearest], result.axis[nearest]) == (SpeedCause.JOINT_SPEED, 3)
    middle = turn - 0.5 * turn[1]
    u = np.stack([-np.sin(middle), np.cos(middle)], axis=1)
    away = radius * np.stack([np.cos(middle), np.sin(middle)], axis=1) - [0.0, radius + h]
    rate = np.abs(away[:, 0] * u[:, 1] - away[:, 1] * u[:, 0]) / np.sum(away**2, axis=1)
    expected = np.minimum(SPEED, omega / rate)
    inner = slice(50, -50)
    assert result.mean_m_s[inner] == pytest.approx(expected[inner], rel=5e-3)
    found = row(path, result)
    assert found.point is not None
    assert abs(found.point - nearest) <= 1 or found.value == 0.0
    assert "joint speed of axis 4" in found.what


def test_dense_blocks_and_a_short_look_ahead_slow_down() -> None:
    path = path_of_pieces(*(line((k, 0), (k + 1, 0)) for k in range(40)))
    slow = held(path, replace(BOUNDS, least_block_s=0.04))
    assert (slow.mean_m_s[80], slow.cause[80]) == (pytest.approx(0.025), SpeedCause.BLOCK_TIME)
    ahead = held(path, replace(BOUNDS, look_ahead=1, acceleration_m_s2=0.5))
    assert ahead.mean_m_s[80] == pytest.approx(np.sqrt(2 * 0.5 * 1.0 * MM))
    assert ahead.cause[80] == SpeedCause.LOOK_AHEAD


def test_ramps_are_those_of_the_definition() -> None:
    """Random limits at the rows: forwards and backwards, one row after the other."""
    rng = np.random.default_rng(3)
    path = path_of_pieces(*(line((k, 0), (k + 1, 0)) for k in range(30)))
    speeds = rng.uniform(0.005, 0.2, 30)[np.minimum(path.motion, 29)]
    step = np.diff(path.p_part_tcp[:, 0], prepend=0.0)
    path = replace(path, time_s=np.cumsum(step / speeds), feed_m_s=speeds)
    result = held(path, replace(BOUNDS, acceleration_m_s2=0.3))
    v = np.minimum(speeds, np.append(speeds[1:], 0.0))
    v[0] = 0.0
    for k in range(1, len(v)):
        v[k] = min(v[k], np.sqrt(v[k - 1] ** 2 + 2 * 0.3 * step[k]))
    for k in range(len(v) - 1, 0, -1):
        v[k - 1] = min(v[k - 1], np.sqrt(v[k] ** 2 + 2 * 0.3 * step[k]))
    assert result.at_m_s == pytest.approx(v, abs=1e-9)


def test_nothing_that_moves_has_no_speed() -> None:
    path = lines((0, 0), (1, 0))
    still = replace(path, p_part_tcp=np.zeros_like(path.p_part_tcp))
    assert row(still, held(still)).what == "nothing is cut"


def test_the_row_has_the_share_the_lowest_speed_and_its_reason() -> None:
    """An exact stop in the middle of 40 mm: two ramps of 1.25 mm, together 50 ms more; both ends are in the air."""
    path = lines((0, 0), (20, 0), (40, 0))
    result = held(path, own_m=0.0)
    cutting = (path.p_part_tcp[:, 0] > 5 * MM) & (path.p_part_tcp[:, 0] < 35 * MM)
    found = row(path, result, replace(BOUNDS, assumed=frozenset({"controller.acceleration_mm_s2"})), cutting)
    assert (found.verdict, found.value, found.unit) == ("warning", 0.0, "m/s")
    assert found.limit == pytest.approx(SPEED)
    assert found.what.startswith("8.4 % of the cutting path (2.5 of 29.8 mm) is slower than programmed, 0.05 s more")
    assert "exact stops 100 %" in found.what
    assert "assumed: controller.acceleration_mm_s2 1000" in found.what
    assert "left out: limits.joint_speed_deg_s, limits.joint_acceleration_deg_s2" in found.what
    assert "C_DIS" in found.advice
    fine = row(path, held(path), cutting=cutting)
    assert fine.verdict == "ok"
    assert fine.value == pytest.approx(SPEED)
    known = replace(BOUNDS, joint_speeds_rad_s=np.ones(6), joint_accelerations_rad_s2=np.full(6, 50.0))
    assert "left out" not in row(path, held(path, known), known, cutting).what
