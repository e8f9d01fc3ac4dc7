"""Natural frequencies: closed forms, and inertia from an independent dynamics library."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
import scipy.linalg

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.plan.elastic_motion import DENSITY_KG_M3, coordinates, matrices
from counterflex.plan.lowest_mode import ASSUMED_DAMPING, RIGID_HZ, assumed_masses, can_move, mode_of
from counterflex.plan.modes import (
    ModelSpread,
    drawn_frequencies,
    frequency_response,
    kinetic_shares,
    lowest_mode,
    modes,
)
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Servo
from counterflex.signals.preview import Mode
from elastic_equations import DOUBLE, walk

POSTURES = [np.array([0.2, -1.4, 1.9, 0.3, 0.7, -0.4]), np.array([-0.9, -0.8, 1.2, -1.1, 1.3, 0.5])]
TAPPED = Mode(50.0, 0.05)


@pytest.fixture(scope="module")
def arm() -> ElasticChain:
    return ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"))


def inertia_by_pinocchio(chain: ElasticChain, q: Float) -> Float:
    """Each elastic coordinate as a joint of its own, the drives held at q."""
    model, parent, place = pinocchio.Model(), 0, pinocchio.SE3.Identity()
    segment, direction, sign = coordinates(chain)
    added = []
    for i in range(chain.n):
        place = place * pinocchio.SE3(chain.fixed[i])
        if chain.joint[i] >= 0:
            angle = chain.sign[i] * q[chain.joint[i]] + chain.offset[i]
            place = place * pinocchio.SE3(pinocchio.utils.rotate("z", angle), np.zeros(3))
        for k in np.flatnonzero(segment == i):
            axis = np.eye(3)[direction[k] % 3] * sign[k]
            kind = pinocchio.JointModelPrismaticUnaligned if direction[k] < 3 else pinocchio.JointModelRevoluteUnaligned
            parent = model.addJoint(parent, kind(axis), place, f"c{k}")
            added.append(k)
            place = pinocchio.SE3.Identity()
        if chain.mass[i] > 0.0:
            radius = (0.75 * chain.mass[i] / (math.pi * DENSITY_KG_M3)) ** (1.0 / 3.0)
            ball = 0.4 * float(chain.mass[i]) * radius**2 * np.eye(3)
            model.appendBodyToJoint(parent, pinocchio.Inertia(float(chain.mass[i]), chain.com[i], ball), place)
    M = pinocchio.crba(model, model.createData(), np.zeros(model.nq))
    upper = np.triu(M)
    M = upper + upper.T - np.diag(np.diag(upper))
    back = np.argsort(added)
    out: Float = M[np.ix_(back, back)]
    return out


@pytest.mark.parametrize("q", POSTURES)
def test_frequencies_and_shapes_are_those_of_an_independent_library(q: Float, arm: ElasticChain) -> None:
    found = modes(*matrices(arm, q)[:2])
    soft = matrices(arm, q)[1] < 1e11
    M, K = inertia_by_pinocchio(arm, q)[np.ix_(soft, soft)], np.diag(matrices(arm, q)[1][soft])
    value, vector = scipy.linalg.eigh(K, M)
    assert 4.0 < math.sqrt(value[0]) / (2.0 * math.pi) < 40.0
    np.testing.assert_allclose(found.omega_rad_s[:8], np.sqrt(value[:8]), rtol=1e-6)
    for k in range(4):
        mine, theirs = found.shapes[soft, k], vector[:, k]
        assert abs(mine @ K @ theirs) / math.sqrt((mine @ K @ mine) * (theirs @ K @ theirs)) == pytest.approx(
            1.0, abs=1e-6
        )


def test_two_masses_in_a_row() -> None:
    """M x1'' = -k x1 + k (x2 - x1), m x2'' = -k (x2 - x1): omega^2 = (3 -+ sqrt 5) / 2 k / m, in spring coordinates."""
    m, k = 3.0, 700.0
    M = m * np.array([[2.0, 1.0], [1.0, 1.0]])
    found = modes(M, np.array([k, k]))
    np.testing.assert_allclose(found.omega_rad_s**2, (3.0 + np.array([-1.0, 1.0]) * math.sqrt(5.0)) / 2.0 * k / m)
    np.testing.assert_allclose(found.strain.sum(axis=0), 1.0)


def test_rigid_and_massless_coordinates_drop_out() -> None:
    M = np.diag([2.0, 0.0, 5.0])
    np.testing.assert_allclose(modes(M, np.array([8.0, 3.0, np.inf])).omega_rad_s, [2.0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_spring_swings_as_a_pendulum(axis: int, arm: ElasticChain) -> None:
    """All elements rigid but one axis: omega^2 = k / I, with I about the axis by parallel axes."""
    q, k = POSTURES[0], 2.0e6
    compliance = np.zeros_like(arm.compliance)
    segment = int(arm.torsion[axis])
    compliance[segment, 5] = 1.0 / k
    alone = replace(arm, compliance=compliance)
    T, about = rigid_frames(alone, q), 0.0
    z, p = T[segment][:3, 2], T[segment][:3, 3]
    for body in range(segment, arm.n):
        r = (T[body] @ np.append(arm.com[body], 1.0))[:3] - p
        radius = (0.75 * arm.mass[body] / (math.pi * DENSITY_KG_M3)) ** (1.0 / 3.0)
        about += arm.mass[body] * (np.linalg.norm(np.cross(z, r)) ** 2 + 0.4 * radius**2)
    assert modes(*matrices(alone, q)[:2]).omega_rad_s[0] == pytest.approx(math.sqrt(k / about), rel=1e-6)


def rigid_frames(chain: ElasticChain, q: Float) -> Float:
    R, p = walk(chain, q, None, DOUBLE)
    out = np.tile(np.eye(4), (chain.n, 1, 1))
    for i in range(chain.n):
        out[i, :3, :3], out[i, :3, 3] = np.array(R[i], dtype=float), np.array(p[i], dtype=float)
    return out


def test_drawn_frequencies_follow_the_energies(arm: ElasticChain) -> None:
    """Small spreads: ``d ln f = (sum s d ln k - sum t d ln m) / 2`` with the shares of the energies."""
    q, small = POSTURES[1], 0.02
    M, stiffness = matrices(arm, q)[:2]
    free = modes(M, stiffness)
    kinetic = kinetic_shares(arm, q, free.shapes[:, :1])[:, 0]
    assert kinetic.sum() == pytest.approx(1.0)
    for common in (0.0, 0.5):
        springs = small * free.strain[:, 0]
        variance = (1.0 - common) * np.sum(springs**2) + common * np.sum(springs) ** 2 + np.sum((small * kinetic) ** 2)
        spread = ModelSpread(np.full(len(stiffness), small), np.full(arm.n, small), common)
        drawn = np.log(drawn_frequencies(arm, q, spread, draws=2000)[:, 0])
        assert np.std(drawn) == pytest.approx(0.5 * math.sqrt(variance), rel=0.06)
        assert np.median(drawn) == pytest.approx(math.log(free.omega_rad_s[0]), abs=0.002)


def test_without_spread_every_draw_is_the_robot(arm: ElasticChain) -> None:
    M, stiffness = matrices(arm, POSTURES[0])[:2]
    certain = ModelSpread(np.zeros(len(stiffness)), np.zeros(arm.n), 0.2)
    free = modes(M, stiffness).omega_rad_s
    np.testing.assert_allclose(
        drawn_frequencies(arm, POSTURES[0], certain, draws=3)[:, : len(free)], [free] * 3, rtol=1e-6
    )


@pytest.mark.parametrize("servo", [(None,) * 6, (Servo(3e4, 15.0, 0.05),) * 6])
def test_the_response_peaks_where_the_modes_are_and_begins_at_the_compliance(
    servo: tuple[Servo | None, ...], arm: ElasticChain
) -> None:
    M, stiffness, J, _ = matrices(arm, POSTURES[1])
    lowest = lowest_mode(M, stiffness, 2e-4, servo)
    omega = lowest.omega_rad_s * np.linspace(0.6, 1.3, 1401)
    size = np.linalg.norm(frequency_response(M, stiffness, J, 2e-4, servo, omega)[:, :3, :3], axis=(1, 2))
    peaks = omega[1:-1][(size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])]
    assert np.min(np.abs(peaks / lowest.omega_rad_s - 1.0)) < 2.0 * lowest.damping_ratio**2 + 2e-3
    slow = frequency_response(M, stiffness, J, 2e-4, servo, np.array([1e-4]))[0]
    np.testing.assert_allclose(slow[:3, :3].real, cartesian_compliance(arm, POSTURES[1])[:3, :3], rtol=1e-6, atol=1e-12)


def test_the_response_is_the_sum_of_the_modes(arm: ElasticChain) -> None:
    """Proportional damping: ``sum_k a_k a_k' / (1 - r^2 + i omega beta)`` with r = omega / omega_k."""
    M, stiffness, J, _ = matrices(arm, POSTURES[0])
    free, beta, omega = modes(M, stiffness), 3e-3, np.array([20.0, 75.0, 140.0, 400.0])
    tip = J @ free.shapes
    below = 1.0 - (omega[:, None] / free.omega_rad_s) ** 2 + 1j * omega[:, None] * beta
    summed = np.einsum("ak,bk,fk->fab", tip, tip, 1.0 / below)
    response = frequency_response(M, stiffness, J, beta, (None,) * 6, omega)
    np.testing.assert_allclose(response, summed, rtol=1e-6, atol=1e-9 * np.abs(summed).max())


