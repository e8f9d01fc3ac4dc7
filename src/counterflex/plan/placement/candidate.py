"""Worth of a pose of the part in the cell: its best posture on a thinned path, or what refuses it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.plan.placement.chatter import Feeding, feeding
from counterflex.plan.placement.error import ErrorLeft
from counterflex.plan.posture.choose import Freedom, cannot_touch
from counterflex.plan.posture.clearance import Surroundings, kept, too_close
from counterflex.plan.posture.cut_path import LoadedPath
from counterflex.plan.posture.held import PostureTask
from counterflex.plan.posture.impossible import FAULTS
from counterflex.plan.posture.survey import RobotHere, survey_path
from counterflex.plan.posture.survey_kernel import OK, POWER
from counterflex.plan.posture.way import Way, best_way
from counterflex.plan.stability.stretches import Stretch
from counterflex.robot.model.opw import BRANCHES

POINTS: Final = 40
"""Points in the cut that a thinned path has at most."""


def thinned(path: LoadedPath, most: int = POINTS) -> tuple[LoadedPath, Int]:
    """Few points for many: what is cut in pieces of equal length, and the ends of the whole path.

    The cut is divided into ``most`` pieces of equal length. Of each the point stays whose force is nearest to the
    piece's power mean ``(sum ds |F|^4 / sum ds)^(1/4)``; it bears the length of the piece. Points in the air stay where
    they are the first, the last, or lie farthest along an axis of the part, so that reach is that of the whole path.

    Args:
        path: n points.
        most: Pieces of the cut.

    Returns:
        The thinned path, and its (k,) rows in the whole one, rising. The length in the cut is that of the whole path.
    """
    chosen, pieces = _in_the_cut(path, most)
    outer = np.concatenate([path.p_part.argmin(axis=0), path.p_part.argmax(axis=0), [0, len(path) - 1]])
    rows: Int = np.union1d(chosen, outer).astype(np.int64)
    weight = np.zeros(len(path))
    np.add.at(weight, chosen, pieces)
    part = LoadedPath(
        path.p_part[rows],
        path.axis_part[rows],
        path.w_tcp_part[rows],
        path.normals_part[rows],
        weight[rows],
        path.time_s[rows],
        path.run[rows],
    )
    return part, rows


def _in_the_cut(path: LoadedPath, most: int) -> tuple[Int, Float]:
    """Rows that stand for the pieces of the cut, and the lengths of these."""
    cutting = np.flatnonzero(path.weight_m > 0.0)
    weight = path.weight_m[cutting]
    force = np.linalg.norm(path.w_tcp_part[cutting, :3], axis=1)
    along = np.cumsum(weight) - 0.5 * weight
    piece = np.minimum((along / weight.sum() * most).astype(np.int64), most - 1)
    rows, lengths = [], []
    for number in np.unique(piece):
        here = np.flatnonzero(piece == number)
        mean = np.average(force[here] ** POWER, weights=weight[here]) ** (1.0 / POWER)
        rows.append(cutting[here[int(np.argmin(np.abs(force[here] - mean)))]])
        lengths.append(weight[here].sum())
    return np.array(rows, dtype=np.int64), np.array(lengths)


NO_POSTURE: Final = "no single posture leads through the program"
UNTOUCHED: Final = "datum points cannot be touched"
COLLISION: Final = "bodies too close"
CHATTER: Final = "the cut feeds a swing (chatter)"
REFUSALS: Final = FAULTS
"""What refuses a pose of the part in which some point has no posture, by the code of the survey."""
ROTATIONS: Final = 36
"""Rotations about the tool axis that are tried of each candidate: every 10 deg."""
POSTURES: Final = 3
"""Postures of a candidate that are looked at where the cut feeds a swing in the best one, each at least
:data:`NEAR` steps of the grid from the last or in another branch; taken is the one with the most damping."""
NEAR: Final = 3


@dataclass(frozen=True, eq=False)
class Site:
    """A program whose place is searched, thinned."""

    cut: LoadedPath  # thinned path
    robot: RobotHere  # robot and tool; the pose of the part, or of the spindle that stands, is replaced
    freedom: Freedom  # rotations that are tried
    rows: Int  # (m,) rows of the whole path that the thinned one has, rising
    around: Surroundings | None  # bodies that must not touch, tools by the rows of the thinned path; None: nobody looks
    datum_points: Float | None  # (k, 3) m points of the part that the robot must touch, or None
    error: ErrorLeft  # tells the error that is left in a posture
    feeding: Feeding | None = None  # how the cut feeds swings; None: nobody looks

    @property
    def poses(self) -> int:
        """Poses of the robot that are tried for one candidate."""
        return len(self.cut) * self.freedom.rotations * len(BRANCHES)


_FED: Final = 0.4
"""Cost of a candidate in which the cut feeds a swing, m: over any error; up to twice it, the faster the swing grows."""
_REFUSED: Final = 1.0
"""Cost of a refused candidate, m: over any deflection; less by the share of points that can be reached, which leads the
search back to where the part can be reached."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A pose of the part, judged."""

    refused: str = ""  # what refuses it; empty where it can be run
    passed: float = 0.0  # share of the points that the robot can reach in some posture, 0 to 1
    # power mean of the deflection along the cut in the best posture, at rest; infinite where refused
    deflection_m: float = np.inf
    error_m: float = np.inf  # the same with lost motion and swing, by which candidates are ranked
    # damping ratio that the modes have left in the cut; below 0 the cut feeds a swing. NaN: not known
    least_damping: float = np.nan
    # duration of the program, with the time that axes at their largest speeds need between its points
    time_s: float = np.inf
    margin_rad: float = -np.inf  # smallest of the distances to a joint limit or cable and to the wrist singularity
    # smallest distance of coarse bodies, tools left out; infinite where nothing is compared
    clearance_m: float = np.inf
    branch: str = ""  # of the best posture
    rotation_rad: float = 0.0  # about the tool axis
    q: Float | None = None  # (m, 6) rad along the thinned path

    @property
    def cost(self) -> float:
        """Cost for differential evolution: error, then chatter, then what refuses a candidate."""
        if self.refused:
            return _REFUSED * (2.0 - self.passed)
        if self.least_damping < 0.0:
            return _FED * (1.0 - self.least_damping / (1.0 - self.least_damping))
        return self.error_m


