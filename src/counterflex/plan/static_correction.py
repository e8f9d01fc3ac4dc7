"""The correction at rest: against deflection, own weight and lost motion, shaped in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.batches import batches
from counterflex.core.errors import ModelError
from counterflex.core.progress import Progress
from counterflex.core.units import DEG, MM
from counterflex.geometry import wrench
from counterflex.plan.holes import held_in_holes
from counterflex.plan.inputs import Inputs, feed_runs, part_compliance
from counterflex.plan.lost_motion import corrected_joints
from counterflex.plan.part_frame import residual_sag, touched_points
from counterflex.plan.plan import across
from counterflex.plan.response import within
from counterflex.plan.setting import Limits, Setting
from counterflex.plan.tool_deviation import PlannedRobot, lost_motion, mode_of
from counterflex.plan.undisturbed_cut import UndisturbedCut
from counterflex.robot.elasticity import compliance
from counterflex.signals.preview import by_group

_PLAY_ROUNDS = 3
"""How often the correction is made again for what the axes lose at rest: a correction moves them."""
APPROACH_S = 0.3
"""So long before and after contact the path is freed of sag and lost motion too: cuts begin in the right place."""
_FADE_S = 0.2
"""Beyond that, corrections that are left over from shaping are taken for zero."""


@dataclass(frozen=True, eq=False)
class LoadedRobot:
    """The robot under the force of the undisturbed cut, at rest in every row.

    Attributes:
        inputs: Path and setting.
        cut: The undisturbed cut.
        robot: The robot along the path; its mode is that of the posture with the largest force.
        deflection_part: (n, 6) m, rad under the force.
        swinging_part: (n, 6) the part of it that the arm makes, which follows a force as a mode does.
        feed_run: (n,) number of the run of even motion.
        near: (n,) rows in contact or within :data:`APPROACH_S` of it: corrected.
        reach: (n,) rows where shaping may leave a correction.
    """

    inputs: Inputs
    cut: UndisturbedCut
    robot: PlannedRobot
    deflection_part: Float
    swinging_part: Float
    feed_run: Int
    near: Bool
    reach: Bool


@dataclass(frozen=True, eq=False)
class Command:
    """A correction as it is commanded.

    Attributes:
        correction_part: (n, 3) m.
        rotvec_part: (n, 3) rad.
        q: (n, 6) rad, joint angles with both.
    """

    correction_part: Float
    rotvec_part: Float
    q: Float


def loaded_robot(inputs: Inputs, cut: UndisturbedCut) -> LoadedRobot:
    """Deflection under the force of the undisturbed cut, own weight, and where corrections are wanted."""
    path, setting, q, w = inputs.path, inputs.setting, inputs.q, cut.w_tcp_part
    R = setting.T_base_part[:3, :3]
    deflection = wrench.rotate(R.T, compliance.deflection(setting.chain, q, wrench.rotate(R, w)))
    hardest = q[int(np.argmax(np.linalg.norm(w[:, :3], axis=1)))]
    robot = PlannedRobot(
        setting,
        path,
        q,
        part_compliance(setting, q),
        residual_sag(path.p_part_tcp, q, setting),
        touched_points(setting),
        mode_of(setting.chain, hardest, setting.mode),
    )
    feed_run = feed_runs(path)
    near = within(cut.contact, path.time_s, feed_run, APPROACH_S)
    reach = within(near, path.time_s, feed_run, _FADE_S)
    return LoadedRobot(inputs, cut, robot, deflection, _through_arm(setting, q, w, deflection), feed_run, near, reach)


def shaped(loaded: LoadedRobot, displacement: Float, swinging: Float) -> Float:
    """A displacement (n, 6) as the controller has to be told it in time, zero away from the cut.

    Args:
        loaded: Where corrections are wanted, and the mode.
        displacement: (n, 6) m, rad that follow the command at once.
        swinging: (n, 6) that follow it as the mode does.
    """
    time_s, robot = loaded.inputs.path.time_s, loaded.robot
    wanted = np.where(loaded.near[:, None], displacement, 0.0)
    out = by_group(wanted, swinging, time_s, loaded.feed_run, (robot.mode,), robot.setting.shaping)
    out[~loaded.reach] = 0.0
    return out


def command_against(loaded: LoadedRobot, displacement: Float) -> Command:
    """The command that takes back a displacement (n, 6), as far as the setting lets it."""
    inputs, setting = loaded.inputs, loaded.inputs.setting
    correction = 0.0 - displacement[:, :3]
    if setting.normal_only:
        correction = across(correction, inputs.path.p_part_tcp)
    turn = 0.0 - displacement[:, 3:] if setting.orientation else np.zeros_like(correction)
    correction, turn = held_in_holes(inputs.path, loaded.cut.contact, correction, turn)
    q = corrected_joints(setting.controller_chain, setting.T_base_part, inputs.q, correction, turn)
    return Command(correction, turn, q)


def static_correction(loaded: LoadedRobot, progress: Progress) -> tuple[Float, Command]:
    """The correction of a robot that comes to rest in every row.

    ``correction = -shaped(deflection + sag + lost motion)``. Lost motion depends on the commanded angles, so it is
    found again for each command, :data:`_PLAY_ROUNDS` times.

    Args:
        loaded: The robot under load.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The displacement (n, 6) m, rad that is taken back, and the command that does it.
    """
    w, robot, deflection = loaded.cut.w_tcp_part, loaded.robot, loaded.deflection_part
    static = np.concatenate([deflection[:, :3] + robot.sag_part, deflection[:, 3:]], axis=1)

    q = loaded.inputs.q
    for done in range(_PLAY_ROUNDS + 1):
        progress((done + 1.0) / (_PLAY_ROUNDS + 2.0))
        lost = np.pad(lost_motion(robot, q, w), ((0, 0), (0, 3)))
        displacement = shaped(loaded, static - loaded.swinging_part + lost, loaded.swinging_part)
        command = command_against(loaded, displacement)
        q = command.q
    progress(1.0)
    return displacement, command


def check_corrections(command: Command, line: Int, limits: Limits) -> None:
    """Refuse a correction that is beyond its bound.

    Raises:
        ModelError: Names the source line, the size and the key of the bound.
    """
    for values, limit, unit, name, key in (
        (command.correction_part, limits.correction_m, MM, "mm", "correction_mm"),
        (command.rotvec_part, limits.rotation_rad, DEG, "deg", "correction_deg"),
    ):
        size = np.linalg.norm(values, axis=1)
        row = int(np.argmax(size)) if len(size) else 0
        if len(size) and size[row] > limit:
            raise ModelError(
                "the correction needed is beyond its bound",
                where=f"line {int(line[row])}",
                value=f"{size[row] / unit:.3f} {name}",
                limit=f"<= {limit / unit:g} {name} (limits.{key})",
                hint="Cut less at a time, place the part better, or raise the bound if it is safe",
            )


def _through_arm(setting: Setting, q: Float, w_part: Float, deflection_part: Float) -> Float:
    """The part of the deflection that the arm makes, swinging; sensor, spindle and tool follow a force at once."""
    R = setting.T_base_part[:3, :3]
    rows = np.flatnonzero(np.any(w_part != 0.0, axis=1))
    out = np.zeros_like(deflection_part)
    if len(rows):
        w_base, at_once = wrench.rotate(R, w_part[rows]), np.empty((len(rows), 6))
        for some in batches(len(rows)):
            own = compliance.shares(setting.chain, q[rows[some]], w_base[some])
            at_once[some] = np.sum(own[:, setting.chain.flange_segment + 1 :], axis=1)
        out[rows] = deflection_part[rows] - wrench.rotate(R.T, at_once)
    return out
