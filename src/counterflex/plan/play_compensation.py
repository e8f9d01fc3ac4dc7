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

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import Setting
from counterflex.plan.lowest_mode import mode_of
from counterflex.plan.sag_and_play import corrected_joints, play_deviation, touched_points
from counterflex.signals.preview import Mode, Shaping, command_for

SMOOTHING_S: Final = 0.04
_ROUNDS: Final = 12
_FIRST: Final = 0.5
"""Share of the deviation without a correction that is taken back at first: the play is then passed, but not twice."""


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

    def lost(x: Float) -> Float:
        moved = corrected_joints(setting.controller_chain, relative, q, x, still)
        return play_deviation(setting.chain, relative, path.p_part_tcp, moved, w_tcp_part, path.time_s, touched, mode)

    requested = -_FIRST * lost(requested)
    for n in range(_ROUNDS):
        result = lost(command_for(requested, path.time_s, (), smooth))
        requested = requested - (result + requested) / (1.5 + 0.5 * n)
    return command_for(requested, path.time_s, (mode, lag), Shaping(SMOOTHING_S, dead_s))
