"""The prior of a robot's class covers robots that it was not made from: their axes, and what they yield at the tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import read_cell
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain, axis_deflections, forward, jacobian
from counterflex.robot.model import catalog
from counterflex.robot.model.class_prior import AXES, ClassPrior, class_prior, published
from counterflex.robot.model.description import EndEffector

EXAMPLES = Path(__file__).parents[2] / "examples"
ALL = tuple(range(AXES))
KR300 = ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"))
USED = [row for row in published() if row.used]
TYPES = sorted({row.robot for row in USED})


def without(robot: str, payload_kg: float, reach_m: float) -> ClassPrior:
    """The prior as it would be had this type not been published."""
    return class_prior(payload_kg, reach_m, [row for row in USED if row.robot != robot])


def interval(prior: ClassPrior, chain: ElasticChain, q: Float, w: Float) -> Float:
    """90 % interval (2, n, 3) of the displacement under wrenches (n, 6), base axes."""
    per_stiffness = axis_deflections(chain, q, w, ALL)
    drawn = np.einsum("ra,nad->rnd", 1.0 / prior.drawn(2000, seed=1), per_stiffness)
    out: Float = np.quantile(drawn, [0.05, 0.95], axis=0)
    return out


def unit_forces(q: Float) -> tuple[Float, Float]:
    w = np.zeros((3, 6))
    w[:, :3] = np.eye(3)
    return np.tile(q, (3, 1)), w


def test_nine_of_ten_axes_of_a_robot_that_was_left_out_lie_in_its_interval() -> None:
    z = []
    for row in USED:
        prior = without(row.robot, row.payload_kg, row.reach_m)
        off = np.log(row.stiffness_nm_per_rad / prior.median_nm_per_rad) / np.log(prior.factor)
        z += off[np.isfinite(off)].tolist()
    assert len(z) == 36
    inside = np.mean(np.abs(z) < 1.0)
    assert 0.85 <= inside <= 0.97
    assert 0.25 < np.median(np.abs(z)) < 0.55  # 0.41 where the spread is right: neither too narrow nor too wide


def test_pulls_at_a_robot_that_was_left_out_lie_in_their_interval() -> None:
    folder = EXAMPLES / "data" / "fanuc_r2000ic_stiffness"
    q, force, moved = (
        np.loadtxt(folder / name, delimiter=",", skiprows=1)
        for name in ("joint_angles.csv", "forces.csv", "deltaX.csv")
    )
    q, force, moved = q[:, -6:], force[:, -3:], moved[:, -3:]
    q[:, 2] += q[:, 1]  # the pendant's third angle, see the manifest
    chain = read_cell(EXAMPLES / "cells" / "fanuc_r2000ic.toml").chain
    prior = without("FANUC R-2000iC", 210.0, 2.655)
    per_stiffness = axis_deflections(chain, q, np.concatenate([force, np.zeros_like(force)], axis=1), ALL)
    drawn = np.linalg.norm(np.einsum("ra,nad->rnd", 1.0 / prior.drawn(1000, seed=1), per_stiffness), axis=2)
    size = np.linalg.norm(moved, axis=1)
    low, high = np.quantile(drawn, [0.05, 0.95], axis=0)
    assert np.mean((low < size) & (size < high)) >= 0.9
    assert 0.5 < np.median(drawn.mean(axis=1)) / size.mean() < 2.0


def test_compliance_published_of_the_kr_500_lies_in_its_interval() -> None:
    """Denkena2015: 1.8, 0.5 and 1.1 um/N tangential to axis 1, radial and axial, in the centre of the working space."""
    chain = ElasticChain.build(catalog.load("kuka_kr500_r2830"))
    q, w = unit_forces(np.array([0.0, -60.0, 90.0, 0.0, 60.0, 0.0]) * DEG)
    low, high = interval(without("KUKA KR 500", 500.0, 2.826), chain, q, w)
    for axis, published_um in ((1, 1.8), (0, 0.5), (2, 1.1)):
        assert low[axis, axis] < published_um * UM < high[axis, axis]


def test_whole_model_of_the_kr_300_lies_in_its_interval() -> None:
    prior = without("KUKA KR 300 R2500 ultra", 300.0, 2.496)
    for angles in ((0, -90, 120, 0, 40, 0), (0, -60, 90, 0, 60, 0), (30, -100, 120, 20, 60, 0)):
        q, w = unit_forces(np.array(angles) * DEG)
        low, high = interval(prior, KR300, q, w)
        C = compliance.cartesian_compliance(KR300, q[0])
        for axis in range(3):
            assert low[axis, axis] < C[axis, axis] < high[axis, axis]


def test_springs_of_the_whole_arm_follow_from_the_published_elements() -> None:
    """The first row of the data: six springs about the axes that fit the compliance of all of Haehn's elements."""
    rng = np.random.default_rng(0)
    rows: list[Float] = []
    low, high = np.array([[-40, -110, 60, -60, -100, -90], [40, -40, 130, 60, 100, 90]]) * DEG
    tip = np.eye(4)
    tip[:3, 3] = 0.25, 0.0, 0.2
    chain = ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"), EndEffector((), tip))
    while len(rows) < 200:
        q = rng.uniform(low, high)
        place = forward(KR300, q)[:3, 3]
        if 0.3 < place[2] < 1.8 and 1.0 < np.hypot(place[0], place[1]) < 2.3:
            rows.append(q)
    J, C = jacobian(chain, np.array(rows))[:, :3], compliance.cartesian_compliance(chain, np.array(rows))[:, :3, :3]
    A = np.einsum("pai,pbi->pabi", J, J).reshape(-1, AXES)
    springs, left = nnls(A, C.ravel())
    row = next(row for row in USED if row.robot == "KUKA KR 300 R2500 ultra")
    np.testing.assert_allclose(1.0 / springs, row.stiffness_nm_per_rad, rtol=0.1)
    assert 0.1 < left / np.linalg.norm(C) < 0.2


def test_a_larger_robot_is_stiffer_and_a_foreign_size_is_known_worse() -> None:
    known, small, large = class_prior(270.0, 2.7), class_prior(40.0, 2.55), class_prior(500.0, 2.8)
    assert np.all(small.median_nm_per_rad < known.median_nm_per_rad)
    assert np.all(known.median_nm_per_rad < large.median_nm_per_rad)
    assert np.all(small.factor > 1.1 * known.factor)


def test_drawn_robots_have_the_median_and_the_spread() -> None:
    prior = class_prior(185.0, 2.8)
    k = prior.drawn(20_000, seed=3)
    np.testing.assert_allclose(np.median(k, axis=0), prior.median_nm_per_rad, rtol=0.03)
    inside = (k > prior.median_nm_per_rad / prior.factor) & (k < prior.median_nm_per_rad * prior.factor)
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.01)
    assert abs(np.corrcoef(np.log(k[:, 0]), np.log(k[:, 3]))[0, 1] - prior.common) < 0.03


@pytest.mark.parametrize(("payload", "said"), [(10.0, "payload 10 kg"), (None, "payload of the robot is not known")])
def test_small_arms_and_unknown_payloads_have_no_class(payload: float | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        class_prior(payload, 1.45)


def test_every_row_says_where_it_comes_from() -> None:
    assert all(len(row.source) > 20 for row in published())
    assert {row.robot for row in published() if not row.used} == {
        "KUKA KR 300 R2500 ultra",  # once more, its axes alone
        "KUKA KR 240-2",
        "KUKA KR 270",
    }
    assert len(TYPES) == 4
