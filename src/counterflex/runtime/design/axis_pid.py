"""Gains of the PID of an axis from dead time, lag and lowest mode, with margins, in discrete time.

An axis answers a correction as :class:`counterflex.runtime.design.tracker_plant.TrackerPlant` says: dead time,
second-order lag, and the mode that the motor shakes. Its encoder sees the motor, not the link: a drive that holds its
motor against the swing shows nothing of the mode, one that yields a share of it (``mode_share``). So every margin has
to hold for both, and for dead time, lag and mode that are off by as much as the goals say.

What is sent is ``u = r + C (r - y)``, so the angle in effect follows what is wanted by ``P (1 + C) / (1 + P C)``. Of
all ratios of a table between the gains, and the largest gain each that keeps the margins, the one is taken with the
least integral of the absolute error after a step, on the worst of the robots.

Source: Astrom and Hagglund, Advanced PID Control, ch. 4 and 6 (margins, IAE under a bound of Ms); the closed loop's
poles are those of the exactly sampled plant (Astrom and Wittenmark, Computer-Controlled Systems, ch. 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG, MS
from counterflex.runtime.axis_gains import AxisGains
from counterflex.runtime.design.tracker import DesignGoals, Margins, largest_that, margins_of
from counterflex.runtime.design.tracker_plant import Complex, TrackerPlant

_POINTS: Final = 500
_LOWEST_HZ: Final = 0.02
_INSIDE: Final = 1.0 - 1e-12
_RATES: Final = (0.0, 0.7, 1.4)
"""Derivative time by the lag's own ``1 / (2 z0 w0)``, which its second pole has."""
_SUMS: Final = (1.5, 4.0, 10.0)
"""Integral time by dead time and lag together."""
_FILTER: Final = 0.2
"""Low-pass of the derivative by the derivative time; at least a cycle."""
_LEAST: Final = 0.02
_MOST: Final = 20.0
_STEP_S: Final = 1.0


@dataclass(frozen=True)
class AxisDesign:
    """A controller and what it holds."""

    gains: AxisGains  # of the axis
    margins: Margins  # the worst over all robots that it was designed for
    radius: float  # largest magnitude of the closed loop's poles over them; below 1 is stable
    late_s: float  # integral of the absolute error after a step of what is wanted, per step, on the robot as known
    late_alone_s: float  # the same without the controller


def robots(plant: TrackerPlant, goals: DesignGoals) -> tuple[TrackerPlant, ...]:
    """Every robot that margins hold for: as known first, its neighbours, and all once more with the mode unseen."""
    seen = goals.neighbours(plant)
    return seen if plant.mode_per_s == 0.0 else (*seen, *goals.neighbours(replace(plant, mode_per_s=0.0)))


def radius(plant: TrackerPlant, gains: AxisGains) -> float:
    """Largest magnitude of the closed loop's poles."""
    return float(np.max(np.abs(np.linalg.eigvals(_closed(plant, gains)[0]))))


def worst_margins(plants: tuple[TrackerPlant, ...], gains: AxisGains) -> tuple[Margins, float]:
    """Margins that hold on every robot, and the largest magnitude of a pole.

    Args:
        plants: The first gives the crossover.
    """
    f = _grid(plants[0].period_s)
    return _worst(plants, [plant.response(f) for plant in plants], gains, f)


def step_error(plant: TrackerPlant, gains: AxisGains, *, seconds: float = _STEP_S) -> float:
    """``integral |r - y| dt`` after a step r = 1 of the angle wanted, s.

    ``gains``: of the axis; all zero: the correction is sent as it is. ``seconds``: how long it is looked at.
    """
    A, B, C = _closed(plant, gains)
    x, total = np.zeros(len(B)), 0.0
    for _ in range(round(seconds / plant.period_s)):
        total += abs(1.0 - float(C @ x)) * plant.period_s
        x = A @ x + B
    return total


