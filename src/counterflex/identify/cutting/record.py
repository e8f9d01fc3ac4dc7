"""Test cuts recorded over time: the zero taken out, settled stretches found, means with standard deviations."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError

AIR_ROWS = 5
"""Fewest rows in air from which a zero is taken."""
RISE = 0.2
"""Share of the plateau above which a force counts as contact, where the record does not say what is air."""
_STEEP = 0.6  # change of depth per travel that is a step and no ramp
_BATCHES = 8


@dataclass(frozen=True, eq=False)
class Zero:
    """What the sensor showed in air.

    Attributes:
        value: (n, k) zero at every row of the cut.
        sigma: (k,) its standard deviation.
        sides: How many sides of the cut it rests on: 0 (none, zero assumed), 1 or 2.
        drift: (k,) change from before to after the cut; 0 with fewer than two sides.
    """

    value: Float
    sigma: Float
    sides: int
    drift: Float


def contact(force: Float, depth: Float) -> Bool:
    """Rows of one cut in which the tool may touch the work.

    Args:
        force: (n, 3) N as shown.
        depth: (n,) m commanded depth; where some rows have 0, these are the air. Otherwise the force decides: more
            than :data:`RISE` of the way from the first rows to the plateau.

    Returns:
        (n,) mask.
    """
    if np.any(depth <= 0.0):
        return np.array(depth > 0.0, dtype=np.bool_)
    n = len(force)
    size = np.linalg.norm(force - np.median(force[: max(AIR_ROWS, n // 20)], axis=0), axis=1)
    return np.array(size > RISE * np.quantile(size, 0.95), dtype=np.bool_)


def zero(values: Float, time_s: Float, touching: Bool) -> Zero:
    """The sensor's zero through a cut, from what it showed before the first and after the last contact.

    Medians on both sides, joined by a straight line in time: a swing after a rapid move does not count.

    Args:
        values: (n, k) as shown.
        time_s: (n,) s.
        touching: (n,) from :func:`contact`.
    """
    n, k = values.shape
    rows = np.flatnonzero(touching)
    ends = (0, n) if len(rows) == 0 else (int(rows[0]), int(rows[-1]) + 1)
    sides = [side for side in (slice(0, ends[0]), slice(ends[1], n)) if side.stop - side.start >= AIR_ROWS]
    if not sides:
        return Zero(np.zeros((n, k)), np.zeros(k), 0, np.zeros(k))
    middle = [np.median(values[s], axis=0) for s in sides]
    spread = [1.4826 * np.median(np.abs(values[s] - m), axis=0) for s, m in zip(sides, middle, strict=True)]
    error = [1.2533 * d / np.sqrt(s.stop - s.start) for d, s in zip(spread, sides, strict=True)]
    if len(sides) == 1:
        return Zero(np.tile(middle[0], (n, 1)), error[0], 1, np.zeros(k))
    begin, end = (float(np.mean(time_s[s])) for s in sides)
    share = np.clip((time_s - begin) / (end - begin), 0.0, 1.0)[:, None]
    value = middle[0] + share * (middle[1] - middle[0])
    return Zero(value, 0.5 * np.hypot(error[0], error[1]), 2, middle[1] - middle[0])


def settled(touching: Bool, travel_m: Float, depth: Float, conditions: Float, trim_m: Float) -> list[Int]:
    """Stretches of one cut over which conditions are steady, far enough from entries, exits and steps.

    Args:
        touching: (n,) from :func:`contact`.
        travel_m: (n,) distance run, rising.
        depth: (n,) m; a change steeper than a ramp is a step.
        conditions: (n, k) feed, speed, width, direction: any change is a step.
        trim_m: (n,) distance that is left out beside every end and step.

    Returns:
        Rows of each stretch.
    """
    n = len(touching)
    travel = np.diff(travel_m)
    scale = np.maximum(np.max(np.abs(conditions), axis=0), 1e-12)
    step = np.any(np.abs(np.diff(conditions, axis=0)) > 1e-3 * scale, axis=1)
    step |= np.abs(np.diff(depth)) > _STEEP * travel + 1e-6
    step |= np.diff(touching.astype(np.int8)) != 0
    breaks = [0, *(np.flatnonzero(step) + 1).tolist(), n]
    out: list[Int] = []
    for first, last in itertools.pairwise(breaks):
        if not touching[first]:
            continue
        rows = np.arange(first, last, dtype=np.int64)
        inside = (travel_m[rows] >= travel_m[first] + trim_m[rows]) & (
            travel_m[rows] <= travel_m[last - 1] - trim_m[rows]
        )
        if np.any(inside):
            out.append(rows[inside])
    return out


def split_ramp(rows: Int, depth: Float, most_m: float) -> list[Int]:
    """Parts of a stretch over which the depth changes by at most ``most_m``.

    Raises:
        InputError: ``most_m`` is not positive.
    """
    if not most_m > 0.0:
        raise InputError("change of depth within a piece is out of range", value=most_m, limit="> 0 m")
    change = float(np.ptp(depth[rows]))
    count = max(1, int(np.ceil(change / most_m - 1e-9))) if change > 1e-6 else 1
    return [part for part in np.array_split(rows, count) if len(part)]


def mean_with_sigma(values: Float, stated: Float | None) -> tuple[Float, Float]:
    """Mean of a settled stretch and its standard deviation, correlated samples allowed.

    The standard deviation is that of the means of :data:`8 <_BATCHES>` batches around a straight line, at least what
    the stated noise gives.

    Args:
        values: (n, k).
        stated: (n, k) standard deviation of each sample, or None.

    Returns:
        Mean (k,) and its standard deviation (k,).
    """
    n = len(values)
    mean = values.mean(axis=0)
    floor = np.zeros(values.shape[1]) if stated is None else np.sqrt(np.mean(stated**2, axis=0) / n)
    count = min(_BATCHES, n // 3)
    if count < 4:
        spread = values.std(axis=0, ddof=1) / np.sqrt(n) if n > 1 else floor
        return mean, np.maximum(spread, floor)
    batches = np.array([part.mean(axis=0) for part in np.array_split(values, count)])
    u = np.linspace(-1.0, 1.0, count)[:, None]
    rest = batches - batches.mean(axis=0) - u * (u * batches).sum(axis=0) / float(np.sum(u**2))
    spread = np.sqrt(np.sum(rest**2, axis=0) / (count - 2) / count)
    return mean, np.maximum(spread, floor)


def slope(travel_m: Float, depth_m: Float) -> float:
    """Change of depth per travel, least squares; 0 where the tool does not move.

    Args:
        travel_m: (n,) length that the tool has moved.
        depth_m: (n,) depth there.
    """
    u = travel_m - travel_m.mean()
    square = float(u @ u)
    return float(u @ depth_m) / square if square > 0.0 else 0.0
