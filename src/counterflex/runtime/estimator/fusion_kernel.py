"""One Kalman filter for all that is measured: factors of the predicted force, error of the elastic model, offset.

State, nine numbers that change slowly::

    k (3)  measured by predicted force: along the feed, across it, along the tool
    a (3)  share of the predicted deflection that the force does not explain (compliance that is wrong)
    b (3)  deviation that does not go with the force (drift, play, frames), m, part axes

With h_d the predicted force along direction d, delayed like the measured one, and D_d the deflection under it::

    force      y_d = h_d k_d
    tracker    n . (deviation - correction in effect) = sum_d n . D_d (k_d + a_d) + n . b
    currents   tau_j = sum_d (J^T w_d)_j k_d

All are linear, each scalar is taken by itself, the covariance in Joseph form: it stays symmetric and positive. What is
slow in between has no memory of order: a late sample is taken with the D of its own time and counts as if it had come
in time; what the state may have drifted since is added to its variance. A scalar farther off than ``gate`` standard
deviations counts only with the variance that would explain it: one wild value moves nothing much, a lasting change is
followed.

Source: Joseph form and sequential scalar updates: Bierman 1977, "Factorization Methods for Discrete Sequential
Estimation".
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.estimator.force import LEAST_FORCE_N
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

N: Final = 9
"""Numbers of the state."""


@kernel("float64(Fusion, float64, float64, float64)", **LOOP_TYPES)
def update(fusion: Record, y: float, variance: float, gate: float) -> float:
    """Take one scalar ``y = H x + noise`` with the row H that stands in ``fusion``.

    Args:
        fusion: State of the filter; changed.
        y: Measurement.
        variance: Of its noise, > 0.
        gate: Standard deviations beyond which the noise is taken larger.

    Returns:
        Innovation by its standard deviation, before the gate.
    """
    innovation, spread = y, 0.0
    for i in range(N):
        total = 0.0
        for j in range(N):
            total += fusion.covariance[i, j] * fusion.row[j]
        fusion.product[i] = total
    for i in range(N):
        innovation -= fusion.row[i] * fusion.estimate[i]
        spread += fusion.row[i] * fusion.product[i]
    s = spread + variance
    normalised = innovation / math.sqrt(s)
    if normalised * normalised > gate * gate:
        s = innovation * innovation / (gate * gate)
        variance = s - spread
    for i in range(N):
        fusion.gain[i] = fusion.product[i] / s
        fusion.estimate[i] += fusion.gain[i] * innovation
    # Joseph form in rank-one steps: W = (1 - K H) P, then W (1 - K H)^T + K R K^T.
    for i in range(N):
        along = 0.0
        for j in range(N):
            fusion.covariance[i, j] -= fusion.gain[i] * fusion.product[j]
            along += fusion.covariance[i, j] * fusion.row[j]
        for j in range(N):
            fusion.covariance[i, j] += (fusion.gain[i] * variance - along) * fusion.gain[j]
    for i in range(N):
        for j in range(i):
            mean = 0.5 * (fusion.covariance[i, j] + fusion.covariance[j, i])
            fusion.covariance[i, j] = fusion.covariance[j, i] = mean
    return normalised


@kernel("void(Fusion, float64[::1], float64[::1], float64, float64)", **LOOP_TYPES)
def drift(fusion: Record, growth: Float, largest: Float, turn_growth: float, turn_largest: float) -> None:
    """One cycle without a measurement: variances grow, not beyond what was not known at the start.

    Args:
        fusion: State of the filter; changed.
        growth: (3,) of k, a, b per cycle: 1, 1, m2.
        largest: (3,) variances at the start.
        turn_growth: Of the orientation's offset, rad2.
    """
    for i in range(N):
        if fusion.covariance[i, i] + growth[i // 3] <= largest[i // 3]:
            fusion.covariance[i, i] += growth[i // 3]
    fusion.turn_variance = min(fusion.turn_variance + turn_growth, turn_largest)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def shares(w: Float, frame: Float, out: Float) -> None:
    """Split a wrench into the parts that belong to three directions; their sum is the wrench.

    The force by its components, the moment in proportion to their squares.

    Args:
        w: (6,) N, N m about the TCP, part axes.
        frame: (9,) rows: unit vectors of the directions, part axes.
        out: (18,) three wrenches; written.
    """
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    for d in range(3):
        a, b, c = frame[3 * d], frame[3 * d + 1], frame[3 * d + 2]
        h = a * w[0] + b * w[1] + c * w[2]
        out[6 * d], out[6 * d + 1], out[6 * d + 2] = h * a, h * b, h * c
        part = h * h / square if square > 0.0 else 1.0 / 3.0
        for k in range(3, 6):
            out[6 * d + k] = part * w[k]


@kernel("void(Fusion, float64[::1], float64[::1], float64, float64[::1])", **LOOP_TYPES)
def fused_load(fusion: Record, w: Float, frame: Float, without: float, out: Float) -> None:
    """Wrench whose deflection is the expected one: ``sum_d (k_d + a_d - without) w_d``.

    Args:
        fusion: State of the filter.
        w: (6,) predicted, ahead of time.
        frame: (9,) directions.
        without: 1 where the program contains the correction of the predicted deflection, else 0.
        out: (6,) written; the first 18 numbers of D are not touched.
    """
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    for k in range(6):
        out[k] = 0.0
    for d in range(3):
        a, b, c = frame[3 * d], frame[3 * d + 1], frame[3 * d + 2]
        h = a * w[0] + b * w[1] + c * w[2]
        factor = fusion.estimate[d] + fusion.estimate[3 + d] - without
        part = h * h / square if square > 0.0 else 1.0 / 3.0
        out[0] += factor * h * a
        out[1] += factor * h * b
        out[2] += factor * h * c
        for k in range(3, 6):
            out[k] += factor * part * w[k]


@kernel("void(Fusion, float64[::1], float64[::1])", **LOOP_TYPES)
def bend(fusion: Record, C: Float, R_base_part: Float) -> None:
    """Deflection D of the three wrenches that stand in its place: ``R^T C R w``, part axes.

    Args:
        fusion: State of the filter with three wrenches in D; changed to deflections, m and rad.
        C: (36,) compliance, base axes, by rows.
        R_base_part: (9,) by rows.
    """
    w, x, bent = fusion.product[:], fusion.gain[:], fusion.bent[:]  # the first two as work space
    R = R_base_part
    for d in range(3):
        for part in range(2):
            place = 6 * d + 3 * part
            p, q, r = bent[place], bent[place + 1], bent[place + 2]
            for k in range(3):
                w[3 * part + k] = R[3 * k] * p + R[3 * k + 1] * q + R[3 * k + 2] * r
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += C[6 * i + j] * w[j]
            x[i] = total
        for part in range(2):
            for k in range(3):
                total = 0.0
                for j in range(3):
                    total += R[3 * j + k] * x[3 * part + j]
                bent[6 * d + 3 * part + k] = total


@kernel(
    "float64(Fusion, float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64, float64)",
    **LOOP_TYPES,
)
def take_force(
    fusion: Record,
    measured: Float,
    predicted: Float,
    before: Float,
    frame: Float,
    tuning: Float,
    swing: float,
    gate: float,
) -> float:
    """Update with a measured force.

    Args:
        fusion: State of the filter; changed.
        measured: (6,) filtered, part axes.
        predicted: (6,) through the same filters.
        before: (6,) predicted of the last cycle.
        frame: (9,) directions.
        tuning: (4,) sigma N, tau / period, and two that are not used here, as of the factors' filter.
        swing: Share of the force by which the arm's swing may change it at the sensor.
        gate: See :func:`update`.

    Returns:
        Largest innovation by its standard deviation.
    """
    worst = 0.0
    for d in range(3):
        a, b, c = frame[3 * d], frame[3 * d + 1], frame[3 * d + 2]
        h = a * predicted[0] + b * predicted[1] + c * predicted[2]
        y = a * measured[0] + b * measured[1] + c * measured[2]
        if abs(h) < LEAST_FORCE_N or not math.isfinite(y):
            continue
        change = h - (a * before[0] + b * before[1] + c * before[2])
        for i in range(N):
            fusion.row[i] = 0.0
        fusion.row[d] = h
        noise = tuning[0] * tuning[0] + (tuning[1] * change) ** 2 + (swing * h) ** 2
        normalised = update(fusion, y, noise, gate)
        worst = max(worst, abs(normalised))
    return worst


@kernel("float64(Fusion, float64[::1], float64[::1], float64[::1], int64, float64)", **LOOP_TYPES)
def unexplained(fusion: Record, rest: Float, bent: Float, frame: Float, first: int, without: float) -> float:
    """Part of a deviation that the present estimate does not expect, m.

    Args:
        fusion: State of the filter.
        rest: (6,) deviation less the correction in effect.
        bent: (18,) D of the time of the sample.
        frame: (9,) directions of that time.
        first: First direction that counts: 1 leaves the feed out.
        without: See :func:`fused_load`.
    """
    total = 0.0
    for n in range(first, 3):
        residual = 0.0
        for k in range(3):
            here = rest[k] - fusion.estimate[6 + k]
            for d in range(3):
                here -= (fusion.estimate[d] + fusion.estimate[3 + d] - without) * bent[6 * d + k]
            residual += frame[3 * n + k] * here
        total += residual * residual
    return math.sqrt(total)


@kernel(
    "float64(Fusion, float64[::1], float64[::1], float64[::1], int64, float64, float64, float64, float64)", **LOOP_TYPES
)
def take_deviation(
    fusion: Record,
    rest: Float,
    bent: Float,
    frame: Float,
    first: int,
    without: float,
    variance: float,
    turn_variance: float,
    gate: float,
) -> float:
    """Update with a deviation that a tracker measured.

    Args:
        fusion: State of the filter; changed.
        rest: (6,) deviation less the correction in effect, m and rad.
        bent: (18,) D of the time of the sample.
        frame: (9,) directions of that time.
        first: 0 takes the deviation along the feed too, 1 leaves it out.
        without: See :func:`fused_load`.
        variance: Of the deviation, m2, what may have drifted since the sample included.
        turn_variance: Likewise of the orientation, rad2.
        gate: See :func:`update`.

    Returns:
        Largest innovation by its standard deviation.
    """
    worst = 0.0
    for n in range(first, 3):
        y = 0.0
        for i in range(N):
            fusion.row[i] = 0.0
        for k in range(3):
            u = frame[3 * n + k]
            y += u * rest[k]
            fusion.row[6 + k] = u
            for d in range(3):
                y += without * u * bent[6 * d + k]
                fusion.row[d] += u * bent[6 * d + k]
        for d in range(3):
            fusion.row[3 + d] = fusion.row[d]
        worst = max(worst, abs(update(fusion, y, variance, gate)))
    share = fusion.turn_variance / (fusion.turn_variance + turn_variance)
    fusion.turn_variance *= 1.0 - share
    for k in range(3):
        residual = rest[3 + k] - fusion.turn[k]
        for d in range(3):
            residual -= (fusion.estimate[d] + fusion.estimate[3 + d] - without) * bent[6 * d + 3 + k]
        fusion.turn[k] += share * residual
    return worst


@kernel(
    "float64(Fusion, float64[::1], float64[::1], int64, float64[::1], float64[::1], float64[::1], float64)",
    **LOOP_TYPES,
)
def take_torque(
    fusion: Record,
    torque: Float,
    zero: Float,
    known: int,
    jac: Float,
    R_base_part: Float,
    variance: Float,
    gate: float,
) -> float:
    """Update with the torque that the process puts on the axes: ``tau_j = sum_d (J^T w_d)_j k_d``.

    Args:
        fusion: State of the filter with the three wrenches of :func:`shares` in D; changed.
        torque: (6,) N m, from motor currents.
        zero: (6,) N m, what they show without a cut.
        known: Bit per axis whose zero is known; the others are left out.
        jac: (36,) Jacobian of the TCP, base axes, by rows: translation first.
        R_base_part: (9,) by rows.
        variance: (6,) of the torques, N2 m2.
        gate: See :func:`update`.

    Returns:
        Largest innovation by its standard deviation.
    """
    R, bent, worst = R_base_part, fusion.bent[:], 0.0
    for j in range(6):
        if not known >> j & 1:
            continue
        for i in range(N):
            fusion.row[i] = 0.0
        for d in range(3):
            total = 0.0
            for part in range(2):
                place = 6 * d + 3 * part
                for k in range(3):
                    base = R[3 * k] * bent[place] + R[3 * k + 1] * bent[place + 1] + R[3 * k + 2] * bent[place + 2]
                    total += jac[6 * (3 * part + k) + j] * base
            fusion.row[d] = total
        worst = max(worst, abs(update(fusion, torque[j] - zero[j], variance[j], gate)))
    return worst


@kernel("float64(Fusion, float64[::1], float64[::1], int64)", **LOOP_TYPES)
def uncertainty(fusion: Record, bent: Float, frame: Float, first: int) -> float:
    """Standard deviation of the expected deviation in the direction in which it is largest, m.

    Args:
        fusion: State of the filter; its work space is changed.
        bent: (18,) deflections D.
        frame: (9,) directions.
        first: First direction that counts.
    """
    worst = 0.0
    for n in range(first, 3):
        for i in range(N):
            fusion.row[i] = 0.0
        for k in range(3):
            u = frame[3 * n + k]
            fusion.row[6 + k] = u
            for d in range(3):
                fusion.row[d] += u * bent[6 * d + k]
        for d in range(3):
            fusion.row[3 + d] = fusion.row[d]
        total = 0.0
        for i in range(N):
            for j in range(N):
                total += fusion.row[i] * fusion.covariance[i, j] * fusion.row[j]
        worst = max(worst, total)
    return math.sqrt(max(0.0, worst))
