"""Force on the tool over one revolution, tooth by tooth: helix, runout, and the edge's true path.

The edges are cut into axial slices. At the rotation angle theta the slice at height z of tooth j is at the immersion
angle ``phi = theta - j psi - z tan(beta) / R``; it cuts where the booked engagement reaches its height and where
the thickness left by the earlier teeth is positive. The slices are as high as the helix takes to lag by one step of the
rotation, so that every slice sees the same angles and all edges of the engagement bins are hit exactly: the mean over
the revolution then meets the closed form of :mod:`counterflex.cutting.mean_force` to 1e-3 N.

Directions as in :mod:`counterflex.cutting.mean_force`. Valid for level feed (no descent).

Sources: Altintas and Lee 1998; Berger2013 section 5; Kline and DeVor 1983 (runout).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int, as_float, as_positive
from counterflex.core.errors import InputError, ModelError
from counterflex.core.jit import kernel
from counterflex.cutting.arc_integrals import level_table
from counterflex.cutting.chip import edge_radii, trochoid_thickness
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter

STEPS = 1536
"""Least number of steps in a revolution."""
MAX_SLICES = 100_000


@dataclass(frozen=True)
class ToothForces:
    """Wrench on the tool over one revolution."""

    angle_rad: Float  # (n,) rotation of the first tooth's tip from the left normal, clockwise from above, in rad
    # (n, 6) force in N and moment in N m about the tool tip in the feed frame (x along the feed, y to its left, z up
    # along the tool axis)
    wrench_tcp: Float
    chip_max_m: float  # largest chip thickness met, in m
    # share of the cutting work done at a thickness below `h_min_m` or above `h_max_m` of the force law
    extrapolated_share: float

    @property
    def mean(self) -> Float:
        """(6,) mean wrench over the revolution."""
        result: Float = self.wrench_tcp.mean(axis=0)
        return result

    @property
    def peak_n(self) -> float:
        """Largest magnitude of the force in N."""
        return float(np.linalg.norm(self.wrench_tcp[:, :3], axis=1).max())


@kernel(
    "void(float64[:,:,::1], int64[:,::1], float64[:,::1], float64[:,::1], float64[:,::1], float64[:,::1], int64,"
    " float64, float64, float64[:,::1], float64[::1])",
    entry=True,
)
def _revolution(
    chips: Float,
    place: Int,
    heights: Float,
    depth: Float,
    levels: Float,
    terms: Float,
    teeth: int,
    h_min: float,
    h_max: float,
    out: Float,
    book: Float,
) -> None:
    """Add every slice of every tooth to ``out``; ``book`` takes work, work out of range and the largest chip."""
    steps = out.shape[0]
    half = steps // 2
    turn = 2.0 * math.pi / steps
    for s in range(place.shape[0]):
        level, lag, row = place[s, 0], place[s, 1], place[s, 2]
        low, high = heights[s, 0], heights[s, 1]
        sin_k, cos_k, radius, base = levels[level, 0], levels[level, 1], levels[level, 3], levels[level, 4]
        for tooth in range(teeth):
            for k in range(half):
                length = min(base + depth[level, k * depth.shape[1] // half], high) - low
                gap = chips[row, tooth % chips.shape[1], k]
                if length <= 0.0 or gap <= 0.0:
                    continue
                height = low + 0.5 * length
                edge = length / sin_k
                fc = fr = fa = 0.0
                for t in range(terms.shape[0]):
                    power = (gap * levels[level, 10 + t]) ** terms[t, 0] * edge
                    fc += terms[t, 1] * power
                    fr += terms[t, 2] * power
                    fa += terms[t, 3] * power
                phi = (k + 0.5) * turn
                sine, cosine = math.sin(phi), math.cos(phi)
                normal = fr * sin_k + fa * cos_k
                fx = -fc * cosine - normal * sine
                fy = fc * sine - normal * cosine
                fz = fr * cos_k - fa * sin_k
                at = (k + tooth * steps // teeth + lag) % steps
                out[at, 0] += fx
                out[at, 1] += fy
                out[at, 2] += fz
                out[at, 3] += radius * cosine * fz - height * fy
                out[at, 4] += height * fx - radius * sine * fz
                out[at, 5] += radius * fc
                book[0] += fc * radius
                if gap * sin_k < h_min or gap * sin_k > h_max:
                    book[1] += fc * radius
                book[2] = max(book[2], gap * sin_k)


def _slices(cutter: Cutter, levels: Float, depth: Float, turn: float) -> tuple[Int, Float, int]:
    """Cut the engaged height into slices; returns (level, lag, chip row), (low, high) and the number of lags."""
    tangent = math.tan(cutter.helix_rad)
    pitch = 0.5 * cutter.diameter_m * turn / abs(tangent) if tangent else math.inf
    sign = -1 if tangent < 0.0 else 1
    place, heights = [], []
    for index, (level, row) in enumerate(zip(levels, depth, strict=True)):
        z, top = float(level[4]), min(float(level[4] + row.max()), float(level[5]))
        if math.isfinite(pitch) and (top - z) / pitch > MAX_SLICES:
            raise ModelError("helix needs too many slices", value=int((top - z) / pitch), limit=MAX_SLICES)
        while z < top * (1.0 - 1e-12):
            # z is the upper end of the slice before, a whole number of pitches: rounded down, the loop would stand
            # still.
            lag = int(z / pitch * (1.0 + 1e-12)) if math.isfinite(pitch) else 0
            end = min(top, (lag + 1) * pitch)
            place.append((index, sign * lag, lag))
            heights.append((z, end))
            z = end
    lags = 1 + max((entry[2] for entry in place), default=0)
    return np.array(place, dtype=np.int64).reshape(-1, 3), np.array(heights).reshape(-1, 2), lags


def _chips(cutter: Cutter, phi: Float, feed: float, lags: int, turn: float, trochoid: bool) -> Float:
    """Return the radial chip thickness (lags or 1, teeth or 1, angles)."""
    radius, flutes = 0.5 * cutter.diameter_m, cutter.flutes
    # Without runout all teeth cut alike: one row stands for every tooth and lag.
    if not cutter.runout_m:
        same = trochoid_thickness(phi, feed, np.full(flutes, radius)) if trochoid else feed * np.sin(phi)
        return np.ascontiguousarray(same[None, None, :])
    sign = -1.0 if cutter.helix_rad < 0.0 else 1.0
    table = np.empty((lags, flutes, phi.size))
    for lag in range(lags):
        middle = sign * (lag + 0.5) * turn if cutter.helix_rad else 0.0
        radii = edge_radii(radius, flutes, cutter.runout_m, cutter.runout_angle_rad, middle)
        for tooth in range(flutes):
            if trochoid:
                table[lag, tooth] = trochoid_thickness(phi, feed, radii, tooth)
            else:
                earlier = [radii[(tooth - k) % flutes] - k * feed * np.sin(phi) for k in range(1, flutes + 1)]
                table[lag, tooth] = radii[tooth] - np.max(earlier, axis=0)
    return table


def tooth_forces(
    cutter: Cutter, law: ForceLaw, depth_m: Float, feed_m: float, *, trochoid: bool = True, steps: int = STEPS
) -> ToothForces:
    """Return the wrench on the tool at every rotation angle of one revolution.

    Args:
        cutter: The cutter, with helix and runout.
        depth_m: (n_levels, n_bins) engaged axial length per level and bin of the immersion angle in m, each level
            engaged from its lower end, as booked by :mod:`counterflex.cutting.removal`.
        feed_m: Horizontal feed per tooth in m, > 0.
        trochoid: Use the true path of the edge; otherwise circles.
        steps: Least number of steps; raised to a multiple of the flutes and of twice the number of bins.

    Raises:
        InputError: Shapes or numbers out of range.
        ModelError: The helix would need too many slices, or the feed is too large for the radius.
    """
    as_positive("feed_m", feed_m)
    depth = np.array(as_float("depth_m", depth_m, (cutter.n_levels, None)))
    if depth.size == 0 or float(depth.min()) < 0.0:
        raise InputError("depth_m is not an engagement", value=depth.shape, limit="(n_levels, n_bins), >= 0")
    if steps < 1:
        raise InputError("number of steps is out of range", value=steps, limit=">= 1")
    # Ends of bins and the pitch fall on whole steps: no step straddles a bin, and the mean meets the closed form.
    unit = math.lcm(2 * depth.shape[1], cutter.flutes)
    steps = unit * math.ceil(steps / unit)
    turn = 2.0 * math.pi / steps
    terms = law.terms()
    levels = level_table(cutter.levels(), 0.5 * cutter.diameter_m, cutter.corner_radius_m, cutter.flute_length_m, terms)
    place, heights, lags = _slices(cutter, levels, depth, turn)
    phi = np.asarray((np.arange(steps // 2) + 0.5) * turn, dtype=np.float64)
    chips = _chips(cutter, phi, feed_m, lags, turn, trochoid)
    if chips.shape[0] == 1 and len(place):
        place[:, 2] = 0
    out, book = np.zeros((steps, 6)), np.zeros(3)
    _revolution(chips, place, heights, depth, levels, terms, cutter.flutes, law.h_min_m, law.h_max_m, out, book)
    # A slice lags by half a step more than its number. With the half step of its angle the edge of a right-handed helix
    # stands at the end of the step, that of a left-handed one at its begin.
    half = 0.5 * (1.0 + math.copysign(1.0, cutter.helix_rad)) if cutter.helix_rad else 0.5
    share = float(book[1] / book[0]) if book[0] > 0.0 else 0.0
    angle = np.asarray((np.arange(steps) + half) * turn, dtype=np.float64)
    return ToothForces(angle, out, float(book[2]), share)
