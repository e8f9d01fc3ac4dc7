"""Parts of production identification: maps between nodes, Jacobian, drift of a tool with known growth."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.identify.production.drift import RunFactor, drift
from counterflex.identify.production.planned import EXPONENTS, weights_at


@pytest.mark.parametrize("ratio", [1.0 / 3.0, 0.6, 1.7, 3.0])
def test_powers_between_the_nodes(ratio: float) -> None:
    """The map of one chip thickness is ``(h / h0)^p``; the polynomial is exact to 0.03 % within a factor of three."""
    for p in np.linspace(0.1, 1.0, 19):
        value, slope = weights_at(float(p))
        nodes = ratio ** np.array(EXPONENTS)
        assert float(nodes @ value) == pytest.approx(ratio**p, rel=3e-4)
        assert float(nodes @ slope) == pytest.approx(np.log(ratio) * ratio**p, rel=2e-2)


def test_interval_of_the_growth_holds() -> None:
    """90 % intervals of the slope, runs with a scatter of their own beyond what they state: 86 to 94 % of 400 lives."""
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(400):
        n = int(rng.integers(5, 12))
        cut = np.full(n, 2.0)
        before = 2.0 * np.arange(n) + 1.0
        true = 0.01
        s = 1.1 * (1.0 + true * before) + rng.normal(0.0, np.hypot(0.01, 0.01), n)
        found = drift([RunFactor(float(v), 0.01) for v in s], cut, np.zeros(n, dtype=np.bool_))
        inside += found.low < true < found.high
    assert 0.86 < inside / 400 < 0.94 + 0.02


def test_a_new_edge_is_seen_and_not_made_up() -> None:
    rng = np.random.default_rng(2)
    n = 12
    cut = np.full(n, 1.0)
    made_up = 0
    for trial in range(100):
        before = np.arange(n) + 0.5
        worn = 1.0 + 0.02 * before
        made_up += len(drift([RunFactor(v, 0.01) for v in worn + rng.normal(0, 0.01, n)], cut, np.zeros(n, bool)).seen)
        before[7:] -= 7.0
        changed = 1.0 + 0.02 * before + rng.normal(0.0, 0.01, n)
        found = drift([RunFactor(float(v), 0.01) for v in changed], cut, np.zeros(n, dtype=np.bool_))
        assert found.seen == (7,), trial
    assert made_up <= 1


def test_stated_edges_and_too_few_runs() -> None:
    one = drift([RunFactor(1.2, 0.01)], np.array([1.0]), np.zeros(1, dtype=np.bool_))
    assert not one.is_known
    two = drift([RunFactor(1.2, 0.01), RunFactor(1.0, 0.01)], np.ones(2), np.array([False, True]))
    assert two.edge.tolist() == [0, 1]
    assert not two.is_known
    with pytest.raises(InputError, match="no run"):
        drift([], np.zeros(0), np.zeros(0, dtype=np.bool_))
