"""Mean force: closed forms of the slot, numerical integration, the plunge, continuity on slopes, energy balance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, N_PER_MM, N_PER_MM2, UM
from counterflex.cutting.arc_integrals import cosine_power_integral, sine_power_integral
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_thickness
from counterflex.cutting.mean_force import N_BINS, MeanForceWeights, mean_force_weights, mean_wrenches
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap

HAEHN_FEED = 25e-3 / (13000 / 60 * 3)
D16 = Cutter(diameter_m=16 * MM, flutes=3, flute_length_m=40 * MM)


def kienzle(mc: float = 0.25, mr: float = 0.25, ma: float = 0.25) -> KienzleLaw:
    return KienzleLaw.from_k11(
        780 * N_PER_MM2,
        mc,
        kr11_pa=0.35 * 780 * N_PER_MM2,
        mr=mr,
        ka11_pa=0.15 * 780 * N_PER_MM2,
        ma=ma,
        h_min_m=0.001 * MM,
        h_max_m=1.0 * MM,
        source="test",
        status="assumed",
    )


def linear_edge() -> LinearEdgeLaw:
    return LinearEdgeLaw(
        767.01 * N_PER_MM2,
        168.8 * N_PER_MM2,
        222 * N_PER_MM2,
        27.7 * N_PER_MM,
        26.6 * N_PER_MM,
        0.7 * N_PER_MM,
        h_min_m=0.01 * MM,
        h_max_m=0.1 * MM,
        source="test",
        status="derived",
    )


def slot(weights: MeanForceWeights, depth_m: float) -> Float:
    depths = np.zeros((weights.n_levels, weights.n_bins))
    depths[-1] = depth_m
    return depths


def test_slot_of_haehn2020_gives_its_547_n() -> None:
    weights = mean_force_weights(D16, kienzle())
    wrench = mean_wrenches(weights, slot(weights, 9.5 * MM), HAEHN_FEED)
    assert np.abs(wrench[:3]) == pytest.approx([178, 508, 100], abs=0.6)
    assert np.linalg.norm(wrench[:3]) == pytest.approx(547, abs=0.5)
    assert wrench[0] < 0.0 < wrench[1]


def test_slot_closed_form_of_kienzle() -> None:
    law = kienzle(0.23, 0.6, 0.1)
    weights = mean_force_weights(D16, law)
    for feed in (0.008 * MM, 0.03 * MM, 0.1 * MM):
        wrench = mean_wrenches(weights, slot(weights, 3 * MM), feed)
        kc, kr, ka = law.k11_pa()

        def closed(k11: float, m: float, power: float, feed: float = feed) -> float:
            gamma = math.sqrt(math.pi) * math.gamma((power + 1) / 2) / math.gamma(power / 2 + 1)
            return float(3 * 3 * MM / (2 * math.pi) * k11 * MM**m * feed ** (1 - m) * gamma)

        expected = [-closed(kr, 0.6, 1.4), closed(kc, 0.23, 1.77), -closed(ka, 0.1, 0.9)]
        np.testing.assert_allclose(wrench[:3], expected, rtol=1e-12)


def test_slot_closed_form_of_linear_edge() -> None:
    law = linear_edge()
    weights = mean_force_weights(D16, law)
    n, a, fz = 3, 2 * MM, 0.05 * MM
    wrench = mean_wrenches(weights, slot(weights, a), fz)
    expected = [
        -n * a / 4 * law.krc_pa * fz - n * a / math.pi * law.kre_n_m,
        n * a / 4 * law.ktc_pa * fz + n * a / math.pi * law.kte_n_m,
        -n * a / math.pi * law.kac_pa * fz - n * a / 2 * law.kae_n_m,
    ]
    np.testing.assert_allclose(wrench[:3], expected, rtol=1e-12)


@pytest.mark.parametrize(("ae_over_d", "factor"), [(1.0, 1.57), (0.5, 1.57), (0.2, 2.32), (0.1, 3.22), (0.05, 4.51)])
def test_mean_thickness_and_what_taking_the_feed_for_it_costs(ae_over_d: float, factor: float) -> None:
    """Berger2013 eq. 1 prints f_z where eq. 2 and 3 need the mean thickness h_m."""
    weights = mean_force_weights(D16, kienzle(), n_bins=2048)
    arc = engagement_of_arc(D16, 3 * MM, 0.0, math.acos(1 - 2 * ae_over_d), 2048)
    found = mean_thickness(weights, arc[None], np.array([0.03 * MM]), np.zeros(1))[0]
    assert 0.03 * MM / found == pytest.approx(factor, abs=0.006)


@pytest.mark.parametrize(("m", "percent"), [(0.23, 3.0), (0.274, 4.0)])
@pytest.mark.parametrize("ae_over_d", [0.05, 0.2, 0.5, 1.0])
def test_force_of_the_mean_thickness_is_a_few_percent_too_high(m: float, percent: float, ae_over_d: float) -> None:
    """k_c(h_m) h_m against the mean of k_c(h) h over the arc (Jensen): 2 to 4.5 %."""
    phi = np.linspace(0.0, math.acos(1 - 2 * ae_over_d), 100_001)
    h = np.sin(phi)
    mean = np.trapezoid(h, phi) / phi[-1]
    exact = np.trapezoid(h ** (1 - m), phi) / phi[-1]
    closed = float(sine_power_integral(1 - m, phi[-1:])[0] / phi[-1])
    assert closed == pytest.approx(exact, rel=1e-6)
    assert 100 * (mean ** (1 - m) / closed - 1) == pytest.approx(percent, abs=1.1)


@pytest.mark.parametrize("law", [kienzle(), kienzle(0.23, 0.6, 0.1), linear_edge()])
def test_stepped_engagement_matches_integration_point_by_point(law: ForceLaw) -> None:
    weights = mean_force_weights(D16, law)
    rng = np.random.default_rng(3)
    depths = rng.uniform(0.0, 5 * MM, (1, N_BINS)) * (rng.random((1, N_BINS)) > 0.3)
    fz, radius, n = 0.04 * MM, 8 * MM, 200_000
    phi = (np.arange(n) + 0.5) * math.pi / n
    depth = depths[0][np.minimum((phi / math.pi * N_BINS).astype(int), N_BINS - 1)]
    edge = law.edge_force(fz * np.sin(phi)) * depth[:, None] * (3 / (2 * math.pi)) * (math.pi / n)
    sin, cos = np.sin(phi), np.cos(phi)
    force = np.stack([-edge[:, 0] * cos - edge[:, 1] * sin, edge[:, 0] * sin - edge[:, 1] * cos, -edge[:, 2]], axis=1)
    arm = np.stack([radius * sin, radius * cos, depth / 2], axis=1)
    expected = np.concatenate([force.sum(axis=0), np.cross(arm, force).sum(axis=0)])
    np.testing.assert_allclose(mean_wrenches(weights, depths, fz), expected, rtol=2e-5, atol=2e-5)


def test_sine_integrals() -> None:
    phi = np.linspace(0.0, math.pi, 33)
    np.testing.assert_allclose(sine_power_integral(0.0, phi), phi, atol=1e-14)
    np.testing.assert_allclose(sine_power_integral(1.0, phi), 1 - np.cos(phi), atol=1e-14)
    np.testing.assert_allclose(sine_power_integral(2.0, phi), phi / 2 - np.sin(2 * phi) / 4, atol=1e-14)
    np.testing.assert_allclose(cosine_power_integral(1.0, phi), np.sin(phi) ** 2 / 2, atol=1e-15)
    with pytest.raises(InputError):
        sine_power_integral(-0.1, phi)


@pytest.mark.parametrize("law", [kienzle(0.23, 0.6, 0.1), linear_edge()])
@pytest.mark.parametrize("corner", [8.0, 3.0])
def test_ball_and_bull_nose_match_integration_over_the_corner(law: ForceLaw, corner: float) -> None:
    """All corner levels engaged from 40 to 140 deg; the truth is a double integral with Altintas' directions."""
    cutter = Cutter(diameter_m=16 * MM, corner_radius_m=corner * MM, flutes=3)
    weights = mean_force_weights(cutter, law)
    edges = np.linspace(0.0, math.pi, N_BINS + 1)
    inside = (edges[:-1] > math.radians(40)) & (edges[1:] < math.radians(140))
    depths = np.zeros((weights.n_levels, N_BINS))
    depths[:-1, inside] = np.diff(cutter.levels())[:-1, None]
    phi0, phi1 = edges[:-1][inside][0], edges[1:][inside][-1]
    n, fz, r = 400, 0.05 * MM, corner * MM
    phi = phi0 + (np.arange(n) + 0.5) * (phi1 - phi0) / n
    kappa = (np.arange(n) + 0.5) * (math.pi / 2) / n
    P, K = np.meshgrid(phi, kappa, indexing="ij")
    sp, cp, sk, ck = np.sin(P), np.cos(P), np.sin(K), np.cos(K)
    weight = 3 / (2 * math.pi) * (phi1 - phi0) / n * r * (math.pi / 2) / n
    fc, fr, fa = np.moveaxis(law.edge_force(fz * sp * sk), -1, 0) * weight
    zero = np.zeros_like(P)
    force = (
        fc[..., None] * np.stack([-cp, sp, zero], -1)
        - fr[..., None] * np.stack([sk * sp, sk * cp, -ck], -1)
        - fa[..., None] * np.stack([ck * sp, ck * cp, sk], -1)
    )
    rho = 8 * MM - r + r * sk
    arm = np.stack([rho * sp, rho * cp, r * (1 - ck)], -1)
    wrench = mean_wrenches(weights, depths, fz)
    np.testing.assert_allclose(wrench[:3], force.sum(axis=(0, 1)), rtol=4e-3, atol=0.02)
    np.testing.assert_allclose(wrench[3:], np.cross(arm, force).sum(axis=(0, 1)), rtol=4e-3, atol=2e-3)


