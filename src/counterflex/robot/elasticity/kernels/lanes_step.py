"""Lane-blocked batch kernel of the full step: Newton correction of 16 points at a time; see ``kernels_lanes``."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import prange

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.batch import step_range
from counterflex.robot.elasticity.kernels.lanes import BLOCKS, L, gather, lane_difference, lane_pass, lane_trig
from counterflex.robot.elasticity.kernels.records import Compact
from counterflex.robot.elasticity.kernels.scalar import SMALL, small_cos, small_sin
from counterflex.robot.elasticity.kernels.step import DAMPING_BELOW, STEP_LIMIT

REGULAR: Final = min(SMALL, STEP_LIMIT)  # rad, largest angle the series of a block may meet


# fmt: off
@kernel()
def lane_factor(J: Float, inv: Float, sigma: Float) -> None:
    """Inverse Cholesky factor of ``J J^T`` (21 rows) and sigma; the scalar form written out.

    ``d_i`` and ``l_ik`` are the factor with its diagonal inverted, ``v_ik`` the inverse below the diagonal.
    """
    for p in range(L):
        j00, j01, j02, j03, j04, j05 = J[p], J[L + p], J[2 * L + p], J[3 * L + p], J[4 * L + p], J[5 * L + p]
        j10, j11, j12, j13, j14, j15 = (
            J[6 * L + p], J[7 * L + p], J[8 * L + p], J[9 * L + p], J[10 * L + p], J[11 * L + p]
        )
        j20, j21, j22, j23, j24, j25 = (
            J[12 * L + p], J[13 * L + p], J[14 * L + p], J[15 * L + p], J[16 * L + p], J[17 * L + p]
        )
        j30, j31, j32, j33, j34, j35 = (
            J[18 * L + p], J[19 * L + p], J[20 * L + p], J[21 * L + p], J[22 * L + p], J[23 * L + p]
        )
        j40, j41, j42, j43, j44, j45 = (
            J[24 * L + p], J[25 * L + p], J[26 * L + p], J[27 * L + p], J[28 * L + p], J[29 * L + p]
        )
        j50, j51, j52, j53, j54, j55 = (
            J[30 * L + p], J[31 * L + p], J[32 * L + p], J[33 * L + p], J[34 * L + p], J[35 * L + p]
        )
        s = j00 * j00 + j01 * j01 + j02 * j02 + j03 * j03 + j04 * j04 + j05 * j05
        d0 = 1.0 / math.sqrt(s)
        s = j10 * j00 + j11 * j01 + j12 * j02 + j13 * j03 + j14 * j04 + j15 * j05
        l10 = s * d0
        s = j10 * j10 + j11 * j11 + j12 * j12 + j13 * j13 + j14 * j14 + j15 * j15 - l10 * l10
        d1 = 1.0 / math.sqrt(s)
        s = j20 * j00 + j21 * j01 + j22 * j02 + j23 * j03 + j24 * j04 + j25 * j05
        l20 = s * d0
        s = j20 * j10 + j21 * j11 + j22 * j12 + j23 * j13 + j24 * j14 + j25 * j15 - l20 * l10
        l21 = s * d1
        s = j20 * j20 + j21 * j21 + j22 * j22 + j23 * j23 + j24 * j24 + j25 * j25 - l20 * l20 - l21 * l21
        d2 = 1.0 / math.sqrt(s)
        s = j30 * j00 + j31 * j01 + j32 * j02 + j33 * j03 + j34 * j04 + j35 * j05
        l30 = s * d0
        s = j30 * j10 + j31 * j11 + j32 * j12 + j33 * j13 + j34 * j14 + j35 * j15 - l30 * l10
        l31 = s * d1
        s = j30 * j20 + j31 * j21 + j32 * j22 + j33 * j23 + j34 * j24 + j35 * j25 - l30 * l20 - l31 * l21
        l32 = s * d2
        s = j30 * j30 + j31 * j31 + j32 * j32 + j33 * j33 + j34 * j34 + j35 * j35 - l30 * l30 - l31 * l31 - l32 * l32
        d3 = 1.0 / math.sqrt(s)
        s = j40 * j00 + j41 * j01 + j42 * j02 + j43 * j03 + j44 * j04 + j45 * j05
        l40 = s * d0
        s = j40 * j10 + j41 * j11 + j42 * j12 + j43 * j13 + j44 * j14 + j45 * j15 - l40 * l10
        l41 = s * d1
        s = j40 * j20 + j41 * j21 + j42 * j22 + j43 * j23 + j44 * j24 + j45 * j25 - l40 * l20 - l41 * l21
        l42 = s * d2
        s = j40 * j30 + j41 * j31 + j42 * j32 + j43 * j33 + j44 * j34 + j45 * j35 - l40 * l30 - l41 * l31 - l42 * l32
        l43 = s * d3
        s = (
            j40 * j40 + j41 * j41 + j42 * j42 + j43 * j43 + j44 * j44 + j45 * j45 - l40 * l40 - l41 * l41 - l42 *
            l42 - l43 * l43
        )
        d4 = 1.0 / math.sqrt(s)
        s = j50 * j00 + j51 * j01 + j52 * j02 + j53 * j03 + j54 * j04 + j55 * j05
        l50 = s * d0
        s = j50 * j10 + j51 * j11 + j52 * j12 + j53 * j13 + j54 * j14 + j55 * j15 - l50 * l10
        l51 = s * d1
        s = j50 * j20 + j51 * j21 + j52 * j22 + j53 * j23 + j54 * j24 + j55 * j25 - l50 * l20 - l51 * l21
        l52 = s * d2
        s = j50 * j30 + j51 * j31 + j52 * j32 + j53 * j33 + j54 * j34 + j55 * j35 - l50 * l30 - l51 * l31 - l52 * l32
        l53 = s * d3
        s = (
            j50 * j40 + j51 * j41 + j52 * j42 + j53 * j43 + j54 * j44 + j55 * j45 - l50 * l40 - l51 * l41 - l52 *
            l42 - l53 * l43
        )
        l54 = s * d4
        s = (
            j50 * j50 + j51 * j51 + j52 * j52 + j53 * j53 + j54 * j54 + j55 * j55 - l50 * l50 - l51 * l51 - l52 *
            l52 - l53 * l53 - l54 * l54
        )
        d5 = 1.0 / math.sqrt(s)
        v10 = -d1 * (l10 * d0)
        v20 = -d2 * (l20 * d0 + l21 * v10)
        v21 = -d2 * (l21 * d1)
        v30 = -d3 * (l30 * d0 + l31 * v10 + l32 * v20)
        v31 = -d3 * (l31 * d1 + l32 * v21)
        v32 = -d3 * (l32 * d2)
        v40 = -d4 * (l40 * d0 + l41 * v10 + l42 * v20 + l43 * v30)
        v41 = -d4 * (l41 * d1 + l42 * v21 + l43 * v31)
        v42 = -d4 * (l42 * d2 + l43 * v32)
        v43 = -d4 * (l43 * d3)
        v50 = -d5 * (l50 * d0 + l51 * v10 + l52 * v20 + l53 * v30 + l54 * v40)
        v51 = -d5 * (l51 * d1 + l52 * v21 + l53 * v31 + l54 * v41)
        v52 = -d5 * (l52 * d2 + l53 * v32 + l54 * v42)
        v53 = -d5 * (l53 * d3 + l54 * v43)
        v54 = -d5 * (l54 * d4)
        inv[p] = d0
        inv[L + p], inv[2 * L + p] = v10, d1
        inv[3 * L + p], inv[4 * L + p], inv[5 * L + p] = v20, v21, d2
        inv[6 * L + p], inv[7 * L + p], inv[8 * L + p], inv[9 * L + p] = v30, v31, v32, d3
        inv[10 * L + p] = v40
        inv[11 * L + p] = v41
        inv[12 * L + p] = v42
        inv[13 * L + p] = v43
        inv[14 * L + p] = d4
        inv[15 * L + p] = v50
        inv[16 * L + p] = v51
        inv[17 * L + p] = v52
        inv[18 * L + p] = v53
        inv[19 * L + p] = v54
        inv[20 * L + p] = d5
        total = d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4 + d5 * d5
        total += v10 * v10
        total += v20 * v20 + v21 * v21
        total += v30 * v30 + v31 * v31 + v32 * v32
        total += v40 * v40 + v41 * v41 + v42 * v42 + v43 * v43
        total += v50 * v50 + v51 * v51 + v52 * v52 + v53 * v53 + v54 * v54
        sigma[p] = 1.0 / math.sqrt(total)


@kernel()
def lane_newton(J: Float, inv: Float, E: Float, step: Float, peak: Float) -> None:
    """Joint steps ``-J^T (J J^T)^-1 error`` (6 rows), their largest entry into ``peak``."""
    for p in range(L):
        e0, e1, e2, e3, e4, e5 = E[p], E[L + p], E[2 * L + p], E[3 * L + p], E[4 * L + p], E[5 * L + p]
        y0 = inv[p] * e0
        y1 = inv[L + p] * e0 + inv[2 * L + p] * e1
        y2 = inv[3 * L + p] * e0 + inv[4 * L + p] * e1 + inv[5 * L + p] * e2
        y3 = inv[6 * L + p] * e0 + inv[7 * L + p] * e1 + inv[8 * L + p] * e2 + inv[9 * L + p] * e3
        y4 = (
            inv[10 * L + p] * e0 + inv[11 * L + p] * e1 + inv[12 * L + p] * e2 + inv[13 * L + p] * e3 + inv[14 * L +
            p] * e4
        )
        y5 = (
            inv[15 * L + p] * e0 + inv[16 * L + p] * e1 + inv[17 * L + p] * e2 + inv[18 * L + p] * e3 + inv[19 * L +
            p] * e4 + inv[20 * L + p] * e5
        )
        z0 = (
            inv[p] * y0 + inv[L + p] * y1 + inv[3 * L + p] * y2 + inv[6 * L + p] * y3 + inv[10 * L + p] * y4 +
            inv[15 * L + p] * y5
        )
        z1 = (
            inv[2 * L + p] * y1 + inv[4 * L + p] * y2 + inv[7 * L + p] * y3 + inv[11 * L + p] * y4 + inv[16 * L + p]
            * y5
        )
        z2 = inv[5 * L + p] * y2 + inv[8 * L + p] * y3 + inv[12 * L + p] * y4 + inv[17 * L + p] * y5
        z3 = inv[9 * L + p] * y3 + inv[13 * L + p] * y4 + inv[18 * L + p] * y5
        z4 = inv[14 * L + p] * y4 + inv[19 * L + p] * y5
        z5 = inv[20 * L + p] * y5
        s0 = (
            -J[p] * z0 - J[6 * L + p] * z1 - J[12 * L + p] * z2 - J[18 * L + p] * z3 - J[24 * L + p] * z4 - J[30 * L
            + p] * z5
        )
        s1 = (
            -J[L + p] * z0 - J[7 * L + p] * z1 - J[13 * L + p] * z2 - J[19 * L + p] * z3 - J[25 * L + p] * z4 - J[31
            * L + p] * z5
        )
        s2 = (
            -J[2 * L + p] * z0 - J[8 * L + p] * z1 - J[14 * L + p] * z2 - J[20 * L + p] * z3 - J[26 * L + p] * z4 -
            J[32 * L + p] * z5
        )
        s3 = (
            -J[3 * L + p] * z0 - J[9 * L + p] * z1 - J[15 * L + p] * z2 - J[21 * L + p] * z3 - J[27 * L + p] * z4 -
            J[33 * L + p] * z5
        )
        s4 = (
            -J[4 * L + p] * z0 - J[10 * L + p] * z1 - J[16 * L + p] * z2 - J[22 * L + p] * z3 - J[28 * L + p] * z4 -
            J[34 * L + p] * z5
        )
        s5 = (
            -J[5 * L + p] * z0 - J[11 * L + p] * z1 - J[17 * L + p] * z2 - J[23 * L + p] * z3 - J[29 * L + p] * z4 -
            J[35 * L + p] * z5
        )
        step[p] = s0
        step[L + p] = s1
        step[2 * L + p] = s2
        step[3 * L + p] = s3
        step[4 * L + p] = s4
        step[5 * L + p] = s5
        size = max(max(abs(s0), abs(s1), abs(s2)), max(abs(s3), abs(s4), abs(s5)))
        peak[p] = max(peak[p], size)
# fmt: on


@kernel()
def lane_jacobian(chain: Compact, F: Float, J: Float) -> None:
    """Rigid Jacobians (36 rows) at the TCP in base axes."""
    m = len(chain.stations) - 1
    tip = F[m]
    for i in range(m):
        j = chain.stations[i].drive
        if j >= 0:
            f, column, sign = F[i], J[j * L :], chain.stations[i].sign
            for p in range(L):
                a, b, c = sign * f[6 * L + p], sign * f[7 * L + p], sign * f[8 * L + p]
                x = tip[9 * L + p] - f[9 * L + p]
                y = tip[10 * L + p] - f[10 * L + p]
                z = tip[11 * L + p] - f[11 * L + p]
                column[p] = b * z - c * y
                column[6 * L + p] = c * x - a * z
                column[12 * L + p] = a * y - b * x
                column[18 * L + p], column[24 * L + p], column[30 * L + p] = a, b, c


@kernel()
def lane_advance(trig: Float, step: Float, q: Float) -> None:
    """Move six rows of joint angles, with their cosines and sines, by small steps."""
    for k in range(6 * L):
        c, s, t = trig[k], trig[6 * L + k], step[k]
        dc, ds = small_cos(t), small_sin(t)
        trig[k] = c * dc - s * ds
        trig[6 * L + k] = s * dc + c * ds
        q[k] += t


@kernel()
def step_blocks(chain: Compact, q: Float, w: Float, out: Float, status: Int, first: int, last: int) -> int:
    """Steps (n, 19) like :func:`step_range` for the points first..last-1; returns how many the scalar kernel did."""
    m = len(chain.stations) - 1
    F, S, unit = np.empty((m + 1, 12 * L)), np.empty(12 * L), np.zeros(2 * L)
    Q, W, E, trig, peak = np.empty(6 * L), np.empty(6 * L), np.empty(6 * L), np.empty(12 * L), np.empty(L)
    T0, J, inv, move, sigma = np.empty(12 * L), np.empty(36 * L), np.empty(21 * L), np.empty(6 * L), np.empty(L)
    unit[:L] = 1.0
    redone = 0
    for n in range(first, last, L):
        count = min(L, last - n)
        gather(q, n, Q)
        gather(w, n, W)
        peak[:] = 0.0
        lane_trig(Q, trig)
        lane_pass(chain, trig, W, 0, F, S, peak, unit)
        lane_jacobian(chain, F, J)
        lane_factor(J, inv, sigma)
        T0[:] = S
        lane_pass(chain, trig, W, 1, F, S, peak, unit)
        lane_difference(T0, S, E, peak)
        for p in range(count):
            for k in range(6):
                out[n + p, k] = E[k * L + p]
        for _ in range(2):
            lane_newton(J, inv, E, move, peak)
            lane_advance(trig, move, Q)
            lane_pass(chain, trig, W, 0, F, S, peak, unit)
            lane_pass(chain, trig, W, 1, F, S, peak, unit)
            lane_difference(T0, S, E, peak)
        for p in range(count):
            for k in range(6):
                out[n + p, 6 + k] = Q[k * L + p]
                out[n + p, 12 + k] = E[k * L + p]
            out[n + p, 18] = sigma[p]
            status[n + p] = 0
            if not (peak[p] <= REGULAR and sigma[p] >= DAMPING_BELOW):
                step_range(chain, q, w, 0, out, status, n + p, n + p + 1)
                redone += 1
    return redone


@kernel(parallel=True)
def step_lanes(chain: Compact, q: Float, w: Float, out: Float, status: Int) -> int:
    """Threaded :func:`step_blocks` over all points."""
    redone = 0
    for k in prange((len(q) + BLOCKS * L - 1) // (BLOCKS * L)):
        redone += step_blocks(chain, q, w, out, status, k * BLOCKS * L, min(len(q), (k + 1) * BLOCKS * L))
    return redone
