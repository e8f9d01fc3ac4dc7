"""Path deviation against cases whose answer is known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures, path_deviation
from counterflex.path import FEED, RAPID, ToolPath

FEED_M_S = 0.025
RADIUS = 8e-3


def tool_path(points: Float, kind: Float | None = None) -> ToolPath:
    points = np.asarray(points, dtype=float)
    n = len(points)
    kinds = np.full(n, FEED, dtype=np.int64) if kind is None else np.asarray(kind, dtype=np.int64)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return ToolPath(
        p_part_tcp=points,
        axis_part=np.tile([0.0, 0.0, 1.0], (n, 1)),
        kind=kinds,
        feed_m_s=np.full(n, FEED_M_S),
        spindle_rad_s=np.full(n, 1361.0),
        time_s=length / FEED_M_S,
        motion=np.arange(n, dtype=np.int64),
        tool=np.ones(n, dtype=np.int64),
    )


def travel(points: Float, step: float = 0.5e-3 * FEED_M_S) -> tuple[Float, Float]:
    """Samples at even time along a polyline at the programmed feed: time, points."""
    points = np.asarray(points, dtype=float)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    s = np.linspace(0.0, length[-1], int(length[-1] / step) + 1)
    return s / FEED_M_S, np.stack([np.interp(s, length, points[:, c]) for c in range(3)], axis=1)


def run(nominal: Float, actual: Float, time: Float | None = None, spacing_m: float = 1e-4) -> PathDeviation:
    when = np.linspace(0.0, 1.0, len(actual)) if time is None else time
    contact = np.ones(len(actual), dtype=bool)
    return path_deviation(tool_path(nominal), when, actual, contact, RADIUS, spacing_m=spacing_m)


LINE = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("offset", "left", "axis"),
    [([0.0, 3e-4, 0.0], 3e-4, 0.0), ([0.0, -2e-4, 0.0], -2e-4, 0.0), ([0.0, 3e-4, 4e-4], 3e-4, 4e-4)],
)
def test_straight_line_offset_is_across_exactly(offset: list[float], left: float, axis: float) -> None:
    time, p = travel(LINE)
    found = run(LINE, p + offset, time)
    size = float(np.linalg.norm(offset))
    figures = PathFigures.of(found)
    for value in (figures.path.max_m, figures.path.p997_m, figures.path.rms_m, figures.entry.max_m, figures.exit.max_m):
        assert value == pytest.approx(size, abs=1e-15)
    np.testing.assert_allclose(found.across_left_m, left, atol=1e-15)
    np.testing.assert_allclose(found.across_axis_m, axis, atol=1e-15)
    np.testing.assert_allclose(found.along_m, 0.0, atol=1e-12)


def test_left_is_left_of_the_feed_seen_from_the_spindle() -> None:
    nominal = np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    time, p = travel(nominal)
    np.testing.assert_allclose(run(nominal, p + np.array([-1e-4, 0, 0]), time).across_left_m, 1e-4, atol=1e-15)


def test_following_lag_is_along_only() -> None:
    time, p = travel(LINE)
    lag_s = 0.02
    found = run(LINE, p[time <= time[-1] - lag_s], time[time <= time[-1] - lag_s] + lag_s)
    assert PathFigures.of(found).path.max_m < 1e-15
    np.testing.assert_allclose(found.along_m, -lag_s * FEED_M_S, atol=1e-12)


def test_lag_is_measured_against_the_set_points_where_they_are_known() -> None:
    time, command = travel(LINE)
    actual = np.column_stack([np.maximum(command[:, 0] - 4e-4, 0.0), command[:, 1] + 1e-4, command[:, 2]])
    slow = time * 3.0  # the machine ran slower than programmed: no lag by itself
    found = path_deviation(
        tool_path(LINE), slow, actual, np.ones(len(slow), dtype=bool), RADIUS, command_part_tcp=command
    )
    inner = found.length_m > 1e-3
    np.testing.assert_allclose(found.along_m[inner], -4e-4, atol=1e-12)
    np.testing.assert_allclose(found.across_left_m, 1e-4, atol=1e-15)


def test_circle_with_a_radius_error() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    circle = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    found = run(0.03 * circle, 0.0302 * circle)
    figures = PathFigures.of(found)
    assert figures.path.max_m == pytest.approx(2e-4, abs=2e-9)
    assert figures.path.rms_m == pytest.approx(2e-4, abs=2e-9)
    assert figures.path.extent == pytest.approx(2 * np.pi * 0.0302, rel=1e-3)
    np.testing.assert_allclose(found.across_left_m, -2e-4, atol=2e-9)  # counterclockwise: outside is right


def test_rounded_corner_is_measured_to_the_nearer_leg() -> None:
    nominal = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.05, 0.05, 0.0]])
    r = 2e-3
    a = np.linspace(-np.pi / 2, 0.0, 200)
    arc = np.stack([0.05 - r + r * np.cos(a), r + r * np.sin(a), 0 * a], axis=1)
    _, actual = travel(np.vstack([nominal[:1], arc, nominal[2:]]))
    exact = r * (1.0 - np.cos(np.pi / 4))
    for spacing in (1e-4, 1e-5):  # stations miss the peak by at most half their spacing, at 45 deg
        found = PathFigures.of(run(nominal, actual, spacing_m=spacing)).path.max_m
        assert exact - 0.5 * spacing * np.sin(np.pi / 4) - 1e-7 < found < exact + 1e-9


def test_overshoot_of_a_corner_counts_as_path_error() -> None:
    nominal = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.05, 0.05, 0.0]])
    over = 3e-4
    _, actual = travel(
        np.array([[0.0, 0, 0], [0.05 + over, 0, 0], [0.05 + over, 1e-3, 0], [0.05, 1e-3, 0], [0.05, 0.05, 0]])
    )
    assert PathFigures.of(run(nominal, actual)).path.max_m == pytest.approx(over, abs=2e-6)


def test_self_crossing_path_stays_on_its_own_pass() -> None:
    nominal = np.array([[-0.03, 0, 0], [0.03, 0, 0], [0.03, 0.03, 0], [0, 0.03, 0], [0, -0.03, 0.0]])
    _, p = travel(nominal)
    actual = p + np.array([2e-4, 2e-4, 0.0])
    found = run(nominal, actual)
    assert np.all(np.diff(found.length_m) >= 0.0)
    assert found.length_m[-1] == pytest.approx(0.18, abs=1e-3)
    assert PathFigures.of(found).path.max_m <= np.hypot(2e-4, 2e-4) + 1e-12
    crossing = np.abs(found.p_part_actual[:, 0] - 2e-4) < 5e-4
    late = crossing & (found.length_m > 0.121)
    np.testing.assert_allclose(found.p_part_nominal[late][:, 0], 0.0, atol=1e-12)


def test_running_back_on_the_same_line_keeps_the_order() -> None:
    nominal = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.0, 0.0, 0.0]])
    _, p = travel(nominal)
    found = run(nominal, p + np.array([0.0, 1e-4, 0.0]))
    assert found.length_m[-1] == pytest.approx(0.1, abs=1e-9)
    half = found.length_m < 0.0499
    np.testing.assert_allclose(found.across_left_m[half], 1e-4, atol=1e-12)
    np.testing.assert_allclose(found.across_left_m[found.length_m > 0.0501], -1e-4, atol=1e-12)


def test_stop_and_go_and_vibration_along_weigh_nothing() -> None:
    time, p = travel(LINE)
    p = p + np.stack([0 * time, 2e-4 * (p[:, 0] > 0.05), 0 * time], axis=1)
    stop = len(p) // 4
    dwell = np.repeat(p[stop : stop + 1], 5000, axis=0)
    dwell[:, 0] += 1e-5 * np.sin(np.arange(5000) * 0.3)
    with_stop = np.vstack([p[:stop], dwell, p[stop:]])
    a, b = PathFigures.of(run(LINE, p)), PathFigures.of(run(LINE, with_stop))
    assert b.path.rms_m == pytest.approx(a.path.rms_m, rel=2e-3)
    assert b.path.extent == pytest.approx(a.path.extent, rel=2e-3)


@pytest.mark.parametrize(("bad_m", "p997_m"), [(1e-3, 1e-4), (4e-3, 1e-3)])
@pytest.mark.parametrize("repeats", [1, 50])
def test_p997_is_by_length_not_by_time(bad_m: float, p997_m: float, repeats: int) -> None:
    nominal = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    x = np.linspace(0.0, 1.0, 50_001)
    samples = np.stack([x, np.where(x < bad_m, 1e-3, 1e-4), 0 * x], axis=1)
    slow = np.vstack([np.repeat(samples[x < bad_m], repeats, axis=0), samples[x >= bad_m]])
    figures = PathFigures.of(run(nominal, slow))
    assert figures.path.max_m == pytest.approx(1e-3, abs=1e-12)
    assert figures.path.p997_m == pytest.approx(p997_m, abs=1e-12)  # 0.3 % of 1 m is 3 mm


def test_skipped_air_moves_are_found_again_on_the_right_level() -> None:
    nominal = np.array(
        [
            [0.0, 0, 0.005], [0, 0, -0.001], [0.06, 0, -0.001], [0.06, 0, 0.005],
            [0.0, 0, 0.005], [0, 0, -0.002], [0.06, 0, -0.002], [0.06, 0, 0.005],
        ]
    )  # fmt: skip
    kinds: Float = np.array([RAPID, FEED, FEED, RAPID, RAPID, FEED, FEED, RAPID])
    _, one = travel(nominal[1:3])
    _, two = travel(nominal[5:7])
    actual: Float = np.vstack([one, two]) + np.array([0.0, 3e-4, -2e-4], dtype=np.float64)
    time: Float = np.linspace(0.0, 1.0, len(actual))
    found = path_deviation(tool_path(nominal, kinds), time, actual, np.ones(len(actual), dtype=bool), RADIUS)
    assert found.broken.sum() == 2
    np.testing.assert_allclose(found.across_left_m, 3e-4, atol=1e-12)
    np.testing.assert_allclose(found.across_axis_m, -2e-4, atol=1e-12)
    assert set(found.motion.tolist()) <= {1, 2, 5, 6}  # the plunge's end is the start of the cut
    assert set(np.round(found.p_part_nominal[:, 2], 12).tolist()) == {-0.001, -0.002}


def test_a_link_move_above_a_later_cut_is_not_taken_for_it() -> None:
    cuts = [np.array([[0.0, y, -0.001], [0.06, y, -0.001]]) for y in (0.0, 0.01, 0.02, 0.03)]
    safe = np.array([0.0, 0.0, 0.012])
    nominal = np.vstack([np.vstack([c[0] + safe, c, c[1] + safe]) for c in cuts])
    kinds: Float = np.array([RAPID, FEED, FEED, RAPID] * 4)
    samples, contact = [], []
    for k, c in enumerate(cuts):
        _, cut = travel(c)
        # the machine links on its own way: low above the last cut, sampled coarsely
        link = np.linspace(cuts[3][1] + [0, 0, 0.006], cuts[3][0] + [0, 0, 0.006], 61) if k < 3 else cut[-1:]
        samples += [cut + np.array([0.0, 8e-4, 0.0]), link]
        contact += [np.ones(len(cut)), np.zeros(len(link))]
    actual = np.vstack(samples)
    found = path_deviation(
        tool_path(nominal, kinds), np.linspace(0.0, 1.0, len(actual)), actual, np.concatenate(contact), RADIUS
    )
    figures = PathFigures.of(found)
    assert figures.path.max_m == pytest.approx(8e-4, abs=1e-9)
    assert figures.path.extent == pytest.approx(4 * 0.06, rel=0.01)
    assert set(np.round(found.p_part_nominal[found.cutting][:, 1], 9).tolist()) == {0.0, 0.01, 0.02, 0.03}


def test_retract_while_still_touching_is_not_taken_for_the_cut() -> None:
    nominal = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.05, 0, 0.02], [0.05, 0.05, 0.02]])
    kinds: Float = np.array([RAPID, FEED, RAPID, RAPID])
    _, p = travel(nominal)
    lift = np.interp(np.arange(len(p)), [0, len(p)], [3e-4, 3e-4])
    found = path_deviation(
        tool_path(nominal, kinds),
        np.linspace(0.0, 1.0, len(p)),
        p + np.stack([0 * lift, 0 * lift, lift], axis=1),
        p[:, 2] < 0.01,  # the cutter still scrapes half way up
        RADIUS,
    )
    figures = PathFigures.of(found)
    assert figures.path.max_m == pytest.approx(3e-4, abs=1e-9)
    assert figures.path.extent == pytest.approx(0.05, abs=1e-3)


def test_a_tool_that_swings_as_it_starts_to_plunge_is_not_taken_for_the_move_after_the_plunge() -> None:
    """The first stations run the way of the move that begins 9 mm below them."""
    nominal = np.array([[0.0, 0.0, 9e-3], [0.0, 0.0, 0.0], [0.06, 0.0, 0.0]])
    swing = np.array([[0.0, 0.0, 9e-3], [5e-4, 0.0, 9e-3], [0.0, 0.0, 8.6e-3], [0.0, 0.0, 0.0], [0.06, 0.0, 0.0]])
    time, p = travel(swing)
    found = run(nominal, p, time)
    assert found.length_m[0] == 0.0
    assert np.max(found.across_m) < 5.1e-4


def test_entry_and_exit_are_part_of_the_whole_and_at_least_a_radius_long() -> None:
    time, p = travel(LINE)
    contact = (p[:, 0] > 0.02) & (p[:, 0] < 0.08)
    y = np.where(p[:, 0] > 0.075, 5e-4, np.where(p[:, 0] < 0.021, 3e-4, 1e-4))
    found = path_deviation(tool_path(LINE), time, p + np.stack([0 * y, y, 0 * y], axis=1), contact, RADIUS)
    figures = PathFigures.of(found)
    assert figures.path.max_m == pytest.approx(5e-4)
    assert figures.exit.max_m == pytest.approx(5e-4)
    assert figures.entry.max_m == pytest.approx(3e-4)
    assert figures.plateau.max_m == pytest.approx(1e-4)
    assert figures.air.max_m > 0.0
    for part in (figures.entry, figures.exit):
        assert part.extent == pytest.approx(RADIUS, abs=1.1e-4)
    total = figures.entry.extent + figures.exit.extent + figures.plateau.extent
    assert total == pytest.approx(figures.path.extent)


def test_contact_begins_behind_the_last_sample_without_it_and_ends_at_the_last_with_it() -> None:
    """Entry i of the engagement holds on the way from sample i - 1 to sample i; samples 1 mm apart."""
    time, p = travel(LINE, step=1e-3)
    contact = np.zeros(len(p), dtype=bool)
    contact[20:61] = True
    found = path_deviation(tool_path(LINE), time, p, contact, RADIUS)
    x = found.p_part_actual[found.cutting, 0]
    assert x.min() == pytest.approx(p[19, 0], abs=1.01 * found.spacing_m)
    assert x.max() == pytest.approx(p[60, 0], abs=1.01 * found.spacing_m)


def test_entry_lasts_until_the_engagement_has_reached_its_plateau() -> None:
    time, p = travel(LINE)
    area = np.interp(p[:, 0], [0.02, 0.036, 0.06, 0.08], [0.0, 1.0, 1.0, 0.0], left=0.0, right=0.0)
    found = path_deviation(tool_path(LINE), time, p, area, RADIUS)
    figures = PathFigures.of(found)
    assert figures.entry.extent == pytest.approx(0.95 * 16e-3, abs=3e-4)
    assert figures.exit.extent > 1.9 * RADIUS


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-40, 40), st.integers(-40, 40), st.integers(-5, 5)), min_size=3, max_size=8),
    st.floats(-3e-4, 3e-4),
)
def test_any_path_followed_exactly_has_no_deviation(corners: list[tuple[int, int, int]], shift: float) -> None:
    nominal = np.array(corners, dtype=float) * 1e-3
    if np.any(np.linalg.norm(np.diff(nominal, axis=0), axis=1) < 1e-3):
        nominal = np.cumsum(np.abs(nominal) + 1e-3, axis=0)
    _, p = travel(nominal, 5e-5)
    exact = PathFigures.of(run(nominal, p))
    assert exact.path.max_m <= 5.1e-5  # stations are chords of 0.1 mm: a corner is cut by less than half of one
    moved = PathFigures.of(run(nominal, p + np.array([0.0, 0.0, shift])))
    assert moved.path.max_m <= abs(shift) + 5.1e-5


def test_bad_input_is_refused() -> None:
    time, p = travel(LINE)
    yes = np.ones(len(p), dtype=bool)
    nominal = tool_path(LINE)
    with pytest.raises(InputError, match="wrong shape"):
        path_deviation(nominal, time[:-1], p, yes, RADIUS)
    with pytest.raises(InputError, match="backwards"):
        path_deviation(nominal, time[::-1].copy(), p, yes, RADIUS)
    with pytest.raises(InputError, match="not finite"):
        path_deviation(nominal, time, p * np.nan, yes, RADIUS)
    with pytest.raises(InputError, match="no length"):
        path_deviation(tool_path(LINE[:1]), time, p, yes, RADIUS)
    with pytest.raises(InputError, match="no samples"):
        path_deviation(nominal, time[:0], p[:0], yes[:0], RADIUS)
    with pytest.raises(InputError, match="out of range"):
        path_deviation(nominal, time, p, yes, -1.0)
