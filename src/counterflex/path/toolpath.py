"""A sampled tool path in the part frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError

RAPID: Final = 0
FEED: Final = 1


@dataclass(frozen=True)
class ToolPath:
    """Points the tool centre point runs through, joined by straight segments; row i ends segment i.

    Row 0 is the start and ends no segment. Consecutive rows may coincide (a dwell: time passes, nothing moves).

    Attributes:
        p_part_tcp: (n, 3) m. Tool tip in the part frame (for a ball mill the tip too, not the ball centre).
        axis_part: (n, 3) unit vectors from the tool tip towards the spindle, in the part frame.
        kind: (n,) :data:`RAPID` or :data:`FEED` of the segment that ends here.
        feed_m_s: (n,) m/s. Programmed speed along the segment that ends here.
        spindle_rad_s: (n,) rad/s. Spindle speed, positive clockwise seen from the spindle (M3), 0 when off.
        time_s: (n,) s. Time of arrival at the programmed speed, non-decreasing, ``time_s[0] == 0``.
        motion: (n,) index of the program motion that the segment belongs to, non-decreasing.
        tool: (n,) number of the tool in the spindle.
    """

    p_part_tcp: Float
    axis_part: Float
    kind: Int
    feed_m_s: Float
    spindle_rad_s: Float
    time_s: Float
    motion: Int
    tool: Int

    def __post_init__(self) -> None:
        """Check lengths and order."""
        n = len(self.p_part_tcp)
        for name in ("axis_part", "kind", "feed_m_s", "spindle_rad_s", "time_s", "motion", "tool"):
            if len(getattr(self, name)) != n:
                raise InputError(f"tool path column {name} has another length", value=len(getattr(self, name)), limit=n)
        if n and (np.any(np.diff(self.time_s) < 0.0) or np.any(np.diff(self.motion) < 0)):
            raise InputError("tool path runs backwards in time or in motions")

    def __len__(self) -> int:
        """Number of points."""
        return len(self.p_part_tcp)
