"""Damping of modes while they cut, with the exact delay of a tooth period.

The structure swings with ``eta'' + 2 zeta omega eta' + omega^2 eta = -U' s A (q - q_T)``, q = U eta at the tip and q_T
the tip a tooth period T before. The motion of the tip over the last period is carried at Chebyshev nodes, and its
transport along them by the derivative of the interpolating polynomial. That makes the delay equation an ordinary one,
whose eigenvalues tell growth and frequency. It is the equation of the zeroth-order lobes
(:mod:`counterflex.cutting.stability.lobes`): where the least damping is 0, the factor on the depth is their limit. Far
below the tooth-passing frequency it is the criterion of :mod:`counterflex.cutting.stability.low_frequency`.

Source: Breda, Maset and Vermiglio 2005, Pseudospectral differencing methods for characteristic roots of delay
differential equations.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.cutting.stability.modes import DIMENSIONS, TipModes

NODES: Final = 10
"""Nodes of a tooth period: eigenvalues of up to omega T = 6 are exact to 1e-4."""
_FAST: Final = 6.0
"""Eigenvalues beyond so many times the highest natural frequency are not looked at, as by the lobes."""


@functools.cache
def _transport(nodes: int) -> Float:
    """(nodes + 1, nodes + 1) derivative at Chebyshev nodes of [-1, 0], the present first."""
    k = np.arange(nodes + 1)
    x = np.cos(np.pi * k / nodes)
    c = np.where((k == 0) | (k == nodes), 2.0, 1.0) * (-1.0) ** k
    away = x[:, None] - x + np.eye(nodes + 1)
    D = np.outer(c, 1.0 / c) / away
    D -= np.diag(D.sum(axis=1))
    return 2.0 * D


def least_damping(modes: TipModes, A: Float, period_s: float) -> float:
    """Least damping ratio that modes have left while they cut, ``min(-Re lambda / |lambda|)``; below 0 they chatter.

    One slow mode alone has ``zeta + T u'Au / (2 omega)``.

    Args:
        modes: Modes in the axes of A; at least one.
        A: (3, 3) mean directional matrix at the depth that is cut, N/m.
        period_s: Tooth period T, s.

    Raises:
        InputError: Shapes or the period, or no mode.
    """
    A, T = as_float("A", A, (DIMENSIONS, DIMENSIONS)), as_positive("period_s", period_s)
    n = len(modes)
    if n == 0:
        raise InputError("there is no mode that could swing", limit="at least 1")
    rows = DIMENSIONS * NODES
    U, fed = modes.shape, modes.shape.T @ A
    state = np.zeros((2 * n + rows, 2 * n + rows))
    state[:n, n : 2 * n] = np.eye(n)
    state[n : 2 * n, :n] = -np.diag(modes.omega_rad_s**2) - fed @ U
    state[n : 2 * n, n : 2 * n] = -np.diag(2.0 * modes.damping_ratio * modes.omega_rad_s)
    state[n : 2 * n, -DIMENSIONS:] = fed
    D = _transport(NODES)[1:] / T
    eye = np.eye(DIMENSIONS)
    state[2 * n :, 2 * n :] = np.kron(D[:, 1:], eye)
    state[2 * n :, :n] = np.kron(D[:, :1], eye) @ U
    values = np.linalg.eigvals(state)
    # Ten nodes carry waves up to about omega T = 6. Faster eigenvalues are those of the polynomial, not of the cut.
    values = values[np.abs(values) <= _FAST * float(modes.omega_rad_s.max())]
    return float(np.min(-values.real / np.abs(values), initial=1.0))
