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
_TEETH = 8
"""Rows in a revolution from which its ripple shows whether the tool cuts."""
_FEWEST_TURNS = 4
_QUIET = 0.1
"""Ripple in a revolution, as a share of that of the cut, below which a row is in air. Air shows noise, a cut at a third
of the feed a third of the ripple."""
_LEVEL_DISTANCE = 2.6
"""Distance of two levels of force in standard deviations about each. Entry and exit over half of the record give 3.3, a
ramp over all of it 2.4, one level with noise 2."""
_STEEP = 0.6  # change of depth per travel that is a step and no ramp
_BATCHES = 8


@dataclass(frozen=True, eq=False)
class Zero:
    """Reading of the sensor in air."""

    value: Float  # (n, k) zero at every row of the cut
    sigma: Float  # (k,) its standard deviation
    sides: int  # how many sides of the cut it rests on: 0 (none, zero assumed), 1 or 2
    drift: Float  # (k,) change from before to after the cut; 0 with fewer than two sides


def contact(force: Float, depth: Float, per_turn: int = 1, *, steady: bool = True, air: bool = True) -> Bool:
    """Rows of one cut in which the tool may touch the work.

    Where no row says what is air, the force decides: more than :data:`RISE` of the way from the first rows to the
    plateau, by means over a revolution. A record of the middle of a cut has no air and no way to go: its force would be
    compared with itself. It is recognised by its ripple, which is as large everywhere, or, where the record does not
    show single teeth, by a force without two levels.

    Args:
        force: (n, 3) N as shown.
        depth: (n,) m commanded depth; where some rows have 0, these are the air.
        per_turn: Rows in a revolution of the spindle.
        steady: Feed, speed and width stay the same: one level of the force is then one state.
        air: False states that all rows are in the cut.

    Returns:
        (n,) mask.
    """
    if np.any(depth <= 0.0):
        return np.array(depth > 0.0, dtype=np.bool_)
    n = len(force)
    everywhere = np.ones(n, dtype=np.bool_)
    if not air:
        return everywhere
    window = max(1, min(per_turn, n // _FEWEST_TURNS))
    mean = _moving_mean(force, window)
    quiet = False
    if window >= _TEETH:
        ripple = np.sqrt(np.sum(np.maximum(_moving_mean(force**2, window) - mean**2, 0.0), axis=1))
        quiet = bool(np.any(ripple < _QUIET * float(np.quantile(ripple, 0.95))))
        # Air would show as rows without ripple. There are none: steps of the force are then steps of the feed.
        if not quiet and not steady:
            return everywhere  # levels differ by the feed, teeth are seen in all of them
    first = mean[: max(AIR_ROWS, n // 20)]
    size = np.linalg.norm(mean - np.median(first, axis=0), axis=1)
    touching = np.array(size > RISE * np.quantile(size, 0.95), dtype=np.bool_)
    if steady and not quiet and not _two_levels(size, touching):
        return everywhere
    return touching


def _two_levels(size: Float, upper: Bool) -> bool:
    """Return whether sizes fall into two levels, far apart in terms of the scatter about each."""
    low, high = size[~upper], size[upper]
    if len(low) == 0 or len(high) == 0:
        return False
    within = np.sqrt((np.sum((low - low.mean()) ** 2) + np.sum((high - high.mean()) ** 2)) / len(size))
    return bool(high.mean() - low.mean() > _LEVEL_DISTANCE * within)


def _moving_mean(values: Float, window: int) -> Float:
    """Mean over ``window`` rows about each row, shorter at the ends."""
    if window <= 1:
        return values
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    row = np.arange(len(values))
    begin, end = np.maximum(row - window // 2, 0), np.minimum(row - window // 2 + window, len(values))
    out: Float = (total[end] - total[begin]) / (end - begin)[:, None]
    return out


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
    # Not extrapolated: beyond both sides the median of that side is what was measured.
    share = np.clip((time_s - begin) / (end - begin), 0.0, 1.0)[:, None]
    value = middle[0] + share * (middle[1] - middle[0])
    return Zero(value, 0.5 * np.hypot(error[0], error[1]), 2, middle[1] - middle[0])


def settled(
    touching: Bool, travel_m: Float, depth: Float, conditions: Float, trim_m: Float, gap: Bool | None = None
) -> list[Int]:
    """Stretches of one cut over which conditions are steady, far enough from entries, exits and steps.

    Args:
        touching: (n,) from :func:`contact`.
        travel_m: (n,) distance run, rising.
        depth: (n,) m; a change steeper than a ramp is a step.
        conditions: (n, k) feed, speed, width, direction: any change is a step.
        trim_m: (n,) distance that is left out beside every end and step.
        gap: (n,) rows before which the record has a gap. Given for a record without any air: its stretches begin and
            end in the cut, so nothing is left out at gaps and at its ends.
    """
    n = len(touching)
    travel = np.diff(travel_m)
    scale = np.maximum(np.max(np.abs(conditions), axis=0), 1e-12)
    step = np.any(np.abs(np.diff(conditions, axis=0)) > 1e-3 * scale, axis=1)
    step |= np.abs(np.diff(depth)) > _STEEP * travel + 1e-6
    step |= np.diff(touching.astype(np.int8)) != 0
    free = {0, n} if gap is not None else set()
    if gap is not None:
        step |= gap[1:]
        free |= set(np.flatnonzero(gap).tolist())
    breaks = [0, *(np.flatnonzero(step) + 1).tolist(), n]
    out: list[Int] = []
    for first, last in itertools.pairwise(breaks):
        if not touching[first]:
            continue
        rows = np.arange(first, last, dtype=np.int64)
        begin, end = (0.0 if edge in free else trim_m[rows] for edge in (first, last))
        inside = (travel_m[rows] >= travel_m[first] + begin) & (travel_m[rows] <= travel_m[last - 1] - end)
        if np.any(inside):
            out.append(rows[inside])
    return out


def split_ramp(rows: Int, depth: Float, most_m: float) -> list[Int]:
    """Parts of a stretch over which the depth changes by at most ``most_m``.

    Raises InputError: ``most_m`` is not positive.
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
    # Two degrees of freedom go to the line: a slow drift within a stretch is no noise of its mean.
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
