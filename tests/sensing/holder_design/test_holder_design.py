"""Design of a sensing holder: beams as the limit, what pockets and ribs do, choice of places under a limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.sensing.holder_design.bricks import MirroredBody, solve
from counterflex.sensing.holder_design.drawing import Drawing, Pocket
from counterflex.sensing.holder_design.places import (
    Behaviour,
    Chosen,
    beam_tip,
    behaviour,
    gain_by_pocket,
    lost_stiffness,
    without_ribs,
)
from counterflex.sensing.strain_holder import HolderBeam

BEAM = HolderBeam(0.18, 0.16, 0.015, 0.118)
TCP = (0.07, 0.0, 0.42)
NOISE = 0.2e-6
MESH_M = 0.03


def pockets(depth_m: float = 0.008, rib_m: float = 0.004, z_m: float = 0.04) -> tuple[Pocket, ...]:
    return tuple(
        Pocket(side, True, y, z, 0.03, 0.006, depth_m, rib_m)
        for side in (-1, 1)
        for y, z in ((0.04, z_m), (-0.04, z_m), (0.0, 0.14))
    )


DRAWING = Drawing(BEAM, pockets(), TCP)


@pytest.fixture(scope="module")
def plain() -> Behaviour:
    return behaviour(DRAWING, MESH_M, NOISE, cut=False, bricks=1)


@pytest.fixture(scope="module")
def cut() -> Behaviour:
    return behaviour(DRAWING, MESH_M, NOISE, bricks=1)


def test_without_pockets_it_is_two_timoshenko_cheeks(plain: Behaviour) -> None:
    """Cheeks as wide as two thirds of their length: bent about y they are plates, stiffer than beams by 1 - nu2."""
    bernoulli, timoshenko = beam_tip(BEAM, np.array(TCP))
    tip = plain.tip_m_per_n
    assert np.all(tip < 1.01 * timoshenko)
    assert np.all(tip > (1.0 - 0.3**2) * timoshenko)
    assert tip[1] > bernoulli[1], "shear is a twentieth of the deflection across"
    np.testing.assert_allclose(plain.compliance, plain.compliance.T, atol=1e-9 * np.abs(plain.compliance).max())


@pytest.mark.long
def test_pockets_cost_stiffness_and_deeper_ones_cost_more(plain: Behaviour, cut: Behaviour) -> None:
    lost = lost_stiffness(plain, cut)
    assert np.all(lost > 0.0)
    shallow = behaviour(replace(DRAWING, pockets=pockets(depth_m=0.004)), MESH_M, NOISE, bricks=1)
    assert np.all(lost_stiffness(plain, shallow) < 0.75 * lost)


def test_a_rib_over_a_pocket_across_the_cheek_shows_more_than_its_floor_and_gives_stiffness_back() -> None:
    """The pocket shifts the neutral line by d / 2: at most the rib is (t + d) / (t - d) as far from it as the floor."""
    t, d = BEAM.thickness_m, 0.008
    ribbed = Drawing(BEAM, tuple(Pocket(side, True, 0.0, 0.04, 0.116, 0.012, d, 0.004) for side in (-1, 1)), TCP)
    rib, floor = behaviour(ribbed, MESH_M, NOISE, bricks=1), behaviour(without_ribs(ribbed), MESH_M, NOISE, bricks=1)
    assert 1.2 < rib.strain[0, 0] / floor.strain[0, 0] < (t + d) / (t - d)
    assert rib.tip_m_per_n[0] < floor.tip_m_per_n[0]
    assert 1.5 < gain_by_pocket(ribbed, floor)[0] < (t / (t - d)) ** 2, "at most the strain of a cheek as thin as that"


def test_mirrored_cheeks_show_mirrored_strains(cut: Behaviour) -> None:
    """A force along x stretches one cheek's outside and shortens the other's; the tool tip lies off the middle."""
    np.testing.assert_allclose(cut.strain[:3, 0], -cut.strain[3:, 0], rtol=1e-6, atol=1e-14)
    np.testing.assert_allclose(cut.strain[0, 1], -cut.strain[1, 1], rtol=1e-6)


@pytest.mark.long
def test_places_are_chosen_within_the_limit_and_see_more(plain: Behaviour, cut: Behaviour) -> None:
    assert np.max(lost_stiffness(plain, cut)) > 0.05
    chosen = Chosen.of(DRAWING, 6, 0.05, MESH_M, NOISE, bricks=1)
    assert np.all(lost_stiffness(chosen.plain, chosen.cut) <= 0.05)
    assert chosen.cut.sight is not None
    assert cut.sight is not None
    # The given pockets cost more than the limit of 5 %, the chosen ones less: noise alone compares different costs.
    # Information goes with the square of the strain per newton, and so does the compliance that a pocket adds, so
    # noise^2 times lost stiffness is independent of how much is cut: what remains is the choice of the places.
    cost, before = np.max(lost_stiffness(chosen.plain, chosen.cut)), np.max(lost_stiffness(plain, cut))
    noise = chosen.cut.sight.sigma_n[2] ** 2 * cost
    assert noise < cut.sight.sigma_n[2] ** 2 * before, "more is told along the tool, seen worst, for what it costs"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depth_m": 0.0145}, "wall behind the pocket"),
        ({"y_m": 0.05}, "beyond the cheek across"),
        ({"z_m": 0.002}, "end of the cheek"),
        ({"rib_m": 0.0295}, "width of the rib"),
        ({"height_m": 0.002}, "shorter along the cheek than the gauge"),
        ({"side": 0}, "side"),
        ({"width_m": 0.0}, "not above 0"),
    ],
)
def test_pockets_that_cannot_be_cut_are_refused(change: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Drawing(BEAM, (replace(pockets()[0], **change),), TCP)  # type: ignore[arg-type]


@pytest.mark.long
def test_pockets_that_meet_and_limits_that_cannot_be_kept_are_refused() -> None:
    one = pockets()[0]
    with pytest.raises(InputError, match="pocket 2 meets pocket 1"):
        Drawing(BEAM, (one, replace(one, z_m=one.z_m + 0.0065)), TCP)
    Drawing(BEAM, (one, replace(one, outer=False, depth_m=0.005)), TCP)
    with pytest.raises(InputError, match="no pocket"):
        Chosen.of(Drawing(BEAM, (), TCP), 6, 0.1, MESH_M, NOISE, bricks=1)
    with pytest.raises(InputError, match="keeps the limit"):
        Chosen.of(Drawing(BEAM, (one,), TCP), 3, 1e-4, 2.0 * MESH_M, NOISE, bricks=1)


def test_a_mirrored_cheek_is_what_its_own_solution_is() -> None:
    """One pocket that is off the middle: the other cheek by its image and by finite elements of its own."""
    both = Drawing(BEAM, tuple(Pocket(side, True, 0.03, 0.04, 0.03, 0.012, 0.006) for side in (-1, 1)), TCP)
    assert both.mirrored
    left = both.cheek(-1, MESH_M, bricks=1)
    right = solve(both.cheek(1, MESH_M, bricks=1), BEAM.e_pa, BEAM.poisson_ratio)
    own, image = solve(left, BEAM.e_pa, BEAM.poisson_ratio), MirroredBody(right)
    np.testing.assert_allclose(image.stiffness, own.stiffness, rtol=1e-6, atol=1e-9 * own.stiffness.max())
    points = both.gauge_points(both.pockets[0])
    np.testing.assert_allclose(image.strain(points), own.strain(points), atol=1e-6 * np.abs(own.strain(points)).max())


@pytest.mark.parametrize("depth_m", [0.004, 0.008, 0.012])
@pytest.mark.parametrize("height_m", [0.004, 0.012])
def test_every_pocket_and_the_wall_behind_it_has_four_bricks(depth_m: float, height_m: float) -> None:
    pocket = Pocket(1, True, 0.02, 0.06, 0.03, height_m, depth_m)
    body = Drawing(BEAM, (pocket, replace(pocket, side=-1)), TCP).cheek(1, 0.06)
    floor = 0.5 * BEAM.thickness_m - depth_m
    eps = 1e-9

    def count(planes: Float, low: float, high: float) -> int:
        return int(np.sum((planes > low - eps) & (planes < high + eps))) - 1

    assert count(body.x, floor, 0.5 * BEAM.thickness_m) >= 4
    assert count(body.x, -0.5 * BEAM.thickness_m, floor) >= 4
    assert count(body.y, 0.005, 0.035) >= 4
    assert count(body.z, 0.06 - 0.5 * height_m, 0.06 + 0.5 * height_m) >= 4
    steps = np.diff(body.z)
    assert np.max(steps[1:] / steps[:-1]) < 2.5
    assert np.max(steps[:-1] / steps[1:]) < 2.5
