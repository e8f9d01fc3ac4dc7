"""The elastic model equation by equation, for one point: the specification of the compiled kernels.

Slow and plain on purpose, and generic in the kind of number: with :data:`DOUBLE` it runs in double precision, with the
functions of an arbitrary-precision library in as many digits as wanted. Names and shapes as in
:mod:`counterflex.robot.elasticity.chain` and :mod:`counterflex.robot.elasticity.kernels.step`; no checks of its
arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.step import (
    CLAMPED,
    DAMPED,
    DAMPING,
    DAMPING_BELOW,
    REFUSE_BELOW,
    REFUSED,
    STEP_LIMIT,
)

Numbers = npt.NDArray[Any]


@dataclass(frozen=True)
class Arithmetic:
    """A kind of number: its constructor from a float and the functions the model needs."""

    number: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    sin: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    atan2: Callable[[Any, Any], Any]

    def array(self, values: Any) -> Numbers:
        """Every entry as such a number, in an object array."""
        source = np.asarray(values)
        out = np.empty(source.shape, dtype=object)
        for index, value in np.ndenumerate(source):
            out[index] = self.number(value)
        return out


DOUBLE = Arithmetic(float, math.cos, math.sin, math.sqrt, math.atan2)


def turn(axis: int, angle: Any, a: Arithmetic) -> Numbers:
    """Rotation (3, 3) about x, y or z (axis 0, 1, 2)."""
    R = a.array(np.eye(3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i] = R[j, j] = a.cos(angle)
    R[j, i] = a.sin(angle)
    R[i, j] = -R[j, i]
    return R


def cross(u: Numbers, v: Numbers) -> Numbers:
    """Cross product of two vectors."""
    return np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], dtype=object)


def as_doubles(q: Numbers) -> Numbers:
    """Angles (6,) in double precision: factors of regions are facts of measurement, as compliances are."""
    return np.array([float(angle) for angle in q])


def walk(chain: ElasticChain, q: Numbers, delta: Numbers | None, a: Arithmetic) -> tuple[list[Numbers], list[Numbers]]:
    """Rotations and positions of the n segment frames after their drives, and of the TCP as entry n.

    ``T_next = T fixed Rz(sign q + offset)``, then, with ``delta`` (n, 6), ``Trans(delta_0..2) Rz(delta_5) Ry(delta_4)
    Rx(delta_3)`` (Haehn2020 eq. 2-9).
    """
    R, p = a.array(np.eye(3)), a.array(np.zeros(3))
    Rs, ps = [], []
    for i in range(chain.n):
        p = p + R @ a.array(chain.fixed[i, :3, 3])
        R = R @ a.array(chain.fixed[i, :3, :3])
        if chain.joint[i] >= 0:
            R = R @ turn(2, a.number(chain.sign[i]) * q[chain.joint[i]] + a.number(chain.offset[i]), a)
        Rs.append(R)
        ps.append(p)
        if delta is not None:
            p = p + R @ delta[i, :3]
            R = R @ turn(2, delta[i, 5], a) @ turn(1, delta[i, 4], a) @ turn(0, delta[i, 3], a)
    Rs.append(R @ a.array(chain.T_last_tcp[:3, :3]))
    ps.append(p + R @ a.array(chain.T_last_tcp[:3, 3]))
    return Rs, ps


def displacements(chain: ElasticChain, q: Numbers, w: Numbers, a: Arithmetic) -> Numbers:
    """Elastic displacements (n, 6): compliance times the wrench about and in each segment's frame, rigid geometry."""
    Rs, ps = walk(chain, q, None, a)
    delta = a.array(np.zeros((chain.n, 6)))
    for i in range(chain.n):
        moment = w[3:] + cross(ps[-1] - ps[i], w[:3])
        delta[i, :3] = Rs[i].T @ w[:3]
        delta[i, 3:] = Rs[i].T @ moment
    return a.array(chain.compliance_at(as_doubles(q))) * delta


