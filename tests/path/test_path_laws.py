"""Laws of paths with uneven motions: spirals, gaps, two spindle speeds, corners of unequal legs, external axes.

Lengths are held against chords, speeds against the limits of every cycle, places against matrices composed by hand.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.path.external_axes import AxisChange, ExternalAxis, ExternalPlaces, moving, places_of, with_places
from counterflex.path.path_speed import build_track
from counterflex.path.sampling import ARC_MOTION, FEED_MOTION, MotionTable, chord_angle, motion_length, sample
from counterflex.path.tool_rotation import APART_M, ToolRotation
from counterflex.path.toolpath import FEED, RAPID, ToolPath, tool_orientation

seed = st.integers(0, 2**31)
QUICK = settings(max_examples=40)


def table(rows: list[dict[str, Any]]) -> MotionTable:
    n = len(rows)
    base: dict[str, Any] = {
        "kind": FEED_MOTION, "p_start": (0.0,) * 3, "p_end": (0.0,) * 3, "feed_m_s": 0.02, "spindle_rad_s": 100.0,
        "tool": 1, "duration_s": 0.0, "p_centre": (0.0,) * 3, "normal": (0.0, 0.0, 1.0), "turn_rad": 0.0,
    }  # fmt: skip
    columns = {name: np.array([{**base, **row}[name] for row in rows], dtype=np.float64) for name in base}
    whole = {name: columns[name].astype(np.int64) for name in ("kind", "tool")}
    assert n == len(columns["kind"])
    return MotionTable(**{**columns, **whole})  # type: ignore[arg-type]


def spiral(first: float, last: float, turn: float, rise: float) -> dict[str, Any]:
    """From radius to radius while it turns and rises, about a centre beside the origin."""
    centre = np.array([0.3, -0.2, 0.1])
    end = np.add(centre, [last * math.cos(turn), last * math.sin(turn), rise])
    return {
        "kind": ARC_MOTION,
        "p_start": np.add(centre, [first, 0.0, 0.0]),
        "p_end": end,
        "p_centre": centre,
        "turn_rad": turn,
    }


@QUICK
@given(st.floats(5e-3, 0.05), st.floats(0.97, 1.03), st.floats(0.3, 12.0), st.floats(-0.05, 0.05), st.booleans())
def test_a_spiral_is_as_long_as_its_chords(first: float, ratio: float, turn: float, rise: float, left: bool) -> None:
    """Whichever end is the wider one and however it rises; chords keep the error allowed at the wider end."""
    motions = table([spiral(first, ratio * first, -turn if left else turn, rise)])
    chord = 2e-6
    path = sample(motions, step_m=1.0, chord_m=chord)
    chords = float(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1).sum())
    assert float(motion_length(motions)[0]) == pytest.approx(chords, rel=0.01)  # its growth is no length
    mean_radius = 0.5 * first * (1.0 + ratio)
    assert float(motion_length(motions)[0]) == pytest.approx(math.hypot(mean_radius * turn, rise), rel=1e-9)
    assert turn / (len(path) - 1) <= float(chord_angle(np.array(max(first, ratio * first)), chord)) * (1.0 + 1e-9)
    duration = float(path.time_s[-1])
    assert duration == pytest.approx(float(motion_length(motions)[0]) / 0.02)
    back = sample(table([spiral(first, ratio * first, turn if left else -turn, rise)]), step_m=1.0, chord_m=chord)
    np.testing.assert_allclose((back.p_part_tcp - [0.3, -0.2, 0.1]) * [1.0, -1.0, 1.0] + [0.3, -0.2, 0.1],
                               path.p_part_tcp, atol=1e-12)  # fmt: skip


@QUICK
@given(st.lists(st.tuples(st.floats(10.0, 500.0), st.floats(0.0, 0.05), st.integers(1, 3)), min_size=2, max_size=6))
def test_a_gap_belongs_to_the_motion_that_it_leads_to(rows: list[tuple[float, float, int]]) -> None:
    """It has the later motion's spindle speed and tool, and takes its length at the speed of rapids."""
    at, motions = 0.0, []
    for spindle, gap, tool in rows:
        start = at + gap
        at = start + 0.01
        motions.append({"p_start": (start, 0.0, 0.0), "p_end": (at, 0.0, 0.0), "spindle_rad_s": spindle, "tool": tool})
    path = sample(table(motions), step_m=1.0, rapid_speed_m_s=0.5)
    np.testing.assert_array_equal(path.spindle_rad_s, [rows[m][0] for m in path.motion])
    np.testing.assert_array_equal(path.tool, [rows[m][2] for m in path.motion])
    gaps = sum(gap for k, (_, gap, _) in enumerate(rows) if k and gap > 1e-9)
    assert path.time_s[-1] == pytest.approx(len(rows) * 0.01 / 0.02 + gaps / 0.5)


