"""Compliances that differ by region of the joint space: every kernel against the plain equations, and no step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import elastic_equations as equations
from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG, UM
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance, deflection, shares
from counterflex.robot.elasticity.gravity import sag
from counterflex.robot.model import catalog
from counterflex.robot.model.description import ElasticRegion
from counterflex.robot.model.elastic_region import beyond_regions, factor, growth
from online_step import ElasticStep

REGIONS = (
    ElasticRegion("axis2", 5, 1, (-1.9, -1.7, -1.5, -1.3), (0.7, 0.7, 1.4, 1.4)),
    ElasticRegion("axis2", 5, 2, (1.3, 2.0), (1.2, 0.8)),
    ElasticRegion("spindle", 0, 5, (-2.0, 0.0, 2.5), (1.5, 0.6, 1.1)),
    ElasticRegion("spindle", 3, 4, (0.6, 1.5), (0.5, 1.8)),
)


@pytest.fixture(scope="module")
def changing(heavy: ElasticChain) -> ElasticChain:
    return replace(heavy, regions=REGIONS)


def at(chain: ElasticChain, q: Float) -> ElasticChain:
    """A plain chain with the compliances that a changing one has in one posture."""
    return replace(chain, compliance=chain.compliance_at(q), regions=())


def test_the_step_equals_the_equations(changing: ElasticChain, poses: Float, wrenches: Float) -> None:
    step = ElasticStep(changing)
    for q, w in zip(poses[:12], wrenches[:12], strict=True):
        want = equations.step(changing, q, w, equations.DOUBLE)
        assert step(q, w) == want.status
        np.testing.assert_allclose(step.C, want.C.astype(float), rtol=1e-11, atol=1e-18)
        np.testing.assert_allclose(step.d, want.d.astype(float), atol=1e-14)
        np.testing.assert_allclose(step.residual, want.residual.astype(float), atol=1e-12)
        np.testing.assert_allclose(step.q_c, want.q_c.astype(float), atol=1e-10)


def test_every_form_is_that_of_a_chain_with_the_compliance_of_the_posture(
    changing: ElasticChain, poses: Float, wrenches: Float
) -> None:
    for q, w in zip(poses[:6], wrenches[:6], strict=True):
        still = at(changing, q)
        np.testing.assert_allclose(cartesian_compliance(changing, q), cartesian_compliance(still, q), rtol=1e-12)
        for gravity in (False, True):
            for equilibrium in (False, True):
                found, want = (deflection(c, q, w, gravity=gravity, equilibrium=equilibrium) for c in (changing, still))
                np.testing.assert_allclose(found, want, rtol=1e-9, atol=1e-13)
        np.testing.assert_allclose(sag(changing, q), sag(still, q), rtol=1e-9, atol=1e-13)
        np.testing.assert_allclose(np.sum(shares(changing, q, w), axis=0), cartesian_compliance(still, q) @ w)


def test_large_batches_equal_small_ones(changing: ElasticChain, poses: Float, wrenches: Float) -> None:
    """Kernels that take many points at once know no regions: they are not asked."""
    q, w = np.tile(poses, (501, 1)), np.tile(wrenches, (501, 1))
    np.testing.assert_array_equal(deflection(changing, q, w)[:400], deflection(changing, poses, wrenches))


def test_nothing_steps_on_the_way_through_a_region(changing: ElasticChain, heavy: ElasticChain) -> None:
    """In steps of 0.01 deg through all of the axis: the deflection moves little more than a plain chain's."""
    q = np.tile([0.3, 0.0, 1.7, 0.4, 0.9, -0.2], (14_000, 1))
    q[:, 1] = np.linspace(-2.6, -2.6 + 140.0 * DEG, len(q))
    w = np.array([500.0, 300.0, -800.0, 0.0, 0.0, 0.0])
    largest = {}
    for name, chain in (("plain", heavy), ("regions", changing)):
        d = deflection(chain, q, w)[:, :3]
        largest[name] = float(np.max(np.linalg.norm(np.diff(d, axis=0), axis=1)))
    assert np.max(np.abs(deflection(changing, q, w) - deflection(heavy, q, w))[:, :3]) > 50.0 * UM
    assert largest["regions"] < largest["plain"] + 1.0 * UM


def test_outside_the_angles_measured_the_mean_is_used_and_told(changing: ElasticChain) -> None:
    one = REGIONS[0]
    q = np.zeros((5, 6))
    q[:, 1] = np.array([-1.9 - 10.1 * DEG, -1.9 - 5.0 * DEG, -1.8, -1.6, -1.3 + 11.0 * DEG])
    np.testing.assert_allclose(factor(one, q), [1.0, 0.85, 0.7, 1.05, 1.0], atol=1e-12)
    assert np.all(growth(REGIONS, changing.names, np.zeros(6))[:2] == 1.0)
    assert [text[:26] for text in beyond_regions((one,), q)] == ["axis 2 leaves the angles a"]
    assert beyond_regions((one,), q[2:4]) == []


@pytest.mark.parametrize(
    ("region", "said"),
    [
        (replace(REGIONS[0], segment="axis9"), "names no segment"),
        (replace(REGIONS[0], direction=0), "rigid"),
        (replace(REGIONS[0], axis=6), "spring or axis"),
        (replace(REGIONS[0], angles_rad=(0.0, 0.0, 1.0, 2.0)), "do not rise"),
        (replace(REGIONS[0], factors=(1.0, 1.0)), "as many factors"),
        (replace(REGIONS[0], factors=(1.0, 0.0, 1.0, 1.0)), "not above 0"),
        (replace(REGIONS[0], factors=(1.0, 60.0, 1.0, 1.0)), "too large"),
    ],
)
def test_regions_that_no_robot_has_are_refused(region: ElasticRegion, said: str) -> None:
    robot = replace(catalog.load("kuka_kr300_r2500_ultra"), regions=(region,))
    with pytest.raises(ModelError, match=said):
        ElasticChain.build(robot)


def test_shares_of_many_postures_are_those_of_each(changing: ElasticChain, poses: Float, wrenches: Float) -> None:
    """Each by the compliances of its own posture; together they are the deflection there."""
    n = min(len(poses), len(wrenches))
    many = shares(changing, poses[:n], wrenches[:n])
    for k in range(n):
        np.testing.assert_allclose(
            many[k], shares(at(changing, poses[k]), poses[k], wrenches[k]), rtol=1e-9, atol=1e-15
        )
    C = cartesian_compliance(changing, poses[:n])
    np.testing.assert_allclose(many.sum(axis=1), (C @ wrenches[:n, :, None])[..., 0], rtol=1e-9, atol=1e-15)
