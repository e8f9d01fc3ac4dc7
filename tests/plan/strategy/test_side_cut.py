"""Side cuts: closed forms of the mean force, the width without force against a fine scan, published figures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting import material
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import zero_normal_force_immersion
from counterflex.cutting.tooth_force import tooth_forces
from counterflex.plan.strategy.side_cut import SideCuts, feed_axes, in_part, peak_side_force, wrenches
from counterflex.plan.strategy.zero import normal_errors, normal_force, zero_width

MILL = Cutter(diameter_m=6 * MM, flutes=4, helix_rad=0.0, flute_length_m=16 * MM)
EDGE = LinearEdgeLaw(
    ktc_pa=767e6,
    krc_pa=169e6,
    kac_pa=222e6,
    kte_n_m=27.7e3,
    kre_n_m=26.6e3,
    kae_n_m=0.7e3,
    h_min_m=1e-6,
    h_max_m=1e-3,
    source="test",
    status="test",
)


def kienzle(ratio: float, mc: float = 0.0, mr: float = 0.0) -> KienzleLaw:
    return KienzleLaw(
        kc_ref_pa=1e9,
        mc=mc,
        kr_ref_pa=ratio * 1e9,
        mr=mr,
        ka_ref_pa=0.1e9,
        ma=mc,
        h_ref_m=0.02 * MM,
        h_min_m=1e-6,
        h_max_m=1e-3,
        source="test",
        status="test",
    )


def cut(up: bool, ae_mm: float, ap_mm: float = 3.0, fz_mm: float = 0.03) -> SideCuts:
    return SideCuts(MILL, np.array([up]), *(np.array([value * MM]) for value in (ae_mm, ap_mm, fz_mm)))


def scanned(law: ForceLaw, fz_m: float, count: int = 100_000) -> tuple[Float, Float]:
    """Immersion and mean normal force of up-milling per depth, by adding up thin slices of the arc."""
    step = math.pi / count
    phi = np.linspace(0.5 * step, math.pi - 0.5 * step, count)
    force = law.edge_force(fz_m * np.sin(phi))
    normal = -np.cumsum(force[:, 0] * np.sin(phi) - force[:, 1] * np.cos(phi)) * step * MILL.flutes / (2.0 * math.pi)
    ends: Float = phi + 0.5 * step
    return ends, normal


@pytest.mark.parametrize("up", [True, False])
def test_the_mean_force_of_a_slot_is_that_of_the_closed_form(up: bool) -> None:
    one = cut(up, 6.0)
    n, a, f = 4, 3 * MM, 0.03 * MM
    expected = [
        -n * a / 4 * EDGE.krc_pa * f - n * a / math.pi * EDGE.kre_n_m,
        n * a / 4 * EDGE.ktc_pa * f + n * a / math.pi * EDGE.kte_n_m,
        -(n * a / math.pi * EDGE.kac_pa * f + n * a / 2 * EDGE.kae_n_m),
    ]
    whole = wrenches(one, EDGE).sum(axis=1)[0]
    assert whole[:3] == pytest.approx(expected, rel=1e-9)
    torque = n * a * 3 * MM * (EDGE.ktc_pa * f / math.pi + EDGE.kte_n_m / 2)
    assert whole[5] == pytest.approx(torque, rel=1e-6)


@example(ratio=0.25, mc=0.5, mr=0.0, fz_mm=0.015625)  # at 0.15 % of the diameter
@settings(max_examples=20)
@given(ratio=st.floats(0.2, 1.4), mc=st.floats(0.0, 0.5), mr=st.floats(0.0, 0.8), fz_mm=st.floats(0.008, 0.1))
def test_the_width_without_normal_force_is_where_a_fine_scan_has_it(
    ratio: float, mc: float, mr: float, fz_mm: float
) -> None:
    law = kienzle(ratio, mc, mr)
    phi, normal = scanned(law, fz_mm * MM)
    change = np.flatnonzero((normal[1:] <= 0.0) & (normal[:-1] > 0.0))
    width = zero_width(MILL, 3 * MM, fz_mm * MM, lambda cuts: normal_force(cuts, law))
    if not len(change):
        assert width is None
        return
    scan = MILL.radius_m * (1.0 - math.cos(phi[change[0]]))
    assert width == pytest.approx(scan, abs=2e-3 * MM)
    if 0.0 < mc < 1.0:
        immersion = zero_normal_force_immersion(law, fz_mm * MM)
        assert width == pytest.approx(MILL.radius_m * (1.0 - math.cos(immersion)), abs=1e-3 * MM)


@pytest.mark.parametrize(
    ("ratio", "share"),
    [
        (0.2, 0.022),
        (0.3, 0.047),
        (0.5, 0.118),
        (0.8, 0.242),
        (1.0, 0.322),
        (1.25, 0.409),
        (math.pi / 2, 0.5),
        (2.0, 0.591),
    ],
)
def test_widths_without_force_of_plain_ratios(ratio: float, share: float) -> None:
    width = zero_width(MILL, 3 * MM, 0.03 * MM, lambda cuts: normal_force(cuts, kienzle(ratio)))
    assert width is not None
    assert width / MILL.diameter_m == pytest.approx(share, abs=6e-4)


@pytest.mark.parametrize(("fz_mm", "low", "high"), [(0.008, 0.42, 0.49), (0.03, 0.31, 0.36), (0.1, 0.19, 0.22)])
def test_half_the_diameter_holds_at_small_feeds_only(fz_mm: float, low: float, high: float) -> None:
    for name in ("en-aw-7075-linear-190", "en-aw-7075-linear-160"):
        law = material.load(name).with_ratios(ka_over_kc=None if name.endswith("190") else 0.1)
        width = zero_width(MILL, 3 * MM, fz_mm * MM, lambda cuts, law=law: normal_force(cuts, law))  # type: ignore[misc]
        assert width is not None
        assert low - 0.005 <= width / MILL.diameter_m <= high + 0.005


@pytest.mark.parametrize(("up", "sign"), [(True, -1.0), (False, 1.0)])
@pytest.mark.parametrize("ae_mm", [0.3, 3.0, 4.5])
def test_the_force_on_the_wall_is_that_of_the_closed_form(up: bool, sign: float, ae_mm: float) -> None:
    one, f = cut(up, ae_mm), 0.03 * MM
    phi = float(one.immersion_rad[0])
    sine = EDGE.ktc_pa * f * (phi / 2 - math.sin(2 * phi) / 4) + EDGE.kte_n_m * (1 - math.cos(phi))
    cosine = EDGE.krc_pa * f * math.sin(phi) ** 2 / 2 + EDGE.kre_n_m * math.sin(phi)
    expected = 4 * 3 * MM / (2 * math.pi) * (sign * sine + cosine)
    assert float(normal_force(one, EDGE)[0]) == pytest.approx(expected, rel=2e-3, abs=0.02)


@given(ae_mm=st.floats(0.05, 5.9), fz_mm=st.floats(0.005, 0.1))
@settings(max_examples=20)
def test_down_milling_always_pushes_the_tool_off_the_wall_and_harder(ae_mm: float, fz_mm: float) -> None:
    down = float(normal_force(cut(False, ae_mm, fz_mm=fz_mm), EDGE)[0])
    up = float(normal_force(cut(True, ae_mm, fz_mm=fz_mm), EDGE)[0])
    assert down > 0.0
    assert abs(up) < down


def test_the_same_wall_is_passed_in_opposite_directions_and_feels_the_same_force() -> None:
    normal = np.array([0.6, 0.8, 0.0])
    both = SideCuts(MILL, np.array([True, False]), *(np.full(2, value * MM) for value in (1.0, 3.0, 0.03)))
    axes = feed_axes(both.up, normal)
    assert axes[0, :, 0] == pytest.approx(-axes[1, :, 0])
    assert np.linalg.det(axes) == pytest.approx(1.0)
    w = in_part(both, wrenches(both, EDGE), normal).sum(axis=1)
    assert w[:, :3] @ normal == pytest.approx(normal_force(both, EDGE))
    isotropic = np.zeros((6, 6))
    isotropic[:3, :3] = 1e-6 * np.eye(3)
    errors = normal_errors(both, EDGE, isotropic, normal).sum(axis=1)
    assert errors == pytest.approx(1e-6 * normal_force(both, EDGE))


def test_the_peak_without_helix_is_that_of_the_tooth_by_tooth_force() -> None:
    one = cut(True, 2.0)
    from counterflex.cutting.force import engagement_of_arc

    exact = tooth_forces(MILL, EDGE, engagement_of_arc(MILL, 3 * MM, 0.0, float(one.exit_rad[0])), 0.03 * MM)
    side = float(np.linalg.norm(exact.wrench_tcp[:, :2], axis=1).max())
    assert float(peak_side_force(one, EDGE)[0]) == pytest.approx(side, rel=0.03)


def test_a_cut_wider_than_the_tool_is_refused() -> None:
    with pytest.raises(InputError, match="ae_m is out of range"):
        cut(True, 6.5)
    with pytest.raises(InputError, match="ap_m is out of range"):
        cut(True, 1.0, ap_mm=17.0)
