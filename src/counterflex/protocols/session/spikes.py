"""Spikes of a force sensor: single readings far off those about them, as a loose plug or a radio makes them.

A force of the process lasts longer than a cycle; a reading that is far off the last one is therefore held back for a
cycle, and used where the next one is there, too. A step of the force is late by one cycle so.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float

LEAST_N: Final = 60.0
"""Change from one reading to the next that is never a spike: a cutter enters at full depth within some cycles."""
USUAL: Final = 5.0
"""Usual changes above which a change is far off: one in 300 of normal noise is above 3."""
_SHARE: Final = 0.05
"""Of a new change in the usual one."""


class SpikeGate:
    """Holds readings back that are far off, for a cycle each.

    Attributes:
        count: Spikes so far.
    """

    def __init__(self) -> None:
        self._x = self._y = self._z = 0.0
        self._usual_n = 0.0
        self._known = self._held = False
        self.count = 0

    def takes(self, w: Float) -> bool:
        """Whether a reading is to be used.

        Args:
            w: (>= 3,) force, N.
        """
        x, y, z = float(w[0]), float(w[1]), float(w[2])
        change = math.sqrt((x - self._x) ** 2 + (y - self._y) ** 2 + (z - self._z) ** 2)
        limit = max(LEAST_N, USUAL * self._usual_n)
        if self._known and change > limit and not self._held:
            self._held = True
            return False
        if self._held and change <= limit:
            self.count += 1
        self._held = False
        self._usual_n += _SHARE * (min(change, limit) - self._usual_n) if self._known else 0.0
        self._x, self._y, self._z, self._known = x, y, z, True
        return True
