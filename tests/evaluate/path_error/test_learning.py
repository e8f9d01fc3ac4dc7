"""Learning from part to part on plants of known response: closed forms, convergence, what is not seen, scatter."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import UM
from counterflex.evaluate.path_error import learning
from counterflex.evaluate.path_error.learning import MeasuredError, ToolResponse, learned, scatter_of

N = 300
TIME = np.linspace(0.0, 0.012 * (N - 1), N)
SIGMA = 3.0 * UM
LEAST = 5.0 * UM
Plant = Callable[[Float], Float]


def following(*, gain: float = 0.1, delay_s: float = 0.02) -> ToolResponse:
    """A gain of each axis and one delay."""
    none, axes = np.zeros((N, 3)), [np.tile(gain * axis, (N, 1)) for axis in np.eye(3)]
    late = np.stack([none, none, none, np.full((N, 3), delay_s)])
    return ToolResponse(TIME, np.zeros(N, dtype=np.int64), np.stack([*axes, none]), late, 25.0 * UM)


def smooth() -> Float:
    """An error that changes by several hundred micrometres within a second: of each axis its own."""
    return np.column_stack([300.0 * np.sin(TIME), 400.0 * np.exp(-2.0 * TIME) - 150.0, 80.0 + 0.0 * TIME]) * UM


def part_of(taken: Float, error: Float, seen: Bool | None = None) -> MeasuredError:
    return MeasuredError(taken, error, np.full((N, 3), SIGMA), np.ones((N, 3), np.bool_) if seen is None else seen)


def run(error: Float, plant: Plant, parts: int, ways: ToolResponse) -> tuple[list[Float], learning.Learned]:
    """Errors of parts that are made one after the other, and what was learned from all."""
    taken, done, errors = np.zeros((N, 3)), [], []
    for _ in range(parts):
        errors.append(error - plant(taken))
        done.append(part_of(taken, errors[-1]))
        state = learned(done, ways)
        taken = taken + state.best_step(ways)
    return errors, state


def size(error: Float) -> float:
    return float(np.sqrt(np.mean(error**2)))


def late(step: Float, delay_s: float) -> Float:
    return np.column_stack([np.interp(TIME - delay_s, TIME, column) for column in step.T])


def test_a_tool_that_follows_as_it_should_is_right_after_one_part_in_closed_form() -> None:
    """With one even error e and no doubt of delays the step is ``e / (1 + gain^2 + LOCAL^2)``, less what SIZE holds."""
    even = np.tile([0.0, 200.0 * UM, -100.0 * UM], (N, 1))
    ways = following(delay_s=0.0)
    step = learned([part_of(np.zeros((N, 3)), even)], ways).best_step(ways)
    np.testing.assert_allclose(step, even / (1.0 + 0.1**2 + learning.LOCAL**2), rtol=1e-4, atol=1e-12)
    errors, _ = run(smooth(), lambda taken: taken, 3, following())
    assert size(errors[1]) < 0.03 * size(errors[0])
    assert size(errors[2]) < 0.01 * size(errors[0])


@pytest.mark.parametrize("gain", [0.6, 0.9, 1.2])
def test_a_plant_whose_gain_is_wrong_and_not_learned_converges_geometrically(gain: float) -> None:
    """The error is ``|1 - g|^k`` of the first, with g the gain times the share 1 / (1 + LOCAL^2) of a step."""
    even = np.tile([0.0, 20.0, -10.0], (N, 1)) * 1e3 * UM
    errors, _ = run(even, lambda taken: gain * taken, 4, following(gain=0.0, delay_s=0.0))
    left = 1.0 - gain / (1.0 + learning.LOCAL**2)
    for k, error in enumerate(errors):
        np.testing.assert_allclose(error[:, 1:], left**k * even[:, 1:], rtol=0.1 * k, atol=1e-9)


@pytest.mark.parametrize("gain", [0.7, 1.2])
def test_the_secant_recovers_the_gain_of_a_scalar_plant(gain: float) -> None:
    """From two parts, within two of its standard deviations; no axis lends its gain to another."""
    even = np.tile([0.0, 400.0, 0.0], (N, 1)) * UM
    ways = following(gain=0.2, delay_s=0.0)
    step = np.tile([0.0, 350.0, 0.0], (N, 1)) * UM
    state = learned([part_of(0.0 * step, even), part_of(step, even - gain * step)], ways)
    sigma = 0.2 * np.sqrt(state.covariance[1, 1])
    assert 1.0 - 0.2 * state.response[1] == pytest.approx(gain, abs=2.0 * sigma)
    assert sigma < 0.1
    np.testing.assert_array_equal(state.response[[0, 2]], 0.0)


def test_parts_without_error_change_nothing() -> None:
    parts = [part_of(smooth(), np.zeros((N, 3)))] * 3
    np.testing.assert_array_equal(learned(parts, following()).best_step(following()), 0.0)


@pytest.mark.parametrize("gain", [0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
@pytest.mark.parametrize("delay_s", [0.0, 0.03])
def test_a_tool_that_follows_too_little_or_too_far_converges_from_part_to_part(gain: float, delay_s: float) -> None:
    errors, state = run(smooth(), lambda taken: gain * late(taken, delay_s), 5, following())
    sizes = [size(error) for error in errors]
    assert all(after < before or after < 0.02 * sizes[0] for before, after in itertools.pairwise(sizes))
    assert sizes[2] < 0.5 * abs(1.0 - gain) * sizes[0] + 0.03 * sizes[0]  # faster than by the wrong gain alone
    assert sizes[4] < 0.05 * sizes[0]
    assert np.sign(1.0 - gain) == np.sign(state.response[0])  # an error that stays is a gain below 1


def test_a_delay_is_learned_from_one_step() -> None:
    _, state = run(smooth(), lambda taken: late(taken, 0.03), 2, following())
    assert 0.02 * state.response[3] == pytest.approx(0.03, abs=0.012)
    assert state.covariance[3, 3] < 0.5


def test_what_no_part_shows_stays_unchanged_and_the_step_fades_towards_it() -> None:
    seen = np.ones((N, 3), np.bool_)
    seen[:, 0] = False
    seen[150:, 1] = False
    one = part_of(np.zeros((N, 3)), np.tile([300.0, 200.0, 0.0], (N, 1)) * UM, seen)
    ways = following()
    step = learned([one], ways).best_step(ways)
    np.testing.assert_array_equal(step[:, 0], 0.0)
    assert step[100, 1] == pytest.approx(200.0 * UM, rel=0.03)
    assert np.all(np.diff(step[149:, 1]) <= 0.0)
    behind = (TIME[150:] - TIME[-1]) * learning.RATE_M_S / learning.SIZE_M
    closed = step[149, 1] * np.cosh(behind) / np.cosh((TIME[149] - TIME[-1]) * learning.RATE_M_S / learning.SIZE_M)
    np.testing.assert_allclose(step[150:, 1], closed, rtol=0.02)
    other_run = replace(ways, group=np.repeat([0, 1], 150))
    np.testing.assert_array_equal(learned([one], other_run).best_step(other_run)[150:, 1], 0.0)


def test_a_part_that_was_spoiled_is_repaired_by_the_next() -> None:
    """The newest part counts: an error that a step brought in is taken out whole, however large it is."""
    spoiled = np.where((TIME > 1.0) & (TIME < 2.0), 250.0, 0.0)[:, None] * np.array([0.0, 1.0, 0.0]) * UM
    step = smooth()
    parts = [part_of(np.zeros((N, 3)), step), part_of(step, spoiled)]
    ways = following()
    again = learned(parts, ways).best_step(ways)
    inside = (TIME > 1.1) & (TIME < 1.9)
    assert np.min(again[inside, 1]) > 0.85 * 250.0 * UM
    outside = (TIME < 0.8) | (TIME > 2.2)
    assert np.max(np.abs(again[outside])) < 15.0 * UM


def test_parts_of_one_program_are_averaged_and_their_scatter_is_estimated() -> None:
    rng = np.random.default_rng(1)
    parts = [part_of(np.zeros((N, 3)), UM * np.hypot(12.0, 3.0) * rng.standard_normal((N, 3))) for _ in range(4)]
    between, scatter = scatter_of(parts)
    assert between == pytest.approx(12.0 * UM, rel=0.1)
    assert learning.SCATTER_M < scatter < 12.0 * UM
    state = learned(parts, following())
    np.testing.assert_allclose(state.error_m, np.mean([p.error_m for p in parts], axis=0), atol=1e-12)
    np.testing.assert_allclose(state.sigma_m, np.sqrt((SIGMA**2 + scatter**2) / 4.0), rtol=1e-9)


def test_scatter_is_never_zero() -> None:
    """Neither of one part, nor of parts that are alike by chance."""
    one = part_of(np.zeros((N, 3)), smooth())
    between, scatter = scatter_of([one])
    assert np.isnan(between)
    assert scatter == learning.SCATTER_M
    assert scatter_of([one, one, one])[1] > 0.3 * learning.SCATTER_M


def test_scatter_alone_makes_no_correction_grow() -> None:
    """Twenty parts that differ by chance only: the program wanders no farther than a few of the scatter."""
    rng, ways, spread = np.random.default_rng(7), following(), 10.0 * UM
    worst = []
    for _ in range(3):
        taken, parts, sizes = np.zeros((N, 3)), [], []
        for _ in range(20):
            parts.append(part_of(taken, spread * rng.standard_normal(3) - taken))
            step = learned(parts, ways).best_step(ways)
            taken = taken + (step if np.max(np.abs(step)) > LEAST else 0.0)
            sizes.append(np.max(np.abs(taken)))
        worst.append([max(sizes[:10]), max(sizes[10:])])
    assert np.max(worst) < 3.5 * spread
    assert np.mean(worst, axis=0)[1] < 1.2 * np.mean(worst, axis=0)[0]


def test_an_axis_is_corrected_by_its_own_error_and_in_its_own_direction() -> None:
    """A tool 50 um too far along +y of the part: 50 um are taken back along +y, nothing along x and z."""
    error = np.tile([0.0, 50.0 * UM, 0.0], (N, 1))
    ways = following()
    step = learned([part_of(np.zeros((N, 3)), error)], ways).best_step(ways)
    np.testing.assert_allclose(step[:, 1], 50.0 * UM, rtol=0.02)
    np.testing.assert_array_equal(step[:, [0, 2]], 0.0)


def test_parts_of_other_programs_are_refused() -> None:
    few = np.zeros((5, 3))
    short = MeasuredError(few, few, few, np.ones((5, 3), dtype=np.bool_))
    with pytest.raises(InputError, match="different lengths"):
        learned([part_of(np.zeros((N, 3)), smooth()), short], following())
    with pytest.raises(InputError, match="no part"):
        learned([], following())
