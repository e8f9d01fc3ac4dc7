"""At which speed can the correction follow? The plan is driven through limits, dead time and lag of the correction.

The correction that the plan wants at every place is commanded ahead of time, as the loop does: shaped for what it
passes (:class:`counterflex.signals.preview.Ahead`), or read ahead by the lead. It goes through limits of speed and
acceleration, the dead time and the second-order lag of the robot's answer, and the arm's mode where it is known. What
is missing of it where and when it is needed, taken over the uncertainty of timing, is the remaining error. Where it is
beyond the tolerance the program goes slower: everything then changes more slowly in time, while lag and limits stay,
and the force is smaller. Repeated until it fits or the least speed is reached; the largest change of speed per second
is kept by beginning earlier.

A compensated program leaves an error that the plan has predicted already (``left_m``); what of it is lag and what is
force changes with the speed at most in proportion, and so it is lowered here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Records, record, records
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.settings import OnlineSettings, robot_answer
from counterflex.signals.limiter import limited_step
from counterflex.signals.preview import Ahead, Mode

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


@kernel("void(float64[::1], float64[::1], float64[:, ::1])")
def _passed(x: Float, answer: Float, memory: Float) -> None:
    """Pass (3,) values through a second-order lag, in place; ``memory`` (4, 3) last two inputs and outputs."""
    for k in range(3):
        y = answer[0] * x[k] + answer[1] * memory[0, k] + answer[2] * memory[1, k]
        y -= answer[3] * memory[2, k] + answer[4] * memory[3, k]
        memory[1, k], memory[0, k] = memory[0, k], x[k]
        memory[3, k], memory[2, k] = memory[2, k], y
        x[k] = y


LOOP: Final = record(
    period=float,  # cycle, s
    lead=float,  # how much ahead the commanded correction is read, s
    timing=float,  # uncertainty of timing, s
    longest=float,  # ends there, s
    dead=int,  # cycles of dead time
    limit=(float, 3),  # of the correction: radius, speed, acceleration
    answer=(float, 5),  # b0 b1 b2 a1 a2 of the robot's lag
    arm=(float, 5),  # of the arm's mode, which the correction passes too
    arm_share=float,  # of the need that swings through that mode
)
"""The loop as a plan is driven through it."""


@kernel("void(float64[::1], float64[:, ::1], float64[:, ::1], Loop[::1], float64[::1])", Loop=LOOP, entry=True)
def drive(time: Float, need: Float, sent: Float, loops: Records, error: Float) -> None:
    """Remaining error of a plan.

    Args:
        time: (n,) s, not decreasing.
        need: (n, 3) correction that is needed there, m.
        sent: (n, 3) correction that is commanded, m.
        loops: (1,) LOOP.
        error: (n,) written: largest error from each row to the next, m.
    """
    d = loops[0]
    n = time.shape[0]
    y, v, requested, here, swung, now = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    of_robot, of_arm, of_need = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((3, 4, 3))
    ring = np.zeros((d.dead + 1, 3))
    error[:] = 0.0
    t, at, row = time[0], 0, 0
    while t < time[n - 1] and t - time[0] < d.longest:
        while row < n - 2 and time[row + 1] < t:
            row += 1
        _need_at(time, sent, t + d.lead, row, requested)
        limited_step(y, v, requested, d.limit[:], d.period)
        ring[at] = y
        at = (at + 1) % (d.dead + 1)
        now[:] = ring[at]
        _passed(now, d.answer[:], of_robot)
        _passed(now, d.arm[:], of_arm)
        for side in range(3):
            _need_at(time, need, t + (side - 1.0) * d.timing, row, here)
            swung[:] = here
            _passed(swung, d.arm[:], of_need[side])
            square = 0.0
            for k in range(3):
                square += ((1.0 - d.arm_share) * here[k] + d.arm_share * swung[k] - now[k]) ** 2
            error[row] = max(error[row], math.sqrt(square))
        t += d.period


@kernel("void(float64[::1], float64[::1], float64)", entry=True)
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


@kernel("void(float64[::1], float64[::1], float64, float64, float64[::1])", entry=True)
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
    """Speeds for a tolerance."""

    speed: Float  # (n,) share of the programmed speed
    error_before_m: Float  # (n,) predicted remaining error at full speed
    error_after_m: Float  # (n,) at these speeds
    time_s: Float  # (n,) when the rows are reached at these speeds
    extra_s: float  # time that it costs


def slowed_time(time_s: Float, speed: Float) -> Float:
    """(n,) s, when the rows of a plan are reached at shares of its speed, linear between them over the plan's time.

    Args:
        time_s: (n,) planned, not decreasing.
        speed: (n,) above 0.
    """
    step = np.diff(time_s) * 2.0 / (speed[1:] + speed[:-1])
    out: Float = time_s[0] + np.concatenate([[0.0], np.cumsum(step)])
    return out


def _sampled(mode: Mode, period: float) -> Float:
    """(5,) b0 b1 b2 a1 a2 of a mode, bilinear transform as of the robot's answer."""
    k = mode.omega_rad_s * period / 2.0
    norm = 1.0 + 2.0 * mode.damping_ratio * k + k * k
    b = k * k / norm
    return np.array([b, 2.0 * b, b, 2.0 * (k * k - 1.0) / norm, (1.0 - 2.0 * mode.damping_ratio * k + k * k) / norm])


