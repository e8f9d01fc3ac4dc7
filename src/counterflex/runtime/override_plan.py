"""At which speed can the correction follow? The plan is driven through limits, dead time and lag of the correction.

The correction that the plan wants at every place is sent ahead of time by the lead, as the loop does, through limits
of speed and acceleration, the dead time and the second-order lag of the robot's answer. What is missing of it where and
when it is needed, taken over the uncertainty of timing, is the remaining error. Where it is beyond the tolerance the
program goes slower: everything then changes more slowly in time, while lag and limits stay. Repeated until it fits or
the least speed is reached; the largest change of speed per second is kept by beginning earlier.

A compensated program leaves an error that the plan has predicted already (``left_m``); what of it is lag and what is
force changes with the speed at most in proportion, and so it is lowered here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.runtime.override_settings import OverrideSettings
from counterflex.runtime.settings import OnlineSettings, robot_answer
from counterflex.signals.limiter import limited_step

ROUNDS: Final = 12
_LONGEST_S: Final = 7200.0


@kernel("void(float64[::1], float64[:, ::1], float64, int64, float64[::1])")
def _need_at(time: Float, need: Float, t: float, begin: int, out: Float) -> None:
    """Need at a plan time, linear; searched from a row near it."""
    n = time.shape[0]
    i = min(max(begin, 0), n - 2)
    while i > 0 and time[i] > t:
        i -= 1
    while i < n - 2 and time[i + 1] < t:
        i += 1
    span = time[i + 1] - time[i]
    u = min(1.0, max(0.0, (t - time[i]) / span)) if span > 0.0 else 1.0
    for k in range(3):
        out[k] = (1.0 - u) * need[i, k] + u * need[i + 1, k]


@kernel(
    "float64(float64[::1], float64[:, ::1], float64[::1], float64, float64, float64, int64, float64[::1],"
    " float64[::1], float64, float64[::1])"
)
def drive(
    time: Float,
    need: Float,
    speed: Float,
    period: float,
    lead: float,
    timing: float,
    dead: int,
    answer: Float,
    limit: Float,
    longest: float,
    error: Float,
) -> float:
    """Remaining error of a plan at given shares of its speed.

    Args:
        time: (n,) s, not decreasing.
        need: (n, 3) correction that is needed there, m.
        speed: (n,) share of the programmed speed, above 0, linear between rows.
        period: Cycle, s.
        lead: How much ahead the need is sent, s.
        timing: Uncertainty of timing, s.
        dead: Cycles of dead time.
        answer: (5,) b0 b1 b2 a1 a2 of the lag.
        limit: (3,) of the correction.
        longest: Ends there, s.
        error: (n,) written: largest error from each row to the next, m.

    Returns:
        How long it takes, s.
    """
    n = time.shape[0]
    y, v, wanted, here, x1, x2 = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    y1, y2, now = np.zeros(3), np.zeros(3), np.zeros(3)
    ring = np.zeros((dead + 1, 3))
    error[:] = 0.0
    t, at, row, spent = time[0], 0, 0, 0.0
    while t < time[n - 1] and spent < longest:
        while row < n - 2 and time[row + 1] < t:
            row += 1
        span = time[row + 1] - time[row]
        u = min(1.0, max(0.0, (t - time[row]) / span)) if span > 0.0 else 1.0
        share = (1.0 - u) * speed[row] + u * speed[row + 1]
        _need_at(time, need, t + share * lead, row, wanted)
        limited_step(y, v, wanted, limit, period)
        ring[at] = y
        at = (at + 1) % (dead + 1)
        for k in range(3):
            x = ring[at, k]
            now[k] = answer[0] * x + answer[1] * x1[k] + answer[2] * x2[k] - answer[3] * y1[k] - answer[4] * y2[k]
            x2[k], x1[k] = x1[k], x
            y2[k], y1[k] = y1[k], now[k]
        for side in (-1.0, 0.0, 1.0):
            _need_at(time, need, t + side * timing * share, row, here)
            square = (here[0] - now[0]) ** 2 + (here[1] - now[1]) ** 2 + (here[2] - now[2]) ** 2
            error[row] = max(error[row], math.sqrt(square))
        t += share * period
        spent += period
    return spent


@kernel("void(float64[::1], float64[::1], float64)")
def within_rate(time: Float, speed: Float, change_per_s: float) -> None:
    """Lower a speed over the plan's time until it nowhere changes by more than a rate; changed in place.

    Over a plan time dt the robot needs ``dt / s``, so ``d(s^2) / dt <= 2 rate`` holds the rate in real time.
    """
    n = time.shape[0]
    for i in range(1, n):
        most = math.sqrt(speed[i - 1] ** 2 + 2.0 * change_per_s * (time[i] - time[i - 1]))
        speed[i] = min(speed[i], most)
    for i in range(n - 2, -1, -1):
        most = math.sqrt(speed[i + 1] ** 2 + 2.0 * change_per_s * (time[i + 1] - time[i]))
        speed[i] = min(speed[i], most)


@kernel("void(float64[::1], float64[::1], float64, float64, float64[::1])")
def least_about(time: Float, speed: Float, before: float, after: float, out: Float) -> None:
    """Least speed of the rows from ``before`` seconds ahead of each row's time to ``after`` seconds behind it."""
    n = time.shape[0]
    for i in range(n):
        least = speed[i]
        j = i + 1
        while j < n and time[j] <= time[i] + before:
            least = min(least, speed[j])
            j += 1
        j = i - 1
        while j >= 0 and time[j] >= time[i] - after:
            least = min(least, speed[j])
            j -= 1
        out[i] = least


