"""Deviation of the tool by play, friction and yielding of the drives, along the path as it is commanded.

What the axes lose depends on where they come from, so the whole path counts, air moves included; and a correction
moves the axes itself, so it is asked of the corrected path. Friction is relaxed at the first point, as after a rest.
A part frame measured with the robot itself contains the play that the touched points had; friction was relaxed there.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import wrench
from counterflex.plan.part_frame import sag_deviation, true_part_frame
from counterflex.plan.response import swing
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.servo import servo_error
from counterflex.signals.preview import Mode


def play_deviation(
    chain: ElasticChain,
    T_base_part: Float,
    p_part: Float,
    q: Float,
    w_tcp_part: Float,
    time_s: Float,
    touched: tuple[Float, Float] | None,
    mode: Mode,
) -> Float:
    """Deviation of the tool by lost motion and by motors that yield, beside sag and deflection.

    Args:
        chain: Robot and end effector with play and servo gains; without both, the deviation is exactly zero.
        T_base_part: (4, 4) part frame as the controller knows it.
        p_part: (n, 3) m, programmed points in the order of the path.
        q: (n, 6) rad, commanded angles there, corrections included.
        w_tcp_part: (n, 6) N, N m, process wrench about the tip in part axes.
        time_s: (n,) s.
        touched: Datum points (k, 3) m in the part frame and the angles (k, 6) rad at which they were touched, or None
            for a frame measured from outside.
        mode: The structural mode through which the process load reaches the motors.

    Returns:
        (n, 3) m, part axes, actual - nominal.
    """
    if chain.play is None and chain.servo is None:
        return np.zeros((len(p_part), 3))
    w_base = wrench.rotate(T_base_part[:3, :3], w_tcp_part)
    lost, load = play.torsion(chain, q, w_base)
    if chain.servo is not None:
        lost = lost + servo_error(chain.servo, q, swing(load, time_s, mode), time_s)
    off = play.at_tcp(chain, q, lost)[:, :3]
    return in_touched_frame(chain, T_base_part, p_part, touched, off)


def in_touched_frame(
    chain: ElasticChain, T_base_part: Float, p_part: Float, touched: tuple[Float, Float] | None, deviation_base: Float
) -> Float:
    """Deviation from a path in a part frame that was touched with play in the axes.

    Args:
        chain: Robot and end effector.
        T_base_part: (4, 4) part frame as the controller knows it.
        p_part: (n, 3) m, programmed points.
        touched: See :func:`play_deviation`.
        deviation_base: (n, 3) m, actual minus commanded tip, base axes.

    Returns:
        (n, 3) m, part axes.
    """
    T_base_true = T_base_part
    if touched is not None and chain.play is not None:
        datum, q_datum = touched
        there = play.at_tcp(chain, q_datum, play.relaxed(chain, q_datum))[:, :3]
        T_base_true = true_part_frame(T_base_part, datum, there)
    return sag_deviation(T_base_part, T_base_true, p_part, deviation_base)


def corrected_joints(chain: ElasticChain, T_base_part: Float, q: Float, correction: Float, turn: Float) -> Float:
    """Angles of a corrected point from those of the programmed one, ``q + J(q)^-1 u``.

    Corrections are millimetres over metres: the second order is below 1e-6 rad.

    Args:
        chain: As the controller has it.
        T_base_part: (4, 4).
        q: (n, 6) rad, away from singularities.
        correction: (n, 3) m, part axes.
        turn: (n, 3) rad, part axes.

    Returns:
        (n, 6) rad; rows without a correction are returned as they are.
    """
    out = q.copy()
    rows = np.flatnonzero(np.any(correction != 0.0, axis=1) | np.any(turn != 0.0, axis=1))
    if len(rows):
        u = np.concatenate([correction[rows], turn[rows]], axis=1) @ _both(T_base_part[:3, :3]).T
        out[rows] += np.linalg.solve(jacobian(chain, q[rows]), u[..., None])[..., 0]
    return out


def _both(R_base_part: Float) -> Float:
    """(6, 6) that turns linear and angular part alike."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = R_base_part
    return turn