def test_order_of_what_is_known(arm: ElasticChain) -> None:
    """Masses count before a tap test, a tap test before assumed masses; the damping of a tap test counts always."""
    q = POSTURES[0]
    computed, told = mode_of(arm, q, None), mode_of(arm, q, TAPPED)
    assert computed.damping_ratio == pytest.approx(ASSUMED_DAMPING, rel=1e-6)
    assert told.omega_rad_s == pytest.approx(computed.omega_rad_s, rel=1e-3)
    assert told.damping_ratio == pytest.approx(TAPPED.damping_ratio * told.omega_rad_s / TAPPED.omega_rad_s, rel=1e-6)
    bare = replace(arm, mass=np.zeros(arm.n))
    assert mode_of(bare, q, TAPPED) == TAPPED
    assert mode_of(bare, q, None).omega_rad_s == pytest.approx(computed.omega_rad_s, rel=0.35)
    assert mode_of(replace(bare, compliance=np.zeros_like(arm.compliance)), q, None).hz == pytest.approx(RIGID_HZ)


def test_assumed_masses_stand_only_where_there_are_none(arm: ElasticChain) -> None:
    hand = replace(arm, mass=np.where(np.arange(arm.n) > int(np.flatnonzero(arm.joint >= 0)[4]), arm.mass, 0.0))
    filled = assumed_masses(hand, POSTURES[0])
    assert can_move(filled)
    assert np.all(filled.mass[hand.mass > 0.0] == hand.mass[hand.mass > 0.0])
    assert filled.mass.sum() == pytest.approx(arm.mass.sum(), rel=0.4)


def test_bad_input_is_told() -> None:
    with pytest.raises(InputError, match="above 0"):
        modes(np.eye(2), np.array([1.0, 0.0]))
    with pytest.raises(ModelError, match="no masses"):
        modes(np.zeros((2, 2)), np.ones(2))
