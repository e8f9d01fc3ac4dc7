"""The step with any springs, none at all, or impossible ones, in any pose: it answers or holds, nothing escapes."""

from __future__ import annotations

import ast
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

import counterflex
from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.model.description import ElasticRegion
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.state.supervisor import State
from counterflex_lab.faults.demonstration import demo_cell, force_only

CHAIN = demo_cell().chain
SOURCES = Path(counterflex.__file__).parent
GOOD = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
ARMING, CYCLES = 15, 60


def springs(values: Float) -> ElasticChain:
    return dataclasses.replace(CHAIN, compliance=values)


def corrected(chain: ElasticChain, q: Float) -> tuple[list[State], Float]:
    """States and corrections: armed in a good pose, from ARMING on in another one, while a force rises."""
    loop = Loop(chain, force_only(), demo_cell().T_base_part)
    states, sent = [], []
    for k in range(CYCLES):
        loop.feed(
            CycleInputs(
                T_part_tcp=pose.make(rotation.about_x(np.pi), np.array([1e-4 * k, 0.0, 0.0])),
                q=GOOD if k < ARMING else q,
                w_tcp_part=np.r_[20.0, 5.0 * k, -50.0, 1.0, 0.0, 0.5],
                arm=k == 2,
                enable=k > 5,
            )
        )
        loop.run()
        states.append(State(int(loop.state)))
        sent.append(loop.correction.copy())
    return states, np.array(sent)


ANGLES = st.tuples(
    *(st.floats(low, high) for low, high in ((-3, 3), (-2.3, -0.1), (-1.9, 2.6), (-3, 3), (-2, 2), (-3, 3)))
)


@settings(max_examples=15, deadline=None)
@given(
    hnp.arrays(np.float64, CHAIN.compliance.shape, elements=st.sampled_from([0.0, 1e-12, 1e-8, 1e-6])),
    ANGLES,
    st.booleans(),
)
def test_semidefinite_springs_in_any_pose(values: Float, q: tuple[float, ...], stretched: bool) -> None:
    """Rigid in any direction, or very soft; with the wrist stretched, where the Jacobian is singular, it holds."""
    angles = np.array(q)
    if stretched:
        angles[4] = 0.0
    states, sent = corrected(springs(values), angles)
    assert np.isfinite(sent).all()
    assert np.linalg.norm(sent[:, :3], axis=1).max() <= force_only().translation.radius * (1.0 + 1e-9)
    assert states[ARMING - 1] == State.ACTIVE
    if stretched:
        assert State.ACTIVE not in states[ARMING:]
        assert np.ptp(sent[ARMING:], axis=0).max() <= np.abs(sent[ARMING]).max() + 1e-4
    C = cartesian_compliance(springs(values), angles)
    np.testing.assert_allclose(C, C.T, atol=1e-12 * max(1.0, float(np.abs(C).max())))
    assert np.linalg.eigvalsh(0.5 * (C + C.T)).min() >= -1e-9 * float(np.abs(C).max())


def test_all_rigid_corrects_nothing_and_goes_on() -> None:
    states, sent = corrected(springs(np.zeros_like(CHAIN.compliance)), GOOD)
    assert State.ACTIVE in states
    assert not {State.HOLD, State.FAULT} & set(states)
    assert np.abs(sent).max() == 0.0


def test_the_loop_corrects_with_the_compliance_of_the_posture() -> None:
    """Where a spring is softer by region, as with that spring softer everywhere; not as with the mean."""
    i = CHAIN.names.index("axis1")
    soft = CHAIN.compliance.copy()
    soft[i, 5] *= 2.5
    region = ElasticRegion("axis1", 5, 1, (GOOD[1] - 0.2, GOOD[1] + 0.2), (2.0, 3.0))
    changing = corrected(dataclasses.replace(CHAIN, regions=(region,)), GOOD)[1]
    np.testing.assert_allclose(changing, corrected(springs(soft), GOOD)[1], atol=1e-12)
    assert np.abs(changing - corrected(CHAIN, GOOD)[1]).max() > 5e-6


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-6, -1e-3, 1e3])
def test_impossible_springs_neither_escape_nor_reach_the_robot(value: float) -> None:
    """What the checks of the chain refuse, put in behind them."""
    values = CHAIN.compliance.copy()
    values[1, 5] = value
    _, sent = corrected(springs(values), GOOD)
    assert np.isfinite(sent).all()
    assert np.linalg.norm(sent[:, :3], axis=1).max() <= force_only().translation.radius * (1.0 + 1e-9)


def test_the_compiled_step_factors_no_matrix() -> None:
    """No kernel of loop or chain calls linear algebra that can fail: stiffness is never formed, nothing is inverted."""
    sources = [*(SOURCES / "runtime").rglob("*.py"), *(SOURCES / "robot").rglob("*.py")]
    kernels = [file for file in sources if "jit import kernel" in file.read_text(encoding="utf-8")]
    assert len(kernels) > 30
    allowed = {"norm"}
    for file in kernels:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Attribute)
                and node.value.attr == "linalg"
            ):
                assert node.attr in allowed, f"{file.name}:{node.lineno}"
