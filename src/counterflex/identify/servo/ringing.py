"""Lowest mode of a structure that rings down, from samples of any of its motions.

Free motion is a sum of damped exponentials ``z^n`` with poles z shared by all channels; the poles are the eigenvalues
of the shift that carries one window of samples onto the next (matrix pencil, signal space from a singular value
decomposition). A mode has ``ln z / h = -zeta w +- i w sqrt(1 - zeta^2)``.

Source: Hua and Sarkar 1990.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError

ORDER: Final = 10
SHARE: Final = 0.1
"""Amplitude against the strongest mode below which a mode does not count."""
_BAND_HZ = (1.0, 60.0)


@dataclass(frozen=True)
class Mode:
    """A damped oscillation.

    Attributes:
        frequency_hz: Undamped natural frequency.
        damping: zeta, 1.
        amplitude: Root of the sum of squared amplitudes over the channels, unit of the signals.
    """

    frequency_hz: float
    damping: float
    amplitude: float


def lowest_mode(signals: Float, step_s: float, *, order: int = ORDER) -> Mode:
    """The lowest mode that rings noticeably.

    ``signals``: (n, k) at even steps, from just after the release; like units. ``step_s``: s.

    Returns:
        Of the modes with at least :data:`SHARE` of the strongest one's amplitude the one of lowest frequency.

    Raises:
        InputError: Too few samples, or nothing rings.
    """
    y = as_float("signals", signals, (None, None))
    h = as_positive("step_s", step_s)
    n = len(y)
    if n < 4 * order:
        raise InputError("a record too short to determine a mode", value=n, limit=f">= {4 * order} samples")
    y = y - y[-max(n // 10, 1) :].mean(axis=0)
    window = n // 3
    H = np.concatenate([np.lib.stride_tricks.sliding_window_view(column, window).T for column in y.T], axis=1)
    u = np.linalg.svd(H @ H.T)[0][:, :order]
    z = np.linalg.eigvals(np.linalg.lstsq(u[:-1], u[1:], rcond=None)[0])
    z = z[(np.abs(z) < 1.02) & (np.abs(z) > 0.1)]
    V = z[None, :] ** np.arange(n)[:, None]
    amplitudes = np.linalg.norm(np.linalg.lstsq(V, y.astype(np.complex128), rcond=None)[0], axis=1)
    rate = np.log(z) / h
    modes = [
        Mode(float(abs(r)) / (2.0 * np.pi), float(-r.real / abs(r)), 2.0 * float(a))
        for r, a in zip(rate, amplitudes, strict=True)
        if r.imag > 0.0 and _BAND_HZ[0] < abs(r) / (2.0 * np.pi) < _BAND_HZ[1] and 0.0 < -r.real / abs(r) < 0.6
    ]
    if not modes:
        raise InputError("nothing rings in this record", limit=f"{_BAND_HZ[0]:g} .. {_BAND_HZ[1]:g} Hz")
    strongest = max(mode.amplitude for mode in modes)
    return min((mode for mode in modes if mode.amplitude >= SHARE * strongest), key=lambda mode: mode.frequency_hz)
