"""Stability lobes by the zeroth-order solution: mean directional coefficients, exact delay.

With the mean directional matrix A and the frequency response G at the tip, the cut at s times its depth swings for
ever at omega where ``det(I + s (1 - exp(-i omega T)) A G(i omega)) = 0``. Every eigenvalue lambda of A G gives, with
``Lambda = -1 / lambda`` and ``Re Lambda > 0``, the factor and the phase of the wave left by the tooth before

    s = |Lambda|^2 / (2 Re Lambda),    omega T = pi - 2 arg(Lambda) + 2 pi k

At a given tooth period the limit is the smallest s among the frequencies that meet the phase. The responses may be
measured ones: nothing is assumed of their form. For plunge turning on one mode the least limit is
``2 k zeta (1 + zeta) / Kf``.

Valid for mean coefficients: three teeth or more, or an engagement above about 0.3 of the diameter. With few teeth and a
shallow engagement there are lobes of period doubling, which only
:mod:`counterflex.cutting.stability.semi_discretisation` has.

Source: Altintas and Budak 1995, Analytical prediction of stability lobes in milling; Altintas 2012, ch. 4.
"""

from __future__ import annotations

import functools
import itertools
from typing import Final

import numpy as np

from counterflex.core.arrays import Complex, Float, Int, as_float, batches
from counterflex.core.errors import InputError
from counterflex.cutting.stability.modes import TipModes

POINTS_PER_WIDTH: Final = 16
_LOWEST, _HIGHEST = 0.05, 6.0
_NO_RANK: Final = 1e-13
"""Singular values of A below this share of the largest are what rounding leaves of zeros."""


def frequencies_for(modes: TipModes) -> Float:
    """Angular frequencies that resolve every mode: geometric, with points between the half-power frequencies.

    From :data:`_LOWEST` of the lowest to :data:`_HIGHEST` times the highest natural frequency.
    """
    broad = np.geomspace(_LOWEST * modes.omega_rad_s.min(), _HIGHEST * modes.omega_rad_s.max(), 1600)
    widths = np.sinh(np.linspace(-6.0, 6.0, 12 * POINTS_PER_WIDTH))
    near = modes.omega_rad_s * (1.0 + modes.damping_ratio * widths[:, None] / 2.0)
    grid = np.unique(np.concatenate([broad, near[near > broad[0]].ravel()]))
    out: Float = grid[grid <= broad[-1]]
    return out


def curves(A: Float, response: Complex) -> tuple[Float, Float]:
    """Factor and phase of every eigenvalue over the frequency.

    Args:
        A: (3, 3) mean directional matrix, N/m.
        response: (n, 3, 3) frequency response at the tip in the axes of A, m/N, at rising frequencies.

    Returns:
        Factors (n, k), inf where no depth reaches the limit; phases (n, k) of ``omega T`` in (0, 2 pi). k is the rank
        of A, at least 1.

    Raises:
        InputError: Shapes.
    """
    A = as_float("A", A, (3, 3))
    if response.ndim != 3 or response.shape[1:] != (3, 3):
        raise InputError("the response has the wrong shape", value=response.shape, limit="(n, 3, 3)")
    values = _tracked(_eigenvalues(A, response))
    size = np.abs(values)
    # A cylindrical cutter does not feed back along its axis: A has rank 2, and one eigenvalue is rounding. Its inverse
    # is no limit.
    there = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    inverse = -1.0 / np.where(there, values, 1.0)
    reached = there & (inverse.real > 0.0)
    factor = np.where(reached, np.abs(inverse) ** 2 / (2.0 * np.where(reached, inverse.real, 1.0)), np.inf)
    phase = np.pi - 2.0 * np.angle(inverse)
    return factor, np.where(reached, phase, np.nan)


