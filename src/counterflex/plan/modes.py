"""Natural frequencies and mode shapes of the elastic chain in a posture, and how well they are known.

With inertia M and the compliances C = 1/k of the coordinates of :func:`counterflex.plan.elastic_motion.matrices`, the
free motion ``M x'' + K x = 0`` is solved in the form ``sqrt(C) M sqrt(C) y = y / omega^2``, ``x = sqrt(C) y``: rigid
coordinates (C = 0) and coordinates without mass drop out by themselves. Shapes are normalised to ``x' K x = 1``.

A frequency follows its constants by energy (Rayleigh's quotient, stationary at a mode)::

    d ln f = 1/2 (sum_i s_i d ln k_i - sum_b t_b d ln m_b)

with s_i the share of coordinate i in the strain energy and t_b that of body b in the kinetic energy.

Source: Meirovitch 2001, Fundamentals of Vibrations, ch. 7 (generalised eigenproblem, Rayleigh's quotient).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError, ModelError
from counterflex.plan.elastic_motion import inertia
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.description import Servo
from counterflex.signals.preview import Mode

Complex = NDArray[np.complex128]

_OVERDAMPED = 0.7
"""Poles with a larger damping ratio are no modes."""
_STILL = 1e-12
"""Share of the largest 1/omega^2 below which a coordinate has no mass or does not yield."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Undamped modes of a posture, drives held.

    Attributes:
        omega_rad_s: (m,) angular frequencies, rising.
        shapes: (n, m) rad or m of each coordinate; each column has twice the strain energy 1 J.
        strain: (n, m) share of each coordinate in the strain energy; columns sum to 1.
    """

    omega_rad_s: Float
    shapes: Float
    strain: Float


def modes(M: Float, stiffness: Float) -> Modes:
    """All modes of a posture.

    Args:
        M: (n, n) inertia, kg m2, kg m, kg; positive semidefinite.
        stiffness: (n,) N m/rad, N/m, > 0; infinite is rigid.

    Raises:
        InputError: Shapes do not match or a stiffness is not positive.
        ModelError: Nothing swings: the chain has no masses.
    """
    inertia = as_float("M", M, (None, None))
    if inertia.shape != (len(stiffness), len(stiffness)) or np.any(~(stiffness > 0.0)):
        raise InputError("modes need a stiffness above 0 for every coordinate", value=(inertia.shape, len(stiffness)))
    root = 1.0 / np.sqrt(stiffness)
    value, y = np.linalg.eigh(root[:, None] * inertia * root)
    value, y = value[::-1], y[:, ::-1]
    swings = value > _STILL * max(float(value[0]), 0.0)
    if not np.any(swings):
        raise ModelError("the chain has no masses, so it has no modes", hint="Give mass_kg of the bodies")
    y = y[:, swings]
    return Modes(1.0 / np.sqrt(value[swings]), root[:, None] * y, y**2)


def lowest_mode(M: Float, stiffness: Float, beta_s: float, servo: tuple[Servo | None, ...]) -> Mode:
    """Lowest mode of a posture while the drives hold it: the first of :func:`driven_modes`, with the same arguments."""
    return driven_modes(M, stiffness, beta_s, servo)[0]


def driven_modes(M: Float, stiffness: Float, beta_s: float, servo: tuple[Servo | None, ...]) -> list[Mode]:
    """Modes of a posture while the drives hold it, the lowest first.

    Eigenvalues of the linear equations (no play, no friction) that are damped by less than :data:`_OVERDAMPED`. In
    modal coordinates ``x = Phi y`` with ``G = Phi' K`` of the six axes and motor angles theta,
    ``y'' = -Omega^2 (y - G theta + beta (y' - G theta'))``; the gears load the motors with ``k Phi (y - G theta)``.

    Args:
        M: (n, n) inertia.
        stiffness: (n,), K is diagonal; the six axes come first.
        beta_s: s, damping D is beta K.
        servo: Of the six axes; None for one that never yields.

    Raises:
        ModelError: Nothing swings: the chain has no masses, or all is overdamped.
    """
    free = modes(M, stiffness)
    n, square = len(free.omega_rad_s), free.omega_rad_s[:, None] ** 2
    G = free.shapes[:AXES].T * stiffness[:AXES]
    A = np.zeros((2 * n + 2 * AXES, 2 * n + 2 * AXES))
    motors = slice(2 * n, 2 * n + AXES)
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -square * np.eye(n)
    A[n : 2 * n, n : 2 * n] = -beta_s * square * np.eye(n)
    A[n : 2 * n, motors] = square * G
    for a, entry in enumerate(servo):
        if entry is None:
            continue
        through = np.zeros(len(A))
        through[:n], through[motors] = G[:, a], -G[:, a] @ G
        row = through / entry.speed_gain_nm_s
        row[2 * n + AXES + a] -= 1.0 / entry.integral_time_s
        A[2 * n + AXES + a] = row
        A[2 * n + a] = row
        A[2 * n + a, 2 * n + a] -= entry.position_gain_per_s
        A[n : 2 * n] += beta_s * np.outer(square[:, 0] * G[:, a], A[2 * n + a])
    poles = np.linalg.eigvals(A)
    poles = poles[poles.imag > 1e-6 * np.abs(poles)]
    poles = poles[-poles.real < _OVERDAMPED * np.abs(poles)]
    if len(poles) == 0:
        raise ModelError("every mode is overdamped", value=beta_s, hint="Check damping and loop gains")
    poles = poles[np.argsort(np.abs(poles))]
    return [Mode(float(abs(pole)), float(-pole.real / abs(pole))) for pole in poles]


def frequency_response(
    M: Float, stiffness: Float, J: Float, beta_s: float, servo: tuple[Servo | None, ...], omega_rad_s: Float
) -> Complex:
    """Receptance of the tool's tip: motion per load, ``J Z^-1 J'`` with ``Z = -omega^2 M + K (1 + i omega beta)``.

    A drive that yields lies in series with its gear: its spring becomes ``1 / (1 / (k (1 + i omega beta)) + Y)`` with
    ``Y = s / (K (s + Kv) (s + 1/Ti))``, s = i omega (:mod:`counterflex.robot.elasticity.servo`).

    Args:
        M: (n, n) inertia.
        stiffness: (n,), K is diagonal; the six axes come first.
        J: (6, n) motion of the tip per coordinate.
        beta_s: s, damping D is beta K.
        servo: Of the six axes; None for one that never yields.
        omega_rad_s: (f,) > 0.

    Returns:
        (f, 6, 6) complex, m/N, rad/(N m), base axes.
    """
    s = 1j * np.asarray(omega_rad_s)[:, None]
    flexible = np.asarray(1.0 / (stiffness * (1.0 + beta_s * s)), dtype=np.complex128)
    for a, entry in enumerate(servo):
        if entry is not None:
            yields = entry.speed_gain_nm_s * (s + entry.position_gain_per_s) * (s + 1.0 / entry.integral_time_s)
            flexible[:, a] += (s / yields)[:, 0]
    # Z^-1 = C (1 + s^2 M C)^-1 with C the compliances: rigid coordinates need no large number
    inner = np.eye(len(stiffness)) + s[:, :, None] ** 2 * M * flexible[:, None, :]
    out: Complex = (J * flexible[:, None, :]) @ np.linalg.solve(inner, np.broadcast_to(J.T, (len(s), *J.T.shape)))
    return out


def kinetic_shares(chain: ElasticChain, q: Float, shapes: Float) -> Float:
    """Share of each body in the kinetic energy of modes.

    Args:
        chain: Masses.
        q: (6,) rad.
        shapes: (n, m) of :func:`modes`.

    Returns:
        (bodies, m); columns sum to 1.
    """
    angles = as_float("q", q, (6,))[None]
    out = np.zeros((chain.n, shapes.shape[1]))
    for body in np.flatnonzero(chain.mass > 0.0):
        alone = replace(chain, mass=np.where(np.arange(chain.n) == body, chain.mass, 0.0))
        out[body] = np.einsum("im,ij,jm->m", shapes, inertia(alone, angles)[0], shapes)
    shares: Float = out / out.sum(axis=0)
    return shares


def frequency_sigma(strain: Float, kinetic: Float, stiffness_sigma: Float, mass_sigma: Float) -> float:
    """Standard deviation of the logarithm of a frequency.

    Args:
        strain: (n,) shares of the strain energy.
        kinetic: (b,) shares of the kinetic energy.
        stiffness_sigma: (n,) standard deviations of the logarithms of stiffnesses, independent.
        mass_sigma: (b,) the same of masses.
    """
    return 0.5 * float(np.hypot(np.linalg.norm(strain * stiffness_sigma), np.linalg.norm(kinetic * mass_sigma)))
