"""Limits of a tool, and the outline of its holder; None is not known."""

from __future__ import annotations

from dataclasses import dataclass

Range = tuple[float, float]


@dataclass(frozen=True)
class ToolBounds:
    """Bounds of one tool.

    Attributes:
        centre_cutting: The mill cuts at its centre, so that it may plunge.
        ramp_rad: Steepest ramp of a mill that does not.
        feed_per_tooth_m: Least and largest.
        cutting_speed_m_s: Least and largest, at the diameter.
        max_rad_s: Highest speed.
        coolant: It is to be cooled (True), or must not be (False).
        holder_m: Outline of what does not cut, from the tip upward: height above the tip, radius; empty: not known.
    """

    centre_cutting: bool | None = None
    ramp_rad: float | None = None
    feed_per_tooth_m: Range | None = None
    cutting_speed_m_s: Range | None = None
    max_rad_s: float | None = None
    coolant: bool | None = None
    holder_m: tuple[tuple[float, float], ...] = ()
