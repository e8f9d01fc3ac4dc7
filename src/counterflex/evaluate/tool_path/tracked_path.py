"""The logged path against the program's: deviation at every station, smoothed, with its uncertainty."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.path_deviation import (
    LOST_M,
    SPACING_M,
    PathDeviation,
    contact_runs,
    entry_exit,
    path_deviation,
)
from counterflex.evaluate.tool_path.curve import begin_on, curve_of, within
from counterflex.evaluate.tool_path.pose_search import LEAST_SHARE
from counterflex.evaluate.tool_path.readings import ToolReadings
from counterflex.path.toolpath import FEED, ToolPath

# Deviations along a path smoothed as the path itself says: much where it is quiet, little where the tool swings.
# In windows of :data:`WINDOW_M` the deviation is a straight line and a Gaussian process over the length s of the path,
#
# y = a + b s + f(s) + noise,   cov(f(s), f(s')) = A^2 (1 + r + r^2 / 3) exp(-r),   r = sqrt(5) |s - s'| / l
#
# (Matern 5/2). Nothing is known of a and b. Size A and length l are not chosen but weighed by their likelihood in the
# window, A = 0 among them. Windows lie an eighth of their length apart; at a station the one that knows it best counts
# most (by the square of its variance), so that a quiet stretch beside a swing is smoothed as one. Never across a corner
# or a hole.
#
# Source: Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", 2.7 (unknown line), 4.2.1 (Matern),
# 5.2 (likelihood).

WINDOW_M: Final = 8.0 * MM
"""The deviation has one size and one length in a window so long."""
NOISELESS_M: Final = 1.0 * UM
"""Readings with less noise stay as they are."""
CORNER: Final = np.cos(np.radians(15.0))
"""Cosine of the turn between two stations beyond which a corner lies between them."""
_LEAST: Final = 6  # Shorter runs stay as they are
_HOP: Final = 8
_END: Final = 0.05  # Share that the ends of a window have of its middle
_MOST: Final = 400  # Stations in a window
_LENGTHS: Final = np.geomspace(0.8, 8.0, 6) * MM
_SIZES: Final = np.concatenate([[0.0], np.geomspace(0.25, 512.0, 12)])  # Standard deviation of f by that of one reading


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
    """Mean and variance at the stations of windows (m, n), each with its own noise (m,), over all sizes and lengths."""
    # With V = K + noise^2 I and Q orthogonal to every straight line, the best estimate is `y - noise^2 Q (Q' V Q)^-1 Q'
    # y` and its covariance `noise^2 (I - noise^2 Q (Q' V Q)^-1 Q')`; the likelihood is that of `Q' y`.
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


_BEYOND_M: Final = 0.3 * MM  # A station further than this before the start or behind the end is not of the program
_SEEN_M: Final = 2.0 * MM  # A place of the path with no station nearer along it was not measured


@dataclass(frozen=True, eq=False)
class TrackedPath:
    """A measured path of the tool on the program's."""

    # at stations of the measured path, smoothed; `cutting` is all feed motion where it is not known where the tool cut,
    # and there are no entries and exits then
    deviation: PathDeviation
    row: Int  # (k,) row of the program's path that ends the stretch on which each station lies
    # (k,) standard deviation of the deviation across the path by the noise of the readings, the larger of both
    # components, m
    sigma_m: Float
    noise_m: float  # standard deviation of one reading along one axis, m
    window_m: float  # largest length over which deviations were smoothed, 0 where they were not
    covered: float  # share of the program's feed motion that was measured
    left_out: float  # share of the stations that lie further than 5 mm off the program's path
    hidden: Float  # (m, 3) m, places of the program's path that were not measured
    cut_known: bool  # whether it is known where the tool cut
    # what `along_m` counts from: `command` (commanded positions of the log), `program` (the program's own clock, its
    # offset in each stretch of feed motion taken away) or empty: it is not known
    clock: str

    @property
    def p_part(self) -> Float:
        """(k, 3) m, the tool tip, smoothed."""
        return self.deviation.p_part_actual


def of_program(path: ToolPath, readings: ToolReadings, *, least_share: float = LEAST_SHARE) -> ToolReadings:
    """The readings from the start of a program to its end, both in the part frame; the rest left out."""
    program, log = curve_of(path.p_part_tcp), curve_of(readings.p)
    begin = begin_on(program, log, least_share)
    slack = 0.05 * program.length_m
    rows = within(len(readings), log, begin - 1.0 * MM, begin + program.length_m + slack)
    return readings if np.count_nonzero(rows) < 4 else readings.only(rows)


