"""Tracking error of a tool in the air: across the path and in all, on straights, at corners, on arcs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM


@dataclass(frozen=True)
class Spread:
    """Figures of an error over the samples of a stretch."""

    rms: float  # root of the mean square
    p997: float  # what 99.7 % of the samples stay at or below; a value that was met
    largest: float
    count: int  # samples

    def as_um(self) -> dict[str, float]:
        """Figures of a length, in um."""
        return {
            "rms_um": round(self.rms / UM, 2),
            "p997_um": round(self.p997 / UM, 2),
            "max_um": round(self.largest / UM, 2),
        }

    def as_mdeg(self) -> dict[str, float]:
        """Figures of an angle, in thousandths of a degree."""
        unit = 1e-3 * DEG
        return {
            "rms_mdeg": round(self.rms / unit, 2),
            "p997_mdeg": round(self.p997 / unit, 2),
            "max_mdeg": round(self.largest / unit, 2),
        }


def spread(size: Float, where: Bool) -> Spread:
    """Figures of the sizes ``size`` (n,) over the samples ``where`` (n,).

    Raises:
        InputError: No sample is chosen.
    """
    chosen = np.sort(np.abs(np.asarray(size, dtype=np.float64)[np.asarray(where, dtype=bool)]))
    if len(chosen) == 0:
        raise InputError("no sample lies in this stretch")
    at = max(0, int(np.ceil(0.997 * len(chosen))) - 1)
    return Spread(float(np.sqrt(np.mean(chosen**2))), float(chosen[at]), float(chosen[-1]), len(chosen))


def nearest_on_polyline(p: Float, corners: Float, near: Int) -> Float:
    """Nearest point of a polyline, close to where each point belongs: (n, 3) m.

    Args:
        p: (n, 3) m, actual points.
        corners: (k, 3) m, the polyline, k >= 2.
        near: (n,) segment 0..k-2 that each point is on by the program; it, the one before and the one after count.

    Raises:
        InputError: Wrong shapes, or fewer than two corners.
    """
    points, line = as_float("p", p, (None, 3)), as_float("corners", corners, (None, 3))
    segments = len(line) - 1
    if segments < 1:
        raise InputError("a polyline needs two points", value=len(line))
    best, out = np.full(len(points), np.inf), points.copy()
    for step in (-1, 0, 1):
        i = np.clip(np.asarray(near, dtype=np.int64) + step, 0, segments - 1)
        a, d = line[i], line[i + 1] - line[i]
        u = np.clip(np.sum((points - a) * d, axis=1) / np.maximum(np.sum(d * d, axis=1), 1e-18), 0.0, 1.0)
        foot = a + u[:, None] * d
        away = np.linalg.norm(points - foot, axis=1)
        out[away < best] = foot[away < best]
        best = np.minimum(best, away)
    return out


def nearest_on_circle(p: Float, radius_m: float) -> Float:
    """Nearest points (n, 3) m of a circle about the origin in the plane z = 0, of points (n, 3) m off its axis."""
    points, radius = as_float("p", p, (None, 3)), as_positive("radius_m", radius_m)
    out = np.zeros_like(points)
    out[:, :2] = radius * points[:, :2] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    return out


@dataclass(frozen=True)
class Tracked:
    """A path as it was run, one row per cycle; part frame, m and rad."""

    time_s: Float
    p_command: Float  # (n, 3) where the tool tip should have been at that time
    p_actual: Float  # (n, 3) where it was
    tilt: Float  # (n, 3) rotation vector from the commanded to the true tool frame
    q: Float  # (n, 6) rad, angles of the axes

    @property
    def total(self) -> Float:
        """(n,) m, distance from where the tip should have been, lag along the path included."""
        out: Float = np.linalg.norm(self.p_actual - self.p_command, axis=1)
        return out

    @property
    def turned(self) -> Float:
        """(n,) rad, size of the orientation error."""
        out: Float = np.linalg.norm(self.tilt, axis=1)
        return out


def segment_of(p_command: Float, corners: Float) -> Int:
    """Segment of a polyline on which each commanded point lies, never going back: (n,) 0..k-2."""
    line = as_float("corners", corners, (None, 3))
    out = np.zeros(len(p_command), dtype=np.int64)
    segment, last = 0, len(line) - 2
    for n, p in enumerate(p_command):
        while segment < last:
            d = line[segment + 1] - line[segment]
            if float((p - line[segment]) @ d) < float(d @ d) * (1.0 - 1e-9):
                break
            segment += 1
        out[n] = segment
    return out


def corner_zones(tracked: Tracked, corners: Float, reach_m: float) -> tuple[Bool, Bool]:
    """Samples of a polyline's straights, and those around its inner corners.

    Args:
        corners: (k, 3) m.
        reach_m: Around a corner, and at both ends of the path, this much of the path is no straight.

    Returns:
        Straights (n,) and corners (n,).
    """
    line = as_float("corners", corners, (None, 3))
    near = segment_of(tracked.p_command, line)
    before = np.linalg.norm(tracked.p_command - line[near], axis=1)
    after = np.linalg.norm(tracked.p_command - line[near + 1], axis=1)
    moving = _moving(tracked)
    straight = moving & (before > reach_m) & (after > reach_m)
    inner = ((before <= reach_m) & (near > 0)) | ((after <= reach_m) & (near < len(line) - 2))
    return straight, moving & inner


def turn_zone(tracked: Tracked, run_in_rad: float) -> Bool:
    """Samples (n,) of one whole turn of a circle about the origin in either sense, after a run-in."""
    angle = np.unwrap(np.arctan2(tracked.p_command[:, 1], tracked.p_command[:, 0]))
    turned = np.abs(angle - angle[0])
    out: Bool = (turned >= run_in_rad) & (turned < run_in_rad + 2.0 * np.pi)
    return out


def reversals(q: Float, least_rad: float = 100e-6) -> list[tuple[int, int]]:
    """Rows where axes turn round: rows and axes (0..5), in the order of the axes.

    Args:
        q: (n, k) rad.
        least_rad: An axis must have moved this much before it turns, and as much after: less is noise. The row is that
            of the turn itself.
    """
    results = []
    for axis, angles in enumerate(as_float("q", q, (None, None)).T):
        extreme, at, direction = angles[0], 0, 0.0
        for n, angle in enumerate(angles):
            if direction == 0.0:
                direction = float(np.sign(angle - extreme)) if abs(angle - extreme) > least_rad else 0.0
                if direction != 0.0:
                    extreme, at = angle, n
                continue
            if (angle - extreme) * direction > 0.0:
                extreme, at = angle, n
            elif (extreme - angle) * direction > least_rad:
                results.append((at, axis))
                extreme, at, direction = angle, n, -direction
    return results


def reversal_zone(tracked: Tracked, where: Bool, after_s: float, least_rad: float = 100e-6) -> Bool:
    """Samples (n,) of ``where`` within a time after an axis turned round.

    Args:
        where: Samples that count.
        after_s: Time after the turn of an axis that is counted, and half as much before it.
        least_rad: See :func:`reversals`.
    """
    out = np.zeros(len(tracked.time_s), dtype=bool)
    for row, _ in reversals(tracked.q, least_rad):
        at = tracked.time_s[row]
        out |= (tracked.time_s >= at - 0.5 * after_s) & (tracked.time_s < at + after_s)
    return out & where


def _moving(tracked: Tracked) -> Bool:
    step = np.linalg.norm(np.diff(tracked.p_command, axis=0, prepend=tracked.p_command[:1]), axis=1)
    begun = np.maximum.accumulate(step > 0.0)
    ended = np.maximum.accumulate((step > 0.0)[::-1])[::-1]
    out: Bool = begun & ended
    return out
