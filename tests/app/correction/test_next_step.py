"""The next correction counts from what the last program took back: nothing is taken twice, and nothing is forgotten."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from counterflex.app.correction import decide
from counterflex.app.correction.decide import LEAST_M, Step, next_step
from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.evaluate.path_error.repeated import MeasuredError

N = 12


def step_of(parts: list[MeasuredError], monkeypatch: pytest.MonkeyPatch) -> Step:
    """The next step, the plan itself left out."""
    monkeypatch.setattr(decide, "with_measured", lambda plan, *_: plan)
    monkeypatch.setattr(decide, "unsure", lambda *_: np.zeros((1, N, 3)))
    none: Any = None
    return next_step(none, none, parts)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**31), st.integers(1, 4), st.floats(0.0, 1.0))
def test_a_machine_that_stays_as_it_is_is_corrected_once(
    monkeypatch: pytest.MonkeyPatch, number: int, count: int, begun: float
) -> None:
    """Whatever the first program took back already: the second takes the rest, and every further one nothing."""
    rng = np.random.default_rng(number)
    whole: Float = rng.normal(scale=200.0 * UM, size=(N, 3))
    sigma, seen = np.full((N, 3), UM), np.ones((N, 3), np.bool_)
    taken: Float = begun * whole
    parts: list[MeasuredError] = []
    for k in range(count):
        parts.append(MeasuredError(taken, whole - taken, sigma, seen))
        found = step_of(parts, monkeypatch)
        np.testing.assert_allclose(found.taken.taken_m + found.taken.error_m, found.together.total_m, atol=1e-15)
        np.testing.assert_allclose(found.further_m, found.taken.taken_m - taken, atol=1e-15)
        if k > 0:
            np.testing.assert_allclose(found.further_m, 0.0, atol=1e-12)
        taken = found.taken.taken_m
        np.testing.assert_allclose(taken + found.taken.error_m, whole, atol=5.0 * UM)


@pytest.mark.parametrize(("size_um", "changed"), [(4.9, False), (5.5, True)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_is_less_than_a_robot_can_do_is_left(
    monkeypatch: pytest.MonkeyPatch, size_um: float, changed: bool, sign: float
) -> None:
    """A single place beyond the least size, of either sign, is enough for a change."""
    error = np.zeros((N, 3))
    error[3, 1] = sign * size_um * UM
    taken = np.full((N, 3), 30.0 * UM)
    one = MeasuredError(taken, error, np.full((N, 3), 1e-3 * UM), np.ones((N, 3), np.bool_))
    found = step_of([one], monkeypatch)
    assert bool(np.any(found.further_m)) == changed
    assert np.max(np.abs(found.together.total_m - taken)) == pytest.approx(size_um * UM, rel=0.05)
    assert LEAST_M == 5.0 * UM
    np.testing.assert_allclose(found.taken.taken_m, taken + found.further_m)
    np.testing.assert_allclose(found.taken.error_m, found.together.total_m - taken - found.further_m, atol=1e-15)