def tracked_path(
    path: ToolPath, readings: ToolReadings, radius_m: float, engagement: Float | None, where: str
) -> TrackedPath:
    """Match readings in the part frame to the program's path, and smooth the deviations.

    Args:
        readings: From its start to its end (:func:`of_program`), part frame.
        radius_m: Of the cutter: shortest length of an entry.
        engagement: (n,) of the path's rows, how much is cut on the way to each; None where it is not known whether
            the tool cut.

    Raises:
        InputError: Hardly a reading lies on the path.
    """
    noise = readings.noise_m()
    spacing = max(SPACING_M, 4.0 * noise)
    raw = path_deviation(
        path,
        readings.clock_s - readings.clock_s[0],
        readings.p,
        np.ones(len(readings)),
        radius_m,
        command_part_tcp=readings.command_part,
        spacing_m=spacing,
    )
    S = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    step = raw.p_part_actual - raw.p_part_nominal
    at_end = (raw.length_m <= 0.0) | (raw.length_m >= S[-1] * (1.0 - 1e-12))
    beyond = (
        at_end
        & (np.linalg.norm(step, axis=1) > _BEYOND_M)
        & (np.linalg.norm(raw.across, axis=1) < 0.99 * np.linalg.norm(step, axis=1))
    )
    lost = np.linalg.norm(step, axis=1) > LOST_M
    kept = ~lost & ~beyond
    if np.count_nonzero(kept) < 20:
        raise InputError(
            "hardly a reading lies on the program's path",
            where=where,
            value=f"{np.count_nonzero(kept)} of {len(kept)} places within {LOST_M / MM:g} mm",
        )
    raw = _only(raw, kept)
    row = np.clip(np.searchsorted(S, raw.length_m, side="left"), 1, len(S) - 1)
    kind = np.asarray(path.kind)[row]
    place = np.interp(raw.time_s, readings.clock_s - readings.clock_s[0], np.arange(len(readings)))
    weight = np.clip(np.gradient(place), 1e-3, 1.0)
    runs = pieces(raw.feed_direction, raw.broken, kind)
    along = raw.along_m if readings.command_part is not None else _ahead(path, raw, S, row)
    parts = (raw.across_left_m, raw.across_axis_m, along)
    smooth = [smoothed(values, runs, weight, noise, spacing) for values in parts]
    even = np.column_stack([values for values, _ in smooth])
    sigma = np.maximum(smooth[0][1], smooth[1][1])
    deviation, clock = _with(raw, even, readings, kind == FEED)
    deviation = _contact(deviation, kind == FEED, None if engagement is None else engagement[row], radius_m)
    hidden, covered = _hidden(path, S, raw.length_m)
    return TrackedPath(
        deviation,
        row,
        sigma,
        noise,
        WINDOW_M if noise > NOISELESS_M else 0.0,
        covered,
        float(np.mean(lost)),
        hidden,
        engagement is not None,
        clock,
    )


def _only(deviation: PathDeviation, kept: Bool) -> PathDeviation:
    """Some of the stations; behind those left out the path is broken."""
    values = {f.name: getattr(deviation, f.name) for f in fields(deviation) if f.name != "spacing_m"}
    rows = np.flatnonzero(kept)
    out = replace(deviation, **{name: value[rows] for name, value in values.items()})
    gap = np.concatenate([[True], np.diff(rows) > 1])
    return replace(out, broken=out.broken | gap)


def _with(raw: PathDeviation, even: Float, readings: ToolReadings, feed: Bool) -> tuple[PathDeviation, str]:
    """The deviation with its smoothed components across the feed, and the clock that the one along it counts from."""
    axis = np.cross(raw.feed_direction, raw.left)
    across = even[:, :1] * raw.left + even[:, 1:2] * axis
    remains = np.sum((raw.p_part_actual - raw.p_part_nominal) * raw.feed_direction, axis=1)
    actual = raw.p_part_nominal + across + remains[:, None] * raw.feed_direction
    along, clock = even[:, 2], "command"
    if readings.command_part is None:
        along, clock = even[:, 2], "program"
        if readings.time_s is None or float(np.percentile(np.abs(along[feed]), 95.0)) > LOST_M:
            along, clock = np.zeros(len(along)), ""
    return (
        replace(
            raw, p_part_actual=actual, across=across, across_left_m=even[:, 0], across_axis_m=even[:, 1], along_m=along
        ),
        clock,
    )


def _ahead(path: ToolPath, raw: PathDeviation, S: Float, row: Int) -> Float:
    """(k,) m, progress ahead of the program's clock, less the difference of the clocks by stretch of feed motion."""
    # The time by the program of the place, less the time of the log, times the programmed feed.
    feed = np.asarray(path.kind)[row] == FEED
    ahead = np.interp(raw.length_m, S, path.time_s) - raw.time_s
    edges = np.flatnonzero(raw.broken[1:] | (feed[1:] != feed[:-1])) + 1
    out = np.zeros(len(feed))
    for first, end in itertools.pairwise([0, *edges.tolist(), len(feed)]):
        out[first:end] = ahead[first:end] - np.median(ahead[first:end])
    return out * path.feed_m_s[row]


def _contact(deviation: PathDeviation, feed: Bool, engagement: Float | None, radius_m: float) -> PathDeviation:
    """The deviation with where the tool cut: all feed motion where it is not known."""
    none = np.zeros(len(feed), np.bool_)
    if engagement is None:
        return replace(deviation, engagement=feed.astype(np.float64), cutting=feed, entry=none, exit=none, air=none)
    cutting: Bool = feed & (engagement > 0.0)
    runs = contact_runs(cutting, deviation.broken, deviation.spacing_m)
    entry, leave = entry_exit(runs, engagement, deviation.spacing_m, radius_m)
    return replace(
        deviation,
        engagement=engagement,
        cutting=cutting,
        entry=entry & cutting,
        exit=leave & cutting,
        air=feed & ~cutting,
    )


def _hidden(path: ToolPath, S: Float, measured_m: Float) -> tuple[Float, float]:
    """Places of the path's feed motion, 0.5 mm apart, that no station is near; and the share of the others."""
    s = np.arange(0.0, float(S[-1]), 0.5 * MM)
    row = np.clip(np.searchsorted(S, s, side="left"), 1, len(S) - 1)
    s = s[np.asarray(path.kind)[row] == FEED]
    if len(s) == 0:
        return np.zeros((0, 3)), 0.0
    away = scipy.spatial.cKDTree(measured_m[:, None]).query(s[:, None])[0]
    unseen = away > _SEEN_M
    points = np.column_stack([np.interp(s[unseen], S, path.p_part_tcp[:, k]) for k in range(3)])
    return points, 1.0 - float(np.mean(unseen))
