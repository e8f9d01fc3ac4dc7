"""From a tool path to a compensated one: predict force and deflection point by point and move the points against them.

Where the compensation works, the tool runs along the nominal path; so the force that decides the correction is that of
the *undisturbed* cut. Commanded = nominal - (deflection under that force + sag that is left + lost motion of the
drives), shaped in time. That command is tried on the robot in motion and mended by what it leaves; the last trial,
and one of the program as it is, are the prediction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.progress import Progress, in_parts, share_of, silent
from counterflex.cutting.stability.process import process_of_side_cut
from counterflex.cutting.stock import HeightMap
from counterflex.path.path_speed import time_as_run
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.feed_schedule import FeedGroups, at_feed, feed_share, share_between
from counterflex.plan.inputs import (
    CORRECTION,
    JOINTS,
    MENDED,
    TRIAL,
    UNCOMPENSATED,
    UNDISTURBED,
    CompensationInputs,
    Setting,
    solve_joints,
    work_of,
)
from counterflex.plan.lowest_mode import can_move
from counterflex.plan.plan import Plan, across
from counterflex.plan.stability.criterion import robot_limit
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.static_correction import (
    Command,
    LoadedRobot,
    check_corrections,
    lasting,
    loaded_robot,
    static_correction,
)
from counterflex.plan.stock_grain import fine_enough, grain_per_cell
from counterflex.plan.tool_deviation import lost_motion, run
from counterflex.plan.undisturbed_cut import undisturbed_cut

# Cuts of a trial that chatter, by the criterion of ``plan stability``: what it leaves there is no error to mend.
# Looked at are cuts of which the trial leaves a large share of the deflection: where the row that it leaves most of, or
# the deepest row, chatters with the arc of engagement of the undisturbed cut, the rest is a swing that feeds itself.

SWINGS: Final = 0.1
"""Residual of a cut, as a share of its deflection (root mean squares across the path), from which it is looked at. The
model in motion leaves less where it does not swing. At 0.3 a soft arm that bent by 2.2 mm and swung by 0.5 mm at 45 Hz
passed (0.24): the offset of its swing was taken for an error and commanded against, which left 0.59 mm at the exit."""


def chattering(loaded: LoadedRobot, deviation: Float, cut_of_row: Int) -> Bool:
    """(n,) rows of cuts that chatter in a trial.

    ``deviation``: (n, 6) m, rad, that the trial leaves; ``cut_of_row``: (n,) number of the cut of each row, from 0.
    """
    p, contact = loaded.inputs.path.p_part_tcp, loaded.cut.contact
    left, bend = (np.sum(across(d[:, :3], p) ** 2, axis=1) for d in (deviation, loaded.deflection_part))
    count = int(cut_of_row[-1]) + 1
    sums = [np.bincount(cut_of_row, np.where(contact, square, 0.0), count) for square in (left, bend)]
    out = np.zeros(count, dtype=np.bool_)
    for cut in np.flatnonzero((sums[0] >= SWINGS**2 * sums[1]) & (sums[1] > 0.0)).tolist():
        rows = np.flatnonzero(contact & (cut_of_row == cut))
        looked = {int(rows[np.argmax(left[rows])]), int(rows[np.argmax(loaded.cut.cut.axial_depth_m[rows])])}
        out[cut] = any(limit_of_row(loaded, row) < 1.0 for row in looked)
    chatters: Bool = out[cut_of_row]
    return chatters


def limit_of_row(loaded: LoadedRobot, row: int) -> float:
    """Factor on the depth at which the undisturbed cut of a row chatters; inf where it has no side engagement."""
    path, setting, cut = loaded.inputs.path, loaded.inputs.setting, loaded.cut.cut
    entry, leave = float(cut.entry_rad[row]), float(cut.exit_rad[row])
    depth, feed = float(cut.axial_depth_m[row]), float(cut.feed_per_tooth_m[row])
    axis = path.axis_part[row]
    step = path.p_part_tcp[row] - path.p_part_tcp[row - 1]
    aside = step - float(step @ axis) * axis
    size = float(np.linalg.norm(aside))
    if not (leave > entry and depth > 0.0 and feed > 0.0 and size > 0.0):
        return math.inf
    cutter = setting.cutter_of(int(path.tool[row]))
    A = process_of_side_cut(cutter, setting.law, entry, leave, depth, feed).mean
    R = np.stack([aside / size, np.cross(axis, aside / size), axis], axis=1)
    relative = setting.relative_motion(path).to_part
    modes = robot_modes(
        setting.chain, loaded.inputs.q[row], relative[min(row, len(relative) - 1)], setting.mode, setting.damping.ratio
    )
    period = 2.0 * math.pi / (cutter.flutes * abs(float(path.spindle_rad_s[row])))
    return robot_limit(modes, R @ A @ R.T, period).factor


_SHARE = 0.7
"""Of what is left: friction and cutting answer otherwise than the one mode that inverts the command."""
_MENDS = 3
"""Trials that may mend the command, the further ones only where the one before was better and leaves much."""
_MUCH = 0.15
"""More than such a share of what the command takes back there; the model is accurate to a tenth."""
_BLEND_S = 0.1
"""Over which a change that is taken begins and ends."""


def plan(
    path: ToolPath,
    line_of_motion: Int,
    stock: HeightMap,
    setting: Setting,
    *,
    feeds: FeedGroups | None = None,
    predict: bool = True,
    progress: Progress = silent,
) -> Plan:
    """Plan the compensation of a path.

    Args:
        line_of_motion: (motions,) source line of each program motion.
        stock: The blank; left as it is.
        setting: Robot, part, tools, law, bounds.
        feeds: Where the feed may be lowered so that the arm does not swing; None leaves it as it is.
        predict: Also predict the deviations of the uncompensated and the compensated program.
        progress: Progress callback, fraction 0 to 1; may raise to interrupt.

    Raises:
        ReachError: A point cannot be reached within limits; names the source line.
        ModelError: A correction is beyond its bound, force comes from chips outside the law's range, or a cut is deeper
            than the flutes are long.
        ProgramError: Material is cut with the spindle stopped.
    """
    line: Int = line_of_motion[path.motion]
    seconds = float(path.time_s[-1] - path.time_s[0]) if len(path) else 0.0
    moves = can_move(setting.chain)
    mends = moves and setting.chain.servo is not None and setting.shaping.smoothing_s > 0.0
    work = work_of(len(path), seconds, moves=moves, mends=mends, predicts=predict)
    parts = in_parts(progress, work)
    parts[JOINTS](0.0)
    inputs = CompensationInputs(as_run(path, setting), line, stock, setting, solve_joints(path, line, setting).q)
    # Two robots are kept: the prediction of the program as it is needs its own feed, not the lowered one.
    programmed = in_fine_stock(loaded_robot(inputs, undisturbed_cut(inputs, parts[UNDISTURBED])))
    loaded = programmed if feeds is None else at_calm_feed(programmed, feeds)
    undisturbed = loaded.cut
    displacement, static = static_correction(loaded, parts[CORRECTION])
    command, trial = dynamic_trial(loaded, displacement, static, parts)
    # Asked of the command that is written, behind every trial that may have changed it.
    check_corrections(command, line, setting.limits)
    prediction = predict_deviations(programmed, trial, parts)
    progress(1.0)
    cut = undisturbed.cut
    return Plan(
        path=at_feed(path, share_between(path, loaded.inputs.path)),
        line=line,
        q=inputs.q,
        w_tcp_part=undisturbed.w_tcp_part,
        deflection_part=loaded.deflection_part,
        sag_part=loaded.robot.sag_part,
        play_part=lost_motion(loaded.robot, command.q, undisturbed.w_tcp_part),
        correction_part=command.correction_part,
        rotvec_part=command.rotvec_part,
        volume_m3=cut.volume_m3,
        axial_depth_m=cut.axial_depth_m,
        entry_rad=cut.entry_rad,
        exit_rad=cut.exit_rad,
        feed_per_tooth_m=cut.feed_per_tooth_m,
        deviation_nominal_part=prediction.deviation_nominal_part,
        deviation_compensated_part=prediction.deviation_compensated_part,
        w_nominal_part=prediction.w_nominal_part,
        extrapolated=undisturbed.extrapolated.astype(np.int64),
        chip_m=cut.chip_m,
        recut=prediction.cutting & _fed(path) & ~undisturbed.contact,
    )


def _fed(path: ToolPath) -> Bool:
    """(n,) True in rows that are fed somewhere: a row without length has no direction to be off across."""
    moves = np.any(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]) != 0.0, axis=1)
    out: Bool = (path.kind == FEED) & moves
    return out


def at_calm_feed(loaded: LoadedRobot, feeds: FeedGroups) -> LoadedRobot:
    """The same robot with the feed lowered where the arm would swing; its force is that of the thinner chips."""
    inputs, cut = loaded.inputs, loaded.cut
    swing_m = inputs.setting.swing_m
    if np.max(np.linalg.norm(loaded.deflection_part[:, :3], axis=1), initial=0.0) <= swing_m:
        return loaded  # an arm that yields less than it may swing
    share = feed_share(
        inputs.path,
        loaded.deflection_part[:, :3],
        cut.contact,
        cut.cut.feed_per_tooth_m,
        loaded.robot.mode.omega_rad_s,
        swing_m,
        feeds,
    )
    if np.all(share == 1.0):
        return loaded
    slowed = replace(inputs, path=as_run(at_feed(inputs.path, share), inputs.setting))
    return loaded_robot(slowed, undisturbed_cut(slowed, silent))


def as_run(path: ToolPath, setting: Setting) -> ToolPath:
    """The same path with the times at which the controller has the tool at its points.

    It speeds up and brakes for tens of milliseconds where the feed changes; a correction sent by the times of the
    program reaches such a place as much too early.
    """
    if len(path) < 2:
        return path
    return replace(path, time_s=time_as_run(path, setting.blending_m, setting.acceleration_m_s2))


def in_fine_stock(loaded: LoadedRobot) -> LoadedRobot:
    """The same robot in stock whose grain does not shake the tool; see :mod:`counterflex.plan.stock_grain`."""
    inputs, omega = loaded.inputs, loaded.robot.mode.omega_rad_s
    per_cell = grain_per_cell(inputs.path, loaded.deflection_part, loaded.cut.contact, inputs.setting.cutter_of, omega)
    stock = fine_enough(inputs.stock, per_cell)
    if stock is inputs.stock:
        return loaded
    finer = replace(inputs, stock=stock)
    return loaded_robot(finer, undisturbed_cut(finer, silent))


@dataclass(frozen=True, eq=False)
class Trial:
    """A command run on the robot in motion."""

    deviation_part: Float  # (n, 6) m, rad, of the tool from the programmed path, part axes
    cutting: Bool  # (n,) True where teeth meet material


def dynamic_trial(
    loaded: LoadedRobot, displacement: Float, command: Command, parts: Mapping[str, Progress]
) -> tuple[Command, Trial]:
    """Try a command, take back a share of its deviation, and keep the better of the two commands at each place.

    Repeat where the deviation is still large, at most :data:`_MENDS` times. Cuts that chatter are left as they are
    (:mod:`counterflex.plan.compensate`).

    Args:
        loaded: The robot under load.
        displacement: (n, 6) m, rad that the command takes back.
        command: The correction at rest.
        parts: Progress of the parts of the work; without :data:`~counterflex.plan.inputs.MENDED` nothing is mended, and
            without :data:`~counterflex.plan.inputs.UNCOMPENSATED` (no prediction is asked for) nothing is tried for its
            own sake.

    Returns:
        The command, and what it leaves in motion; a deviation of zero if nothing was tried.
    """
    mends = MENDED in parts and bool(np.any(loaded.cut.contact))
    if not mends and UNCOMPENSATED not in parts:
        return command, Trial(np.zeros_like(displacement), loaded.cut.contact)
    trial = _tried(loaded, command, parts[TRIAL])
    if not mends:
        return command, trial
    remaining = trial.deviation_part
    unfinished = ~chattering(loaded, remaining, _cuts(loaded))
    left, allowed = loaded.size_about(remaining), _MUCH**4 * loaded.size_about(displacement)
    for done in range(_MENDS):
        if not np.any(unfinished):
            break
        change = _SHARE * _correctable(loaded, _blended(loaded, unfinished) * remaining)
        reported = share_of(parts[MENDED], 0.0 if done == 0 else 1.0, 1.0)  # the further ones are seldom
        next_trial = _tried(loaded, loaded.command_against(displacement + change), reported)
        size = loaded.size_about(next_trial.deviation_part)
        better = unfinished & (size <= left)
        displacement = displacement + _blended(loaded, better) * change
        remaining = np.where(better[:, None], next_trial.deviation_part, remaining)
        trial = Trial(remaining, np.where(better, next_trial.cutting, trial.cutting))
        left = np.where(better, size, left)
        unfinished = better & (left > allowed)
    return loaded.command_against(displacement), trial


def _cuts(loaded: LoadedRobot) -> Int:
    """(n,) number of the cut of each row, from rapid to rapid."""
    kind = loaded.inputs.path.kind
    out: Int = np.cumsum(np.diff(kind, prepend=kind[:1]) != 0)
    return out


def _blended(loaded: LoadedRobot, rows: Bool) -> Float:
    """(n, 1) share 0..1 of a change that is taken in some rows, even over :data:`_BLEND_S` at their ends."""
    return lasting(rows[:, None].astype(np.float64), loaded.inputs.path.time_s, _BLEND_S)


def _tried(loaded: LoadedRobot, command: Command, progress: Progress) -> Trial:
    cut, deviation = run(loaded.robot, loaded.inputs.stock, command.q, command.correction_part, progress)
    return Trial(deviation, cut.axial_depth_m > 0.0)


def _correctable(loaded: LoadedRobot, deviation: Float) -> Float:
    """Return the correctable part of a deviation: without what is faster than the robot."""
    setting, path = loaded.inputs.setting, loaded.inputs.path
    left = deviation if setting.orientation else np.pad(deviation[:, :3], ((0, 0), (0, 3)))
    if setting.normal_only:
        left = np.concatenate([across(left[:, :3], path.p_part_tcp), left[:, 3:]], axis=1)
    return loaded.shaped(left, np.zeros_like(left))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Deviations of the tool from the programmed path, part axes; NaN where nothing was predicted."""

    deviation_nominal_part: Float  # (n, 3) m, the program as it is
    deviation_compensated_part: Float  # (n, 3) m, the compensated program
    w_nominal_part: Float  # (n, 6) N, N m, force on the tool that the program as it is makes
    cutting: Bool  # (n,) True where teeth meet material in one of the two


def predict_deviations(loaded: LoadedRobot, trial: Trial, parts: Mapping[str, Progress]) -> Prediction:
    """Run the program as it is on the moving robot; what the compensated one leaves is known from its trial.

    Args:
        loaded: The robot under load at the programmed feed.
        parts: Progress of the parts of the work; without :data:`~counterflex.plan.inputs.UNCOMPENSATED` nothing is
            predicted.
    """
    n = len(loaded.inputs.path)
    if UNCOMPENSATED not in parts:
        nothing, none = np.full((n, 3), np.nan), np.zeros(n, dtype=np.bool_)
        return Prediction(nothing, nothing, np.full((n, 6), np.nan), none)
    as_it_is = np.zeros((n, 3))
    bent, deviation = run(loaded.robot, loaded.inputs.stock, loaded.inputs.q, as_it_is, parts[UNCOMPENSATED])
    cutting = trial.cutting | (bent.axial_depth_m > 0.0)
    return Prediction(deviation[:, :3], trial.deviation_part[:, :3], bent.w_tcp_part, cutting)
