"""Parts of production identification: maps between nodes, Jacobian, drift of a tool with known growth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.identify.production.alignment import EXPONENTS, AlignedRunRecord, PlannedCut, weights_at
from counterflex.identify.production.drift import ForceDrift, RunFactor, drift
from counterflex.identify.production.hypotheses import Kind


@pytest.mark.parametrize("ratio", [1.0 / 3.0, 0.6, 1.7, 3.0])
def test_powers_between_the_nodes(ratio: float) -> None:
    """The map of one chip thickness is ``(h / h0)^p``; the polynomial is exact to 0.03 % within a factor of three."""
    for p in np.linspace(0.1, 1.0, 19):
        value, slope = weights_at(float(p))
        nodes = ratio ** np.array(EXPONENTS)
        assert float(nodes @ value) == pytest.approx(ratio**p, rel=3e-4)
        assert float(nodes @ slope) == pytest.approx(np.log(ratio) * ratio**p, rel=2e-2)


def test_interval_of_the_growth_holds() -> None:
    """90 % intervals of the slope, runs with a scatter of their own beyond what they state: most of 60 lives."""
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(60):
        n = int(rng.integers(5, 12))
        cut = np.full(n, 2.0)
        before = 2.0 * np.arange(n) + 1.0
        true = 0.01
        s = 1.1 * (1.0 + true * before) + rng.normal(0.0, np.hypot(0.01, 0.01), n)
        found = drift([RunFactor(float(v), 0.01) for v in s], cut, np.zeros(n, dtype=np.bool_))
        inside += found.low < true < found.high
    assert 0.8 < inside / 60 <= 0.99


@pytest.mark.long
def test_a_new_edge_is_seen_and_not_made_up() -> None:
    rng = np.random.default_rng(2)
    n = 12
    cut = np.full(n, 1.0)
    made_up = 0
    for trial in range(30):
        before = np.arange(n) + 0.5
        worn = 1.0 + 0.02 * before
        made_up += len(drift([RunFactor(v, 0.01) for v in worn + rng.normal(0, 0.01, n)], cut, np.zeros(n, bool)).seen)
        before[7:] -= 7.0
        changed = 1.0 + 0.02 * before + rng.normal(0.0, 0.01, n)
        found = drift([RunFactor(float(v), 0.01) for v in changed], cut, np.zeros(n, dtype=np.bool_))
        assert list(found.seen) == [7], trial
    assert made_up <= 1


def life(expected: NDArray[np.floating], seed: int, scatter: float = 0.01, lost_share: float = 0.0) -> ForceDrift:
    """Drift of runs of 1 m each, with a scatter beside 1 % of their own."""
    n = len(expected)
    s = expected + np.random.default_rng((3, seed)).normal(0.0, scatter, n)
    return drift([RunFactor(float(v), 0.01) for v in s], np.ones(n), np.zeros(n, dtype=np.bool_), lost_share)


RUN: Float = np.arange(10, dtype=np.float64)


@pytest.mark.parametrize("rise", [0.15, 0.25, 0.35])
def test_a_jump_of_the_force_is_named_and_is_growth(rise: float) -> None:
    """Force that rises at the sixth of ten runs: one event there, no new edge, and the growth is the jump."""
    for seed in range(8):
        found = life(1.0 + rise * (RUN >= 5.0), seed)
        (event,) = found.events
        assert event.at == 5
        assert event.kind in (Kind.CHIPPED, Kind.MATERIAL)
        assert event.size == pytest.approx(rise, abs=0.03)
        assert found.grown == pytest.approx(rise, abs=0.03)
        assert not found.seen


@pytest.mark.parametrize(
    "expected",
    [
        1.0 + 0.15 * (1.0 - np.exp(-RUN / 1.5)) + 0.004 * RUN,
        1.0 + 0.25 * (1.0 - np.exp(-RUN / 2.5)),
        1.0 + 0.35 * (RUN / 9.0) ** 3,
        1.0 + 0.01 * RUN + 0.3 * np.maximum(0.0, RUN - 6.0) / 3.0,
        np.exp(0.03 * RUN),
        1.0 + 0.03 * RUN,
        0.8 + 0.0 * RUN,
    ],
    ids=["break-in", "break-in alone", "third power", "knee", "exponential", "line", "none"],
)
def test_growth_of_any_shape_is_found_without_events(expected: Float) -> None:
    found = [life(expected, seed, scatter=0.005) for seed in range(8)]
    true = expected[-1] / expected[0] - 1.0
    np.testing.assert_allclose([one.grown for one in found], true, atol=0.03)
    assert all(not one.events for one in found)
    assert sum(one.grown_low <= true <= one.grown_high for one in found) >= 5


@pytest.mark.long
def test_clean_series_show_nothing() -> None:
    """A hundred of 6 to 18 runs, without growth and with it, that scatter by up to 4 %: hardly an event, no edge."""
    rng = np.random.default_rng(11)
    named = []
    for seed in range(100):
        n = int(rng.integers(6, 19))
        expected = rng.uniform(0.7, 1.4) * (1.0 + rng.choice([0.0, 0.02]) * np.arange(n))
        named.append(life(expected, seed, scatter=float(rng.uniform(0.003, 0.04)), lost_share=0.106))
    assert not any(one.seen for one in named)
    assert sum(bool(one.events) for one in named) <= 1


def test_falls_are_told_apart_by_their_odds() -> None:
    """A tooth of three, another material, and one that passes: none of them a new edge, and no growth hides in them."""
    for seed in range(6):
        tooth = life(1.1 - 0.117 * (RUN >= 6.0), seed, 0.005, lost_share=0.106)
        assert [e.kind for e in tooth.events] == [Kind.LOST_TOOTH]
        softer = life(1.0 - 0.2 * (RUN >= 4.0), seed, lost_share=0.106)
        assert [(e.at, e.kind) for e in softer.events] == [(4, Kind.MATERIAL)]
        harder = life(1.0 + 0.2 * ((RUN >= 3.0) & (RUN < 6.0)), seed, lost_share=0.106)
        assert [(e.at, e.until, e.kind) for e in harder.events] == [(3, 6, Kind.PASSING)]
        for found in (tooth, softer, harder):
            assert abs(found.grown) < 0.03
            assert sum(share for _, share in found.events[0].kinds) == pytest.approx(1.0)


def test_a_jump_before_a_new_edge_ends_with_the_edge() -> None:
    expected = np.array([1.0, 1.02, 1.04, 1.31, 1.33, 1.0, 1.02, 1.04, 1.06, 1.08])
    for seed in range(6):
        found = life(expected, seed, 0.005)
        assert [(e.at, e.kind) for e in found.events] == [(3, Kind.CHIPPED), (5, Kind.NEW_EDGE)]
        assert found.grown == pytest.approx(0.08, abs=0.02)


def test_stated_edges_and_too_few_runs() -> None:
    one = drift([RunFactor(1.2, 0.01)], np.array([1.0]), np.zeros(1, dtype=np.bool_))
    assert not one.is_known
    two = drift([RunFactor(1.2, 0.01), RunFactor(1.0, 0.01)], np.ones(2), np.array([False, True]))
    assert two.edge.tolist() == [0, 1]
    assert not two.is_known
    with pytest.raises(InputError, match="no run"):
        drift([], np.zeros(0), np.zeros(0, dtype=np.bool_))


@pytest.mark.parametrize("air_mm", [0.0, 30.0])
def test_a_run_without_air_is_refused_and_not_given_the_zero_0(air_mm: float) -> None:
    """Where no air is the zero of the force is not known: no delay is found by a made-up one."""
    x = np.arange(0.0, 0.1, 0.25 * MM)
    n, at_x = len(x), np.arange(0.0, 0.1, 0.1 * MM)
    cutting = (x >= air_mm * MM) & (x < 0.1 - air_mm * MM)
    p, still = np.stack([x, 0.0 * x, 0.0 * x], axis=1), np.zeros((n, 3))
    force = np.array([0.0, 300.0, 0.0]) * cutting[:, None]
    ones = np.ones(n)
    plan = PlannedCut(
        p, x / 0.025, ones.astype(int), ones.astype(int), cutting, still,
        ones, ones, ones, ones, ones, ones, ones, ones, force, np.zeros((n, 3, 3, len(EXPONENTS))), still, 1e-4,
    )  # fmt: skip
    m, good = len(at_x), np.ones(len(at_x), dtype=bool)
    shown = np.zeros((m, 6))
    shown[:, :3] = 40.0
    shown[:, 1] += np.interp(at_x - 0.5 * MM, x, force[:, 1])  # 20 ms late, beside a zero of 40 N
    run = AlignedRunRecord(
        "run", at_x / 0.025, np.stack([at_x, 0.0 * at_x, 0.0 * at_x], axis=1), shown, np.zeros((m, 6)),
        np.zeros((m, 3)), good, ~good, 4e-3,
    )  # fmt: skip
    if air_mm == 0.0:
        with pytest.raises(InputError, match="no entry or exit"):
            run.aligned(plan)
    else:
        assert run.aligned(plan).delay_s == pytest.approx(0.02, abs=2e-3)
