"""Filter that turns speed and acceleration of the program into the correction that undoes the lag behind it.

The robot follows its program by F and a correction by G, both known to second order::

    F = 1 - f1 s + f2 s^2,   1/G = 1 + g1 s + ...,   c = (1/G)(1 - F) r = (f1 s + a s^2) r,   a = g1 f1 - f2

A program that changes its speed at once would then shake the lowest mode as a robot without lag is shaken by it. So
the motion is led through ``N = (s^2 + 2 z w s + w^2) / (s + w)^2``, which has nothing at the mode, and what N delays is
read ahead from speed and acceleration::

    c = N (1 + k1 s + k2 s^2) r - r,   k1 = f1 + n1,   k2 = a + f1 n1 + n2,   1/N = 1 + n1 s + n2 s^2 + ...

so that a steady speed and a steady acceleration are followed without any error. The position itself is not filtered:
``(1 - N) r = 2 (1 - z) w / (s + w)^2 dr/dt``.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError
from counterflex.runtime.settings import Delays


def lag_filter(delays: Delays, period_s: float, mode: tuple[float, float] | None) -> Float:
    """Coefficients ``b0 b1 b2`` on the speed (s), ``b0 b1 b2`` on the acceleration (s2), ``a1 a2``.

    Args:
        delays: Of program and correction.
        period_s: Cycle.
        mode: Lowest mode, Hz, and its damping ratio; None leaves the motion as it is.

    Raises:
        InputError: The mode lies at or above half the sampling rate.
    """
    first, second = delays.lag_gains
    if mode is None or mode[0] == 0.0:
        return np.array([first, 0.0, 0.0, second, 0.0, 0.0, 0.0, 0.0])
    w, z = 2.0 * math.pi * as_positive("mode", mode[0]), min(as_positive("damping ratio", mode[1]), 1.0)
    if w * period_s >= math.pi:
        raise InputError("the mode is too fast for the loop", value=mode[0], limit=0.5 / period_s)
    n1, n2 = 2.0 * (1.0 - z) / w, -4.0 * z * (1.0 - z) / w**2
    k1, k2 = first + n1, second + first * n1 + n2
    k = math.tan(0.5 * w * period_s)
    square, plain, one = np.array([1.0, -2.0, 1.0]), np.array([k, 0.0, -k]), k * k * np.array([1.0, 2.0, 1.0])
    below = square + 2.0 * plain + one
    passes = square + 2.0 * z * plain + one
    speed = k1 * passes - n1 * one
    out: Float = np.concatenate([speed, k2 * passes, below[1:]]) / below[0]
    return out
