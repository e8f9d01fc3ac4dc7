"""What is known of the error of a path before any part was measured: smooth along a run of feed, in two lengths.

Each component is the sum of a wide and a narrow Gaussian process with Matern 3/2 covariance
``sigma^2 (1 + r) exp(-r)``, ``r = sqrt(3) |s - s'| / length``: forces and postures change along the whole run, entries
and corners over a few millimetres. In the states (value, derivative) both are Markov, so that the precision of all
nodes is a band matrix, and the estimate is that of a Kalman filter with a Rauch-Tung-Striebel smoother, however long
the run.

Source: Sarkka and Solin, Applied Stochastic Differential Equations, 2019, section 12.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.path_error.contacts import Nodes

COMPONENTS: Final = 3
STATES: Final = 4
"""Of each component: value and scaled derivative, wide and narrow."""
WIDTH: Final = COMPONENTS * STATES
BAND: Final = 2 * WIDTH - 1
WIDE_M: Final = (15.0 * MM, 400.0 * MM)
NARROW_M: Final = (2.0 * MM, 12.0 * MM)
"""Range of the two lengths."""


@dataclass(frozen=True)
class Prior:
    """Sizes and lengths of the two processes.

    Attributes:
        wide_m: Standard deviation of the wide one, m.
        wide_length_m: Its length.
        narrow_m: Standard deviation of the narrow one, m.
        narrow_length_m: Its length.
    """

    wide_m: float
    wide_length_m: float
    narrow_m: float
    narrow_length_m: float

    @property
    def sigma_m(self) -> float:
        """Standard deviation of both together, m."""
        return float(np.hypot(self.wide_m, self.narrow_m))


def precision(nodes: Nodes, prior: Prior) -> tuple[Float, float]:
    """Precision of all states as a lower band matrix, and the logarithm of its determinant.

    Args:
        nodes: k nodes.
        prior: Sizes and lengths.

    Returns:
        (:data:`BAND` + 1, :data:`WIDTH` k) lower band; state ``node * WIDTH + component * STATES + j``.
    """
    k = len(nodes)
    band, logdet = np.zeros((BAND + 1, WIDTH * k)), 0.0
    first = np.diff(nodes.chain, prepend=-1) != 0
    step = np.diff(nodes.station_m, prepend=0.0)
    for j, (sigma, length) in enumerate(((prior.wide_m, prior.wide_length_m), (prior.narrow_m, prior.narrow_length_m))):
        x = np.where(first, 0.0, np.maximum(step, 1e-6) * np.sqrt(3.0) / length)
        decay = np.exp(-x)
        A = decay[:, None, None] * np.stack([np.stack([1.0 + x, x], -1), np.stack([-x, 1.0 - x], -1)], -2)
        A[first] = 0.0
        Q = sigma**2 * (np.eye(2) - A @ np.swapaxes(A, 1, 2))
        P = np.linalg.inv(Q)
        logdet -= COMPONENTS * float(np.sum(np.linalg.slogdet(Q)[1]))
        PA = P @ A
        own = P.copy()
        own[:-1] += (np.swapaxes(A, 1, 2) @ PA)[1:]
        for component in range(COMPONENTS):
            base = WIDTH * np.arange(k) + STATES * component + 2 * j
            for r in range(2):
                for c in range(r + 1):
                    band[r - c, base + c] += own[:, r, c]
                for c in range(2):  # row r of the next node, column c of this one
                    band[WIDTH + r - c, base[:-1] + c] -= PA[1:, r, c]
    return band, logdet
