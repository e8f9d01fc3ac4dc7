"""Gains of the tracker loop: margins against closed forms and against a loop run in time, and what a design keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.records import records
from counterflex.runtime.design.tracker import (
    DesignGoals,
    TrackerGains,
    closed_loop_radius,
    design,
    grid,
    lag_filter,
    margins,
    margins_of,
    notch_at,
    observer_gain,
    observer_response,
)
from counterflex.runtime.design.tracker_plant import TrackerPlant
from counterflex.runtime.settings import Delays
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.memory import STATE
from counterflex.runtime.step.tracker import designed

T = 0.004
KV, SPEED_LOOP = 11.0, 150.0
W0 = math.sqrt(KV * SPEED_LOOP)
TRAILING = TrackerPlant(T, 0.015, W0, 0.5 * (KV + SPEED_LOOP) / W0, 2.0 * math.pi * 8.5, 0.1)
"""The robot of Mandiola2023 as the twin has it: Kv 11, speed loop 150 1/s, 15 ms, a mode at 8.5 Hz."""


def simulated(plant: TrackerPlant, gains: TrackerGains, seconds: float, step_s: float = 1e-4) -> Float:
    """Deviation of the closed loop after a step of it, sampled; fine semi-implicit integration, no state space."""
    per_cycle, late = round(plant.period_s / step_s), round(plant.delay_s / step_s)
    n = round(seconds / step_s)
    sent = np.zeros(n + late + 1)
    y = rate = r = r_rate = 0.0
    w0, z0, w, z = plant.natural_per_s, plant.damping, plant.mode_per_s, plant.mode_damping
    total, out, x1, x2 = 0.0, [], 0.0, 0.0
    held = 0.0
    b0, b1, b2, a1, a2 = gains.notch
    for k in range(n):
        if k % per_cycle == 0:
            e = 1.0 + y + plant.mode_share * r
            out.append(e)
            f = b0 * e + x1
            x1, x2 = b1 * e - a1 * f + x2, b2 * e - a2 * f
            total += gains.integral * f
            held = -(total + gains.proportional * f)
        sent[k + late] = held
        acceleration = w0 * w0 * (sent[k] - y) - 2.0 * z0 * w0 * rate
        if w > 0.0:
            r_rate += step_s * (-acceleration - 2.0 * z * w * r_rate - w * w * r)
            r += step_s * r_rate
        rate += step_s * acceleration
        y += step_s * rate
    return np.array(out)


def test_the_published_gain_has_the_margins_of_the_prototype() -> None:
    found = margins(TRAILING, TrackerGains(0.01))
    assert found.crossover_hz == pytest.approx(0.39, abs=0.01)
    assert found.phase_deg == pytest.approx(75.0, abs=2.0)
    assert 23.0 <= found.gain_db <= 26.0
    assert found.sensitivity == pytest.approx(1.19, abs=0.03)
    at_limit = TrackerGains(0.01 * found.gain)
    assert 0.144 <= at_limit.integral <= 0.203


@pytest.mark.parametrize("cycles", [0, 1, 3, 7])
def test_an_integrator_behind_a_dead_time_has_its_closed_form(cycles: int) -> None:
    """``K = 2 sin(pi / (2 (2 d - 1)))`` is the limit of ``K / (1 - 1/z) z^-d``; the phase at crossover likewise."""
    fast = TrackerPlant(T, cycles * T, 2.0e4, 1.0)
    d = cycles + 1
    limit = 2.0 * math.sin(math.pi / (2.0 * (2.0 * d - 1.0)))
    found = margins(fast, TrackerGains(0.1 * limit))
    if d > 1:
        assert found.gain == pytest.approx(10.0, rel=1e-3)
    angle = 2.0 * math.asin(0.05 * limit)
    assert found.crossover_hz == pytest.approx(angle / (2.0 * math.pi * T), rel=1e-3)
    assert found.phase_rad == pytest.approx(0.5 * math.pi - (d - 0.5) * angle, abs=1e-3)
    assert (
        closed_loop_radius(fast, TrackerGains(0.99 * limit))
        < 1.0
        < closed_loop_radius(fast, TrackerGains(1.01 * limit))
    )


@pytest.mark.parametrize("notch", [False, True])
@pytest.mark.parametrize("delay_s", [0.0122, 0.016])
def test_the_gain_margin_is_where_a_simulated_loop_begins_to_swing(notch: bool, delay_s: float) -> None:
    plant = replace(TRAILING, delay_s=delay_s)
    shape = notch_at(plant.mode_per_s, plant.mode_damping, T) if notch else (1.0, 0.0, 0.0, 0.0, 0.0)
    gains = TrackerGains(0.02, 0.4, shape)
    found = margins(plant, gains)
    assert found.stable

    def swings(factor: float) -> float:
        scaled = TrackerGains(factor * gains.integral, factor * gains.proportional, shape)
        e = simulated(plant, scaled, 8.0)
        return float(np.max(np.abs(e[-500:])) / np.max(np.abs(e[1000:1500])))

    assert swings(0.95 * found.gain) < 0.9
    assert swings(1.05 * found.gain) > 1.1


def test_a_sampled_robot_answers_as_the_fine_one_does() -> None:
    """Step of the correction, dead time of no whole number of cycles."""
    plant = replace(TRAILING, delay_s=0.0137)
    A, B, C = plant.sampled()
    x, found = np.zeros(len(B)), []
    for _ in range(200):
        found.append(float(C @ x))
        x = A @ x + B
    step_s, y, rate, r, r_rate = 2e-5, 0.0, 0.0, 0.0, 0.0
    expected = []
    for k in range(200 * 200):
        if k % 200 == 0:
            expected.append(y + r)
        u = 1.0 if k * step_s >= plant.delay_s - 1e-12 else 0.0
        acceleration = plant.natural_per_s**2 * (u - y) - 2.0 * plant.damping * plant.natural_per_s * rate
        r_rate += step_s * (-acceleration - 0.2 * plant.mode_per_s * r_rate - plant.mode_per_s**2 * r)
        r += step_s * r_rate
        rate += step_s * acceleration
        y += step_s * rate
    np.testing.assert_allclose(found, expected, atol=2e-3)


@settings(max_examples=6, deadline=None)
@given(
    delay=st.floats(0.004, 0.05),
    lag=st.floats(0.02, 0.15),
    mode=st.floats(5.0, 20.0),
    damping=st.floats(0.03, 0.3),
    share=st.floats(0.2, 1.0),
)
def test_a_design_keeps_its_margins_and_is_the_largest(
    delay: float, lag: float, mode: float, damping: float, share: float
) -> None:
    w0 = math.sqrt(150.0 / lag)
    plant = TrackerPlant(T, delay, w0, 0.5 * (1.0 / lag + 150.0) / w0, 2.0 * math.pi * mode, damping, share)
    goals = DesignGoals()
    gains = design(plant, goals)
    robots = goals.neighbours(plant)
    assert len(robots) == 9
    assert all(margins(robot, gains).meets(goals) for robot in robots)
    larger = TrackerGains(1.02 * gains.integral, 1.02 * gains.proportional, gains.notch)
    assert not all(margins(robot, larger).meets(goals) for robot in robots)


def test_a_design_is_faster_than_the_published_gain_and_as_safe() -> None:
    gains = design(TRAILING)
    published, ours = margins(TRAILING, TrackerGains(0.01)), margins(TRAILING, gains)
    assert ours.crossover_hz > 3.0 * published.crossover_hz
    assert ours.meets(DesignGoals())
    without = design(TRAILING, notch=False)
    assert without.integral < 0.5 * gains.integral


def test_more_margin_costs_gain() -> None:
    careful = design(TRAILING, DesignGoals(phase_rad=math.radians(70.0), gain=10.0, sensitivity=1.3))
    assert careful.integral < 0.7 * design(TRAILING).integral


def test_what_cannot_be_designed_is_refused() -> None:
    with pytest.raises(ModelError, match="margins"):
        design(replace(TRAILING, delay_s=0.1), DesignGoals(gain=1e6))
    with pytest.raises(InputError, match="too fast"):
        notch_at(1000.0, 0.1, T)
    with pytest.raises(InputError, match="natural_per_s"):
        replace(TRAILING, natural_per_s=0.0)


def test_the_observers_gain_is_that_of_its_filter_run_long() -> None:
    q, r = 1.6e-10, 3.6e-9
    variance = 1.0
    for _ in range(5000):
        gain = variance / (variance + r)
        variance = variance * (1.0 - gain) + q
    assert observer_gain(q, r) == pytest.approx(gain, rel=1e-9)


def test_the_observer_is_an_integrator_that_knows_what_is_on_its_way() -> None:
    """On the robot it is designed for, the loop's transfer from disturbance to deviation is ``1 - F``, F its filter."""
    rigid = replace(TRAILING, mode_per_s=0.0)
    f = grid(T)
    q, r = (200e-6) ** 2 * T, (60e-6) ** 2
    L = observer_response(rigid, q, r, f) * rigid.response(f)
    gain, z = observer_gain(q, r), np.exp(2j * np.pi * f * T)
    filtered = gain / (1.0 - (1.0 - gain) / z)
    np.testing.assert_allclose(1.0 / (1.0 + L), 1.0 - filtered * rigid.response(f), rtol=1e-6, atol=1e-9)
    assert margins_of(L, f, stable=True).phase_deg > 60.0


