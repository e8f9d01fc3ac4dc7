"""Cuts of a trial that chatter, by the criterion of ``plan stability``: what it leaves there is no error to mend.

Looked at are cuts of which the trial leaves a large share of the deflection: where the row that it leaves most of, or
the deepest row, chatters with the arc of engagement of the undisturbed cut, the rest is a swing that feeds itself.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.cutting.stability.process import process_of_side_cut
from counterflex.plan.plan import across
from counterflex.plan.stability.criterion import robot_limit
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.static_correction import LoadedRobot

SWINGS: Final = 0.1
"""Residual of a cut, as a share of its deflection (root mean squares across the path), from which it is looked at. The
model in motion leaves less where it does not swing. At 0.3 a soft arm that bent by 2.2 mm and swung by 0.5 mm at 45 Hz
passed (0.24): the offset of its swing was taken for an error and commanded against, which left 0.59 mm at the exit."""


def chattering(loaded: LoadedRobot, deviation: Float, cut_of_row: Int) -> Bool:
    """(n,) rows of cuts that chatter in a trial.

    Args:
        loaded: The robot under load.
        deviation: (n, 6) m, rad, that the trial leaves.
        cut_of_row: (n,) number of the cut of each row, from 0.
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
