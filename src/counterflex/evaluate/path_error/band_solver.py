"""Gaussian estimate of the states of a path from linear observations, in band matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.evaluate.path_error.contacts import Nodes

# What is known of the error of a path before any part was measured: smooth along a run of feed, in two lengths.
# Each component is the sum of a wide and a narrow Gaussian process with Matern 3/2 covariance
# ``sigma^2 (1 + r) exp(-r)``, ``r = sqrt(3) |s - s'| / length``: forces and postures change along the whole run,
# entries and corners over a few millimetres. In the states (value, derivative) both are Markov, so that the precision
# of all nodes is a band matrix, and the estimate is that of a Kalman filter with a Rauch-Tung-Striebel smoother,
# however long the run.
#
# Source: Sarkka and Solin, Applied Stochastic Differential Equations, 2019, section 12.3.

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
    """Sizes and lengths of the two processes."""

    wide_m: float  # standard deviation of the wide one, m
    wide_length_m: float
    narrow_m: float  # standard deviation of the narrow one, m
    narrow_length_m: float

    def sigma_m(self, unrest: Float) -> Float:
        """(k,) m, standard deviation of both together at nodes of that unrest (k,)."""
        out: Float = np.hypot(self.wide_m, self.narrow_m * unrest)
        return out


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
    wide, narrow = np.full(k, prior.wide_m), prior.narrow_m * nodes.unrest
    for j, (sigma, length) in enumerate(((wide, prior.wide_length_m), (narrow, prior.narrow_length_m))):
        x = np.where(first, 0.0, np.maximum(step, 1e-6) * np.sqrt(3.0) / length)
        decay = np.exp(-x)
        A = decay[:, None, None] * np.stack([np.stack([1.0 + x, x], -1), np.stack([-x, 1.0 - x], -1)], -2)
        A[first] = 0.0
        Q = (sigma**2)[:, None, None] * (np.eye(2) - A @ np.swapaxes(A, 1, 2))
        A *= (sigma / np.roll(sigma, 1))[:, None, None]
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


_VALUES = (0, 2)  # States of a component whose sum is its value


@dataclass(frozen=True, eq=False)
class Observations:
    """Linear observations ``y = m . ((1 - t) d[node - 1] + t d[node]) + e``."""

    node: Int  # (n,) node at the end of the stretch
    share: Float  # (n,) t
    normal: Float  # (n, 3) m
    y_m: Float
    variance_m2: Float  # (n,) of e

    def columns(self) -> tuple[Int, Float]:
        """States (n, 12) that each observation sees, and with which weight."""
        index, weight = [], []
        for node, part in ((self.node - 1, 1.0 - self.share), (self.node, self.share)):
            for component in range(COMPONENTS):
                for state in _VALUES:
                    index.append(node * WIDTH + component * STATES + state)
                    weight.append(part * self.normal[:, component])
        return np.stack(index, axis=1), np.stack(weight, axis=1)

    def seen(self, states: Float) -> Float:
        """(n,) what the observations would be without noise."""
        index, weight = self.columns()
        out: Float = np.sum(states[index] * weight, axis=1)
        return out


@dataclass(frozen=True, eq=False)
class Gathered:
    """Observations summed over the states: ``H^T W H`` as lower band, ``H^T W y``, ``y^T W y``, ``log det W``."""

    band: Float
    right: Float
    square: float
    log_weight: float
    count: int

    @classmethod
    def of(cls, seen: Observations, states: int) -> Gathered:
        """Sum them."""
        index, weight = seen.columns()
        w = 1.0 / seen.variance_m2
        band, right = np.zeros((BAND + 1, states)), np.zeros(states)
        n = index.shape[1]
        for i in range(n):
            right += np.bincount(index[:, i], w * weight[:, i] * seen.y_m, minlength=states)
            for j in range(n):
                lower = index[:, i] - index[:, j]
                at = lower >= 0
                if np.any(at):
                    flat = lower[at] * states + index[at, j]
                    values = (w * weight[:, i] * weight[:, j])[at]
                    band += np.bincount(flat, values, minlength=band.size).reshape(band.shape)
        return cls(band, right, float(np.sum(w * seen.y_m**2)), float(np.sum(np.log(w))), len(seen.y_m))


@dataclass(frozen=True, eq=False)
class BandSolution:
    """Mean of the states, Cholesky factor of their precision (lower band), and the logarithm of the evidence."""

    mean: Float
    factor: Float
    log_evidence: float

    def solve(self, right: Float) -> Float:
        """Covariance of the states times ``right``."""
        out: Float = scipy.linalg.cho_solve_banded((self.factor, True), right, check_finite=False)
        return out

    def draws(self, count: int, seed: int) -> Float:
        """(count, states) draws of the states from what is known of them."""
        z = np.random.default_rng(seed).standard_normal((len(self.mean), count))
        upper = np.zeros_like(self.factor)
        for d in range(len(self.factor)):
            upper[len(self.factor) - 1 - d, d:] = self.factor[d, : self.factor.shape[1] - d]
        out: Float = self.mean + scipy.linalg.solve_banded((0, len(self.factor) - 1), upper, z, check_finite=False).T
        return out


def solved(nodes: Nodes, prior: Prior, gathered: Gathered) -> BandSolution:
    """Estimate the states.

    The evidence is that of the observations, ``log N(y; 0, H K H^T + W^-1)``.
    """
    band, logdet = precision(nodes, prior)
    factor = scipy.linalg.cholesky_banded(band + gathered.band, lower=True, check_finite=False)
    mean = scipy.linalg.cho_solve_banded((factor, True), gathered.right, check_finite=False)
    fit = gathered.square - float(mean @ gathered.right)
    logdet_after = 2.0 * float(np.sum(np.log(factor[0])))
    log_evidence = -0.5 * (
        fit + logdet_after - logdet - gathered.log_weight + gathered.count * float(np.log(2.0 * np.pi))
    )
    return BandSolution(mean, factor, log_evidence)


def values_of(states: Float) -> Float:
    """(..., k, 3) m, the error of the path at the nodes from states (..., WIDTH k)."""
    shaped = states.reshape(*states.shape[:-1], -1, COMPONENTS, STATES)
    out: Float = shaped[..., _VALUES[0]] + shaped[..., _VALUES[1]]
    return out
