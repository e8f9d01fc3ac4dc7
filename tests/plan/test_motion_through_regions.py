"""The robot in motion where compliances differ by region: statics on the way, no step, nothing moves unloaded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import Cell
from counterflex.plan.elastic_motion import matrices, motion_along
from counterflex.plan.elastic_motion_kernel import advance, rest
from counterflex.plan.relative_motion import tool_carried
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.model.description import ElasticRegion

Q = np.array([-3.0, -92.0, 123.0, -174.0, 31.0, 175.0]) * DEG
LOAD = np.array([300.0, 200.0, -600.0, 0.0, 0.0, 0.0])
REGIONS = (
    ElasticRegion("axis2", 5, 1, tuple(np.array([-110.0, -93.0, -91.0, -70.0]) * DEG), (0.7, 0.7, 1.5, 1.5)),
    ElasticRegion("spindle", 4, 1, tuple(np.array([-110.0, -70.0]) * DEG), (0.6, 1.6)),
)
SWING = 4.0 * DEG
PER_S = 500


@pytest.fixture(scope="module")
def changing(cell_of: Callable[..., Cell]) -> ElasticChain:
    return replace(setting_of(cell_of()).chain, play=None, servo=None, regions=REGIONS)


def along(chain: ElasticChain, load: Float, seconds: float = 4.0, rows: int = 81) -> tuple[Float, Float]:
    """Axis 2 moves by 4 deg under a load; times, angles and deviations (steps, 6), base axes."""
    time = np.linspace(0.0, seconds, rows)
    q = np.tile(Q, (rows, 1))
    q[:, 1] += SWING * (time / seconds - 0.5)
    motion = motion_along(chain, tool_carried(np.eye(4)), q, q, time)
    rest(motion, 0)
    at = np.arange(1, round(seconds * PER_S) + 1) / PER_S
    out, one = np.zeros((len(at), 6)), np.zeros(6)
    for k, until in enumerate(at):
        row = min(int(np.searchsorted(time, until - 1e-9)), rows - 1)
        advance(motion, max(row, 1), until, load, one)
        out[k] = one
    moved = np.stack([np.interp(at, time, q[:, a]) for a in range(6)], axis=1)
    return moved, out


def test_stiffness_is_that_of_the_posture(changing: ElasticChain) -> None:
    for q in (Q, Q + np.array([0.0, 5.0 * DEG, 0.0, 0.0, 0.0, 0.0])):
        _, stiffness, J, _ = matrices(changing, q)
        assert (J / stiffness) @ J.T == pytest.approx(cartesian_compliance(changing, q), rel=1e-9)


def test_it_follows_the_statics_through_a_region_without_a_step(changing: ElasticChain) -> None:
    q, found = along(changing, LOAD)
    settled = len(q) // 2
    statics = np.stack([cartesian_compliance(changing, row) @ LOAD for row in q])
    mean = np.stack([cartesian_compliance(replace(changing, regions=()), row) @ LOAD for row in q])
    assert np.max(np.linalg.norm((statics - mean)[settled:, :3], axis=1)) > 80.0 * UM
    off = np.linalg.norm((found - statics)[settled:, :3], axis=1)
    assert np.max(off) < 15.0 * UM
    steps = np.linalg.norm(np.diff(found[settled:, :3], axis=0), axis=1)
    assert np.max(steps) < 3.0 * UM


def test_weight_alone_moves_nothing_on_the_way(changing: ElasticChain) -> None:
    """The sag of the programmed path is counted elsewhere, that of the regions with it."""
    assert np.abs(along(changing, np.zeros(6), seconds=6.0)[1][:, :3]).max() < 5.0 * UM
