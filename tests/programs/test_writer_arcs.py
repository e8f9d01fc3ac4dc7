"""Arc fitting against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.programs.gcode.write.arc_fit import (
    arc_error,
    arc_points,
    fit_centre,
    radii_agree,
    radius_centre,
    written_turn,
)
from counterflex.programs.gcode.write.arc_pieces import arc_pieces


def helix(centre: tuple[float, float], radius: float, start: float, turn: float, rise: float, n: int) -> Float:
    share = np.linspace(0.0, 1.0, n)
    angle = start + turn * share
    return np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), rise * share], axis=1)


@settings(max_examples=80, deadline=None)
@given(
    u=st.floats(-1.0, 1.0),
    v=st.floats(-1.0, 1.0),
    radius=st.floats(1e-3, 0.5),
    start=st.floats(-3.1, 3.1),
    turn=st.floats(0.05, 6.2),
    left=st.booleans(),
    rise=st.floats(-0.01, 0.01),
)
def test_exact_arcs_are_found(
    u: float, v: float, radius: float, start: float, turn: float, left: bool, rise: float
) -> None:
    turn = turn if left else -turn
    points = helix((u, v), radius, start, turn, rise, 40)
    centre = fit_centre(points, turn)
    assert math.hypot(centre[0] - u, centre[1] - v) < 1e-9
    assert arc_error(points, np.linspace(0.0, 1.0, 40), centre, turn) < 1e-9
    sense = 1.0 if left else -1.0
    assert written_turn(points[0], points[-1], centre, sense, 1) == pytest.approx(turn, abs=1e-7)
    by_radius = radius_centre(points[0], points[-1], math.copysign(radius, math.pi - abs(turn)), sense)
    if by_radius is not None and abs(abs(turn) - math.pi) > 0.1 and 0.2 < abs(turn) < 6.0:
        assert math.hypot(by_radius[0] - u, by_radius[1] - v) < 1e-8 * max(1.0, 1.0 / radius)


def test_full_turn_and_several_turns() -> None:
    points = helix((0.1, -0.2), 0.02, 0.3, 2.0 * math.pi, -0.003, 60)
    centre = fit_centre(points, 2.0 * math.pi)
    assert centre == pytest.approx((0.1, -0.2), abs=1e-12)
    assert written_turn(points[0], points[0], centre, 1.0, 1) == pytest.approx(2.0 * math.pi)
    assert written_turn(points[0], points[0], centre, -1.0, 3) == pytest.approx(-6.0 * math.pi)


def test_two_points_use_the_nominal_turn() -> None:
    points = helix((0.0, 0.0), 0.05, 0.0, -1.2, 0.0, 2)
    assert fit_centre(points, -1.2) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_spiral_is_followed_linearly() -> None:
    start, end = np.array([0.01, 0.0, 0.0]), np.array([0.0, 0.0102, 0.001])
    middle = arc_points(start, end, (0.0, 0.0), 0.5 * math.pi, np.array([0.5]))[0]
    assert math.hypot(middle[0], middle[1]) == pytest.approx(0.0101)
    assert middle[2] == pytest.approx(0.0005)


@pytest.mark.parametrize(
    ("radius", "gap", "good"),
    [(1e-3, 4e-6, True), (1e-3, 6e-6, False), (0.1, 9e-5, True), (0.1, 1.1e-4, False), (10.0, 6e-4, False)],
)
def test_linuxcnc_radius_rule(radius: float, gap: float, good: bool) -> None:
    start, end = np.array([radius, 0.0]), np.array([0.0, radius + gap])
    assert radii_agree(start, end, (0.0, 0.0)) is good


def test_pieces_keep_one_arc_split_a_bent_one_and_give_up_on_noise() -> None:
    share = np.linspace(0.0, 1.0, 201)
    points = helix((0.0, 0.0), 0.03, 0.0, 2.0, 0.0, 201)
    whole = arc_pieces(points, share, 2.0, 1e-6)
    assert len(whole) == 1
    assert whole[0].centre == pytest.approx((0.0, 0.0), abs=1e-9)
    bent = points.copy()
    bent[:, 2] = 2e-5 * np.sin(6.0 * share)
    pieces = arc_pieces(bent, share, 2.0, 2e-6)
    assert 1 < len(pieces) < 20
    assert all(piece.centre is not None for piece in pieces)
    assert [piece.first for piece in pieces[1:]] == [piece.last for piece in pieces[:-1]]
    assert (pieces[0].first, pieces[-1].last) == (0, 200)
    noisy = points + np.random.default_rng(1).normal(0.0, 1e-4, points.shape)
    assert all(piece.centre is None for piece in arc_pieces(noisy, share, 2.0, 1e-6))
