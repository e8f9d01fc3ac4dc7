"""Checks of the spindle: on and turning the right way where material is removed, and at a speed that it has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import RPM
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.process.tool_bounds import ToolBounds
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row, Verdict
from counterflex.plan.process_limits import ProcessLimits

RUN_UP: Final = "spindle run-up"
RUN_UP_KEY: Final = "process_limits.spindle_run_up_s"
IN_CUT: Final = "spindle in the cut"
SPEED: Final = "spindle speed"
STANDS: Final = "standing in the cut"
LONGEST_S: Final = 1.0
"""Longest dwell in the cut: a drilling cycle stays for some turns, 0.5 s at most; a mill that stays longer rubs."""
SPEED_KEY: Final = "tools.spindle_rpm"
_SLACK: Final = 1.0 + 1e-6
_ADVICE: Final = "Start the spindle (M3 S...) before the first cut, and stop it after the retract"


def engaged(path: ToolPath, contact: Bool) -> Bool:
    """(n,) rows at whose end the tool stands in the material that it has just cut.

    Args:
        path: n rows.
        contact: (n,) segments at feed that remove material.
    """
    moves = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) > 0.0
    last = np.maximum.accumulate(np.where(moves, np.arange(len(path)), 0))
    out: Bool = contact[last]
    return out


def turning(path: ToolPath, stands_rad_s: float) -> Float:
    """(n,) rad/s, spindle speeds with which the cut can be computed: no row stands or turns backwards.

    Args:
        path: n rows.
        stands_rad_s: Speed in place of 0.
    """
    size = np.abs(path.spindle_rad_s)
    out: Float = np.where(size > 0.0, size, stands_rad_s)
    return out


def in_cut_row(path: ToolPath, contact: Bool, by_person: bool) -> Row:
    """Return whether the spindle turns, clockwise, wherever material is removed, until the tool has left.

    Args:
        path: n rows.
        contact: (n,) segments at feed that remove material.
        by_person: The program says nothing of the spindle, and nobody but a person starts it.
    """
    spindle = path.spindle_rad_s
    if by_person and np.any(contact):
        text = "the program says nothing of the spindle: a person or the line controller starts it"
        return Row(IN_CUT, NOT_LOOKED_AT, what=text, missing=SPEED_KEY)
    stands = contact & (spindle == 0.0)
    stops = np.zeros(len(path), dtype=np.bool_)
    stops[1:] = engaged(path, contact)[:-1] & (spindle[:-1] != 0.0) & (spindle[1:] == 0.0)
    for rows, what in (
        (stands, "the program cuts material with the spindle stopped"),
        (contact & (spindle < 0.0), "the spindle turns backwards (M4) in the cut"),
        (stops & ~contact, "the spindle stops while the tool stands in the material"),
    ):
        if np.any(rows):
            return Row(IN_CUT, "fail", float(rows.sum()), 0.0, "", int(np.argmax(rows)), what, advice=_ADVICE)
    return Row(IN_CUT, "ok", 0.0, 0.0, what="clockwise in every cut" if np.any(contact) else "nothing is cut")


def run_up_row(
    path: ToolPath, cuts: Bool, stops: Bool, waits_first: bool, limits_of: Callable[[int], ProcessLimits]
) -> Row:
    """Return the shortest time from a change of the spindle speed to the next cut; a wait for a person is long enough.

    Args:
        path: n rows.
        cuts: (n,) segments at feed that remove material with the spindle on.
        stops: (motions,) a person or a signal is waited for at the end of the motion.
        waits_first: The same before the first motion.
        limits_of: Gives the limits for a tool number.
    """
    if not np.any(cuts):
        return Row(RUN_UP, "ok", what="no cut with the spindle on")
    rows = np.arange(len(path))
    begins = np.concatenate([path.time_s[:1], path.time_s[:-1]])
    changed = np.maximum.accumulate(np.where(np.diff(path.spindle_rad_s, prepend=np.inf) != 0.0, rows, 0))
    ends = (np.diff(path.motion, append=-1) != 0) & stops[path.motion]
    waited = np.maximum.accumulate(np.where(ends, rows, -1 if waits_first else -2))
    free = np.concatenate([[-1 if waits_first else -2], waited[:-1]]) >= changed - 1
    time_s = np.where(cuts & ~free, begins - begins[changed], np.inf)
    row = int(np.argmin(time_s))
    if not np.isfinite(time_s[row]):
        return Row(RUN_UP, "ok", what="a person or a signal is waited for before each cut")
    needed = limits_of(int(path.tool[row])).run_up_s
    value, what = float(time_s[row]), f"{abs(path.spindle_rad_s[row]) / RPM:.0f} rpm, to the next cut"
    if needed is None:
        return Row(RUN_UP, NOT_LOOKED_AT, value, None, "s", row, what, missing=RUN_UP_KEY)
    short = value < needed
    return Row(RUN_UP, "warning" if short else "ok", value, needed, "s", row, what,
               advice="Dwell (G4), or wait for the signal of the spindle, before the cut" if short else "")  # fmt: skip


def standing_row(path: ToolPath, contact: Bool, stops: Bool) -> Row:
    """Return the longest time for which the tool stands in the material that it has cut, or a wait for a person there.

    Args:
        path: n rows.
        contact: (n,) segments at feed that remove material.
        stops: (motions,) a person or a signal is waited for at the end of the motion.
    """
    last = np.diff(path.motion, append=-1) != 0
    waits = last & stops[path.motion] & engaged(path, contact)
    if np.any(waits):
        text = "the program waits for a person or a signal while the tool stands in the material"
        return Row(STANDS, "warning", None, LONGEST_S, "s", int(np.argmax(waits)), text,
                   advice="Retract before the wait: the edges rub")  # fmt: skip
    step = np.diff(path.time_s, prepend=path.time_s[:1])
    moves = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) > 0.0
    dwell = np.where(engaged(path, contact) & ~moves, step, 0.0)
    row = int(np.argmax(dwell))
    if dwell[row] == 0.0:
        return Row(STANDS, "ok", 0.0, LONGEST_S, "s")
    long = dwell[row] > LONGEST_S
    return Row(STANDS, "warning" if long else "ok", float(dwell[row]), LONGEST_S, "s", row, "dwell in the material",
               advice="Dwell outside of the material: the edges rub" if long else "")  # fmt: skip


def speed_row(
    path: ToolPath, limits_of: Callable[[int], ProcessLimits], tools: Mapping[int, ToolBounds], by_person: bool
) -> Row:
    """Return the spindle speed that is nearest to, or farthest beyond, what spindle and tool have.

    Args:
        path: n rows.
        limits_of: Gives the limits for a tool number.
        by_person: See :func:`in_cut_row`.
    """
    speed = np.abs(path.spindle_rad_s)
    on = speed > 0.0
    if not np.any(on):
        return Row(SPEED, NOT_LOOKED_AT if by_person else "ok", what="the program states no speed",
                   missing=SPEED_KEY if by_person else "")  # fmt: skip
    high, low = np.full(len(path), np.inf), np.zeros(len(path))
    for number in np.unique(path.tool).tolist():
        limits, tool = limits_of(number), tools.get(number, ToolBounds())
        most = [value for value in (limits.spindle_max_rad_s, tool.max_rad_s) if value is not None]
        rows = path.tool == number
        high[rows] = min(most, default=np.inf)
        low[rows] = limits.spindle_min_rad_s or 0.0
    share = np.where(on, speed / high, 0.0)
    row = int(np.argmax(share)) if np.isfinite(high).any() else int(np.argmax(speed))
    slow = on & (speed * _SLACK < low)
    if share[row] > _SLACK:
        return _row("fail", speed[row], high[row], row, "above the highest speed of spindle or tool", "Lower S")
    if np.any(slow):
        row = int(np.argmin(np.where(slow, speed / np.maximum(low, 1e-9), np.inf)))
        return _row("warning", speed[row], low[row], row, "below the lowest speed of the spindle", "Raise S")
    if not np.isfinite(high[on]).all():
        key = "process_limits.spindle_max_rpm"
        return Row(SPEED, NOT_LOOKED_AT, float(speed[row]) / RPM, None, "rpm", row, "highest speed", key)
    return _row("ok", speed[row], high[row], row, f"tool T{int(path.tool[row])}", "")


def _row(verdict: Verdict, speed: float, limit: float, row: int, what: str, advice: str) -> Row:
    return Row(SPEED, verdict, float(speed) / RPM, float(limit) / RPM, "rpm", row, what, advice=advice)
