"""A path as a curve of even stations: its places and directions, and where on it another curve begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.evaluate import path_matching

STATIONS: Final = 500
"""Stations along the diagonal of a curve, about."""
MOST: Final = 20_000
"""Most stations, about."""


@dataclass(frozen=True, eq=False)
class StationCurve:
    """Stations at one pitch along a path."""

    points: Float  # (m, 3) m
    directions: Float  # (m, 3) unit vectors of travel
    sample: Float  # (m,) place in the samples that it was made of, as index plus fraction
    pitch_m: float  # distance of neighbours

    def __len__(self) -> int:
        """Number of stations."""
        return len(self.points)

    @property
    def length_m(self) -> float:
        """From the first station to the last."""
        return self.pitch_m * (len(self.points) - 1)

    def at(self, length_m: Float) -> Float:
        """Places (..., 3) m at lengths (...) m from the start; beyond the ends, the ends."""
        where = np.asarray(length_m) / self.pitch_m
        index = np.arange(len(self.points), dtype=np.float64)
        out: Float = np.stack([np.interp(where, index, self.points[:, k]) for k in range(3)], axis=-1)
        return out

    def scaled(self, factor: float) -> StationCurve:
        """The same curve in another unit."""
        return StationCurve(self.points * factor, self.directions, self.sample, self.pitch_m * factor)

    def mirrored(self) -> StationCurve:
        """The same curve with its first axis turned over."""
        over = np.array([-1.0, 1.0, 1.0])
        return StationCurve(self.points * over, self.directions * over, self.sample, self.pitch_m)


def curve_of(p: Float) -> StationCurve:
    """Stations of a sampled path (n, 3) m: blind to speed, stops and small vibration."""
    size = float(np.linalg.norm(p.max(axis=0) - p.min(axis=0)))
    travelled = float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())
    pitch = max(size / STATIONS, travelled / MOST, 1e-12)
    points, sample, broken = path_matching.even_stations(np.ascontiguousarray(p), pitch, np.inf)
    directions = path_matching.travel_directions(points, broken)
    return StationCurve(points, directions, sample, pitch)


def offsets(path: StationCurve, log: StationCurve, least_share: float) -> Float:
    """Lengths along the log at which the path may begin, so that it covers at least a share of the path."""
    length = path.length_m
    first, last = -(1.0 - least_share) * length, log.length_m - least_share * length
    if last < first:
        return np.zeros(0)
    return np.linspace(first, last, int(np.clip((last - first) / (length / 250.0), 2, 1500)))


def matched_lengths(path: StationCurve, log: StationCurve, offset_m: Float, count: int) -> tuple[Float, Float]:
    """Lengths along the path (k, count) that the log covers for each offset (k,), evenly; and along the log."""
    begin = np.maximum(0.0, -offset_m)
    end = np.minimum(path.length_m, log.length_m - offset_m)
    on_path: Float = begin[:, None] + np.linspace(0.0, 1.0, count) * (end - begin)[:, None]
    return on_path, on_path + offset_m[:, None]


def begin_on(path: StationCurve, log: StationCurve, least_share: float) -> float:
    """Length along the log, in the frame of the path, at which the path begins, m."""
    steps = offsets(path, log, least_share)
    if len(steps) == 0:
        return 0.0
    on_path, on_log = matched_lengths(path, log, steps, 120)
    distance = np.linalg.norm(path.at(on_path) - log.at(on_log), axis=2)
    # the median bears a detour, the share covered decides between the whole and a part of it
    covered = (on_path[:, -1] - on_path[:, 0]) / path.length_m
    cost = np.median(distance, axis=1) + 0.02 * path.length_m * (1.0 - covered)
    return float(steps[int(np.argmin(cost))])


def within(samples: int, curve: StationCurve, first_m: float, last_m: float) -> Bool:
    """(samples,) the samples of a curve between two lengths along it."""
    place = np.interp([first_m, last_m], curve.pitch_m * np.arange(len(curve)), curve.sample)
    index = np.arange(samples)
    out: Bool = (index >= np.floor(place[0])) & (index <= np.ceil(place[1]))
    return out
