"""Swings of the predicted tool that do not die away: the cut itself feeds them."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.units import MS, UM

_STEP_S: Final = 5.0 * MS
WINDOW_S: Final = 0.2
"""A period of the slowest arms (5 Hz); faster modes have several in it."""
LASTING: Final = 4
"""Windows in succession."""
KEPT: Final = 0.5
"""Share of the amplitude that is left from the first of them to the last: an arm of 6 Hz keeps 0.3 with a damping ratio
of 0.05, 0.1 with 0.1."""
LEAST_M: Final = 50.0 * UM
"""Amplitude that counts: that of the swing to which planning lowers feeds (``[dynamics] swing_um``)."""


def lasting_swings(time_s: Float, deviation_part: Float, cutting: Bool, line: Int) -> list[tuple[int, float]]:
    """Lines in which a predicted deviation swings and does not come to rest.

    Of each stretch of rows in the cut and in one line, what is left of the deviation (along the feed too) beside its
    mean over :data:`WINDOW_S` is the swing; its amplitude in a window is ``sqrt(2)`` times its rms. A swing that an
    entry or a corner makes dies away; one that stays above :data:`LEAST_M` for :data:`LASTING` of them in succession,
    and keeps at least :data:`KEPT` of its amplitude over them, is fed by the cut.

    Args:
        time_s: (n,) s, rising.
        deviation_part: (n, 3) m, part axes.
        cutting: (n,) rows in the cut.
        line: (n,) line of the program of each row.

    Returns:
        Line and largest amplitude in m, by rising line. Stretches shorter than six windows are not judged.
    """
    t = as_float("time_s", time_s, (None,))
    x = as_float("deviation_part", deviation_part, (len(t), 3))
    edges = np.flatnonzero(np.diff(np.where(cutting, line, -1), prepend=-2, append=-2))
    worst: dict[int, float] = {}
    for first, last in pairwise(edges):
        if not cutting[first]:
            continue
        amplitude = _amplitudes(t[first:last], x[first:last])
        if any(_lasts(amplitude[k : k + LASTING]) for k in range(len(amplitude) - LASTING + 1)):
            number = int(line[first])
            worst[number] = max(worst.get(number, 0.0), float(amplitude.max()))
    return sorted(worst.items())


def _lasts(amplitude: Float) -> bool:
    return bool(np.all(amplitude > LEAST_M) and amplitude[-1] >= KEPT * amplitude[0])


def _amplitudes(t: Float, x: Float) -> Float:
    """Amplitude of the swing in each whole window, the first and the last left out: the mean is one-sided there."""
    even = np.arange(t[0], t[-1], _STEP_S)
    per_window = math.ceil(WINDOW_S / _STEP_S)
    whole = len(even) // per_window
    if whole < LASTING + 2:
        return np.empty(0)
    values = np.column_stack([np.interp(even, t, column) for column in x.T])
    swing = values - scipy.ndimage.uniform_filter1d(values, per_window, axis=0, mode="nearest")
    squares = np.sum(swing[: whole * per_window] ** 2, axis=1).reshape(whole, per_window)
    amplitude: Float = np.sqrt(2.0 * squares.mean(axis=1))[1:-1]
    return amplitude
