"""The cell that faults are composed in: program, plan, and a truth of its own that the loop's model only resembles.

A racetrack of two straight cuts and two arcs in air, three laps at growing depth, then back to its beginning::

        <---- cut (force +y) ----
       (                         )   z falls on the arc at the left
        ---- cut (force -y) ---->
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex_lab.devices import RsiConfig, read_config
from counterflex_lab.faults.demonstration import Q, demo_cell

CELL: Final = Path("cell.toml")
"""Name of the cell file, for messages: it is read from the package."""
FEED_M_S: Final = 0.025
SPACING_M: Final = 0.1 * MM
"""Between rows of the program's table: chords of its arcs are right to 0.1 um."""
_STRAIGHT_M: Final = 80.0 * MM
_RADIUS_M: Final = 15.0 * MM
_DEEPER_M: Final = 0.5 * MM
_LAPS: Final = 3
_AIR_M: Final = 8.0 * MM
"""At both ends of a straight."""
_ENGAGING_M: Final = 4.0 * MM
_PLAN_ROWS: Final = 5
"""Rows of the program's table per row of the plan."""
_FORCE_N: Final = np.array([-80.0, 250.0, -60.0])
"""Along the feed, across it, along z."""
_TRUTH: Final = 0.08
"""Standard deviation of the entries of the true compliance about the model's, as a share."""


@dataclass(frozen=True, eq=False)
class Program:
    """The program, a row every 0.1 mm; part frame, SI.

    Attributes:
        p: (n, 3) points.
        q: (n, 6) rad.
        force: (n, 3) N, planned.
        R: (3, 3) of the tool, the same everywhere.
        T_base_part: (4, 4) the program's BASE.
        end: Last row of the program; behind it the way back.
    """

    p: Float
    q: Float
    force: Float
    R: Float
    T_base_part: Float
    end: int


@functools.cache
def config() -> RsiConfig:
    """RSI configuration with every tag that the loop has a word for."""
    with resources.as_file(resources.files("counterflex_lab.composed") / "rsi.xml") as file:
        return read_config(file)


@functools.cache
def program() -> Program:
    """The program and its angles by the geometry that the controller computes with."""
    arc = np.pi * _RADIUS_M
    lap = 2.0 * (_STRAIGHT_M + arc)
    s = np.arange(0.0, _LAPS * lap, SPACING_M)
    p, force = np.zeros((len(s), 3)), np.zeros((len(s), 3))
    at = s % lap
    first, second = at < _STRAIGHT_M, (at >= _STRAIGHT_M + arc) & (at < 2.0 * _STRAIGHT_M + arc)
    right, left = ~first & (at < _STRAIGHT_M + arc), at >= 2.0 * _STRAIGHT_M + arc
    p[first, 0] = at[first]
    turn = (at[right] - _STRAIGHT_M) / _RADIUS_M
    p[right, 0], p[right, 1] = _STRAIGHT_M + _RADIUS_M * np.sin(turn), _RADIUS_M * (1.0 - np.cos(turn))
    back = at[second] - _STRAIGHT_M - arc
    p[second, 0], p[second, 1] = _STRAIGHT_M - back, 2.0 * _RADIUS_M
    turn = (at[left] - 2.0 * _STRAIGHT_M - arc) / _RADIUS_M
    p[left, 0], p[left, 1] = -_RADIUS_M * np.sin(turn), _RADIUS_M * (1.0 + np.cos(turn))
    p[:, 2] = -_DEEPER_M * np.floor(s / lap)
    p[left, 2] -= _DEEPER_M * 0.5 * (1.0 - np.cos(turn))
    for rows, along, sign in ((first, at[first], 1.0), (second, back, -1.0)):
        inside = np.minimum(along - _AIR_M, _STRAIGHT_M - _AIR_M - along)
        force[rows] = np.clip(inside / _ENGAGING_M, 0.0, 1.0)[:, None] * _FORCE_N * [sign, sign, 1.0]
    p[:, 0] += 0.05
    rows_back = max(2, round(float(np.linalg.norm(p[0] - p[-1])) / SPACING_M) + 1)
    p_all = np.concatenate([p, p[-1] + np.linspace(0.0, 1.0, rows_back)[1:, None] * (p[0] - p[-1])])
    R = rotation.about_x(np.pi)
    T = np.tile(np.eye(4), (len(p_all), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, p_all
    chain = demo_cell().controller_chain
    T_base_part: Float = forward(chain, Q) @ pose.inverse(T[0])
    q: Float = inverse_path(chain, T_base_part @ T, Q).q
    whole = np.concatenate([force, np.zeros((rows_back - 1, 3))])
    return Program(p_all, q, whole, R, T_base_part, len(p) - 1)


@functools.cache
def plan(deeper_m: float = 0.0) -> LoopPlan:
    """What was planned for the program.

    Args:
        deeper_m: By how much the plan is deeper than the program.
    """
    own = program()
    rows = slice(0, own.end + 1, _PLAN_ROWS)
    p: Float = own.p[rows] - np.array([0.0, 0.0, deeper_m])
    force = own.force[rows]
    n = len(p)
    w = np.concatenate([force, np.zeros((n, 3))], axis=1)
    cuts = (np.abs(force[:, 1]) > 0.0).astype(np.float64)
    time = np.arange(n) * _PLAN_ROWS * SPACING_M / FEED_M_S
    return LoopPlan(p, np.asarray(time, dtype=np.float64), w, cuts, np.zeros((n, 6)))


@functools.cache
def model_compliance() -> Float:
    """(3, 3) m/N of the tool in the part frame by the loop's model."""
    cell = demo_cell()
    R = program().T_base_part[:3, :3]
    C: Float = R.T @ cartesian_compliance(cell.chain, Q)[:3, :3] @ R
    return C


@functools.cache
def jacobian() -> Float:
    """(3, 6) m/rad of the tool at the beginning of the program, part axes, by differences."""
    chain, R, small = demo_cell().controller_chain, program().T_base_part[:3, :3], 1e-6
    columns = [forward(chain, Q + small * row)[:3, 3] - forward(chain, Q - small * row)[:3, 3] for row in np.eye(6)]
    out: Float = R.T @ np.array(columns).T / (2.0 * small)
    return out


def true_compliance(rng: np.random.Generator) -> Float:
    """(3, 3) m/N of the robot that is there: symmetric, near the model's, and not of its form."""
    C = model_compliance()
    other = _TRUTH * rng.standard_normal((3, 3))
    scale = np.eye(3) + 0.5 * (other + other.T)
    out: Float = scale @ C @ scale
    return 0.5 * (out + out.T)


def wrench() -> SensorWrench:
    """A sensor that carries no weight."""
    cell = demo_cell()
    return SensorWrench(cell.chain, FlangeSensor("sensor", np.eye(4), 0.0, np.zeros(3)), program().T_base_part)


@functools.cache
def reading() -> Float:
    """(6, 6) reading of the sensor for a wrench on the tool, part axes; the tool never turns."""
    own, out = wrench(), np.zeros((6, 6))
    for k in range(6):
        own.w_base[:] = 0.0
        out[:, k] = own(Q, np.eye(6)[k])
    inverse: Float = np.asarray(np.linalg.inv(out), dtype=np.float64)
    return inverse


TRACKER_NOISE_M: Final = 5.0 * UM
