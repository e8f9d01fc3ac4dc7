"""Compliance that depends on posture: held-out pulls are met better with regions, plain cells no worse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import read_cell
from counterflex.identify.data.changes import ElementCompliance, ElementRegion
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.arm_geometry import displaced_arm
from counterflex.identify.geometry.compliances import springs
from counterflex.identify.pulls.blocks import block, layout
from counterflex.identify.pulls.pulls import read_pulls
from counterflex.identify.pulls.residuals import PullShape
from counterflex.identify.recipe import Identification
from counterflex.identify.stiffness import recipe as stiffness
from counterflex.identify.stiffness.piecewise_compliance import BLEND_RAD
from counterflex.robot.elasticity.chain import forward_elastic
from counterflex.robot.elasticity.compliance import deflection
from counterflex.robot.model.description import ComplianceCurve, ElasticRegion
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.other import GearCurve
from counterflex.twin.truth.perturb import perturbed
from counterflex.twin.truth.truth import CuttingTruth

CELL = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_flat.toml"
TRUE = ElasticRegion("axis2", 5, 1, (-100 * DEG, -78 * DEG, -62 * DEG, -40 * DEG), (0.7, 0.7, 1.35, 1.35))
SIGMA = 5.0 * UM
FIT, JUDGE = 80, 60
SEEDS, PLAIN = (21, 22, 23, 24), (21, 22)


@cache
def cell() -> CellModel:
    found = model_of(read_cell(CELL))
    return replace(found, robot=replace(found.robot, play=None))


def pulls(
    seed: int, count: int, regions: tuple[ElasticRegion, ...], draw: int, gears: tuple[GearCurve, ...] = ()
) -> Dataset:
    """Pulls of a cell whose elements are 10 % off, at random in space, statics of the simulated cell."""
    cutting = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.25, 0.25))
    nominal = nominal_truth(cell().nominal_robot, cell().nominal_end_effector, cutting)
    truth = perturbed(nominal, seed)
    truth = replace(truth, regions=regions, other=replace(truth.other, gears=gears))
    plant = Plant(truth, friction=False)
    rng = np.random.default_rng(1000 * seed + draw)
    low, high = np.array([-60, -100, 60, -120, 25, -150]) * DEG, np.array([60, -40, 130, 120, 80, 150]) * DEG
    q = rng.uniform(low, high, (count, 6))
    axes = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]])
    f = 750.0 * axes[rng.integers(0, 5, count)]
    d = np.zeros((count, 3))
    for i in range(count):
        load = np.concatenate([f[i], np.zeros(3)])
        d[i] = (plant.equilibrium(q[i], load) - plant.equilibrium(q[i]))[:3, 3]
    d += SIGMA * rng.standard_normal(d.shape)
    return of_arrays("pulls", "pulls", {"q": q, "f_tcp_base": f, "d_tcp_base": d}, {"d_tcp_base": SIGMA})


@cache
def found(seed: int, changing: bool, regions: bool) -> tuple[Identification, Dataset]:
    true = (TRUE,) if changing else ()
    judge = pulls(seed, JUDGE, true, 1)
    result = stiffness.RECIPE.identify(cell(), [pulls(seed, FIT, true, 0)], [judge], {"regions": regions})
    return result, judge


def unexplained(seed: int, changing: bool, regions: bool) -> float:
    figures = {f.name: f.value for f in found(seed, changing, regions)[0].headline}
    return figures["holdout_unexplained_percent"]


@pytest.mark.long
def test_posture_dependent_compliance_is_met_better_and_plain_cells_no_worse() -> None:
    """Seeds 101 to 108: 0.32 to 0.74 of the error without regions, mean 0.47; what bearings do stays.

    Each must be better; the mean of four is below 0.7, by its scatter (0.13 of one seed) above 2 standard deviations of
    what is expected, and below the 0.74 that half the effect would leave.
    """
    for seed in SEEDS:
        assert unexplained(seed, True, True) < 0.9 * unexplained(seed, True, False)
    shares = [unexplained(seed, True, True) / unexplained(seed, True, False) for seed in SEEDS]
    assert sum(shares) < 0.7 * len(SEEDS)
    for seed in PLAIN:
        assert unexplained(seed, False, True) < 1.05 * unexplained(seed, False, False)


def test_what_goes_into_the_cell_file_is_what_was_there() -> None:
    regions = [c.region for c in found(21, True, True)[0].changes if isinstance(c, ElementRegion)]
    first = regions[0]
    assert isinstance(first, ElasticRegion)
    assert (first.segment, first.direction, first.axis) == ("axis2", 5, 1)
    assert min(first.factors) == pytest.approx(0.7, abs=0.12)
    assert max(first.factors) == pytest.approx(1.35, abs=0.15)
    assert not any(isinstance(c, ElementRegion) for c in found(21, False, True)[0].changes)


def as_written(result: Identification) -> CellModel:
    """The cell with what was found, as its file would have it."""
    before = cell()
    soft: Mapping[str, Float] = {c.segment: c.compliance for c in result.changes if isinstance(c, ElementCompliance)}
    new = [c.region for c in result.changes if isinstance(c, ElementRegion)]
    regions = tuple(r for r in new if isinstance(r, ElasticRegion))
    curves = tuple(r for r in new if isinstance(r, ComplianceCurve))

    def changed(segments: tuple) -> tuple:  # type: ignore[type-arg]
        return tuple(replace(s, compliance=soft.get(s.name, s.compliance)) for s in segments)

    robot = replace(before.robot, segments=changed(before.robot.segments), regions=(*before.robot.regions, *regions))
    robot = replace(robot, curves=curves)
    return replace(
        before,
        robot=robot,
        end_effector=replace(before.end_effector, segments=changed(before.end_effector.segments)),
    )


def test_the_plans_model_meets_the_pulls_as_the_identification_said() -> None:
    """The error of the written cell's own chain on held-out pulls is the one of the headline."""
    errors = {}
    for regions in (False, True):
        result, judge = found(22, True, regions)
        q, f, d = (judge.values(name) for name in ("q", "f_tcp_base", "d_tcp_base"))
        w = np.hstack([f, np.zeros((len(f), 3))])
        model = deflection(as_written(result).chain, q, w, gravity=True, equilibrium=True)[:, :3]
        errors[regions] = 100.0 * float(np.sum(np.linalg.norm(d - model, axis=1)) / np.sum(np.linalg.norm(d, axis=1)))
        assert errors[regions] == pytest.approx(unexplained(22, True, regions), rel=0.1)
    assert errors[True] < 0.9 * errors[False]


