"""Path velocity: accuracy AV, repeatability RV and fluctuation FV (ISO 9283:1998, 8.6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.iso9283.intervals import FigureInterval, mean_figure, three_sigma
from counterflex.evaluate.iso9283.path_cycles import CommandedPath, PathCycle
from counterflex.evaluate.iso9283.path_figures import crossing_steps

MIDDLE: Final = 0.5
"""Share of each stretch that velocities are taken from, its middle."""
WINDOW_S: Final = 0.1
"""Time over which a velocity is the slope of a straight line through the readings."""
_PLACES: Final = 50


@dataclass(frozen=True, eq=False)
class PathVelocity:
    """Velocity figures."""

    commanded_m_s: float  # commanded velocity
    av: FigureInterval  # `AV = mean(v) - v_c`, m/s; the standard gives it in % of `v_c`
    rv: FigureInterval | None  # `RV = 3 S_v` of the cycles' means, m/s; None with one cycle
    fv_m_s: float  # `FV = max_j (max_i v_ij - min_i v_ij)`, m/s
    mean_m_s: Float  # (n,) mean of each cycle
    length_m: Float  # (m,) places
    v: Float
    noise_m_s: float  # standard deviation of one velocity that the noise of the readings alone gives


def path_velocity(path: CommandedPath, cycles: Sequence[PathCycle], window_s: float = WINDOW_S) -> PathVelocity:
    """AV, RV and FV over the middle half of each stretch.

    A velocity is the slope of the progress along the commanded direction against time, by least squares over
    ``window_s``. The noise of a velocity is estimated from what those straight lines leave.

    Raises:
        InputError: The path has no commanded velocity, or a log no times.

    Source: ISO 9283:1998, 8.6.
    """
    vc = path.speed_m_s
    if vc is None or any(cycle.time_s is None for cycle in cycles):
        raise InputError("velocities need a commanded velocity and times")
    s = path.places(MIDDLE, _PLACES)
    c, t = path.at(s)
    v, left = np.full((len(cycles), len(s)), np.nan), []
    for j, cycle in enumerate(cycles):
        assert cycle.time_s is not None
        for i in range(len(s)):
            k, _ = crossing_steps(cycle, s[i], c[i], t[i])
            if len(k) == 0:
                continue
            at = float(np.mean(cycle.time_s[k]))
            a, b = np.searchsorted(cycle.time_s, [at - 0.5 * window_s, at + 0.5 * window_s])
            a, b = min(int(a), int(k[0])), max(int(b), int(k[-1]) + 2)
            time, along = cycle.time_s[a:b] - at, (cycle.p[a:b] - c[i]) @ t[i]
            time0 = time - time.mean()
            sum2 = float(time0 @ time0)
            v[j, i] = float(time0 @ along) / sum2
            if b - a > 2:
                rest = along - along.mean() - v[j, i] * time0
                left.append(math.sqrt(float(rest @ rest) / (b - a - 2) / sum2))
    if np.isnan(v).any():
        raise InputError("an attained path has a hole where its velocity is measured")
    mean = v.mean(axis=1)
    error = mean_figure(mean - vc)
    return PathVelocity(
        commanded_m_s=vc,
        av=error,
        rv=three_sigma(mean) if len(mean) > 1 else None,
        fv_m_s=float((v.max(axis=1) - v.min(axis=1)).max()),
        mean_m_s=mean,
        length_m=s,
        v=v,
        noise_m_s=float(np.median(left)) if left else 0.0,
    )
