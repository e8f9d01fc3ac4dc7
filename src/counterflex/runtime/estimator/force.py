"""Force that the correction is computed from: measured, blended with the predicted one, or the predicted one scaled.

Forces of a robot's flange sensor come late (filters), predicted ones come when they are wanted. Two ways to join them:

- *pilot control* (Haehn2020 section 2.8): where the two differ by more than a threshold, a change of direction or an
  exit is assumed, and the signal is blended linearly into the prediction; otherwise the measured force is trusted. A
  measured force is late; where the plan says what to command ahead of time, it is brought forward by what the plan
  changes meanwhile: ``measured + m (ahead - predicted through the same filters)``, m the share of the force that is
  there.
- *scale*: a Kalman filter per direction estimates by which factor the measured force exceeds the predicted one, delayed
  alike, and the prediction ahead of time is multiplied by it. What changes slowly (wear, material, a wrong constant)
  is learnt in the cut; what changes fast (exits) is taken from the plan.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel

LEAST_FORCE_N: Final = 20.0
"""Predicted force below which a direction tells nothing about its factor."""


@kernel("float64(float64[::1], float64[::1], float64, float64, float64)", entry=True)
def blend(measured: Float, predicted: Float, share: float, threshold_n: float, step: float) -> float:
    """Pilot control: how much of the prediction is blended in.

    Args:
        measured: (6,) N, N m, filtered.
        predicted: (6,) with lead.
        share: 0..1 of the prediction in the last cycle.
        threshold_n: Difference of forces above which the prediction is blended in.
        step: Change of the share per cycle: period by blending time.

    Returns:
        The new share; the force to correct for is ``(1 - share) measured + share predicted``.
    """
    square = 0.0
    for k in range(3):
        square += (predicted[k] - measured[k]) ** 2
    return min(1.0, share + step) if square > threshold_n * threshold_n else max(0.0, share - step)


@kernel("float64(float64[::1], float64[::1])")
def met_share(measured: Float, predicted: Float) -> float:
    """Share of a predicted force that is there: ``F_m . F_p / F_p . F_p``, 0..1; 1 where next to nothing is predicted.

    A program that the operator slows or stops leaves less force than planned, and less of what the plan changes.

    Args:
        measured: (6,) N, N m.
        predicted: (6,) through the same filters.
    """
    both = square = 0.0
    for k in range(3):
        both += measured[k] * predicted[k]
        square += predicted[k] * predicted[k]
    return 1.0 if square < LEAST_FORCE_N * LEAST_FORCE_N else min(1.0, max(0.0, both / square))


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def learn_scale(
    measured: Float, predicted: Float, before: Float, frame: Float, tuning: Float, scale: Float, variance: Float
) -> None:
    """One cycle of the Kalman filter for the factors of the force along three directions.

    ``k' = k + K (y - h k)``, ``K = P h / (h^2 P + R)``, ``P' = (1 - K h) P + Q`` per direction with y the measured and
    h the predicted force through the same filters. ``R = n (sigma^2 + (tau dh/dt)^2)``: while the force changes, an
    uncertainty of timing makes the measurement worth little; n cycles in which an error lasts tell as much as one.
    Taken for independent, they would let the factor follow every swing of the arm, which corrections then feed.

    Args:
        measured: (6,) filtered.
        predicted: (6,) through the same filters.
        before: (6,) predicted of the last cycle.
        frame: (9,) rows: unit vectors of the three directions, part axes.
        tuning: (4,) sqrt(n) sigma N, sqrt(n) tau / period, Q per cycle, largest variance.
        scale: (3,) factors; changed.
        variance: (3,) theirs; changed.
    """
    for d in range(3):
        a, b, c = frame[3 * d], frame[3 * d + 1], frame[3 * d + 2]
        y = a * measured[0] + b * measured[1] + c * measured[2]
        h = a * predicted[0] + b * predicted[1] + c * predicted[2]
        change = h - (a * before[0] + b * before[1] + c * before[2])
        variance[d] = min(variance[d] + tuning[2], tuning[3])
        if abs(h) < LEAST_FORCE_N or not math.isfinite(y):
            continue
        noise = tuning[0] * tuning[0] + (tuning[1] * change) ** 2
        gain = variance[d] * h / (h * h * variance[d] + noise)
        scale[d] += gain * (y - h * scale[d])
        variance[d] *= 1.0 - gain * h


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def scaled(predicted: Float, frame: Float, scale: Float, out: Float) -> None:
    """The predicted wrench with the factors of its three directions; moments take the factor of the whole force.

    Args:
        predicted: (6,).
        frame: (9,) as in :func:`learn_scale`.
        scale: (3,).
        out: (6,) written.
    """
    before = after = 0.0
    for k in range(3):
        out[k] = 0.0
    for d in range(3):
        a, b, c = frame[3 * d], frame[3 * d + 1], frame[3 * d + 2]
        h = a * predicted[0] + b * predicted[1] + c * predicted[2]
        before += h * h
        after += (h * scale[d]) ** 2
        out[0] += scale[d] * h * a
        out[1] += scale[d] * h * b
        out[2] += scale[d] * h * c
    ratio = math.sqrt(after / before) if before > 0.0 else 1.0
    for k in range(3, 6):
        out[k] = ratio * predicted[k]
