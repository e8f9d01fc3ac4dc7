"""Loops of a trochoid: the closed form of their engagement, the step found against a fine scan, their way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.plan.strategy.trochoid import immersions, loop_for, pieces


@settings(max_examples=15)
@given(width_mm=st.floats(8.0, 40.0), share=st.floats(0.4, 0.9), angle_deg=st.floats(10.0, 100.0))
def test_the_engagement_reaches_the_angle_and_no_more(width_mm: float, share: float, angle_deg: float) -> None:
    loop = loop_for(width_mm * MM, 0.5 * share * width_mm * MM, angle_deg * DEG)
    assert loop.engagement_rad == pytest.approx(angle_deg * DEG, abs=1e-6)
    assert 0.0 < loop.mean_rad < loop.engagement_rad
    assert loop.radius_m == pytest.approx(0.5 * (1.0 - share) * width_mm * MM)


@pytest.mark.parametrize("theta_deg", [-90.0, -30.0, 0.0, 45.0])
def test_an_immersion_is_where_the_tool_meets_the_stock(theta_deg: float) -> None:
    """Points around the tool, looked up one by one in the stock that the last loop left."""
    width, r, step = 10 * MM, 3 * MM, 0.5 * MM
    theta = theta_deg * DEG
    rho = 0.5 * width - r
    centre = rho * np.array([math.cos(theta), math.sin(theta)])
    beta = np.linspace(0.0, math.pi, 200_001)
    around = centre[:, None] + r * np.array([np.cos(theta + beta), np.sin(theta + beta)])
    in_stock = np.hypot(around[0] + step, around[1]) > 0.5 * width
    scanned = float(beta[in_stock].max())
    row = round((theta_deg + 90.0) / 0.25)
    assert immersions(width, r, step)[row] == pytest.approx(scanned, abs=1e-4)


@pytest.mark.parametrize("up", [True, False])
def test_loops_stay_between_the_walls_and_lead_to_the_end(up: bool) -> None:
    start, end = np.array([1.0, 2.0]) * MM, np.array([31.0, 42.0]) * MM
    loop = loop_for(16 * MM, 5 * MM, 40 * DEG)
    way = pieces(start, end, loop, up=up)
    assert way[-1].end == pytest.approx(end)
    x = (end - start) / np.linalg.norm(end - start)
    left = np.array([-x[1], x[0]])
    for piece in way[:-1]:
        assert abs(float((piece.end - start) @ left)) == pytest.approx(loop.radius_m)
        if piece.centre is not None:
            assert np.linalg.norm(piece.end - piece.centre) == pytest.approx(loop.radius_m)
            assert abs(float((piece.centre - start) @ left)) < 1e-12
    side = float((way[0].end - start) @ left)
    assert (side > 0.0) == up  # clockwise from the left wall leads ahead


def test_a_tool_as_wide_as_the_slot_has_no_room() -> None:
    with pytest.raises(InputError, match=r"too wide for loops.*smaller tool"):
        loop_for(10 * MM, 5 * MM, 40 * DEG)
    with pytest.raises(InputError, match="out of range"):
        loop_for(10 * MM, 3 * MM, 130 * DEG)
