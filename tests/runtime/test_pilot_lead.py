"""Lead of pilot control found on the plan: laws."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.runtime.pilot_lead import pilot_lead
from counterflex.signals.filters import Smoothing

T = 0.004
TIME: Float = np.arange(0.0, 4.0, T)
SMOOTHING = Smoothing(8.0, 8, T)
PASS: Float = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
"""A robot that answers at once."""


def force(drop_s: float) -> Float:
    """A cut from 1 s to 3 s that ends within ``drop_s``."""
    w = np.zeros((len(TIME), 6))
    w[:, 1] = 500.0 * np.clip((TIME - 1.0) / drop_s, 0.0, 1.0) * np.clip((3.0 - TIME) / drop_s, 0.0, 1.0)
    return w


def lead(w: Float, blend_s: float, threshold_n: float = 150.0) -> float:
    return pilot_lead(TIME, w, w, SMOOTHING, threshold_n, blend_s, PASS, most_s=0.2)


def test_nothing_to_blend_needs_no_lead() -> None:
    assert lead(np.zeros((len(TIME), 6)), 0.08) == 0.0
    assert lead(force(0.05), 0.08, threshold_n=5000.0) == 0.0


@pytest.mark.parametrize("blend_s", [0.04, 0.08, 0.12])
def test_a_step_is_met_in_the_middle_of_the_blending(blend_s: float) -> None:
    """Of a step, blending linearly over a time makes a ramp: least is left where its middle meets the step."""
    assert lead(force(T), blend_s) == pytest.approx(0.5 * blend_s, abs=3.0 * T)


def test_a_slower_force_needs_less_lead_after_the_threshold() -> None:
    """While the prediction still falls, what is blended falls with it."""
    assert 0.0 < lead(force(0.15), 0.08) <= lead(force(T), 0.08) + 2.0 * T
