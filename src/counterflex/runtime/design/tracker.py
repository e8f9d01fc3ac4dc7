"""Gains of the tracker loop from what is known of the robot, and the margins of any gains, in discrete time.

The robot answers a correction after a dead time, behind a second-order lag, and through its lowest mode, which the
motors shake at its base::

    P(s) = exp(-D s) w0^2 / (s^2 + 2 z0 w0 s + w0^2) (1 + m (-s^2) / (s^2 + 2 z w s + w^2))

D holds everything late: dead time of the correction, age of a tracker sample, half the window it is averaged over. The
loop holds its output over a cycle T, so that P becomes ``P(z)`` exactly, for any D. The controller adds to the
correction ``-C(z)`` times the deviation::

    C(z) = N(z) (Kp + Ki / (1 - 1/z)),   N(z): damps the mode

The published integrator (Mandiola2023) is ``Kp = 0, N = 1``. The zero of the PI cancels the slower pole of the lag.

Source: Astrom and Wittenmark, Computer-Controlled Systems, ch. 3 (sampling with a dead time); margins as in Astrom and
Hagglund, Advanced PID Control, ch. 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG
from counterflex.runtime.design.tracker_plant import Complex, TrackerPlant
from counterflex.runtime.settings import Delays

# Filter that turns speed and acceleration of the program into the correction that undoes the lag behind it.
# The robot follows its program by F and a correction by G, both known to second order::
#
# F = 1 - f1 s + f2 s^2,   1/G = 1 + g1 s + ...,   c = (1/G)(1 - F) r = (f1 s + a s^2) r,   a = g1 f1 - f2
#
# A program that changes its speed at once would then shake the lowest mode as a robot without lag is shaken by it. So
# the motion is led through ``N = (s^2 + 2 z w s + w^2) / (s + w)^2``, which has nothing at the mode, and what N delays
# is read ahead from speed and acceleration::
#
# c = N (1 + k1 s + k2 s^2) r - r,   k1 = f1 + n1,   k2 = a + f1 n1 + n2,   1/N = 1 + n1 s + n2 s^2 + ...
#
# so that a steady speed and a steady acceleration are followed without any error. The position itself is not filtered:
# ``(1 - N) r = 2 (1 - z) w / (s + w)^2 dr/dt``.


def lag_filter(delays: Delays, period_s: float, mode: tuple[float, float] | None) -> Float:
    """Coefficients ``b0 b1 b2`` on the speed (s), ``b0 b1 b2`` on the acceleration (s2), ``a1 a2``.

    Args:
        delays: Of program and correction.
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


FLAT: Final = (1.0, 0.0, 0.0, 0.0, 0.0)
"""Filter that passes everything: ``b0 b1 b2 a1 a2``."""
_POINTS: Final = 1500
_LOWEST_HZ: Final = 1e-3


@dataclass(frozen=True)
class TrackerGains:
    """A controller of the tracker loop."""

    integral: float  # Ki per cycle
    proportional: float = 0.0  # Kp
    notch: tuple[float, float, float, float, float] = FLAT  # ``b0 b1 b2 a1 a2`` of N

    def response(self, frequency_hz: Float, period_s: float) -> Complex:
        """C at ``z = exp(2 pi i f T)``, (k,) complex."""
        back = np.exp(-2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) * period_s)
        b0, b1, b2, a1, a2 = self.notch
        shape = (b0 + b1 * back + b2 * back**2) / (1.0 + a1 * back + a2 * back**2)
        out: Complex = shape * (self.proportional + self.integral / (1.0 - back))
        return out

    def sampled(self) -> tuple[Float, Float, Float, float]:
        """``x' = A x + B e, c = C x + D e``: (3, 3), (3,), (3,) and D, c being what is taken off the correction."""
        b0, b1, b2, a1, a2 = self.notch
        gain = self.proportional + self.integral
        # Filter in direct form II transposed: f = b0 e + s1; then the sum.
        A = np.array([[-a1, 1.0, 0.0], [-a2, 0.0, 0.0], [self.integral, 0.0, 1.0]])
        B = np.array([b1 - a1 * b0, b2 - a2 * b0, self.integral * b0])
        return A, B, np.array([gain, 0.0, 1.0]), gain * b0


