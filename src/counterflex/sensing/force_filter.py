"""Causal filter from strain to force that states its delay: a Kalman observer.

The force walks at random, ``f_k+1 = f_k + w``; beside it each bridge's zero can walk slowly. Measured are strains
``s_k = K f_k + zero_k + v``. The gain is that of the steady state (discrete Riccati equation). The filter is linear and
does not change in time, so its delay is a number: the phase of force to estimate at 2 Hz over the frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError

ZERO_MEMORY_S = 600.0
"""Time over which a wandering zero forgets; it is set anew in air far more often."""
DELAY_HZ = 2.0
"""Frequency at which delays are stated: the pace at which a robot can follow a correction."""


@dataclass(frozen=True, eq=False)
class ForceFilter:
    """A filter with constant gains: ``x = A x + L (s - H A x)``, force ``= C x``."""

    A: Float  # (m, m) transition of the state over one sample
    L: Float  # (m, n) gain
    H: Float  # (n, m) strain of the state
    C: Float  # (3, m) force of the state
    step_s: float
    delay_s: Float  # (3,) s, > 0 is late: delay of each force component at DELAY_HZ
    sigma_n: Float  # (3,) N standard deviation of the estimate in steady state

    def run(self, strain: Float, start: Float | None = None) -> Float:
        """Filter a record.

        Args:
            strain: (m, n) without bias.
            start: (3,) N force to start from; None is none.

        Returns:
            (m, 3) N; each row uses its own and earlier rows only.
        """
        s = as_float("strain", strain, (None, self.H.shape[0]))
        x = np.zeros(len(self.A))
        if start is not None:
            x[:3] = start
        step = self.A - self.L @ self.H @ self.A
        out = np.empty((len(s), 3))
        for k, row in enumerate(s):
            x = step @ x + self.L @ row
            out[k] = self.C @ x
        return out


def kalman_observer(
    K: Float, noise_covariance: Float, *, step_s: float, slew_n: Float | float, wander: Float | None = None
) -> ForceFilter:
    """Kalman observer of a force that walks at random.

    Args:
        K: (n, 3) 1/N strain per force.
        noise_covariance: (n, n) of one sample.
        slew_n: Standard deviation of the force's change over one second of random walk, N; one or (3,).
        wander: (n,) standard deviation of each zero's walk over one second; None has no zeros in the state. With more
            bridges than forces it separates what no force can explain; the rest of the zeros must be taken in air.

    Raises:
        InputError: Wrong shapes or times.
    """
    P = np.broadcast_to(as_float("slew_n", slew_n), (3,)) ** 2 * as_positive("step_s", step_s)
    K = as_float("K", K, (None, 3))
    n = len(K)
    noise = as_float("noise_covariance", noise_covariance, (n, n))
    H, A, Q = K, np.eye(3), np.diag(P)
    if wander is not None:
        walk = np.broadcast_to(as_float("wander", wander), (n,))
        if np.any(walk <= 0.0):
            raise InputError("wander of a zero", value=float(walk.min()), limit="> 0, or None")
        H = np.hstack([K, np.eye(n)])
        A = np.diag(np.r_[np.ones(3), np.full(n, math.exp(-step_s / ZERO_MEMORY_S))])
        Q = np.diag(np.r_[np.diag(Q), walk**2 * step_s])
    scale = np.sqrt(np.diag(noise))
    Hs, Rs = H / scale[:, None], noise / scale[:, None] / scale
    X = scipy.linalg.solve_discrete_are(A.T, Hs.T, Q, Rs)
    L = X @ Hs.T @ np.linalg.inv(Hs @ X @ Hs.T + Rs) / scale
    m = len(A)
    after = (np.eye(m) - L @ H) @ X
    C = np.eye(3, m)
    step = A - L @ H @ A
    B = L @ K
    omega = 2.0 * math.pi * DELAY_HZ
    late = np.exp(-1j * omega * step_s)
    answer = np.diagonal(C @ np.linalg.solve(np.eye(m) - late * step, B.astype(np.complex128)))
    delay_s = -np.angle(answer) / omega
    sigma_n = np.sqrt(after[:3, :3].diagonal())
    return ForceFilter(A, L, H, C, step_s, np.asarray(delay_s, dtype=np.float64), sigma_n)
