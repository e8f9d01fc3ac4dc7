"""One force from two sensors, by their covariances: a Kalman filter of the force and of both zeros, compiled.

State ``x = [f; z_1; z_2]``: force on the tool (3, part axes) and what each sensor's zero is off by (3 each, in its own
axes). All walk at random, and a reading says, along axis k of sensor i with unit vector ``r_ik`` in part axes,

    y_ik = r_ik . f + z_ik + n_ik,   var n_ik = noise_ik^2 + slew^2 late_i

``late_i`` is how old the reading is: what the force may have changed by since counts as noise. Each sensor is taken
when it has something new, so rates may differ. As the difference of the zeros is known, the force goes on without a
jump when one sensor falls away. Before both are taken, they are held against each other: a difference beyond what
noise, zeros and delays explain means that one of them is wrong, and nothing is taken while it lasts.

Source: sequential scalar updates of a Kalman filter: Bierman 1977, "Factorization Methods for Discrete Sequential
Estimation".
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record, record

STATES: Final = 9
FIRST: Final = 1
SECOND: Final = 2
"""Bits of the sensors that have something new."""

PAIR: Final = record(
    slew=float,  # N2 per s
    walk=(float, 6),  # N2 per s, of each zero: first sensor, second sensor
    late=(float, 2),  # s
    gate=float,  # standard deviations that the difference may have
    floor_n=float,  # N, on top of them
    patience=int,  # cycles in a row after which a difference is an alarm
)
"""Constants."""
PAIRED: Final = record(
    x=(float, STATES),
    covariance=(float, (STATES, STATES)),
    axes=(float, (6, 3)),  # unit vectors of the sensors' axes, part axes
    reading=(float, 6),  # N, in the sensors' own axes
    noise=(float, 6),  # N2
    row=(float, STATES),
    product=(float, STATES),
    gap_n=float,  # largest difference of the last cycle with both
    differing=int,  # cycles in a row in which they differed too much
    alarm=int,  # 1: they have for too long, and have not agreed for as long since
)
"""What the filter remembers."""


@kernel("float64(Paired)", Paired=PAIRED)
def _spread(p: Record) -> float:
    """``H P H^T`` of the row H; ``P H^T`` into ``product``."""
    total = 0.0
    for i in range(STATES):
        s = 0.0
        for j in range(STATES):
            s += p.covariance[i, j] * p.row[j]
        p.product[i] = s
        total += p.row[i] * s
    return total


@kernel("void(Paired, float64, float64)", Paired=PAIRED)
def _take(p: Record, y: float, variance: float) -> None:
    """Take one scalar ``y = H x + n``."""
    s = _spread(p) + variance
    innovation = y
    for i in range(STATES):
        innovation -= p.row[i] * p.x[i]
    for i in range(STATES):
        p.x[i] += p.product[i] / s * innovation
        for j in range(i + 1):
            value = p.covariance[i, j] - p.product[i] * p.product[j] / s
            p.covariance[i, j] = p.covariance[j, i] = value


@kernel("boolean(Pair, Paired)", Pair=PAIR, Paired=PAIRED)
def _agree(c: Record, p: Record) -> bool:
    """Return whether both readings can be of one force, along each axis of the second sensor; ``gap_n`` is written."""
    agree = True
    p.gap_n = 0.0
    for k in range(3):
        for i in range(STATES):
            p.row[i] = 0.0
        p.row[6 + k] = 1.0
        gap = p.reading[3 + k] - p.x[6 + k]
        noise = p.noise[3 + k] + c.slew * abs(c.late[0] - c.late[1])
        for j in range(3):
            share = 0.0
            for i in range(3):
                share += p.axes[3 + k, i] * p.axes[j, i]
            p.row[3 + j] = -share
            gap -= share * (p.reading[j] - p.x[3 + j])
            noise += share * share * p.noise[j]
        p.gap_n = max(p.gap_n, abs(gap))
        # Not ``>``: a NaN of either sensor must not agree.
        if not abs(gap) <= c.gate * math.sqrt(_spread(p) + noise) + c.floor_n:
            agree = False
    return agree


@kernel("boolean(Pair, Paired, float64, int64)", Pair=PAIR, Paired=PAIRED, entry=True)
def pair_step(c: Record, p: Record, dt: float, fresh: int) -> bool:
    """One cycle.

    ``p``: changed; ``dt``: s since the last one; ``fresh``: bits of the sensors whose reading is new.

    Returns:
        Whether the readings were taken.
    """
    for i in range(STATES):
        p.covariance[i, i] += dt * (c.slew if i < 3 else c.walk[i - 3])
    if fresh == FIRST | SECOND:
        agree = _agree(c, p)
        # Counts down by one, not to zero: two sensors that agree in every other cycle differ.
        p.differing = min(p.differing + 1, c.patience) if not agree else max(p.differing - 1, 0)
        if p.differing >= c.patience:
            p.alarm = 1
        elif p.differing == 0:
            p.alarm = 0
        if not agree:
            return False
    for sensor in range(2):
        if fresh & (1 << sensor):
            for k in range(3 * sensor, 3 * sensor + 3):
                for i in range(STATES):
                    p.row[i] = p.axes[k, i] if i < 3 else 0.0
                p.row[3 + k] = 1.0
                _take(p, p.reading[k], p.noise[k] + c.slew * c.late[sensor])
    return True
