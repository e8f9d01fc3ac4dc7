"""Mean cutting wrench over a revolution, exact for the booked engagement, one table product per path point.

For an engaged edge length that is constant over a bin of the immersion angle phi, the mean of a power law over a
revolution has a closed form that does not depend on helix or pitch. With the integrals over bin b

    I1 = int sin^p dphi,   Ic = int sin^p cos dphi,   Is = int sin^p sin dphi

and h = f sin(phi) sin(kappa), the mean force on the tool in the feed frame (x along the horizontal feed, y to its
left, z up along the tool axis, out of the part) of each power term k h^p, a level of inclination kappa and N teeth is

    Fx = N/2pi (f sin kappa)^p / sin kappa sum_b d_b [-k_c Ic - k_n Is]
    Fy = N/2pi (f sin kappa)^p / sin kappa sum_b d_b [ k_c Is - k_n Ic]
    Fz = N/2pi (f sin kappa)^p / sin kappa sum_b d_b   k_z I1

with k_n = k_r sin kappa + k_a cos kappa, k_z = k_r cos kappa - k_a sin kappa and d_b the engaged axial length.

On a slope the chip at a corner is h = f_h sin(phi) sin(kappa) + f_d cos(kappa), f_h the feed per tooth in the plane,
f_d the descent per tooth; on the cylinder kappa = 90 deg and the descent adds nothing. On a steep descent the rear
half of the corner cuts too, h = f_d cos(kappa) - f_h |sin(phi)| sin(kappa) where that is positive; it is taken as the
mirror image of the front, with which it is booked, and in the plunge the two cancel but for thrust and torque. What is
left of the area that the tool lowers by descending is cut by its end face: the flat bottom with h = f_d (radial end
edges that reach the centre, thrust k_r, torque k_c), then the corner from the tip outwards with h = f_d cos(kappa).
The side part and the end part add, so the force is continuous from the level cut over ramp and helix to the plunge.
Where the end face is engaged in part, the contact is taken as spread evenly around the axis: its side force and
tilting moment are zero.

Runout makes chips uneven: each power term is multiplied by the mean of ``(h_j / h)^p`` over the teeth, at the chip of
the bin (:func:`counterflex.cutting.arc_integrals.runout_table`). On the end face it moves no edge along the axis.

Sources: Altintas and Lee 1998 (directions at an inclined edge), Berger2013 section 5 (mean force per path point), Kline
and DeVor 1983 (runout).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.cutting.arc_integrals import arc_table, level_table, runout_table
from counterflex.cutting.coefficients import ForceLaw

N_BINS = 64
"""Bins of the immersion angle over (0, pi)."""


class CutterShape(Protocol):
    """Interface of a cutter to the force model; ``counterflex.cutting.cutter.Cutter`` has it."""

    @property
    def diameter_m(self) -> float:
        """Diameter in m."""

    @property
    def corner_radius_m(self) -> float:
        """Corner radius in m: 0 flat, half the diameter ball."""

    @property
    def flutes(self) -> int:
        """Number of teeth."""

    @property
    def runout_m(self) -> float:
        """Offset of the cutter's axis from the spindle's in m."""

    @property
    def flute_length_m(self) -> float:
        """Cutting length in m."""

    def levels(self) -> Float:
        """Axial level boundaries above the tip in m, rising, the last infinite."""


@dataclass(frozen=True)
class MeanForceWeights:
    """Everything the mean-force kernels need, as small owned arrays (compiled kernels take no read-only ones)."""

    terms: Float  # (n_terms, 4) rows (p, k_c, k_r, k_a) times N / 2 pi
    # (n_terms, 6, n_bins) counterflex.cutting.arc_integrals.arc_table, and behind it the factors of runout_table
    arc: Float
    # (n_levels, 11 + n_terms) edge geometry, see counterflex.cutting.arc_integrals.level_table; runout in m
    levels: Float

    @property
    def n_bins(self) -> int:
        """Bins of the immersion angle."""
        return int(self.arc.shape[2])

    @property
    def n_levels(self) -> int:
        """Axial levels of the cutter."""
        return int(self.levels.shape[0])


def mean_force_weights(cutter: CutterShape, law: ForceLaw, n_bins: int = N_BINS) -> MeanForceWeights:
    """Tabulate a cutter and a force law for :func:`mean_wrench`.

    ``n_bins``: bins of the immersion angle over (0, pi), even.

    Returns:
        The arrays; pass them to the kernels as ``weights.terms, weights.arc, weights.levels``.

    Raises:
        InputError: Number of bins, or a cutter whose numbers contradict each other.
    """
    radius = 0.5 * as_positive("diameter_m", cutter.diameter_m)
    corner = as_positive("corner_radius_m", cutter.corner_radius_m, zero=True)
    if corner > radius * (1.0 + 1e-9):
        raise InputError("corner radius is larger than the cutter's radius", value=corner, limit=radius)
    if cutter.flutes < 1:
        raise InputError("number of flutes is out of range", value=cutter.flutes, limit=">= 1")
    terms = law.terms()
    uneven = runout_table(terms[:, 0], cutter.flutes, n_bins)[:, :1]
    arc = np.ascontiguousarray(np.concatenate([arc_table(terms, n_bins), uneven], axis=1))
    boundaries = np.asarray(cutter.levels(), dtype=np.float64)
    levels = level_table(boundaries, radius, corner, cutter.flute_length_m, terms)
    runout = as_positive("runout_m", cutter.runout_m, zero=True) if cutter.flutes > 1 else 0.0
    levels = np.pad(levels, ((0, 0), (0, 1)), constant_values=runout)
    terms[:, 1:] *= cutter.flutes / (2.0 * math.pi)
    return MeanForceWeights(terms, arc, levels)


@kernel("float64(float64[::1], float64, float64)")
def _uneven(factors: Float, runout: float, chip: float) -> float:
    """Factor of runout on the mean power of a chip, from a row of :func:`runout_table`."""
    place = runout / (runout + chip) * (factors.size - 1)
    before = min(int(place), factors.size - 2)
    return float(factors[before] + (place - before) * (factors[before + 1] - factors[before]))


@kernel("void(float64[::1], float64, float64[:,::1], float64[:,:,::1], float64[::1], float64[::1])", disjoint=True)
def _level_side(row: Float, feed: float, terms: Float, arc: Float, level: Float, out: Float) -> None:
    """Add the wrench of one level whose chip is ``feed sin(phi) sin(kappa)``."""
    sin_k, cos_k, radius, z0, runout = level[0], level[1], level[3], level[4], level[level.size - 1]
    for t in range(terms.shape[0]):
        i1, ic, i_s = arc[t, 0], arc[t, 1], arc[t, 2]
        d1 = dc = ds = ec = es = 0.0
        for b in range(row.size):
            d = row[b]
            # A level is engaged from its lower end upwards: its force acts half way up what is engaged.
            e = d * (z0 + 0.5 * d)
            if runout > 0.0 and d > 0.0:
                # Runout and chip both shrink with sin(kappa).
                factor = _uneven(arc[t, 5], runout, feed * arc[t, 3, b])
                d *= factor
                e *= factor
            d1 += d * i1[b]
            dc += d * ic[b]
            ds += d * i_s[b]
            ec += e * ic[b]
            es += e * i_s[b]
        power = (feed * level[10 + t]) ** terms[t, 0] / sin_k
        kc = terms[t, 1] * power
        kn = (terms[t, 2] * sin_k + terms[t, 3] * cos_k) * power
        kz = (terms[t, 2] * cos_k - terms[t, 3] * sin_k) * power
        out[0] -= kc * dc + kn * ds
        out[1] += kc * ds - kn * dc
        out[2] += kz * d1
        out[3] += radius * kz * dc - (kc * es - kn * ec)
        out[4] -= kc * ec + kn * es + radius * kz * ds
        out[5] += radius * kc * d1


@kernel(
    "float64(float64[::1], float64, float64, float64[:,::1], float64[:,:,::1], float64[::1], float64[::1])",
    disjoint=True,
)
def _inclined_side(row: Float, feed: float, drop: float, terms: Float, arc: Float, level: Float, out: Float) -> float:
    """Add the wrench of one level of a corner on a slope, chip ``feed sin(phi) sin(kappa) + drop cos(kappa)``."""
    # Returns the horizontal area over which it cuts by descending.
    sin_k, cos_k, radius, z0 = level[0], level[1], level[3], level[4]
    runout = level[level.size - 1] * sin_k
    longest = 4.0 * (level[5] - z0) / sin_k  # bounds the noise of a climbing level that just loses contact
    width = math.pi / row.size
    area = 0.0
    for b in range(row.size):
        if row[b] <= 0.0:
            continue
        sine = arc[0, 3, b]
        rear = 0.0
        if drop > 0.0:  # what the rear lowers is booked with the front
            rear = max(0.0, drop * cos_k - feed * sine * sin_k)
        depth = row[b] / (1.0 + rear / (feed * sine * sin_k + drop * cos_k)) if rear > 0.0 else row[b]
        if drop > 0.0:
            face = depth * cos_k / sin_k * radius * width
            beyond = (row[b] - depth) * feed * sine * radius * width  # booked to the side, but lowered by the rear
            area += face + face * rear / (drop * cos_k) - beyond / drop
        for t in range(terms.shape[0]):
            p = terms[t, 0]
            sine = arc[t, 3, b]
            chip = feed * sine * level[10 + t] + drop * cos_k
            edge = depth / sin_k
            if drop < 0.0:
                swept = feed * sine * sin_k + drop * cos_k
                most = feed * sine * level[8] + drop * level[9]
                if 2.0 * swept < most:  # the lower end of the level does not cut
                    swept = 0.5 * most
                    chip = swept
                if swept <= 0.0:
                    continue
                chip = min(max(chip, 0.5 * swept), most)
                edge = min(row[b] * feed * sine / swept, longest)
            height = z0 + 0.5 * edge * sin_k
            front, back = chip**p * edge, rear**p * edge if rear > 0.0 else 0.0
            if runout > 0.0:
                front *= _uneven(arc[t, 5], runout, chip)
                back *= _uneven(arc[t, 5], runout, rear)
            along, across = (front - back) * arc[t, 4, b], (front + back) * arc[t, 4, b]
            kc = terms[t, 1]
            kn = terms[t, 2] * sin_k + terms[t, 3] * cos_k
            kz = terms[t, 2] * cos_k - terms[t, 3] * sin_k
            fx = -kc * arc[t, 1, b] * across - kn * arc[t, 2, b] * along
            fy = kc * arc[t, 2, b] * along - kn * arc[t, 1, b] * across
            out[0] += fx
            out[1] += fy
            out[2] += kz * arc[t, 0, b] * across
            out[3] += radius * kz * arc[t, 1, b] * across - height * fy
            out[4] += height * fx - radius * kz * arc[t, 2, b] * along
            out[5] += radius * kc * (front + back) * width
    return area


@kernel("void(float64, float64, float64[:,::1], float64[:,::1], float64[::1])")
def _end_face(area: float, drop: float, terms: Float, levels: Float, out: Float) -> None:
    """Add thrust and torque of an end face that descends over ``area``, filled from the tip outwards."""
    flat = levels[0, 7]
    disc = math.pi * flat * flat
    rest = area
    if disc > 0.0:
        share = min(1.0, rest / disc)
        rest -= share * disc
        for t in range(terms.shape[0]):
            power = drop ** terms[t, 0] * share
            out[2] += terms[t, 2] * power * 2.0 * math.pi * flat
            out[5] += terms[t, 1] * power * disc
    for level in range(levels.shape[0]):
        ring, cos_k = levels[level, 6], levels[level, 1]
        if rest <= 0.0 or ring <= 0.0:
            break
        part = min(rest, ring)
        rest -= part
        sin_k, radius = levels[level, 0], levels[level, 3]
        edge = part / (radius * cos_k)
        for t in range(terms.shape[0]):
            power = (drop * cos_k) ** terms[t, 0] * edge
            out[2] += (terms[t, 2] * cos_k - terms[t, 3] * sin_k) * power
            out[5] += terms[t, 1] * power * radius


@kernel(
    "void(float64[:,::1], float64, float64, float64, float64[:,::1], float64[:,:,::1], float64[:,::1], float64[::1])",
    disjoint=True,
)
def mean_wrench(
    depth: Float, feed_m: float, drop_m: float, end_area_m2: float, terms: Float, arc: Float, levels: Float, out: Float
) -> None:
    """Write the mean wrench on the tool at one path segment; callable from other kernels, allocates nothing.

    Takes what :func:`counterflex.cutting.sweep_kernels.stamp_segment` books: with ``n`` teeth passing during the
    segment, ``feed_m = hypot(dx, dy) / n``, ``drop_m = -dz / n``, ``end_area_m2 = extra[0] / -dz`` when descending.
    The spindle turns clockwise (M3). For a left-hand cutter on M4 pass the bins in reverse order and change the sign of
    Fy, Mx and Mz of the result.

    Args:
        depth: (n_levels, n_bins) engaged axial length per level and bin of the immersion angle in m.
        feed_m: Horizontal feed per tooth in m, from the *actual* feed speed.
        drop_m: Descent per tooth in m, negative when climbing.
        end_area_m2: Horizontal area over which the tool cuts by descending (volume removed by the end face per
            depth of descent) in m2; 0 unless descending.
        terms: ``MeanForceWeights.terms``.
        arc: ``MeanForceWeights.arc``.
        levels: ``MeanForceWeights.levels``.
        out: (6,) result: force (N) and moment (N m) on the tool about the tool tip in the feed frame: x along the
            horizontal feed, y to its left, z up along the tool axis.
    """
    for i in range(6):
        out[i] = 0.0
    lowered = 0.0
    for level in range(depth.shape[0]):
        row = depth[level]
        engaged = 0.0
        for b in range(row.size):
            engaged += row[b]
        if engaged <= 0.0 or feed_m <= 0.0:
            continue
        # On the level, and on the cylinder (cos kappa = 0) at any slope, the descent adds nothing to the chip: the
        # exact integrals hold.
        if drop_m == 0.0 or levels[level, 1] == 0.0:
            _level_side(row, feed_m, terms, arc, levels[level], out)
        else:
            lowered += _inclined_side(row, feed_m, drop_m, terms, arc, levels[level], out)
    # What inclined levels lower is in their force already: counted with the end face it would push twice.
    if drop_m > 0.0 and end_area_m2 > lowered:
        _end_face(end_area_m2 - lowered, drop_m, terms, levels, out)


@kernel(
    "void(float64[:,:,::1], float64[::1], float64[::1], float64[::1], float64[:,::1], float64[:,:,::1],"
    " float64[:,::1], float64[:,::1])",
    entry=True,
)
def _mean_wrenches(
    depths: Float, feeds: Float, drops: Float, areas: Float, terms: Float, arc: Float, levels: Float, out: Float
) -> None:
    for i in range(depths.shape[0]):
        mean_wrench(depths[i], feeds[i], drops[i], areas[i], terms, arc, levels, out[i])


def mean_wrenches(
    weights: MeanForceWeights,
    depths_m: Float,
    feeds_m: float | Float,
    drops_m: float | Float = 0.0,
    end_areas_m2: float | Float = 0.0,
) -> Float:
    """Return the mean wrench on the tool for a batch of path segments.

    Args:
        weights: Cutter and law, from :func:`mean_force_weights`.
        depths_m: (n, n_levels, n_bins) or (n_levels, n_bins) engaged axial lengths in m, see :func:`mean_wrench`.
        feeds_m: Horizontal feed per tooth in m, scalar or (n,).
        drops_m: Descent per tooth in m, scalar or (n,), negative when climbing.
        end_areas_m2: Area of the end face that cuts by descending in m2, scalar or (n,).

    Returns:
        (n, 6) or (6,): force in N and moment in N m about the tool tip, in the feed frame, what the part does to
        the tool.

    Raises:
        InputError: Shapes that do not fit, negative depths, feeds or areas.
    """
    depths = as_float("depths_m", depths_m)
    single = depths.ndim == 2
    if single:
        depths = depths[None]
    if depths.ndim != 3 or depths.shape[1:] != (weights.n_levels, weights.n_bins):
        raise InputError(
            "depths_m has the wrong shape", value=depths.shape, limit=("n", weights.n_levels, weights.n_bins)
        )
    n = len(depths)
    feeds, areas, drops = (
        np.array(np.broadcast_to(as_float(name, value), (n,)))
        for name, value in (("feeds_m", feeds_m), ("end_areas_m2", end_areas_m2), ("drops_m", drops_m))
    )
    for name, array in (("feeds_m", feeds), ("end_areas_m2", areas)):
        if n and float(array.min()) < 0.0:
            raise InputError(f"{name} is negative", value=float(array.min()), limit=">= 0")
    if depths.size and float(depths.min()) < 0.0:
        raise InputError("engaged depth is negative", value=float(depths.min()), limit=">= 0")
    if not depths.flags.writeable:
        depths = depths.copy()
    out = np.empty((n, 6))
    _mean_wrenches(depths, feeds, drops, areas, weights.terms, weights.arc, weights.levels, out)
    return out[0] if single else out
