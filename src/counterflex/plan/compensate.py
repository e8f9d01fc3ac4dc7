"""From a tool path to a compensated one: predict force and deflection point by point and move the points against them.

Where the compensation works, the tool runs along the nominal path; so the force that decides the correction is that of
the *undisturbed* cut. Commanded = nominal - (deflection under that force + sag that is left + lost motion of the
drives), shaped in time. That command is tried on the robot in motion and mended once by what it leaves; the last trial,
and one of the program as it is, are the prediction.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.batches import batches
from counterflex.core.errors import ModelError, ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG, MM
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import wrench
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.cut import Cut, at_points, cut
from counterflex.plan.flute_length import check_flutes
from counterflex.plan.holes import held_in_holes
from counterflex.plan.lost_motion import corrected_joints
from counterflex.plan.part_frame import sag_deviation, true_part_frame
from counterflex.plan.plan import Plan, across, impulse_share
from counterflex.plan.response import lasting, within
from counterflex.plan.setting import Limits, Setting
from counterflex.plan.tool_deviation import Robot, can_move, lost_motion, mode_of, run
from counterflex.plan.tool_frame import tool_orientation, tool_poses
from counterflex.plan.work import CORRECTION, JOINTS, MENDED, TRIAL, UNCOMPENSATED, UNDISTURBED, work_of
from counterflex.robot.elasticity import compliance, gravity
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import PathSolution, inverse_path
from counterflex.signals.preview import by_group

EXTRAPOLATED_SHARE = 0.02
"""Share of the force impulse that may come from chips outside the law's range before planning refuses."""
_CONTACT_M3 = 1e-12
_PLAY_ROUNDS = 3
"""How often the correction is made again for what the axes lose at rest: a correction moves them."""
_BELIEVED = 0.3
"""Share of the deflection that the trial may leave: if it leaves more, the model chatters and teaches nothing."""
_SHARE = 0.7
"""Of what is left: friction and cutting answer otherwise than the one mode that inverts the command."""
APPROACH_S = 0.3
"""So long before and after contact the path is freed of sag and lost motion too: cuts begin in the right place."""
_FADE_S = 0.2
"""Beyond that, corrections that are left over from shaping are taken for zero."""


