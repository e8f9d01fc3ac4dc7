"""Limits of a tool, and the outline of its holder; None is not known."""

from __future__ import annotations

from dataclasses import dataclass

Range = tuple[float, float]


@dataclass(frozen=True)
class ToolBounds:
    """Bounds of one tool."""

    centre_cutting: bool | None = None  # the mill cuts at its centre, so that it may plunge
    ramp_rad: float | None = None  # steepest ramp of a mill that does not
    feed_per_tooth_m: Range | None = None  # least and largest
    cutting_speed_m_s: Range | None = None  # least and largest, at the diameter
    max_rad_s: float | None = None  # highest speed
    coolant: bool | None = None  # it is to be cooled (True), or must not be (False)
    # outline of what does not cut, from the tip upward: height above the tip, radius; empty: not known
    holder_m: tuple[tuple[float, float], ...] = ()