@pytest.mark.parametrize("flutes", [2, 3, 5])
@pytest.mark.parametrize("drop_um", [0.0, 6.0])
def test_runout_on_a_slope_is_that_of_teeth_that_cut_one_behind_the_other(flutes: int, drop_um: float) -> None:
    """Each edge cuts the surface back to where it stands; the feed brings on the surface between two edges."""
    cutter, runout = Cutter(diameter_m=10 * MM, corner_radius_m=5 * MM, flutes=flutes), 8 * UM
    law, feed, drop = kienzle(), 12 * UM, drop_um * UM
    weights = mean_force_weights(cutter, law)
    level, at = weights.n_levels // 2, N_BINS // 3
    depths = np.zeros((weights.n_levels, N_BINS))
    depths[level, at] = 0.2 * np.diff(cutter.levels())[level]
    even, uneven = (
        mean_wrenches(mean_force_weights(c, law), depths, feed, drop)
        for c in (cutter, replace(cutter, runout_m=runout))
    )
    sin_k, cos_k = weights.levels[level, :2]
    chip = feed * weights.arc[0, 3, at] * weights.levels[level, 10] + drop * cos_k
    powers = []
    for alpha in np.linspace(0.0, 2 * math.pi, 90, endpoint=False):
        reach = runout * sin_k * np.cos(alpha + 2 * math.pi * np.arange(flutes) / flutes)
        surface, taken = float(reach.max()), []
        for j in range(6 * flutes):
            surface -= chip
            taken.append(max(0.0, reach[j % flutes] - surface))
            surface = max(surface, reach[j % flutes])
        powers.append(np.mean((np.array(taken[-flutes:]) / chip) ** 0.75))
    np.testing.assert_allclose(uneven, even * np.mean(powers), rtol=3e-3)
    assert np.mean(powers) < 0.99


