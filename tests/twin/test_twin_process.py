"""Cutting forces and removal of the twin against closed forms and quadrature written here."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, SimulationError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.twin.plant.process import StockCutting
from counterflex.twin.truth.truth import CuttingTruth

RADIUS, TEETH, SPEED, FEED, DEPTH = 8e-3, 3, 13000.0 / 60.0, 25e-3, 6e-3
CHIP = FEED / (SPEED * TEETH)
STEP = 0.5e-3
LAW = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.40, 0.30))


def closed_form(law: CuttingTruth, begin: float, end: float, depth: float, *, chip: float = CHIP) -> Float:
    """Mean force in feed, left, up axes for the immersion begin..end, by quadrature over a revolution."""

    def share(phi: float) -> Float:
        h = chip * math.sin(phi)
        c, r, a = (
            depth * (k * law.h_ref_m**m * max(h, 0.0) ** (1.0 - m) + e * -math.expm1(-h / law.edge_onset_m))
            for k, m, e in zip(law.k_pa, law.exponent, law.edge_n_m, strict=True)
        )
        return np.array([-c * math.cos(phi) - r * math.sin(phi), c * math.sin(phi) - r * math.cos(phi), -a])

    return np.array([quad(lambda p, i=i: share(p)[i], begin, end)[0] for i in range(3)]) * TEETH / (2.0 * math.pi)


def slot(
    law: CuttingTruth,
    *,
    angle: float = 0.0,
    side: float | None = None,
    keep_right: bool = True,
    cutter: Cutter | None = None,
    spindle: float = SPEED,
    start: float = -0.022,
    end: float = 0.0,
    depth: float = DEPTH,
) -> tuple[Float, Float, StockCutting]:
    """Feed straight through a block; travel (n,) m and force in feed, left, up axes (n, 3) N."""
    stock = HeightMap.from_box((-0.025, -0.02, -0.01), (0.025, 0.02, 0.0), 1e-4)
    u = np.array([math.cos(angle), math.sin(angle)])
    left = np.array([-u[1], u[0]])
    X, Y = np.meshgrid(stock.x_m(), stock.y_m())
    if side is not None:
        W = X * left[0] + Y * left[1]
        stock.z[side < W if keep_right else side > W] = stock.bottom_m
        stock.refresh()
    tool = cutter or Cutter(2.0 * RADIUS, flutes=TEETH)
    process = StockCutting(stock, tool, law, STEP, np.eye(4))
    process.spindle(2.0 * math.pi * spindle)
    s = np.arange(start, end, FEED * STEP)
    force = np.empty((len(s), 3))
    for k, travel in enumerate(s):
        p = np.array([*(travel * u), -depth])
        if k == 0:
            process.restart(p)
        w = process.wrench(p)
        force[k] = w[:2] @ u, w[:2] @ left, w[2]
        if k % 8 == 0:
            process.advance(p)
    return s, force, process


@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize(
    ("begin", "end", "side", "keep_right"),
    [
        (0.0, math.pi, None, True),
        (0.0, math.pi / 2, 0.0, False),
        (math.pi / 2, math.pi, 0.0, True),
        (0.0, math.acos(0.8), 0.8 * RADIUS, False),
    ],
)
def test_mean_force_in_the_plateau(
    angle: float, begin: float, end: float, side: float | None, keep_right: bool
) -> None:
    s, force, _ = slot(LAW, angle=angle, side=side, keep_right=keep_right, start=-0.01)
    found = force[s > -2e-3].mean(axis=0)
    expected = closed_form(LAW, begin, end, DEPTH)
    cells = 0.03 if side is None or side == 0.0 else 0.05  # a narrow cut is known to half a cell of its width
    assert np.linalg.norm(found - expected) < cells * np.linalg.norm(expected)
    if side is None:
        np.testing.assert_allclose(found, expected, rtol=0.01)
        assert force[s > -2e-3].std(axis=0).max() < 0.01 * np.linalg.norm(expected)


def test_ploughing_adds_its_share() -> None:
    law = replace(LAW, edge_n_m=(4000.0, 3000.0, 500.0))
    s, force, _ = slot(law, start=-0.01)
    np.testing.assert_allclose(force[s > -2e-3].mean(axis=0), closed_form(law, 0.0, math.pi, DEPTH), rtol=0.015)


def test_runout_keeps_the_chip_and_changes_the_force_a_little() -> None:
    """With linear forces the mean does not know runout; with Kienzle it falls slightly (concave law)."""
    linear = CuttingTruth(k_pa=(900e6, 300e6, 100e6), exponent=(0.0, 0.0, 0.0))
    for law, low, high in ((linear, 0.985, 1.001), (LAW, 0.90, 0.9999)):
        s, plain, _ = slot(law, start=-0.004)
        _, uneven, _ = slot(replace(law, runout_m=10e-6), start=-0.004)
        late = s > -1e-3
        ratio = uneven[late, 1].mean() / plain[late, 1].mean()
        assert low < ratio < high


def test_turning_the_other_way_mirrors_the_force() -> None:
    s, clockwise, _ = slot(LAW, start=-0.004)
    _, counter, _ = slot(LAW, start=-0.004, spindle=-SPEED)
    late = s > -1e-3
    np.testing.assert_allclose(counter[late].mean(axis=0) * [1, -1, 1], clockwise[late].mean(axis=0), rtol=0.01)


def test_entry_is_smooth_and_follows_the_arc() -> None:
    """Into a face at s = 0 the tool is engaged where ``R sin(phi) > distance``."""
    s, force, _ = slot(LAW, side=None, start=-0.035, end=-0.010)
    ahead = -0.025 - s  # distance from the tool axis to the face
    expected = np.array(
        [
            closed_form(LAW, math.asin(d / RADIUS), math.pi - math.asin(d / RADIUS), DEPTH) if d > 0 else np.zeros(3)
            for d in np.clip(ahead, None, RADIUS)[::20]
        ]
    )
    entering = (ahead[::20] > 0.3e-3) & (ahead[::20] < RADIUS)
    plateau = np.linalg.norm(closed_form(LAW, 0.0, math.pi, DEPTH))
    assert np.max(np.abs(force[::20] - expected)[entering]) < 0.05 * plateau
    assert np.max(np.linalg.norm(np.diff(force, axis=0), axis=1)) < 0.04 * plateau
    assert np.all(force[ahead > RADIUS + 0.2e-3] == 0.0)


def test_ball_end_mill_force() -> None:
    """A ball in full slot: quadrature over the sphere, normals tilted by kappa."""
    depth, ball = 4e-3, Cutter(2.0 * RADIUS, corner_radius_m=RADIUS, flutes=TEETH)
    law = LAW
    expected = np.zeros(3)
    kappa_end = math.acos(1.0 - depth / RADIUS)
    kappas = (np.arange(200) + 0.5) * kappa_end / 200
    phis = (np.arange(360) + 0.5) * math.pi / 360
    for kappa in kappas:
        h = CHIP * np.sin(phis) * math.sin(kappa)
        edge = RADIUS * kappa_end / 200
        c, r, a = (edge * k * law.h_ref_m**m * h ** (1 - m) for k, m in zip(law.k_pa, law.exponent, strict=True))
        inward = r * math.sin(kappa) + a * math.cos(kappa)
        expected += (
            TEETH
            / 360
            / 2
            * np.array(
                [
                    np.sum(-c * np.cos(phis) - inward * np.sin(phis)),
                    np.sum(c * np.sin(phis) - inward * np.cos(phis)),
                    np.sum(r * math.cos(kappa) - a * math.sin(kappa)),
                ]
            )
        )
    s, force, _ = slot(law, cutter=ball, depth=depth, start=-0.01)
    found = force[s > -2e-3].mean(axis=0)
    assert np.linalg.norm(found - expected) < 0.03 * np.linalg.norm(expected)


def test_plunging_pushes_the_tool_up_and_drilling_moment_opposes_the_turn() -> None:
    stock = HeightMap.from_box((-0.02, -0.02, -0.02), (0.02, 0.02, 0.0), 2e-4)
    process = StockCutting(stock, Cutter(2.0 * RADIUS, flutes=TEETH), LAW, STEP, np.eye(4))
    process.spindle(2.0 * math.pi * SPEED)
    speed = 5e-3
    for k in range(1200):
        p = np.array([0.0, 0.0, 1e-3 - speed * STEP * k])
        if k == 0:
            process.restart(p)
        w = process.wrench(p)
        if k % 8 == 0:
            process.advance(p)
    h = speed / (SPEED * TEETH)
    up = TEETH * RADIUS * LAW.k_pa[1] * LAW.h_ref_m ** LAW.exponent[1] * h ** (1.0 - LAW.exponent[1])
    assert w[2] == pytest.approx(up, rel=0.01)
    moment = 0.5 * TEETH * RADIUS**2 * LAW.k_pa[0] * LAW.h_ref_m ** LAW.exponent[0] * h ** (1.0 - LAW.exponent[0])
    assert w[5] == pytest.approx(moment, rel=0.01)  # clockwise from above is about -z; the stock holds back
    assert abs(w[0]) < 1e-6 * up


def test_regenerating_surface_springs_nothing_when_standing_still() -> None:
    """Pressed against the wall it has cut, without motion, the tool feels nothing."""
    _, _, process = slot(LAW, start=-0.01, end=-0.005)
    p = process.p_part.copy()
    for _ in range(10):
        w = process.wrench(p)
    assert np.all(w == 0.0)


def test_removed_volume_is_that_of_the_swept_tool() -> None:
    s, _, process = slot(LAW, start=-0.015, end=0.010)
    before = process.stock.volume_m3
    stock = process.finish()
    assert stock.volume_m3 < before
    whole = HeightMap.from_box((-0.025, -0.02, -0.01), (0.025, 0.02, 0.0), 1e-4).volume_m3
    last = s[::8][-1]
    swept = (2.0 * RADIUS * (last - s[0]) + math.pi * RADIUS**2) * DEPTH
    assert whole - stock.volume_m3 == pytest.approx(swept, rel=2e-3)
    assert stock.z.min() == pytest.approx(-DEPTH, abs=1e-8)


def test_ramp_leaves_the_floor_of_a_flat_tool_where_it_belongs() -> None:
    """Descending at slope m the floor lies at ``z_tip + m sqrt(R^2 - w^2)``."""
    stock = HeightMap.from_box((-0.03, -0.01, -0.01), (0.03, 0.01, 0.0), 1e-4)
    process = StockCutting(stock, Cutter(2.0 * RADIUS, flutes=TEETH), LAW, STEP, np.eye(4))
    slope = 0.1
    for k, x in enumerate(np.arange(-0.02, 0.02, 1e-4)):
        p = np.array([x, 0.0, -slope * (x + 0.02)])
        if k == 0:
            process.restart(p)
        process.advance(p)
    z = process.finish().z
    i = int(np.argmin(np.abs(stock.x_m())))
    w = stock.y_m()
    inside = np.abs(w) < 0.95 * RADIUS
    expected = -slope * (stock.x_m()[i] + 0.02) + 0.0 * w - 0.0
    floor = expected - slope * np.sqrt(np.clip(RADIUS**2 - w**2, 0, None))
    np.testing.assert_allclose(z[inside, i], floor[inside], atol=2e-6)


def test_spindle_off_in_material_is_refused() -> None:
    with pytest.raises(SimulationError, match="spindle off"):
        slot(LAW, spindle=0.0, start=-0.004)


def test_cutting_with_the_shank_is_refused() -> None:
    with pytest.raises(SimulationError, match="flutes"):
        slot(LAW, cutter=Cutter(2.0 * RADIUS, flutes=TEETH, flute_length_m=5e-3), start=-0.004)


def test_a_spindle_that_hardly_turns_is_refused() -> None:
    process = slot(LAW, start=-0.0005)[2]
    with pytest.raises(InputError, match="too slowly"):
        process.spindle(0.1)


def test_opening_a_hole_engages_more_than_a_straight_cut() -> None:
    """Hole of radius 20 mm opened to 24 mm by an 8 mm tool: 71.79 deg of engagement, where ae = 4 mm gives 60 deg."""
    stock = HeightMap.from_box((-0.03, -0.03, -0.01), (0.03, 0.03, 0.0), 1e-4)
    X, Y = np.meshgrid(stock.x_m(), stock.y_m())
    stock.z[np.hypot(X, Y) < 20e-3] = stock.bottom_m
    stock.refresh()
    process = StockCutting(stock, Cutter(2.0 * RADIUS, flutes=TEETH), LAW, STEP, np.eye(4))
    process.spindle(2.0 * math.pi * SPEED)
    circle = 16e-3
    angles = np.arange(0.0, 2.2, FEED * STEP / circle)
    force = np.empty((len(angles), 3))
    for k, a in enumerate(angles):
        p = np.array([circle * math.cos(a), circle * math.sin(a), -DEPTH])
        if k == 0:
            process.restart(p)
        w = process.wrench(p)
        feed, left = np.array([-math.sin(a), math.cos(a)]), np.array([-math.cos(a), -math.sin(a)])
        force[k] = w[:2] @ feed, w[:2] @ left, w[2]
        if k % 8 == 0:
            process.advance(p)
    engaged = math.acos((20e-3**2 - circle**2 - RADIUS**2) / (2.0 * circle * RADIUS))
    assert math.degrees(engaged) == pytest.approx(71.79, abs=0.01)
    expected = closed_form(LAW, math.pi - engaged, math.pi, DEPTH)
    found = force[angles > 1.4].mean(axis=0)
    assert np.linalg.norm(found - expected) < 0.03 * np.linalg.norm(expected)
