"""Torque of the process from motor currents: own weight against the batch computation, friction by its direction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import Record, records
from counterflex.files.cell.cell import read_cell
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.elasticity.play import axis_torque
from counterflex.runtime.estimator.idle_torque import PRESLIDING_RAD, follow_idle, less_force
from counterflex.runtime.sensing.motor_torque import MotorTorque
from counterflex.runtime.state.memory import STATE

CELLS = sorted((Path(__file__).resolve().parents[2] / "examples" / "cells").glob("*.toml"))


@pytest.mark.parametrize("file", CELLS, ids=lambda file: file.stem)
def test_what_balances_weight_and_force_gives_the_force_back(file: Path) -> None:
    """Motors that hold weight (batch computation, counterbalance included) and a force at the tip: J^T w is left."""
    chain = read_cell(file).chain
    rng = np.random.default_rng(3)
    constants = rng.uniform(50.0, 400.0, 6) * rng.choice([-1.0, 1.0], 6)
    motors, out = MotorTorque(chain, constants), np.zeros(6)
    for q in rng.uniform(-1.2, 1.2, (20, 6)):
        w = rng.uniform(-500.0, 500.0, 6)
        process = jacobian(chain, q).T @ w
        motors.current[:] = -(process + axis_torque(chain, q[None])[0]) / constants
        motors(q, out)
        np.testing.assert_allclose(out, process, atol=1e-8)


def test_constants_that_are_none_are_refused() -> None:
    chain = read_cell(CELLS[0]).chain
    for bad in ([0.0, 1.0, 1.0, 1.0, 1.0, 1.0], [np.nan, 1.0, 1.0, 1.0, 1.0, 1.0]):
        with pytest.raises(InputError):
            MotorTorque(chain, np.array(bad))


def fresh() -> Record:
    return records(STATE)[0]


def go(state: Record, q: Float, torque: Float, learn: bool) -> tuple[int, Float]:
    idle = np.zeros(6)
    return follow_idle(q, q.copy(), torque, learn, state, idle), idle


def test_friction_is_known_by_direction_and_only_when_it_has_turned_round() -> None:
    """Axis 1 goes forth and back, axis 2 stands: each direction of axis 1 has its own idle torque, axis 2 none."""
    state, step = fresh(), 1e-5
    q = np.zeros(6)
    for _ in range(100):
        q[0] += step
        known, idle = go(state, q, np.array([-350.0, 80.0, 0.0, 0.0, 0.0, 0.0]), True)
    assert known == 1
    assert idle[0] == -350.0
    turning = []
    for k in range(100):  # friction turns round over twice the presliding
        q[0] -= step
        friction = -350.0 + 770.0 * min(1.0, (k + 1) * step / (2.0 * PRESLIDING_RAD))
        known, idle = go(state, q, np.array([friction, 80.0, 0.0, 0.0, 0.0, 0.0]), True)
        turning.append(known)
    assert turning[-1] == 1
    assert idle[0] == pytest.approx(420.0, rel=0.02)
    back = turning.index(0)
    assert back * step < 0.3 * PRESLIDING_RAD
    assert turning.index(1, back) * step > 1.7 * PRESLIDING_RAD
    for _ in range(100):  # a cut: nothing is learnt, what was known of this direction holds
        q[0] += step
        known, idle = go(state, q, np.full(6, 1e4), False)
    assert known == 1
    assert idle[0] == pytest.approx(-350.0, rel=0.02)


def test_a_force_that_moves_the_link_back_makes_the_friction_unknown() -> None:
    state, idle = fresh(), np.zeros(6)
    q = np.zeros(6)
    for _ in range(100):
        q[0] += 1e-5
        follow_idle(q, q.copy(), np.full(6, -350.0), True, state, idle)
    link = q.copy()
    link[0] -= PRESLIDING_RAD
    assert follow_idle(q, link, np.full(6, 0.0), False, state, idle) == 0


def test_a_measured_force_is_taken_off() -> None:
    cell = read_cell(CELLS[1])
    q = np.array([0.1, -1.3, 1.7, 0.2, 0.9, -0.3])
    R_base_part, jac = cell.T_base_part[:3, :3], jacobian(cell.chain, q)
    w = np.array([120.0, -300.0, 80.0, 5.0, -7.0, 2.0])
    w_base = np.concatenate([R_base_part @ w[:3], R_base_part @ w[3:]])
    torque = 100.0 + jac.T @ w_base
    less_force(w, np.ascontiguousarray(jac.reshape(-1)), np.ascontiguousarray(R_base_part.reshape(-1)), torque)
    np.testing.assert_allclose(torque, 100.0, atol=1e-9)
