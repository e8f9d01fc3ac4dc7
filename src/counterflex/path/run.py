"""Record of a machining, however it was machined."""

from __future__ import annotations

from dataclasses import dataclass, field

from counterflex.core.arrays import Float, Int


@dataclass(frozen=True, eq=False)
class Run:
    """Record of a machining, simulated or measured; n rows, part axes, SI."""

    time_s: Float  # (n,) controller time; stretches of air may be left out
    motion: Int  # (n,) program motion
    kind: Int  # (n,) RAPID or FEED
    progress: Float  # (n,) share 0..1 of the program's path length that is done
    p_part_command: Float  # (n, 3) m, interpolated set-point
    p_part_tcp: Float  # (n, 3) m, where the tool tip was
    tilt_part: Float  # (n, 3) rad, from the commanded to the true orientation
    force_part: Float  # (n, 3) N, mean force on the tool
    moment_part: Float  # (n, 3) N m
    force_peak_n: Float
    depth_m: Float  # (n,) m, engaged axial depth, 0 in air
    q_motor: Float  # (n, 6) rad
    # (n, 3) unit vectors from the tip to the spindle, as the tool was held; None in records of before
    axis_part: Float | None = field(default=None, kw_only=True)
