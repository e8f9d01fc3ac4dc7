"""Stability of milling by first-order semi-discretisation: time-varying coefficients, any engagement, few teeth.

The delay equation ``eta'' + 2 zeta omega eta' + omega^2 eta = -s U' a(t) U (eta(t) - eta(t - T))`` is solved exactly
over each of k intervals of the tooth period, with the mean of a(t) over the interval and the delayed displacement
linear between its values at the interval's ends. The product of the k maps, the transition matrix over a tooth period,
has the multipliers mu: the cut is stable when all ``|mu| < 1``. A multiplier at -1 is period doubling (flip), a complex
pair a quasi-periodic chatter (Hopf).

An interval of duration h makes the delayed wave too small by about ``(omega h)^2 / 12`` and takes the mean of a(t) over
it. Both matter only while a tooth cuts: between cuts the modes move freely and one interval is exact, however long.
:func:`intervals_for` therefore divides what is engaged, and is as accurate at 5 % immersion as in a slot.

Source: Insperger and Stepan 2004, Updated semi-discretization method; Insperger, Stepan and Turi 2008 (first order).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int, as_positive
from counterflex.core.errors import InputError
from counterflex.cutting.stability.modes import TipModes
from counterflex.cutting.stability.process import Process

LEAST_INTERVALS: Final = 40
MOST_INTERVALS: Final = 2000
_STEP_RAD: Final = 0.3
_DENSE: Final = 250
"""Size up to which all multipliers are computed; of larger matrices only the largest few."""
_SEARCH: Final = 14
_TAYLOR_NORM, _TAYLOR_ORDER = 0.5, 12
"""Rest of the series: ``0.5^13 / 13!``, below 1e-13."""


def intervals_for(modes: TipModes, process: Process, period_s: float) -> Float:
    """Edges of the intervals of a tooth pitch, (k + 1,) rad, rising from 0 to ``2 pi / N``.

    A stretch in which a tooth cuts is divided so that the fastest mode turns by at most 0.3 rad in an interval (the
    delayed wave to 0.75 %), all such stretches together into at least 40; one between cuts is a single interval.
    """
    pitch = 2.0 * np.pi / process.teeth
    spans = process.engaged()
    durations = spans[:, 1] - spans[:, 0]
    rad_per_rad = float(modes.omega_rad_s.max()) * period_s / pitch  # of the mode, per angle of the cutter
    step = min(_STEP_RAD / rad_per_rad, float(durations.sum()) / LEAST_INTERVALS)
    step = max(step, pitch / MOST_INTERVALS)
    parts = [np.linspace(low, high, math.ceil((high - low) / step - 1e-9) + 1) for low, high in spans]
    edges: Float = np.unique(np.concatenate([[0.0, pitch], *parts]))
    return edges


def largest_multiplier(
    modes: TipModes, process: Process, period_s: float, factor: float = 1.0, intervals: int | None = None
) -> float:
    """Largest ``|mu|`` of the cut at a factor on its depth; stable below 1.

    Args:
        modes: Modes in the feed frame.
        period_s: Tooth period T, s.
        factor: On the depths of the engagement, >= 0.
        intervals: k equal ones, or None for those of :func:`intervals_for`.

    Raises:
        InputError: A number is out of range, or there is no mode.
    """
    T = as_positive("period_s", period_s)
    s = as_positive("factor", factor, zero=True)
    if len(modes) == 0:
        raise InputError("no mode to discretise", limit="at least 1")
    edges = _edges(modes, process, T, intervals)
    return _radius(_transition(modes, s * process.means(edges), np.diff(edges) * T / edges[-1]))


def _edges(modes: TipModes, process: Process, period_s: float, intervals: int | None) -> Float:
    if intervals is None:
        return intervals_for(modes, process, period_s)
    if not 2 <= intervals <= 100_000:
        raise InputError("number of intervals is out of range", value=intervals, limit="2 to 100000")
    return np.linspace(0.0, 2.0 * np.pi / process.teeth, intervals + 1)


def _transition(modes: TipModes, a: Float, step_s: Float) -> Float:
    """Transition matrix over a tooth period of (eta, eta', y(-1), ..., y(-k)), y the displacements that feed back."""
    k, n = len(a), len(modes)
    # Directions that nothing feeds back (z of an upright flat mill) need no history: the matrix is a third smaller.
    used = np.flatnonzero(np.any(a != 0.0, axis=(0, 1)) & np.any(modes.shape != 0.0, axis=1))
    U, d = modes.shape[used], len(used)
    maps, which = _interval_maps(modes, a, used, step_s)
    size = 2 * n + k * d
    x = np.zeros((2 * n, size))
    x[:, : 2 * n] = np.eye(2 * n)
    history = np.zeros((k, d, size))  # y at the ends of the intervals of this period
    for i in range(k):
        P, R0, R1 = maps[which[i]]
        x = P @ x
        _add_delayed(x, R0, i - k, n, U)
        _add_delayed(x, R1, i - k + 1, n, U)
        history[i] = U @ x[:n]
    # y(-1) of the next period is y one interval before its begin, and so on; its begin is part of x
    before = np.zeros((1, d, size))
    before[0, :, :n] = U
    rows = np.concatenate([before, history[:-1]])[::-1]
    return np.concatenate([x, rows.reshape(k * d, size)])


def _add_delayed(x: Float, R: Float, at: int, n: int, U: Float) -> None:
    """Add ``R y(at)``, at = -k .. 0 counted in intervals from the begin of the period."""
    d = len(U)
    if at == 0:
        x[:, :n] += R @ U
    else:
        first = 2 * n + (-at - 1) * d
        x[:, first : first + d] += R


def _interval_maps(
    modes: TipModes, a: Float, used: Int, step_s: Float
) -> tuple[list[tuple[Float, Float, Float]], list[int]]:
    """Maps of an interval for each different coefficient matrix and duration, and which of them each interval has."""
    # `x(1) = P x(0) + R0 y(0 - T) + R1 y(1 - T)` from one matrix exponential of the state with y and its slope.
    n, d = len(modes), len(used)
    rows = np.column_stack([a.reshape(len(a), -1), step_s])
    distinct, which = np.unique(rows, axis=0, return_inverse=True)
    h = distinct[:, -1, None, None]
    generator = np.zeros((len(distinct), 2 * n + 2 * d, 2 * n + 2 * d))
    coupling = modes.shape.T @ distinct[:, :-1].reshape(-1, 3, 3)  # (m, n, 3)
    generator[:, :n, n : 2 * n] = np.eye(n)
    generator[:, n : 2 * n, :n] = -np.diag(modes.omega_rad_s**2) - coupling @ modes.shape
    generator[:, n : 2 * n, n : 2 * n] = -np.diag(2.0 * modes.damping_ratio * modes.omega_rad_s)
    generator[:, n : 2 * n, 2 * n : 2 * n + d] = coupling[:, :, used]
    generator[:, 2 * n : 2 * n + d, 2 * n + d :] = np.eye(d) / h
    flow = _exponentials(generator * h, n, float(modes.omega_rad_s.max()))[:, : 2 * n]
    maps = []
    for one in flow:
        slope = one[:, 2 * n + d :]
        maps.append((one[:, : 2 * n], one[:, 2 * n : 2 * n + d] - slope, slope))
    return maps, which.ravel().tolist()


def _exponentials(generators: Float, n: int, fastest: float) -> Float:
    """Exponentials of many small matrices: Taylor series with scaling and squaring, all at once."""
    # Velocities are measured in units of the fastest frequency, so that the norm is the angle that it turns by.
    scale = np.ones(generators.shape[1])
    scale[n : 2 * n] = 1.0 / fastest
    balanced = generators * (scale[:, None] / scale)
    norm = float(np.abs(balanced).sum(axis=2).max())
    squarings = max(0, math.ceil(math.log2(max(norm, 1e-300) / _TAYLOR_NORM)))
    small = balanced / 2.0**squarings
    out = np.broadcast_to(np.eye(len(scale)), small.shape).copy()
    for order in range(_TAYLOR_ORDER, 0, -1):
        out = np.eye(len(scale)) + small @ out / order
    for _ in range(squarings):
        out = out @ out
    result: Float = out * (scale / scale[:, None])
    return result


def _radius(matrix: Float) -> float:
    """Spectral radius."""
    if len(matrix) <= _DENSE:
        return float(np.abs(np.linalg.eigvals(matrix)).max())
    try:
        values = scipy.sparse.linalg.eigs(
            matrix, k=4, v0=np.ones(len(matrix)), ncv=40, maxiter=30, tol=1e-9, return_eigenvectors=False
        )
    except scipy.sparse.linalg.ArpackError:
        values = np.linalg.eigvals(matrix)
    return float(np.abs(values).max())


def limit(
    modes: TipModes,
    process: Process,
    period_s: float,
    *,
    most: float,
    least: float | None = None,
    intervals: int | None = None,
    tolerance: float = 2e-3,
) -> float:
    """Smallest factor on the depth at which the cut becomes unstable.

    Geometric steps from ``least`` upwards find the first unstable factor, regula falsi on ``ln |mu|`` the limit in
    between. An island of instability narrower than a step (20 %) can be passed over.

    Args:
        modes: Modes in the feed frame.
        period_s: Tooth period T, s.
        most: Largest factor of interest; the result is inf where all below are stable.
        least: Where to begin, default ``most / 13``; it is lowered while the cut is unstable there.
        intervals: k equal ones, or None for those of :func:`intervals_for`.
        tolerance: Relative, of the result.

    Raises:
        InputError: A number is out of range.
    """
    most = as_positive("most", most)
    growth = partial(_growth, modes, process, as_positive("period_s", period_s), intervals)
    low = most * 1.2**-_SEARCH if least is None else min(as_positive("least", least), most)
    g_low = growth(low)
    high, g_high = low, g_low
    # Lowered while it chatters: the limit must lie between a stable and an unstable factor.
    while g_low >= 0.0 and low > 1e-9 * most:
        high, g_high = low, g_low
        low *= 0.5
        g_low = growth(low)
    if g_low >= 0.0:
        return low
    while g_high < 0.0:
        if high >= most:
            return math.inf
        low, g_low = high, g_high
        high = min(high * 1.2, most)
        g_high = growth(high)
    return _refined(growth, (low, g_low), (high, g_high), tolerance)


def _growth(modes: TipModes, process: Process, period_s: float, intervals: int | None, factor: float) -> float:
    return math.log(max(largest_multiplier(modes, process, period_s, factor, intervals), 1e-300))


def _refined(
    growth: Callable[[float], float], stable: tuple[float, float], unstable: tuple[float, float], tolerance: float
) -> float:
    """Root of the growth between a stable and an unstable factor (Illinois variant of regula falsi)."""
    (low, g_low), (high, g_high) = stable, unstable
    side = 0
    while high - low > tolerance * high:
        middle = (low * g_high - high * g_low) / (g_high - g_low)
        # Regula falsi creeps where the growth is curved: each step leaves the ends by 5 % of what is left at least.
        middle = min(max(middle, low + 0.05 * (high - low)), high - 0.05 * (high - low))
        g = growth(middle)
        if g >= 0.0:
            high, g_high = middle, g
            g_low *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            low, g_low = middle, g
            g_high *= 0.5 if side == -1 else 1.0
            side = -1
    return 0.5 * (low + high)
