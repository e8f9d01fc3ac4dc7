"""Pattern of the force over a turn: unchanged by scale, angle and run-out, changed by a lost tooth; closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from counterflex.core.arrays import Float
from counterflex.core.records import Record, records
from counterflex.runtime.monitoring.records import HARMONICS, MEMORY
from counterflex.runtime.monitoring.spindle_lines import NOTCH_S, set_lines
from counterflex.runtime.monitoring.tooth_pattern import KNOWN, compare_pattern, see_lines

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
        compare_pattern(d, True, True, CYCLE_S)
    return d


def change(d: Record, lines: Float) -> float:
    d.lines[:] = lines
    return float(compare_pattern(d, True, False, CYCLE_S))


@settings(max_examples=30, deadline=None)
@given(whole, st.floats(-np.pi, np.pi))
def test_scale_and_angle_are_no_change(scale: float, angle: float) -> None:
    """Thinner stock, or a spindle whose angle was lost in a gap."""
    d = known(RADIUS)
    compare_pattern(d, False, False, CYCLE_S)  # a gap
    for _ in range(20):
        found = change(d, lines_of(RADIUS, scale, angle))
    assert found < 1e-3 * scale * np.linalg.norm(lines_of(RADIUS))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2), st.floats(-np.pi, np.pi))
def test_a_lost_tooth_is_a_change_behind_a_gap_too(lost: int, angle: float) -> None:
    """The next tooth takes twice the chip: by 2^0.75. Of the tooth passing, at least a quarter."""
    d = known(RADIUS)
    compare_pattern(d, False, False, CYCLE_S)
    teeth = RADIUS.copy()
    teeth[(lost + 1) % 3] *= 2.0**0.75
    teeth[lost] = 0.0
    after = lines_of(teeth, 1.0, angle)
    tooth = np.linalg.norm(after[:, np.repeat(order_of(3) % 3 == 0, 2)])
    assert change(d, after) > 0.25 * tooth


def test_nothing_is_known_before_the_pattern_and_without_a_steady_cut() -> None:
    d = records(MEMORY)[0].samples
    set_lines(d, TURN, 3, 1e-3)
    d.active[:] = d.gain[:] = d.seen[:] = 1.0
    d.lines[:] = lines_of(RADIUS)
    assert compare_pattern(d, True, True, CYCLE_S) == -1.0
    assert compare_pattern(known(RADIUS), False, False, CYCLE_S) == -1.0


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