GEARS = (
    GearCurve(0, (800.0, 4000.0), (0.5, 1.0, 1.2), 0.0, 0.0, 1e-5),
    GearCurve(1, (700.0, 2500.0), (0.5, 1.0, 1.2), 0.0, 0.0, 1e-5),
)
"""Gears that are half as stiff below a fifth of their largest torque."""


@pytest.mark.long
def test_gears_that_stiffen_with_the_load_are_met_in_the_cell_file_too() -> None:
    """Seeds 31, 32: error on pulls not used with curves over that without; the written cell's chain has the same."""
    for seed in (31, 32):
        fit, judge = pulls(seed, FIT, (), 0, GEARS), pulls(seed, JUDGE, (), 1, GEARS)
        left = {}
        for regions in (False, True):
            result = stiffness.RECIPE.identify(cell(), [fit], [judge], {"regions": regions})
            q, f, d = (judge.values(name) for name in ("q", "f_tcp_base", "d_tcp_base"))
            w = np.hstack([f, np.zeros((len(f), 3))])
            model = deflection(as_written(result).chain, q, w, gravity=True, equilibrium=True)[:, :3]
            off = 100.0 * float(np.sum(np.linalg.norm(d - model, axis=1)) / np.sum(np.linalg.norm(d, axis=1)))
            figures = {figure.name: figure.value for figure in result.headline}
            assert off == pytest.approx(figures["holdout_unexplained_percent"], rel=0.1)
            left[regions] = off
        curves = [c.region for c in result.changes if isinstance(c, ElementRegion)]
        assert any(isinstance(c, ComplianceCurve) and c.segment in ("axis1", "axis2") for c in curves)
        assert left[True] < 0.8 * left[False]


