"""Play in axis-specific output: the lost motion of the path that the motors take, and none where it is not asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import records
from counterflex.core.units import URAD
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.robot.model.description import Play
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.supervisor import State
from counterflex.runtime.step.axis_play import PlayCompensation

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
GEAR = Play(20 * URAD, (100.0, 100.0, 100.0), (10 * URAD, 20 * URAD, 40 * URAD))
CHAIN = replace(CELL.chain, play=(GEAR,) * 6)
Q = np.radians([0.0, -90.0, 120.0, 5.0, 30.0, 0.0])
T = 4e-3


def run(play: PlayCompensation, q: Float, added: Float, state: State = State.ACTIVE) -> Float:
    """Feed a path (n, 6) and corrections (n, 6); returns what was added to them."""
    out = np.zeros_like(q)
    for k in range(len(q)):
        given, result = records(GIVEN)[0], records(RESULT)[0]
        given.elapsed, result.state = 1, state
        given.q = q[k]
        result.axes = added[k]
        play.after(given, result)
        out[k] = result.axes - added[k]
    return out


def swinging(n: int = 1200) -> Float:
    """All axes to and fro by 1 mrad, slowly."""
    phase = 2.0 * np.pi * np.arange(n) / 600.0
    out: Float = Q + 1e-3 * np.sin(phase)[:, None]
    return out


def test_it_is_half_the_play_in_the_direction_of_program_and_correction_together() -> None:
    """The correction runs against the program, is larger and so turns the motors round."""
    q = swinging()
    phase = 2.0 * np.pi * np.arange(len(q)) / 600.0
    added = -1.6e-3 * np.sin(phase)[:, None] * np.ones(6)
    found = run(PlayCompensation(CHAIN, T, contained=False), q, added)
    calm = np.flatnonzero((np.abs(np.cos(phase)) > 0.3) & (phase > 0.5))  # away from the reversals
    expected = 20 * URAD * np.sign(np.gradient((q + added)[:, 0]))[calm, None] * np.ones(6)
    np.testing.assert_allclose(found[calm], expected, atol=1e-9)


def test_an_axis_that_trembles_does_not_turn_round() -> None:
    rng = np.random.default_rng(0)
    q = Q + np.linspace(0.0, 1e-3, 600)[:, None] * np.ones(6)
    added = 1.0 * URAD * rng.uniform(-1.0, 1.0, (600, 6))
    found = run(PlayCompensation(CHAIN, T, contained=False), q, added)
    assert found[300:].min() > 0.0


def test_it_never_jumps() -> None:
    play = PlayCompensation(CHAIN, T, contained=False)
    found = run(play, swinging(), np.zeros((1200, 6)))
    steps = np.abs(np.diff(found, axis=0, prepend=0.0))
    assert np.all(steps <= play.plays["step"] * (1.0 + 1e-12))
    assert steps.max() < 5 * URAD


def test_a_program_that_contains_its_play_gets_that_of_the_correction_only() -> None:
    q = swinging()
    none = run(PlayCompensation(CHAIN, T, contained=True), q, np.zeros_like(q))
    np.testing.assert_allclose(none, 0.0, atol=1e-15)
    added = -1.6e-3 * np.sin(2.0 * np.pi * np.arange(len(q)) / 600.0)[:, None] * np.ones(6)
    found = run(PlayCompensation(CHAIN, T, contained=True), q, added)
    np.testing.assert_allclose(np.abs(found[:, 0]).max(), 40 * URAD, rtol=1e-6)


def test_what_the_controller_adds_itself_is_left_to_it() -> None:
    q = swinging()
    own = np.full(6, 20 * URAD)
    alone = run(PlayCompensation(CHAIN, T, contained=False), q, np.zeros_like(q))
    shared = run(PlayCompensation(CHAIN, T, contained=False, own_rad=own), q, np.zeros_like(q))
    rising = slice(700, 740)
    np.testing.assert_allclose(shared[rising], alone[rising] - own, atol=2 * URAD)


@pytest.mark.parametrize("state", [State.IDLE, State.READY, State.ARMED])
def test_it_acts_only_while_the_correction_does(state: State) -> None:
    q = swinging()
    np.testing.assert_array_equal(run(PlayCompensation(CHAIN, T, contained=False), q, 0.0 * q, state), 0.0)


def test_a_hold_holds_it() -> None:
    play, q = PlayCompensation(CHAIN, T, contained=False), swinging()
    before = run(play, q[:140], np.zeros((140, 6)))[-1]
    assert np.abs(before).max() > 10 * URAD
    np.testing.assert_array_equal(run(play, q[140:], np.zeros((1060, 6)), State.HOLD), before[None].repeat(1060, 0))


def test_nothing_of_it_goes_into_another_session() -> None:
    play, q = PlayCompensation(CHAIN, T, contained=False), swinging()
    assert np.abs(run(play, q[:140], np.zeros((140, 6)))[-1]).max() > 10 * URAD
    given, result = records(GIVEN)[0], records(RESULT)[0]
    given.q = q[139]
    given.elapsed, result.state, result.silent = 1, State.FAULT, 1
    play.after(given, result)
    result.state, result.silent = State.IDLE, 0
    play.after(given, result)
    np.testing.assert_array_equal(result.axes, 0.0)


def test_cells_and_settings_that_do_not_fit_say_so() -> None:
    with pytest.raises(InputError, match="knows no play"):
        PlayCompensation(replace(CELL.chain, play=None), T, contained=False)
    with pytest.raises(InputError, match="axis-specific output"):
        OnlineSettings(axis_play=True)
    with pytest.raises(InputError, match="half the play"):
        PlayCompensation(CHAIN, T, contained=False, own_rad=np.full(6, -1e-6))
