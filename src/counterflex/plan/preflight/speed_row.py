"""One figure of the path speed that a robot holds: on how much of the cut it is slower than programmed, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM, PERCENT
from counterflex.plan.preflight.approximation import BLENDING_KEY
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
QUIET_SHARE: Final = 0.05
"""Share of the cutting path below the programmed speed from which on a warning is given: entries and single corners of
a clean program stay below it (0.5 to 3.5 % in the examples), and the cut changes along few millimetres only."""
QUIET_M: Final = 2.0 * MM
"""Way below the programmed speed that is no warning, however short the cut is: the bottom of a drilled hole."""


def slower(held: HeldSpeed) -> Bool:
    """(n,) segments below the programmed speed; ramps from one programmed feed to the next do not count."""
    out: Bool = held.slower(HELD) & (held.cause != Cause.PROGRAMMED)
    return out


def words(cause: int, axis: int) -> str:
    """Cause that limits the speed, in words."""
    return _WORDS[Cause(cause)].format(axis + 1)


@dataclass(frozen=True, eq=False)
class SpeedInCut:
    """Part of the cut on which the robot is slower than programmed, and its causes."""

    cut_m: float  # way that counts
    slower_m: float  # on which of it the robot is slower than programmed
    more_s: float  # time that it takes more there
    # words, cause and share 0..1 of what is slower, the largest first; axes are causes of their own
    causes: Sequence[tuple[str, Cause, float]]
    row: int  # row of the path with the lowest speed there; where it is held everywhere the one nearest to being slower
    lowest_m_s: float  # lowest speed at this row
    programmed_m_s: float  # programmed there

    @property
    def share(self) -> float:
        """Share 0..1 of the cut on which the robot is slower."""
        return self.slower_m / self.cut_m


def speed_in_cut(held: HeldSpeed, cutting: Bool) -> SpeedInCut | None:
    """Compare path speed and feed in the cut; None where nothing is cut.

    Args:
        held: Along the path.
        cutting: (n,) segments that count.
    """
    way = np.where(cutting, held.length_m, 0.0)
    total = float(way.sum())
    if total == 0.0:
        return None
    slow = cutting & slower(held)
    rows = np.flatnonzero(slow)
    if len(rows) == 0:
        row = int(np.argmin(np.where(way > 0.0, held.mean_m_s / np.maximum(held.programmed_m_s, 1e-12), np.inf)))
        return SpeedInCut(total, 0.0, 0.0, (), row, float(held.mean_m_s[row]), float(held.programmed_m_s[row]))
    row = int(rows[np.argmin(held.lowest_m_s[rows])])
    late = float(np.sum(held.duration_s[rows] - way[rows] / held.programmed_m_s[rows]))
    lowest, programmed = float(held.lowest_m_s[row]), float(held.programmed_m_s[row])
    return SpeedInCut(total, float(way[rows].sum()), late, _shares(held, way, slow), row, lowest, programmed)


def speed_row(held: HeldSpeed, cutting: Bool, bounds: Bounds, path_name: str = "cutting path") -> Row:
    """The lowest speed in the cut, and on how much of it the robot is slower than programmed.

    Args:
        held: Along the path.
        cutting: (n,) segments that count.
        bounds: Which of the limits are assumed or not known.
        path_name: Name of what counts; nothing is cut where it is the path at feed.
    """
    speed = speed_in_cut(held, cutting)
    if speed is None:
        return Row(SPEED_CHECK, "ok", what="nothing is cut")
    slow = speed.share > QUIET_SHARE and speed.slower_m > QUIET_M
    listed = ", ".join(f"{text} {share / PERCENT:.0f} %" for text, _, share in speed.causes[:_LISTED])
    what = f"on all of {speed.cut_m / MM:.0f} mm"
    if speed.causes:
        what = (
            f"{speed.share / PERCENT:.1f} % of the {path_name} ({speed.slower_m / MM:.1f} of {speed.cut_m / MM:.1f} "
            f"mm) is slower than programmed, {speed.more_s:.2f} s more: {listed}; "
            f"here {words(int(held.cause[speed.row]), int(held.axis[speed.row]))}"
        )
    return Row(
        SPEED_CHECK,
        "warning" if slow else "ok",
        speed.lowest_m_s,
        speed.programmed_m_s,
        "m/s",
        speed.row,
        what + _assumed(bounds, {cause for _, cause, _ in speed.causes}) + _left_out(bounds),
        advice=next((_ADVICE[cause] for _, cause, _ in speed.causes if cause in _ADVICE), "") if slow else "",
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
    if Cause.TOOL_ACCELERATION in causes and BLENDING_KEY in bounds.assumed:
        texts.append(f"{BLENDING_KEY} {bounds.blending_m / MM:g}")
    if Cause.REORIENTATION in causes and ORIENTATION_KEY in bounds.assumed and bounds.orientation_rad_s is not None:
        texts.append(f"{ORIENTATION_KEY} {bounds.orientation_rad_s / DEG:g}")
    return f"; assumed: {', '.join(texts)}" if texts else ""


def _left_out(bounds: Bounds) -> str:
    """Limits that are not known and so slow nothing down."""
    lacking = [key for key, known in (
        ("limits.joint_speed_deg_s", bounds.joint_speeds_rad_s), (ACCELERATION_KEY, bounds.joint_accelerations_rad_s2),
    ) if known is None]  # fmt: skip
    return f"; not known and left out: {', '.join(lacking)}" if lacking else ""
