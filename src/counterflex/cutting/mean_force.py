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

On a slope the chip is h = f_h sin(phi) sin(kappa) + f_d cos(kappa), f_h the feed per tooth in the plane, f_d the
descent per tooth. Engagement is booked as removed volume, so the engaged edge length follows from it: a surface
element cuts h per tooth, the rear half of the tool (sin phi < 0) shares in the volume as far as its own h is positive,
and force = specific force k h^(p-1) times volume. The flat bottom of a cutter descends with h = f_d everywhere; its
end edges are taken to reach the centre. All of it is continuous in the slope, exact at slope 0 and for the plunge.

Sources: Altintas and Lee 1998 (directions at an inclined edge), Berger2013 section 5 (mean force per path point).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.cutting.arc_integrals import arc_table, disc_table, level_table
from counterflex.cutting.coefficients import ForceLaw

N_BINS = 64
"""Bins of the immersion angle over (0, pi)."""


class CutterShape(Protocol):
    """What the force model needs to know of a cutter; ``counterflex.cutting.cutter.Cutter`` has it."""

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
    def flute_length_m(self) -> float:
        """Cutting length in m."""

    def levels(self) -> Float:
        """Axial level boundaries above the tip in m, rising, the last infinite."""


@dataclass(frozen=True)
class MeanForceWeights:
    """Everything the mean-force kernels need, as small owned arrays (compiled kernels take no read-only ones).

    Attributes:
        terms: (n_terms, 4) rows (p, k_c, k_r, k_a) times N / 2 pi.
        arc: (n_terms, 4, n_bins) arc integrals, see :func:`counterflex.cutting.arc_integrals.arc_table`.
        levels: (n_levels, 6) edge geometry, see :func:`counterflex.cutting.arc_integrals.level_table`.
        disc: (5, n_bins) flat bottom, see :func:`counterflex.cutting.arc_integrals.disc_table`.
    """

    terms: Float
    arc: Float
    levels: Float
    disc: Float

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

    Args:
        cutter: The cutter.
        law: The force law, Kienzle or linear-edge.
        n_bins: Bins of the immersion angle over (0, pi), even.

    Returns:
        The arrays; pass them to the kernels as ``weights.terms, weights.arc, weights.levels, weights.disc``.

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
    arc = arc_table(terms, n_bins)
    terms[:, 1:] *= cutter.flutes / (2.0 * math.pi)
    levels = level_table(np.asarray(cutter.levels(), dtype=np.float64), radius, corner, cutter.flute_length_m)
    disc = disc_table(float(levels[0, 3]), radius - corner, n_bins)
    return MeanForceWeights(terms, arc, levels, disc)


@kernel("void(float64[:,::1], float64, float64[:,::1], float64[:,:,::1], float64[:,::1], float64[::1])")
def _level_wrench(depth: Float, feed: float, terms: Float, arc: Float, levels: Float, out: Float) -> None:
    """Add the wrench of a level move (no slope) to ``out``."""
    for level in range(depth.shape[0]):
        row = depth[level]
        reach = 0.0
        for b in range(row.size):
            reach += row[b]
        if reach <= 0.0:
            continue
        sin_k, cos_k, radius, z0 = levels[level, 0], levels[level, 1], levels[level, 3], levels[level, 4]
        for t in range(terms.shape[0]):
            i1, ic, i_s = arc[t, 0], arc[t, 1], arc[t, 2]
            d1 = dc = ds = e1 = ec = es = 0.0
            for b in range(row.size):
                d = row[b]
                e = d * (z0 + 0.5 * d)
                d1 += d * i1[b]
                dc += d * ic[b]
                ds += d * i_s[b]
                e1 += e * i1[b]
                ec += e * ic[b]
                es += e * i_s[b]
            power = (feed * sin_k) ** terms[t, 0] / sin_k
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
    "void(float64[:,::1], float64, float64, float64, float64[:,::1], float64[:,:,::1], float64[:,::1], float64[:,::1],"
    " float64[::1])"
)
def _sloped_wrench(
    depth: Float,
    feed: float,
    plane: float,
    drop: float,
    terms: Float,
    arc: Float,
    levels: Float,
    disc: Float,
    out: Float,
) -> None:
    """Add the wrench of a sloped move to ``out``: ``plane`` and ``drop`` are the parts of the feed per tooth."""
    width = math.pi / depth.shape[1]
    for level in range(depth.shape[0]):
        sin_k, cos_k, radius = levels[level, 0], levels[level, 1], levels[level, 3]
        z0, z1 = levels[level, 4], levels[level, 5]
        longest = (z1 - z0) * levels[level, 2]
        for b in range(depth.shape[1]):
            volume = depth[level, b] * feed  # per tooth and lateral width
            if volume <= 0.0:
                continue
            if level == 0 and drop > 0.0 and disc[0, b] > 0.0:
                share = min(1.0, volume / (drop * disc[0, b]))
                volume -= share * drop * disc[0, b]
                for t in range(terms.shape[0]):
                    power = drop ** terms[t, 0] * share
                    kc, kr, ka = terms[t, 1] * power, terms[t, 2] * power, terms[t, 3] * power
                    out[0] -= kc * disc[2, b]
                    out[1] -= ka * disc[2, b]
                    out[2] += kr * disc[1, b]
                    out[3] += kr * disc[3, b]
                    out[5] += kc * disc[4, b]
            for t in range(terms.shape[0]):
                p = terms[t, 0]
                sine = arc[t, 3, b]
                front = plane * sine * sin_k + drop * cos_k
                rear = drop * cos_k - plane * sine * sin_k
                if rear < 0.0:
                    rear = 0.0
                if front <= 0.0 or volume <= 0.0:
                    continue
                edge = min(volume * sine / (front + rear), longest)
                height = z0 + 0.5 * min(edge * sin_k, z1 - z0)
                power = (sine**p * width) if p > 0.0 else width
                wc, ws = width * arc[t, 1, b] / power, width * arc[t, 2, b] / power
                front = front**p * edge
                rear = rear**p * edge if rear > 0.0 else 0.0
                kc = terms[t, 1]
                kn = terms[t, 2] * sin_k + terms[t, 3] * cos_k
                kz = terms[t, 2] * cos_k - terms[t, 3] * sin_k
                both, net = front + rear, front - rear
                fx = -kc * wc * both - kn * ws * net
                fy = kc * ws * net - kn * wc * both
                out[0] += fx
                out[1] += fy
                out[2] += kz * width * both
                out[3] += radius * kz * wc * both - height * fy
                out[4] += height * fx - radius * kz * ws * net
                out[5] += radius * kc * width * both


