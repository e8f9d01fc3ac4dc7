"""Wear: does the ratio of measured to predicted force rise with the length of cut?

Each stretch of cut gives one ratio. It is held against those before it of cuts of about the same force, because a model
errs by another percentage in a slot than on a thin wall. With n ratios before, mean m and standard deviation s::

    T = (x - m) / s sqrt(n / (n + 1))        Student, n - 1 degrees of freedom

as long as nothing changes, whatever m and s truly are; made standard normal (Wallace 1959)::

    U = sign(T) (8 nu + 1) / (8 nu + 3) sqrt(nu log(1 + T^2 / nu))

and summed up: ``S = max(0, S + c U - 1/2)``. The false alarm rate is therefore that of a cumulative sum of standard
normal values, with no reference to be learnt first (self-starting CUSUM, Hawkins 1987; Page 1954). Beside it runs the
regression of the ratio on the length of cut with one mean per class of force: trend per metre, its standard deviation.

Neighbouring stretches are alike: the place in the stock, the posture of the arm and the model's error there are nearly
the same. With the correlation rho of neighbouring residuals n ratios are worth ``n / f`` independent ones,
``f = (1 + rho) / (1 - rho)`` (Bayley and Hammersley 1946). rho is that of the recursive residuals of the regression,
freed of the bias of short records, one standard error added; as long as few are known they count as correlated by 1/2::

    sigma^2 = rest / (n - (classes + 1) f),   sigma_b^2 = f sigma^2 / sum Sxx,   degrees = n / f - classes - 1

and ``c = 1 / sqrt(f)``. A trend is known from one degree of freedom on: nine ratios at the least.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.runtime.monitoring import layout as ml

FIRST: Final = 3
"""Ratios of a class before the next one is judged."""
LARGEST_U: Final = 4.0
"""A single ratio counts no more than this: one odd stretch is no trend."""
LEAST_SPREAD: Final = 0.002
"""Standard deviation of ratios, at least."""
_SUPPOSED: Final = 0.5  # correlation of neighbours as long as nothing is known
_SUPPOSED_WEIGHT: Final = 4.0  # ratios that it counts as
_MOST_ALIKE: Final = 0.98
# Places of the memory of neighbours.
_LAST, _PRODUCTS, _SQUARES, _PAIRS = 0, 1, 2, 3


@kernel("int64(float64)")
def force_class(force_n: float) -> int:
    """Class of a force: one for each factor of the square root of two from 20 N on, the last for all above."""
    if force_n <= 20.0:
        return 0
    return min(ml.CLASSES - 1, int(2.0 * math.log2(force_n / 20.0)))


@kernel("float64(float64, float64)")
def normal_of_student(t: float, degrees: float) -> float:
    """Standard normal value at the same probability as a Student value (Wallace 1959)."""
    size = (8.0 * degrees + 1.0) / (8.0 * degrees + 3.0) * math.sqrt(degrees * math.log1p(t * t / degrees))
    return size if t >= 0.0 else -size


@kernel("float64(float64[::1])")
def worth(serial: Float) -> float:
    """By how many ratios one independent one is outweighed, ``(1 + rho) / (1 - rho)``, at least 1.

    Args:
        serial: (4,) last residual, sum of products of neighbours, sum of squares, number of pairs.
    """
    n = serial[_PAIRS]
    rho = 0.0
    if n > 0.0 and serial[_SQUARES] > 0.0:
        rho = serial[_PRODUCTS] / serial[_SQUARES]
        rho += (1.0 + 3.0 * max(0.0, rho)) / n  # that of a short record is too low (Kendall 1954)
        rho += math.sqrt(max(0.0, 1.0 - rho * rho) / n)  # doubt counts against certainty
    rho = (n * rho + _SUPPOSED_WEIGHT * _SUPPOSED) / (n + _SUPPOSED_WEIGHT)
    rho = min(_MOST_ALIKE, max(0.0, rho))
    return float((1.0 + rho) / (1.0 - rho))


@kernel("void(float64[:, ::1], float64[::1], float64, float64, float64)")
def _add_residual(classes: Float, serial: Float, n: float, dx: float, dy: float) -> None:
    """Residual of a ratio from the regression of those before it, in units of its own spread; beside its neighbour."""
    sxx = sxy = 0.0
    for k in range(classes.shape[0]):
        sxx += classes[k, 3]
        sxy += classes[k, 4]
    slope = sxy / sxx if sxx > 0.0 and n >= FIRST else 0.0
    wide = 1.0 + 1.0 / n + (dx * dx / sxx if sxx > 0.0 and n >= FIRST else 0.0)
    residual = (dy - slope * dx) / math.sqrt(wide)
    if serial[_SQUARES] > 0.0:
        serial[_PRODUCTS] += residual * serial[_LAST]
        serial[_PAIRS] += 1.0
    serial[_SQUARES] += residual * residual
    serial[_LAST] = residual


@kernel("float64(float64[:, ::1], float64[::1], int64, float64, float64, float64)")
def add_ratio(classes: Float, serial: Float, which: int, cut_m: float, ratio: float, total: float) -> float:
    """Take one ratio.

    Args:
        classes: (CLASSES, 6) n, mean length of cut, mean ratio, Sxx, Sxy, Syy; changed.
        serial: (4,) see :func:`worth`; changed.
        which: Class.
        cut_m: Length of cut at the middle of its stretch, m.
        ratio: Measured by predicted force.
        total: Cumulative sum so far.

    Returns:
        The new cumulative sum.
    """
    c = classes[which]
    n = c[0]
    dx, dy = cut_m - c[1], ratio - c[2]
    if n > 0.0:
        _add_residual(classes, serial, n, dx, dy)
    if n >= FIRST:
        spread = max(math.sqrt(c[5] / (n - 1.0)), LEAST_SPREAD)
        u = normal_of_student(dy / spread * math.sqrt(n / (n + 1.0)), n - 1.0)
        total = max(0.0, total + min(LARGEST_U, u / math.sqrt(worth(serial))) - 0.5)
    c[0] = n + 1.0
    c[1] += dx / c[0]
    c[2] += dy / c[0]
    c[3] += dx * (cut_m - c[1])
    c[4] += dx * (ratio - c[2])
    c[5] += dy * (ratio - c[2])
    return total


@kernel("void(float64[:, ::1], float64[::1], float64, float64[::1])")
def trend(classes: Float, serial: Float, cut_m: float, out: Float) -> None:
    """Regression over all classes: ``b = sum Sxy / sum Sxx``.

    Args:
        classes: (CLASSES, 6).
        serial: (4,) see :func:`worth`.
        cut_m: Length of cut now.
        out: (4,) written: trend per metre, its standard deviation, rise since the first cut relative to the ratio
            there, degrees of freedom of the standard deviation; all 0 where the cut is too short to tell.
    """
    n = used = sxx = sxy = syy = mean = 0.0
    for k in range(classes.shape[0]):
        n += classes[k, 0]
        used += 1.0 if classes[k, 0] > 0.0 else 0.0
        mean += classes[k, 0] * classes[k, 2]
        sxx += classes[k, 3]
        sxy += classes[k, 4]
        syy += classes[k, 5]
    for k in range(4):
        out[k] = 0.0
    f = worth(serial)
    degrees = n / f - used - 1.0
    if degrees < 1.0 or sxx <= 0.0:
        return
    slope = sxy / sxx
    variance = max(max(0.0, syy - slope * sxy) / (f * degrees), LEAST_SPREAD * LEAST_SPREAD)
    middle = 0.0
    for k in range(classes.shape[0]):
        middle += classes[k, 0] * classes[k, 1]
    first = mean / n - slope * middle / n
    out[0], out[1] = slope, math.sqrt(f * variance / sxx)
    out[2] = slope * cut_m / first if first > 0.0 else 0.0
    out[3] = degrees
