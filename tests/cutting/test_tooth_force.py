"""Tooth-resolved force: mean against the closed form, helix, runout, trochoid; range of validity; zero normal force."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG, MM, N_PER_MM2, UM
from counterflex.cutting import material
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc, mean_force, zero_normal_force_immersion
from counterflex.cutting.mean_force import mean_force_weights, mean_wrenches
from counterflex.cutting.tooth_force import tooth_forces


def kienzle(m: float = 0.25, kr_over_kc: float = 0.35, ka_over_kc: float = 0.15) -> KienzleLaw:
    return KienzleLaw.with_ratios(
        780 * N_PER_MM2,
        m,
        kr_over_kc=kr_over_kc,
        ka_over_kc=ka_over_kc,
        h_min_m=0.002 * MM,
        h_max_m=0.2 * MM,
        source="test",
    )


def stepped(n_levels: int) -> Float:
    depth = np.zeros((n_levels, 64))
    depth[-1, 5:20] = 9.5 * MM
    depth[-1, 20:40] = 3.1 * MM
    depth[-1, 50:] = 0.7 * MM
    return depth


@pytest.mark.parametrize("law", [kienzle(), material.load("en-aw-7075-linear-190").law()])
@pytest.mark.parametrize(("flutes", "helix_deg"), [(3, 0.0), (3, 30.0), (4, 45.0), (2, -20.0), (5, 3.0)])
def test_mean_is_the_closed_form_whatever_helix_and_flutes(law: ForceLaw, flutes: int, helix_deg: float) -> None:
    cutter = Cutter(16 * MM, flutes=flutes, helix_rad=helix_deg * DEG)
    depth = stepped(1)
    found = tooth_forces(cutter, law, depth, 0.0385 * MM, trochoid=False).mean
    closed = mean_wrenches(mean_force_weights(cutter, law), depth, 0.0385 * MM)
    np.testing.assert_allclose(found, closed, atol=1e-3)


def test_mean_of_a_ball_is_the_closed_form() -> None:
    cutter = Cutter(10 * MM, corner_radius_m=5 * MM, flutes=2, helix_rad=30 * DEG)
    depth = engagement_of_arc(cutter, 3 * MM, 0.0, 96 / 64 * math.pi / 2)
    found = tooth_forces(cutter, kienzle(), depth, 0.04 * MM, trochoid=False).mean
    closed = mean_wrenches(mean_force_weights(cutter, kienzle()), depth, 0.04 * MM)
    np.testing.assert_allclose(found, closed, atol=1e-3)


def test_helix_smooths_the_force() -> None:
    depth = engagement_of_arc(Cutter(16 * MM), 6 * MM, 0.0, math.pi / 2)
    peaks = [
        tooth_forces(Cutter(16 * MM, flutes=3, helix_rad=h * DEG), kienzle(), depth, 0.04 * MM).peak_n
        for h in (0.0, 20.0, 40.0)
    ]
    assert peaks[0] > peaks[1] > peaks[2]


def test_peak_of_one_straight_tooth_in_the_slot() -> None:
    """At phi = 90 deg one tooth carries the largest chip: F = a_p sqrt(k_c^2 + k_r^2 + k_a^2) f^(1-m)."""
    cutter = Cutter(16 * MM, flutes=1, helix_rad=0.0)
    depth = engagement_of_arc(cutter, 2 * MM, 0.0, math.pi)
    law = kienzle()
    found = tooth_forces(cutter, law, depth, 0.04 * MM, trochoid=False)
    assert found.peak_n == pytest.approx(2 * MM * np.linalg.norm(law.edge_force(0.04 * MM)), rel=1e-5)
    assert found.chip_max_m == pytest.approx(0.04 * MM, rel=1e-5)


@pytest.mark.parametrize(("entry", "exit_", "percent"), [(0, 0.2, 0.74), (1, 2, 0.53), (0, 2, 0.14)])
def test_trochoid_changes_the_mean_by_less_than_a_percent(entry: float, exit_: float, percent: float) -> None:
    """Berger2013's D 6 mm, 4 teeth, fz 0.03 mm: up-milling 0.1 D, down-milling 0.5 D, slot (a_e / R from the left)."""
    cutter = Cutter(6 * MM, flutes=4)
    depth = engagement_of_arc(cutter, 3 * MM, math.acos(1 - entry), math.acos(1 - exit_))
    true, circle = (
        tooth_forces(cutter, kienzle(0.274), depth, 0.03 * MM, trochoid=flag).mean[:3] for flag in (True, False)
    )
    assert 100 * (1 - np.linalg.norm(circle) / np.linalg.norm(true)) == pytest.approx(percent, abs=0.05)


@pytest.mark.parametrize(("entry", "exit_"), [(0.0, 2.0), (0.0, 1.0), (1.0, 2.0)])
def test_trochoid_at_the_conditions_of_haehn2020(entry: float, exit_: float) -> None:
    cutter = Cutter(16 * MM, flutes=3)
    depth = engagement_of_arc(cutter, 3 * MM, math.acos(1 - entry), math.acos(1 - exit_))
    true, circle = (
        tooth_forces(cutter, kienzle(), depth, 0.0385 * MM, trochoid=flag).mean[:3] for flag in (True, False)
    )
    assert 0.0 < 100 * (1 - np.linalg.norm(circle) / np.linalg.norm(true)) < 0.41


