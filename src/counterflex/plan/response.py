"""Where corrections reach in time, what of an error lasts, and how a load arrives through the arm."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.jit import kernel
from counterflex.plan.cut_kernel import oscillator
from counterflex.signals.preview import Mode

_LASTING_S = 0.6
"""What a trial leaves for that long is left to the correction at rest, which knows it better: in the model the grain of
the stock shakes the drives free of friction that holds them in the cell."""


@kernel("void(float64[:,::1], float64[::1], float64, float64, float64[:,::1])")
def _swing(static: Float, time: Float, omega: float, zeta: float, out: Float) -> None:
    x, v = static[0].copy(), np.zeros(static.shape[1])
    out[0] = x
    for i in range(1, static.shape[0]):
        dt = time[i] - time[i - 1]
        if dt > 0.0:
            a, b, c, d = oscillator(dt, omega, zeta)
            for k in range(static.shape[1]):
                rest = x[k] - static[i, k]
                x[k] = static[i, k] + a * rest + b * v[k]
                v[k] = c * rest + d * v[k]
        out[i] = x


def swing(static: Float, time_s: Float, mode: Mode) -> Float:
    """What arrives through a structure of one mode of something that acts at its end.

    ``x'' + 2 zeta w x' + w^2 x = w^2 x_static(t)``, started at rest at the first value, with the value of each row held
    since the row before; exact for that.

    Args:
        static: (n, k), for example the loads on the drives if the structure passed them on at once.
        time_s: (n,) non-decreasing.
        mode: The mode.

    Returns:
        (n, k) at the times of the rows.
    """
    values = np.array(as_float("static", static, (None, None)))
    out = np.empty_like(values)
    if len(values):
        time = np.array(as_float("time_s", time_s, (len(values),)))
        _swing(values, time, mode.omega_rad_s, mode.damping_ratio, out)
    return out


def within(active: Bool, time_s: Float, group: Int, reach_s: float) -> Bool:
    """Rows within a time of an active row of their group.

    Args:
        active: (n,).
        time_s: (n,) s.
        group: (n,) rows that follow each other without interruption have one number.
        reach_s: The time.

    Returns:
        (n,).
    """
    out = active.copy()
    for rows in _slices(group):
        t, on = time_s[rows], time_s[rows][active[rows]]
        if len(on):
            at = np.searchsorted(on, t)
            before = np.abs(t - on[np.maximum(at - 1, 0)])
            behind = np.abs(t - on[np.minimum(at, len(on) - 1)])
            out[rows] = np.minimum(before, behind) <= reach_s
    return out


def lasting(values: Float, time_s: Float) -> Float:
    """What of a signal lasts: its mean over :data:`_LASTING_S` about each row, less at the ends.

    Args:
        values: (n, k).
        time_s: (n,) s, not decreasing, longer than nothing.

    Returns:
        (n, k).
    """
    if len(time_s) < 2 or time_s[-1] <= time_s[0]:
        return values.copy()
    step = np.diff(time_s, prepend=time_s[0])[:, None]
    middle = 0.5 * (values + np.concatenate([values[:1], values[:-1]]))
    total = np.cumsum(middle * step, axis=0)
    late, early = time_s + 0.5 * _LASTING_S, time_s - 0.5 * _LASTING_S
    width = np.minimum(late, time_s[-1]) - np.maximum(early, time_s[0])
    out = [(np.interp(late, time_s, c) - np.interp(early, time_s, c)) / width for c in total.T]
    return np.stack(out, axis=1)


def _slices(group: Int) -> list[slice]:
    edges = np.flatnonzero(np.diff(group)) + 1
    return [slice(int(a), int(b)) for a, b in zip([0, *edges], [*edges, len(group)], strict=True)]
