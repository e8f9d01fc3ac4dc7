"""Cutting force of path segments, with the range of validity of the coefficients looked after.

The entry to the room: engagement in (booked by :mod:`counterflex.cutting.removal` or stated by entry and exit angle),
wrench on the tool out. Nothing is extrapolated in silence: the mean chip thickness over the engaged arc decides
whether the coefficients hold, and the share of the cutting work done at a thickness outside their range is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, as_float, as_positive
from counterflex.core.errors import InputError, ModelError
from counterflex.cutting.arc_integrals import cosine_power_integral, sine_power_integral
from counterflex.cutting.coefficients import ForceLaw, check_thickness
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.mean_force import N_BINS, MeanForceWeights, mean_force_weights, mean_wrenches


@dataclass(frozen=True)
class MeanForce:
    """Mean cutting force of path segments."""

    # (n, 6) force in N and moment in N m on the tool about its tip, in the feed frame (x along the horizontal feed, y
    # to its left, z up along the tool axis)
    wrench_tcp: Float
    h_mean_m: Float  # (n,) mean chip thickness over the engaged edge in m, 0 where nothing is cut
    in_range: Bool  # (n,) True where `h_mean_m` lies within the range of the law, and where nothing is cut
    # (n,) share of the cutting work of the side done at a thickness out of that range. It is not zero in range either:
    # an arc that starts tangentially passes through h = 0
    extrapolated_share: Float


def engagement_of_arc(cutter: Cutter, depth_m: float, entry_rad: float, exit_rad: float, n_bins: int = N_BINS) -> Float:
    """Return the engagement of a constant depth over one arc, as a removal simulation would book it.

    A bin that the arc covers in part takes the covered part of its chip width ``cos(phi_b) - cos(phi_b+1)``.

    Args:
        depth_m: Axial depth of cut above the tip in m.
        entry_rad: Immersion angle at which the edge enters, in rad: 0 for up-milling from the left normal.
        exit_rad: Immersion angle at which it leaves, up to pi.
        n_bins: Number of bins.

    Returns:
        (n_levels, n_bins) engaged axial length in m.

    Raises:
        InputError: Angles out of order, or a negative depth.
    """
    as_positive("depth_m", depth_m, zero=True)
    if not 0.0 <= entry_rad <= exit_rad <= math.pi * (1.0 + 1e-12):
        raise InputError(
            "arc of engagement is out of range", value=(entry_rad, exit_rad), limit="0 <= entry <= exit <= pi"
        )
    edges = np.cos(np.linspace(0.0, math.pi, n_bins + 1))
    covered = np.clip(
        np.minimum(edges[:-1], math.cos(entry_rad)) - np.maximum(edges[1:], math.cos(exit_rad)), 0.0, None
    )
    boundaries = cutter.levels()
    heights = np.clip(np.minimum(boundaries[1:], depth_m) - boundaries[:-1], 0.0, None)
    result: Float = heights[:, None] * (covered / (edges[:-1] - edges[1:]))
    return result


def mean_thickness(weights: MeanForceWeights, depths_m: Float, feeds_m: Float, drops_m: Float) -> Float:
    """Return the mean chip thickness over the engaged edge, ``h_m = int h ds dphi / int ds dphi``.

    On the cylinder with an arc from phi_1 to phi_2 that is ``f_z (cos phi_1 - cos phi_2) / (phi_2 - phi_1)``.

    Args:
        weights: Cutter and law.
        depths_m: (n, n_levels, n_bins) engaged axial lengths in m.
        feeds_m: (n,) horizontal feed per tooth in m.
        drops_m: (n,) descent per tooth in m, negative when climbing.

    Returns:
        (n,) thickness in m; where only the end face cuts, the descent per tooth.

    Source: Berger2013 eq. 3.
    """
    h, edge = _thickness(weights, depths_m, feeds_m, drops_m)
    total = edge.sum(axis=(1, 2))
    mean = (h * edge).sum(axis=(1, 2)) / np.where(total > 0.0, total, 1.0)
    result: Float = np.where(total > 0.0, mean, np.clip(drops_m, 0.0, None))
    return result


def _thickness(weights: MeanForceWeights, depths_m: Float, feeds_m: Float, drops_m: Float) -> tuple[Float, Float]:
    """Return chip thickness and engaged edge length, both (n, n_levels, n_bins)."""
    edges = np.linspace(0.0, math.pi, weights.n_bins + 1)
    sine = np.diff(-np.cos(edges)) / np.diff(edges)
    sin_k, cos_k = weights.levels[:, 0], weights.levels[:, 1]
    h = np.multiply.outer(feeds_m, sin_k[:, None] * sine) + np.multiply.outer(drops_m, cos_k)[:, :, None]
    edge: Float = np.where(h > 0.0, depths_m / sin_k[:, None], 0.0)
    clipped: Float = np.clip(h, 0.0, None)
    return clipped, edge


def mean_force(
    cutter: Cutter,
    law: ForceLaw,
    depths_m: Float,
    feeds_m: float | Float,
    drops_m: float | Float = 0.0,
    end_areas_m2: float | Float = 0.0,
    *,
    allow_extrapolation: bool = False,
    where: str | None = None,
) -> MeanForce:
    """Return the mean wrench of path segments and whether the force coefficients hold there.

    Args:
        depths_m: (n, n_levels, n_bins) engaged axial lengths in m.
        feeds_m: Horizontal feed per tooth in m, scalar or (n,), from the actual feed speed.
        drops_m: Descent per tooth in m, scalar or (n,), negative when climbing.
        end_areas_m2: Area over which the end face cuts by descending in m2, scalar or (n,).
        allow_extrapolation: Flag segments out of range instead of raising.
        where: Place to name in the error (operation, program).

    Returns:
        Wrench, mean thickness and flags.

    Raises:
        InputError: Shapes or numbers out of range.
        ModelError: The mean chip thickness of a segment is outside the range of the law.
    """
    weights = mean_force_weights(cutter, law)
    depths = as_float("depths_m", depths_m, (None, weights.n_levels, weights.n_bins))
    n = len(depths)
    feeds = np.broadcast_to(as_float("feeds_m", feeds_m), (n,))
    drops = np.broadcast_to(as_float("drops_m", drops_m), (n,))
    wrench = mean_wrenches(weights, depths, feeds, drops, end_areas_m2)
    # A row without force has no thickness, and must not be refused for one outside the range.
    cut = np.any(wrench != 0.0, axis=1)
    h_mean: Float = np.where(cut, mean_thickness(weights, depths, feeds, drops), 0.0)
    in_range: Bool = ~cut | ((h_mean >= law.h_min_m) & (h_mean <= law.h_max_m))
    if not allow_extrapolation and not np.all(in_range):
        first = int(np.argmin(in_range))
        check_thickness(law, float(h_mean[first]), where=f"{where or 'path'}, segment {first}")
    h, edge = _thickness(weights, depths, feeds, drops)
    work = law.edge_force(h)[..., 0] * edge * weights.levels[:, 3, None]
    outside = (h < law.h_min_m) | (h > law.h_max_m)
    total = work.sum(axis=(1, 2))
    share: Float = np.where(outside, work, 0.0).sum(axis=(1, 2)) / np.where(total > 0.0, total, 1.0)
    return MeanForce(wrench, h_mean, in_range, share)


def zero_normal_force_immersion(law: ForceLaw, feed_m: float) -> float:
    """Return the up-milling immersion at which the mean force normal to the feed vanishes.

    Root of ``sum_t [k_c S(p+1, phi) - k_r C(p, phi)] f^p`` over the arc 0 to phi. The radial width of cut is
    ``a_e = R (1 - cos phi)``. For exponents of zero it obeys ``(2 phi - sin 2 phi) / (1 - cos 2 phi) = k_r / k_c``, so
    that a_e = D/2 needs k_r/k_c = pi/2; the rule "half the diameter" holds near f_z = 0.008 mm only, where edge forces
    raise the ratio. Only the mean vanishes, the ripple at the tooth-passing frequency stays.

    Args:
        feed_m: Feed per tooth in m, > 0.

    Returns:
        phi in rad within (0, pi).

    Raises:
        ModelError: The normal force vanishes nowhere: no radial force, or one that outweighs the slot.

    Source: Berger2013 (strategy), corrected: the immersion is computed, not half the diameter.
    """
    as_positive("feed_m", feed_m)
    # At 0 both integrals vanish; a small arc has the sign of their limit.
    low, high = 1e-3, math.pi
    at_start, in_slot = _normal_force(low, law, feed_m), _normal_force(high, law, feed_m)
    if not at_start < 0.0 < in_slot:
        raise ModelError(
            "force normal to the feed vanishes at no immersion",
            value=f"{at_start:.3g} N/m at the start, {in_slot:.3g} N/m in the slot",
            limit="negative, then positive",
        )
    return float(scipy.optimize.brentq(_normal_force, low, high, args=(law, feed_m), xtol=1e-12))


def _normal_force(phi: float, law: ForceLaw, feed_m: float) -> float:
    """Mean force normal to the feed from 0 to an immersion, N per m of depth, but for a positive factor."""
    angle, total = np.array(phi), 0.0
    for p, kc, kr, _ in law.terms():
        total += feed_m**p * float(
            kc * sine_power_integral(float(p) + 1.0, angle) - kr * cosine_power_integral(float(p), angle)
        )
    return total
