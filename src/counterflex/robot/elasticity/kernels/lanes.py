"""Lane-blocked batch kernels: deflection of 16 points at a time, laid out so that the compiler vectorises.

Every quantity of a block is a row of LANES numbers: entry k of lane l sits at ``k * LANES + l``. A pose is stored by
columns (x axis, y axis, z axis, position). The kernels do only what is regular; a point whose elastic angles are large
is done again by the scalar kernels, which are the reference for all of this.
Loads on the rigid geometry, no own weight.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import prange

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.robot.elasticity.kernels.batch import ON_RIGID, deflection_range
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import SMALL, small_asin_ratio, small_cos, small_sin

LANES: Final = 16
L: Final = LANES
BLOCKS: Final = 16  # blocks that one thread takes at a time

# Cody-Waite split of pi/2 and minimax coefficients of sine and cosine on +-pi/4.
_HIGH: Final = 1.57079632673412561417e00
_LOW: Final = 6.07710050650619224932e-11


@kernel()
def lane_trig(q: Float, trig: Float) -> None:
    """Cosines then sines (12 rows) of six rows of angles, up to +-1e5 rad."""
    for k in range(6 * L):
        x = q[k]
        n = math.floor(x * (2.0 / math.pi) + 0.5)
        r = (x - n * _HIGH) - n * _LOW
        z = r * r
        sine = r + r * z * (
            -1.66666666666666324348e-01
            + z
            * (
                8.33333333332248946124e-03
                + z
                * (
                    -1.98412698298579493134e-04
                    + z
                    * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
                )
            )
        )
        cosine = (
            1.0
            - 0.5 * z
            + z
            * z
            * (
                4.16666666666666019037e-02
                + z
                * (
                    -1.38888888888741095749e-03
                    + z
                    * (
                        2.48015872894767294178e-05
                        + z
                        * (
                            -2.75573143513906633035e-07
                            + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
                        )
                    )
                )
            )
        )
        quadrant = n - 4.0 * math.floor(n * 0.25)
        odd = quadrant == 1.0 or quadrant == 3.0
        c = sine if odd else cosine
        s = cosine if odd else sine
        trig[k] = -c if quadrant == 1.0 or quadrant == 2.0 else c
        trig[6 * L + k] = -s if quadrant >= 2.0 else s


@kernel()
def lane_shift(S: Float, x: float, y: float, z: float) -> None:
    """Move all poses along their own axes by the same vector."""
    for p in range(3 * L):
        S[9 * L + p] += S[p] * x + S[3 * L + p] * y + S[6 * L + p] * z


@kernel()
def lane_turn(A: Float, B: Float, c: float, s: float) -> None:
    """Turn one pair of axes of all poses by the same angle."""
    for k in range(3 * L):
        a, b = A[k], B[k]
        A[k] = c * a + s * b
        B[k] = c * b - s * a


@kernel()
def lane_rotate(S: Float, R: Float) -> None:
    """Multiply all poses from the right by one general rotation (9,), row by row."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = R[0], R[1], R[2], R[3], R[4], R[5], R[6], R[7], R[8]
    for k in range(3 * L):
        a, b, c = S[k], S[3 * L + k], S[6 * L + k]
        S[k] = a * r00 + b * r10 + c * r20
        S[3 * L + k] = a * r01 + b * r11 + c * r21
        S[6 * L + k] = a * r02 + b * r12 + c * r22


@kernel()
def lane_drive(S: Float, cosine: Float, sine: Float, sign: float) -> None:
    """Turn every pose about its z by its own angle."""
    for p in range(L):
        c, s = cosine[p], sign * sine[p]
        x, y, z = S[p], S[L + p], S[2 * L + p]
        u, v, w = S[3 * L + p], S[4 * L + p], S[5 * L + p]
        S[p] = c * x + s * u
        S[L + p] = c * y + s * v
        S[2 * L + p] = c * z + s * w
        S[3 * L + p] = c * u - s * x
        S[4 * L + p] = c * v - s * y
        S[5 * L + p] = c * w - s * z


@kernel()
def lane_slide(S: Float, F: Float, W: Float, cx: float, cy: float, cz: float) -> None:
    """Translate every pose by compliance times the force in the rigid axes ``F``."""
    for p in range(L):
        fx, fy, fz = W[p], W[L + p], W[2 * L + p]
        a = cx * (F[p] * fx + F[L + p] * fy + F[2 * L + p] * fz)
        b = cy * (F[3 * L + p] * fx + F[4 * L + p] * fy + F[5 * L + p] * fz)
        c = cz * (F[6 * L + p] * fx + F[7 * L + p] * fy + F[8 * L + p] * fz)
        S[9 * L + p] += S[p] * a + S[3 * L + p] * b + S[6 * L + p] * c
        S[10 * L + p] += S[L + p] * a + S[4 * L + p] * b + S[7 * L + p] * c
        S[11 * L + p] += S[2 * L + p] * a + S[5 * L + p] * b + S[8 * L + p] * c


