"""Force from the bridges of an instrumented holder, sample by sample: a Kalman filter of force and zeros, compiled.

State ``x = [f; z]``: force at the tool (3, holder axes) and the wandering zero of each bridge; both walk at random,

    x_k+1 = x_k + v,  cov v = dt diag(slew^2, wander^2),   s_k = K f_k + z_k + n,  cov n = diag(noise^2),

with ``s`` the strains less bias, temperature, weight of the spindle and the zero that was taken before the cut, and
``K = S [1; [p]x]`` of the tool in use. Bridges are independent, so their readings are taken one after the other, which
needs no inverse, and a bridge that shows nothing is left out with the right covariance. Before a cycle's samples are
taken, their mean is held against what any force could show: what then remains on a bridge, beyond noise, drift of the
zeros and a share of the strain, means that a bridge jumped, and nothing of the cycle is taken.

Strains are in um/m here, so that variances of strains and of forces are of a size.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record

BRIDGES: Final = 12
STATES: Final = 3 + BRIDGES

HOLDER: Final = record(
    sensitivity=(float, (BRIDGES, 6)),  # um/m per N and per N m, load about the holder's origin
    bias=(float, BRIDGES),  # um/m
    kelvin=(float, BRIDGES),  # um/m per K
    noise=(float, BRIDGES),  # (um/m)2, variance of a sample
    wander=(float, BRIDGES),  # (um/m)2 per s
    slew=(float, 3),  # N2 per s
    drift=(float, BRIDGES),  # um/m, change of a zero since it was taken that is no contradiction
    error=(float, 9),  # standard deviation of the force shown along x, y, z (rows) by 1 N along x, y, z (columns)
    reference_c=float,
    share=float,  # of the largest strain of a bridge that may contradict the others
    step_s=float,  # between samples, where their clock does not tell
    bridges=int,
    least=int,  # bridges without which there is no force
)
"""Constants of a holder."""
OBSERVED: Final = record(
    gain=(float, (BRIDGES, 3)),  # um/m per N: K of the tool in use
    x=(float, STATES),
    covariance=(float, (STATES, STATES)),
    zero=(float, BRIDGES),  # um/m, taken before the cut
    weight=(float, BRIDGES),  # um/m, strain by the weight behind the holder
    level=(float, BRIDGES),  # um/m, mean of this cycle, bias, temperature and weight taken off
    counted=(float, BRIDGES),  # samples in it
    residual=(float, BRIDGES),  # um/m that no force explains
    sigma=(float, 3),  # N, of the force, what the calibration leaves uncertain included
    row=(float, STATES),
    normal=(float, 9),
    right=(float, 3),
    fitted=(float, 3),
    warm_c=float,  # last temperature that is believed
    other_c=float,  # last one that is not
    others=int,  # samples in a row that are not and agree with each other
    time_ns=int,
    begun=int,
    used=int,  # bridges with a reading in this cycle
    worst=int,  # bridge that contradicts most, -1: none
    contradicting=int,  # cycles in a row
)
"""What the filter remembers, and what it found in the last cycle."""
_LONGEST_S: Final = 1.0
_NS: Final = 1e-9
_GATE: Final = 5.0
_MOST_C: Final = 5.0
"""Most kelvin that the temperature may change between two samples that tell one; else it is not believed at once."""
_OTHERS: Final = 100
"""Samples in a row that agree on another temperature after which that is the holder's: a bad telegram is shorter. Else
the value with which an amplifier starts, or the one before a pause, would be the holder's for ever."""


@kernel("boolean(float64[::1], float64[::1], float64[::1])")
def solve3(a: Float, b: Float, x: Float) -> bool:
    """Solve a symmetric 3 x 3 system by its adjugate; False where it is singular.

    Args:
        a: (9,) matrix by rows.
        b: (3,).
        x: (3,) written.
    """
    c0, c1, c2 = a[4] * a[8] - a[5] * a[7], a[5] * a[6] - a[3] * a[8], a[3] * a[7] - a[4] * a[6]
    det = a[0] * c0 + a[1] * c1 + a[2] * c2
    size = a[0] * a[4] * a[8]
    if not abs(det) > 1e-12 * size:
        return False
    d0, d1, d2 = a[2] * a[7] - a[1] * a[8], a[0] * a[8] - a[2] * a[6], a[1] * a[6] - a[0] * a[7]
    e0, e1, e2 = a[1] * a[5] - a[2] * a[4], a[2] * a[3] - a[0] * a[5], a[0] * a[4] - a[1] * a[3]
    x[0] = (c0 * b[0] + d0 * b[1] + e0 * b[2]) / det
    x[1] = (c1 * b[0] + d1 * b[1] + e1 * b[2]) / det
    x[2] = (c2 * b[0] + d2 * b[1] + e2 * b[2]) / det
    return True