@dataclass(frozen=True, eq=False)
class SpeedPlan:
    """Speeds for a tolerance.

    Attributes:
        speed: (n,) share of the programmed speed.
        error_before_m: (n,) predicted remaining error at full speed.
        error_after_m: (n,) at these speeds.
        extra_s: Time that it costs.
    """

    speed: Float
    error_before_m: Float
    error_after_m: Float
    extra_s: float


def speed_plan(
    time_s: Float, need_m: Float | None, left_m: Float | None, online: OnlineSettings, override: OverrideSettings
) -> SpeedPlan:
    """Speeds at which the predicted remaining error stays within the tolerance, as far as the least speed allows.

    Args:
        time_s: (n,) planned time, not decreasing.
        need_m: (n, 3) correction that the loop will want, part axes; None for none.
        left_m: (n,) error that the program itself is predicted to leave; None for none.
        online: Settings of the loop: limits, delays, lead.
        override: Tolerance, least speed, rate.

    Raises:
        InputError: The program takes more than two hours even at full speed.
    """
    n = len(time_s)
    time = np.ascontiguousarray(time_s, dtype=np.float64)
    need = np.zeros((n, 3)) if need_m is None else np.ascontiguousarray(need_m, dtype=np.float64)
    left = np.zeros(n) if left_m is None else np.ascontiguousarray(left_m, dtype=np.float64)
    dead, answer = robot_answer(online)
    found: Float = np.zeros(n)

    def errors(speed: Float) -> tuple[Float, float]:
        spent = drive(
            time,
            need,
            speed,
            online.period_s,
            online.lead_s,
            online.timing_s,
            dead,
            answer,
            online.translation.packed(),
            _LONGEST_S / override.least * 2.0,
            found,
        )
        return np.maximum(found, left * speed), float(spent)

    if time[-1] - time[0] > _LONGEST_S:
        raise InputError(
            "the program is too long for speeds to be planned",
            value=f"{time[-1] - time[0]:.0f} s",
            limit=f"<= {_LONGEST_S:g} s",
            hint="Split it, or leave out the table [override]",
        )
    before, plain = errors(np.ones(n))
    own: Float = np.ones(n)
    speed: Float = np.ones(n)
    settle = 2.0 * online.delays.correction_s
    after, spent = before, plain
    for _ in range(ROUNDS):
        over = after / override.tolerance_m
        if not np.any((over > 1.0) & (speed > override.least)):
            break
        lower = np.where(
            over > 1.0, np.maximum(override.least, speed * np.clip(np.maximum(over, 1.0) ** -0.5, 0.5, 1.0)), 1.0
        )
        own = np.minimum(own, lower)
        wide: Float = np.empty(n)
        least_about(time, own, override.delay_s + online.lead_s, settle * override.least, wide)
        speed = wide
        within_rate(time, speed, override.change_per_s)
        after, spent = errors(speed)
    return SpeedPlan(speed, before, after, max(0.0, spent - plain))