@kernel()
def lane_bend(
    S: Float, F: Float, tip: Float, W: Float, peak: Float, cosine: Float, sine: Float, sign: float, station: Record
) -> None:
    """Drive every pose and rotate it z-y'-x'' by compliance times the moment about the rigid frames ``F``."""
    cx, cy, cz = station.compliance[3], station.compliance[4], station.compliance[5]
    for p in range(L):
        fx, fy, fz = W[p], W[L + p], W[2 * L + p]
        x, y, z = tip[9 * L + p] - F[9 * L + p], tip[10 * L + p] - F[10 * L + p], tip[11 * L + p] - F[11 * L + p]
        mx = W[3 * L + p] + y * fz - z * fy
        my = W[4 * L + p] + z * fx - x * fz
        mz = W[5 * L + p] + x * fy - y * fx
        a = cx * (F[p] * mx + F[L + p] * my + F[2 * L + p] * mz)
        b = cy * (F[3 * L + p] * mx + F[4 * L + p] * my + F[5 * L + p] * mz)
        c = cz * (F[6 * L + p] * mx + F[7 * L + p] * my + F[8 * L + p] * mz)
        size = abs(a) + abs(b) + abs(c)
        peak[p] = max(peak[p], size)
        ca, sa, cb, sb = small_cos(a), small_sin(a), small_cos(b), small_sin(b)
        cg, sg = small_cos(c), small_sin(c)
        c, s = cosine[p], sign * sine[p]
        cc, sc = c * cg - s * sg, s * cg + c * sg
        x0, x1, x2 = S[p], S[L + p], S[2 * L + p]
        y0, y1, y2 = S[3 * L + p], S[4 * L + p], S[5 * L + p]
        z0, z1, z2 = S[6 * L + p], S[7 * L + p], S[8 * L + p]
        x0, y0 = cc * x0 + sc * y0, cc * y0 - sc * x0
        x1, y1 = cc * x1 + sc * y1, cc * y1 - sc * x1
        x2, y2 = cc * x2 + sc * y2, cc * y2 - sc * x2
        x0, z0 = cb * x0 - sb * z0, cb * z0 + sb * x0
        x1, z1 = cb * x1 - sb * z1, cb * z1 + sb * x1
        x2, z2 = cb * x2 - sb * z2, cb * z2 + sb * x2
        S[p], S[L + p], S[2 * L + p] = x0, x1, x2
        S[3 * L + p] = ca * y0 + sa * z0
        S[4 * L + p] = ca * y1 + sa * z1
        S[5 * L + p] = ca * y2 + sa * z2
        S[6 * L + p] = ca * z0 - sa * y0
        S[7 * L + p] = ca * z1 - sa * y1
        S[8 * L + p] = ca * z2 - sa * y2


@kernel()
def lane_pass(
    chain: Compact, trig: Float, W: Float, elastic: int, F: Float, S: Float, peak: Float, unit: Float
) -> None:
    """Rigid pass: frames ``F`` (m + 1, 12 rows) after the drives and TCP. Elastic pass: TCP in ``S``, loads from ``F``.

    ``unit`` holds a row of ones and a row of zeros.
    """
    S[:] = 0.0
    S[0:L] = 1.0
    S[4 * L : 5 * L] = 1.0
    S[8 * L : 9 * L] = 1.0
    m = len(chain.stations) - 1
    for i in range(m + 1):
        s = chain.stations[i]
        a, b, c = s.position[0], s.position[1], s.position[2]
        if a != 0.0 or b != 0.0 or c != 0.0:
            lane_shift(S, a, b, c)
        turn = s.turn
        if turn == 1:
            lane_turn(S[3 * L : 6 * L], S[6 * L : 9 * L], s.rotation[4], s.rotation[7])
        elif turn == 2:
            lane_turn(S[6 * L : 9 * L], S[0 : 3 * L], s.rotation[0], s.rotation[2])
        elif turn == 3:
            lane_turn(S[0 : 3 * L], S[3 * L : 6 * L], s.rotation[0], s.rotation[3])
        elif turn == 4:
            lane_rotate(S, s.rotation[:])
        joint = s.drive
        if i == m:
            break
        bends = elastic != 0 and s.rotates != 0
        slides = elastic != 0 and s.slides != 0
        driven = joint >= 0
        if driven and (slides or not bends):
            lane_drive(S, trig[joint * L : joint * L + L], trig[(6 + joint) * L : (7 + joint) * L], s.sign)
        if elastic == 0:
            F[i, :] = S
        if slides:
            lane_slide(S, F[i], W, s.compliance[0], s.compliance[1], s.compliance[2])
        if bends:
            if driven and not slides:
                cosine, sine = trig[joint * L : joint * L + L], trig[(6 + joint) * L : (7 + joint) * L]
                lane_bend(S, F[i], F[m], W, peak, cosine, sine, s.sign, s)
            else:
                lane_bend(S, F[i], F[m], W, peak, unit[0:L], unit[L : 2 * L], 1.0, s)
    if elastic == 0:
        F[m, :] = S