def test_runout_raises_the_peak() -> None:
    """5 um: about +15 % at fz 0.03 and +48 % at 0.008; 10 um: about +29 %; the mean falls by 1 to 3 %."""
    law = KienzleLaw.with_ratios(
        780 * N_PER_MM2, 0.23, kr_over_kc=0.3, ka_over_kc=0.0, h_min_m=1e-6, h_max_m=1e-3, source="test"
    )
    cutter = Cutter(6 * MM, flutes=4, helix_rad=30 * DEG)
    depth = engagement_of_arc(cutter, 2 * MM, 0.0, math.pi / 2)

    def effect(feed: float, runout: float) -> tuple[float, float]:
        still = tooth_forces(cutter, law, depth, feed)
        running = tooth_forces(replace(cutter, runout_m=runout), law, depth, feed)
        means = [float(np.linalg.norm(forces.mean[:3])) for forces in (running, still)]
        return 100 * (running.peak_n / still.peak_n - 1), 100 * (means[0] / means[1] - 1)

    assert effect(0.03 * MM, 5 * UM)[0] == pytest.approx(15, abs=1.5)
    peak, mean = effect(0.03 * MM, 10 * UM)
    assert peak == pytest.approx(29, abs=2)
    assert -4 < mean < -1
    assert effect(0.008 * MM, 5 * UM)[0] == pytest.approx(48, abs=7)


def test_runout_conserves_the_work_of_a_constant_specific_force() -> None:
    """With m = 0 the work over a revolution is k_c times the volume, even when teeth cut air."""
    law = kienzle(0.0)
    cutter = Cutter(6 * MM, flutes=4)
    depth = engagement_of_arc(cutter, 2 * MM, math.pi / 4, 3 * math.pi / 4)
    still = tooth_forces(cutter, law, depth, 0.008 * MM, trochoid=False)
    running = tooth_forces(replace(cutter, runout_m=10 * UM), law, depth, 0.008 * MM, trochoid=False)
    assert running.mean[5] == pytest.approx(still.mean[5], rel=2e-3)
    assert running.peak_n > 1.5 * still.peak_n


def test_teeth_of_a_runout_cut_in_the_order_in_which_they_pass() -> None:
    """Tooth j cuts what the teeth before it left: its pulse is R_j less the highest wall that an earlier one stood for.

    The wall left by the tooth k pitches earlier has moved in by k f_z since. With three teeth the other order gives
    other chips. Arc near 90 degrees, so that one tooth cuts at a time; force proportional to the chip.
    """
    feed, runout = 0.05 * MM, 12 * UM
    law = LinearEdgeLaw(
        800 * N_PER_MM2, 0.0, 0.0, 0.0, 0.0, 0.0, h_min_m=1e-6, h_max_m=1e-3, source="test", status="assumed"
    )
    for alpha in (0.3, 1.7, 4.0):
        cutter = Cutter(10 * MM, flutes=3, helix_rad=0.0, runout_m=runout, runout_angle_rad=alpha)
        radii = 5 * MM + runout * np.cos(alpha + 2.0 * math.pi / 3.0 * np.arange(3))
        walls = [max(radii[(j - k) % 3] - k * feed for k in (1, 2, 3)) for j in range(3)]
        chips = radii - np.array(walls)
        depth = np.zeros((cutter.n_levels, 64))
        depth[0, 31:33] = 2 * MM  # 87.2 to 92.8 degrees
        for trochoid in (False, True):
            forces = tooth_forces(cutter, law, depth, feed, trochoid=trochoid, steps=3600)
            turned = np.degrees(forces.angle_rad)
            peaks = []
            for tooth in range(3):
                near = np.abs((turned - 90.0 - 120.0 * tooth + 180.0) % 360.0 - 180.0) < 2.0
                peaks.append(float(np.median(np.linalg.norm(forces.wrench_tcp[near, :3], axis=1))))
            np.testing.assert_allclose(peaks, 800 * N_PER_MM2 * 2 * MM * chips, rtol=0.02)
        assert np.ptp(chips) > 0.2 * feed


@pytest.mark.parametrize("depth_mm", [1.0, 3.0, 5.0])
def test_share_of_a_ball_outside_the_range_is_the_share_of_its_cutting_work(depth_mm: float) -> None:
    """Work of an edge element: F_c(h) ds times the way it goes, rho dphi; h = f_z sin(phi) sin(kappa)."""
    law = replace(kienzle(), h_min_m=0.012 * MM, h_max_m=0.03 * MM)
    radius, feed = 5 * MM, 0.04 * MM
    cutter = Cutter(10 * MM, corner_radius_m=radius, flutes=2)
    kappa = (np.arange(2000) + 0.5) / 2000 * math.acos(1.0 - depth_mm * MM / radius)
    phi = (np.arange(2000) + 0.5) / 2000 * math.pi
    h = feed * np.sin(kappa)[:, None] * np.sin(phi)
    work = law.edge_force(h)[..., 0] * radius * np.sin(kappa)[:, None]
    outside = (h < law.h_min_m) | (h > law.h_max_m)
    expected = work[outside].sum() / work.sum()
    depth = engagement_of_arc(cutter, depth_mm * MM, 0.0, math.pi)
    mean = mean_force(cutter, law, depth[None], feed, allow_extrapolation=True).extrapolated_share[0]
    assert mean == pytest.approx(expected, abs=0.03)
    teeth = tooth_forces(cutter, law, depth, feed, trochoid=False, steps=1440).extrapolated_share
    assert teeth == pytest.approx(expected, abs=0.03)


