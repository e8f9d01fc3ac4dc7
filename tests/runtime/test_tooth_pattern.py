"""Pattern of the force over a turn: unchanged by scale, angle and run-out, changed by a lost tooth; closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.records import Record, records
from counterflex.runtime.monitoring.records import HARMONICS, MEMORY
from counterflex.runtime.monitoring.spindle_lines import NOTCH_S, set_lines
from counterflex.runtime.monitoring.tooth_pattern import KNOWN, MIXED_S, compare_pattern, see_lines

TURN, CYCLE_S = 0.2167, 4e-3
RADIUS = np.array([1.2, 0.9, 1.0])
whole = st.floats(0.3, 3.0)


def lines_of(teeth: Float, scale: float = 1.0, angle: float = 0.0) -> Float:
    """Cosine and sine amplitudes, along one axis, of teeth whose pulses have equal lines and these sizes."""
    orders = order_of(len(teeth))
    phasor = np.exp(-2j * np.pi * np.outer(orders, np.arange(len(teeth))) / len(teeth)) @ teeth
    phasor = scale * phasor * np.exp(1j * orders * angle)
    out = np.zeros((3, 2 * HARMONICS))
    out[1, ::2], out[1, 1::2] = phasor.real, -phasor.imag
    return out


def order_of(teeth: int) -> Float:
    d = records(MEMORY)[0].samples
    set_lines(d, TURN, teeth, 1e-3)
    out: Float = np.array(d.order)
    return out


def known(teeth: Float) -> Record:
    """Samples whose pattern was averaged over the steady cut, every line followed, no high-pass."""
    d: Record = records(MEMORY)[0].samples
    set_lines(d, TURN, len(teeth), 1e-3)
    d.active[:] = d.gain[:] = d.seen[:] = 1.0
    d.lines[:] = lines_of(teeth)
    for _ in range(round(KNOWN) + 1):
        compare_pattern(d, True, True, 1.0, CYCLE_S)
    return d


def change(d: Record, lines: Float) -> float:
    d.lines[:] = lines
    return float(compare_pattern(d, True, False, 1.0, CYCLE_S))


def rise(d: Record, lines: Float, scale: float) -> float:
    """Change where phases are exchanged: of amplitudes alone."""
    d.mixed[:] = MIXED_S
    d.lines[:] = lines
    return float(compare_pattern(d, True, False, scale, CYCLE_S))


@settings(max_examples=30, deadline=None)
@given(whole, st.floats(-np.pi, np.pi))
def test_scale_and_angle_are_no_change(scale: float, angle: float) -> None:
    """Thinner stock, or a spindle whose angle was lost in a gap."""
    d = known(RADIUS)
    compare_pattern(d, False, False, 1.0, CYCLE_S)  # a gap
    for _ in range(20):
        found = change(d, lines_of(RADIUS, scale, angle))
    assert found < 1e-3 * scale * np.linalg.norm(lines_of(RADIUS))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2), st.floats(-np.pi, np.pi))
def test_a_lost_tooth_is_a_change_behind_a_gap_too(lost: int, angle: float) -> None:
    """The next tooth takes twice the chip: by 2^0.75. Of the tooth passing, at least a quarter."""
    d = known(RADIUS)
    compare_pattern(d, False, False, 1.0, CYCLE_S)
    teeth = RADIUS.copy()
    teeth[(lost + 1) % 3] *= 2.0**0.75
    teeth[lost] = 0.0
    after = lines_of(teeth, 1.0, angle)
    tooth = np.linalg.norm(after[:, np.repeat(order_of(3) % 3 == 0, 2)])
    assert change(d, after) > 0.25 * tooth


@settings(max_examples=30, deadline=None)
@given(whole, st.lists(st.floats(-np.pi, np.pi), min_size=HARMONICS, max_size=HARMONICS))
def test_exchanged_phases_are_no_change_where_lines_meet(scale: float, phases: list[float]) -> None:
    lines = lines_of(RADIUS, scale)
    turned = (lines[1, ::2] - 1j * lines[1, 1::2]) * np.exp(1j * np.array(phases))
    lines[1, ::2], lines[1, 1::2] = turned.real, -turned.imag
    assert rise(known(RADIUS), lines, scale) < 1e-6 * scale * np.linalg.norm(lines_of(RADIUS))


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_lost_tooth_raises_what_lines_that_meet_hold_together(lost: int) -> None:
    """The rise is that of the amplitude of all lines between, from the scaled past: in closed form."""
    teeth = RADIUS.copy()
    teeth[(lost + 1) % 3] *= 2.0**0.75
    teeth[lost] = 0.0
    between, scale = np.repeat(order_of(3) % 3 != 0, 2), 0.9
    past, now = (float(np.linalg.norm(lines_of(each)[:, between])) for each in (RADIUS, teeth))
    assert rise(known(RADIUS), lines_of(teeth), scale) == pytest.approx(now - scale * past, rel=1e-9)
    assert now - scale * past > 0.25 * np.linalg.norm(lines_of(teeth)[:, ~between])


@pytest.mark.parametrize(("rpm", "mixed"), [(10_000.0, True), (13_000.0, False)])
def test_phases_are_not_taken_for_their_own_at_fractions_of_the_sampling_rate(rpm: float, mixed: bool) -> None:
    """10 000 rpm: six samples a turn, orders 1, 5 and 7 lie within 4 Hz, and for a time after the speed parts them."""
    d = records(MEMORY)[0].samples
    turn = rpm / 60.0 * 1e-3
    set_lines(d, turn, 3, 1e-3)
    d.active[:] = 1.0
    for slip, cycles in ((-0.003, 50), (-0.008, 50)):
        turns = turn * (1.0 + slip) * d.order
        d.place[:] = np.abs(turns - np.round(turns))
        for _ in range(cycles):
            see_lines(d, 4)
    assert bool(d.mixed[np.flatnonzero(d.order == 1.0)[0]] > 0.0) == mixed


def test_nothing_is_known_before_the_pattern_and_without_a_steady_cut() -> None:
    d = records(MEMORY)[0].samples
    set_lines(d, TURN, 3, 1e-3)
    d.active[:] = d.gain[:] = d.seen[:] = 1.0
    d.lines[:] = lines_of(RADIUS)
    assert compare_pattern(d, True, True, 1.0, CYCLE_S) == -1.0
    assert compare_pattern(known(RADIUS), False, False, 1.0, CYCLE_S) == -1.0


def test_a_pattern_most_of_which_is_hidden_is_not_compared() -> None:
    """Lines that come near others take no part; without the strong ones the angle is uncertain."""
    d = known(RADIUS)
    between = np.flatnonzero(order_of(3) % 3 != 0)
    d.seen[between[: len(between) // 2]] = 0.0
    assert change(d, lines_of(RADIUS)) == -1.0


@pytest.mark.parametrize(("slip", "clear"), [(-0.004, True), (-0.0083, False)])
def test_lines_count_by_the_present_speed(slip: float, clear: bool) -> None:
    """11 000 rpm, three teeth: order 8 lies 17 Hz from the tooth passing as commanded, on it 0.83 % slower."""
    d = records(MEMORY)[0].samples
    turn = 11_000.0 / 60.0 * 1e-3
    set_lines(d, turn, 3, 1e-3)
    d.active[:], d.slip = 1.0, slip
    turns = turn * (1.0 + slip) * d.order
    d.place[:] = np.abs(turns - np.round(turns))
    see_lines(d, round(4.0 * NOTCH_S / 1e-3))
    assert bool(d.seen[np.flatnonzero(d.order == 8.0)[0]] > 0.5) == clear