def test_a_second_identification_starts_from_the_regions_of_the_first() -> None:
    """Its nominal error is the identified one of the first, and it finds nothing more to change."""
    result, judge = found(21, True, True)
    again = stiffness.RECIPE.identify(as_written(result), [pulls(21, FIT, (TRUE,), 0)], [judge], {"regions": True})
    nominal = next(f.nominal for f in again.headline if f.name == "holdout_unexplained_percent")
    assert nominal == pytest.approx(unexplained(21, True, True), rel=0.1)
    first = sum(isinstance(c, ElementRegion) for c in result.changes)
    assert sum(isinstance(c, ElementRegion) for c in again.changes) <= first - 1 or first == 1


def test_halves_are_joined_without_a_step() -> None:
    region = next(c.region for c in found(21, True, True)[0].changes if isinstance(c, ElementRegion))
    assert isinstance(region, ElasticRegion)
    slopes = np.abs(np.diff(region.factors) / np.diff(region.angles_rad))
    assert np.max(slopes) <= np.ptp(region.factors) / BLEND_RAD * 1.001


def test_shapes_on_one_spring_multiply_with_exact_derivatives() -> None:
    chain = cell().chain
    data = pulls(3, 8, (), 0)
    read = read_pulls(chain, data)
    plan = layout(chain, springs(chain, {}), [read])
    n = len(plan.parameters)
    rng = np.random.default_rng(0)
    shapes = (PullShape(1, n, rng.uniform(-0.5, 0.5, 8)), PullShape(1, n + 1, rng.uniform(-0.5, 0.5, 8)))
    rows = replace(block(chain, plan, read, None), shapes=shapes)
    x = np.append(plan.parameters.nominal, [0.4, -0.3])
    grown = (1.0 + 0.4 * shapes[0].phi) * (1.0 - 0.3 * shapes[1].phi)
    plain = replace(rows, shapes=())
    J = plain.jacobian(x)[:, :, rows.columns[1]] * x[rows.columns[1]] * (grown - 1.0)[:, None]
    np.testing.assert_allclose(rows.evaluate(x) - plain.evaluate(x), J, rtol=1e-9, atol=1e-12)
    step = 1e-6
    for column in (n, n + 1):
        up, down = (rows.evaluate(x + s * step * np.eye(n + 2)[column]) for s in (1.0, -1.0))
        np.testing.assert_allclose(rows.jacobian(x)[:, :, column], (up - down) / (2 * step), rtol=1e-6, atol=1e-7)


def test_the_sag_of_a_calibration_is_that_of_the_plan() -> None:
    """Both arms hang under their own weight with the compliance of each posture."""
    region = ElasticRegion("axis2", 5, 1, (-2.0, -0.5), (2.0, 0.5))
    chain = replace(cell().chain, regions=(region,))
    q = pulls(3, 8, (), 0).values("q")
    found = displaced_arm(chain, q).poses(np.zeros(0))[:, :3, 3]
    want = forward_elastic(chain, q, gravity=True, equilibrium=True)[:, :3, 3]
    plain = forward_elastic(cell().chain, q, gravity=True, equilibrium=True)[:, :3, 3]
    assert np.max(np.linalg.norm(want - plain, axis=1)) > 100.0 * UM
    np.testing.assert_allclose(found, want, atol=2.0 * UM)