def site_of(task: PostureTask, stretches: Sequence[Stretch] = (), rotations: int = ROTATIONS) -> Site:
    """The thinned program of a task.

    Args:
        task: The program on its cell.
        stretches: What it cuts, for the criterion of chatter; none: nobody looks at it.
        rotations: About the tool axis that are tried.
    """
    cut, rows = thinned(task.cut)
    around = task.around
    if around is not None:
        around = replace(around, tool=around.tool[rows])
    error = ErrorLeft.of(task.cut, cut, rows, task.robot.chain, task.setting.mode)
    law = task.setting.law
    fed = feeding(stretches, rows, task.setting, law) if stretches else None
    return Site(cut, task.robot, Freedom(rotations), rows, around, task.setting.datum_points_part, error, fed)


def judge(site: Site, T_base_standing: Float, T_base_before: Float | None = None) -> Candidate:
    """Find the best posture of a place: survey, dynamic programming, distances of bodies.

    Args:
        T_base_standing: (4, 4) of the part; where the robot holds the part, of the spindle's tool frame.
        T_base_before: (4, 4) robot base of the site in that of the candidate, where the robot was carried away.
    """
    robot, cut = site.robot.facing(T_base_standing), site.cut
    around = None if site.around is None else site.around.facing(site.robot, robot, T_base_before)
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
    looked, best = around is None, Candidate(NO_POSTURE, passed)
    tried = 0
    while tried < POSTURES:
        way, _ = best_way(cut, robot, survey, rows, steps, site.freedom.weights)
        if way is None:
            return best
        # Bodies are asked for their distances only where a way exists: that costs far more than the survey.
        close, clearance = (None, np.inf) if around is None else kept(way.q, robot, around)
        if around is not None and close is not None:
            if looked:
                return Candidate(COLLISION, passed) if best.refused else best
            survey.q[:, too_close(survey.q, rows, robot, around)] = np.nan
            looked, best = True, Candidate(COLLISION, passed)
            continue
        match = _worth(site, robot, way, clearance, passed)
        if best.refused or match.least_damping > best.least_damping:
            best = match
        # NaN, where nobody looks at chatter, is no reason to try another posture.
        if not match.least_damping < 0.0:
            return match
        tried += 1
        survey.q[:, site.freedom.near(way.index[0], NEAR), way.slot] = np.nan
    return best


def worth(site: Site, robot: RobotHere, q: Float) -> tuple[float, float, float]:
    """Deflection at rest and error in the power mean, m, and the least damping ratio in the cut (NaN: not known).

    ``robot``: robot and place of the part; ``q``: (m, 6) rad along the thinned path.
    """
    angles = np.ascontiguousarray(q)
    relative, fed = robot.relative_motion(angles), np.nan
    if site.feeding is not None:
        to_part = relative.rows(site.feeding.rows).to_part
        fed = site.feeding.least_damping(robot.chain, angles, to_part)
    return (*site.error.means(site.cut, robot.chain, relative, angles), fed)


def _worth(site: Site, robot: RobotHere, way: Way, clearance_m: float, passed: float) -> Candidate:
    """Accuracy, stability, time and margins of a way."""
    cut, q = site.cut, way.q
    opw = robot.controller_chain.opw
    assert opw is not None  # the survey has refused a robot without closed-form geometry
    # The wrist is straight where theta 5 of the geometry is 0: the controller may count axis 5 from elsewhere.
    wrist = np.arcsin(np.abs(np.sin(opw.signs[4] * q[:, 4] - opw.offsets_rad[4])))
    to_limits = robot.room(q)
    return Candidate(
        "",
        passed,
        *worth(site, robot, q),
        float(np.sum(np.maximum(np.diff(cut.time_s), _least_duration(q, robot)))),
        float(min(to_limits.min(), wrist.min() - robot.limits.wrist_rad)),
        clearance_m,
        BRANCHES[way.slot],
        float(site.freedom.grid_rad[way.index[0]]),
        q,
    )


def _least_duration(q: Float, robot: RobotHere) -> Float:
    """(k - 1,) s, time that the slowest axis needs from point to point; 0 where speeds are not known."""
    if robot.joint_speeds_rad_s is None:
        return np.zeros(len(q) - 1)
    out: Float = np.max(
        np.abs(robot.controller_chain.axes.shown_change(np.diff(q, axis=0))) / np.asarray(robot.joint_speeds_rad_s),
        axis=1,
    )
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
