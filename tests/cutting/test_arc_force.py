"""Mean force over an arc: against the booked engagement, single teeth, quadrature, and its own derivatives."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad
from scipy.special import gamma

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import MM, N_PER_MM, UM
from counterflex.cutting.arc_force import ArcCuts, TermForce, mean_thickness
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.mean_force import mean_force_weights, mean_wrenches
from counterflex.cutting.tooth_force import tooth_forces

FLAT = Cutter(16.0 * MM, flutes=3, flute_length_m=35.0 * MM)
BALL = Cutter(10.0 * MM, corner_radius_m=5.0 * MM, flutes=2, flute_length_m=25.0 * MM)
BULL = Cutter(16.0 * MM, corner_radius_m=2.0 * MM, flutes=4, flute_length_m=30.0 * MM)
LAW = KienzleLaw(
    800e6, 0.25, 300e6, 0.4, 110e6, 0.1, MM, UM, MM, "test", "test", (2 * N_PER_MM, 1.5 * N_PER_MM, 0.3 * N_PER_MM)
)
LINEAR = LinearEdgeLaw(
    800e6, 300e6, 100e6, 14 * N_PER_MM, 11 * N_PER_MM, 1 * N_PER_MM, UM, MM, source="test", status="test"
)


def one(cutter: Cutter, depth: float, entry: float, leave: float, feed: float, drop: float = 0.0) -> ArcCuts:
    return ArcCuts(cutter, *(np.array([v]) for v in (depth, entry, leave, feed, drop)))


def force(cuts: ArcCuts, law: ForceLaw) -> Float:
    out = np.zeros((len(cuts), 3))
    for p, *k in law.terms():
        out += TermForce.of(cuts, float(p)).value @ np.array(k)
    return out


@pytest.mark.parametrize("cutter", [FLAT, BALL, BULL])
@pytest.mark.parametrize("law", [LAW, LINEAR])
def test_slot_is_that_of_booked_engagement(cutter: Cutter, law: ForceLaw) -> None:
    booked = mean_wrenches(mean_force_weights(cutter, law), engagement_of_arc(cutter, 3 * MM, 0.0, math.pi), 40 * UM)
    ours = force(one(cutter, 3 * MM, 0.0, math.pi, 40 * UM), law)[0]
    np.testing.assert_allclose(ours, booked[:3], rtol=2e-6)


@settings(max_examples=40, deadline=None)
@given(
    first=st.integers(0, 60),
    span=st.integers(3, 64),
    depth=st.floats(0.3, 12.0),
    feed=st.floats(2.0, 150.0),
    ball=st.booleans(),
)
def test_any_arc_of_whole_bins_is_that_of_booked_engagement(
    first: int, span: int, depth: float, feed: float, ball: bool
) -> None:
    cutter = BALL if ball else FLAT
    entry, leave = first * math.pi / 64, min(first + span, 64) * math.pi / 64
    booked = mean_wrenches(
        mean_force_weights(cutter, LAW), engagement_of_arc(cutter, depth * MM, entry, leave), feed * UM
    )[:3]
    ours = force(one(cutter, depth * MM, entry, leave, feed * UM), LAW)[0]
    np.testing.assert_allclose(ours, booked, rtol=1e-5, atol=1e-6 * float(np.linalg.norm(booked)))


def test_slot_has_berger_closed_form() -> None:
    m, k, depth, feed = 0.274, 776e6, 2 * MM, 30 * UM
    p = 1.0 - m
    value = TermForce.of(one(FLAT, depth, 0.0, math.pi, feed), p).value[0] * k * MM**m
    left = FLAT.flutes * depth / (2 * math.pi) * k * MM**m * feed**p
    left *= math.sqrt(math.pi) * gamma((3 - m) / 2) / gamma(2 - m / 2)
    assert value[1, 0] == pytest.approx(left, rel=1e-9)
    assert value[0, 1] == pytest.approx(-left, rel=1e-9)


def test_mean_over_the_single_teeth() -> None:
    teeth = tooth_forces(FLAT, LAW, engagement_of_arc(FLAT, 4 * MM, 0.0, math.pi / 2), 40 * UM, trochoid=False)
    ours = force(one(FLAT, 4 * MM, 0.0, math.pi / 2, 40 * UM), LAW)[0]
    np.testing.assert_allclose(ours, teeth.mean[:3], atol=2e-3 * float(np.linalg.norm(ours)))


@pytest.mark.parametrize("cutter", [FLAT, BALL, BULL])
@pytest.mark.parametrize("feed_um", [8.0, 40.0])
def test_runout_is_that_of_the_single_teeth(cutter: Cutter, feed_um: float) -> None:
    """Booked engagement and closed arc against teeth with helix, whose first edge stands anywhere to the offset."""
    off = replace(cutter, runout_m=6 * UM)
    booked, feed = engagement_of_arc(cutter, 4 * MM, 0.3, 2.5), feed_um * UM
    turned = [replace(off, runout_angle_rad=k * math.pi / 6) for k in range(12)]
    teeth = np.mean([tooth_forces(c, LAW, booked, feed, trochoid=False, steps=384).mean for c in turned], axis=0)
    even = tooth_forces(cutter, LAW, booked, feed, trochoid=False, steps=384).mean
    assert np.linalg.norm(teeth[:3] - even[:3]) > (0.04 if feed_um == 8.0 else 0.002) * np.linalg.norm(even[:3])
    ours = mean_wrenches(mean_force_weights(off, LAW), booked, feed)
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(ours[part], teeth[part], atol=2e-3 * float(np.linalg.norm(teeth[part])))
    arc = force(one(off, 4 * MM, 0.3, 2.5, feed), LAW)[0]
    np.testing.assert_allclose(arc, teeth[:3], atol=4e-3 * float(np.linalg.norm(arc)))


@pytest.mark.parametrize("p", [0.1, 0.7, 1.0])
def test_integrals_and_their_derivative_by_the_exponent_against_quadrature(p: float) -> None:
    entry, leave, depth, feed = 0.0, 2.2, 2 * MM, 40 * UM
    found = TermForce.of(one(FLAT, depth, entry, leave, feed), p)
    unit = FLAT.flutes * depth / (2 * math.pi)
    fine: dict[str, Any] = {"epsabs": 0.0, "epsrel": 1e-11, "limit": 200}
    left = quad(lambda t: unit * (feed * math.sin(t)) ** p * math.sin(t), entry, leave, **fine)[0]
    slope = quad(
        lambda t: unit * (feed * math.sin(t)) ** p * math.log(feed * math.sin(t)) * math.sin(t) if t > 0 else 0.0,
        entry,
        leave,
        **fine,
    )[0]
    assert found.value[0, 1, 0] == pytest.approx(left, rel=1e-8)
    assert found.by_exponent[0, 1, 0] == pytest.approx(slope, rel=1e-7)


@pytest.mark.parametrize("cutter", [FLAT, BALL, BULL, replace(BULL, runout_m=5 * UM)])
def test_derivatives_are_approached_with_the_square_of_the_step(cutter: Cutter) -> None:
    drop = 0.5 * UM if cutter.is_flat else 0.0
    base = (1.3 * MM, 0.4, 2.5, 30 * UM, drop)
    found = TermForce.of(one(cutter, *base), 0.72)
    for name, place, step in (("by_depth", 0, 0.05 * MM), ("by_entry", 1, 0.05), ("by_exit", 2, 0.05)):
        errors = []
        for h in (step, 0.5 * step):
            up, down = list(base), list(base)
            up[place] += h
            down[place] -= h
            change = TermForce.of(one(cutter, *up), 0.72).value - TermForce.of(one(cutter, *down), 0.72).value
            errors.append(float(np.max(np.abs(change / (2 * h) - getattr(found, name)))))
        assert errors[1] < 0.3 * errors[0] or errors[1] < 1e-7 * float(np.max(np.abs(getattr(found, name)))), name
    change = TermForce.of(one(cutter, *base), 0.7201).value - TermForce.of(one(cutter, *base), 0.7199).value
    np.testing.assert_allclose(change / 2e-4, found.by_exponent, rtol=2e-6, atol=1e-7 * np.abs(change).max() / 2e-4)


def test_sinking_end_face_pushes_up_by_its_share_of_the_disc() -> None:
    weights = mean_force_weights(FLAT, LAW)
    disc = math.pi * FLAT.radius_m**2
    for leave, share in ((math.pi, 1.0), (math.pi / 2, 0.5)):
        booked = mean_wrenches(weights, engagement_of_arc(FLAT, 3 * MM, 0.0, leave), 40 * UM, 2 * UM, share * disc)
        ours = force(one(FLAT, 3 * MM, 0.0, leave, 40 * UM, 2 * UM), LAW)[0]
        np.testing.assert_allclose(ours, booked[:3], rtol=1e-6)
    rising = force(one(FLAT, 3 * MM, 0.0, math.pi, 40 * UM, -2 * UM), LAW)
    np.testing.assert_allclose(rising, force(one(FLAT, 3 * MM, 0.0, math.pi, 40 * UM), LAW))


def test_mean_thickness_of_a_slot_and_of_a_quarter() -> None:
    assert mean_thickness(one(FLAT, MM, 0.0, math.pi, 50 * UM))[0] == pytest.approx(100 * UM / math.pi)
    assert mean_thickness(one(FLAT, MM, 0.0, math.pi / 3, 50 * UM))[0] == pytest.approx(25 * UM / (math.pi / 3))


def test_refuses_what_it_cannot_do() -> None:
    with pytest.raises(InputError, match="negative"):
        one(FLAT, -MM, 0.0, 1.0, UM)
    with pytest.raises(InputError, match="feed per tooth"):
        one(FLAT, MM, 0.0, 1.0, 0.0)
    with pytest.raises(InputError, match="arc of engagement"):
        one(FLAT, MM, 2.0, 1.0, UM)
    with pytest.raises(ModelError, match="rounded cutter"):
        one(BALL, MM, 0.0, 1.0, UM, UM)
    with pytest.raises(InputError, match="exponent"):
        TermForce.of(one(FLAT, MM, 0.0, 1.0, UM), -0.1)
