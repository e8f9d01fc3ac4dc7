"""Compiled Newton iteration on the elastic chain: one pose, and a whole path seeded by the previous point.

The residual is ``e = [(p_target - p) / L, log(R_target R^T)]`` of the loaded chain, the Jacobian the geometric one of
the displaced frames. Step ``dq = J^T (J J^T + lambda^2)^-1 e`` with ``lambda^2 = max(0, 1 - sigma/sigma_0)^2
lambda_0^2 min(1, |e|/e_0)``: damping grows as the smallest singular value sigma of the scaled Jacobian falls and
vanishes with the residual, so that the iteration still ends exactly. Steps are clamped per joint.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Float, Float1, Float2, Int1
from counterflex.core.jit import bundle, kernel
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import chain_pass, joint_trig, loads, rigid_jacobian

OK, UNREACHED, OUTSIDE, SINGULAR = 0, 1, 2, 3
"""How a point ended: solved, no convergence, a joint limit broken, too close to a singularity."""

TOLERANCE = 1e-11  # m and rad, on the largest component of the residual
MAX_STEPS = 60
_STEP_RAD = 0.3  # largest joint step of one iteration
_SIGMA_0 = 0.05  # damping sets in below
_LAMBDA_0 = 0.05
_E_0 = 1e-2
_ROUGH, _FINE = 3, 10  # squarings: 2.5 % to damp a step with, 0.02 % to report
_SUB_M = 0.05  # a longer move between two points of a path is followed in steps
_SUB_RAD = 0.15
_JUMP_RAD = 0.5  # a joint that moves further within one such step is looked at in smaller ones
_FINEST = 4096


@kernel()
def rotation_vector(R: Float, out: Float) -> None:
    """Rotation vector of a rotation matrix (3, 3) into ``out`` (3,); at a half turn either sign."""
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    s = 0.5 * math.sqrt(x * x + y * y + z * z)
    c = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    if s < 1e-7 and c < 0.0:  # a half turn: the axis is the largest column of R + 1
        best = 0
        for i in range(1, 3):
            if R[i, i] > R[best, best]:
                best = i
        norm = 0.0
        for i in range(3):
            out[i] = R[i, best] + (1.0 if i == best else 0.0)
            norm += out[i] * out[i]
        for i in range(3):
            out[i] *= math.pi / math.sqrt(norm)
        return
    scale = 0.5 if s < 1e-9 else 0.5 * math.atan2(s, c) / s
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@kernel()
def _cholesky(A: Float, C: Float) -> None:
    for i in range(6):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= C[i, k] * C[j, k]
            if i == j:
                # At a singularity rounding makes the last pivot negative. A tiny one keeps the solve finite, and sigma
                # says how near it is.
                C[i, i] = math.sqrt(s) if s > 1e-30 else 1e-15
            else:
                C[i, j] = s / C[j, j]


@kernel()
def _solve(C: Float, b: Float) -> None:
    for i in range(6):
        s = b[i]
        for k in range(i):
            s -= C[i, k] * b[k]
        b[i] = s / C[i, i]
    for i in range(5, -1, -1):
        s = b[i]
        for k in range(i + 1, 6):
            s -= C[k, i] * b[k]
        b[i] = s / C[i, i]


@kernel()
def _sigma_min(C: Float, squarings: int, B: Float, D: Float) -> float:
    """Smallest singular value of J from the Cholesky factor of ``A = J J^T``, by squaring the inverse."""
    # With `B = A^-1` and k = 2^squarings the largest eigenvalue of B is `(tr B^2k / tr B^k)^(1/k)`, low by less than
    # 0.2/k of itself whatever its neighbours are.
    for j in range(6):
        for i in range(6):
            D[j, i] = 1.0 if i == j else 0.0
        _solve(C, D[j])
    for i in range(6):
        for j in range(6):
            B[i, j] = D[i, j]
    logarithm, weight = 0.0, 1.0  # log of the scale taken out of B^k, per power
    for turn in range(squarings + 1):
        trace = B[0, 0] + B[1, 1] + B[2, 2] + B[3, 3] + B[4, 4] + B[5, 5]
        logarithm += math.log(trace) * weight
        for i in range(6):
            for j in range(6):
                B[i, j] /= trace
        if turn == squarings:
            break
        for i in range(6):
            for j in range(i + 1):
                s = 0.0
                for k in range(6):
                    s += B[i, k] * B[j, k]
                D[i, j] = s
        for i in range(6):
            for j in range(i + 1):
                B[i, j] = D[i, j]
                B[j, i] = D[i, j]
        weight *= 0.5
    last = 0.0
    for i in range(6):
        for k in range(6):
            last += B[i, k] * B[i, k]
    logarithm += math.log(last) * weight
    return math.exp(-0.5 * logarithm)


@kernel(
    "boolean(Compact, float64[:, ::1], float64[::1], int64, int64, float64, float64[::1], float64[::1])",
    entry=True,
    Compact=CHAIN,
)
def newton(
    chain: Compact, target: Float, w: Float, gravity: int, loaded: int, length: float, q: Float,
    measures: Float,
) -> bool:  # fmt: skip
    """Bring the loaded chain's TCP to a pose; ``q`` (6,) rad is start and result.

    Args:
        chain: Compact chain.
        target: (4, 4) T_base_tcp, m.
        w: (6,) N, N m about the TCP in base axes.
        gravity: Not 0: own weight acts.
        loaded: Not 0: the chain is loaded at all.
        length: L, m, that makes positions comparable to angles.
        q: (6,) rad, start and result.
        measures: (3,) result: smallest singular value of the scaled Jacobian, ``|sin|`` of the angle between axes 4
            and 6, largest component of the residual (m, rad).

    Returns:
        Whether the residual fell below the tolerance.
    """
    m = len(chain.stations) - 1
    frame, delta, trig, flat = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12), np.empty(36)
    J, A, C, e = flat.reshape((6, 6)), np.empty((6, 6)), np.zeros((6, 6)), np.empty(6)
    dR, turn, step = np.empty((3, 3)), np.empty(3), np.empty(6)
    B, D = np.empty((6, 6)), np.empty((6, 6))
    for _ in range(MAX_STEPS):
        joint_trig(q, trig)
        if loaded != 0:
            chain_pass(chain, trig, delta, 0, frame)
            loads(chain, frame, q, w, gravity, delta)
        chain_pass(chain, trig, delta, loaded, frame)
        tip = frame[m]
        for i in range(3):
            for j in range(3):
                dR[i, j] = target[i, 0] * tip[3 * j] + target[i, 1] * tip[3 * j + 1] + target[i, 2] * tip[3 * j + 2]
        rotation_vector(dR, turn)
        worst = 0.0
        for i in range(3):
            e[i] = (target[i, 3] - tip[9 + i]) / length
            e[3 + i] = turn[i]
            worst = max(worst, abs(e[i]) * length, abs(turn[i]))
        rigid_jacobian(chain, frame, flat)
        # Linear rows over L: a metre and a radian then count alike in sigma and in the damping.
        for k in range(18):
            flat[k] /= length
        for i in range(6):
            for j in range(i + 1):
                s = 0.0
                for k in range(6):
                    s += J[i, k] * J[j, k]
                A[i, j] = s
        _cholesky(A, C)
        sigma = _sigma_min(C, _ROUGH, B, D)
        measures[0] = sigma
        x = J[4, 3] * J[5, 5] - J[5, 3] * J[4, 5]
        y = J[5, 3] * J[3, 5] - J[3, 3] * J[5, 5]
        z = J[3, 3] * J[4, 5] - J[4, 3] * J[3, 5]
        measures[1] = math.sqrt(x * x + y * y + z * z)
        measures[2] = worst
        if worst < TOLERANCE:
            measures[0] = _sigma_min(C, _FINE, B, D)
            return True
        if sigma < _SIGMA_0:
            size = 0.0
            for i in range(6):
                size += e[i] * e[i]
            fall = (1.0 - sigma / _SIGMA_0) * _LAMBDA_0
            # 1e-18, so that a factor exists at an exact singularity too.
            damping = fall * fall * min(1.0, math.sqrt(size) / _E_0) + 1e-18
            for i in range(6):
                A[i, i] += damping
            _cholesky(A, C)
        _solve(C, e)
        largest = 0.0
        for k in range(6):
            s = 0.0
            for i in range(6):
                s += J[i, k] * e[i]
            step[k] = s
            largest = max(largest, abs(s))
        clamp = 1.0 if largest <= _STEP_RAD else _STEP_RAD / largest
        for k in range(6):
            q[k] += clamp * step[k]
    return False


class Bounds(NamedTuple):
    """Limits that a path is accepted within."""

    limits: Float2  # (6, 2) rad
    enforce: int  # not 0: joint limits are faults
    sigma_floor: float  # smallest singular value accepted, at the points and between them


BOUNDS: Final = bundle(Bounds)


class Followed(NamedTuple):
    """Results along a path."""

    q: Float2  # (n, 6) rad
    # (n, 3) joint-limit margin rad, smallest singular value since the point before, `|sin|` of the wrist
    measures: Float2
    axes: Int1  # (n,) axis 0..5 nearest to its limit
    fault: Float1  # (2,) of a fault: the value, its limit's index (0 lower, 1 upper) or the threshold


FOLLOWED: Final = bundle(Followed)


@kernel(
    "UniTuple(int64, 3)(Compact, float64[:, :, ::1], float64[:, ::1], int64, int64, float64, "
    "float64[::1], Bounds, Followed)",
    entry=True,
    Compact=CHAIN,
    Bounds=BOUNDS,
    Followed=FOLLOWED,
)
def follow(
    chain: Compact, targets: Float, ws: Float, gravity: int, loaded: int, length: float, start: Float,
    bounds: Bounds, followed: Followed,
) -> tuple[int, int, int]:  # fmt: skip
    """Follow a path of poses on one branch, each point seeded by the one before; stops at the first fault.

    Long moves between two points are followed along the straight line and the shortest turn between them, so that
    the joints move as the controller would move them.

    Args:
        chain: See :func:`newton`.
        targets: (n, 4, 4) T_base_tcp.
        ws: (n, 6) or (1, 6) wrench per point.
        gravity: See :func:`newton`.
        loaded: See :func:`newton`.
        length: See :func:`newton`.
        start: (6,) rad near the first point.
        bounds: What is accepted.
        followed: Results, written.

    Returns:
        Points done, how the next one ended (:data:`OK` where all are done), axis of the fault.
    """
    limits, enforce, sigma_floor = bounds.limits, bounds.enforce, bounds.sigma_floor
    out_q, out, axes, fault = followed.q, followed.measures, followed.axes, followed.fault
    points = targets.shape[0]
    q, measures = start.copy(), np.empty(3)
    before, here, angle = q.copy(), q.copy(), 0.0
    way, dR, turn = np.eye(4), np.empty((3, 3)), np.empty(3)
    for n in range(points):
        w = ws[n] if ws.shape[0] > 1 else ws[0]
        lowest = math.inf
        steps = 1
        if n > 0:
            far = 0.0
            for i in range(3):
                far += (targets[n, i, 3] - targets[n - 1, i, 3]) ** 2
                for j in range(3):
                    dR[i, j] = (
                        targets[n, i, 0] * targets[n - 1, j, 0]
                        + targets[n, i, 1] * targets[n - 1, j, 1]
                        + targets[n, i, 2] * targets[n - 1, j, 2]
                    )
            rotation_vector(dR, turn)
            angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
            steps = int(max(1.0, math.ceil(math.sqrt(far) / _SUB_M), math.ceil(angle / _SUB_RAD)))
        before[:] = q
        k = 1
        while k <= steps:
            if k < steps:
                f = k / steps
                a = f * angle
                s = math.sin(a) / angle if angle > 1e-12 else f
                c = (1.0 - math.cos(a)) / (angle * angle) if angle > 1e-6 else 0.5 * f * f
                x, y, t = turn[0], turn[1], turn[2]
                dR[0, 0], dR[0, 1], dR[0, 2] = 1.0 - c * (y * y + t * t), c * x * y - s * t, c * x * t + s * y
                dR[1, 0], dR[1, 1], dR[1, 2] = c * x * y + s * t, 1.0 - c * (x * x + t * t), c * y * t - s * x
                dR[2, 0], dR[2, 1], dR[2, 2] = c * x * t - s * y, c * y * t + s * x, 1.0 - c * (x * x + y * y)
                for i in range(3):
                    way[i, 3] = targets[n - 1, i, 3] + f * (targets[n, i, 3] - targets[n - 1, i, 3])
                    for j in range(3):
                        way[i, j] = (
                            dR[i, 0] * targets[n - 1, 0, j]
                            + dR[i, 1] * targets[n - 1, 1, j]
                            + dR[i, 2] * targets[n - 1, 2, j]
                        )
                goal = way
            else:
                goal = targets[n]
            here[:] = q
            done = newton(chain, goal, w, gravity, loaded, length, q, measures)
            lowest = min(lowest, measures[0])
            if not done:
                fault[0], fault[1] = measures[2], measures[0]
                # Asked before the failed search: one that fails beside a singularity failed for it.
                if lowest < sigma_floor:
                    fault[0] = lowest
                    return n, SINGULAR, -1
                return n, UNREACHED, -1
            if lowest < sigma_floor:
                fault[0], fault[1] = lowest, measures[1]
                return n, SINGULAR, -1
            jump = 0.0
            for i in range(6):
                jump = max(jump, abs(q[i] - here[i]))
            k += 1
            if n > 0 and jump > _JUMP_RAD:  # a wrist that swings round: look closer, or call it what it is
                if steps >= _FINEST:
                    fault[0], fault[1] = lowest, jump
                    return n, SINGULAR, -1
                steps *= 8
                q[:] = before
                lowest = math.inf
                k = 1
        margin, axis = math.inf, 0
        for i in range(6):
            out_q[n, i] = q[i]
            for side in range(2):
                room = q[i] - limits[i, 0] if side == 0 else limits[i, 1] - q[i]
                if room < margin:
                    margin, axis = room, i
        out[n, 0], out[n, 1], out[n, 2], axes[n] = margin, lowest, measures[1], axis
        if enforce != 0 and margin < -1e-9:
            fault[0], fault[1] = q[axis], 0.0 if q[axis] < limits[axis, 0] else 1.0
            return n, OUTSIDE, axis
    return points, OK, -1
