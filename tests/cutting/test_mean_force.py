"""Mean force: closed forms of the slot, numerical integration, the plunge, continuity on slopes, energy balance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, N_PER_MM, N_PER_MM2
from counterflex.cutting.arc_integrals import cosine_power_integral, disc_table, sine_power_integral
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.mean_force import N_BINS, MeanForceWeights, mean_force_weights, mean_wrenches

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


def test_disc_integrals_add_up() -> None:
    table = disc_table(8.0, 8.0, N_BINS)
    assert table[1].sum() == pytest.approx(2 * math.pi * 8.0, rel=1e-9)
    assert table[4].sum() == pytest.approx(math.pi * 64.0, rel=1e-9)
    assert table[2:4].sum(axis=1) == pytest.approx([0.0, 0.0], abs=1e-9)
