"""Deviations along a path smoothed as the path itself says: much where it is quiet, little where the tool swings.

In windows of :data:`WINDOW_M` the deviation is a straight line and a Gaussian process over the length s of the path,

    y = a + b s + f(s) + noise,   cov(f(s), f(s')) = A^2 (1 + r + r^2 / 3) exp(-r),   r = sqrt(5) |s - s'| / l

(Matern 5/2). Nothing is known of a and b. Size A and length l are not chosen but weighed by their likelihood in the
window, A = 0 among them. Windows lie an eighth of their length apart; at a station the one that knows it best counts
most (by the square of its variance), so that a quiet stretch beside a swing is smoothed as one. Never across a corner
or a hole.

Source: Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", 2.7 (unknown line), 4.2.1 (Matern), 5.2
(likelihood).
"""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, UM

WINDOW_M: Final = 8.0 * MM
"""The deviation has one size and one length in a window so long."""
NOISELESS_M: Final = 1.0 * UM
"""Readings with less noise stay as they are."""
CORNER: Final = np.cos(np.radians(15.0))
"""Cosine of the turn between two stations beyond which a corner lies between them."""
_LEAST: Final = 6
"""Shorter runs stay as they are."""
_HOP: Final = 8
_END: Final = 0.05
"""Share that the ends of a window have of its middle."""
_MOST: Final = 400
"""Stations in a window."""
_LENGTHS: Final = np.geomspace(0.8, 8.0, 6) * MM
_SIZES: Final = np.concatenate([[0.0], np.geomspace(0.25, 512.0, 12)])
"""Standard deviation of f by that of one reading."""


def pieces(directions: Float, broken: Bool, kind: Int) -> list[tuple[int, int]]:
    """Runs of stations (first, behind last) without a corner, a hole or a change of kind."""
    turn = np.sum(directions[1:] * directions[:-1], axis=1) < CORNER
    edges = np.flatnonzero(turn | broken[1:] | (kind[1:] != kind[:-1])) + 1
    bounds = [0, *edges.tolist(), len(broken)]
    return list(itertools.pairwise(bounds))


def smoothed(
    values: Float, runs: list[tuple[int, int]], weight: Float, noise_m: float, spacing_m: float
) -> tuple[Float, Float]:
    """Values at stations without their noise.

    Args:
        values: (k,) m, at the stations.
        runs: From :func:`pieces`.
        weight: (k,) how many independent readings a station stands for, at most one.
        noise_m: Standard deviation of one reading, m.
        spacing_m: Distance of stations, m.

    Returns:
        (k,) smoothed, m; and (k,) the standard deviation of each, m.
    """
    out, sigma = values.copy(), np.full(len(values), noise_m)
    if noise_m <= NOISELESS_M:
        return out, sigma
    most = int(np.clip(round(WINDOW_M / spacing_m), _LEAST, _MOST))
    for first, end in runs:
        n = min(end - first, most)
        if n < _LEAST:
            continue
        begin = np.unique(np.append(np.arange(0, end - first - n, max(n // _HOP, 1)), end - first - n))
        index = first + begin[:, None] + np.arange(n)
        sigma_y = noise_m / np.sqrt(np.clip(weight[index].mean(axis=1), 1e-3, 1.0))
        mean, variance = _windows(values[index], sigma_y, spacing_m, n)
        middle = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2 + _END
        share = (middle / variance**2).ravel()
        total = np.bincount(index.ravel() - first, share, end - first)
        y = np.bincount(index.ravel() - first, share * mean.ravel(), end - first) / total
        v = np.bincount(index.ravel() - first, share * variance.ravel(), end - first) / total
        out[first:end], sigma[first:end] = y, np.sqrt(v)
    return out, sigma


def _windows(y: Float, noise: Float, spacing: float, n: int) -> tuple[Float, Float]:
    """Mean and variance at the stations of windows (m, n), each with its own noise (m,), over all sizes and lengths.

    With V = K + noise^2 I and Q orthogonal to every straight line, the best estimate is
    ``y - noise^2 Q (Q' V Q)^-1 Q' y`` and its covariance ``noise^2 (I - noise^2 Q (Q' V Q)^-1 Q')``; the likelihood
    is that of ``Q' y``.
    """
    scale = noise[:, None]
    bases = [_basis(n, spacing, float(length)) for length in _LENGTHS]
    likely = np.empty((len(bases), len(_SIZES), len(y)))
    spectra = []
    for k, (basis, power) in enumerate(bases):
        z = (y / scale) @ basis
        spectra.append(z)
        for a, size in enumerate(_SIZES):
            v = 1.0 + size * size * power
            likely[k, a] = -0.5 * (np.sum(z * z / v, axis=1) + np.sum(np.log(v)))
    likely[:, 0] -= np.log(len(bases) / (len(_SIZES) - 1.0))  # all lengths are one without f: it weighs like a length
    chance = np.exp(likely - likely.max(axis=(0, 1)))
    chance /= chance.sum(axis=(0, 1))
    mean, second, variance = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y)
    for k, (basis, power) in enumerate(bases):
        for a, size in enumerate(_SIZES):
            p = chance[k, a][:, None]
            some = np.flatnonzero(p[:, 0] > 1e-4)
            if len(some) == 0:
                continue
            g = 1.0 / (1.0 + size * size * power)
            fitted = y[some] - scale[some] * ((spectra[k][some] * g) @ basis.T)
            mean[some] += p[some] * fitted
            second[some] += p[some] * fitted * fitted
            variance[some] += p[some] * scale[some] ** 2 * (1.0 - (basis * basis) @ g)
    total = np.sum(np.where(chance > 1e-4, chance, 0.0), axis=(0, 1))[:, None]
    mean, second, variance = mean / total, second / total, variance / total
    return mean, np.maximum(variance + second - mean * mean, 1e-18)


@lru_cache(maxsize=4096)
def _basis(n: int, spacing: float, length: float) -> tuple[Float, Float]:
    """Directions (n, n - 2) square to straight lines in which f of size 1 has independent parts, and their powers."""
    s = spacing * np.arange(n)
    r = np.sqrt(5.0) * np.abs(s[:, None] - s) / length
    covariance = (1.0 + r + r * r / 3.0) * np.exp(-r)
    line = np.column_stack([np.ones(n), s - s.mean()])
    square = np.linalg.qr(line, mode="complete")[0][:, 2:]
    power, vectors = np.linalg.eigh(square.T @ covariance @ square)
    return square @ vectors, np.maximum(power, 0.0)
