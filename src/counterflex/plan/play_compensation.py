"""Correction that undoes play, friction and yielding drives of a path online, sent ahead of time.

What the axes lose depends on how they move, and a correction moves them: where an axis turns round, the correction
takes up its play within a few hundredths of a second, while the program alone would creep through it for half a second.
So the motion x that is wanted of the drives solves ``x = -lost(q + J^-1 S x)``, S a smoothing, found by averaged steps.
The command is that motion passed backwards through what a correction passes
(:func:`counterflex.signals.preview.command_for`): dead time, the controller's own lag, the arm's mode.

Smoothing: a dead band is crossed in a jump at a place that is known as well as the friction is. A jump commanded at the
wrong place leaves its whole height as an error; over 40 ms the robot is moved gently, and the error stays smaller.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import Setting
from counterflex.plan.lowest_mode import mode_of
from counterflex.plan.sag_and_play import corrected_joints, play_deviation, touched_points
from counterflex.plan.static_correction import FIRST_SHARE, share_of_round
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode, Shaping, command_for


def arm_share(chain: ElasticChain, q: Float, w_base: Float) -> float:
    """Share of the deflection that the robot's arm makes, the rest being made by what it carries.

    Median over the rows under load of ``d_arm . d / d . d``, translations only, linear.

    ``q``: (n, 6) rad; ``w_base``: (n, 6) N, N m, on the robot's hand about its origin, base axes.

    Returns:
        0..1; 1 where nothing is loaded or nothing yields.
    """
    rows = np.flatnonzero(np.any(w_base != 0.0, axis=1))
    if len(rows) == 0:
        return 1.0
    own = compliance.shares(chain, q[rows], w_base[rows])[..., :3]
    total = np.sum(own, axis=1)
    arm = np.sum(own[:, : chain.flange_segment + 1], axis=1)
    square = np.sum(total * total, axis=1)
    if not np.any(square > 0.0):
        return 1.0
    selected = square > 0.0
    return float(np.clip(np.median(np.sum(arm * total, axis=1)[selected] / square[selected]), 0.0, 1.0))


def arrival(p_part: Float, time_s: Float, deflection_part: Float) -> Float:
    """Times at which a tool that the force pushes back along the feed reaches the points of a program.

    ``t - d . u / v`` with u the direction and v the speed of the feed: at 25 mm/s a force that bends the robot by 0.4
    mm against the feed makes the tool leave 16 ms late, unless the deflection along the feed is corrected too.

    Args:
        p_part: (n, 3) m, points of the program.
        time_s: (n,) s, when it commands them, not decreasing.
        deflection_part: (n, 3) m at the points.

    Returns:
        (n,) s, not decreasing.
    """
    step = np.diff(p_part, axis=0, prepend=p_part[:1])
    passed = np.diff(time_s, prepend=time_s[:1])
    square = np.sum(step * step, axis=1)
    moves = square > 0.0
    along = np.sum(deflection_part * step, axis=1)
    late = np.where(moves, -along * passed / np.where(moves, square, 1.0), 0.0)
    out: Float = np.maximum.accumulate(time_s + late)
    return out


SMOOTHING_S: Final = 0.04
_ROUNDS: Final = 12


def play_compensation(setting: Setting, path: ToolPath, q: Float, w_tcp_part: Float, lag: Mode, dead_s: float) -> Float:
    """The correction to be sent at each row of a path.

    Args:
        setting: Cell with play, friction and servo gains; without them the correction is exactly zero.
        path: The path, n rows.
        q: (n, 6) rad, controller angles of the programmed points.
        w_tcp_part: (n, 6) N, N m, predicted process wrench about the tip, part axes.
        lag: What the controller makes of a correction, second order; the arm's mode is the setting's.
        dead_s: Dead time of a correction, >= 0.

    Returns:
        (n, 3) m, part axes.

    Raises:
        InputError: Shapes do not match, or the path is too long for its shaping.
    """
    requested = np.zeros((len(path), 3))
    if setting.chain.play is None and setting.chain.servo is None:
        return requested
    touched, smooth = touched_points(setting), Shaping(SMOOTHING_S, 0.0)
    mode = mode_of(setting.chain, q[int(np.argmax(np.linalg.norm(w_tcp_part[:, :3], axis=1)))], setting.mode)
    still, relative = np.zeros_like(requested), setting.relative_motion(path)
    moved = partial(corrected_joints, setting.controller_chain, relative, q, turn=still)
    deviation = partial(play_deviation, setting.chain, relative, path.p_part_tcp)
    as_cut = w_tcp_part, path.time_s, touched, mode
    requested = -FIRST_SHARE * deviation(moved(requested), *as_cut)
    for n in range(_ROUNDS):
        result = deviation(moved(command_for(requested, path.time_s, (), smooth)), *as_cut)
        requested = requested - (result + requested) * share_of_round(n)
    return command_for(requested, path.time_s, (mode, lag), Shaping(SMOOTHING_S, dead_s))