@kernel()
def lane_difference(A: Float, B: Float, out: Float, peak: Float) -> None:
    """Six rows ``[p_B - p_A, log(R_B R_A^T)]``; the sine of the rotation goes into ``peak``."""
    for p in range(L):
        a0, a1, a2, a3, a4, a5 = A[p], A[L + p], A[2 * L + p], A[3 * L + p], A[4 * L + p], A[5 * L + p]
        a6, a7, a8 = A[6 * L + p], A[7 * L + p], A[8 * L + p]
        b0, b1, b2, b3, b4, b5 = B[p], B[L + p], B[2 * L + p], B[3 * L + p], B[4 * L + p], B[5 * L + p]
        b6, b7, b8 = B[6 * L + p], B[7 * L + p], B[8 * L + p]
        x = 0.5 * (a1 * b2 - a2 * b1 + a4 * b5 - a5 * b4 + a7 * b8 - a8 * b7)
        y = 0.5 * (a2 * b0 - a0 * b2 + a5 * b3 - a3 * b5 + a8 * b6 - a6 * b8)
        z = 0.5 * (a0 * b1 - a1 * b0 + a3 * b4 - a4 * b3 + a6 * b7 - a7 * b6)
        s2 = x * x + y * y + z * z
        ratio = small_asin_ratio(s2)
        size = s2 * (1.0 / SMALL)  # below SMALL exactly when the sine is
        peak[p] = max(peak[p], size)
        out[p] = B[9 * L + p] - A[9 * L + p]
        out[L + p] = B[10 * L + p] - A[10 * L + p]
        out[2 * L + p] = B[11 * L + p] - A[11 * L + p]
        out[3 * L + p], out[4 * L + p], out[5 * L + p] = ratio * x, ratio * y, ratio * z


@kernel()
def gather(values: Float, first: int, rows: Float) -> None:
    """Transpose 16 points (n, 6) into six rows; past the end the last point is repeated."""
    for p in range(L):
        n = min(first + p, len(values) - 1)
        for k in range(6):
            rows[k * L + p] = values[n, k]


@kernel()
def deflection_blocks(chain: Compact, q: Float, w: Float, out: Float, first: int, last: int) -> int:
    """Deflections (n, 6) for the points first..last-1; returns how many were left to the scalar kernel."""
    m = len(chain.stations) - 1
    F, S, unit = np.empty((m + 1, 12 * L)), np.empty(12 * L), np.zeros(2 * L)
    Q, W, E, trig, peak = np.empty(6 * L), np.empty(6 * L), np.empty(6 * L), np.empty(12 * L), np.empty(L)
    unit[:L] = 1.0
    redone = 0
    for n in range(first, last, L):
        gather(q, n, Q)
        gather(w, n, W)
        peak[:] = 0.0
        lane_trig(Q, trig)
        lane_pass(chain, trig, W, 0, F, S, peak, unit)
        lane_pass(chain, trig, W, 1, F, S, peak, unit)
        lane_difference(F[m], S, E, peak)
        for p in range(min(L, last - n)):
            for k in range(6):
                out[n + p, k] = E[k * L + p]
            # Asked this way round, NaN goes to the scalar kernel too.
            if not peak[p] <= SMALL:
                deflection_range(chain, q, w, ON_RIGID, 0, out, n + p, n + p + 1)
                redone += 1
    return redone


@kernel("int64(Compact, float64[:, ::1], float64[:, ::1], float64[:, ::1])", parallel=True, entry=True, Compact=CHAIN)
def deflection_lanes(chain: Compact, q: Float, w: Float, out: Float) -> int:
    """Threaded :func:`deflection_blocks` over all points."""
    redone = 0
    for k in prange((len(q) + BLOCKS * L - 1) // (BLOCKS * L)):
        redone += deflection_blocks(chain, q, w, out, k * BLOCKS * L, min(len(q), (k + 1) * BLOCKS * L))
    return redone
