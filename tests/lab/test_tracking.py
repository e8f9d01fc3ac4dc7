"""Following of a path: figures by sorting, zones by counting, alike from either end and in either sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex_lab.reproduce.tracking import (
    Tracked,
    corner_zones,
    nearest_on_circle,
    nearest_on_polyline,
    reversal_zone,
    reversals,
    spread,
    turn_zone,
)

QUICK = settings(max_examples=30)
seed = st.integers(0, 2**31)
CORNERS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.06, 0.0], [0.03, 0.06, 0.02]])


def tracked(p: Float, q: Float | None = None, step_s: float = 0.01) -> Tracked:
    n = len(p)
    time_s: Float = step_s * np.arange(n, dtype=np.float64)
    return Tracked(time_s, p, p, np.zeros((n, 3)), np.zeros((n, 6)) if q is None else q)


@QUICK
@given(seed, st.integers(1, 1500), st.floats(0.2, 1.0))
def test_figures_of_an_error_are_those_of_the_sorted_sizes(number: int, n: int, share: float) -> None:
    rng = np.random.default_rng(number)
    size, where = rng.normal(size=n), rng.random(n) < share
    if not where.any():
        with pytest.raises(InputError, match="no sample"):
            spread(size, where)
        return
    found, chosen = spread(size, where), np.abs(size[where])
    assert found.count == where.sum()
    assert found.rms == pytest.approx(np.sqrt(np.mean(chosen**2)))
    assert (found.p997, found.largest) == (np.quantile(chosen, 0.997, method="inverted_cdf"), chosen.max())
    assert replace(found, rms=1e-6, p997=2e-6, largest=3e-6).as_um() == {"rms_um": 1.0, "p997_um": 2.0, "max_um": 3.0}
    turned = replace(found, rms=np.pi / 180, p997=np.pi / 360, largest=np.pi / 90).as_mdeg()
    assert turned == {"rms_mdeg": 1000.0, "p997_mdeg": 500.0, "max_mdeg": 2000.0}


@QUICK
@given(seed, st.booleans())
def test_the_nearest_point_of_a_polyline_is_near_and_the_same_from_either_end(number: int, shifted: bool) -> None:
    """No point of the segment or its two neighbours is nearer, by points close together on them."""
    rng = np.random.default_rng(number)
    p, near = rng.uniform(-0.05, 0.15, (20, 3)), rng.integers(0, 3, 20)
    line = CORNERS + (rng.normal(size=3) if shifted else 0.0)
    p = p + line[0]
    found = nearest_on_polyline(p, line, near)
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    for point, foot, k in zip(p, found, near.tolist(), strict=True):
        some = [line[i] + share * (line[i + 1] - line[i]) for i in range(max(0, k - 1), min(3, k + 2))]
        away = np.linalg.norm(np.concatenate(some) - point, axis=1).min()
        assert away - 2.6e-5 <= np.linalg.norm(foot - point) <= away + 1e-12  # half of what lies between two of them
    np.testing.assert_allclose(nearest_on_polyline(p, line[::-1], 2 - near), found, atol=1e-12)


@QUICK
@given(seed, st.floats(0.01, 0.2))
def test_the_nearest_point_of_a_circle_lies_on_the_ray_from_its_centre(number: int, radius: float) -> None:
    p = np.random.default_rng(number).normal(size=(9, 3)) * 0.1
    found = nearest_on_circle(p, radius)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), radius)
    np.testing.assert_allclose(found[:, 2], 0.0)
    np.testing.assert_allclose(found[:, 0] * p[:, 1], found[:, 1] * p[:, 0], atol=1e-15)
    assert np.all(np.sum(found[:, :2] * p[:, :2], axis=1) > 0.0)


@QUICK
@given(st.integers(0, 5), st.integers(0, 9), st.floats(2e-3, 0.02), st.booleans())
def test_straights_and_corners_are_told_by_the_way_to_them(before: int, after: int, reach: float, back: bool) -> None:
    """By the way from both ends of each straight; ends of the path are no corners, and what stands counts nowhere."""
    line = CORNERS[::-1] if back else CORNERS
    length = np.linalg.norm(np.diff(line, axis=0), axis=1)
    ends = np.concatenate([[0.0], np.cumsum(length)])
    way = np.arange(0.5e-3, ends[-1], 1e-3)
    p = np.stack([np.interp(way, ends, line[:, k]) for k in range(3)], axis=1)
    run = tracked(np.concatenate([np.repeat(p[:1], before, axis=0), p, np.repeat(p[-1:], after, axis=0)]))
    straight, corner = (found[before : len(found) - after] for found in corner_zones(run, line, reach))
    k = np.searchsorted(ends, way) - 1
    begun, left = way - ends[k], ends[k + 1] - way
    moving = np.arange(len(way)) > 0
    clear = np.minimum(np.abs(begun - reach), np.abs(left - reach)) > 1e-9
    expected = (begun > reach) & (left > reach) & moving
    at_corner = (((begun <= reach) & (k > 0)) | ((left <= reach) & (k < 2))) & moving
    np.testing.assert_array_equal(straight[clear], expected[clear])
    np.testing.assert_array_equal(corner[clear], at_corner[clear])
    assert not np.concatenate([found[:before] for found in corner_zones(run, line, reach)]).any()


@QUICK
@given(st.floats(0.05, 1.0), st.floats(-3.0, 3.0), st.booleans())
def test_a_turn_is_one_whole_turn_behind_its_run_in_in_either_sense(run_in: float, begin: float, left: bool) -> None:
    turned = np.linspace(0.0, 2.5 * np.pi, 801)
    angle = begin + (turned if left else -turned)
    p = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    found = turn_zone(tracked(p), run_in)
    off = np.minimum(np.abs(turned - run_in), np.abs(turned - run_in - 2.0 * np.pi)) > 1e-9
    np.testing.assert_array_equal(found[off], ((turned >= run_in) & (turned < run_in + 2.0 * np.pi))[off])


@QUICK
@given(st.lists(st.integers(3, 40), min_size=2, max_size=6), st.booleans(), seed)
def test_an_axis_turns_where_it_turns_whatever_trembles(lengths: list[int], down: bool, number: int) -> None:
    """A zigzag of uneven legs turns between them; what trembles by less than the least way is no turn."""
    rng = np.random.default_rng(number)
    sign = np.where(np.arange(len(lengths)) % 2 == 0, 1.0, -1.0) * (-1.0 if down else 1.0)
    steps = np.concatenate([np.full(n, s * 1e-3) for n, s in zip(lengths, sign, strict=True)])
    q = np.zeros((len(steps) + 1, 6))
    q[1:, 3] = np.cumsum(steps)
    q[:, 5] = rng.uniform(-0.4e-4, 0.4e-4, len(q))
    expected = [(row, 3) for row in np.cumsum(lengths)[:-1].tolist()]
    assert reversals(q) == expected
    assert reversals(-q) == expected
    assert reversals(q[::-1]) == [(len(q) - 1 - row, 3) for row, _ in reversed(expected)]


@QUICK
@given(seed, st.floats(0.01, 0.1))
def test_behind_a_turn_twice_as_long_as_before_it_counts(number: int, after_s: float) -> None:
    rng = np.random.default_rng(number)
    q = np.zeros((200, 6))
    turn = int(rng.integers(40, 160))
    q[:, 1] = -np.abs(np.arange(200) - turn) * 1e-3
    run = tracked(np.zeros((200, 3)), q, step_s=1e-3)
    late = run.time_s - run.time_s[turn]
    clear = np.minimum(np.abs(late + 0.5 * after_s), np.abs(late - after_s)) > 1e-9
    found = reversal_zone(run, np.ones(200, np.bool_), after_s)
    np.testing.assert_array_equal(found[clear], ((late >= -0.5 * after_s) & (late < after_s))[clear])