@dataclass(frozen=True)
class Margins:
    """Distance of a loop from instability."""

    crossover_hz: float  # where the open loop's gain falls through 1; NaN where it never is 1
    phase_rad: float  # least phase margin over all crossings; infinite without one
    gain: float  # least factor > 1 on the gains that makes it unstable
    sensitivity: float  # largest amplification of a deviation, Ms
    stable: bool  # all poles of the closed loop lie inside the unit circle

    @property
    def gain_db(self) -> float:
        """Gain margin in dB."""
        return 20.0 * math.log10(self.gain)

    @property
    def phase_deg(self) -> float:
        """Phase margin in deg."""
        return self.phase_rad / DEG

    def meets(self, goals: DesignGoals) -> bool:
        """Return whether the margins are at least those wanted."""
        return (
            self.stable
            and self.phase_rad >= goals.phase_rad
            and self.gain >= goals.gain
            and self.sensitivity <= goals.sensitivity
        )


@dataclass(frozen=True)
class DesignGoals:
    """Margins that a design keeps."""

    phase_rad: float = 50.0 * DEG  # least phase margin
    gain: float = 10.0**0.5  # least gain margin, a factor
    sensitivity: float = 1.6  # largest Ms
    mode_off: float = 0.15  # relative error of the mode's frequency, both ways, at which they still hold
    lag_off: float = 0.10  # relative error of lag and delay, likewise

    def neighbours(self, plant: TrackerPlant) -> tuple[TrackerPlant, ...]:
        """The robot as known, and off from it by what these goals allow for."""
        out = [plant]
        for mode in (-1.0, 0.0, 1.0) if plant.mode_per_s > 0.0 else (0.0,):
            for lag in (-1.0, 0.0, 1.0):
                if mode == 0.0 and lag == 0.0:
                    continue
                slower = 1.0 + lag * self.lag_off
                out.append(
                    replace(
                        plant,
                        mode_per_s=plant.mode_per_s * (1.0 + mode * self.mode_off),
                        natural_per_s=plant.natural_per_s / slower,
                        delay_s=plant.delay_s * slower,
                    )
                )
        return tuple(out)


def margins_of(response: Complex, frequency_hz: Float, stable: bool) -> Margins:
    """Margins of an open loop from its frequency response.

    Args:
        response: (k,) L at rising frequencies, fine enough that neighbours differ little.
        frequency_hz: (k,).
        stable: Whether the closed loop is.
    """
    size, turned = np.abs(response), np.unwrap(np.angle(response))
    crossings = np.flatnonzero((size[:-1] >= 1.0) != (size[1:] >= 1.0))
    crossover, phase = math.nan, math.inf
    for n, k in enumerate(crossings):
        u = math.log(size[k]) / math.log(size[k] / size[k + 1])
        angle = turned[k] + u * (turned[k + 1] - turned[k])
        distance = abs((angle + math.pi + math.pi) % (2.0 * math.pi) - math.pi)
        phase = min(phase, distance)
        if n == 0:
            crossover = float(frequency_hz[k] + u * (frequency_hz[k + 1] - frequency_hz[k]))
    wound = np.floor((turned + math.pi) / (2.0 * math.pi))
    gain = math.inf
    for k in np.flatnonzero(wound[:-1] != wound[1:]):
        line = math.pi * (2.0 * max(wound[k], wound[k + 1]) - 1.0)
        u = (line - turned[k]) / (turned[k + 1] - turned[k])
        at = size[k] ** (1.0 - u) * size[k + 1] ** u
        if at < 1.0:
            gain = min(gain, 1.0 / at)
    return Margins(crossover, phase, gain, float(np.max(1.0 / np.abs(1.0 + response))), stable)


def grid(period_s: float) -> Float:
    """Frequencies from a thousandth of a Hz to just below half the sampling rate, evenly spread in ratio."""
    out: Float = np.geomspace(_LOWEST_HZ, 0.4999 / as_positive("period_s", period_s), _POINTS)
    return out


def closed_loop_radius(plant: TrackerPlant, gains: TrackerGains) -> float:
    """Largest magnitude of the closed loop's poles; below 1 is stable."""
    A, B, C = plant.sampled()
    F, G, H, D = gains.sampled()
    # u = -(H x_c + D y), y = C x
    top = np.concatenate([A - np.outer(B, D * C), -np.outer(B, H)], axis=1)
    bottom = np.concatenate([np.outer(G, C), F], axis=1)
    return float(np.max(np.abs(np.linalg.eigvals(np.concatenate([top, bottom])))))


def margins(plant: TrackerPlant, gains: TrackerGains) -> Margins:
    """Margins of a controller on a robot."""
    f = grid(plant.period_s)
    response = plant.response(f) * gains.response(f, plant.period_s)
    # The sum leaves one pole on the circle's inside; 1 itself is the integrator without a loop.
    return margins_of(response, f, closed_loop_radius(plant, gains) < 1.0 - 1e-12)


