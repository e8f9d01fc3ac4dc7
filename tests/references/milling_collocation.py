"""Multipliers of milling with one arc of engagement by Chebyshev collocation: no mean coefficients, no lines between.

Independent of :mod:`counterflex.cutting.stability`: coefficients of a straight tooth are written out from chip
thickness and force, the solution in the arc is a polynomial that fulfils the delay equation at Chebyshev points, and
between arcs the modes move freely.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq


@dataclass(frozen=True)
class Cut:
    """Straight teeth on equal modes in x and y.

    Attributes:
        omega_rad_s: Frequency of both modes.
        damping_ratio: Of both.
        stiffness_n_m: Of both.
        entry_rad: Of the arc; clockwise from y.
        exit_rad: Of the arc; it is no longer than the tooth pitch.
        slopes_pa: Kt, Kr.
        teeth: Number of teeth.
    """

    omega_rad_s: float
    damping_ratio: float
    stiffness_n_m: float
    entry_rad: float
    exit_rad: float
    slopes_pa: tuple[float, float]
    teeth: int


def _coefficients(cut: Cut, phi: float) -> np.ndarray:
    """Force on the tool is ``-b a (q - q_T)``: chip thickness (sin, cos).q, tangential and radial force on the tool."""
    s, c = math.sin(phi), math.cos(phi)
    kt, kr = cut.slopes_pa
    tangential, radial = np.array([c, -s]), np.array([s, c])
    return np.outer(kt * tangential + kr * radial, [s, c])


def _differences(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev points on (-1, 1), rising, and the matrix of the derivative of the polynomial through them."""
    x = -np.cos(np.pi * np.arange(count + 1) / count)
    weight = np.ones(count + 1)
    weight[[0, -1]] = 2.0
    weight *= (-1.0) ** np.arange(count + 1)
    D = np.outer(weight, 1.0 / weight) / (x[:, None] - x + np.eye(count + 1))
    return x, D - np.diag(D.sum(axis=1))


def largest_multiplier(cut: Cut, period_s: float, depth_m: float, points: int = 60) -> float:
    """Largest ``|mu|`` over a tooth period."""
    speed = 2.0 * math.pi / (cut.teeth * period_s)
    arc_s = (cut.exit_rad - cut.entry_rad) / speed
    x, D = _differences(points)
    D *= 2.0 / arc_s
    stiffness = np.eye(2) * cut.omega_rad_s**2
    free = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-stiffness, -2.0 * cut.damping_ratio * cut.omega_rad_s * np.eye(2)]]
    )
    mass = cut.stiffness_n_m / cut.omega_rad_s**2
    size = 4 * (points + 1)
    now, before = np.kron(D, np.eye(4)), np.zeros((size, size))
    for i, phi in enumerate(cut.entry_rad + 0.5 * (x + 1.0) * arc_s * speed):
        here, a = slice(4 * i, 4 * i + 4), np.zeros((4, 4))
        a[2:, :2] = depth_m / mass * _coefficients(cut, float(phi))
        now[here, here] -= free - a
        before[here, here] = a
    now[:4], before[:4] = 0.0, 0.0  # the first point: the last of the arc before, after the free motion
    now[:4, :4] = np.eye(4)
    before[:4, -4:] = expm(free * (period_s - arc_s))
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(now, before))).max())


def limit(cut: Cut, period_s: float, between_m: tuple[float, float]) -> float:
    """Depth at which the largest multiplier is 1, m; it must lie between two depths."""
    growth: Callable[[float], float] = lambda depth: math.log(largest_multiplier(cut, period_s, depth))  # noqa: E731
    return float(brentq(growth, *between_m, rtol=1e-6))
