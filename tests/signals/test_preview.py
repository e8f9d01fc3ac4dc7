"""Commands that a structure turns into a wanted motion: laws of the inverse, and what it is worth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.signals.preview import Ahead, Mode, Shaping, _passed, by_group, command_for

STEP = 0.002
TIME: Float = np.arange(0.0, 2.0, STEP)
RISE: Float = (1.0 - np.cos(np.pi * np.clip((TIME - 0.6) / 0.15, 0.0, 1.0)))[:, None] / 2.0
MODE = Mode(2.0 * np.pi * 9.0, 0.08)


def through(mode: Mode, time: Float, command: Float) -> Float:
    """The mode's answer to a command, by an integrator of another library."""
    w, zeta = mode.omega_rad_s, mode.damping_ratio

    def rate(t: float, x: Float) -> list[float]:
        return [x[1], w * w * (float(np.interp(t, time, command)) - x[0]) - 2.0 * zeta * w * x[1]]

    found = solve_ivp(rate, (time[0], time[-1]), [command[0], 0.0], t_eval=time, max_step=1e-3, rtol=1e-8, atol=1e-10)
    out: Float = found.y[0]
    return out


def test_the_structure_makes_of_the_command_what_is_wanted_pair() -> None:
    """A rise in 150 ms through a mode of 9 Hz: sent as it is, it rings; sent as its command, it does not."""
    plain = through(MODE, TIME, RISE[:, 0])
    command = command_for(RISE, TIME, (MODE,), Shaping(0.005, 0.0))[:, 0]
    made = through(MODE, TIME, command)
    assert np.max(np.abs(plain - RISE[:, 0])) > 0.12
    assert np.max(np.abs(made - RISE[:, 0])) < 0.01


@pytest.mark.parametrize("damping", [0.05, 1.0, 1.5])
def test_what_passes_a_mode_swings_as_a_filter_of_another_library_does(damping: float) -> None:
    mode, step, held = Mode(53.0, damping), 1e-3, np.cumsum(np.random.default_rng(1).normal(size=(2000, 2)), axis=0)
    w = mode.omega_rad_s
    numerator, denominator, _ = cont2discrete(([w * w], [1.0, 2.0 * damping * w, w * w]), step)
    b = numerator.ravel()
    at_rest = lfilter_zi(b, denominator)[:, None] * held[0]
    expected = lfilter(b, denominator, held, axis=0, zi=at_rest)[0]
    np.testing.assert_allclose(_passed(held, step, mode), expected, rtol=0, atol=1e-10)


def test_a_dead_time_is_sent_ahead() -> None:
    """Lead alone shifts the command, so that after the dead time the same motion is made."""
    plain = command_for(RISE, TIME, (MODE,), Shaping(0.01, 0.0))[:, 0]
    early = command_for(RISE, TIME, (MODE,), Shaping(0.01, 0.02))[:, 0]
    assert np.allclose(early[:-10], plain[10:], atol=1e-3)


def test_two_modes_are_undone_one_after_the_other() -> None:
    second = Mode(2.0 * np.pi * 5.0, 0.7)
    command = command_for(RISE, TIME, (MODE, second), Shaping(0.004, 0.0))[:, 0]
    made = through(MODE, TIME, through(second, TIME, command))
    assert np.max(np.abs(made - RISE[:, 0])) < 0.02


def test_what_swings_by_itself_needs_the_static_command() -> None:
    """A load whose effect passes the same mode as the command: the inverse of the mode cancels the mode."""
    command = command_for(np.zeros_like(RISE), TIME, (MODE,), Shaping(0.005, 0.0), RISE)[:, 0]
    assert np.max(np.abs(command - RISE[:, 0])) < 0.03
    at_once = command_for(RISE, TIME, (MODE,), Shaping(0.005, 0.0))[:, 0]
    assert np.max(np.abs(at_once - RISE[:, 0])) > 0.06


