"""ISO 230-4 and straightness against closed forms and cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.iso230.circular_test import (
    BiDirectional,
    Circle,
    Turn,
    fitted_circle,
    least_squares_circle,
    turns,
)
from counterflex.evaluate.iso230.straightness import Straightness, narrowest_cylinder, parallel_lines
from counterflex.geometry import rotation

R = 50.0 * MM
ANGLE = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)


def ring(r: Float, direction: str = "ccw", angle: Float = ANGLE) -> Turn:
    sense = 1.0 if direction == "ccw" else -1.0
    return Turn(direction, np.column_stack([r * np.cos(angle), sense * r * np.sin(angle)]), 0.0)


def test_two_lobes() -> None:
    """Radius R + 20 + 10 cos 2a um: G = 20 (both methods), F from +10 to +30."""
    f = ring(R + (20.0 + 10.0 * np.cos(2.0 * ANGLE)) * UM).figures(R, nominal_centre=True)
    assert [f.g_m, f.g_lsc_m] == pytest.approx([20.0 * UM] * 2, abs=1e-9)
    assert [f.f_max_m, f.f_min_m] == pytest.approx([30.0 * UM, 10.0 * UM], abs=1e-9)


def test_minimum_zone_is_below_least_squares() -> None:
    """A bump of 10 um over 20 deg pulls the least-squares centre, not the narrowest ring."""
    bump = np.where(np.abs(ANGLE - np.pi) < 10.0 * DEG, 10.0 * UM, 0.0)
    f = ring(R + bump).figures(R, nominal_centre=False)
    assert f.g_m < f.g_lsc_m
    assert f.f_nominal_max_m is None
    assert 5.0 * UM - 1e-9 <= f.g_m <= 10.0 * UM


def test_eccentric_circle_has_no_deviation_about_its_own_centre() -> None:
    """Off by 30 um in x: G = 0; F about the nominal centre is +-30, about the least-squares centre 0."""
    turn = ring(np.full(3600, R))
    moved = Turn("ccw", turn.points + np.array([30.0 * UM, 0.0]), 0.0)
    f = moved.figures(R, nominal_centre=True)
    assert [f.g_m, f.f_max_m, f.f_nominal_max_m, f.f_nominal_min_m] == pytest.approx(
        [0.0, 0.0, 30.0 * UM, -30.0 * UM], abs=1e-9
    )
    assert f.centre_m == pytest.approx((30.0 * UM, 0.0), abs=1e-10)


def test_both_directions() -> None:
    """Radii R + 12 and R - 4 um: each round (G = 0), G(b) = 16, D = (12 - 4) / 2 = 4, H = 16."""
    f = BiDirectional.of(ring(np.full(3600, R - 4.0 * UM), "cw"), ring(np.full(3600, R + 12.0 * UM)), R)
    assert [f.g_b_m, f.g_b_lsc_m, f.d_m, f.h_m] == pytest.approx([16 * UM, 16 * UM, 4 * UM, 16 * UM], abs=1e-9)


def test_turns_of_a_log_in_any_plane() -> None:
    """A turn and a half each way, run-in, reversal and a visit to the middle: one whole turn each way is found."""
    tilt = rotation.exp(np.array([0.4, 0.7, 0.1]))
    out = np.linspace(0.0, 3.0 * np.pi, 6000)
    angle = np.concatenate([out, out[::-1]])
    flat = np.column_stack([R * np.cos(angle), R * np.sin(angle), 0.0 * angle])
    middle = np.linspace(flat[-1], np.zeros(3), 500)
    p = np.concatenate([np.linspace(1.5 * flat[0], flat[0], 300), flat, middle]) @ tilt.T + [0.3, 0.1, 0.2]
    circle = fitted_circle(flat @ tilt.T + [0.3, 0.1, 0.2])
    assert circle.radius_m == pytest.approx(R, rel=1e-9)
    found = turns(p, circle)
    assert [turn.direction for turn in found] == ["ccw", "cw"]
    for turn in found:
        swept = np.unwrap(np.arctan2(turn.points[:, 1], turn.points[:, 0]))
        assert abs(swept[-1] - swept[0]) == pytest.approx(2.0 * np.pi, abs=0.01)
        assert turn.axial_m < 1e-9
    with pytest.raises(InputError, match="no whole turn"):
        turns(p[:3000], circle)


def test_least_squares_circle_is_the_least() -> None:
    rng = np.random.default_rng(2)
    points = ring(R + 20.0 * UM * rng.standard_normal(3600)).points
    c, _ = least_squares_circle(points)

    def left(at: Float) -> float:
        return float(np.var(np.linalg.norm(points - at, axis=1)))

    assert all(left(c) < left(c + 1e-7 * np.array([np.cos(a), np.sin(a)])) for a in np.arange(8) * np.pi / 4)


def test_straightness_by_hand() -> None:
    """Heights 0, 0, 0, 3 at 0..3. Along y = x: 2, the least. The line -0.6 + 0.9 x leaves -1.2 to 0.9: range 2.1."""
    x = np.arange(4.0) * 10.0 * MM
    y = np.array([0.0, 0.0, 0.0, 3.0]) * UM
    assert parallel_lines(x, y) == pytest.approx(2.0 * UM)
    s = Straightness.of(np.column_stack([x, y, 0.0 * x]))
    assert [s.horizontal_m, s.horizontal_ls_m, s.vertical_m] == pytest.approx([2.0 * UM, 2.1 * UM, 0.0], abs=1e-11)
    assert s.cylinder_m == pytest.approx(2.0 * UM, rel=1e-6)
    assert s.length_m == pytest.approx(30.0 * MM, rel=1e-6)


def test_helix_fills_a_cylinder() -> None:
    """Ten turns of radius 5 um: diameter 10 um in space, 10 um from the side and from above."""
    a = np.linspace(0.0, 20.0 * np.pi, 4001)
    x, yz = a * MM, 5.0 * UM * np.column_stack([np.cos(a), np.sin(a)])
    assert narrowest_cylinder(x, yz) == pytest.approx(10.0 * UM, rel=2e-3)
    assert parallel_lines(x, yz[:, 0]) == pytest.approx(10.0 * UM, rel=2e-3)


def test_minimum_zone_bounds() -> None:
    """Never above least squares; the cylinder between the wider plane and both together; the same in any frame."""
    rng = np.random.default_rng(6)
    for _ in range(4):
        p = np.column_stack([np.sort(rng.uniform(0.0, 0.2, 60)), *(20.0 * UM * rng.standard_normal((2, 60)))])
        s = Straightness.of(p)
        assert s.horizontal_m <= s.horizontal_ls_m + 1e-12
        assert s.vertical_m <= s.vertical_ls_m + 1e-12
        assert s.cylinder_m <= s.cylinder_ls_m + 1e-12
        assert max(s.horizontal_m, s.vertical_m) * (1.0 - 1e-6) <= s.cylinder_m
        assert s.cylinder_m <= np.hypot(s.horizontal_m, s.vertical_m) * (1.0 + 1e-6)
        moved = Straightness.of(p @ rotation.about_z(0.7).T + [1.0, 2.0, 3.0])
        assert [moved.horizontal_m, moved.vertical_m, moved.cylinder_m] == pytest.approx(
            [s.horizontal_m, s.vertical_m, s.cylinder_m], rel=1e-5
        )
    with pytest.raises(InputError, match="no line"):
        Straightness.of(rng.standard_normal((20, 3)))


def test_circle_axes_are_right_handed() -> None:
    for normal in np.concatenate([np.eye(3), -np.eye(3)]):
        axes = Circle(np.zeros(3), normal, R).axes
        assert np.cross(axes[0], axes[1]) == pytest.approx(normal)


def test_a_straight_line_far_off_is_straight() -> None:
    """A metre aside, rounding is all that is left of the spread."""
    x = np.linspace(0.0, 20.0 * MM, 200)
    y = 1.0 + 2e-16 * np.resize([0.0, 1.0, 0.0], 200)
    assert parallel_lines(x, y) <= 1e-15
    assert narrowest_cylinder(x, np.column_stack([y, y])) <= 1e-15


def test_a_straight_line_read_in_whole_micrometres_has_the_cylinder_of_their_corners() -> None:
    """Hundreds of points all but touch it: it is found all the same, and in any frame."""
    x = np.linspace(0.0, 0.2, 2000)
    across = np.column_stack([0.03 * x, 0.05 * x])
    p = np.column_stack([x, np.round(across, 6)])
    found = [Straightness.of(q).cylinder_m for q in (p, p @ rotation.about_x(0.7).T)]
    assert 0.9 * UM < found[0] < np.sqrt(2.0) * UM
    assert found[1] == pytest.approx(found[0], rel=1e-5)
