"""Bank of Kalman filters of thermal growth, and how likely a touch is by all of them together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float

STATES: Final = 8
"""g, A, b (3) and c (3)."""
TAUS: Final[Float] = 60.0 * np.geomspace(4.0, 120.0, 13)
"""Time constants of the spindle that are weighed, s: 4 min to 2 h."""
WALKS: Final[Float] = np.array([0.3, 1.0])
"""Drifts of the arm that are weighed, as shares of :attr:`GrowthModel.arm_walk_m`: 7.5 and 25 um per root hour."""
_HOUR: Final = 3600.0


@dataclass(eq=False)
class Bank:
    """One filter for each time constant and drift."""

    growth_walk_m: float  # standard deviation over an hour of what a single time constant leaves out of g
    tau_s: Float  # (m,) time constants
    walk_m: Float  # (m,) drifts of the arm over an hour
    x: Float  # (m, STATES) states
    P: Float  # (m, STATES, STATES) their covariances
    log_weight: Float  # (m,) logarithms of the weights, but for a constant

    def copy(self) -> Bank:
        """The same filters, apart from these."""
        return replace(self, x=self.x.copy(), P=self.P.copy(), log_weight=self.log_weight.copy())

    def weights(self) -> Float:
        """(m,) sum 1."""
        w = np.exp(self.log_weight - self.log_weight.max())
        out: Float = w / w.sum()
        return out

    def marginals(self) -> tuple[Float, Float]:
        """Weights of the time constants and of the drifts, each sum 1."""
        grid = self.weights().reshape(len(WALKS), len(TAUS))
        return grid.sum(axis=0), grid.sum(axis=1)

    def move(self, step_s: float, u: float) -> Float:
        """Let a time pass at a speed; (m, STATES, STATES) transitions."""
        hours = step_s / _HOUR
        transitions = np.zeros_like(self.P)
        for j, (tau, walk) in enumerate(zip(self.tau_s, self.walk_m, strict=True)):
            kept = math.exp(-step_s / float(tau))
            F = np.eye(STATES)
            F[0, 0], F[0, 1] = kept, (1.0 - kept) * u
            noise = np.diag([self.growth_walk_m**2, 0.0, *(float(walk) ** 2,) * 3, 0.0, 0.0, 0.0]) * hours
            self.x[j], self.P[j] = F @ self.x[j], F @ self.P[j] @ F.T + noise
            transitions[j] = F
        return transitions

    def expected(self, H: Float, y: Float, R: Float) -> tuple[Float, Float]:
        """(m, d) innovations of a touch and (m, d, d) their covariances."""
        return y - self.x @ H.T, H @ self.P @ H.T + R

    def update(self, H: Float, y: Float, R: Float) -> None:
        """Take a touch in."""
        innovation, S = self.expected(H, y, R)
        self.log_weight = self.log_weight - 0.5 * (squares(innovation, S) + np.linalg.slogdet(S)[1])
        self.log_weight -= self.log_weight.max()
        gain = np.swapaxes(np.linalg.solve(S, H @ self.P), 1, 2)
        self.x = self.x + np.einsum("jab,jb->ja", gain, innovation)
        left = np.eye(STATES) - gain @ H
        self.P = left @ self.P @ np.swapaxes(left, 1, 2) + gain @ R @ np.swapaxes(gain, 1, 2)

    def mixed(self) -> tuple[Float, Float]:
        """Mean and covariance over the time constants, with the largest drift."""
        widest = slice((len(WALKS) - 1) * len(TAUS), None)
        w = self.log_weight[widest]
        w = np.exp(w - w.max())
        return mean_of(w / w.sum(), self.x[widest], self.P[widest])


def squares(innovation: Float, S: Float) -> Float:
    """(m,) innovations squared in units of their covariance."""
    out: Float = np.einsum("jd,jd->j", innovation, np.linalg.solve(S, innovation[:, :, None])[:, :, 0])
    return out


def chance(weights: Float, innovation: Float, S: Float) -> float:
    """Probability of an innovation at least as far off, by the filters as they were weighted before it."""
    from scipy.stats import chi2

    return float(weights @ chi2.sf(squares(innovation, S), innovation.shape[1]))


def step_over_two(
    before: Bank, H: Float, y: Float, R: Float, step_s: float, u: float, now: tuple[Float, Float, Float]
) -> tuple[float, Float, Float]:
    """Probability of a step of the place before the first of two touches by chance, the step and its covariance.

    ``e = A s + v`` with both innovations e (without the first one's update), ``A = [I I]``, v by the filter.

    Args:
        before: The filters as they expected the first of the two touches.
        H: (d, STATES) of the first touch.
        y: (d,) likewise.
        R: (d, d) likewise.
        step_s: Time from the first to the second.
        u: Speed in it.
        now: H, y, R of the second.
    """
    from scipy.stats import chi2

    later = before.copy()
    weights, P = before.weights(), before.P
    F = later.move(step_s, u)
    first, S1 = before.expected(H[:3], y[:3], R[:3, :3])
    second, S2 = later.expected(now[0][:3], now[1][:3], now[2][:3, :3])
    cross = H[:3] @ P @ np.swapaxes(F, 1, 2) @ now[0][:3].T
    S = np.concatenate(
        [np.concatenate([S1, cross], axis=2), np.concatenate([np.swapaxes(cross, 1, 2), S2], axis=2)], axis=1
    )
    A = np.vstack([np.eye(3), np.eye(3)])
    weighted = np.linalg.solve(S, np.broadcast_to(A, (len(S), 6, 3)))
    spread: Float = np.linalg.inv(A.T @ weighted).astype(np.float64)
    step = np.einsum("jab,jcb,jc->ja", spread, weighted, np.concatenate([first, second], axis=1))
    by_chance = float(weights @ chi2.sf(squares(step, spread), 3))
    return (by_chance, *mean_of(weights, step, spread))


def mean_of(weights: Float, mean: Float, covariance: Float) -> tuple[Float, Float]:
    """Mean and covariance of a mixture of normal distributions."""
    centre = weights @ mean
    off = mean - centre
    spread = np.einsum("j,jab->ab", weights, covariance) + np.einsum("j,ja,jb->ab", weights, off, off)
    return centre, spread


def size_along(off: Float, covariance: Float) -> tuple[float, float]:
    """Length of a vector, and the standard deviation along it."""
    size = float(np.linalg.norm(off))
    a = off / size
    return size, float(np.sqrt(a @ covariance @ a))
