"""A swing that the cut feeds is told with its line; one that an entry makes is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.app.compensation.prediction import swing_warnings
from counterflex.core.arrays import Float
from counterflex.plan.lasting_swing import lasting_swings

T = np.arange(0.0, 3.0, 0.016)
CUT = np.ones(len(T), dtype=np.bool_)
LINE = np.full(len(T), 20)


def _deviation(amplitude_m: Float, hz: float) -> Float:
    """Swing along the feed on top of a deviation that changes slowly."""
    out: Float = np.zeros((len(T), 3))
    out[:, 0] = 3e-4 * T
    out[:, 1] = amplitude_m * np.sin(2.0 * np.pi * hz * T)
    return out


@given(hz=st.floats(5.0, 20.0), amplitude=st.floats(8e-5, 1e-3))
def test_a_swing_that_stays_is_told_with_its_amplitude(hz: float, amplitude: float) -> None:
    [(line, size)] = lasting_swings(T, _deviation(np.full(len(T), amplitude), hz), CUT, LINE)
    assert line == 20
    assert size == pytest.approx(amplitude, rel=0.35)


@given(hz=st.floats(6.0, 20.0), damping=st.floats(0.05, 0.2))
def test_a_swing_that_an_entry_makes_is_not(hz: float, damping: float) -> None:
    dying = 4e-4 * np.exp(-2.0 * np.pi * hz * damping * T)
    assert lasting_swings(T, _deviation(dying, hz), CUT, LINE) == []


def test_each_line_is_judged_by_itself() -> None:
    line = np.where(T < 1.5, 20, 22)
    swinging = _deviation(np.where(T < 1.5, 0.0, 2e-4), 6.0)
    assert [number for number, _ in lasting_swings(T, swinging, CUT, line)] == [22]
    assert lasting_swings(T, swinging, T < 1.5, line) == []


def test_the_warning_names_the_line_and_what_to_do() -> None:
    assert swing_warnings([]) == []
    [text] = swing_warnings([{"line": 20, "amplitude_mm": 0.48}, {"line": 22, "amplitude_mm": 0.1}])
    assert "line 20, 22" in text
    assert "0.48 mm in line 20" in text
    assert "plan stability" in text