def difference(R0: Numbers, p0: Numbers, R1: Numbers, p1: Numbers, a: Arithmetic) -> Numbers:
    """``[p1 - p0, log(R1 R0^T)]`` (6,)."""
    R = R1 @ R0.T
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]], dtype=object) / a.number(2)
    s = a.sqrt(v @ v)
    if s != 0:
        v = v * (a.atan2(s, (np.trace(R) - a.number(1)) / a.number(2)) / s)
    return np.concatenate([p1 - p0, v])


def compliance(chain: ElasticChain, q: Numbers, a: Arithmetic) -> Numbers:
    """``C = sum_i sum_d c_id(q) J_id J_id^T`` (6, 6) with ``J_id`` the TCP twist of direction d of element i."""
    Rs, ps = walk(chain, q, None, a)
    C, c = a.array(np.zeros((6, 6))), chain.compliance_at(as_doubles(q))
    for i in range(chain.n):
        for d in range(6):
            axis = Rs[i][:, d % 3]
            zero = a.array(np.zeros(3))
            twist = np.concatenate([axis, zero] if d < 3 else [cross(axis, ps[-1] - ps[i]), axis])
            C = C + a.number(c[i, d]) * np.outer(twist, twist)
    return C


def jacobian(chain: ElasticChain, q: Numbers, a: Arithmetic) -> Numbers:
    """Rigid geometric Jacobian (6, 6) at the TCP in base axes, per controller angle."""
    Rs, ps = walk(chain, q, None, a)
    J = a.array(np.zeros((6, 6)))
    for i in range(chain.n):
        if chain.joint[i] >= 0:
            axis = a.number(chain.sign[i]) * Rs[i][:, 2]
            J[:, chain.joint[i]] = np.concatenate([cross(axis, ps[-1] - ps[i]), axis])
    return J


def inverted(A: Numbers, a: Arithmetic) -> Numbers:
    """Inverse of a small matrix by Gauss-Jordan elimination with pivoting."""
    n = len(A)
    M = np.concatenate([A, a.array(np.eye(n))], axis=1)
    for k in range(n):
        best = max(range(k, n), key=lambda r: abs(M[r, k]))
        M[[k, best]] = M[[best, k]]
        M[k] = M[k] / M[k, k]
        for r in range(n):
            if r != k:
                M[r] = M[r] - M[r, k] * M[k]
    return M[:, n:]


@dataclass(frozen=True)
class StepResult:
    """Results of :func:`step`."""

    C: Numbers
    d: Numbers
    q_c: Numbers
    p_c: Numbers
    residual: Numbers
    sigma: Any
    status: int


def step(chain: ElasticChain, q: Numbers, w: Numbers, a: Arithmetic) -> StepResult:
    """The online step: ``q_c = q - sum of two steps J^T (J J^T + lambda^2)^-1 (fk_elastic(q_c, w) - fk_rigid(q))``."""
    q, w = a.array(q), a.array(w)
    Rs, ps = walk(chain, q, None, a)
    R0, p0 = Rs[-1], ps[-1]

    def error(angles: Numbers) -> Numbers:
        Re, pe = walk(chain, angles, displacements(chain, angles, w, a), a)
        return difference(R0, p0, Re[-1], pe[-1], a)

    C, d = compliance(chain, q, a), error(q)
    J = jacobian(chain, q, a)
    A = J @ J.T
    inverse = inverted(A, a)
    sigma = a.number(1) / a.sqrt(np.trace(inverse))
    if sigma < REFUSE_BELOW:
        return StepResult(C, d, q, p0, d, sigma, REFUSED)
    status = 0
    if sigma < DAMPING_BELOW:
        status = DAMPED
        ratio = sigma / a.number(DAMPING_BELOW)
        inverse = inverted(A + a.number(DAMPING) ** 2 * (1 - ratio * ratio) * a.array(np.eye(6)), a)
    q_c, residual = q, d
    for _ in range(2):
        move = -(J.T @ (inverse @ residual))
        peak = max(abs(m) for m in move)
        if peak > STEP_LIMIT:
            move = move * (a.number(STEP_LIMIT) / peak)
            status |= CLAMPED
        q_c = q_c + move
        residual = error(q_c)
    return StepResult(C, d, q_c, walk(chain, q_c, None, a)[1][-1], residual, sigma, status)