@kernel("void(Observed, float64)", Observed=OBSERVED)
def take_temperature(o: Record, c: float) -> None:
    """Take a temperature, deg C: at once where it is near the last one, else once enough samples agree on it."""
    if not math.isfinite(c):
        return
    if not (math.isfinite(o.warm_c) and abs(c - o.warm_c) > _MOST_C):
        o.warm_c, o.others = c, 0
        return
    o.others = o.others + 1 if o.others > 0 and abs(c - o.other_c) <= _MOST_C else 1
    o.other_c = c
    if o.others >= _OTHERS:
        o.warm_c, o.others = c, 0


@kernel("void(Holder, Observed, float64[:, ::1], float64[::1], int64)", Holder=HOLDER, Observed=OBSERVED)
def mean_strain(h: Record, o: Record, samples: Float, warm: Float, count: int) -> None:
    """Mean strain of each bridge in a cycle, less bias, temperature and weight: into ``level`` and ``counted``.

    Args:
        h: HOLDER.
        o: OBSERVED; changed.
        samples: (m, >= bridges) strain, dimensionless; NaN: none.
        warm: (m,) deg C; NaN: not measured, the last one counts.
        count: Rows that are new.
    """
    for k in range(h.bridges):
        o.level[k] = o.counted[k] = 0.0
    for row in range(count):
        take_temperature(o, warm[row])
        warmer = o.warm_c - h.reference_c if math.isfinite(o.warm_c) else 0.0
        for k in range(h.bridges):
            s = samples[row, k]
            if math.isfinite(s):
                o.level[k] += 1e6 * s - h.bias[k] - h.kelvin[k] * warmer - o.weight[k]
                o.counted[k] += 1.0
    o.used = 0
    for k in range(h.bridges):
        if o.counted[k] > 0.0:
            o.level[k] /= o.counted[k]
            o.used += 1


@kernel("boolean(Holder, Observed)", Holder=HOLDER, Observed=OBSERVED)
def consistent(h: Record, o: Record) -> bool:
    """Return whether some force explains the mean strains of this cycle: with three bridges always.

    Weighted least squares over the bridges that show something; ``residual`` and ``worst`` are written.
    """
    a, b, f = o.normal[:], o.right[:], o.fitted[:]
    for i in range(9):
        a[i] = 0.0
    for i in range(3):
        b[i] = 0.0
    largest = 0.0
    for k in range(h.bridges):
        if o.counted[k] > 0.0:
            y = o.level[k] - o.zero[k] - o.x[3 + k]
            largest = max(largest, abs(y))
            for i in range(3):
                b[i] += o.gain[k, i] * y / h.noise[k]
                for j in range(3):
                    a[3 * i + j] += o.gain[k, i] * o.gain[k, j] / h.noise[k]
    o.worst = -1
    if not solve3(a, b, f):
        # Singular with three bridges or fewer: each reading is some force's, so nothing can contradict.
        return bool(o.used <= 3)
    excess = 1.0
    for k in range(h.bridges):
        o.residual[k] = 0.0
        if o.counted[k] > 0.0:
            y = o.level[k] - o.zero[k] - o.x[3 + k]
            left = y - o.gain[k, 0] * f[0] - o.gain[k, 1] * f[1] - o.gain[k, 2] * f[2]
            o.residual[k] = left
            bound = _GATE * math.sqrt(h.noise[k] / o.counted[k]) + h.drift[k] + h.share * largest
            if o.used > 3 and abs(left) > excess * bound:
                excess, o.worst = abs(left) / bound, k
    return bool(o.worst < 0)