def _errors(
    time: Float, need: Float, residual: Float, loops: Records, ahead: Ahead | None, exponent: float, speed: Float
) -> tuple[Float, Float]:
    """(n,) m, remaining error at shares of the programmed speed, and (n,) s, when the rows are then reached."""
    when = slowed_time(time, speed)
    smaller = np.ascontiguousarray(need * speed[:, None] ** exponent)
    sent = smaller if ahead is None else np.ascontiguousarray(ahead.command(smaller, when))
    error: Float = np.zeros(len(time))
    drive(when, smaller, sent, loops, error)
    return np.maximum(error, residual * speed), when


def speed_plan(
    time_s: Float,
    need_m: Float | None,
    residual_m: Float | None,
    online: OnlineSettings,
    override: OverrideSettings,
    ahead: Ahead | None = None,
    exponent: float = 0.0,
) -> SpeedPlan:
    """Speeds at which the predicted remaining error stays within the tolerance, as far as the least speed allows.

    Args:
        time_s: (n,) planned time, not decreasing.
        need_m: (n, 3) correction that the loop will want, part axes; None for none.
        residual_m: (n,) error that the program itself is predicted to leave; None for none.
        online: Settings of the loop: limits, delays, lead.
        override: Tolerance, least speed, rate.
        ahead: How the loop shapes what it commands; None: it reads the need ahead by the lead.
        exponent: Of the force, and so of the need, in the feed.

    Raises:
        InputError: The program takes more than two hours even at full speed.
    """
    n = len(time_s)
    time = np.ascontiguousarray(time_s, dtype=np.float64)
    need = np.zeros((n, 3)) if need_m is None else np.ascontiguousarray(need_m, dtype=np.float64)
    residual = np.zeros(n) if residual_m is None else np.ascontiguousarray(residual_m, dtype=np.float64)
    through = records(LOOP)
    loop = through[0]
    loop.period, loop.timing, loop.limit = online.period_s, online.timing_s, online.translation.packed()
    loop.dead, loop.answer = robot_answer(online)
    loop.lead = online.lead_s if ahead is None else 0.0
    loop.arm = np.array([1.0, 0.0, 0.0, 0.0, 0.0]) if ahead is None else _sampled(ahead.modes[0], online.period_s)
    loop.arm_share = 0.0 if ahead is None else ahead.arm_share
    loop.longest = _LONGEST_S / override.least * 2.0
    shaped = None if need_m is None else ahead
    errors = partial(_errors, time, need, residual, through, shaped, exponent)
    if time[-1] - time[0] > _LONGEST_S:
        raise InputError(
            "the program is too long for speeds to be planned",
            value=f"{time[-1] - time[0]:.0f} s",
            limit=f"<= {_LONGEST_S:g} s",
            hint="Split it, or leave out the table [override]",
        )
    before, when = errors(np.ones(n))
    own: Float = np.ones(n)
    speed: Float = np.ones(n)
    settle = 2.0 * online.delays.correction_s
    after = before
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
        after, when = errors(speed)
    return SpeedPlan(speed, before, after, when, max(0.0, float(when[-1] - time[-1])))