def _eigenvalues(A: Float, response: Complex) -> Complex:
    """(n, k) eigenvalues of A G that are not zero whatever G is.

    No chip of an upright end mill changes when the tool moves along its axis, so A has rank 2. Of ``A = X Y`` with k
    columns in X the eigenvalues of ``X Y G`` but zeros are those of ``Y G X``. Of two by two they have a closed form:
    the iteration for three by three took two thirds of the time of an advice.
    """
    X, size, Y = np.linalg.svd(A)
    rank = max(1, int(np.count_nonzero(size > _NO_RANK * size[0])))
    if rank == 3:
        return np.asarray(np.linalg.eigvals(A @ response), dtype=np.complex128)
    M: Complex = (size[:rank, None] * Y[:rank]) @ response @ X[:, :rank]
    if rank == 1:
        return M[:, :, 0]
    (a, b), (c, d) = np.moveaxis(M, 0, -1)
    half, product = (a + d) / 2.0, b * c
    root = np.sqrt(((a - d) / 2.0) ** 2 + product)
    large = half + np.where((half.conj() * root).real >= 0.0, root, -root)
    # by the determinant: the difference of half and root cancels where one eigenvalue is small
    small = (a * d - product) / np.where(large == 0.0, 1.0, large)
    return np.stack([large, small], axis=1)


def limits(A: Float, response: Complex, omega_rad_s: Float, periods_s: Float) -> tuple[Float, Float]:
    """Limit factor on the depth at each tooth period, and the frequency of chatter there.

    Args:
        A: (3, 3) mean directional matrix, N/m.
        response: (n, 3, 3) frequency response at the tip in the axes of A, m/N.
        omega_rad_s: (n,) its angular frequencies, rising.
        periods_s: (m,) tooth periods T, s.

    Returns:
        (m,) factors, inf without a limit within the frequencies; (m,) angular frequencies of chatter, nan there.

    Raises:
        InputError: Shapes, or a period that is not above zero.
    """
    omega = as_float("omega_rad_s", omega_rad_s, (len(response),))
    T = as_float("periods_s", periods_s, (None,))
    if np.any(T <= 0.0):
        raise InputError("tooth period is out of range", value=float(T.min()), limit="> 0 s")
    if len(omega) < 2 or np.any(np.diff(omega) <= 0.0):
        raise InputError("frequencies of the response do not rise", limit="at least 2, rising")
    factor, phase = curves(A, response)
    best, chatter = np.full(len(T), np.inf), np.full(len(T), np.nan)
    for rows in batches(len(T), 64):
        for branch in range(factor.shape[1]):
            s, f = _lowest(factor[:, branch], phase[:, branch], omega, T[rows])
            lower = s < best[rows]
            best[rows] = np.where(lower, s, best[rows])
            chatter[rows] = np.where(lower, f, chatter[rows])
    return best, chatter


def _lowest(factor: Float, phase: Float, omega: Float, T: Float) -> tuple[Float, Float]:
    """Smallest factor of one branch at each period: where ``(omega T - phase) / 2 pi`` passes a whole number."""
    turns = (omega * T[:, None] - phase) / (2.0 * np.pi)
    before, after = turns[:, :-1], turns[:, 1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        passed = np.floor(before) != np.floor(after)
        passed &= np.isfinite(before) & np.isfinite(after)
        whole = np.maximum(np.floor(before), np.floor(after))
        share = np.where(passed, (whole - before) / np.where(after == before, 1.0, after - before), 0.0)
        # 1/s is smooth where s grows without bound
        value = np.where(passed, 1.0 / ((1.0 - share) / factor[:-1] + share / factor[1:]), np.inf)
    at = np.argmin(value, axis=1)
    rows = np.arange(len(T))
    return value[rows, at], np.where(
        np.isfinite(value[rows, at]), omega[at] + share[rows, at] * (omega[at + 1] - omega[at]), np.nan
    )


def _tracked(values: Complex) -> Complex:
    """Order the eigenvalues of each frequency so that each column is continuous."""
    count = values.shape[1]
    orders, behind = _orders(count)
    steps = np.abs(values[1:, orders][:, :, :] - values[:-1, None, :])  # where the columns of the row before go
    # relative: small eigenvalues are tracked as well as large ones
    scale = np.abs(values[:-1, None, :]) + np.abs(values[1:, orders]) + 1e-300
    best = np.argmin((steps / scale).sum(axis=2), axis=1).tolist()
    order = list(itertools.accumulate(best, lambda before, step: behind[step][before], initial=0))
    out: Complex = np.take_along_axis(values, orders[order], axis=1)
    return out


@functools.cache
def _orders(count: int) -> tuple[Int, list[list[int]]]:
    """All orders of so many columns, as they are first; the number of each of them taken of each other."""
    orders = list(itertools.permutations(range(count)))
    number = {order: k for k, order in enumerate(orders)}
    return np.array(orders), [[number[tuple(step[k] for k in before)] for before in orders] for step in orders]
