"""Compliances over the load of their spring: the simulated cell's gears, at rest and in motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.app.questions import deflection as deflection_answer
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import Cell
from counterflex.plan.elastic_motion import matrices, motion_along, stiffness_of
from counterflex.plan.elastic_motion_kernel import advance, rest
from counterflex.plan.relative_motion import tool_carried
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance, deflection
from counterflex.robot.elasticity.gravity import weight_loads
from counterflex.robot.model.description import ComplianceCurve
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.other import GearCurve, OtherPhysics
from counterflex.twin.truth.truth import CuttingTruth

Q = np.array([-3.0, -92.0, 123.0, -174.0, 31.0, 175.0]) * DEG
LOAD = np.array([300.0, 200.0, -600.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def plain(cell_of: Callable[..., Cell]) -> ElasticChain:
    return replace(setting_of(cell_of()).chain, play=None, servo=None)


def curve_of(gear: GearCurve) -> ComplianceCurve:
    """Three slopes of a gear as a cell file states them."""
    one, two, (k1, k2, k3) = *gear.torque_nm, gear.share
    loads = (-two - 1.0, -two, -one - 1.0, -one, one, one + 1.0, two, two + 1.0)
    factors = tuple(1.0 / share for share in (k3, k2, k2, k1, k1, k2, k2, k3))
    return ComplianceCurve(f"axis{gear.axis + 1}", 5, loads, factors)


@pytest.mark.parametrize("axis", [1, 2, 4])
def test_gears_of_the_simulated_cell_move_the_tool_as_their_curve_says(axis: int, cell_of: Callable[..., Cell]) -> None:
    """The engine takes torque over wind-up, the model wind-up over torque; loads lie on both sides of a knee."""
    cell = cell_of()
    robot, tool = replace(cell.robot, play=None, servo=None), cell.end_effector
    chain = replace(cell.chain, play=None, servo=None)
    weight = float(weight_loads(chain, Q)[chain.torsion[axis], 5])
    knee = max(30.0, abs(weight) + 60.0)
    gear = GearCurve(axis, (knee, 2.5 * knee), (0.5, 1.0, 1.3), 0.0, 0.0, 1e-5)
    cutting = CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.25, 0.25))
    truth = replace(nominal_truth(robot, tool, cutting), other=OtherPhysics(gears=(gear,)))
    plant = Plant(truth, friction=False)
    known = replace(chain, curves=(curve_of(gear),))
    for load in (LOAD, -LOAD, 0.2 * LOAD):
        moved = (plant.equilibrium(Q, load) - plant.equilibrium(Q))[:3, 3]
        model = deflection(known, Q, load, gravity=True, equilibrium=True)[:3]
        mean = deflection(chain, Q, load, gravity=True, equilibrium=True)[:3]
        assert np.linalg.norm(model - moved) < 0.05 * np.linalg.norm(mean - moved) + 2.0 * UM
    assert np.linalg.norm(mean - moved) > 4.0 * UM  # else the curve would not have been looked at


def test_one_factor_at_all_loads_is_another_compliance(plain: ElasticChain) -> None:
    curve = ComplianceCurve("axis2", 5, (-100.0, 100.0), (1.7, 1.7))
    i = plain.names.index("axis2")
    soft = plain.compliance.copy()
    soft[i, 5] *= 1.7
    curved, scaled = replace(plain, curves=(curve,)), replace(plain, compliance=soft)
    want = cartesian_compliance(scaled, Q)
    assert cartesian_compliance(curved, Q, LOAD) == pytest.approx(want, rel=1e-9, abs=1e-18)
    assert cartesian_compliance(curved, Q) == pytest.approx(cartesian_compliance(plain, Q), rel=1e-12)
    assert deflection(curved, Q, LOAD, nonlinear=False) == pytest.approx(want @ LOAD, rel=1e-9)
    assert deflection(curved, Q, LOAD)[:3] == pytest.approx(deflection(scaled, Q, LOAD)[:3], abs=5.0 * UM)
    assert stiffness_of(curved, Q[None], LOAD[None]) == pytest.approx(stiffness_of(scaled, Q[None]), rel=1e-9)


def test_the_robot_in_motion_settles_where_the_curve_has_it(plain: ElasticChain) -> None:
    chain = replace(plain, curves=(ComplianceCurve("axis2", 5, (-3000.0, 0.0, 3000.0), (0.3, 3.0, 0.3)),))
    rows = 41
    time, q = np.linspace(0.0, 4.0, rows), np.tile(Q, (rows, 1))
    motion = motion_along(chain, tool_carried(np.eye(4)), q, q, time, w_tcp_base=np.tile(LOAD, (rows, 1)))
    rest(motion, 0)
    out = np.zeros(6)
    for row in range(1, rows):
        advance(motion, row, float(time[row]), LOAD, out)
    want = cartesian_compliance(chain, Q, LOAD) @ LOAD
    assert np.linalg.norm(want[:3] - (cartesian_compliance(chain, Q) @ LOAD)[:3]) > 50.0 * UM
    assert np.linalg.norm(out[:3] - want[:3]) < 2.0 * UM
    assert (matrices(chain, Q)[2] / stiffness_of(chain, Q[None], LOAD[None])[0]) @ matrices(chain, Q)[2].T == (
        pytest.approx(cartesian_compliance(chain, Q, LOAD), rel=1e-9)
    )


def test_an_answer_names_what_it_takes_the_mean_of(plain: ElasticChain) -> None:
    curve = ComplianceCurve("axis2", 5, (-3000.0, 0.0, 3000.0), (0.3, 3.0, 0.3))
    ask = ([0.0, -95.0, 125.0, 0.0, -30.0, 0.0], [0.0, 500.0, 0.0], [0.0, 0.0, 0.0])
    assert "compliance_curve" not in str(deflection_answer(plain, *ask)["warnings"])
    assert "mean of [[robot.compliance_curve]] of axis2" in str(
        deflection_answer(replace(plain, curves=(curve,)), *ask)["warnings"]
    )
