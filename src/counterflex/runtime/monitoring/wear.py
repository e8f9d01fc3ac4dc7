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

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.records import CLASSES, MONITOR_TYPES, NEIGHBOURS, RESULTS

FIRST: Final = 3
"""Ratios of a class before the next one is judged."""
LARGEST_U: Final = 4.0
"""A single ratio counts no more than this: one odd stretch is no trend."""
LEAST_SPREAD: Final = 0.002
"""Standard deviation of ratios, at least."""
_SUPPOSED: Final = 0.5  # correlation of neighbours as long as nothing is known
_SUPPOSED_WEIGHT: Final = 4.0  # ratios that it counts as
_MOST_ALIKE: Final = 0.98


@kernel("int64(float64)")
def force_class(force_n: float) -> int:
    """Class of a force: one for each factor of the square root of two from 20 N on, the last for all above."""
    if force_n <= 20.0:
        return 0
    return min(CLASSES - 1, int(2.0 * math.log2(force_n / 20.0)))


@kernel("float64(float64, float64)")
def normal_of_student(t: float, degrees: float) -> float:
    """Standard normal value at the same probability as a Student value (Wallace 1959)."""
    size = (8.0 * degrees + 1.0) / (8.0 * degrees + 3.0) * math.sqrt(degrees * math.log1p(t * t / degrees))
    return size if t >= 0.0 else -size


@kernel("float64(Neighbours)", Neighbours=NEIGHBOURS)
def worth(neighbours: Record) -> float:
    """By how many ratios one independent one is outweighed, ``(1 + rho) / (1 - rho)``, at least 1."""
    n = neighbours.pairs
    rho = 0.0
    if n > 0.0 and neighbours.squares > 0.0:
        rho = neighbours.products / neighbours.squares
        rho += (1.0 + 3.0 * max(0.0, rho)) / n  # that of a short record is too low (Kendall 1954)
        rho += math.sqrt(max(0.0, 1.0 - rho * rho) / n)  # doubt counts against certainty
    rho = (n * rho + _SUPPOSED_WEIGHT * _SUPPOSED) / (n + _SUPPOSED_WEIGHT)
    rho = min(_MOST_ALIKE, max(0.0, rho))
    return float((1.0 + rho) / (1.0 - rho))


@kernel("void(Wear, float64, float64, float64)", **MONITOR_TYPES)
def _add_residual(w: Record, n: float, dx: float, dy: float) -> None:
    """Residual of a ratio from the regression of those before it, in units of its own spread; beside its neighbour."""
    sxx = sxy = 0.0
    for k in range(CLASSES):
        sxx += w.classes[k].cut_cut
        sxy += w.classes[k].cut_ratio
    slope = sxy / sxx if sxx > 0.0 and n >= FIRST else 0.0
    wide = 1.0 + 1.0 / n + (dx * dx / sxx if sxx > 0.0 and n >= FIRST else 0.0)
    residual = (dy - slope * dx) / math.sqrt(wide)
    neighbours = w.neighbours
    if neighbours.squares > 0.0:
        neighbours.products += residual * neighbours.last
        neighbours.pairs += 1.0
    neighbours.squares += residual * residual
    neighbours.last = residual


@kernel("void(Wear, int64, float64, float64)", **MONITOR_TYPES)
def add_ratio(w: Record, which: int, cut_m: float, ratio: float) -> None:
    """Take one ratio.

    Args:
        w: WEAR; classes, neighbours and cumulative sum are changed.
        which: Class.
        cut_m: Length of cut at the middle of its stretch, m.
        ratio: Measured by predicted force.
    """
    c = w.classes[which]
    n = c.number
    dx, dy = cut_m - c.cut, ratio - c.ratio
    if n > 0.0:
        _add_residual(w, n, dx, dy)
    if n >= FIRST:
        spread = max(math.sqrt(c.ratio_ratio / (n - 1.0)), LEAST_SPREAD)
        u = normal_of_student(dy / spread * math.sqrt(n / (n + 1.0)), n - 1.0)
        w.cusum = max(0.0, w.cusum + min(LARGEST_U, u / math.sqrt(worth(w.neighbours))) - 0.5)
    c.number = n + 1.0
    c.cut += dx / c.number
    c.ratio += dy / c.number
    c.cut_cut += dx * (cut_m - c.cut)
    c.cut_ratio += dx * (ratio - c.ratio)
    c.ratio_ratio += dy * (ratio - c.ratio)


@kernel("void(Wear, float64, Results)", Results=RESULTS, **MONITOR_TYPES)
def trend(w: Record, cut_m: float, r: Record) -> None:
    """Regression over all classes: ``b = sum Sxy / sum Sxx``.

    Args:
        w: WEAR.
        cut_m: Length of cut now.
        r: RESULTS; written: trend per metre, its standard deviation, rise since the first cut relative to the ratio
            there, degrees of freedom of the standard deviation; all 0 where the cut is too short to tell.
    """
    n = used = sxx = sxy = syy = mean = 0.0
    for k in range(CLASSES):
        c = w.classes[k]
        n += c.number
        used += 1.0 if c.number > 0.0 else 0.0
        mean += c.number * c.ratio
        sxx += c.cut_cut
        sxy += c.cut_ratio
        syy += c.ratio_ratio
    r.trend = r.trend_sigma = r.rise = r.trend_degrees = 0.0
    f = worth(w.neighbours)
    degrees = n / f - used - 1.0
    if degrees < 1.0 or sxx <= 0.0:
        return
    slope = sxy / sxx
    variance = max(max(0.0, syy - slope * sxy) / (f * degrees), LEAST_SPREAD * LEAST_SPREAD)
    middle = 0.0
    for k in range(CLASSES):
        middle += w.classes[k].number * w.classes[k].cut
    first = mean / n - slope * middle / n
    r.trend, r.trend_sigma = slope, math.sqrt(f * variance / sxx)
    r.rise = slope * cut_m / first if first > 0.0 else 0.0
    r.trend_degrees = degrees


@kernel("void(Wear)", **MONITOR_TYPES)
def new_tool(w: Record) -> None:
    """Forget all: another tool."""
    w.cut = w.bin_product = w.bin_square = w.bin_length = w.cusum = 0.0
    for k in range(CLASSES):
        c = w.classes[k]
        c.number = c.cut = c.ratio = c.cut_cut = c.cut_ratio = c.ratio_ratio = 0.0
    n = w.neighbours
    n.last = n.products = n.squares = n.pairs = 0.0
