"""Modes of the robot as the tool tip sees them, in a posture.

Those of :func:`counterflex.plan.modes.modes`, drives held, with the shapes x at the tip and for a modal mass of 1 kg:
``u = omega X J x`` where ``x' K x = 1`` and X is the motion of the tool relative to the part by that of the hand. A
chain without masses of its own gets assumed ones (:func:`counterflex.plan.lowest_mode.assumed_masses`), all times the
factor that puts the lowest frequency where a tap test measured it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.cutting.stability.modes import TipModes
from counterflex.plan.elastic_motion import inertia, jacobians, stiffness_of
from counterflex.plan.lowest_mode import assumed_masses, can_move
from counterflex.plan.modes import modes
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode

HIGHEST_HZ: Final = 150.0
"""Modes above are left out: there the bodies themselves bend, and what they do must be measured at the tool."""


def robot_modes(chain: ElasticChain, q: Float, to_part: Float, measured: Mode | None, damping_ratio: float) -> TipModes:
    """Modes below :data:`HIGHEST_HZ` in a posture, and the lowest, shapes in part axes.

    Args:
        q: (6,) rad.
        to_part: (6, 6) motion of the tool relative to the part, part axes, from that of the hand, base axes: of
            :class:`counterflex.plan.relative_motion.RelativeMotion`.
        measured: Lowest mode of a tap test, or None; used where the chain has no masses of its own.
        damping_ratio: Of every mode.

    Raises:
        ModelError: Nothing yields.
    """
    return robot_modes_along(chain, q[None], to_part[None], measured, damping_ratio)[0]


def robot_modes_along(
    chain: ElasticChain, q: Float, to_part: Float, measured: Mode | None, damping_ratio: float
) -> list[TipModes]:
    """:func:`robot_modes` of many postures, q (k, 6) rad."""
    return [one[0] for one in drawn_modes(chain, q, to_part, measured, damping_ratio, np.ones((1, 1)))]


def drawn_modes(
    chain: ElasticChain,
    q: Float,
    to_part: Float,
    measured: Mode | None,
    damping_ratio: float,
    stiffness_factors: Float,
) -> list[list[TipModes]]:
    """Modes of many postures and of robots whose springs differ from those of the chain.

    Args:
        q: (k, 6) rad.
        to_part: (k, 6, 6), or (1, 6, 6) where it is the same in all.
        measured: Lowest mode of a tap test, or None; used where the chain has no masses of its own.
        damping_ratio: Of every mode.
        stiffness_factors: (d, n) factors on the stiffness of the coordinates of
            :func:`counterflex.plan.elastic_motion.matrices`, or (d, 1).

    Returns:
        k lists of d.

    Raises:
        ModelError: Nothing yields.
    """
    if not np.any(chain.compliance > 0.0):
        raise ModelError("nothing of the robot yields, so it has no modes", hint="Give compliances, or a tool response")
    moves = can_move(chain)
    heavy = chain if moves else assumed_masses(chain, q[0])
    J, _ = jacobians(heavy, q)
    out = []
    seen = np.broadcast_to(to_part, (len(q), 6, 6)) @ J
    for M, stiffness, at_tip in zip(inertia(heavy, q), _each(stiffness_of(heavy, q), len(q)), seen, strict=True):
        scale = 1.0
        if measured is not None and not moves:
            scale = measured.omega_rad_s / float(modes(M, stiffness).omega_rad_s[0])
        robots = []
        for factor in stiffness_factors:
            free = modes(M, stiffness * factor)
            omega = free.omega_rad_s * scale
            shape = at_tip[:3] @ free.shapes * omega
            # The lowest stays however high it is: a stiff arm would have no mode at all.
            chosen = omega <= max(2.0 * math.pi * HIGHEST_HZ, float(omega[0]))
            robots.append(TipModes(omega[chosen], np.full(int(chosen.sum()), damping_ratio), shape[:, chosen]))
        out.append(robots)
    return out


def _each(stiffness: Float, count: int) -> Float:
    """A row for each posture."""
    return np.broadcast_to(stiffness, (count, stiffness.shape[1]))
