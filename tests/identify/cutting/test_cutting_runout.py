"""Runout from records that show single teeth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.core.units import MM, RPM, UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.identify.cutting.considered import TurnForce, fast_enough, runout, turn_amplitude

CUTTER = Cutter(16.0 * MM, flutes=3, flute_length_m=35.0 * MM)
LAW = KienzleLaw(780e6, 0.25, 273e6, 0.25, 117e6, 0.25, MM, UM, MM, "test", "test", (2e3, 2e3, 0.0))
SPEED = 6000.0 * RPM


def record(runout_m: float, feed_m: float, seed: int, rate_hz: float = 10_000.0) -> TurnForce:
    """A piece of a slot sampled at a rate that is no multiple of the turn, with noise and true edge paths."""
    worn = replace(CUTTER, runout_m=runout_m, runout_angle_rad=0.7)
    depth = engagement_of_arc(CUTTER, 2.0 * MM, 0.0, math.pi)
    teeth = tooth_forces(worn, LAW, depth, feed_m, trochoid=True)
    time = np.arange(int(0.2 * rate_hz)) / rate_hz
    angle = (SPEED * time + 0.3) % (2.0 * math.pi)
    force = np.stack([np.interp(angle, teeth.angle_rad, teeth.wrench_tcp[:, c], period=2 * math.pi) for c in (0, 1)], 1)
    force += 5.0 * np.random.default_rng(seed).standard_normal(force.shape)
    return TurnForce(turn_amplitude(force, time, SPEED, 3), 2.0 * MM, 0.0, math.pi, feed_m)


@pytest.mark.parametrize("true", [2.0, 5.0, 12.0])
def test_runout_is_recovered(true: float) -> None:
    found = runout([record(true * UM, f * UM, i) for i, f in enumerate((20.0, 40.0, 70.0))], CUTTER, LAW)
    assert found is not None
    assert found.value_m == pytest.approx(true * UM, rel=0.08)
    assert found.pieces == 3


def test_pieces_beyond_any_runout_do_not_draw_the_median_down() -> None:
    """A piece whose force is larger than runout can make it is large; without it the smallest would decide."""
    records = [record(e * UM, 40.0 * UM, i) for i, e in enumerate((2.0, 5.0))]
    beyond = replace(records[0], amplitude_n=1e6)
    found = runout([*records, beyond], CUTTER, LAW)
    assert found is not None
    assert found.value_m == pytest.approx(5.0 * UM, rel=0.08)
    assert runout([records[0], beyond], CUTTER, LAW) is None


def test_no_runout_is_below_a_tenth_of_a_micrometre_of_noise() -> None:
    found = runout([record(0.0, f * UM, i) for i, f in enumerate((20.0, 40.0))], CUTTER, LAW)
    assert found is not None
    assert found.value_m < 0.1 * UM


def test_slow_records_show_nothing() -> None:
    time = np.linspace(0.0, 1.98, 100)
    assert not fast_enough(time, SPEED, 3)
    with pytest.raises(InputError, match="single teeth"):
        turn_amplitude(np.zeros((100, 2)), time, SPEED, 3)
    assert runout([TurnForce(10.0, 2 * MM, 0.0, 3.1, 30 * UM)], replace(CUTTER, flutes=1), LAW) is None
    assert runout([], CUTTER, LAW) is None