def tool_path(p: Float, feeds: Float) -> ToolPath:
    n = len(p)
    step = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    return ToolPath(
        p, np.tile([0.0, 0.0, 1.0], (n, 1)), np.full(n, FEED), feeds, np.full(n, 100.0), np.cumsum(step / feeds),
        np.arange(n), np.ones(n, np.int64),
    )  # fmt: skip


@QUICK
@given(seed, st.integers(3, 7), st.floats(0.0, 5e-3))
def test_uneven_legs_and_feeds_keep_speed_and_acceleration(number: int, n: int, blending: float) -> None:
    """In every cycle no faster than the feed of the leg, no corner faster than the slower one, reversed or not."""
    rng = np.random.default_rng(number)
    p = np.cumsum(rng.normal(size=(n, 3)) * rng.uniform(1e-3, 0.05, (n, 1)), axis=0)
    feeds = rng.uniform(0.01, 0.2, n)
    limit, cycle = 2.0, 2e-3
    track = build_track(tool_path(p, feeds), blending_m=blending, rapid_m_s=0.5, acceleration_m_s2=limit)
    time, q, _, source = track.timed(limit, cycle)
    speed = np.linalg.norm(np.diff(q, axis=0), axis=1) / cycle
    near = np.maximum(feeds[source[:-1]], feeds[source[1:]])
    assert np.all(speed <= near * (1.0 + 1e-9))
    across = track.corner_m_s[:-1] > np.minimum(track.speed_m_s[:-1], track.speed_m_s[1:]) * (1.0 + 1e-9)
    assert not np.any(across[1:])
    assert np.all(np.abs(np.diff(speed)) <= 2.0 * limit * cycle + np.max(feeds) * 0.06)
    back = build_track(tool_path(p[::-1], np.roll(feeds[::-1], 1)), blending_m=blending, rapid_m_s=0.5,
                       acceleration_m_s2=limit)  # fmt: skip
    assert len(back.timed(limit, cycle)[0]) == pytest.approx(len(time), abs=2)
    assert float(back.length_m.sum()) == pytest.approx(float(track.length_m.sum()), rel=1e-9)


TABLE = ExternalAxis(1, True, False, np.array([0.0, 0.0, 1.0]), np.array([1.5, -0.3, 0.2]), -90.0 * DEG, 180.0 * DEG)
RAIL = ExternalAxis(2, False, True, np.array([0.0, 1.0, 0.0]), np.zeros(3), -0.5, 3.0)


@QUICK
@given(seed, st.floats(-90.0, 180.0), st.floats(-500.0, 3000.0))
def test_a_table_turns_the_part_about_its_own_axis_and_a_rail_moves_the_robot(n: int, deg: float, mm: float) -> None:
    rng = np.random.default_rng(n)
    T_zero_part = pose.make(rotation.exp(rng.normal(size=3)), rng.normal(size=3))
    places = places_of(
        (TABLE, RAIL), {1: 0.0, 2: 0.0}, [AxisChange(0, False, {1: deg}), AxisChange(1, True, {2: mm})], T_zero_part
    )
    np.testing.assert_allclose(places.values, [[0.0, 0.0], [deg * DEG, 0.0], [deg * DEG, mm * MM]])
    turn = pose.make(p=TABLE.origin) @ pose.make(rotation.about_z(deg * DEG)) @ pose.make(p=-TABLE.origin)
    np.testing.assert_allclose(places.Ts_base_part(np.array([1.0]))[0], turn @ T_zero_part, atol=1e-12)
    along = pose.make(p=np.array([0.0, -mm * MM, 0.0]))  # the robot goes along +y, and the room along -y in its base
    np.testing.assert_allclose(places.Ts_base_floor(np.array([2.0]))[0], along, atol=1e-12)
    np.testing.assert_allclose(places.Ts_base_part(np.array([2.0]))[0], along @ turn @ T_zero_part, atol=1e-12)
    assert places.shown(2) == pytest.approx({1: deg, 2: mm})
    assert places.beyond() is None


