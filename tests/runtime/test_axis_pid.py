"""PID per axis: its samples, its margins on robots whose delays are spread, its limit, and what it does not go with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.runtime.axis_gains import AxisGains
from counterflex.runtime.design.axis_pid import design, radius, robots, step_error, worst_margins
from counterflex.runtime.design.tracker import DesignGoals
from counterflex.runtime.design.tracker_plant import TrackerPlant
from counterflex.runtime.settings import OnlineSettings, Output, TrackerMode, require_for_held_part
from counterflex.runtime.step.axis_pid import AxisPid
from counterflex.runtime.step.axis_pid_kernel import pid_step

T = 4e-3
PLANT = TrackerPlant(T, 12e-3, 2.0 * math.pi * 5.0, 0.7, 2.0 * math.pi * 10.0, 0.1, 0.05)
GAINS = AxisGains(0.7, 1.3, 0.02, 0.006, 1.0)


def sampled(gains: AxisGains, error: Float) -> Float:
    """(n,) what the kernel adds for a series of errors."""
    pid = AxisPid((gains,) * 6, T, 12e-3, expected=False)
    out = np.zeros(len(error))
    for k, e in enumerate(error):
        pid.memory["wanted"] = e
        pid_step(pid.pids[0], pid.memory[0], True)
        out[k] = pid.added[3]
    return out


def test_samples_are_those_of_the_transfer_function() -> None:
    """Periodic error: the response settles to C(z) of that frequency; the sum only shifts it."""
    n, cycles = 50, 40
    t = np.arange(n * cycles)
    out = sampled(GAINS, np.cos(2.0 * np.pi * t / n))
    found = 2.0 * np.mean(out[-n:] * np.exp(-2j * np.pi * t[-n:] / n))
    assert abs(found - GAINS.response(np.array([1.0 / (n * T)]), T)[0]) < 1e-9


def followed(plant: TrackerPlant, gains: AxisGains, cycles: int) -> Float:
    """(n,) angle in effect after a step of 1 of the angle wanted, the controller being the kernel."""
    A, B, C = plant.sampled()
    pid, x, y = AxisPid((gains,) * 6, T, plant.delay_s, expected=False), np.zeros(len(B)), np.zeros(cycles)
    for k in range(cycles):
        y[k] = C @ x
        pid.memory["wanted"], pid.memory["seen"] = 1.0, y[k]
        pid_step(pid.pids[0], pid.memory[0], True)
        x = A @ x + B * (1.0 + pid.added[0])
    return y


FOUND = design(PLANT, most_rad=10.0)


def test_the_design_keeps_its_goals_and_is_quicker() -> None:
    assert FOUND.margins.meets(DesignGoals())
    assert FOUND.radius < 1.0
    assert FOUND.late_s < 0.95 * FOUND.late_alone_s
    y = followed(PLANT, FOUND.gains, 250)
    assert np.sum(np.abs(1.0 - y)) * T == pytest.approx(FOUND.late_s, rel=1e-9)
    assert y.max() < 1.15


def test_margins_are_those_of_the_worst_robot_each_looked_at_by_itself() -> None:
    """With the mode as it is known, off on both sides, and unseen by the encoder; lag and dead time likewise."""
    goals, gains = DesignGoals(), FOUND.gains
    plants = robots(PLANT, goals)
    each = [worst_margins((one,), gains)[0] for one in plants]
    whole, largest = worst_margins(plants, gains)
    assert whole == FOUND.margins
    assert whole.phase_rad == min(one.phase_rad for one in each)
    assert whole.gain == min(one.gain for one in each)
    assert whole.sensitivity == max(one.sensitivity for one in each)
    assert largest == FOUND.radius == max(radius(one, gains) for one in plants)
    seen = {(round(one.mode_per_s / PLANT.mode_per_s, 9), round(one.delay_s / PLANT.delay_s, 9)) for one in plants}
    factors = [[0.0, 1.0 - goals.mode_off, 1.0, 1.0 + goals.mode_off], [1.0 - goals.lag_off, 1.0, 1.0 + goals.lag_off]]
    assert seen == {(round(mode, 9), round(late, 9)) for mode in factors[0] for late in factors[1]}
    assert len(plants) == len(seen)


@settings(max_examples=40, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_it_is_stable_on_every_robot_within_the_spread(lag: float, mode: float, seen: float) -> None:
    """Dead time and lag off by up to 10 %, mode by 15 %, any part of it seen: the kernel's loop settles."""
    slower = 1.0 + 0.10 * lag
    plant = replace(
        PLANT,
        delay_s=PLANT.delay_s * slower,
        natural_per_s=PLANT.natural_per_s / slower,
        mode_per_s=PLANT.mode_per_s * (1.0 + 0.15 * mode),
        mode_share=PLANT.mode_share * seen,
    )
    assert radius(plant, FOUND.gains) < 1.0
    y = followed(plant, FOUND.gains, 1500)
    assert np.all(np.abs(y[-100:] - 1.0) < 0.02)


def test_the_gain_margin_is_where_the_poles_leave_the_circle() -> None:
    """Nyquist against exact poles, on one robot."""
    margin = worst_margins((PLANT,), FOUND.gains)[0].gain

    def times(factor: float) -> AxisGains:
        g = FOUND.gains
        return replace(
            g,
            proportional=factor * g.proportional,
            integral_per_s=factor * g.integral_per_s,
            derivative_s=factor * g.derivative_s,
        )

    assert radius(PLANT, times(0.98 * margin)) < 1.0
    assert radius(PLANT, times(1.02 * margin)) > 1.0


def test_the_sum_stands_still_at_the_limit() -> None:
    """An axis that does not follow for 10 s: the limit is left in the cycle in which the error turns."""
    limited = AxisGains(0.5, 2.0, 0.0, 0.0, 0.3)
    out = sampled(limited, np.concatenate([np.full(2500, 0.4), np.full(20, -0.4)]))
    assert out.max() == pytest.approx(0.3)
    assert out[2500] < 0.0


def test_no_gain_where_there_is_no_margin() -> None:
    """A resonance that the encoder sees whole cannot be held with these margins."""
    with pytest.raises(ModelError, match="no gain of the axis"):
        design(replace(PLANT, mode_share=1.0, delay_s=40e-3))


def test_an_idle_controller_leaves_the_answer_alone() -> None:
    A, B, C = PLANT.sampled()
    x, late = np.zeros(len(B)), 0.0
    for _ in range(250):
        late += abs(1.0 - float(C @ x)) * T
        x = A @ x + B
    assert step_error(PLANT, AxisGains()) == pytest.approx(late, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"output": Output.CARTESIAN}, "output"),
        ({"tracker": TrackerMode.OBSERVER}, "tracker"),
        ({"axis_play": True}, "axis_play"),
    ],
)
def test_what_it_does_not_go_with_is_refused(change: dict[str, object], key: str) -> None:
    with pytest.raises(InputError) as fault:
        OnlineSettings(**{"output": Output.AXES, "axis_pid": (GAINS,) * 6, **change})  # type: ignore[arg-type]
    assert key in str(fault.value)


def test_a_held_part_and_five_axes_are_refused() -> None:
    with pytest.raises(InputError, match="axis_pid"):
        require_for_held_part(OnlineSettings(output=Output.AXES, axis_pid=(GAINS,) * 6))
    with pytest.raises(InputError, match="6, one for each axis"):
        OnlineSettings(output=Output.AXES, axis_pid=(GAINS,) * 5)
