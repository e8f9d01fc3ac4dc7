"""Compliances over the load of their spring: the integral in closed form, and what no robot has is refused."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, strategies as st

from counterflex.core.errors import ModelError
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.description import ComplianceCurve
from counterflex.robot.model.elastic_region import check_curves


@given(
    steps=st.lists(st.floats(1.0, 500.0), min_size=1, max_size=6),
    first=st.floats(-900.0, 100.0),
    seed=st.integers(0, 1000),
    weight=st.floats(-3000.0, 3000.0),
    load=st.one_of(st.just(0.0), st.floats(-2000.0, 2000.0)),
)
def test_what_a_load_moves_is_the_area_under_the_curve(
    steps: list[float], first: float, seed: int, weight: float, load: float
) -> None:
    loads = (first, *(first + np.cumsum(steps)))
    factors = tuple(np.random.default_rng(seed).uniform(0.3, 3.0, len(loads)))
    curve = ComplianceCurve("axis2", 5, loads, factors)
    mean = float(curve.secant(np.array(weight), np.array(load)))
    assert min(factors) * 0.999 <= mean <= max(factors) * 1.001
    if abs(load) > 1.0:
        ends = sorted((weight, weight + load))
        inner = [x for x in loads if ends[0] < x < ends[1]]
        area = scipy.integrate.quad(lambda x: np.interp(x, loads, factors), *ends, points=inner or None, limit=200)[0]
        assert mean == pytest.approx(area / abs(load), rel=1e-6)


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        (ComplianceCurve("axis9", 5, (0.0, 1.0), (1.0, 2.0)), "names no spring"),
        (ComplianceCurve("axis2", 0, (0.0, 1.0), (1.0, 2.0)), "rigid"),
        (ComplianceCurve("axis2", 5, (0.0, 1.0), (1.0, 2.0, 3.0)), "as many factors"),
        (ComplianceCurve("axis2", 5, (1.0, 1.0), (1.0, 2.0)), "do not rise"),
        (ComplianceCurve("axis2", 5, (0.0, 1.0), (1.0, 0.0)), "far too large or small"),
    ],
)
def test_curves_that_no_robot_has_are_refused(haehn: ElasticChain, curve: ComplianceCurve, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        check_curves((curve,), haehn.names, haehn.compliance)
    good = ComplianceCurve("axis2", 5, (0.0, 1.0), (1.0, 2.0))
    with pytest.raises(ModelError, match="two compliance curves"):
        check_curves((good, good), haehn.names, haehn.compliance)


def test_two_curves_of_one_spring_multiply_at_their_loads() -> None:
    one = ComplianceCurve("axis2", 5, (-100.0, 0.0, 300.0), (0.5, 2.0, 0.8))
    twice = ComplianceCurve("axis2", 5, (-50.0, 150.0), (2.0, 2.0))
    load = np.linspace(-200.0, 400.0, 41)
    product = one.times(twice)
    assert product.secant(load, np.zeros(41)) == pytest.approx(2.0 * one.secant(load, np.zeros(41)))
    assert twice.times(one).factors == pytest.approx(product.factors)