def plan(
    path: ToolPath,
    line_of_motion: Int,
    stock: HeightMap,
    setting: Setting,
    *,
    predict: bool = True,
    progress: Progress = silent,
) -> Plan:
    """Plan the compensation of a path.

    Args:
        path: The nominal path.
        line_of_motion: (motions,) source line of each program motion.
        stock: The blank; left as it is.
        setting: Robot, part, tools, law, bounds.
        predict: Also predict the deviations of the uncompensated and the compensated program.
        progress: Told the fraction done; may raise to interrupt.

    Returns:
        The plan.

    Raises:
        ReachError: A point cannot be reached within limits; names the source line.
        ModelError: A correction is beyond its bound, force comes from chips outside the law's range, or a cut is deeper
            than the flutes are long.
        ProgramError: Material is cut with the spindle stopped.
    """
    known = can_move(setting.chain) and setting.chain.servo is not None
    tries = known and setting.shaping.smoothing_s > 0.0
    seconds = float(path.time_s[-1] - path.time_s[0]) if len(path) else 0.0
    work = work_of(len(path), seconds, moves=can_move(setting.chain), mends=tries, predicts=predict)
    parts = in_parts(progress, work)
    line: Int = line_of_motion[path.motion]
    parts[JOINTS](0.0)
    joints = solve_joints(path, line, setting)
    undisturbed = cut(
        path,
        path.p_part_tcp,
        stock.copy(),
        setting.cutter_of,
        setting.law,
        progress=parts[UNDISTURBED],
    )
    contact = (path.kind == FEED) & (undisturbed.volume_m3 > _CONTACT_M3)
    check_flutes(path, undisturbed.volume_m3, setting.cutter_of, lambda row: _place(path, line, row))
    extrapolated = _check_chips(undisturbed, contact, path, line, setting)
    w = at_points(undisturbed.w_tcp_part, contact)
    R_base_part = setting.T_base_part[:3, :3]
    deflection = wrench.rotate(
        R_base_part.T, compliance.deflection(setting.chain, joints.q, wrench.rotate(R_base_part, w))
    )
    sag = residual_sag(path.p_part_tcp, joints.q, setting)
    touched = touched_points(setting)
    hardest = joints.q[int(np.argmax(np.linalg.norm(w[:, :3], axis=1)))]
    mode = mode_of(setting.chain, hardest, setting.mode)
    robot = Robot(setting, path, joints.q, part_compliance(setting, joints.q), sag, touched, mode)
    parts[CORRECTION](1.0 / (_PLAY_ROUNDS + 2.0))
    static = np.concatenate([deflection[:, :3] + sag, deflection[:, 3:]], axis=1)
    feed_run = feed_runs(path)
    near = within(contact, path.time_s, feed_run, APPROACH_S)
    reach = within(near, path.time_s, feed_run, _FADE_S)
    swung = _through_arm(setting, joints.q, w, deflection)

    def shaped(wanted: Float, swinging: Float) -> Float:
        out = by_group(np.where(near[:, None], wanted, 0.0), swinging, path.time_s, feed_run, (mode,), setting.shaping)
        out[~reach] = 0.0
        return out

    def at_rest(lost: Float) -> Float:
        return shaped(static - swung + np.pad(lost, ((0, 0), (0, 3))), swung)

    def commanded(against: Float) -> tuple[Float, Float, Float]:
        correction = 0.0 - against[:, :3]
        if setting.normal_only:
            correction = across(correction, path.p_part_tcp)
        turn = 0.0 - against[:, 3:] if setting.orientation else np.zeros_like(correction)
        correction, turn = held_in_holes(path, contact, correction, turn)
        chain, T_base_part = setting.controller_chain, setting.T_base_part
        return correction, turn, corrected_joints(chain, T_base_part, joints.q, correction, turn)

    def tried(q_command: Float, correction: Float, part: str) -> Float:
        return run(robot, stock, q_command, correction, parts[part])[1]

    def size(deviation: Float) -> float:
        return float(np.sqrt(np.mean(np.sum(across(deviation[:, :3], path.p_part_tcp)[contact] ** 2, axis=1))))

    moving = tries and bool(np.any(contact))
    against = at_rest(lost_motion(robot, joints.q, w))
    correction, turn, q_corrected = commanded(against)
    for done in range(_PLAY_ROUNDS):
        parts[CORRECTION]((done + 2.0) / (_PLAY_ROUNDS + 2.0))
        against = at_rest(lost_motion(robot, q_corrected, w))
        correction, turn, q_corrected = commanded(against)
    parts[CORRECTION](1.0)
    off = tried(q_corrected, correction, TRIAL) if predict or moving else np.zeros_like(against)
    if moving and size(off) < _BELIEVED * size(deflection):
        left = off if setting.orientation else np.pad(off[:, :3], ((0, 0), (0, 3)))
        if setting.normal_only:
            left = np.concatenate([across(left[:, :3], path.p_part_tcp), left[:, 3:]], axis=1)
        left = left - lasting(left, path.time_s)
        trial = commanded(against + _SHARE * shaped(left, np.zeros_like(left)))
        found = tried(trial[2], trial[0], MENDED)
        if size(found) < size(off):
            (correction, turn, q_corrected), off = trial, found
    play = lost_motion(robot, q_corrected, w)
    _check_corrections(correction, turn, line, setting.limits)
    nominal = np.full((len(path), 3), np.nan)
    compensated = nominal.copy()
    w_nominal = np.full((len(path), 6), np.nan)
    if predict:
        bent, off_nominal = run(robot, stock, joints.q, np.zeros_like(correction), parts[UNCOMPENSATED])
        w_nominal, nominal, compensated = bent.w_tcp_part, off_nominal[:, :3], off[:, :3]
    progress(1.0)
    return Plan(
        path=path,
        line=line,
        q=joints.q,
        w_tcp_part=w,
        deflection_part=deflection,
        sag_part=sag,
        play_part=play,
        correction_part=correction,
        rotvec_part=turn,
        volume_m3=undisturbed.volume_m3,
        axial_depth_m=undisturbed.axial_depth_m,
        entry_rad=undisturbed.entry_rad,
        exit_rad=undisturbed.exit_rad,
        feed_per_tooth_m=undisturbed.feed_per_tooth_m,
        deviation_nominal_part=nominal,
        deviation_compensated_part=compensated,
        w_nominal_part=w_nominal,
        extrapolated=extrapolated.astype(np.int64),
    )


def solve_joints(path: ToolPath, line: Int, setting: Setting) -> PathSolution:
    """Joint angles along the path, with the margins that the limits ask for.

    Raises:
        ReachError: Out of reach, out of limits, too near a limit or a singularity; names the source line.
    """
    Rs_part_tcp = tool_orientation(path.axis_part, setting.rotation_about_tool_rad)
    Ts_base_tcp = tool_poses(setting.T_base_part, path.p_part_tcp, Rs_part_tcp)
    try:
        joints = inverse_path(setting.controller_chain, Ts_base_tcp, setting.branch)
    except ReachError as fault:
        row = int(fault.data.get("point", 0))
        raise ReachError(
            fault.what,
            where=_place(path, line, row),
            value=fault.value,
            limit=fault.limit,
            hint=fault.hint,
            **fault.data,
        ) from fault
    limits = setting.limits
    row = int(np.argmin(joints.limit_margin_rad))
    if joints.limit_margin_rad[row] < limits.joint_margin_rad:
        raise ReachError(
            f"axis {int(joints.limit_axis[row]) + 1} comes too close to its limit",
            where=_place(path, line, row),
            value=f"{joints.limit_margin_rad[row] / DEG:.2f} deg left",
            limit=f">= {limits.joint_margin_rad / DEG:g} deg (limits.joint_margin_deg)",
            hint="Move the part, or turn the tool about its axis",
        )
    row = int(np.argmin(joints.wrist))
    if joints.wrist[row] < np.sin(limits.wrist_rad):
        raise ReachError(
            "the wrist comes too close to its singularity",
            where=_place(path, line, row),
            value=f"axis 5 at {float(np.arcsin(joints.wrist[row])) / DEG:.2f} deg from it",
            limit=f">= {limits.wrist_rad / DEG:g} deg (limits.wrist_singularity_deg)",
            hint="Move the part, or turn the tool about its axis",
        )
    return joints