def observer_response(plant: TrackerPlant, drift: float, noise: float, frequency_hz: Float) -> Complex:
    """The observer as a controller, in its steady state: (k,) C such that it takes ``C e`` off the correction.

    With L its gain and M the robot's answer as it is modelled, ``C = L / (1 - (1 - L)/z - L M)``.

    Args:
        plant: Its lag and delay are what the observer uses, its mode is not.
        drift: Variance that the deviation gains per cycle.
        noise: Variance of a sample.
        frequency_hz: (k,).
    """
    gain = observer_gain(drift, noise)
    z = np.exp(2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) * plant.period_s)
    model = replace(plant, mode_per_s=0.0).response(frequency_hz)
    out: Complex = gain / (1.0 - (1.0 - gain) / z - gain * model)
    return out


def observer_gain(drift: float, noise: float) -> float:
    """Steady gain of the observer: of ``P = Q + P R / (P + R)``, ``L = P / (P + R)``.

    Args:
        drift: Q, per cycle.
        noise: R, per sample; one sample each cycle.
    """
    q = as_positive("drift", drift) / as_positive("noise", noise)
    before = 0.5 * (q + math.sqrt(q * q + 4.0 * q))
    return before / (before + 1.0)


def notch_at(mode_per_s: float, damping: float, period_s: float) -> tuple[float, float, float, float, float]:
    """Filter that takes a mode out: ``(s^2 + 2 z w s + w^2) / (s^2 + 2 w s + w^2)``, bilinear, exact at w.

    ``mode_per_s``: w, rad/s, below half the sampling rate; ``damping``: z of the mode.

    Raises:
        InputError: The mode lies at or above half the sampling rate.
    """
    if mode_per_s * period_s >= math.pi:
        raise InputError("the mode is too fast for the loop", value=mode_per_s, limit=math.pi / period_s)
    k = math.tan(0.5 * mode_per_s * period_s)
    norm = 1.0 + 2.0 * k + k * k
    middle = 2.0 * (k * k - 1.0) / norm
    return (
        (1.0 + 2.0 * damping * k + k * k) / norm,
        middle,
        (1.0 - 2.0 * damping * k + k * k) / norm,
        middle,
        (1.0 - 2.0 * k + k * k) / norm,
    )


@lru_cache(maxsize=32)
def design(plant: TrackerPlant, goals: DesignGoals | None = None, *, notch: bool = True) -> TrackerGains:
    """Largest gains that keep the margins, on the robot as known and on its neighbours; found once per process.

    Args:
        goals: Margins; None are 50 deg, 10 dB, Ms 1.6 with the mode off by 15 % and lag and delay by 10 %.
        notch: Take the mode out with a filter.

    Returns:
        A PI whose zero cancels the slower pole of the lag.

    Raises:
        ModelError: Not even the smallest gain keeps the margins.
    """
    requested = goals if goals is not None else DesignGoals()
    shape = FLAT
    if notch and plant.mode_per_s > 0.0:
        shape = notch_at(plant.mode_per_s, plant.mode_damping, plant.period_s)
    ratio = plant.slow_s / plant.period_s - 0.5  # the sum has half a cycle of its own
    robots = requested.neighbours(plant)
    f = grid(plant.period_s)
    answers = [robot.response(f) for robot in robots]
    fits = partial(_fits, max(0.0, ratio), shape, list(zip(robots, answers, strict=True)), f, requested)
    low = 1e-5
    if not fits(low):
        raise ModelError("no gain keeps the margins of the tracker loop", value=f"delay {plant.delay_s:g} s")
    high = low
    while high < 1.0 and fits(2.0 * high):
        high *= 2.0
    gain = largest_that(fits, high, 2.0 * high, 20)
    return TrackerGains(gain, max(0.0, ratio) * gain, shape)


def _fits(
    ratio: float,
    notch: tuple[float, float, float, float, float],
    robots: list[tuple[TrackerPlant, Complex]],
    f: Float,
    goals: DesignGoals,
    integral: float,
) -> bool:
    """Return whether this integral gain keeps the margins on every robot."""
    gains = TrackerGains(integral, ratio * integral, notch)
    own = gains.response(f, robots[0][0].period_s)
    return all(
        margins_of(answer * own, f, stable=True).meets(goals) and closed_loop_radius(robot, gains) < 1.0 - 1e-12
        for robot, answer in robots
    )


def largest_that(fits: Callable[[float], bool], low: float, high: float, rounds: int) -> float:
    """Largest value that fits, by halving the ratio of ``high`` to ``low``, which fits, ``rounds`` times."""
    for _ in range(rounds):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
