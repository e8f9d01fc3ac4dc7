"""The next correction counts from what the last program took back: nothing is taken twice, and nothing is forgotten."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from counterflex.app.correction import decide
from counterflex.app.correction.decide import LEAST_M, CorrectionStep, next_step, tool_response_of
from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.evaluate.path_error.learning import LOCAL, MeasuredError, ToolResponse

N = 12
SHARE = 1.0 / (1.0 + LOCAL**2)
"""Of an even error that a step takes back where the tool is known to follow at once."""


def step_of(parts: list[MeasuredError], monkeypatch: pytest.MonkeyPatch) -> CorrectionStep:
    """The next step of a tool that is known to follow at once and whole, the plan itself left out."""
    none, time_s = np.zeros((1, N, 3)), np.linspace(0.0, 100.0, N)
    ways = ToolResponse(time_s, np.zeros(N, dtype=np.int64), none, none)
    monkeypatch.setattr(decide, "with_measured", lambda plan, *_: plan)
    monkeypatch.setattr(decide, "tool_response_of", lambda _: ways)
    nothing: Any = None
    return next_step(nothing, nothing, parts)


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
        result = step_of(parts, monkeypatch)
        rest = whole - taken
        expected = SHARE * rest if SHARE * np.max(np.abs(rest)) > LEAST_M else 0.0 * rest
        np.testing.assert_allclose(result.further_m, expected, atol=1e-3 * np.max(np.abs(rest)) + 1e-12)
        np.testing.assert_allclose(result.further_m, result.taken.taken_m - taken, atol=1e-15)
        np.testing.assert_allclose(result.next_error_m, rest - result.further_m, atol=1e-12)
        np.testing.assert_array_equal(result.taken.error_m, result.next_error_m)
        if k > 0:
            np.testing.assert_array_equal(result.further_m, 0.0)
        taken = result.taken.taken_m
        np.testing.assert_allclose(taken, whole, atol=LEAST_M)


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
    result = step_of([one], monkeypatch)
    assert bool(np.any(result.further_m)) == changed
    assert LEAST_M == 5.0 * UM
    np.testing.assert_allclose(result.taken.taken_m, taken + result.further_m)
    np.testing.assert_allclose(result.taken.error_m, error - result.further_m, atol=1e-15)


def test_a_program_that_does_not_change_still_leaves_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    """No response is unsure where nothing changes; the scatter of the next part is."""
    one = MeasuredError(np.zeros((N, 3)), np.zeros((N, 3)), np.full((N, 3), UM), np.ones((N, 3), np.bool_))
    result = step_of([one], monkeypatch)
    np.testing.assert_array_equal(result.unsure_m, 0.0)
    assert result.state.scatter_m > 5.0 * UM


def test_entries_and_exits_have_a_gain_and_a_delay_of_their_own() -> None:
    time = np.arange(0.0, 8.0, 0.01)
    contact = (time > 2.0) & (time < 6.0)
    loaded: Any = SimpleNamespace(
        inputs=SimpleNamespace(path=SimpleNamespace(time_s=time)),
        feed_run=np.zeros(len(time), dtype=np.int64),
        cut=SimpleNamespace(contact=contact),
    )
    ways = tool_response_of(loaded)
    assert ways.gain.shape == ways.delay_s.shape == (8, len(time), 3)
    np.testing.assert_array_equal(ways.gain[:3, 400], decide.GAIN * np.eye(3))
    entry, plateau, leaves = (int(np.argmin(np.abs(time - at))) for at in (2.3, 4.0, 5.9))
    for row, inside in ((entry, (True, False)), (plateau, (False, False)), (leaves, (False, True))):
        for window, share in enumerate(inside):
            np.testing.assert_allclose(ways.gain[3 + window, row], share * decide.WINDOW_GAIN, atol=1e-12)
            size = (decide.ENTRY_DELAY_S, decide.EXIT_DELAY_S)[window]
            np.testing.assert_allclose(ways.delay_s[6 + window, row], share * size, atol=1e-12)
    np.testing.assert_allclose(ways.delay_s[5], decide.DELAY_S)
    assert not np.any(ways.delay_s[:5])
    assert not np.any(ways.gain[5:])
