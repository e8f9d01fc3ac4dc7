"""Choose the posture of a program: survey, best way, and what it is worth beside the present posture."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG
from counterflex.path.tool_rotation import ToolRotation
from counterflex.plan.inputs import Setting
from counterflex.plan.posture.acceleration import too_fast, too_fast_at
from counterflex.plan.posture.clearance import too_close, worst
from counterflex.plan.posture.cut_path import LoadedPath, in_contact, stations
from counterflex.plan.posture.held import Held, PostureTask, held
from counterflex.plan.posture.impossible import in_the_way, no_way, require_possible, too_slow
from counterflex.plan.posture.survey import RobotHere, constant_costs, survey_path
from counterflex.plan.posture.survey_kernel import POWER, Survey
from counterflex.plan.posture.way import Way, Weights, allowed_steps, best_way, least_cost
from counterflex.robot.model.opw import BRANCHES

MOST_EDGES: Final = 2000
ROTATIONS: Final = 72
"""Rotations about the tool axis that are tried: every 5 deg."""
ABOUT_RAD: Final = 10.0 * DEG
_USUAL_RATE_RAD_S: Final = 20.0 * DEG
"""Rate of turning that stations are spaced for where the tool does not turn: between them reversals are not seen."""
SURVEY, WAY, JUDGEMENT = "trying every posture", "finding the way", "comparing"


@dataclass(frozen=True)
class Freedom:
    """Freedoms of the choice of a posture."""

    rotations: int = ROTATIONS  # rotations about the tool axis that are tried, evenly over a turn
    rate_rad_s: float = 0.0  # how fast the tool may turn about its axis in the cut; 0: it stays as it is
    air_rate_rad_s: float = 0.0  # how fast between the cuts
    weights: Weights = field(default_factory=Weights)  # of what costs beside the deflection
    # branch and rotation in rad from which the posture at the beginning must not be further than ABOUT_RAD; None: any
    about: tuple[str, float] | None = None

    @property
    def grid_rad(self) -> Float:
        """(rotations,) rad from 0."""
        return np.arange(self.rotations, dtype=np.float64) * self.step_rad

    @property
    def step_rad(self) -> float:
        """From one rotation to the next."""
        return 2.0 * np.pi / self.rotations

    def near(self, index: int, steps: int) -> Bool:
        """(rotations,) those that are at most so many steps of the grid from one of them."""
        half = self.rotations // 2
        steps_off = (np.arange(self.rotations) - index + half) % self.rotations - half
        return np.asarray(np.abs(steps_off) <= steps)

    def left_out(self) -> Bool:
        """(rotations, 8) postures that are not :attr:`about` the one asked for."""
        out = np.zeros((self.rotations, len(BRANCHES)), dtype=np.bool_)
        if self.about is not None:
            branch, rotation = self.about
            out[:] = True
            rows = self.near(round(rotation / self.step_rad), round(ABOUT_RAD / self.step_rad))
            out[rows, BRANCHES.index(branch)] = False
        return out

    @property
    def turns(self) -> bool:
        """The tool may turn about its axis along the path."""
        return max(self.rate_rad_s, self.air_rate_rad_s) > 0.0


@dataclass(frozen=True, eq=False)
class ChosenPosture:
    """The posture that was chosen."""

    present: Held | None  # as the cell file has it; None where the program cannot be run so
    best: Held  # as chosen
    way: Way  # through the grid
    rows: Int  # (m + 1,) rows of the path that are stations
    costs_m: Float  # (r, 8) m, deflection in the power mean of each posture held all along; infinite where impossible
    bound_m: float  # m, the same with every point in its best posture, free of all constraints: no posture is better
    poses: int  # postures that were tried


def choose(task: PostureTask, freedom: Freedom, progress: Progress = silent) -> ChosenPosture:
    """Choose the posture with the smallest deflection that matters.

    Args:
        task: The program on its cell.
        freedom: What may be chosen.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        ReachError: No posture is possible; names the line and what the best one fails by.
        ModelError: The robot has no closed-form geometry.
    """
    cut, parts = task.cut, in_parts(progress, {SURVEY: 4.0, WAY: 2.0, JUDGEMENT: 1.0})
    rows = stations(cut, freedom.step_rad / (freedom.rate_rad_s or _USUAL_RATE_RAD_S), MOST_EDGES)
    survey = survey_path(cut, task.robot, freedom.grid_rad, rows, parts[SURVEY])
    require_possible(survey, task)
    blocked = cannot_touch(task.setting.datum_points_part, task.robot, freedom) | freedom.left_out()
    # At the first station alone: points are touched, and a posture is asked for, where the program begins.
    survey.q[0, blocked] = np.nan
    parts[WAY](0.0)
    way, best = _free_way(task, freedom, survey, rows, blocked)
    parts[JUDGEMENT](0.0)
    try:
        present = held(task, task.setting)
    except ReachError:
        present = None
    length = float(np.sum(cut.weight_m)) or 1.0
    progress(1.0)
    return ChosenPosture(
        present,
        best,
        way,
        rows,
        np.where(blocked, np.inf, constant_costs(survey) / length ** (1.0 / POWER)),
        (least_cost(cut, survey) / length) ** (1.0 / POWER),
        len(cut) * freedom.rotations * len(BRANCHES),
    )


def _free_way(task: PostureTask, freedom: Freedom, survey: Survey, rows: Int, blocked: Bool) -> tuple[Way, Held]:
    """The best way on which no bodies come too close and no axis has to accelerate beyond its drive."""
    # `blocked` learns of the postures left out for that.
    cut, robot, around = task.cut, task.robot, task.around
    steps = allowed_steps(
        in_contact(cut, rows), np.diff(cut.time_s[rows]), freedom.step_rad, freedom.rate_rad_s, freedom.air_rate_rad_s
    )
    looked, refused = False, None
    while True:
        way, passed = best_way(cut, robot, survey, rows, steps, freedom.weights)
        if way is None:
            raise no_way(passed, rows, task, survey, turns=freedom.turns) if refused is None else refused
        best = held(task, _setting(task, freedom, way, rows))
        fast = too_fast(task.path, robot, best.q)
        if fast is not None:
            refused = refused or too_slow(fast, task)
            problems = too_fast_at(task.path, robot, freedom.grid_rad, fast.point)
            blocked |= problems
            survey.q[:, problems] = np.nan
            _block(survey, blocked, way)
            continue
        close = None if around is None else worst(best.q, robot, around)
        if around is None or close is None:
            return way, best
        refused = refused or in_the_way(close, around, task)
        if looked:
            _block(survey, blocked, way)
        else:
            blocked |= too_close(survey.q, rows, robot, around)
            survey.q[:, blocked] = np.nan
            looked = True


def _setting(task: PostureTask, freedom: Freedom, way: Way, rows: Int) -> Setting:
    """The plan's setting with the posture of a way."""
    start = float(freedom.grid_rad[way.index[0]])
    turning = None
    if np.any(way.steps):
        p = task.path.p_part_tcp
        length = np.cumsum(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1))[rows]
        angle = start + freedom.step_rad * np.concatenate([[0], np.cumsum(way.steps)])
        moved = np.append(np.diff(length) > 0.0, True)  # of stations at one place the last counts
        turning = ToolRotation(tuple(length[moved].tolist()), tuple(angle[moved].tolist()))
        start = turning.angle_rad[0]
    return replace(task.setting, branch=BRANCHES[way.slot], rotation_about_tool_rad=start, turning=turning)


def _block(survey: Survey, blocked: Bool, way: Way) -> None:
    """Leave out the postures of a way."""
    for index in np.unique(way.index):
        blocked[index, way.slot] = True
        survey.q[:, index, way.slot] = np.nan


def cannot_touch(points: Float | None, robot: RobotHere, freedom: Freedom) -> Bool:
    """Postures in which the robot cannot touch the points that its part frame is measured at.

    Args:
        points: (k, 3) m in the part frame; None: it is not measured with the robot.
        robot: Robot, tool and place of the part.
        freedom: Rotations that are tried.

    Returns:
        (r, 8).
    """
    if points is None:
        return np.zeros((freedom.rotations, len(BRANCHES)), dtype=np.bool_)
    k = len(points)
    upright = np.tile([0.0, 0.0, 1.0], (k, 1))
    none = np.zeros(k)
    touched = LoadedPath(points, upright, np.zeros((k, 6)), np.zeros((k, 1, 3)), none, none, np.zeros(k, np.int64))
    q = survey_path(touched, robot, freedom.grid_rad, np.arange(k)).q
    return np.asarray(np.any(np.isnan(q[..., 0]), axis=0))
