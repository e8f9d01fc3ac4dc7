"""Motion that play and dry friction of the axes add to a pull, and its uncertainty.

A pull from rest meets the friction of the axes: part of the load is held by it, so the arm looks stiffer, by an amount
that depends on where each axis came from. Two remedies: approach the pose again the same way under load, so that the
friction is the same in both states and cancels (play still shows where the torque of an axis changes its sign), or
predict it with the model of :mod:`counterflex.robot.elasticity.play`. Where the history is not known, what friction
can do at most is added to the standard deviation.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.identify.pulls.pulls import AGAIN, RELAXED, Pulls
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.play import STIFFEST_RAD_NM, axis_torque, relaxed, torsion_path
from counterflex.robot.model.description import Play

FRICTION_SIGMA: Final = 0.2
"""Relative standard deviation of friction and play in a cell file."""
WEIGHT_SIGMA: Final = 0.1
"""Relative standard deviation of masses in a cell file."""
DIRECTION_RAD: Final = 0.01
"""How well the direction of a load is known, per axis."""
_STEP = 1e-3  # relative change of the half bands for their derivative
_LEAST_RAD = 1e-7


def lost_angles(chain: ElasticChain, pulls: Pulls) -> Float:
    """Lost motion of the axes between the unloaded and the loaded reading.

    Each row is a path of its own: relaxed at ``q + approach``, to ``q`` (unloaded reading), load on, and, where it was
    approached again, back to ``q + approach`` and to ``q`` under load (loaded reading).

    ``chain``: With play; axes without an entry lose nothing. Returns (n, 6) rad, positive in the positive direction of
    the axis angles. Raises ModelError: the pulls have no history.
    """
    n = len(pulls)
    play = chain.play
    if play is None:
        return np.zeros((n, 6))
    if pulls.history == RELAXED:
        return relaxed(chain, pulls.q, pulls.w_tcp_base) - relaxed(chain, pulls.q)
    if not pulls.history or pulls.approach is None:
        raise ModelError("lost motion of pulls whose history is not known", where=pulls.where)
    start, load, none = pulls.q + pulls.approach, pulls.w_tcp_base, np.zeros_like(pulls.w_tcp_base)
    stations = [(start, none), (pulls.q, none), (pulls.q, load)]
    if pulls.history == AGAIN:
        stations += [(start, load), (pulls.q, load)]
    q = np.stack([s[0] for s in stations])
    w = np.stack([s[1] for s in stations])
    torque = axis_torque(chain, q.reshape(-1, 6), w.reshape(-1, 6)).reshape(q.shape)
    soft = np.maximum(chain.compliance[chain.torsion, 5], STIFFEST_RAD_NM)
    band, limit, slip = _arrays(play)
    # Axes do not act on each other here, so one compiled path walks all of them at once instead of n times six.
    columns = (len(stations), 6 * n)  # axes are independent: those of all rows side by side in one path
    s = torsion_path(
        q.reshape(columns),
        torque.reshape(columns),
        np.tile(soft, n),
        np.tile(band, n),
        np.tile(limit, (n, 1)),
        np.tile(slip, (n, 1)),
    ).reshape(q.shape)
    lost = s - soft * torque
    out: Float = lost[-1] - lost[1]
    out[:, [entry is None for entry in play]] = 0.0
    return out


def band_slopes(chain: ElasticChain, pulls: Pulls) -> Float:
    """Derivative of :func:`lost_angles` of each axis by the half band of its play.

    -2 .. 2: 2 where the load turns the torque of an axis round, 0 where it does not. Returns (n, 6).
    """
    if chain.play is None:
        return np.zeros((len(pulls), 6))
    half = np.array([_LEAST_RAD if e is None else max(e.half_band_rad, _LEAST_RAD) for e in chain.play])
    ends = [lost_angles(_with_bands(chain, half * factor), pulls) for factor in (1.0 + _STEP, 1.0 - _STEP)]
    out: Float = (ends[0] - ends[1]) / (2.0 * _STEP * half)
    return out


def uncertain_angles(chain: ElasticChain, pulls: Pulls) -> Float:
    """Standard deviation of the lost motion where play and friction are known but not exactly.

    Half the range of :func:`lost_angles` over friction and weights that are off by :data:`FRICTION_SIGMA` and
    :data:`WEIGHT_SIGMA`, and over loads turned by twice :data:`DIRECTION_RAD`: it shows where an axis nearly floats, so
    that nobody can say on which side of its play it is. Such rows, believed, make the play smaller and the torsion
    softer than they are.

    ``chain``: With play or None. Returns (n, 6) rad.
    """
    if chain.play is None:
        return np.zeros((len(pulls), 6))
    angles = [
        lost_angles(replace(chain, play=_with_friction(chain, dry), mass=chain.mass * weight), pulls)
        for dry in (1.0 - FRICTION_SIGMA, 1.0 + FRICTION_SIGMA)
        for weight in (1.0 - WEIGHT_SIGMA, 1.0 + WEIGHT_SIGMA)
    ]
    w = pulls.w_tcp_base
    for turn in 2.0 * DIRECTION_RAD * np.concatenate([np.eye(3), -np.eye(3)]):
        turned = w + np.hstack([np.cross(turn, w[:, :3]), np.cross(turn, w[:, 3:])])
        angles.append(lost_angles(chain, replace(pulls, w_tcp_base=turned)))
    out: Float = 0.5 * (np.max(angles, axis=0) - np.min(angles, axis=0))
    return out


def unknown_angles(chain: ElasticChain) -> Float:
    """Standard deviation (6,) rad that friction and play add to each axis where the history is not known.

    Anything between ``-(b + c F)`` and ``b + c F`` is equally likely (half band b, friction F, torsion compliance c),
    so the standard deviation is that over root 3.
    """
    if chain.play is None:
        return np.zeros(6)
    soft = chain.compliance[chain.torsion, 5]
    most = [
        0.0 if entry is None else entry.half_band_rad + c * sum(entry.friction_nm)
        for entry, c in zip(chain.play, soft, strict=True)
    ]
    # Uniform over the whole loop: its standard deviation is the half width over root 3.
    return np.array(most) / math.sqrt(3.0)


def lost_sigma(chain: ElasticChain, pulls: Pulls) -> Float:
    """Standard deviation that lost motion adds to the displacement of the TCP.

    :func:`uncertain_angles` where the history is known, :func:`unknown_angles` where it is not, carried to the tool.

    ``chain``: With play or None. Returns (n, 6) m, rad, base axes.
    """
    angles = uncertain_angles(chain, pulls) if pulls.history else unknown_angles(chain)[None, :]
    out: Float = np.sqrt(np.sum((jacobian(chain, pulls.q) * angles[:, None, :]) ** 2, axis=2))
    return out


def _arrays(play: tuple[Play | None, ...]) -> tuple[Float, Float, Float]:
    m = max((len(entry.friction_nm) for entry in play if entry is not None), default=0)
    band, limit, slip = np.zeros(6), np.zeros((6, m)), np.ones((6, m))
    for axis, entry in enumerate(play):
        if entry is not None:
            count = len(entry.friction_nm)
            band[axis] = entry.half_band_rad
            limit[axis, :count], slip[axis, :count] = entry.friction_nm, entry.slip_rad
    return band, limit, slip


def _with_friction(chain: ElasticChain, factor: float) -> tuple[Play | None, ...]:
    return tuple(
        None if entry is None else replace(entry, friction_nm=tuple(factor * f for f in entry.friction_nm))
        for entry in chain.play or ()
    )


def _with_bands(chain: ElasticChain, half_band: Float) -> ElasticChain:
    play = tuple(
        None if entry is None else replace(entry, half_band_rad=float(b))
        for entry, b in zip(chain.play or (), half_band, strict=True)
    )
    return replace(chain, play=play)