@kernel(
    "void(float64[:,::1], float64, float64, float64[:,::1], float64[:,:,::1], float64[:,::1], float64[:,::1],"
    " float64[::1])"
)
def mean_wrench(
    depth: Float,
    feed_m: float,
    descent: float,
    terms: Float,
    arc: Float,
    levels: Float,
    disc: Float,
    out: Float,
) -> None:
    """Write the mean wrench on the tool at one path point; callable from other kernels, allocates nothing.

    Args:
        depth: (n_levels, n_bins) engaged axial length per level and bin of the immersion angle in m: the removed
            volume per length of path (true length, in space) and lateral width ``dw = R (cos phi_b - cos phi_b+1)``.
        feed_m: Feed per tooth along the path in m, from the *actual* feed speed: v / (n N), n in rev/s.
        descent: Sine of the angle by which the path descends, -1 (straight up) to 1 (plunge).
        terms: ``MeanForceWeights.terms``.
        arc: ``MeanForceWeights.arc``.
        levels: ``MeanForceWeights.levels``.
        disc: ``MeanForceWeights.disc``.
        out: (6,) result: force (N) and moment (N m) on the tool about the tool tip in the feed frame: x along the
            horizontal feed, y to its left, z up along the tool axis.
    """
    for i in range(6):
        out[i] = 0.0
    if feed_m <= 0.0:
        return
    if descent == 0.0:
        _level_wrench(depth, feed_m, terms, arc, levels, out)
    else:
        plane = feed_m * math.sqrt(max(0.0, 1.0 - descent * descent))
        _sloped_wrench(depth, feed_m, plane, feed_m * descent, terms, arc, levels, disc, out)


@kernel(
    "void(float64[:,:,::1], float64[::1], float64[::1], float64[:,::1], float64[:,:,::1], float64[:,::1],"
    " float64[:,::1], float64[:,::1])"
)
def _mean_wrenches(
    depths: Float, feeds: Float, descents: Float, terms: Float, arc: Float, levels: Float, disc: Float, out: Float
) -> None:
    for i in range(depths.shape[0]):
        mean_wrench(depths[i], feeds[i], descents[i], terms, arc, levels, disc, out[i])


def mean_wrenches(
    weights: MeanForceWeights, depths_m: Float, feeds_m: float | Float, descents: float | Float = 0.0
) -> Float:
    """Return the mean wrench on the tool for a batch of path points.

    Args:
        weights: Cutter and law, from :func:`mean_force_weights`.
        depths_m: (n, n_levels, n_bins) or (n_levels, n_bins) engaged axial lengths in m, see :func:`mean_wrench`.
        feeds_m: Feed per tooth along the path in m, scalar or (n,); 0 gives no force.
        descents: Sine of the descent of the path, scalar or (n,), -1 to 1.

    Returns:
        (n, 6) or (6,): force in N and moment in N m about the tool tip, in the feed frame, what the part does to
        the tool.

    Raises:
        InputError: Shapes that do not fit, negative depths or feeds, |descent| > 1.
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
    feeds = np.array(np.broadcast_to(as_float("feeds_m", feeds_m), (n,)))
    slopes = np.array(np.broadcast_to(as_float("descents", descents), (n,)))
    if depths.size and float(depths.min()) < 0.0:
        raise InputError("engaged depth is negative", value=float(depths.min()), limit=">= 0")
    if n and float(feeds.min()) < 0.0:
        raise InputError("feed per tooth is negative", value=float(feeds.min()), limit=">= 0")
    if n and float(np.abs(slopes).max()) > 1.0:
        raise InputError("descent is not a sine", value=float(np.abs(slopes).max()), limit="-1 to 1")
    out = np.empty((n, 6))
    if not depths.flags.writeable:
        depths = depths.copy()
    _mean_wrenches(depths, feeds, slopes, weights.terms, weights.arc, weights.levels, weights.disc, out)
    return out[0] if single else out
