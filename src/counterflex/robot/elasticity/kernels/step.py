"""The online step: deflection under the measured load and the joint angles that undo it; one call, no allocation."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.records import ELASTIC, Elastic
from counterflex.robot.elasticity.kernels.scalar import (
    chain_pass,
    joint_trig,
    loads,
    pose_difference,
    rigid_jacobian,
    small_cos,
    small_sin,
    tcp_compliance,
)

DAMPING_BELOW: Final = 1e-2  # sigma (1 m of lever per rad of rotation) below which the Newton step is damped
DAMPING: Final = 5e-3  # largest damping factor, reached at sigma = 0
REFUSE_BELOW: Final = 1e-3  # sigma below which no correction is given
STEP_LIMIT: Final = 0.1  # rad, clamp of one Newton step
DAMPED: Final = 1  # status bits
CLAMPED: Final = 2
REFUSED: Final = 4


@kernel("float64(float64[::1], float64, float64[::1], float64[::1])")
def cholesky_inverse(jac: Float, damping2: float, low: Float, inv: Float) -> float:
    """Inverse of the Cholesky factor of ``J J^T + damping2 1``, packed by rows (21,).

    Returns:
        ``sigma = trace((J J^T + damping2 1)^-1)^(-1/2)``: never above the smallest singular value of J, at least
        1/sqrt(6) of it, and equal to it in the limit of a singularity; 0 where the factor breaks down.
    """
    for i in range(6):
        for k in range(i + 1):
            s = damping2 if i == k else 0.0
            for c in range(6):
                s += jac[6 * i + c] * jac[6 * k + c]
            for c in range(k):
                s -= low[i * (i + 1) // 2 + c] * low[k * (k + 1) // 2 + c]
            if i == k:
                # Below every threshold, so that the caller refuses: beside a singularity no correction is the safe one.
                if s <= 1e-15:
                    return 0.0
                low[i * (i + 1) // 2 + i] = 1.0 / math.sqrt(s)
            else:
                low[i * (i + 1) // 2 + k] = s * low[k * (k + 1) // 2 + k]
    total = 0.0
    for i in range(6):
        d = low[i * (i + 1) // 2 + i]
        inv[i * (i + 1) // 2 + i] = d
        total += d * d
        for k in range(i):
            s = 0.0
            for c in range(k, i):
                s -= low[i * (i + 1) // 2 + c] * inv[c * (c + 1) // 2 + k]
            inv[i * (i + 1) // 2 + k] = s * d
            total += s * s * d * d
    return 1.0 / math.sqrt(total)


@kernel("int64(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def newton_step(jac: Float, inv: Float, error: Float, half: Float, step: Float) -> int:
    """Joint step ``-J^T (J J^T + damping2 1)^-1 error``, clamped; returns CLAMPED or 0."""
    for i in range(6):
        step[i] = 0.0
        s = 0.0
        for k in range(i + 1):
            s += inv[i * (i + 1) // 2 + k] * error[k]
        half[i] = s
    for k in range(6):
        s = 0.0
        for i in range(k, 6):
            s -= inv[i * (i + 1) // 2 + k] * half[i]
        for j in range(6):
            step[j] += jac[6 * k + j] * s
    peak = 0.0
    for j in range(6):
        peak = max(peak, abs(step[j]))
    if peak <= STEP_LIMIT:
        return 0
    for j in range(6):
        # All joints by one factor: to clamp one alone would turn the way of the tool.
        step[j] *= STEP_LIMIT / peak
    return CLAMPED


@kernel("void(float64[::1], float64[::1])")
def advance_trig(trig: Float, step: Float) -> None:
    """Turn cosines and sines by a clamped step of the joints, by the addition theorems."""
    for j in range(6):
        c, s, dc, ds = trig[j], trig[6 + j], small_cos(step[j]), small_sin(step[j])
        trig[j] = c * dc - s * ds
        trig[6 + j] = s * dc + c * ds


@kernel("void(float64[::1], float64[::1])")
def write_pose(tip: Float, out: Float) -> None:
    """Store a pose (12,) as a 4x4 matrix (16,)."""
    for r in range(3):
        out[4 * r], out[4 * r + 1], out[4 * r + 2] = tip[3 * r], tip[3 * r + 1], tip[3 * r + 2]
        out[4 * r + 3] = tip[9 + r]
    out[12], out[13], out[14], out[15] = 0.0, 0.0, 0.0, 1.0


@kernel("int64(Elastic, float64[::1], int64)", Elastic=ELASTIC)
def deflect(elastic: Elastic, inputs: Float, gravity: int) -> int:
    """Deflection, compliance and rigid Jacobian for ``given = [q, w_tcp_base]`` (12,): the first half of :func:`step`.

    Both poses, compliance, deflection and sigma are written; the work space then holds the Jacobian and the inverse of
    the (where needed damped) Cholesky factor. Returns DAMPED, REFUSED or 0.
    """
    chain, frame, delta = elastic.chain, elastic.frame, elastic.delta
    result, work = elastic.results[0], elastic.works[0]
    trig, jac, low, inv, error = work.trig[:], work.jacobian[:], work.factor[:], work.inverse[:], work.error[:]
    nominal, tip = work.nominal[:], frame[len(chain.stations) - 1]
    joint_trig(inputs, trig)
    chain_pass(chain, trig, delta, 0, frame)
    loads(chain, frame, inputs, inputs[6:], gravity, delta)
    tcp_compliance(chain, frame, inputs, result.compliance[:])
    rigid_jacobian(chain, frame, jac)
    for k in range(12):
        nominal[k] = tip[k]
    write_pose(tip, result.T0[:])
    chain_pass(chain, trig, delta, 1, frame)
    write_pose(tip, result.Te[:])
    pose_difference(nominal, tip, error)
    for k in range(6):
        result.deflection[k] = error[k]
    sigma = cholesky_inverse(jac, 0.0, low, inv)
    result.sigma = sigma
    if not sigma >= REFUSE_BELOW:
        return REFUSED
    if sigma >= DAMPING_BELOW:
        return 0
    cholesky_inverse(jac, DAMPING * DAMPING * (1.0 - (sigma / DAMPING_BELOW) ** 2), low, inv)
    return DAMPED


@kernel("int64(Elastic, float64[::1], int64)", Elastic=ELASTIC)
def step(elastic: Elastic, inputs: Float, gravity: int) -> int:
    """One online step for ``given = [q, w_tcp_base]`` (12,); returns the status bits.

    Equation by equation it stands in ``tests/references/elastic_equations.py``.
    """
    chain, frame, delta = elastic.chain, elastic.frame, elastic.delta
    result, work = elastic.results[0], elastic.works[0]
    trig, jac, inv, error = work.trig[:], work.jacobian[:], work.inverse[:], work.error[:]
    half, move, nominal = work.half[:], work.move[:], work.nominal[:]
    w, tip = inputs[6:], frame[len(chain.stations) - 1]
    status = deflect(elastic, inputs, gravity)
    q, residual, Tc = result.q[:], result.residual[:], result.Tc[:]
    for k in range(6):
        residual[k] = error[k]
        q[k] = inputs[k]
    for k in range(16):
        Tc[k] = result.T0[k]
    if status & REFUSED:
        return REFUSED
    # Two steps whatever the residual: a cycle has a fixed amount of work, and what is left is reported.
    for _ in range(2):
        status |= newton_step(jac, inv, error, half, move)
        for j in range(6):
            q[j] += move[j]
        advance_trig(trig, move)
        chain_pass(chain, trig, delta, 0, frame)
        loads(chain, frame, q, w, gravity, delta)
        write_pose(tip, Tc)
        chain_pass(chain, trig, delta, 1, frame)
        pose_difference(nominal, tip, error)
    for k in range(6):
        residual[k] = error[k]
    return status