@given(st.floats(0.002, 0.05), st.floats(0.0, 0.02), st.integers(0, 2**32 - 1))
def test_linear_and_still_where_nothing_changes(tau: float, lead: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.001, 0.03, 60))
    y, z = rng.normal(size=(60, 2)), rng.normal(size=(60, 2))
    shaping = Shaping(tau, lead)
    both = command_for(2.0 * y - z, time, (MODE,), shaping)
    assert np.allclose(
        both, 2.0 * command_for(y, time, (MODE,), shaping) - command_for(z, time, (MODE,), shaping), atol=1e-6 * 30
    )
    still = command_for(np.full((60, 2), 0.7), time, (MODE,), shaping)
    assert np.allclose(still, 0.7, atol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_more_smoothing_bends_less(seed: int) -> None:
    rng = np.random.default_rng(seed)
    y = np.cumsum(rng.normal(size=(len(TIME), 1)), axis=0) * 0.01

    def bend(tau: float) -> float:
        u = command_for(y, TIME, (), Shaping(tau, 0.0))[:, 0]
        return float(np.sum(np.diff(u, 2) ** 2))

    assert bend(0.05) < bend(0.02) < bend(0.006)


def test_groups_do_not_know_each_other() -> None:
    y = np.concatenate([RISE, 1.0 - RISE])
    time = np.concatenate([TIME, TIME + 5.0])
    group = np.repeat(np.arange(2), len(TIME))
    both = by_group(y, np.zeros_like(y), time, group, (MODE,), Shaping(0.01, 0.0))
    alone = command_for(RISE, TIME, (MODE,), Shaping(0.01, 0.0), np.zeros_like(RISE))
    assert np.array_equal(both[: len(TIME)], alone)
    assert np.all(by_group(0.0 * y, 0.0 * y, time, group, (MODE,), Shaping(0.01, 0.01)) == 0.0)
    assert by_group(y[:0], y[:0], time[:0], group[:0], (MODE,), Shaping(0.01, 0.0)).shape == (0, 1)


def test_without_smoothing_the_static_command_is_sent() -> None:
    assert np.array_equal(command_for(RISE, TIME, (MODE,), Shaping(0.0, 0.0), RISE), 2.0 * RISE)


def test_refusals() -> None:
    for bad in ((-0.1, 0.0), (0.0, float("inf"))):
        with pytest.raises(InputError):
            Shaping(*bad)
    with pytest.raises(InputError, match="mode"):
        Mode(0.0, 0.1)
    with pytest.raises(InputError, match="times go back"):
        command_for(RISE, TIME[::-1].copy(), (MODE,), Shaping(0.01, 0.0))
    with pytest.raises(InputError, match="no mode"):
        command_for(RISE, TIME, (), Shaping(0.01, 0.0), RISE)
    with pytest.raises(InputError, match="too long"):
        command_for(RISE, TIME * 1e5, (MODE,), Shaping(0.01, 0.0))


@given(st.floats(0.0, 1.0), st.integers(0, 100))
def test_only_the_share_of_the_arm_swings_and_what_has_come_in_time_does_not(share: float, number: int) -> None:
    """The command is linear in both; a share of 0 asks for all at once, and the parts add up to the whole."""
    rng = np.random.default_rng(number)
    requested, moved = RISE * rng.uniform(0.5, 2.0), RISE * rng.uniform(-1.0, 1.0)
    shaping = Shaping(0.004, 0.0)

    def command(part: float, wanted: Float, there: Float) -> Float:
        return Ahead(part, (MODE,), shaping).command(wanted, TIME, there)

    none = np.zeros_like(requested)
    both = command(share, requested, moved)
    np.testing.assert_allclose(both, command(share, requested, none) + command(share, none, moved), atol=1e-9)
    np.testing.assert_allclose(command(share, none, moved), command(0.0, moved, none), atol=1e-9)
    mixed = share * command(1.0, requested, none) + (1.0 - share) * command(0.0, requested, none)
    np.testing.assert_allclose(command(share, requested, none), mixed, atol=1e-9)


@settings(max_examples=20)
@given(st.floats(0.0, 1.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_at_rest_the_whole_is_commanded_whatever_part_of_it_swings(share: float, force: float, there: float) -> None:
    still = np.ones((len(TIME), 2))
    found = Ahead(share, (MODE,), Shaping(0.004, 0.0)).command(force * still, TIME, there * still)
    np.testing.assert_allclose(found, (force + there) * still, atol=1e-9)


@pytest.mark.parametrize(("share", "moved"), [(0.6, 0.5), (0.0, -0.3)])
def test_what_swings_and_what_does_not_are_undone_together(share: float, moved: float) -> None:
    """The command through the mode against the deflection: the arm's share through the mode, the rest at once.

    Within 3 %: half a step of 2 ms at this rise, which the mode enlarges.
    """
    rise = RISE[:, 0]
    there = moved * np.interp(TIME - 0.08, TIME, rise)[:, None]
    command = Ahead(share, (MODE,), Shaping(0.004, 0.0)).command(RISE, TIME, there)[:, 0]
    deflection = (1.0 - share) * rise + share * through(MODE, TIME, rise) + there[:, 0]
    assert np.max(np.abs(through(MODE, TIME, command) - deflection)) < 0.03