@pytest.mark.parametrize("hz", [0.5, 3.0, 8.5, 20.0])
def test_the_kernel_is_the_controller_of_the_design(hz: float) -> None:
    gains = design(TRAILING)
    settings, state = records(SETTINGS)[0], records(STATE)[0]
    settings.gain, settings.proportional = gains.integral, gains.proportional
    settings.notch[:] = gains.notch
    settings.saturation[:] = 1e9
    n = 6000
    turn = np.exp(2j * np.pi * hz * T * np.arange(n))
    out = np.empty(n)
    for k in range(n):
        designed(np.full(6, turn[k].real), True, settings, state)
        out[k] = gains.proportional * state.notch_output[4] - state.tracker_integral[4]
    half = n // 2
    basis = np.stack([turn[half:].real, -turn[half:].imag, np.ones(half)], axis=1)
    real, imaginary, _ = np.linalg.lstsq(basis, out[half:], rcond=None)[0]
    expected = gains.response(np.array([hz]), T)[0]
    assert complex(real, imaginary) == pytest.approx(expected, rel=1e-3)


def trailed(delays: Delays, r: Float, filter_: Float | None) -> Float:
    """Position of a robot that trails its program: first-order lag and dead time for both program and correction."""
    n = len(r)
    c = np.zeros(n)
    if filter_ is not None:
        v, a = np.gradient(r, T), np.gradient(np.gradient(r, T), T)
        m1 = m2 = 0.0
        for k in range(n):
            y = filter_[0] * v[k] + filter_[3] * a[k] + m1
            m1 = filter_[1] * v[k] + filter_[4] * a[k] - filter_[6] * y + m2
            m2 = filter_[2] * v[k] + filter_[5] * a[k] - filter_[7] * y
            c[k] = y
    dead = round(delays.dead_s / T)
    told = r + np.concatenate([np.zeros(dead), c[: n - dead]])
    y, out = r[0], np.empty(n)
    decay = math.exp(-T / delays.follow_lag_s)
    for k in range(n):
        y = decay * y + (1.0 - decay) * told[k]
        out[k] = y
    return out