def test_extrapolation_is_refused_or_reported() -> None:
    law = material.load("en-aw-7075-carbide-190").law()
    cutter = Cutter(16 * MM, flutes=3)
    depth = engagement_of_arc(cutter, 3 * MM, 0.0, math.pi)[None]
    good = mean_force(cutter, law, depth, 0.0385 * MM)
    assert good.in_range.all()
    assert good.h_mean_m[0] == pytest.approx(0.0385 * MM * 2 / math.pi)
    assert 0.0 < good.extrapolated_share[0] < 0.2
    with pytest.raises(ModelError, match="groove, segment 0"):
        mean_force(cutter, law, depth, 0.005 * MM, where="groove")
    flagged = mean_force(cutter, law, depth, 0.005 * MM, allow_extrapolation=True)
    assert not flagged.in_range[0]
    assert flagged.extrapolated_share[0] == 1.0
    assert mean_force(cutter, law, 0 * depth, 0.005 * MM).in_range.all()


def test_engagement_of_arc_books_partial_bins() -> None:
    cutter = Cutter(16 * MM, flutes=3)
    depth = engagement_of_arc(cutter, 3 * MM, 0.3, 1.234)
    widths = -np.diff(np.cos(np.linspace(0, math.pi, 65)))
    assert (depth[0] * widths).sum() == pytest.approx(3 * MM * (math.cos(0.3) - math.cos(1.234)))
    ball = engagement_of_arc(Cutter(10 * MM, corner_radius_m=5 * MM), 7 * MM, 0.0, math.pi)
    np.testing.assert_allclose(ball.sum(axis=0), 7 * MM)
    with pytest.raises(InputError):
        engagement_of_arc(cutter, 3 * MM, 1.0, 0.5)


@pytest.mark.parametrize(
    ("ratio", "immersion"),
    [
        (0.2, 0.022),
        (0.3, 0.047),
        (0.4, 0.080),
        (0.5, 0.118),
        (0.6, 0.158),
        (0.8, 0.242),
        (1.0, 0.322),
        (1.25, 0.409),
        (math.pi / 2, 0.500),
        (2.0, 0.591),
    ],
)
def test_zero_normal_force_without_size_effect(ratio: float, immersion: float) -> None:
    phi = zero_normal_force_immersion(kienzle(0.0, ratio), 0.03 * MM)
    assert (1 - math.cos(phi)) / 2 == pytest.approx(immersion, abs=6e-4)
    assert (2 * phi - math.sin(2 * phi)) / (1 - math.cos(2 * phi)) == pytest.approx(ratio, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("en-aw-7075-linear-190", [(0.415, 0.49), (0.31, 0.36), (0.185, 0.22)]),
        ("en-aw-7075-linear-hss-156", [(0.355, 0.365), (0.215, 0.225), (0.115, 0.125)]),
    ],
)
def test_half_the_diameter_holds_near_one_feed_only(name: str, found: list[tuple[float, float]]) -> None:
    law = material.load(name).law()
    for feed, (low, high) in zip((0.008, 0.03, 0.1), found, strict=True):
        phi = zero_normal_force_immersion(law, feed * MM)
        assert low <= (1 - math.cos(phi)) / 2 <= high
        cutter = Cutter(6 * MM, flutes=4)
        force = mean_wrenches(
            mean_force_weights(cutter, law, 4096), engagement_of_arc(cutter, 2 * MM, 0.0, phi, 4096), feed * MM
        )
        assert abs(force[1]) < 1e-3 * np.linalg.norm(force[:3])


def test_zero_normal_force_may_not_exist() -> None:
    with pytest.raises(ModelError, match="vanishes at no immersion"):
        zero_normal_force_immersion(kienzle(0.25, 0.0), 0.03 * MM)


def test_bad_input() -> None:
    cutter = Cutter(16 * MM, flutes=3)
    with pytest.raises(InputError):
        tooth_forces(cutter, kienzle(), -stepped(1), 0.04 * MM)
    with pytest.raises(InputError):
        tooth_forces(cutter, kienzle(), stepped(2), 0.04 * MM)
    with pytest.raises(InputError):
        tooth_forces(cutter, kienzle(), stepped(1), 0.0)
    with pytest.raises(ModelError, match="slices"):
        tooth_forces(replace(cutter, helix_rad=1.5707), kienzle(), stepped(1), 0.04 * MM)
    assert tooth_forces(cutter, kienzle(), 0 * stepped(1), 0.04 * MM).peak_n == 0.0
