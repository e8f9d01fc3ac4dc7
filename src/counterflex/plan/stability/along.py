"""Margin against chatter of every stretch of a path.

Robot: :mod:`counterflex.plan.stability.criterion` with the modes of the posture. Spindle and tool: the zeroth-order
solution with their response at the spindle speed. The margin is the factor by which the cut could be deeper; below 1
the cut chatters. At the worst stretch of a tool, semi-discretisation with all modes together confirms it
(:func:`confirmed`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG
from counterflex.cutting.stability import lobes, semi_discretisation
from counterflex.cutting.stability.modes import TipModes
from counterflex.cutting.stability.process import Process
from counterflex.cutting.stability.response import Response, fitted_modes
from counterflex.cutting.stock import BlankBox, HeightMap
from counterflex.path.toolpath import ToolPath
from counterflex.plan.elastic_motion import postures
from counterflex.plan.inputs import Setting, joint_angles
from counterflex.plan.lowest_mode import Damping
from counterflex.plan.stability.criterion import LARGEST, Limit, SharedLimits
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.stability.stretches import Stretch, stretches_of
from counterflex.signals.preview import Mode

POSTURE_RAD: Final = 2.0 * DEG
"""Change of an axis after which modes are computed anew."""
ENGAGEMENT, MARGINS = "engagement", "margins"
TOOL = "spindle and tool"


@dataclass(frozen=True, eq=False)
class Structure:
    """The swinging structure."""

    damping: Damping  # of the robot's modes
    measured: Mode | None  # lowest mode of the robot by a tap test, or None
    # spindle and tool in the TCP frame, by a measured response or by modes; None: rigid
    tip: Response | TipModes | None = None

    @property
    def robot_below(self) -> float:
        """Angular frequency from which a measured response holds what the robot does, too; inf without one."""
        return float(self.tip.omega_rad_s[0]) if isinstance(self.tip, Response) else math.inf

    def tip_modes(self) -> tuple[TipModes | None, float]:
        """Modes of spindle and tool, fitted where a response was measured, and the unexplained share of it."""
        if isinstance(self.tip, Response):
            return fitted_modes(self.tip)
        return self.tip, 0.0

    def tip_response(self) -> Response | None:
        """Response of spindle and tool."""
        if isinstance(self.tip, TipModes):
            omega = lobes.frequencies_for(self.tip)
            return Response(omega, self.tip.response(omega))
        return self.tip


@dataclass(frozen=True, eq=False)
class Margin:
    """A stretch and how far it is from chatter."""

    stretch: Stretch
    process: Process  # its directional coefficients, feed frame
    R_part_feed: Float  # (3, 3) feed frame (x along the feed, z along the tool axis) in part axes
    R_part_tcp: Float  # (3, 3) TCP frame in part axes
    robot: TipModes  # modes of the robot there, part axes
    low_frequency: float  # factor on the depth by the low-frequency criterion with the slow modes; inf without a limit
    robot_margin: float  # factor on the depth of all modes of the robot, at most LARGEST
    tool_margin: float  # the same of spindle and tool; LARGEST without a response
    method: str  # how the smaller one was found
    chatter_hz: float  # frequency of chatter at the limit; nan without one

    @property
    def margin(self) -> float:
        """The smaller of both."""
        return min(self.robot_margin, self.tool_margin)


def margins(
    path: ToolPath,
    stock: HeightMap,
    setting: Setting,
    structure: Structure,
    blank: BlankBox | None = None,
    *,
    progress: Progress = silent,
) -> list[Margin]:
    """Margin of every stretch of a path.

    Args:
        stock: The blank; left as it is.
        structure: What swings.
        blank: The blank as a box, see :func:`counterflex.plan.stability.stretches.stretches_of`.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        CounterflexError: The path cannot be reached or cut, or no modes of the robot are known.
    """
    parts = in_parts(progress, {ENGAGEMENT: 1.0, MARGINS: 2.0})
    pieces = stretches_of(path, stock.copy(), setting.cutter_of, blank, progress=parts[ENGAGEMENT])
    if not pieces:
        return []
    rows = np.array([piece.row for piece in pieces])
    Ts_part_tcp = setting.poses_in_part(path)
    q = joint_angles(path, setting).q[rows]
    to_part = setting.relative_motion(path).rows(rows).to_part
    Rs_part_tcp = Ts_part_tcp[rows, :3, :3]
    number, _ = postures(q, POSTURE_RAD)
    tip = structure.tip_response()
    modes: dict[int, TipModes] = {}
    robot_limits, tool_limits = SharedLimits(), SharedLimits(_tool_limit)
    out = []
    for at, piece in enumerate(pieces):
        posture = int(number[at])
        if posture not in modes:
            all_of_robot = robot_modes(
                setting.chain, q[at], to_part[min(at, len(to_part) - 1)], structure.measured, structure.damping.ratio
            )
            modes[posture] = all_of_robot.only(all_of_robot.omega_rad_s < structure.robot_below)
        process = piece.process(setting.law, setting.cutter_of(piece.tool).flutes)
        R = piece.R_part_feed
        A, T = R @ process.mean @ R.T, piece.period_s
        robot = robot_limits(posture, modes[posture], A, T)
        tool = Limit(LARGEST, math.nan, TOOL)
        if tip is not None:
            R_tcp = Rs_part_tcp[at]
            tool = tool_limits(0, tip, R_tcp.T @ A @ R_tcp, T)
        least = tool if tool.factor < robot.factor else robot
        out.append(
            Margin(
                piece, process, R, Rs_part_tcp[at], modes[posture], robot.low, robot.factor, tool.factor,
                least.method, least.omega / (2.0 * math.pi),
            )
        )  # fmt: skip
        parts[MARGINS]((at + 1) / len(pieces))
    return out


def confirmed(worst: Margin, structure: Structure) -> float:
    """Margin of a stretch by semi-discretisation, robot and tool together; inf above twice the margin.

    Raises:
        InputError: The response of the tool has no mode.
    """
    modes = all_modes(worst, structure)
    return semi_discretisation.limit(
        modes, worst.process, worst.stretch.period_s, most=2.0 * worst.margin, least=0.6 * worst.margin
    )


def all_modes(margin: Margin, structure: Structure) -> TipModes:
    """Modes of robot, spindle and tool at a stretch, in the feed frame."""
    robot = margin.robot.turned(margin.R_part_feed.T)
    tip, _ = structure.tip_modes()
    if tip is None:
        return robot
    tip = tip.turned(margin.R_part_feed.T @ margin.R_part_tcp)
    return TipModes(
        np.concatenate([robot.omega_rad_s, tip.omega_rad_s]),
        np.concatenate([robot.damping_ratio, tip.damping_ratio]),
        np.concatenate([robot.shape, tip.shape], axis=1),
    )


def _tool_limit(tip: Response, A: Float, T: float) -> Limit:
    factors, chatter = lobes.limits(A, tip.receptance, tip.omega_rad_s, np.array([T]))
    return Limit(float(factors[0]), float(chatter[0]), TOOL)
