"""One figure of the path speed that a robot holds: on how much of the cut it is slower than programmed, and why."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM, PERCENT
from counterflex.plan.preflight.held_speed import Cause, HeldSpeed
from counterflex.plan.preflight.joints import ACCELERATION_KEY
from counterflex.plan.preflight.row import Bounds, Row

HELD: Final = 0.99
"""A segment whose mean speed reaches that share of the programmed one is as fast as programmed."""
SPEED_CHECK: Final = "path speed held"
TOOL_KEY: Final = "controller.acceleration_mm_s2"
ORIENTATION_KEY: Final = "limits.orientation_speed_deg_s"
_WORDS: Final = {
    Cause.PROGRAMMED: "change of the programmed feed",
    Cause.JOINT_SPEED: "joint speed of axis {}",
    Cause.REORIENTATION: "reorientation of the tool",
    Cause.BLOCK_TIME: "block time",
    Cause.LOOK_AHEAD: "look-ahead",
    Cause.TOOL_ACCELERATION: "acceleration of the tool",
    Cause.JOINT_ACCELERATION: "joint acceleration of axis {}",
    Cause.EXACT_STOP: "exact stops",
    Cause.STANDSTILL: "start and standstill",
}
_ADVICE: Final = {
    Cause.JOINT_SPEED: "Turn the tool about its axis (counterflex plan posture), move the part, or lower the feed",
    Cause.REORIENTATION: "Lower the feed where the tool turns, or spread the turn over more of the path",
    Cause.BLOCK_TIME: "Use arcs, fewer points, or a lower feed",
    Cause.LOOK_AHEAD: "Use arcs, fewer points, or a lower feed",
    Cause.TOOL_ACCELERATION: "Round corners in the program, allow a larger approximation distance, or lower the feed",
    Cause.JOINT_ACCELERATION: "Round corners in the program, turn the tool about its axis, or lower the feed",
    Cause.EXACT_STOP: "Let the controller round the corners where nothing else happens (C_DIS, zone, CNT)",
}
_LISTED: Final = 3


def slower(held: HeldSpeed) -> Bool:
    """(n,) segments below the programmed speed; ramps from one programmed feed to the next do not count."""
    out: Bool = held.slower(HELD) & (held.cause != Cause.PROGRAMMED)
    return out


def words(cause: int, axis: int) -> str:
    """What limits the speed, in words."""
    return _WORDS[Cause(cause)].format(axis + 1)


def speed_row(held: HeldSpeed, cutting: Bool, bounds: Bounds) -> Row:
    """The lowest speed in the cut, and on how much of it the robot is slower than programmed.

    Args:
        held: Along the path.
        cutting: (n,) segments that count.
        bounds: Which of the limits are assumed or not known.
    """
    way = np.where(cutting, held.length_m, 0.0)
    total = float(way.sum())
    if total == 0.0:
        return Row(SPEED_CHECK, "ok", what="nothing is cut")
    slow = cutting & slower(held)
    if not np.any(slow):
        row = int(np.argmin(np.where(way > 0.0, held.mean_m_s / np.maximum(held.programmed_m_s, 1e-12), np.inf)))
        value, limit = float(held.mean_m_s[row]), float(held.programmed_m_s[row])
        return Row(SPEED_CHECK, "ok", value, limit, "m/s", row, f"on all of {total / MM:.0f} mm" + _left_out(bounds))
    rows = np.flatnonzero(slow)
    row = int(rows[np.argmin(held.lowest_m_s[rows])])
    slow_m = float(way[rows].sum())
    late = float(np.sum(held.duration_s[rows] - way[rows] / held.programmed_m_s[rows]))
    shares = _shares(held, way, slow)
    listed = ", ".join(f"{text} {100.0 * share:.0f} %" for text, _, share in shares[:_LISTED])
    what = (
        f"{slow_m / total / PERCENT:.1f} % of the cutting path ({slow_m / MM:.1f} of {total / MM:.1f} mm) is slower "
        f"than programmed, {late:.2f} s more: {listed}; here {words(int(held.cause[row]), int(held.axis[row]))}"
    )
    used = {cause for _, cause, _ in shares}
    return Row(
        SPEED_CHECK,
        "warning",
        float(held.lowest_m_s[row]),
        float(held.programmed_m_s[row]),
        "m/s",
        row,
        what + _assumed(bounds, used) + _left_out(bounds),
        advice=next((_ADVICE[cause] for _, cause, _ in shares if cause in _ADVICE), ""),
    )


def _shares(held: HeldSpeed, way: Float, slow: Bool) -> list[tuple[str, Cause, float]]:
    """Causes and their share of what is slow, the largest first; axes are causes of their own."""
    code = 10 * held.cause + held.axis + 1
    out = []
    for value in np.unique(code[slow]).tolist():
        cause, axis = divmod(value, 10)
        share = float(way[slow & (code == value)].sum() / way[slow].sum())
        out.append((words(cause, axis - 1), Cause(cause), share))
    return sorted(out, key=lambda entry: -entry[2])


def _assumed(bounds: Bounds, causes: set[Cause]) -> str:
    """Defaults of the cell file that the figure stands on."""
    texts = []
    if causes & {Cause.TOOL_ACCELERATION, Cause.EXACT_STOP, Cause.STANDSTILL} and TOOL_KEY in bounds.assumed:
        texts.append(f"{TOOL_KEY} {bounds.acceleration_m_s2 / MM:g}")
    if Cause.REORIENTATION in causes and ORIENTATION_KEY in bounds.assumed and bounds.orientation_rad_s is not None:
        texts.append(f"{ORIENTATION_KEY} {bounds.orientation_rad_s / DEG:g}")
    return f"; assumed: {', '.join(texts)}" if texts else ""


def _left_out(bounds: Bounds) -> str:
    """Limits that are not known and so slow nothing down."""
    lacking = [key for key, known in (
        ("limits.joint_speed_deg_s", bounds.joint_speeds_rad_s), (ACCELERATION_KEY, bounds.joint_accelerations_rad_s2),
    ) if known is None]  # fmt: skip
    return f"; not known and left out: {', '.join(lacking)}" if lacking else ""