def design(plant: TrackerPlant, goals: DesignGoals | None = None, most_rad: float = 1e-3) -> AxisDesign:
    """The controller of an axis.

    Args:
        goals: Margins; None are those of :class:`counterflex.runtime.design.tracker.DesignGoals`.
        most_rad: Largest angle that it adds.

    Raises:
        ModelError: No gain keeps the margins and makes the answer quicker.
    """
    requested = DesignGoals() if goals is None else goals
    plants, f = robots(plant, requested), _grid(plant.period_s)
    answers = [one.response(f) for one in plants]
    alone = step_error(plant, AxisGains())
    best: tuple[float, AxisGains] | None = None
    lag = 1.0 / (2.0 * plant.damping * plant.natural_per_s)
    for rate in _RATES:
        for total in _SUMS:
            shape = _shape(rate * lag, total * (plant.delay_s + plant.slow_s), plant.period_s, most_rad)
            fits = partial(_fits, shape, plants, answers, f, requested)
            if not fits(_LEAST):
                continue
            fitting = _scaled(shape, largest_that(fits, _LEAST, _MOST, 8))
            late = max(step_error(one, fitting) for one in (plant, plants[-1]))
            if best is None or late < best[0]:
                best = late, fitting
    if best is None or step_error(plant, best[1]) >= alone:
        raise ModelError(
            "no gain of the axis keeps its margins and makes its answer quicker",
            value=f"dead time {plant.delay_s / MS:.0f} ms, lag {plant.slow_s / MS:.0f} ms, mode "
            f"{plant.mode_per_s / (2.0 * math.pi):.1f} Hz",
            limit=f"phase {requested.phase_rad / DEG:.0f} deg, gain {20.0 * math.log10(requested.gain):.0f} dB, Ms "
            f"{requested.sensitivity:g}",
            hint="Leave its gains at 0, or ask for smaller margins ([online] phase_margin_deg, gain_margin_db)",
        )
    margins, largest = _worst(plants, answers, best[1], f)
    return AxisDesign(best[1], margins, largest, step_error(plant, best[1]), alone)


def _shape(rate_s: float, total_s: float, period_s: float, most_rad: float) -> AxisGains:
    low_pass = max(period_s, _FILTER * rate_s) if rate_s > 0.0 else 0.0
    return AxisGains(1.0, 1.0 / total_s, rate_s, low_pass, most_rad)


def _scaled(shape: AxisGains, gain: float) -> AxisGains:
    return replace(
        shape,
        proportional=gain * shape.proportional,
        integral_per_s=gain * shape.integral_per_s,
        derivative_s=gain * shape.derivative_s,
    )


def _fits(
    shape: AxisGains,
    plants: tuple[TrackerPlant, ...],
    answers: list[Complex],
    f: Float,
    goals: DesignGoals,
    gain: float,
) -> bool:
    """Return whether the shape with this gain keeps the margins on every robot."""
    own = _scaled(shape, gain)
    response = own.response(f, plants[0].period_s)
    kept = all(margins_of(answer * response, f, stable=True).meets(goals) for answer in answers)
    return kept and all(radius(plant, own) < _INSIDE for plant in plants)


def _worst(
    plants: tuple[TrackerPlant, ...], answers: list[Complex], gains: AxisGains, f: Float
) -> tuple[Margins, float]:
    response = gains.response(f, plants[0].period_s)
    largest = max(radius(plant, gains) for plant in plants)
    each = [margins_of(answer * response, f, stable=True) for answer in answers]
    worst = Margins(
        each[0].crossover_hz,
        min(one.phase_rad for one in each),
        min(one.gain for one in each),
        max(one.sensitivity for one in each),
        largest < _INSIDE,
    )
    return worst, largest


def _closed(plant: TrackerPlant, gains: AxisGains) -> tuple[Float, Float, Float]:
    """Closed loop ``x' = A x + B r, y = C x`` of ``u = r + C (r - y)``: the plant's state, then the controller's."""
    A, B, C = _sampled(plant)
    F, G, H, D = gains.sampled(plant.period_s)
    n, m = len(B), len(G)
    out, into, seen = np.zeros((n + m, n + m)), np.zeros(n + m), np.zeros(n + m)
    out[:n, :n] = A - np.outer(B, D * C)
    out[:n, n:] = np.outer(B, H)
    out[n:, :n] = -np.outer(G, C)
    out[n:, n:] = F
    into[:n], into[n:] = (1.0 + D) * B, G
    seen[:n] = C
    if gains.idle:  # without a controller its sum is no pole of anything
        return A, B, C
    return out, into, seen


@lru_cache(maxsize=256)
def _sampled(plant: TrackerPlant) -> tuple[Float, Float, Float]:
    return plant.sampled()


def _grid(period_s: float) -> Float:
    out: Float = np.geomspace(_LOWEST_HZ, 0.4999 / period_s, _POINTS)
    return out
