"""Spikes of a force sensor: single samples far off those about them, as a loose plug or a radio makes them.

A force of the process lasts longer than a sample; one that is far off the last one is therefore held back, and used
where the next ones are there, too. A step of the force is late by two samples so, where a cycle has several, else by
one.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float

LEAST_N: Final = 60.0
"""Change from one sample to the next that is never a spike: a cutter enters at full depth within some samples."""
USUAL: Final = 5.0
"""Usual changes above which a change is far off: one in 300 of normal noise is above 3."""
_SHARE: Final = 0.05
"""Of a new change in the usual one."""
_SEVERAL: Final = 3
"""Samples in a cycle from which on two are held back."""


class SpikeGate:
    """Leaves samples out that are far off.

    Attributes:
        count: Spikes so far.
    """

    def __init__(self) -> None:
        self._last = (0.0, 0.0, 0.0)
        self._usual_n = 0.0
        self._known = False
        self._held = 0
        self.count = 0

    def cleaned(self, w: Float, samples: Float) -> Float | None:
        """Mean of the samples of a cycle without spikes.

        Args:
            w: (6,) mean of all of them, N, N m.
            samples: (m, 6) in time.

        Returns:
            ``w`` itself where nothing is left out, the mean of the others, or None where none remains.
        """
        most = 2 if len(samples) >= _SEVERAL else 1
        taken = [self._takes(x, y, z, most) for x, y, z, *_ in samples.tolist()]
        if all(taken):
            return w
        return np.asarray(samples[taken].mean(axis=0)) if any(taken) else None

    def _takes(self, x: float, y: float, z: float, most: int) -> bool:
        change = math.dist((x, y, z), self._last)
        limit = max(LEAST_N, USUAL * self._usual_n)
        if self._known and change > limit and self._held < most:
            self._held += 1
            return False
        if change <= limit:
            self.count += self._held
        self._held = 0
        self._usual_n += _SHARE * (min(change, limit) - self._usual_n) if self._known else 0.0
        self._last, self._known = (x, y, z), True
        return True