def test_plunge_of_a_flat_end_mill() -> None:
    """Thrust N k_r f^(1-m) R and torque N k_c f^(1-m) R^2 / 2 of N radial edges that cut with h = f."""
    law = kienzle()
    weights = mean_force_weights(D16, law)
    drop, radius = 0.05 * MM, 8 * MM
    kc, kr, _ = law.k11_pa()
    power = MM**0.25 * drop**0.75
    wrench = mean_wrenches(weights, np.zeros((1, N_BINS)), 0.0, drop, math.pi * radius**2)
    expected = [0, 0, 3 * kr * power * radius, 0, 0, 3 * kc * power * radius**2 / 2]
    np.testing.assert_allclose(wrench, expected, rtol=1e-12, atol=1e-12)


def test_plunge_of_a_ball_matches_integration_over_the_corner() -> None:
    law = kienzle(0.23, 0.6, 0.1)
    cutter = Cutter(diameter_m=10 * MM, corner_radius_m=5 * MM, flutes=2)
    weights = mean_force_weights(cutter, law)
    drop, radius, n = 0.05 * MM, 5 * MM, 20_000
    kappa = (np.arange(n) + 0.5) * (math.pi / 2) / n
    fc, fr, fa = law.edge_force(drop * np.cos(kappa)).T * radius * (math.pi / 2) / n * 2
    wrench = mean_wrenches(weights, np.zeros((weights.n_levels, N_BINS)), 0.0, drop, math.pi * radius**2)
    assert wrench[2] == pytest.approx(float((fr * np.cos(kappa) - fa * np.sin(kappa)).sum()), rel=0.01)
    assert wrench[5] == pytest.approx(float((fc * radius * np.sin(kappa)).sum()), rel=0.01)
    np.testing.assert_allclose(wrench[[0, 1, 3, 4]], 0.0, atol=1e-12)


