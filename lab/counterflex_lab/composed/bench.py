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
from counterflex.robot.elasticity.chain import forward, jacobian as rigid_jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex_lab.devices import RsiConfig, parse_config
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
FULL_N2: Final = 0.99 * float(_FORCE_N[1]) ** 2
"""Square of the force across the feed of which a cut is a whole one."""
_AROUND: Final = 60
"""Rows of the program in which the place of a guided robot is looked for."""
_DELAY: Final = b'<ELEMENT TAG="DEF_Delay"'
_CURRENTS: Final = b'<ELEMENT TAG="DEF_MACur" TYPE="DOUBLE" INDX="INTERNAL"/>'
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
        cuts: For each row whether a force is planned.
    """

    p: Float
    q: Float
    force: Float
    R: Float
    T_base_part: Float
    end: int
    cuts: list[bool]


@functools.cache
def config(*, currents: bool = False) -> RsiConfig:
    """RSI configuration with every tag that the loop has a word for.

    Args:
        currents: Motor currents are sent too.
    """
    text = (resources.files("counterflex_lab.composed") / "rsi.xml").read_bytes()
    if currents:
        text = text.replace(_DELAY, _CURRENTS + _DELAY)
    return parse_config(text, "rsi.xml")


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
    cuts = [bool(row.any()) for row in whole]
    return Program(p_all, q, whole, R, T_base_part, len(p) - 1, cuts)


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
    """(n, 3, 6) m/rad of the tool at each row of the program, part axes."""
    own = program()
    out: Float = own.T_base_part[:3, :3].T @ rigid_jacobian(demo_cell().controller_chain, own.q)[:, :3]
    return out


@functools.cache
def feeds() -> Float:
    """(n, 3) unit vectors from each row of the program to the next, part axes."""
    step = np.diff(program().p, axis=0, append=2.0 * program().p[-1:] - program().p[-2:-1])
    out: Float = step / np.linalg.norm(step, axis=1, keepdims=True)
    return out


@functools.cache
def angles() -> Float:
    """(n, 6, 3) rad/m of the axes for a displacement of the tool that does not turn, part axes."""
    own = program()
    J = rigid_jacobian(demo_cell().controller_chain, own.q)
    out: Float = np.linalg.inv(J)[:, :, :3] @ own.T_base_part[:3, :3]
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


def beside(p: Float, row: int) -> tuple[float, Float]:
    """Place on the program that is nearest to a point, and (3,) m from there to the point.

    Args:
        p: (3,) m, part frame.
        row: Of the program; the place is looked for around it.
    """
    points = _points()
    x, y, z = p.tolist()
    last = len(points) - 2
    k, turned, share = min(max(0, row), last), 0, 0.0
    for _ in range(_AROUND):  # from segment to segment, in one direction
        (ax, ay, az), (bx, by, bz) = points[k], points[k + 1]
        dx, dy, dz = bx - ax, by - ay, bz - az
        share = ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / (dx * dx + dy * dy + dz * dz)
        if share > 1.0 and k < last and turned >= 0:
            k, turned = k + 1, 1
        elif share < 0.0 and k > 0 and turned <= 0:
            k, turned = k - 1, -1
        else:
            break
    share = min(1.0, max(0.0, share))
    return k + share, np.array([x - ax - share * dx, y - ay - share * dy, z - az - share * dz])


@functools.cache
def _points() -> list[list[float]]:
    points: list[list[float]] = program().p.tolist()
    return points


TRACKER_NOISE_M: Final = 5.0 * UM
