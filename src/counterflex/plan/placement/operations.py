"""A place of the external axes for each operation: where a program is divided, and which places cost least together.

An operation is what is cut between two places at which the tool is clear of the blank. External axes stand in it and
move between two of them, so that the cost of an operation depends on its own place alone: the sum is least along the
cheapest way through operations and places, with a cost for every move. The posture is one for all, as in a program that
goes along lines.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ReachError
from counterflex.path.toolpath import RAPID, ToolPath, tool_orientation, tool_poses
from counterflex.plan.placement.candidate import Site, site_of, worth
from counterflex.plan.placement.search import CandidatePoses
from counterflex.plan.posture.choose import cannot_touch
from counterflex.plan.posture.clearance import kept
from counterflex.plan.posture.cut_path import LoadedPath
from counterflex.plan.posture.held import PostureTask
from counterflex.plan.posture.survey import constant_costs, survey_path
from counterflex.plan.posture.survey_kernel import POWER
from counterflex.plan.stability.stretches import Stretch
from counterflex.robot.kinematics.inverse import inverse_path

MOST: Final = 12
"""Operations that a program is divided into at most: the shortest join a neighbour. Each is tried at every place."""


@dataclass(frozen=True)
class Operation:
    """A piece of the path."""

    first: int  # its first row
    last: int  # its last row: of all but the last one, where the tool is clear of the blank
    # row at which external axes have arrived at their next place: the end of the rapid behind, where that stays clear;
    # else `last`, where the tool stands meanwhile
    arrival: int


@dataclass(frozen=True, eq=False)
class OperationSite:
    """An operation whose place is searched."""

    site: Site  # its thinned path on the robot
    length_m: float  # path in the cut

    def posture_costs(self, seen: CandidatePoses) -> Float:
        """(r, 8) m^(POWER + 1), deflection of each posture held in a place; infinite where it is not reached."""
        robot = self.site.robot.facing(seen.T_base_standing)
        cut = self.site.cut
        survey = survey_path(cut, robot, self.site.freedom.grid_rad, np.arange(len(cut)))
        out: Float = constant_costs(survey) ** POWER
        out[cannot_touch(self.site.datum_points, robot, self.site.freedom)] = np.inf
        return out

    def held(self, seen: CandidatePoses, branch: str, rotation_rad: float) -> tuple[float, float]:
        """Error in a place and posture, m, and the least damping ratio in the cut; infinite where it cannot be run.

        Args:
            rotation_rad: About the tool axis.
        """
        site, refused = self.site, (np.inf, np.nan)
        robot = site.robot.facing(seen.T_base_standing)
        R = tool_orientation(site.cut.axis_part, rotation_rad)
        try:
            solved = inverse_path(robot.controller_chain, tool_poses(robot.T_base_part, site.cut.p_part, R), branch)
        except ReachError:
            return refused
        if robot.room(solved.q).min() < 0.0 or solved.wrist.min() < np.sin(robot.limits.wrist_rad):
            return refused
        if site.around is not None:
            around = site.around.facing(site.robot, robot, seen.T_base_before)
            if kept(solved.q, robot, around)[0] is not None:
                return refused
        _, error, damping = worth(site, robot, solved.q)
        return error, damping


def operations_of(path: ToolPath, cut_m: Float, top_m: float, clearance_m: float) -> list[Operation]:
    """Divide a path where the tool is clear of the blank: between two cuts, at the end of a rapid, as high as it goes.

    External axes move along the motion that follows where it is a rapid whose end is clear, too: tool and robot then go
    together.

    Args:
        path: n rows.
        cut_m: (n,) m of path in the material that a row stands for.
        top_m: Height of the blank.
        clearance_m: Least height of the tool over it.

    Returns:
        In their order; all rows belong to one of them.
    """
    ends = np.append(path.motion[1:] != path.motion[:-1], True)
    height = path.p_part_tcp[:, 2] - top_m
    clear = ends & (path.kind == RAPID) & (height >= clearance_m - 1e-9)
    cutting = np.flatnonzero(cut_m > 0.0)
    divided = []
    for before, after in itertools.pairwise(cutting.tolist()):
        between = np.flatnonzero(clear[before + 1 : after]) + before + 1
        if len(between):
            row = int(between[np.argmax(height[between])])
            behind = row + 1 + int(np.argmax(ends[row + 1 :]))  # of one motion: between two the tool may dip
            divided.append((row, behind if clear[behind] and np.all(path.kind[row + 1 : behind + 1] == RAPID) else row))
    ends_at = [*divided, (len(path) - 1, len(path) - 1)]
    firsts = [0, *(row + 1 for row, _ in divided)]
    out = [Operation(first, *at) for first, at in zip(firsts, ends_at, strict=True)]
    while len(out) > MOST:
        lengths = [float(cut_m[one.first : one.last + 1].sum()) for one in out]
        k = int(np.argmin(lengths))
        at = k - 1 if k > 0 and (k == len(out) - 1 or lengths[k - 1] <= lengths[k + 1]) else k
        out[at : at + 2] = [replace(out[at + 1], first=out[at].first)]
    return out


def sites_of(task: PostureTask, operations: Sequence[Operation], stretches: Sequence[Stretch]) -> list[OperationSite]:
    """Return the operations of a task as sites of their own.

    ``operations``: of it; ``stretches``: what it cuts, for the criterion of chatter.
    """
    out = []
    for number, one in enumerate(operations):
        rows = slice(one.first, one.last + 1)
        around = None if task.around is None else replace(task.around, tool=task.around.tool[rows])
        cut = LoadedPath(
            task.cut.p_part[rows], task.cut.axis_part[rows], task.cut.w_tcp_part[rows], task.cut.normals_part[rows],
            task.cut.weight_m[rows], task.cut.time_s[rows], task.cut.run[rows],
        )  # fmt: skip
        setting = task.setting
        if number:  # the frame of the part is measured where the program begins
            setting = replace(setting, datum_points_part=None)
        part = PostureTask(task.path, task.line[rows], cut, setting, task.robot, around)
        own = [replace(piece, row=piece.row - one.first) for piece in stretches if one.first <= piece.row <= one.last]
        out.append(OperationSite(site_of(part, own), float(cut.weight_m.sum())))
    return out


def best_postures(costs: Float, most: int) -> list[tuple[int, int, Int]]:
    """Return the postures with the least sum over all operations, each operation in its own best place.

    Args:
        costs: (operations, places, r, 8) of :meth:`OperationSite.posture_costs`.
        most: Postures that are returned.

    Returns:
        Index of the rotation, index of the branch, and (operations,) places; those that can be run, the best first.
    """
    least = costs.min(axis=1)
    total = least.sum(axis=0)
    order = np.argsort(total, axis=None, kind="stable")[:most]
    out = []
    for turn, branch in zip(*np.unravel_index(order, total.shape), strict=True):
        if np.isfinite(total[turn, branch]):
            out.append((int(turn), int(branch), costs[:, :, turn, branch].argmin(axis=1).astype(np.int64)))
    return out


def cheapest_places(costs: Float, allowed: Bool, move: float) -> Int | None:
    """Return the place of each operation with the least sum of costs, moves counted.

    Args:
        costs: (operations, places), infinite where an operation cannot be run.
        allowed: (operations - 1, places, places) True where the axes can go from one place to another behind an
            operation.
        move: Cost of going to another place, >= 0.

    Returns:
        (operations,) indices; None where there is no way.
    """
    n, k = costs.shape
    step = np.where(np.eye(k, dtype=np.bool_), 0.0, move)
    total, before = costs[0].copy(), np.zeros((n, k), dtype=np.int64)
    for number in range(1, n):
        ways = total[:, None] + np.where(allowed[number - 1] | np.eye(k, dtype=np.bool_), step, np.inf)
        before[number] = ways.argmin(axis=0)
        total = ways.min(axis=0) + costs[number]
    if not np.isfinite(total.min()):
        return None
    out = np.zeros(n, dtype=np.int64)
    out[-1] = int(total.argmin())
    for number in range(n - 1, 0, -1):
        out[number - 1] = before[number, out[number]]
    return out
