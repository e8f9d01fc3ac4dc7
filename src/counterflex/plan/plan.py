"""The result of planning: one row per path point, and the hash that ties a compensated program to it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.path.toolpath import FEED, ToolPath


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything predicted and decided along a path; n rows, as the path. Part axes, SI."""

    path: ToolPath  # the nominal path
    line: Int  # (n,) source line of each row
    q: Float  # (n, 6) rad, controller angles at the nominal point
    w_tcp_part: Float  # (n, 6) N, N m, mean wrench on the tool about its tip in the undisturbed cut
    deflection_part: Float  # (n, 6) m, rad, static deflection under that wrench
    sag_part: Float  # (n, 3) m, deviation of the unloaded tip that own weight leaves after the part frame was measured
    play_part: Float  # (n, 3) m, deviation by play and dry friction of the drives on the corrected path
    correction_part: Float  # (n, 3) m, added to the programmed point
    rotvec_part: Float  # (n, 3) rad, correction of the orientation (zero where the language has none)
    volume_m3: Float  # (n,) removed along the segment that ends here
    axial_depth_m: Float  # (n,) largest engaged axial depth
    entry_rad: Float  # (n,) immersion angle where the engagement begins, NaN out of the cut
    exit_rad: Float  # (n,) where it ends, NaN out of the cut
    feed_per_tooth_m: Float
    deviation_nominal_part: Float  # (n, 3) m, predicted deviation of the uncompensated program (cut and force coupled)
    deviation_compensated_part: Float  # (n, 3) m, the same for the compensated program
    w_nominal_part: Float  # (n, 6) predicted wrench of the uncompensated program
    # (n,) 1 where material is cut with a mean chip outside the range of the cutting constants, else 0
    extrapolated: Int
    # (n, 3) m, part of `correction_part` that takes back what was measured on parts, or None
    measured_part: Float | None = None
    # (n,) mean chip thickness, 0 out of the cut; None for a plan read from a file, which does not hold it
    chip_m: Float | None = None
    # (n,) True in feed rows that remove material only because the tool of an earlier pass was not where it was
    # programmed (a spring pass, a move along a finished wall); None where no motion was predicted
    recut: Bool | None = None

    @property
    def cutting(self) -> Bool:
        """(n,) True for feed rows that remove material."""
        out: Bool = (self.path.kind == FEED) & (self.volume_m3 > 0.0)
        return out

    @property
    def judged(self) -> Bool:
        """(n,) True for feed rows whose path error counts: those that cut as programmed, and those that cut again."""
        out: Bool = self.cutting if self.recut is None else self.cutting | self.recut
        return out

    @property
    def extrapolated_share(self) -> float:
        """Share of the force impulse that comes from chips outside the range of the cutting constants."""
        return impulse_share(self.w_tcp_part, self.path.time_s, self.extrapolated == 1)


def impulse_share(w_tcp_part: Float, time_s: Float, rows: Bool) -> float:
    """Share of the integral of force over time that falls on some rows; 0 where there is no force.

    Args:
        w_tcp_part: (n, 6) N, N m.
        time_s: (n,) s.
        rows: (n,) which.
    """
    impulse = np.linalg.norm(w_tcp_part[:, :3], axis=1) * np.diff(time_s, prepend=time_s[:1])
    total = float(impulse.sum())
    return float(impulse[rows].sum()) / total if total > 0.0 else 0.0


def across(deviation_part: Float, p_part: Float) -> Float:
    """Part of a deviation that is square to the direction of the path.

    Args:
        deviation_part: (n, 3) m.
        p_part: (n, 3) m, points of the path; row i ends the segment whose direction is used.

    Returns:
        (n, 3) m. Rows without a direction (dwell, first row) are returned whole.
    """
    step = np.diff(p_part, axis=0, prepend=p_part[:1])
    length = np.linalg.norm(step, axis=1, keepdims=True)
    v = step / np.where(length > 0.0, length, 1.0)
    out: Float = deviation_part - np.sum(deviation_part * v, axis=1, keepdims=True) * v
    return out


DIGITS: Final = 16


def job_hash(plan: Plan) -> str:
    """Hash of what a plan commands: the first 16 hexadecimal digits of a SHA-256.

    It is over the nominal points, their corrections (position and orientation), the tools and the numbers of the
    source's lines, as little-endian numbers of 64 bits.

    Args:
        plan: As planned, not as read back: a plan file holds shop units, whose numbers are rounded in the last bit. Its
            metadata hold the hash.
    """
    digest = hashlib.sha256()
    for values in (plan.path.p_part_tcp, plan.correction_part, plan.rotvec_part):
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    for whole in (plan.path.tool, plan.line):
        digest.update(np.ascontiguousarray(whole, dtype="<i8").tobytes())
    return digest.hexdigest()[:DIGITS]
