"""Integrals over the bins of the immersion angle that the mean cutting force is made of.

The kernels of :mod:`counterflex.cutting.mean_force` see only tables: for every power term of the force law the
integrals over each bin, for every level of the cutter its inclination, radius and area.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError

_ANGLES = 720


def sine_power_integral(p: float, phi: Float) -> Float:
    """Return S(p, phi) = integral of sin(t)^p over t from 0 to phi.

    ``S = B((p+1)/2, 1/2) I_{sin^2 phi}((p+1)/2, 1/2) / 2`` up to 90 deg, mirrored beyond.

    Args:
        p: Exponent, >= 0.
        phi: Angles in rad within [0, pi], any shape.

    Returns:
        The integral, same shape.

    Raises:
        InputError: The exponent is negative.
    """
    if p < 0.0:
        raise InputError("exponent of the sine integral is out of range", value=p, limit=">= 0")
    angle = np.asarray(phi, dtype=np.float64)
    a = (p + 1.0) / 2.0
    half = 0.5 * math.exp(float(scipy.special.gammaln(a) + scipy.special.gammaln(0.5) - scipy.special.gammaln(a + 0.5)))
    sin2, cos2 = np.sin(angle) ** 2, np.cos(angle) ** 2
    # near 90 deg the complement keeps the digits
    part = half * np.where(
        sin2 < 0.5, scipy.special.betainc(a, 0.5, np.minimum(sin2, 1.0)), 1.0 - scipy.special.betainc(0.5, a, cos2)
    )
    result: Float = np.where(angle <= math.pi / 2.0, part, 2.0 * half - part)
    return result


def cosine_power_integral(p: float, phi: Float) -> Float:
    """Return C(p, phi) = integral of sin(t)^p cos(t) over t from 0 to phi = sin(phi)^(p+1) / (p+1)."""
    result: Float = np.clip(np.sin(phi), 0.0, None) ** (p + 1.0) / (p + 1.0)
    return result


def arc_table(terms: Float, n_bins: int) -> Float:
    """Tabulate the arc integrals of every power term over equal bins of (0, pi).

    Args:
        terms: Rows (p, k_c, k_r, k_a) of the force law, shape (n_terms, 4).
        n_bins: Number of bins, even, so that no bin straddles 90 deg.

    Returns:
        Shape (n_terms, 5, n_bins): ``int sin^p``, ``int sin^p cos``, ``int sin^p sin``, the effective sine
        ``s = (int sin^p / dphi)^(1/p)``, which makes ``(f s)^p dphi`` the exact integral (for p = 0 the mean sine),
        and ``s^-p``.

    Raises:
        InputError: The number of bins is odd or below 8.
    """
    if n_bins < 8 or n_bins % 2:
        raise InputError("number of bins of the immersion angle is out of range", value=n_bins, limit="even, >= 8")
    edges = np.linspace(0.0, math.pi, n_bins + 1)
    width = math.pi / n_bins
    table = np.empty((len(terms), 5, n_bins))
    for row, p in zip(table, terms[:, 0], strict=True):
        row[0] = np.diff(sine_power_integral(p, edges))
        row[1] = np.diff(cosine_power_integral(p, edges))
        row[2] = np.diff(sine_power_integral(p + 1.0, edges))
        mean = row[0] / width if p > 0.0 else np.diff(-np.cos(edges)) / width
        row[3] = mean ** (1.0 / p) if p > 0.0 else mean
        # On a slope the whole chip, descent included, is raised to p. This takes the power of the sine out again,
        # before the exact integrals over the bin are put in.
        row[4] = row[3] ** -p
    return table


def runout_table(exponent: Float, flutes: int, nodes: int) -> Float:
    """Tabulate by how much runout changes the mean of h^p over the teeth, for a tool whose axis is off by e.

    Edge j stands ``r_j = e cos(alpha + 2 pi j / N)`` further out and takes what the edges before it have left,

        h_j = max(0, min_k (k h + r_j - r_(j-k))),   k = 1..N

    Alpha is averaged over the turn: helix and clamping turn it, and no cell file states it.

    Args:
        exponent: (n_terms,) p, >= 0; an edge force (p = 0) acts where the edge cuts at all.
        flutes: N.
        nodes: Number of nodes at equal steps of ``e / (e + h)`` from 0 to 1.

    Returns:
        (n_terms, 2, nodes): ``mean (h_j / h)^p`` and its derivative by p.
    """
    share = np.minimum(np.linspace(0.0, 1.0, nodes), 1.0 - 1e-9)[:, None]
    angle = (np.arange(_ANGLES) + 0.5) * (2.0 * math.pi / _ANGLES)
    left = [k + share / (1.0 - share) * (np.cos(angle) - np.cos(angle - 2.0 * math.pi * k / flutes)) for k in
            range(1, flutes + 1)]  # fmt: skip
    chip = np.min(left, axis=0)
    cuts, logarithm = chip > 0.0, np.log(np.where(chip > 0.0, chip, 1.0))
    powers = [np.where(cuts, np.exp(p * logarithm), 0.0) for p in exponent.tolist()]
    return np.array([[power.mean(axis=1), (power * logarithm).mean(axis=1)] for power in powers])


def level_table(
    boundaries_m: Float, radius_m: float, corner_radius_m: float, flute_length_m: float, terms: Float
) -> Float:
    """Describe the cutting edge at every axial level by averages over the level.

    On the corner arc the angle between tool axis and outward normal is kappa with
    ``cos kappa = (r_c - z) / r_c``; averages are taken over the arc, so that edge length, projected areas and the mean
    direction of the normal are exact for a level that is engaged over its whole height.

    Args:
        boundaries_m: Heights of the level boundaries above the tool tip in m, rising, the last may be infinite.
        radius_m: Cutter radius in m.
        corner_radius_m: Corner radius in m: 0 flat, ``radius_m`` ball.
        flute_length_m: Cutting length in m, the upper end of the last level.
        terms: Rows (p, k_c, k_r, k_a) of the force law, shape (n_terms, 4).

    Returns:
        Shape (n_levels, 10 + n_terms): mean sin kappa, mean cos kappa, edge length per axial length, mean radius in m,
        lower and upper height above the tip in m, area of the level seen along the axis in m2, radius of the flat
        bottom in m, sin kappa and cos kappa at the upper end; then for every power term the effective
        ``(mean sin^p kappa)^(1/p)``.
    """
    table = np.ones((len(boundaries_m) - 1, 10 + len(terms)))
    flat = max(radius_m - corner_radius_m, 0.0)
    for row, z0, z1 in zip(table, boundaries_m[:-1], boundaries_m[1:], strict=True):
        top = min(float(z1), flute_length_m) if math.isinf(z1) else float(z1)
        if z0 >= corner_radius_m * (1.0 - 1e-12):
            row[:10] = 1.0, 0.0, 1.0, radius_m, z0, top, 0.0, flat, 1.0, 0.0
            continue
        k0 = math.acos(1.0 - z0 / corner_radius_m)
        k1 = math.acos(max(1.0 - z1 / corner_radius_m, 0.0))
        span = k1 - k0
        mean_sin = (math.cos(k0) - math.cos(k1)) / span
        mean_cos = (math.sin(k1) - math.sin(k0)) / span
        inner, outer = flat + corner_radius_m * math.sin(k0), flat + corner_radius_m * math.sin(k1)
        mean_radius = flat + corner_radius_m * mean_sin
        ring = math.pi * (outer * outer - inner * inner)
        row[:8] = mean_sin, mean_cos, 1.0 / mean_sin, mean_radius, z0, top, ring, flat
        row[8:10] = math.sin(k1), math.cos(k1)
        for t, p in enumerate(terms[:, 0]):
            # An edge force (p = 0) does not ask how thick the chip is: its effective sine stays 1.
            if p > 0.0:
                mean = np.diff(sine_power_integral(float(p), np.array([k0, k1])))[0] / span
                row[10 + t] = mean ** (1.0 / p)
    return table
