"""What a pose of the part in the cell is worth: its best posture on a thinned path, or what refuses it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.plan.placement.thinned import thinned
from counterflex.plan.posture.choose import Freedom, cannot_touch
from counterflex.plan.posture.clearance import Surroundings, too_close, worst
from counterflex.plan.posture.cut_path import CutPath
from counterflex.plan.posture.held import Task
from counterflex.plan.posture.survey import RobotHere, survey_path
from counterflex.plan.posture.survey_kernel import ARM_SINGULAR, JOINT_LIMIT, OK, OUT_OF_REACH, POWER, WRIST_SINGULAR
from counterflex.plan.posture.way import Way, Weights, best_way, least_cost
from counterflex.robot.model.opw import BRANCHES

NO_POSTURE: Final = "no single posture leads through the program"
UNTOUCHED: Final = "datum points cannot be touched"
COLLISION: Final = "bodies too close"
REFUSALS: Final = {
    OUT_OF_REACH: "out of reach",
    ARM_SINGULAR: "arm stretched",
    JOINT_LIMIT: "joint limit or cable",
    WRIST_SINGULAR: "wrist singularity",
}
"""What refuses a pose of the part in which some point has no posture, by the code of the survey."""
ROTATIONS: Final = 36
"""Rotations about the tool axis that are tried of each candidate: every 10 deg."""


@dataclass(frozen=True, eq=False)
class Site:
    """A program whose place is searched, thinned.

    Attributes:
        cut: Thinned path.
        robot: Robot and tool; its pose of the part is replaced.
        freedom: Rotations that are tried.
        around: Bodies that must not touch, tools by the rows of the thinned path; None: nobody looks.
        datum_points: (k, 3) m points of the part that the robot must touch, or None.
    """

    cut: CutPath
    robot: RobotHere
    freedom: Freedom
    around: Surroundings | None
    datum_points: Float | None

    @property
    def poses(self) -> int:
        """Poses of the robot that are tried for one candidate."""
        return len(self.cut) * self.freedom.rotations * len(BRANCHES)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A pose of the part, judged.

    Attributes:
        refused: What refuses it; empty where it can be run.
        passed: Share of the points that the robot can reach in some posture, 0 to 1.
        deflection_m: Power mean of the deflection along the cut in the best posture; infinite where refused.
        time_s: Duration of the program, with the time that axes at their largest speeds need between its points.
        margin_rad: Smallest of the distances to a joint limit or cable and to the wrist singularity.
        branch: Of the best posture.
        rotation_rad: About the tool axis.
        q: (k, 6) rad along the thinned path.
    """

    refused: str = ""
    passed: float = 0.0
    deflection_m: float = np.inf
    time_s: float = np.inf
    margin_rad: float = -np.inf
    branch: str = ""
    rotation_rad: float = 0.0
    q: Float | None = None


def site_of(task: Task, rotations: int = ROTATIONS) -> Site:
    """The thinned program of a task.

    Reversals and unloadings are left out of the cost: they are events of the whole path, and the posture of the place
    that is found is chosen with them.
    """
    cut, rows = thinned(task.cut)
    around = task.around
    if around is not None:
        around = replace(around, tool=around.tool[rows])
    freedom = Freedom(rotations, weights=Weights(reversals=0.0))
    return Site(cut, task.robot, freedom, around, task.setting.datum_points_part)


def judge(site: Site, T_base_part: Float) -> Candidate:
    """Find the best posture of a pose of the part: survey, dynamic programming, distances of bodies.

    Args:
        site: The program.
        T_base_part: (4, 4).

    Returns:
        What the pose is worth, or what refuses it.
    """
    robot, cut = replace(site.robot, T_base_part=T_base_part), site.cut
    rows = np.arange(len(cut))
    survey = survey_path(cut, robot, site.freedom.grid_rad, rows)
    bad = np.flatnonzero(survey.failed[:, OK] == 0)
    passed = 1.0 - len(bad) / len(cut)
    if len(bad):
        return Candidate(REFUSALS[int(np.flatnonzero(survey.failed[bad[0]])[-1])], passed)
    survey.q[0, cannot_touch(site.datum_points, robot, site.freedom)] = np.nan
    if np.isnan(survey.q[0, ..., 0]).all():
        return Candidate(UNTOUCHED, passed)
    steps = np.zeros(len(cut) - 1, dtype=np.int64)
    for attempt in range(2):
        way, _ = best_way(cut, robot, survey, rows, steps, site.freedom.weights)
        if way is None:
            return Candidate(COLLISION if attempt else NO_POSTURE, passed)
        if site.around is None or worst(way.q, robot, site.around) is None:
            return _worth(site, robot, way, least_cost(cut, survey), passed)
        survey.q[:, too_close(survey.q, rows, robot, site.around)] = np.nan
    return Candidate(COLLISION, passed)


def _worth(site: Site, robot: RobotHere, way: Way, scale: float, passed: float) -> Candidate:
    """Accuracy, time and margin of a way."""
    limits, cut = robot.joint_limits_rad, site.cut
    wrist = np.abs(np.arcsin(np.abs(np.sin(way.q[:, 4]))))
    to_limits = np.minimum(way.q - limits[:, 0], limits[:, 1] - way.q)
    return Candidate(
        "",
        passed,
        float((way.cost * scale / (np.sum(cut.weight_m) or 1.0)) ** (1.0 / POWER)),
        float(np.sum(np.maximum(np.diff(cut.time_s), _least_duration(way.q, robot)))),
        float(min(to_limits.min(), wrist.min() - robot.limits.wrist_rad)),
        BRANCHES[way.slot],
        float(site.freedom.grid_rad[way.index[0]]),
        way.q,
    )


def _least_duration(q: Float, robot: RobotHere) -> Float:
    """(k - 1,) s, time that the slowest axis needs from point to point; 0 where speeds are not known."""
    if robot.joint_speeds_rad_s is None:
        return np.zeros(len(q) - 1)
    out: Float = np.max(np.abs(np.diff(q, axis=0)) / np.asarray(robot.joint_speeds_rad_s), axis=1)
    return out


def pareto(values: Float) -> Int:
    """Rows that no other row beats in every column.

    Args:
        values: (n, k), each to be small; rows with numbers that are not finite are never taken.

    Returns:
        Their indices, by rising first column.
    """
    finite = np.flatnonzero(np.isfinite(values).all(axis=1))
    some = values[finite]
    kept = [
        row
        for row, value in zip(finite, some, strict=True)
        if not np.any(np.all(some <= value, axis=1) & np.any(some < value, axis=1))
    ]
    out: Int = np.array(sorted(kept, key=lambda row: values[row, 0]), dtype=np.int64)
    return out