@kernel("void(Holder, Observed, float64)", Holder=HOLDER, Observed=OBSERVED)
def predict(h: Record, o: Record, dt: float) -> None:
    """One step of the random walk over ``dt`` s."""
    for i in range(3):
        o.covariance[i, i] += h.slew[i] * dt
    for k in range(h.bridges):
        o.covariance[3 + k, 3 + k] += h.wander[k] * dt


@kernel("void(Holder, Observed, int64, float64)", Holder=HOLDER, Observed=OBSERVED)
def take_reading(h: Record, o: Record, k: int, y: float) -> None:
    """One bridge's reading ``y`` (um/m, all known taken off): scalar update of state and covariance."""
    m, row = 3 + h.bridges, o.row[:]
    innovation, variance = y - o.x[3 + k], h.noise[k]
    for i in range(m):
        total = o.covariance[i, 3 + k]
        for j in range(3):
            total += o.covariance[i, j] * o.gain[k, j]
        row[i] = total
    for j in range(3):
        innovation -= o.gain[k, j] * o.x[j]
        variance += o.gain[k, j] * row[j]
    variance += row[3 + k]
    for i in range(m):
        part = row[i] / variance
        o.x[i] += part * innovation
        # Only the lower half is computed and mirrored: rounding of both halves apart loses symmetry, then positiveness.
        for j in range(i + 1):
            o.covariance[i, j] -= part * row[j]
            o.covariance[j, i] = o.covariance[i, j]


@kernel(
    "int64(Holder[::1], Observed[::1], float64[:, ::1], float64[::1], int64[::1], int64)",
    Holder=HOLDER,
    Observed=OBSERVED,
)
def observe(holders: Records, observeds: Records, samples: Float, warm: Float, times: Int, count: int) -> int:
    """Take the samples of a cycle.

    Args:
        holders: (1,) HOLDER.
        observeds: (1,) OBSERVED, ``weight`` filled; changed: force in ``x[:3]``, its deviation in ``sigma``.
        samples: (m, >= bridges) strain, dimensionless; NaN: none.
        warm: (m,) deg C.
        times: (m,) ns of the amplifier's clock.
        count: Rows that are new.

    Returns:
        0 taken; 1 too few bridges show anything; 2 they contradict each other, nothing was taken.
    """
    h, o = holders[0], observeds[0]
    mean_strain(h, o, samples, warm, count)
    if o.used < h.least:
        o.contradicting = 0
        return 1
    agree = consistent(h, o)
    o.contradicting = 0 if agree else o.contradicting + 1
    warmer = o.warm_c - h.reference_c if math.isfinite(o.warm_c) else 0.0
    for row in range(count):
        dt = (times[row] - o.time_ns) * _NS
        # A clock that jumps (restart, wrap) would let the walk run for hours at once and forget zeros that are good.
        if o.begun == 0 or not 0.0 < dt <= _LONGEST_S:
            dt = h.step_s
        o.time_ns, o.begun = times[row], 1
        predict(h, o, dt)
        # The walk goes on while nothing is taken, so that the stated deviation grows with the time without a reading.
        if not agree:
            continue
        for k in range(h.bridges):
            s = samples[row, k]
            if math.isfinite(s):
                known = h.bias[k] + h.kelvin[k] * warmer + o.weight[k] + o.zero[k]
                take_reading(h, o, k, 1e6 * s - known)
    for i in range(3):
        total = max(0.0, o.covariance[i, i])
        for j in range(3):
            total += (h.error[3 * i + j] * o.x[j]) ** 2
        o.sigma[i] = math.sqrt(total)
    return 0 if agree else 2


@kernel("void(Holder[::1], Observed[::1], float64, float64)", Holder=HOLDER, Observed=OBSERVED, entry=True)
def begin(holders: Records, observeds: Records, force_n: float, zero_um_m: float) -> None:
    """Begin anew: no force, zeros as taken; deviations of both given."""
    h, o = holders[0], observeds[0]
    for i in range(STATES):
        o.x[i] = 0.0
        for j in range(STATES):
            o.covariance[i, j] = 0.0
    for i in range(3):
        o.covariance[i, i] = force_n * force_n
        o.sigma[i] = force_n
    for k in range(h.bridges):
        o.covariance[3 + k, 3 + k] = zero_um_m * zero_um_m
    o.contradicting, o.worst = 0, -1
