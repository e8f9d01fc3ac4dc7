"""Worth of a posture: the deflection, the reversals and the margins of a program that is run in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.path.tool_rotation import ToolRotation
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import Setting, part_compliance, solve_joints
from counterflex.plan.posture.clearance import Surroundings
from counterflex.plan.posture.cut_path import LoadedPath
from counterflex.plan.posture.deflection_kernel import deflection_sizes
from counterflex.plan.posture.survey import RobotHere, base_points
from counterflex.plan.preflight.reversals import reversals, unloadings

SHARE: Final = 0.997
"""Of the path in the cut, below whose deflection a posture is judged, as accuracy is."""


@dataclass(frozen=True, eq=False)
class PostureTask:
    """A program on a cell whose posture is to be chosen."""

    path: ToolPath  # n points of the program
    line: Int  # (n,) source line of each
    cut: LoadedPath  # the same with load and directions
    setting: Setting  # of the plan, with the present posture
    robot: RobotHere  # robot, tool and place of the part
    around: Surroundings | None = None  # bodies that must not touch, or None where nobody looks

    @property
    def middle_of_cut(self) -> Float:
        """(3,) m, middle of what is cut, in the frame of the program."""
        p = self.cut.p_part[self.cut.weight_m > 0.0]
        out: Float = 0.5 * (p.min(axis=0) + p.max(axis=0))
        return out


@dataclass(frozen=True, eq=False)
class Held:
    """A program run in one posture."""

    branch: str  # of the arm
    rotation_rad: float  # about the tool axis at the beginning
    turning: ToolRotation | None  # how the tool turns about its axis along the program; None where it does not
    q: Float  # (n, 6) rad
    deflection_m: Float  # (n,) m, size of the deflection in the directions that matter; 0 out of the cut
    share_m: float  # what 99.7 % of the path in the cut stay below
    largest_m: float
    reversals: int  # axes that turn round in the cut
    unloadings: int  # drives whose torque changes its sign in the cut
    limit_margin_rad: float  # smallest distance to a joint limit
    wrist_rad: float  # smallest angle between axes 4 and 6


def held(task: PostureTask, setting: Setting) -> Held:
    """Judge the posture of a setting on a program.

    Args:
        setting: With the posture.

    Raises:
        ReachError: The program cannot be run so.
    """
    path, cut, robot = task.path, task.cut, task.robot
    joints = solve_joints(path, task.line, setting)
    q, cutting = np.ascontiguousarray(joints.q), cut.weight_m > 0.0
    relative = setting.relative_motion(path)
    w = relative.load(cut.w_tcp_part)
    if setting.T_base_tcp is None:
        points, size = base_points(cut, robot.T_base_part, np.array([0, len(path) - 1])), np.zeros(len(path))
        deflection_sizes(robot.chain.compact, q, points.w, points.normals, size, 0, len(path))
    else:
        bent = (part_compliance(setting, relative, q) @ cut.w_tcp_part[..., None])[:, :3, 0]
        size = np.linalg.norm(np.einsum("nki,ni->nk", cut.normals_part, bent), axis=1)
    size[~cutting] = 0.0
    share = 0.0
    if cutting.any():
        share = float(np.quantile(size[cutting], SHARE, weights=cut.weight_m[cutting], method="inverted_cdf"))
    return Held(
        setting.branch,
        setting.rotation_about_tool_rad,
        setting.turning,
        q,
        size,
        share,
        float(size.max(initial=0.0)),
        len(reversals(robot.chain, q, w, cutting)),
        len(unloadings(robot.chain, q, w, cutting)),
        float(joints.limit_margin_rad.min()),
        float(np.arcsin(min(1.0, float(joints.wrist.min())))),
    )
