"""Natural frequencies and mode shapes of the elastic chain in a posture, and how well they are known.

With inertia M and the compliances C = 1/k of the coordinates of :func:`counterflex.plan.elastic_motion.matrices`, the
free motion ``M x'' + K x = 0`` is solved in the form ``sqrt(C) M sqrt(C) y = y / omega^2``, ``x = sqrt(C) y``: rigid
coordinates (C = 0) and coordinates without mass drop out by themselves. Shapes are normalised to ``x' K x = 1``.

A frequency follows its constants by energy (Rayleigh's quotient): the share of a spring in the strain energy is by how
much f^2 rises with its stiffness, that of a body in the kinetic energy by how much it falls with its mass.

Source: Meirovitch 2001, Fundamentals of Vibrations, ch. 7 (generalised eigenproblem, Rayleigh's quotient).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError, ModelError
from counterflex.plan.elastic_motion import coordinates, inertia, stiffness_of
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames
from counterflex.robot.model.description import Servo
from counterflex.signals.preview import Mode


def point_motion(chain: ElasticChain, q: Float, shapes: Float) -> tuple[Float, Float]:
    """Points of the arm, and their motion in given shapes.

    ``dp_i = sum_c x_c s_c`` over the coordinates c at or before segment i, with ``s_c = a_c x (p_i - o_c)`` of a
    turn about the axis ``a_c`` through ``o_c``, and ``s_c = a_c`` of a shift along it. Linear: right for small motion.

    ``q``: (6,) rad; ``shapes``: (n, m) rad or m of each coordinate of :func:`counterflex.plan.elastic_motion.matrices`.

    Returns:
        (k, 3) m, base axes: the robot's foot, the origin of every segment, the flange behind its segment, the tool's
        tip at the end; and (k, 3, m) m, their motion.

    Raises:
        InputError: The shapes are not of this chain.
    """
    Ts = frames(chain, as_float("q", q, (6,)))
    segment, direction, sign = coordinates(chain)
    x = as_float("shapes", shapes, (None, None))
    if len(x) != len(segment):
        raise InputError("the shapes are of another chain", value=len(x), limit=f"{len(segment)} coordinates")
    last = chain.flange_segment
    T_base_flange = (Ts[last] if last >= 0 else np.eye(4)) @ chain.T_segment_flange
    own = np.arange(chain.n)
    p = np.array([np.zeros(3), *Ts[: last + 1, :3, 3], T_base_flange[:3, 3], *Ts[last + 1 :, :3, 3]])
    p = np.vstack([p, forward(chain, q)[:3, 3]])
    on = np.concatenate([[-1], own[: last + 1], [last], own[last + 1 :], [chain.n - 1]])
    axis = sign[:, None] * Ts[segment, :3, direction % 3]
    turned = np.cross(axis, p[:, None] - Ts[segment, :3, 3])
    screw = np.where((direction >= 3)[:, None], turned, axis)
    moved: Float = np.einsum("kcd,cm->kdm", np.where((on[:, None] >= segment)[..., None], screw, 0.0), x)
    return p, moved


Complex = NDArray[np.complex128]

DRAWS: Final = 400
"""Robots that are drawn for an interval: its ends are then known to about a tenth of its width."""
_OVERDAMPED = 0.7
"""Poles with a larger damping ratio do not ring: they are no modes."""
_STILL = 1e-12
"""Share of the largest 1/omega^2 below which a coordinate has no mass or does not yield."""


@dataclass(frozen=True, eq=False)
class UndampedModes:
    """Undamped modes of a posture, drives held."""

    omega_rad_s: Float  # (m,) angular frequencies, rising
    shapes: Float  # (n, m) rad or m of each coordinate; each column has twice the strain energy 1 J
    strain: Float  # (n, m) share of each coordinate in the strain energy; columns sum to 1


def modes(M: Float, stiffness: Float) -> UndampedModes:
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
    return UndampedModes(1.0 / np.sqrt(value[swings]), root[:, None] * y, y**2)


def lowest_mode(M: Float, stiffness: Float, beta_s: float, servo: tuple[Servo | None, ...]) -> Mode:
    """Lowest mode of a posture while the drives hold it: the first of :func:`driven_modes`, with the same arguments."""
    return driven_modes(M, stiffness, beta_s, servo)[0]


def driven_modes(M: Float, stiffness: Float, beta_s: float, servo: tuple[Servo | None, ...]) -> list[Mode]:
    """Modes of a posture while the drives hold it, the lowest first.

    Eigenvalues of the linear equations (no play, no friction) that are damped by less than :data:`_OVERDAMPED`; where
    none is, the lowest mode with drives that stand still, damped by that. In
    modal coordinates ``x = Phi y`` with ``G = Phi' K`` of the six axes and motor angles theta,
    ``y'' = -Omega^2 (y - G theta + beta (y' - G theta'))``; the gears load the motors with ``k Phi (y - G theta)``.

    Args:
        M: (n, n) inertia.
        stiffness: (n,), K is diagonal; the six axes come first.
        beta_s: s, damping D is beta K.
        servo: Of the six axes; None for one that never yields.

    Raises:
        ModelError: Nothing swings: the chain has no masses.
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
    # One of each pair. Real poles are integrators and drives that creep: they do not ring.
    poles = poles[poles.imag > 1e-6 * np.abs(poles)]
    poles = poles[-poles.real < _OVERDAMPED * np.abs(poles)]
    if len(poles) == 0:
        return [Mode(float(free.omega_rad_s[0]), _OVERDAMPED)]
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
        q: (6,) rad.
        shapes: (n, m) of :func:`modes`.

    Returns:
        (bodies, m); columns sum to 1.
    """
    bodies, parts = inertia_of_bodies(chain, q)
    out = np.zeros((chain.n, shapes.shape[1]))
    out[bodies] = np.einsum("im,bij,jm->bm", shapes, parts, shapes)
    shares: Float = out / out.sum(axis=0)
    return shares


@dataclass(frozen=True, eq=False)
class ModelSpread:
    """Uncertainty of the constants of a chain: standard deviations of their logarithms."""

    stiffness: Float  # (n,) of each coordinate
    mass: Float  # (bodies,) of each mass, independent
    common: float  # share of the variance of stiffnesses that all have in common, 0 to 1


def drawn_frequencies(chain: ElasticChain, q: Float, spread: ModelSpread, draws: int = DRAWS, seed: int = 0) -> Float:
    """Natural frequencies of robots as a chain is known, its own values their medians.

    Modes that lie near each other change places, so the lowest of a draw is lower than the first mode is alone.

    Args:
        q: (6,) rad.
        spread: How well it is known.
        draws: Number of robots.
        seed: Of the random numbers; the same on every machine.

    Returns:
        (draws, n) rad/s, rising; inf where a coordinate has no mass.
    """
    rng = np.random.default_rng(seed)
    bodies, parts = inertia_of_bodies(chain, q)
    stiffness = stiffness_of(chain, as_float("q", q, (6,))[None])[0]
    shared, own = rng.standard_normal((draws, 1)), rng.standard_normal((draws, len(stiffness)))
    z = np.sqrt(spread.common) * shared + np.sqrt(1.0 - spread.common) * own
    root = np.exp(-0.5 * spread.stiffness * z) / np.sqrt(stiffness)
    heavy = np.exp(spread.mass[bodies] * rng.standard_normal((draws, len(bodies))))
    M = np.einsum("db,bij->dij", heavy, parts)
    value = np.linalg.eigvalsh(root[:, :, None] * M * root[:, None, :])[:, ::-1]
    still = value <= _STILL * value[:, :1]
    out: Float = np.where(still, np.inf, 1.0 / np.sqrt(np.where(still, 1.0, value)))
    return out


def inertia_of_bodies(chain: ElasticChain, q: Float) -> tuple[Int, Float]:
    """Bodies (k,) that have a mass, and the inertia (k, n, n) of each by itself in the posture q (6,) rad."""
    angles = as_float("q", q, (6,))[None]
    bodies = np.flatnonzero(chain.mass > 0.0)
    alone = [replace(chain, mass=np.where(np.arange(chain.n) == b, chain.mass, 0.0)) for b in bodies.tolist()]
    return bodies, np.array([inertia(one, angles)[0] for one in alone])
