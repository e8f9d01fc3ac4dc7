"""How a correction has to be shaped so that the robot can follow it.

A cutting force sets in within a few hundredths of a second; a correction that did the same would bend the path so
sharply that the controller slows down and the arm rings. The correction is therefore averaged over a short time, half
of it before and half of it after, and may be sent earlier by what the robot answers a command later than a force.
Planning knows the future, so the average costs no delay; it makes corrections begin shortly before contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.jit import kernel
from counterflex.plan.cut_kernel import oscillator
from counterflex.plan.smoothing import moving_average


@dataclass(frozen=True)
class Mode:
    """The lowest structural mode, as a tap test at the tool shows it with the drives on.

    Attributes:
        omega_rad_s: Undamped angular frequency, > 0.
        damping_ratio: > 0.
    """

    omega_rad_s: float
    damping_ratio: float

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("mode frequency", self.omega_rad_s)
        as_positive("mode damping ratio", self.damping_ratio)


@dataclass(frozen=True)
class Shaping:
    """How a correction is shaped in time.

    Attributes:
        smoothing_s: Width of each of the two centred moving averages it passes, >= 0.
        lead_s: How much earlier it is sent, >= 0.
    """

    smoothing_s: float
    lead_s: float

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("smoothing of the correction", self.smoothing_s, zero=True)
        as_positive("lead of the correction", self.lead_s, zero=True)


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


def shaped(correction: Float, time_s: Float, group: Int, shaping: Shaping) -> Float:
    """A correction that the robot can follow.

    Two centred moving averages of the same width (a triangular window), then the lead. Nothing passes from one group
    to the next, the ends of a group are kept, and rows farther than the window and the lead from any correction stay
    exactly zero.

    Args:
        correction: (n, k), zero where nothing is to be corrected.
        time_s: (n,) non-decreasing.
        group: (n,) rows that follow each other without interruption have one number.
        shaping: Window and lead.

    Returns:
        (n, k).
    """
    values = as_float("correction", correction, (None, None))
    time = as_float("time_s", time_s, (len(values),))
    out = values
    for _ in range(2):
        out = moving_average(out, time, shaping.smoothing_s, group)
    reach = _within(np.any(values != 0.0, axis=1), time, group, shaping.smoothing_s + shaping.lead_s)
    if shaping.lead_s > 0.0:
        out = _sent_earlier(out, time, group, shaping.lead_s)
    result: Float = np.where(reach[:, None], out, 0.0)
    return result


def _sent_earlier(values: Float, time: Float, group: Int, lead: float) -> Float:
    out = values.copy()
    for rows in _slices(group):
        for k in range(values.shape[1]):
            out[rows, k] = np.interp(time[rows] + lead, time[rows], values[rows, k])
    return out


def _within(active: Bool, time: Float, group: Int, reach_s: float) -> Bool:
    """Rows within a time of an active row of their group."""
    out = active.copy()
    for rows in _slices(group):
        t, on = time[rows], time[rows][active[rows]]
        if len(on):
            at = np.searchsorted(on, t)
            before = np.abs(t - on[np.maximum(at - 1, 0)])
            behind = np.abs(t - on[np.minimum(at, len(on) - 1)])
            out[rows] = np.minimum(before, behind) <= reach_s
    return out


def _slices(group: Int) -> list[slice]:
    edges = np.flatnonzero(np.diff(group)) + 1
    return [slice(int(a), int(b)) for a, b in zip([0, *edges], [*edges, len(group)], strict=True)]
