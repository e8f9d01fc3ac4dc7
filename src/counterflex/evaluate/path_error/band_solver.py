"""Gaussian estimate of the states of a path from linear observations, in band matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.evaluate.path_error.contacts import Nodes
from counterflex.evaluate.path_error.prior import BAND, COMPONENTS, STATES, WIDTH, Prior, precision

_VALUES = (0, 2)
"""States of a component whose sum is its value."""


@dataclass(frozen=True, eq=False)
class Observations:
    """Linear observations ``y = m . ((1 - t) d[node - 1] + t d[node]) + e``.

    Attributes:
        node: (n,) node at the end of the stretch.
        share: (n,) t.
        normal: (n, 3) m.
        y_m: (n,) m.
        variance_m2: (n,) of e.
    """

    node: Int
    share: Float
    normal: Float
    y_m: Float
    variance_m2: Float

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
class Solved:
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


def solved(nodes: Nodes, prior: Prior, gathered: Gathered) -> Solved:
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
    return Solved(mean, factor, log_evidence)


def values_of(states: Float) -> Float:
    """(..., k, 3) m, the error of the path at the nodes from states (..., WIDTH k)."""
    shaped = states.reshape(*states.shape[:-1], -1, COMPONENTS, STATES)
    out: Float = shaped[..., _VALUES[0]] + shaped[..., _VALUES[1]]
    return out
