"""Record of a machining, however it was machined."""

from __future__ import annotations

from dataclasses import dataclass, field

from counterflex.core.arrays import Float, Int


@dataclass(frozen=True, eq=False)
class Run:
    """What a machining recorded, however it was machined; n rows, part axes, SI.

    Attributes:
        time_s: (n,) controller time; stretches of air may be left out.
        motion: (n,) program motion.
        kind: (n,) RAPID or FEED.
        progress: (n,) share 0..1 of the program's path length that is done.
        p_part_command: (n, 3) m, interpolated set-point.
        p_part_tcp: (n, 3) m, where the tool tip was.
        tilt_part: (n, 3) rad, from the commanded to the true orientation.
        force_part: (n, 3) N, mean force on the tool.
        moment_part: (n, 3) N m.
        force_peak_n: (n,) N.
        depth_m: (n,) m, engaged axial depth, 0 in air.
        q_motor: (n, 6) rad.
        axis_part: (n, 3) unit vectors from the tip to the spindle, as the tool was held; None in records of before.
    """

    time_s: Float
    motion: Int
    kind: Int
    progress: Float
    p_part_command: Float
    p_part_tcp: Float
    tilt_part: Float
    force_part: Float
    moment_part: Float
    force_peak_n: Float
    depth_m: Float
    q_motor: Float
    axis_part: Float | None = field(default=None, kw_only=True)
