"""The best way through the postures of a path: every branch by dynamic programming, the cheapest one taken."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import thread_count
from counterflex.core.units import DEG
from counterflex.plan.posture.branches_kernel import SLOTS
from counterflex.plan.posture.burden_kernel import burdens
from counterflex.plan.posture.cut_path import LoadedPath, in_contact
from counterflex.plan.posture.survey import RobotHere, hand_points, load_by_rotation
from counterflex.plan.posture.survey_kernel import POWER, Survey
from counterflex.plan.posture.walk_kernel import PER_ROTATION, TURNS, Edges, Rules, walk
from counterflex.robot.model.opw import TURN

LOST_RAD: Final = 1.0 / 60.0 * DEG
"""Lost motion of an axis whose play is not known: 1 arc minute, what makers of robot gears guarantee at most (Nabtesco,
data sheets of the series RV-E, RV-N and RV-C: lost motion and backlash 1 arc.min)."""


@dataclass(frozen=True)
class Weights:
    """Costs of a posture beside its deflection, in shares of the least cost of the deflection; without unit."""

    turning: float = 0.02  # A full turn about the tool axis
    winding: float = 0.02  # axes 4 and 6 at the end of their ranges all along
    # factor on what a reversal or an unloading of an axis costs: 0 leaves them out, 1 takes lost motion for a
    # deflection along the edge that follows
    reversals: float = 1.0


@dataclass(frozen=True, eq=False)
class Way:
    """A way through the postures."""

    slot: int  # branch, index into counterflex.robot.model.opw.BRANCHES
    index: Int  # (m + 1,) rotation of the grid at each station
    steps: Int  # (m,) steps of the grid turned on each edge
    q: Float  # (m + 1, 6) rad at the stations, full turns of axes 4 and 6 chosen
    # deflection and all else; 1 is every point in its best posture, free of all constraints: no way through the grid is
    # below
    cost: float


def least_cost(path: LoadedPath, survey: Survey) -> float:
    """Cost of the deflection with every point in its best posture, m^(POWER + 1)."""
    cutting = path.weight_m > 0.0
    return float(np.sum(path.weight_m[cutting] * survey.least[cutting] ** POWER))


def lost_motion(robot: RobotHere) -> Float:
    """(6,) rad, what each axis loses where it turns round: ``2 (b + c sum F)`` where known, else :data:`LOST_RAD`."""
    chain, out = robot.chain, np.full(6, LOST_RAD)
    for axis, play in enumerate(chain.play or ()):
        if play is not None:
            compliance = chain.compliance[chain.torsion[axis], 5]
            out[axis] = 2.0 * (play.half_band_rad + compliance * float(np.sum(play.friction_nm)))
    return out


def allowed_steps(contact: Bool, duration_s: Float, step_rad: float, rate_rad_s: float, air_rate_rad_s: float) -> Int:
    """(m,) steps of the grid that the tool may turn on each edge: one at most where material is cut.

    Args:
        contact: (m,) edges along which material is cut.
        duration_s: (m,) s.
        step_rad: Of the grid.
        rate_rad_s: Largest rate of turning in the cut; 0 forbids it.
        air_rate_rad_s: The same in the air.
    """
    rate = np.where(contact, rate_rad_s, air_rate_rad_s)
    steps = np.floor(rate * duration_s / step_rad + 1e-9).astype(np.int64)
    out: Int = np.where(contact, np.minimum(steps, 1), steps)
    return out


class _Stations(NamedTuple):
    """Arrays along a path of m + 1 stations, whatever the branch."""

    w: Float
    normals: Float
    tips: Float
    contact: Bool
    duration: Float
    reversals: Float  # (m + 1, 1, 1) weight of lost motion
    scale: float  # m, size of a cost of 1


def _best_in_branch(
    robot: RobotHere, survey: Survey, at: _Stations, steps: Int, rules: Rules, lost: Float, slot: int
) -> tuple[float, int, Way | None]:
    """Cost of the cheapest way in one branch, edges that it could pass, and the way."""
    m, r = survey.early.shape[:2]
    q = np.ascontiguousarray(survey.q[:, :, slot])
    torque, gain = np.zeros((m + 1, r, 6)), np.zeros((m + 1, r, 6))
    burdens(robot.chain.compact, q, at.w, at.normals, at.tips, torque, gain)
    cost = at.reversals * (gain * lost) ** POWER / at.scale
    early, late = (np.ascontiguousarray(part[:, :, slot] / at.scale) for part in (survey.early, survey.late))
    edges = Edges(early, late, q, cost, torque, at.contact, at.duration, steps)
    back, hop = (np.zeros((m, r * PER_ROTATION), dtype=np.int16) for _ in range(2))
    value = np.empty(r * PER_ROTATION)
    passed = walk(edges, rules, back, hop, value)
    if passed < m:
        return np.inf, passed, None
    end = int(np.argmin(value))
    return float(value[end]), passed, _traced(slot, q, back, hop, end, float(value[end]))


def best_way(
    path: LoadedPath, robot: RobotHere, survey: Survey, rows: Int, steps: Int, weights: Weights
) -> tuple[Way | None, Int]:
    """The cheapest way through the postures, exact on the grid.

    ``rows``: (m + 1,) stations; ``steps``: (m,) steps that the tool may turn, :func:`allowed_steps`; ``weights``: of
    what costs beside the deflection.

    Returns:
        The way, None where there is none; and (8,) edges that each branch could pass.
    """
    scale = least_cost(path, survey) or 1.0
    m, r = survey.early.shape[:2]
    points, contact = hand_points(path, robot, rows), in_contact(path, rows)
    w, normals = load_by_rotation(points, rows, TURN * np.arange(r) / r)
    tips = np.ascontiguousarray(points.p[rows] if points.part_carried else np.empty((0, 3)))
    weight = np.diff(np.cumsum(path.weight_m)[rows])
    after = np.append(weight, weight[-1:])
    speed = np.full(6, np.inf) if robot.joint_speeds_rad_s is None else np.array(robot.joint_speeds_rad_s)
    rules = Rules(robot.joint_limits_rad, speed, weights.turning / r, weights.winding / m)
    duration = np.ascontiguousarray(np.diff(path.time_s[rows]))
    stations = _Stations(w, normals, tips, contact, duration, weights.reversals * after[:, None, None], scale)
    one = partial(_best_in_branch, robot, survey, stations, steps, rules, lost_motion(robot))
    # A branch that cannot take the first station leads nowhere: it costs no thread.
    possible = [slot for slot in range(SLOTS) if not np.isnan(survey.q[0, :, slot, 0]).all()]
    passed = np.zeros(SLOTS, dtype=np.int64)
    results = []
    with ThreadPoolExecutor(thread_count()) as threads:
        for slot, (cost, edges_passed, way) in zip(possible, threads.map(one, possible), strict=True):
            passed[slot] = edges_passed
            if way is not None and np.isfinite(cost):
                results.append(way)
    return min(results, key=lambda way: way.cost, default=None), passed


def _traced(slot: int, q: Float, back: Int, hop: Int, end: int, cost: float) -> Way:
    """The way that ends in a state."""
    m = len(back)
    state, steps = np.empty(m + 1, dtype=np.int64), np.empty(m, dtype=np.int64)
    state[m] = end
    for e in range(m - 1, -1, -1):
        steps[e] = hop[e, state[e + 1]]
        state[e] = back[e, state[e + 1]]
    index = state // PER_ROTATION
    turns = (state % PER_ROTATION) // (PER_ROTATION // TURNS**2)
    angles = q[np.arange(m + 1), index].copy()
    angles[:, 3] += TURN * (turns // TURNS - 1)
    angles[:, 5] += TURN * (turns % TURNS - 1)
    return Way(slot, index, steps, angles, cost)