@pytest.mark.parametrize("corner", [0.0, 3.0, 8.0])
def test_force_is_continuous_from_level_cut_to_plunge(corner: float) -> None:
    cutter = Cutter(diameter_m=16 * MM, corner_radius_m=corner * MM, flutes=3)
    weights = mean_force_weights(cutter, kienzle())
    heights = np.minimum(np.diff(cutter.levels()), 3 * MM)
    depths = np.repeat(heights[:, None], N_BINS, axis=1)
    fz, area = 0.04 * MM, math.pi * (8 * MM) ** 2

    def at(angle: float) -> Float:
        plane, drop = fz * math.cos(angle), fz * math.sin(angle)
        return mean_wrenches(weights, depths, plane, drop, area if drop > 0 else 0.0)

    level = at(0.0)
    np.testing.assert_allclose(at(1e-7), level, rtol=1e-3, atol=0.02)
    np.testing.assert_allclose(at(-1e-7), level, rtol=1e-3, atol=0.02)
    angles = np.linspace(0.0, math.pi / 2 - 1e-9, 400)
    path = np.array([at(a) for a in angles])
    steps = np.abs(np.diff(path, axis=0)).max(axis=0) / np.ptp(path, axis=0).max()
    assert steps.max() < 0.1


@pytest.mark.parametrize("corner", [0.0, 2.0, 5.0])
@pytest.mark.parametrize("slope_deg", [-90.0, -60.0, -20.0, -3.0, 0.0, 3.0, 20.0, 60.0])
def test_torque_times_angle_is_specific_energy_times_volume(corner: float, slope_deg: float) -> None:
    """With a constant k_c (m = 0) the work of the spindle is k_c V, whatever cutter, slope and engagement."""
    law = kienzle(0.0, 0.0, 0.0)
    cutter = Cutter(diameter_m=10 * MM, corner_radius_m=corner * MM, flutes=2)
    weights = mean_force_weights(cutter, law)
    stock = HeightMap.from_box((0.0, 0.0, -20 * MM), (30 * MM, 20 * MM, 0.0), 0.1 * MM)
    slope = math.radians(slope_deg)
    direction = np.array([math.cos(slope), 0.0, math.sin(slope)])
    start = np.array([12 * MM, 10 * MM, -4 * MM if slope_deg > -90 else 0.5 * MM])
    path = start + np.linspace(0.0, 6 * MM, 13)[:, None] * direction
    if slope_deg > -90:  # open the slot, so that the first segment has no chip of its own
        remove_path(stock, path[[0, 0]] + np.array([[0, 0, 9 * MM], [0, 0, 0]]), np.array([0]), cutter)
    done = remove_path(stock, path, np.ones(12, dtype=np.int64), cutter)
    assert done.engagement is not None
    feed = 0.04 * MM
    teeth = 0.5 * MM / feed
    drop = np.full(12, 0.5 * MM) * -math.sin(slope)
    area = done.bottom_volume_m3 / drop if slope_deg < 0 else np.zeros(12)
    wrench = mean_wrenches(
        weights, done.engagement.dense(0, 12), feed * max(math.cos(slope), 0.0), drop / teeth, np.maximum(area, 0.0)
    )
    work = wrench[2:, 5] * 2 * math.pi * teeth / cutter.flutes
    energy = law.k11_pa()[0] * done.volume_m3[2:]
    np.testing.assert_allclose(work.sum(), energy.sum(), rtol=0.006)


@given(
    st.integers(1, 63),
    st.floats(1e-6, 2e-4),
    st.floats(1e-4, 2e-2),
    st.sampled_from([kienzle(0.2, 0.5, 0.3), linear_edge()]),
)
def test_engagements_add(split: int, feed: float, depth_m: float, law: ForceLaw) -> None:
    """Two arcs side by side carry the sum of the wrenches of each, and the spindle always has to push."""
    weights = mean_force_weights(D16, law)
    whole = slot(weights, depth_m)
    left, right = whole.copy(), whole.copy()
    left[:, split:] = 0.0
    right[:, :split] = 0.0
    parts = mean_wrenches(weights, np.stack([left, right, whole]), feed)
    np.testing.assert_allclose(parts[0] + parts[1], parts[2], rtol=1e-9, atol=1e-9)
    assert np.all(parts[:, 5] > 0.0)


def test_bad_input() -> None:
    weights = mean_force_weights(D16, kienzle())
    good = slot(weights, 1 * MM)
    with pytest.raises(InputError, match="shape"):
        mean_wrenches(weights, np.zeros((2, N_BINS)), 1e-5)
    with pytest.raises(InputError, match="depth is negative"):
        mean_wrenches(weights, -good, 1e-5)
    with pytest.raises(InputError, match="feeds_m is negative"):
        mean_wrenches(weights, good, -1e-5)
    with pytest.raises(InputError, match="even"):
        mean_force_weights(D16, kienzle(), n_bins=63)
    assert np.all(mean_wrenches(weights, good, 0.0) == 0.0)
    frozen = good.copy()
    frozen.flags.writeable = False
    assert mean_wrenches(weights, np.stack([frozen, good]), 1e-5).shape == (2, 6)
