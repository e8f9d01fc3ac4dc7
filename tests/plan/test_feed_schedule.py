"""The feed before and at first contact: what the arm is asked for starts no swing, and nothing else is slowed."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.units import MM, UM
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.feed_schedule import (
    CORNER_M,
    LEAST,
    LEAST_AT_CORNER,
    STEP,
    FeedGroups,
    at_feed,
    feed_share,
    share_between,
)

OMEGA = 2.0 * math.pi * 8.0
FAST = 0.025
SWING = 50.0 * UM


def path_of(points_mm: list[tuple[float, float]], step_mm: float = 0.25, feed: float = FAST) -> ToolPath:
    """A polyline at one feed, sampled finely."""
    rows = [np.array([points_mm[0]])]
    for a, b in itertools.pairwise(points_mm):
        count = max(1, round(math.dist(a, b) / step_mm))
        share = np.arange(1, count + 1)[:, None] / count
        rows.append((1.0 - share) * np.array(a) + share * np.array(b))
    xy = np.concatenate(rows) * MM
    p = np.column_stack([xy, np.zeros(len(xy))])
    n = len(p)
    length = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    whole = np.ones(n, dtype=np.int64)
    return ToolPath(
        p_part_tcp=p,
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=np.full(n, FEED),
        feed_m_s=np.full(n, feed),
        spindle_rad_s=np.full(n, 1000.0),
        time_s=np.cumsum(length) / feed,
        motion=np.zeros(n, dtype=np.int64),
        tool=whole,
    )


def free(path: ToolPath) -> FeedGroups:
    return FeedGroups(np.arange(len(path)), np.zeros(len(path), dtype=np.bool_))


def entered(path: ToolPath, at_m: float, rise_m: float, size_m: float = 1.0 * MM) -> tuple[np.ndarray, np.ndarray]:
    """Deflection that rises along x from a place on, and the rows that cut."""
    x = path.p_part_tcp[:, 0]
    bend = np.clip((x - at_m) / rise_m, 0.0, 1.0) * size_m
    return np.column_stack([0.0 * bend, bend, 0.0 * bend]), x > at_m


def shares(path: ToolPath, bend: np.ndarray, contact: np.ndarray, swing: float = SWING) -> np.ndarray:
    chip = np.where(contact, 40.0 * UM, 0.0)
    return feed_share(path, bend, contact, chip, OMEGA, swing, free(path))


def ringing(time_s: np.ndarray, values: np.ndarray) -> float:
    """Largest distance of an undamped mode from a motion that it is asked for, by small steps; m."""
    t = np.arange(time_s[0], time_s[-1] + 0.6, 2e-4)
    asked = np.stack([np.interp(t, time_s, column) for column in values.T], axis=1)
    x, v = asked[0].copy(), np.zeros(values.shape[1])
    worst, dt = 0.0, t[1] - t[0]
    for target in asked:
        v += dt * OMEGA**2 * (target - x)
        x += dt * v
        worst = max(worst, float(np.linalg.norm(x - target)))
    return worst


def test_a_mode_swings_less_at_first_contact_pair() -> None:
    """An undamped mode that follows the deflection: at the programmed feed, and at the lowered one."""
    path = path_of([(0.0, 0.0), (60.0, 0.0)])
    bend, contact = entered(path, 20.0 * MM, 5.0 * MM)
    slowed = at_feed(path, shares(path, bend, contact))
    before, after = ringing(path.time_s, bend), ringing(slowed.time_s, bend)
    assert before > 90.0 * UM
    assert after < 0.6 * before


def test_a_mode_swings_less_where_the_path_turns_pair() -> None:
    """The same for the tool's own mass: a sharp corner in the cut."""
    path = path_of([(0.0, 0.0), (30.0, 0.0), (30.0, 30.0)])
    contact = np.ones(len(path), dtype=np.bool_)
    bend = np.zeros((len(path), 3))
    slowed = at_feed(path, shares(path, bend, contact, 200.0 * UM))
    middle = slice(len(path) // 2 - 60, None)  # the start from rest aside
    assert ringing(path.time_s[middle], path.p_part_tcp[middle]) > 1.5 * ringing(
        slowed.time_s[middle], slowed.p_part_tcp[middle]
    )


def test_only_contact_and_what_leads_to_it_is_slowed() -> None:
    path = path_of([(0.0, 0.0), (120.0, 0.0)])
    bend, contact = entered(path, 60.0 * MM, 5.0 * MM)
    share = shares(path, bend, contact)
    x = path.p_part_tcp[:, 0] / MM
    assert np.all(share[(x > 1.0) & (x < 45.0)] == 1.0)
    assert np.all(share[(x > 75.0) & (x < 110.0)] == 1.0)  # it stops in the cut at 120
    assert share[(x > 58.0) & (x < 66.0)].max() < 1.0
    assert share[contact].min() >= LEAST - 1e-12


def test_only_about_a_sharp_corner_the_feed_may_fall_below_the_least_of_a_cut() -> None:
    path = path_of([(0.0, 0.0), (30.0, 0.0), (30.0, 30.0), (31.0, 60.0)])
    contact = np.ones(len(path), dtype=np.bool_)
    share = shares(path, np.zeros((len(path), 3)), contact)
    away = np.linalg.norm(path.p_part_tcp[:, :2] - np.array([30.0, 0.0]) * MM, axis=1)
    assert share[away < 0.1 * MM].min() == pytest.approx(LEAST_AT_CORNER)
    assert share[away > CORNER_M + 0.3 * MM].min() >= LEAST - 1e-12


def test_without_limit_without_contact_and_out_of_reach_the_feed_is_as_programmed() -> None:
    path = path_of([(0.0, 0.0), (60.0, 0.0)])
    bend, contact = entered(path, 20.0 * MM, 5.0 * MM)
    assert np.all(shares(path, bend, contact, 0.0) == 1.0)
    assert np.all(shares(path, 0.0 * bend, np.zeros_like(contact)) == 1.0)
    fixed = FeedGroups(np.arange(len(path)), np.ones(len(path), dtype=np.bool_))
    assert np.all(feed_share(path, bend, contact, np.zeros(len(path)), OMEGA, SWING, fixed) == 1.0)


def test_a_rapid_between_ends_the_approach() -> None:
    """What was cut before a rapid is not slowed for the contact behind it."""
    path = path_of([(0.0, 0.0), (60.0, 0.0)])
    bend, contact = entered(path, 20.0 * MM, 5.0 * MM)
    x = path.p_part_tcp[:, 0] / MM
    path.kind[(x > 14.0) & (x < 16.0)] = RAPID
    share = shares(path, bend, contact)
    assert np.all(share[x < 16.0] == 1.0)
    assert share.min() < 1.0


def test_an_arc_has_one_feed_and_needs_a_quarter_of_it_to_be_slowed() -> None:
    path = path_of([(0.0, 0.0), (200.0, 0.0)])
    bend, contact = entered(path, 20.0 * MM, 5.0 * MM)
    x = path.p_part_tcp[:, 0] / MM
    alone = shares(path, bend, contact)
    slow = alone < 1.0
    for reach, expected in ((4.0, alone[np.abs(x - 20.0) < 4.0].min()), (300.0, 1.0)):
        group = np.where(np.abs(x - 20.0) < reach, 0, 1 + np.arange(len(x)))
        share = feed_share(
            path, bend, contact, np.zeros(len(x)), OMEGA, SWING, FeedGroups(group, np.zeros(len(x), dtype=np.bool_))
        )
        own = share[(group == 0) & slow]
        assert np.all(own == own[0])
        assert own[0] == pytest.approx(expected)


@given(st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=2, max_size=6), st.floats(0.0, 1e-3))
def test_shares_are_steps_between_the_least_and_one(points: list[tuple[float, float]], swing: float) -> None:
    path = path_of(points, step_mm=1.0)
    bend, contact = entered(path, 0.0, 3.0 * MM)
    share = shares(path, bend, contact, swing)
    assert np.all((share >= STEP - 1e-12) & (share <= 1.0))
    np.testing.assert_allclose(share / STEP, np.round(share / STEP), atol=1e-9)
    assert np.all(share[contact] >= LEAST_AT_CORNER - 1e-12)
    slowed = at_feed(path, share)
    np.testing.assert_allclose(share_between(path, slowed), share, rtol=1e-12)
    assert slowed.time_s[-1] >= path.time_s[-1] - 1e-12
