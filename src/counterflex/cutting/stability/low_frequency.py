"""Modes far below the tooth-passing frequency: regeneration as a damping matrix.

Where a mode turns by little within a tooth period T, ``omega T << 1``, the tool has hardly moved since the tooth
before: ``q(t) - q(t - T) = T q' - T^2/2 q'' + ...``. The regenerative force ``-s A (q - q_T)`` is then that of dampers,
and of a little mass: the structure swings with

    C_eff = C + s T A,    M_eff = M - s T^2/2 A

s the factor on the engagement's depth, A its mean directional matrix. One mode of shape u, stiffness k and ratio zeta
is stable for every depth of interest where ``u'Au >= 0``, otherwise for ``s < 2 zeta k / (omega T |u'Au|)``. A is not
symmetric, so modes of neighbouring frequency feed each other; the limit of several is found from the eigenvalues of
the whole.

What is left out is of the order ``(omega T)^2 / 6``: 0.2 % of the limit at 0.1, 1.5 % at 0.3, where it is no longer to
be used. Neither is it where the mass that regeneration takes is not small (:func:`valid_factor`): deeper than that, the
cut can stiffen a mode until ``omega T`` is no longer small.

Source: the criterion of one mode and its damping in milling robots: Cordes, Hintze and Altintas 2019.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.cutting.stability.modes import TipModes

VALID_TO: Final = 0.3
"""Largest omega T of a mode that the criterion is used for."""
LARGEST_MASS: Final = 0.05
"""Largest share of the modal mass that regeneration may take."""
_STEPS: Final = 24
_PER_DECADE: Final = 10


def valid_factor(modes: TipModes, A: Float, period_s: float) -> float:
    """Largest factor on the depth that the criterion is good for: ``s T^2/2 |U'AU| <= 0.05``; inf without coupling."""
    coupling = float(np.linalg.norm(modes.shape.T @ A @ modes.shape, 2)) if len(modes) else 0.0
    taken = 0.5 * period_s**2 * coupling
    return LARGEST_MASS / taken if taken > 0.0 else np.inf


def limit(modes: TipModes, A: Float, period_s: float) -> tuple[float, float]:
    """Factor on the depth at which the modes together lose stability, and the frequency at which they then swing.

    Args:
        modes: Modes in the axes of A.
        A: (3, 3) mean directional matrix, N/m.
        period_s: Tooth period T, s.

    Returns:
        The factor, inf where the cut is stable up to :func:`valid_factor`; the angular frequency, rad/s (then nan).

    Raises:
        InputError: Shapes or the period.
    """
    A, T = as_float("A", A, (3, 3)), as_positive("period_s", period_s)
    high = valid_factor(modes, A, T)
    coupling = modes.shape.T @ A @ modes.shape
    if not np.isfinite(high):
        return np.inf, np.nan
    low = 1e-6 * high
    grid = np.geomspace(low, high, 6 * _PER_DECADE + 1)
    growth, omega = _growth(modes, coupling, T, grid)
    unstable = np.flatnonzero(growth > 0.0)
    if len(unstable) == 0:
        return np.inf, np.nan
    at = int(unstable[0])
    # Unstable at a millionth of what the criterion holds for: no depth of any use is stable.
    if at == 0:
        return low, float(omega[0])
    low, high = float(grid[at - 1]), float(grid[at])
    for _ in range(_STEPS):
        middle = float(np.sqrt(low * high))
        if _growth(modes, coupling, T, np.array([middle]))[0][0] > 0.0:
            high = middle
        else:
            low = middle
    factor = float(np.sqrt(low * high))
    return factor, float(_growth(modes, coupling, T, np.array([factor]))[1][0])


def _growth(modes: TipModes, coupling: Float, T: float, factors: Float) -> tuple[Float, Float]:
    """Largest real part of the eigenvalues at each factor, and the frequency of that eigenvalue."""
    n = len(modes)
    s = factors[:, None, None] * coupling
    inverse = np.linalg.inv(np.eye(n) - 0.5 * T**2 * s)
    state = np.zeros((len(factors), 2 * n, 2 * n))
    state[:, :n, n:] = np.eye(n)
    state[:, n:, :n] = -inverse * modes.omega_rad_s**2
    state[:, n:, n:] = -inverse @ (np.diag(2.0 * modes.damping_ratio * modes.omega_rad_s) + T * s)
    values = np.linalg.eigvals(state)
    at = np.argmax(values.real, axis=1)[:, None]
    chosen = np.take_along_axis(values, at, axis=1)[:, 0]
    return chosen.real, np.abs(chosen.imag)
