"""Lags against an ODE solver and their own laws; clocks are inverted exactly; shifts are found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import lsim

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.signals.lag import Lag, coarse_shift

STEP = 0.004
LAGS = (Lag(0.03), Lag(0.02, 0.4), Lag(0.02, 1.0), Lag(0.02, 1.6))


def times(n: int) -> Float:
    out: Float = STEP * np.arange(n, dtype=np.float64)
    return out


@pytest.mark.parametrize("lag", LAGS)
def test_response_is_that_of_the_differential_equation(lag: Lag) -> None:
    t = times(500)
    u = np.sin(9.0 * t) + t**2 + 2.0
    a = [lag.time_s, 1.0] if lag.damping is None else [lag.time_s**2, 2.0 * lag.damping * lag.time_s, 1.0]
    _, exact, _ = lsim(([1.0], a), u - u[0], t, interp=True)
    assert lag.sensitivity(u[:, None], STEP)[0][:, 0] == pytest.approx(exact + u[0], abs=1e-11)


@pytest.mark.parametrize("lag", LAGS)
def test_it_trails_a_ramp_by_the_delay_it_states(lag: Lag) -> None:
    t = times(1000)
    assert t[-1] - lag.sensitivity(t[:, None], STEP)[0][-1, 0] == pytest.approx(lag.delay_s, rel=1e-6)


@pytest.mark.parametrize("lag", LAGS)
def test_amplitude_has_fallen_by_three_decibel_at_the_bandwidth(lag: Lag) -> None:
    s = 2j * np.pi * lag.bandwidth_hz * lag.time_s
    gain = abs(1.0 / (1.0 + s)) if lag.damping is None else abs(1.0 / (1.0 + 2.0 * lag.damping * s + s * s))
    assert gain == pytest.approx(np.sqrt(0.5), rel=1e-12)


@pytest.mark.parametrize("lag", LAGS)
def test_sensitivity_is_the_limit_of_differences(lag: Lag) -> None:
    t = times(300)
    u = np.sin(20.0 * t)[:, None]
    _, slope = lag.sensitivity(u, STEP)
    for row, name in zip(slope, ("time_s", "damping"), strict=False):
        errors = []
        for h in (2e-3, 1e-3):
            fields = {"time_s": lag.time_s, "damping": lag.damping}
            step = h * float(fields[name] or 0.0)
            up, down = ({**fields, name: float(fields[name] or 0.0) + d} for d in (step, -step))
            more, less = (Lag(**one).sensitivity(u, STEP)[0] for one in (up, down))  # type: ignore[arg-type]
            central = (more - less) / (2.0 * step)
            errors.append(float(np.max(np.abs(central - row))))
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("shift", [-0.8, 0.0, 0.344, 12.0])
def test_rough_shift_and_sign_between_records(shift: float) -> None:
    rng = np.random.default_rng(3)
    t = times(2000)
    signal = np.cumsum(rng.standard_normal(2600)) * 0.01
    a, b = signal[300:2300], -np.interp(t, t, signal[300:2300]) + 1e-4 * rng.standard_normal(2000)
    found, match = coarse_shift(t, a, t + shift, b, step_s=STEP)
    assert found == pytest.approx(shift, abs=STEP)
    assert match < -0.9


def test_what_stands_still_has_no_delay() -> None:
    t = times(200)
    with pytest.raises(InputError, match="does not move"):
        coarse_shift(t, np.zeros(200), t, np.sin(t), step_s=STEP)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.3, 0.9), st.booleans(), st.booleans())
def test_a_short_record_is_found_in_a_long_one_of_either_sign(place: float, first: bool, mirrored: bool) -> None:
    """Windows of different length, the short one within the long one or at its end; whichever is given first."""
    rng = np.random.default_rng(int(1000 * place))
    t: Float = 0.01 * np.arange(4000, dtype=np.float64)
    y: Float = np.cumsum(rng.normal(size=4000))
    begin = int(place * 3999)
    late = 0.35
    short_t, short = t[begin : begin + 600] + late, (-1.0 if mirrored else 1.0) * y[begin : begin + 600]
    if first:
        shift, together = coarse_shift(t, y, short_t, short, step_s=0.01)
    else:
        shift, together = coarse_shift(short_t, short, t, y, step_s=0.01)
    assert shift == pytest.approx(late if first else -late, abs=0.011)
    assert together * (-1.0 if mirrored else 1.0) > 0.1