def residual_sag(p_part: Float, q: Float, setting: Setting) -> Float:
    """(n, 3) m, deviation of the unloaded tool along the path, see :mod:`counterflex.plan.part_frame`.

    What the robot does at its commanded joint angles with nothing but its own weight on it: sag, periodic errors of its
    drives, and the difference between its geometry and the one the controller has.
    """
    off = _unloaded_offset(setting, q)
    touched = touched_points(setting)
    if touched is None:
        return sag_deviation(setting.T_base_part, setting.T_base_part, p_part, off)
    datum, q_datum = touched
    T_base_true = true_part_frame(setting.T_base_part, datum, _unloaded_offset(setting, q_datum))
    return sag_deviation(setting.T_base_part, T_base_true, p_part, off)


def touched_points(setting: Setting) -> tuple[Float, Float] | None:
    """Datum points (k, 3) m in the part frame and the angles (k, 6) rad at them; None for a frame from outside."""
    if setting.datum_points_part is None:
        return None
    datum = setting.datum_points_part
    axes = np.tile([0.0, 0.0, 1.0], (len(datum), 1))
    Rs_part_tcp = tool_orientation(axes, setting.rotation_about_tool_rad)
    Ts_base_tcp = tool_poses(setting.T_base_part, datum, Rs_part_tcp)
    return datum, inverse_path(setting.controller_chain, Ts_base_tcp, setting.branch).q


def _unloaded_offset(setting: Setting, q: Float) -> Float:
    """(n, 3) m, true minus believed position of the unloaded tool tip, base axes."""
    off: Float = gravity.sag(setting.chain, q)[..., :3]
    if setting.controller_chain is not setting.chain or setting.drive_errors:
        links = setting.drive_errors.link_angles(q)
        off += forward(setting.chain, links)[..., :3, 3] - forward(setting.controller_chain, q)[..., :3, 3]
    return off


def part_compliance(setting: Setting, q: Float) -> Float:
    """(n, 6, 6) compliance at the tool tip in part axes."""
    R_part_base = setting.T_base_part[:3, :3].T
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = R_part_base
    return np.ascontiguousarray(turn @ compliance.cartesian_compliance(setting.chain, q) @ turn.T)


def feed_runs(path: ToolPath) -> Int:
    """Number of the uninterrupted run each row belongs to: it changes where the kind of motion does and at stops."""
    still = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) == 0.0
    still[:1] = False
    change = (np.diff(path.kind, prepend=path.kind[:1]) != 0) | (np.diff(still.astype(np.int64), prepend=0) != 0)
    out: Int = np.cumsum(change)
    return out


def _check_chips(result: Cut, contact: Bool, path: ToolPath, line: Int, setting: Setting) -> Bool:
    """Rows cut with a mean chip outside the law's range; refused where too much of the force comes from them."""
    law = setting.law
    outside = contact & ((result.chip_m < law.h_min_m) | (result.chip_m > law.h_max_m))
    share = impulse_share(np.where(contact[:, None], result.w_tcp_part, 0.0), path.time_s, outside)
    if share > EXTRAPOLATED_SHARE and not setting.allow_extrapolation:
        row = int(np.argmax(np.where(outside, np.linalg.norm(result.w_tcp_part[:, :3], axis=1), -1.0)))
        raise ModelError(
            "force would come from chips outside the range of the cutting constants",
            where=_place(path, line, row),
            value=f"mean chip {result.chip_m[row] / MM:.3g} mm, {100 * share:.0f} % of the force",
            limit=f"{law.h_min_m / MM:g} to {law.h_max_m / MM:g} mm, at most {100 * EXTRAPOLATED_SHARE:g} %",
            hint="Use constants measured at this feed, or set material.allow_extrapolation = true",
            share=share,
        )
    return outside


def _check_corrections(correction: Float, turn: Float, line: Int, limits: Limits) -> None:
    for values, limit, unit, name, key in (
        (correction, limits.correction_m, MM, "mm", "correction_mm"),
        (turn, limits.rotation_rad, DEG, "deg", "correction_deg"),
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


def _place(path: ToolPath, line: Int, row: int) -> str:
    at = ", ".join(f"{value:.3f}" for value in path.p_part_tcp[row] / MM)
    return f"line {int(line[row])}, at ({at}) mm"


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
