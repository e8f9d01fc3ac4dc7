"""From a tool path to a compensated one: predict force and deflection point by point and move the points against them.

Where the compensation works, the tool runs along the nominal path; so the force that decides the correction is that of
the *undisturbed* cut. Commanded = nominal - (deflection under that force + sag that is left + lost motion of the
drives), shaped in time. That command is tried on the robot in motion and mended once by what it leaves; the last trial,
and one of the program as it is, are the prediction.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.cutting.stock import HeightMap
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import CORRECTION, JOINTS, UNDISTURBED, Inputs, solve_joints, work_of
from counterflex.plan.plan import Plan
from counterflex.plan.predict import dynamic_trial, predict_deviations
from counterflex.plan.setting import Setting
from counterflex.plan.static_correction import check_corrections, loaded_robot, static_correction
from counterflex.plan.tool_deviation import can_move, lost_motion
from counterflex.plan.undisturbed_cut import undisturbed_cut


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
        progress: Progress callback, fraction 0 to 1; may raise to interrupt.

    Returns:
        The plan.

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
    inputs = Inputs(path, line, stock, setting, solve_joints(path, line, setting).q)
    undisturbed = undisturbed_cut(inputs, parts[UNDISTURBED])
    loaded = loaded_robot(inputs, undisturbed)
    displacement, static = static_correction(loaded, parts[CORRECTION])
    command, remaining = dynamic_trial(loaded, displacement, static, parts)
    check_corrections(command, line, setting.limits)
    prediction = predict_deviations(loaded, remaining, parts)
    progress(1.0)
    cut = undisturbed.cut
    return Plan(
        path=path,
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
    )
