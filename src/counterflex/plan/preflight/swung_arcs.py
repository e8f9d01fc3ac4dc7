"""Motions by axes as the controller makes them: points between their ends, where the arm swings the tool.

All axes start and end together, so the way is a straight line in joint space. The tool leaves the straight line between
its ends; rows are put in so that no point of the robot moves by more than :data:`STEP_M` from row to row.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.path.tool_rotation import ToolRotation
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import Setting
from counterflex.plan.preflight.bodies import joint_offsets
from counterflex.plan.preflight.external_moves import moved_m
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.kinematics.inverse import PathSolution
from counterflex.robot.kinematics.inverse_seeds import branch_of
from counterflex.robot.kinematics.joint_path import Turns
from counterflex.robot.model.controller_axes import room

CHECK: Final = "motions by axes"
STEP_M: Final = 5.0 * MM
"""Longest step of any point of the robot between rows: that of rapids along a line."""
_MOST: Final = 4000
"""Rows of one motion: an arm of 3 m that turns by a full turn has them."""


@dataclass(frozen=True, eq=False)
class Swung:
    """A path with the arcs of its motions by axes."""

    path: ToolPath  # m rows
    setting: Setting  # the same, with a rotation along the program counted along this path
    solution: PathSolution | None  # of the first rows, those that are reached; None where the start is not
    row: Int  # (n,) row of this path that each row of the given path is
    made: Bool  # (m,) rows on the way of a motion by axes, its end included

    def as_stated(self, turns: Turns, motion: int) -> bool:
        """Return whether a motion ends in the turns that are stated, as far as it is reached."""
        ends = np.flatnonzero((self.path.motion == motion) & (self.made | (motion == 0)))
        if self.solution is None or len(ends) == 0 or ends[-1] >= len(self.solution.q):
            return True
        return turns.agree(self.solution.q[ends[-1]])


def linear_rows(path: ToolPath, setting: Setting) -> ToolPath:
    """The path without the rows between the ends of motions by axes: a straight line is not their way."""
    _, between = setting.by_axes.rows(path.motion)
    return path if not np.any(between) else taken(path, np.flatnonzero(~between))


def taken(path: ToolPath, rows: Int) -> ToolPath:
    """Some rows of a path, in their order."""
    return ToolPath(**{item.name: getattr(path, item.name)[rows] for item in dataclasses.fields(path)})


def swung(path: ToolPath, setting: Setting, solution: PathSolution | None) -> Swung:
    """Put the arcs of motions by axes into a path, as far as it is reached.

    Args:
        path: n rows; of motions by axes their ends only.
    """
    ends, _ = setting.by_axes.rows(path.motion)
    reached = 0 if solution is None else len(solution.q)
    count = np.ones(len(path), dtype=np.int64)
    if solution is not None:
        at = np.flatnonzero(ends[:reached])
        away = np.zeros(len(path)) if setting.places is None else moved_m(setting.places, path.place)
        count[at] = _counts(setting.controller_chain, solution.q, at, away[at] - away[at - 1])
    made = np.repeat(ends, count)
    if solution is None or np.all(count == 1):
        return Swung(path, setting, solution, np.arange(len(path)), made)
    row = np.repeat(np.arange(len(path)), count)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 1) / count[row]
    last = np.cumsum(count) - 1
    inside = int(last[reached - 1]) + 1
    own, before = row[:inside], np.maximum(row[:inside] - 1, 0)
    part = share[:inside, None]
    q = np.where(part == 1.0, solution.q[own], solution.q[before] + part * (solution.q[own] - solution.q[before]))
    between = np.flatnonzero(share[:inside] < 1.0)
    columns = {item.name: getattr(path, item.name)[row] for item in dataclasses.fields(path)}
    ahead = np.maximum(row - 1, 0)
    for name in ("time_s", "place"):
        values = getattr(path, name)
        columns[name] = np.where(share == 1.0, values[row], values[ahead] + share * (values[row] - values[ahead]))
    _swing(columns, setting, q, between)
    out = ToolPath(**columns)
    return Swung(out, _along(setting, path, out, last), _solved(setting, solution, q, own, between), last, made)


def _counts(chain: ElasticChain, q: Float, at: Int, away_m: Float) -> Int:
    """Rows of the motions that end at some rows, by the way that a point of robot or surroundings may go."""
    steps = np.array([np.linalg.norm(offset) for offset in joint_offsets(chain)])
    way = np.cumsum(steps[::-1])[::-1][1:] + float(np.linalg.norm(chain.T_flange_tcp[:3, 3]))
    length = np.abs(q[at] - q[at - 1]) @ way + away_m
    out: Int = np.clip(np.ceil(length / STEP_M), 1, _MOST).astype(np.int64)
    return out


def _swing(columns: dict[str, Float], setting: Setting, q: Float, between: Int) -> None:
    """Enter tip and axis of the tool where the arm swings them."""
    Ts_hand = forward(setting.controller_chain, q[between])
    if setting.T_base_tcp is None:
        places = setting.places
        Ts_base_part = setting.T_base_part if places is None else places.Ts_base_part(columns["place"][between])
        Ts_part_tcp = pose.inverse(Ts_base_part) @ Ts_hand
    else:
        Ts_part_tcp = pose.inverse(Ts_hand) @ setting.T_base_tcp
    columns["p_part_tcp"][between] = Ts_part_tcp[:, :3, 3]
    columns["axis_part"][between] = -Ts_part_tcp[:, :3, 2]


def _solved(setting: Setting, solution: PathSolution, q: Float, own: Int, between: Int) -> PathSolution:
    """The solution with the rows of the arcs: they keep the joint limits and pass no singularity."""
    chain = setting.controller_chain
    margin, axis = solution.limit_margin_rad[own], solution.limit_axis[own]
    rooms = room(chain.axes, chain.joint_limits_rad, q[between])
    margin[between], axis[between] = rooms.min(axis=1, initial=np.inf), rooms.argmin(axis=1) if len(between) else 0
    wrist, sigma = solution.wrist[own], solution.sigma_min[own]
    wrist[between], sigma[between] = 1.0, np.inf
    extension = None if solution.extension_m is None else solution.extension_m[own]
    return PathSolution(q, solution.branch, margin, axis, wrist, sigma, extension)


def _along(setting: Setting, path: ToolPath, out: ToolPath, last: Int) -> Setting:
    """The setting with its rotation along the program, counted along the path with arcs."""
    if setting.turning is None:
        return setting
    angle = setting.turning.along(path.p_part_tcp)
    step = np.linalg.norm(np.diff(out.p_part_tcp, axis=0, prepend=out.p_part_tcp[:1]), axis=1)
    length = np.cumsum(step)[last]
    rises = np.append(np.diff(length) > 0.0, True)
    return replace(setting, turning=ToolRotation(tuple(length[rises].tolist()), tuple(angle[rises].tolist())))


def axes_row(whole: Swung, setting: Setting, left_out: tuple[str, ...]) -> Row:
    """Return the row of motions by axes: where they lead, and those whose way is not known.

    Args:
        whole: The path with its arcs.
        left_out: File and line of each motion by axes before the first target and behind the last one.
    """
    by_axes, path, solution = setting.by_axes, whole.path, whole.solution
    text = f"{len(by_axes.motions)} motions, swung as the controller moves them"
    if solution is not None:
        for motion, q in sorted(by_axes.stated_rad.items()):
            ends = np.flatnonzero(path.motion == motion)
            goes_on = len(ends) and ends[-1] + 1 < len(whole.made) and not whole.made[ends[-1] + 1]
            branch = branch_of(setting.controller_chain, q)
            if goes_on and branch != setting.branch:
                what = (
                    f"from here on the arm is {branch}, [posture] is {setting.branch}: compensate plans with that of "
                    "the cell file"
                )
                advice = "Give [posture] the posture of the program"
                return Row(CHECK, "warning", point=int(ends[-1]), what=what, advice=advice)
        others = [motion for motion in by_axes.turns if not whole.as_stated(by_axes.turns[motion], motion)]
        if others:
            words, first = by_axes.turns[min(others)].words, min(others)
            what = f"{len(others)} targets ask for other turns of the axes ({words}) than are reached in [posture]"
            return Row(CHECK, "warning", point=int(np.flatnonzero(path.motion == first)[-1]), what=what,
                       advice="Give [posture] the posture of the program, or turn the axes back in it")  # fmt: skip
    if left_out:
        return Row(CHECK, NOT_LOOKED_AT,
                   what=f"{', '.join(left_out[:3])}{' ...' if len(left_out) > 3 else ''}: before the first target or "
                   "behind the last one, from or to a place that the program does not say")  # fmt: skip
    return Row(CHECK, "ok", what=text if by_axes.motions else "none between lines")