@pytest.mark.parametrize("mode", [None, (8.5, 0.1)])
def test_a_steady_speed_and_acceleration_are_followed_without_error(mode: tuple[float, float] | None) -> None:
    delays = Delays(0.008, 2.0 / 0.09, 1.0, 0.09 - 0.5 * T, 0.0, 0.09)
    delays = replace(delays, follow_s=0.09, natural_per_s=1e3, damping=45.0)
    t = T * np.arange(1500)
    for path, size in ((0.0117 * t, 0.0117), (0.5 * 0.01 * t**2, 0.01)):
        r = np.asarray(path, dtype=np.float64)
        uncorrected = r - trailed(delays, r, None)
        left = r - trailed(delays, r, lag_filter(delays, T, mode))
        assert abs(uncorrected[-10]) > 0.08 * size
        assert abs(left[-10]) < 0.03 * abs(uncorrected[-10])


def test_a_filtered_lag_correction_has_nothing_at_the_mode() -> None:
    """Program and correction together, as the drives are told: at the mode only its damping is left."""
    delays = Delays(0.010, 40.0, 2.0, 0.097, 0.0, 0.091)
    hz, damping = 8.5, 0.1
    s = 2j * math.pi * hz
    back = np.exp(-s * T)

    def told(filter_: Float) -> complex:
        below = 1.0 + filter_[6] * back + filter_[7] * back**2
        speed = (filter_[0] + filter_[1] * back + filter_[2] * back**2) / below
        second = (filter_[3] + filter_[4] * back + filter_[5] * back**2) / below
        return complex(1.0 + speed * s + second * s * s)

    plain, shaped = told(lag_filter(delays, T, None)), told(lag_filter(delays, T, (hz, damping)))
    assert abs(plain) > 3.0
    assert abs(shaped) < 0.35 * abs(plain)
