"""Figures of ISO 9283:1998 against cases computed by hand from its definitions; the arithmetic stands beside them."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.iso9283.path_cycles import CommandedPath, PathCycle, path_cycles, path_of
from counterflex.evaluate.iso9283.path_figures import IsoPathFigures, PathVelocity, corners
from counterflex.evaluate.iso9283.poses import DistanceFigures, PoseCycles, PoseFigures, drift, multi_directional
from counterflex.evaluate.iso9283.standstills import MeasuredStandstill, Settled
from counterflex.geometry import pose, rotation

MDEG = 1e-3 * DEG


def poses(points: object, R: Float | None = None, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> PoseCycles:
    """Attained poses, um beside the commanded position (mm)."""
    command = pose.make(p=np.array(at) * MM)
    return PoseCycles(command, command[:3, 3] + np.array(points, dtype=np.float64) * UM, R)


def test_pose_accuracy_and_repeatability() -> None:
    """Barycentre (3, 4, 0): AP = 5. Distances 1, 1, 2, 2: mean 1.5, S = sqrt(4 x 0.25 / 3) = 0.57735; RP = 3.23205."""
    f = PoseFigures.of(poses([(4, 4, 0), (2, 4, 0), (3, 6, 0), (3, 2, 0)]))
    assert f.ap.value == pytest.approx(5.0 * UM)
    assert [c.value for c in f.ap_xyz] == pytest.approx([3.0 * UM, 4.0 * UM, 0.0], abs=1e-15)
    assert f.rp is not None
    assert f.rp.value == pytest.approx(3.2320508 * UM, rel=1e-7)


def test_orientation_accuracy_and_repeatability() -> None:
    """Turns about z of 10, 20, 30, 40 mdeg: AP_c = 25; S = sqrt(500 / 3) = 12.90994; RP_c = 38.72983."""
    R = rotation.about_z(np.array([10.0, 20.0, 30.0, 40.0]) * MDEG)
    f = PoseFigures.of(poses(np.zeros((4, 3)), R))
    assert [c.value / MDEG for c in f.ap_abc] == pytest.approx([0.0, 0.0, 25.0], abs=1e-9)
    assert [c.value / MDEG for c in f.rp_abc] == pytest.approx([0.0, 0.0, 38.7298335], abs=1e-6)
    # interval of S with 3 degrees of freedom: chi2 quantiles 0.2157953, 9.3484036 (tables)
    assert f.rp_abc[2].low == pytest.approx(38.7298335 * MDEG * (3 / 9.3484036) ** 0.5, rel=1e-6)
    assert f.rp_abc[2].high == pytest.approx(38.7298335 * MDEG * (3 / 0.2157953) ** 0.5, rel=1e-6)


def test_distance_accuracy_and_repeatability() -> None:
    """Distances 100.01, 100.03, 100.02 of 100 mm: AD = 0.02; S = 0.01, RD = 0.03."""
    one, other = poses(np.zeros((3, 3))), poses([(10, 0, 0), (30, 0, 0), (20, 0, 0)], at=(100.0, 0.0, 0.0))
    f = DistanceFigures.of(one, other)
    assert f.commanded_m == pytest.approx(0.1)
    assert f.ad.value == pytest.approx(20.0 * UM)
    assert f.rd is not None
    assert f.rd.value == pytest.approx(30.0 * UM)
    # Student's t for 2 degrees of freedom at 97.5 %: 4.3026527; half width 4.3026527 x 10 / sqrt(3)
    assert f.ad.high == pytest.approx((20.0 + 4.3026527 * 10.0 / 3.0**0.5) * UM, rel=1e-6)


def test_multi_directional_variation() -> None:
    """Barycentres (0, 0, 0), (3, 4, 0), (0, 0, 12): the farthest pair is sqrt(9 + 16 + 144) = 13 apart."""
    scatter = np.array([(1, 0, 0), (-1, 0, 0)])
    position, angles = multi_directional([poses(scatter + c) for c in ((0, 0, 0), (3, 4, 0), (0, 0, 12))])
    assert position.value == pytest.approx(13.0 * UM)
    assert angles == ()


def test_drift() -> None:
    """Ten cycles about 10 um, ten about 25 um: dAP = 15. Scatter +-1 (RP = 1) becomes +-3 (RP = 3): dRP = 2."""
    first = np.tile([(11, 0, 0), (9, 0, 0)], (5, 1))
    later = np.tile([(28, 0, 0), (22, 0, 0)], (5, 1))
    attained = poses(np.concatenate([first, later]))
    found = drift(PoseCycles(attained.command, attained.p, None, np.arange(20.0)))
    assert found is not None
    assert [found.dap_m, found.drp_m, found.moved_m] == pytest.approx([15.0 * UM, 2.0 * UM, 15.0 * UM])
    assert drift(PoseCycles(attained.command, attained.p[:19], None, np.arange(19.0))) is None


def test_stabilisation_and_overshoot() -> None:
    """Enters the band of 0.1 mm at reading 12, leaves it to 0.3 mm, is back for good at 15: 3 x 10 ms, OV = 0.3 mm."""
    x = np.concatenate([np.linspace(24.0, 2.0, 12), [0.05, 0.3, 0.2, 0.04], np.zeros(60)]) * MM
    p = np.column_stack([x, 0 * x, 0 * x])
    time: Float = 0.01 * np.arange(len(x), dtype=np.float64)
    found = Settled.of(time, p, None, MeasuredStandstill(16, len(x) - 1, np.zeros(3), None, 0.5))
    assert [found.time_s, found.overshoot_m] == pytest.approx([0.03, 0.3 * MM])
    calm = np.where(np.abs(x - 0.25 * MM) < 0.06 * MM, 0.05 * MM, x)
    still = Settled.of(
        time, np.column_stack([calm, 0 * x, 0 * x]), None, MeasuredStandstill(16, len(x) - 1, np.zeros(3), None, 0.5)
    )
    assert (still.time_s, still.overshoot_m) == (0.0, 0.0)


def line(y_um: float, z_um: float = 0.0, speed_m_s: float = 0.05, wave: float = 0.0) -> PathCycle:
    """A straight run of 100 mm beside the commanded line."""
    time = np.linspace(0.0, 0.1 / speed_m_s, 2001)
    x = speed_m_s * time + wave * np.sin(2.0 * np.pi * time / time[-1] * 8.0)
    p = np.column_stack([x, np.full(len(x), y_um * UM), np.full(len(x), z_um * UM)])
    return PathCycle(0, p, np.clip(x, 0.0, 0.1), None, time)


def straight_path(speed_m_s: float | None = None) -> CommandedPath:
    """A line of 100 mm along x."""
    return path_of(np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0)]), None, speed_m_s)


def test_path_accuracy_and_repeatability() -> None:
    """At y = 1, 2, 3 um: barycentre 2, AT = 2. Distances 1, 0, 1: mean 2/3, S = sqrt(1/3); RT = 0.66667 + 1.73205."""
    f = IsoPathFigures.of(straight_path(), [line(1.0), line(2.0), line(3.0)])
    assert f.at_p.value == pytest.approx(2.0 * UM)
    assert f.rt_p is not None
    assert f.rt_p.value == pytest.approx(2.3987175 * UM, rel=1e-6)


def test_velocity() -> None:
    """Means of 49, 50, 51 mm/s for 50: AV = 0, S = 1, RV = 3 mm/s. A wave a sin(w t): FV = 2 a w, smoothed."""
    v = PathVelocity.of(straight_path(0.05), [line(0.0, speed_m_s=s * MM) for s in (49.0, 50.0, 51.0)])
    assert v.rv is not None
    assert [v.av.value / MM, v.rv.value / MM, v.fv_m_s / MM] == pytest.approx([0.0, 3.0, 0.0], abs=1e-6)
    # 8 periods in 2 s: w = 25.1327 1/s. A slope over T = 0.1 s passes 3 (sin z - z cos z) / z^3 of it, z = w T / 2:
    # 3 (0.951057 - 1.256637 x 0.309017) / 1.984402 = 0.85073. The places meet the crests within 1 %.
    waved = PathVelocity.of(straight_path(0.05), [line(0.0, wave=0.1 * MM)])
    assert waved.fv_m_s == pytest.approx(2.0 * 0.1 * MM * 25.1327 * 0.85073, rel=0.01)


def angle(corner: list[tuple[float, float]]) -> tuple[CommandedPath, list[PathCycle]]:
    """An attained path around a corner of 90 deg at (100, 0) mm."""
    path = path_of(np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.1, 0.0)]))
    ends = np.array([(-5.0, 0.0), *corner, (100.0, 100.0), (100.0, 105.0)]) * MM
    step = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(step)])
    at = np.union1d(np.linspace(0.0, s[-1], 4000), s)
    p = np.column_stack([np.interp(at, s, ends[:, 0]), np.interp(at, s, ends[:, 1]), 0.0 * at])
    return path, path_cycles(path, p)


def test_round_off() -> None:
    """Cut from (99, 0) to (100, 1): 1 / sqrt 2 mm from the corner, nothing outside: CR = 0.70711, CO = 0."""
    path, cycles = angle([(99.0, 0.0), (100.0, 1.0)])
    (corner,) = corners(path, cycles)
    assert corner.turn_rad == pytest.approx(90.0 * DEG)
    assert corner.cr_m == pytest.approx([0.5**0.5 * MM])
    assert corner.co_m == pytest.approx([0.0], abs=1e-12)


def test_overshoot() -> None:
    """Runs on to (100.3, 0) and comes back to (99.8, 20): CR = 0; CO = 0.3, and 0.2 inside the corner is none."""
    path, cycles = angle([(100.3, 0.0), (100.3, 5.0), (99.8, 20.0)])
    (corner,) = corners(path, cycles)
    assert corner.cr_m == pytest.approx([0.0], abs=1e-12)
    assert corner.co_m == pytest.approx([0.3 * MM])


def test_too_little() -> None:
    with pytest.raises(InputError, match="no attained path"):
        IsoPathFigures.of(straight_path(), [])
    with pytest.raises(InputError, match="other numbers of cycles"):
        DistanceFigures.of(poses(np.zeros((3, 3))), poses(np.zeros((2, 3))))
    one = PoseFigures.of(poses([(3, 4, 0)]))
    assert one.rp is None
    assert one.ap.low is None
