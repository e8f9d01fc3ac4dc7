"""Demand of the predicted cut on spindle, tool and robot, against the limits of the cell file.

Forces, torques and powers are means over a tooth period, by the same functions with which compensation lowers the feed
(:mod:`counterflex.plan.feed_limits`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import UM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan import chip_range
from counterflex.plan.cut import Cut
from counterflex.plan.feed_limits import ACCELERATION, CutDemand, limits_by_name
from counterflex.plan.preflight.row import NOT_LOOKED_AT, CheckLimits, Row, Verdict
from counterflex.plan.process_limits import ProcessLimits

CHIP: Final = "chip thickness"
CORRECTION: Final = "correction"
_SLOWER: Final = "Cut less deep or less wide, or lower the feed"


@dataclass(frozen=True)
class _Limit:
    """A limit of ``[process_limits]``: name of the row, of its value, unit, key, verdict beyond it."""

    check: str
    names: tuple[str, ...]
    unit: str
    key: str
    beyond: Verdict
    advice: str = _SLOWER

    def demand(
        self, values: Float, bounds: Float, tool: Int, limits_of: Callable[[int], ProcessLimits], rigid: str
    ) -> Row:
        """Row of the limit, at the largest share of it."""
        known = bool(np.isfinite(bounds).any())
        share = values / bounds if known else values
        name, row = (int(i) for i in np.unravel_index(int(np.argmax(share)), share.shape))
        value, bound = float(values[name, row]), float(bounds[name, row])
        what = f"axis {name + 1}" if len(self.names) > 1 else f"tool T{int(tool[row])}"
        share_text = f"{what}, {100 * value / bound:.0f} % of the limit"
        # Told before anything that is not known, which could only add to it.
        if known and value > bound * _SLACK:
            return Row(self.check, self.beyond, value, bound, self.unit, row, share_text, advice=self.advice)
        if value == 0.0 and self.check != "tool bending":
            return Row(self.check, "ok", 0.0, bound if known else None, self.unit, what="nothing asks for it")
        if self.check == "tool bending" and (lacking := _short_of(tool, limits_of)):
            return Row(self.check, NOT_LOOKED_AT, what=lacking, missing="tools.overhang_mm")
        if not known:
            return Row(self.check, NOT_LOOKED_AT, value, None, self.unit, row, what, self.key)
        if self.check == "deflection" and rigid:
            return Row(self.check, NOT_LOOKED_AT, value, bound, self.unit, row, f"stiffness of {rigid} not known",
                       "robot.elastic")  # fmt: skip
        return Row(self.check, "ok", value, bound, self.unit, row, share_text)


_AXES: Final = tuple(f"torque of axis {k}" for k in range(1, 7))
LIMITS: Final = (
    _Limit("spindle torque", ("spindle torque",), "N m", "process_limits.spindle_torque_nm", "fail"),
    _Limit("spindle power", ("spindle power",), "W", "process_limits.spindle_power_w", "fail"),
    _Limit("cutting force", ("force",), "N", "process_limits.force_n", "fail"),
    _Limit("torque of the axes", _AXES, "N m", "process_limits.axis_torque_nm", "fail"),
    _Limit("tool bending", ("tool bending",), "m", "process_limits.tool_bending_um", "warning",
           "Use a shorter or thicker tool, or cut less"),
    _Limit("deflection", ("deflection",), "m", "process_limits.deflection_um", "warning",
           _SLOWER + ", turn the tool about its axis (counterflex plan posture), or compensate"),
    _Limit("acceleration on arcs", (ACCELERATION,), "m/s2", "process_limits.acceleration_mm_s2", "warning",
           "Lower the feed on the arc"),
)  # fmt: skip
_SLACK: Final = 1.0 + 1e-6


def demand_rows(
    demand: CutDemand, tool: Int, spindle_rad_s: Float, limits_of: Callable[[int], ProcessLimits], rigid: str
) -> list[Row]:
    """One row for each limit of the process: what is asked for where it is nearest to the limit.

    Args:
        demand: By the cut, n rows.
        tool: (n,) number of the tool.
        spindle_rad_s: (n,).
        limits_of: Gives the limits for a tool number.
        rigid: Axes whose stiffness is not known, as text; empty: none.
    """
    numbers = np.unique(tool).tolist()
    tables = {n: limits_by_name(limits_of(n), spindle_rad_s) for n in numbers}
    rows = []
    for limit in LIMITS:
        values = np.stack([demand.values[name] for name in limit.names])
        bounds = np.full_like(values, np.inf)
        for k, name in enumerate(limit.names):
            for n, table in tables.items():
                if name in table:
                    bounds[k] = np.where(tool == n, table[name], bounds[k])
        rows.append(limit.demand(values, bounds, tool, limits_of, rigid))
    return rows


def _short_of(tool: Int, limits_of: Callable[[int], ProcessLimits]) -> str:
    lacking = [f"T{n}" for n in np.unique(tool).tolist() if limits_of(n).overhang_m is None]
    return f"overhang of {', '.join(lacking)} not known" if lacking else ""


def correction_row(demand: CutDemand, bounds: CheckLimits, rigid: str) -> Row:
    """The largest deflection, of which compensation corrects at most ``limits.correction_mm``.

    Args:
        demand: By the cut.
        rigid: See :func:`demand_rows`.
    """
    size = np.linalg.norm(demand.displacement_part[:, :3], axis=1)
    row = int(np.argmax(size))
    value, limit = float(size[row]), bounds.correction_m
    if rigid and value <= limit:  # what yields besides could only add to it; beyond the limit compensate refuses now
        text = f"stiffness of {rigid} not known"
        return Row(CORRECTION, NOT_LOOKED_AT, value, limit, "m", row, text, "robot.elastic")
    turn = np.linalg.norm(demand.displacement_part[:, 3:], axis=1)
    if value <= limit and turn.max() > bounds.correction_rad:
        row = int(np.argmax(turn))
        text = "the tool tilts by more than compensation corrects"
        return Row(CORRECTION, "warning", float(turn[row]), bounds.correction_rad, "rad", row, text, advice=_SLOWER)
    over = value > limit
    text = "deflection under the mean force" + ("; compensate refuses the program" if over else "")
    return Row(CORRECTION, "warning" if over else "ok", value, limit, "m", row, text, advice=_SLOWER if over else "")


def chip_row(cut: Cut, contact: Bool, time_s: Float, law: ForceLaw, extrapolates: bool) -> Row:
    """Return the share of the force that is uncertain because mean chips are outside the range of the constants.

    Args:
        contact: (n,) rows that count.
        time_s: (n,).
        law: Force law with the range of its constants.
        extrapolates: The cell file accepts force from other chips.
    """
    if not np.any(contact):
        return Row(CHIP, "ok", what="nothing is cut")
    shares = chip_range.outside(law, cut.chip_m, contact, cut.w_tcp_part, time_s)
    size = shares.row_share * np.linalg.norm(cut.w_tcp_part[:, :3], axis=1)
    row = int(np.argmax(size if np.any(shares.rows) else np.where(contact, cut.chip_m, -1.0)))
    what = (
        f"mean chip {cut.chip_m[row] / UM:.1f} um, constants for {law.h_min_m / UM:g} to {law.h_max_m / UM:g} um; "
        f"{100.0 * shares.force_share:.2g} % of the force outside"
    )
    over = shares.uncertain_share > chip_range.UNCERTAIN_SHARE and not extrapolates
    return Row(CHIP, "warning" if over else "ok", shares.uncertain_share, chip_range.UNCERTAIN_SHARE, "share", row,
               what,
               advice="Use constants measured at this feed (counterflex identify cutting), or change the feed" if over
               else "")  # fmt: skip