@QUICK
@given(st.sampled_from([0, 1]), st.booleans(), st.floats(1e-3, 1.0), st.integers(0, 3))
def test_a_place_beyond_either_end_of_an_axis_is_named(axis: int, low: bool, beyond: float, place: int) -> None:
    values = np.zeros((4, 2))
    one = (TABLE, RAIL)[axis]
    values[place, axis] = one.low - beyond if low else one.high + beyond
    assert ExternalPlaces((TABLE, RAIL), values, np.eye(4)).beyond() == (place, axis)


@QUICK
@given(st.floats(0.0, 90.0), st.floats(0.0, 2000.0), st.booleans())
def test_an_external_move_lasts_as_long_as_the_slowest_axis(deg: float, mm: float, standing: bool) -> None:
    p = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.05, 0.0, 0.1]])
    path = tool_path(p, np.full(4, 0.05))
    changes = [AxisChange(1, standing, {1: deg, 2: mm})]
    places = places_of((TABLE, RAIL), {1: 0.0, 2: 0.0}, changes, np.eye(4))
    moved = with_places(path, changes, places, 0.5)
    needed = max(deg * DEG, mm * MM) / 0.5
    extra = needed if standing else max(0.0, needed - float(path.time_s[1] - path.time_s[0]))
    assert moved.time_s[-1] - path.time_s[-1] == pytest.approx(extra, abs=1e-9)
    assert (moved.place[0], moved.place[-1]) == (0.0, 1.0)
    assert np.all(np.diff(moved.place) >= 0.0)
    assert np.all(moved.p_part_tcp[moving(moved), 0] == 0.0)  # it is over before the next motion


@QUICK
@given(seed)
def test_a_turning_is_known_by_lengths_from_the_start_and_told_by_its_worst_place(number: int) -> None:
    rng = np.random.default_rng(number)
    p = np.cumsum(rng.uniform(0.03, 0.2, (8, 3)), axis=0) * [1.0, 1.0, 0.0]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    turning = ToolRotation(tuple(length[[1, 4, 6]]), (0.5, -1.0, 2.0)).placed(p)
    np.testing.assert_allclose(turning.p_part, p[[1, 4, 6]], atol=1e-12)
    np.testing.assert_allclose(turning.along(p), np.interp(length, turning.length_m, turning.angle_rad))
    assert turning.distance(p)[0] < 1e-9
    for moved in (1, 4, 6):
        other = p.copy()
        other[moved, 2] += 3.0 * APART_M
        far, place = turning.distance(other)
        assert far > APART_M
        assert place == length[moved] or far >= 3.0 * APART_M - 1e-9


@QUICK
@given(seed, st.floats(-3.0, 3.0))
def test_the_tool_frame_turns_right_handed_about_the_axis_out_of_the_tip(number: int, angle: float) -> None:
    axis = np.random.default_rng(number).normal(size=(1, 3))
    axis /= np.linalg.norm(axis)
    R, R_0 = tool_orientation(axis, angle)[0], tool_orientation(axis, 0.0)[0]
    np.testing.assert_allclose(R, rotation.exp(angle * axis[0]) @ R_0, atol=1e-12)
    np.testing.assert_allclose(R[:, 2], -axis[0], atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_rapids_and_feeds_keep_their_names() -> None:
    assert (RAPID, FEED) == (0, 1)
