"""Whether a tracker sees its target past the arm: straight line against the arm as a chain of capsules."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames

CLEARANCE_M: Final = 0.15
"""Distance that the line keeps from the axes of the arm's bodies."""
NEAR_M: Final = 0.25
"""Stretch of the line next to the target that is not looked at: the target sits on the tool."""


def seen(chain: ElasticChain, q: Float, p_base_tracker: Float, p_tcp_target: Float) -> Bool:
    """Which poses let the tracker see its target.

    Args:
        chain: The arm; its bodies are the lines between the origins of its frames up to the flange.
        q: (m, 6) rad.
        p_base_tracker: (3,) m.
        p_tcp_target: (3,) m, target on the tool.

    Returns:
        (m,) whether the line of sight keeps :data:`CLEARANCE_M` from every body.
    """
    Ts, T = frames(chain, q), forward(chain, q)
    target = (T[:, :3, :3] @ p_tcp_target) + T[:, :3, 3]
    way = p_base_tracker - target
    length = np.linalg.norm(way, axis=1, keepdims=True)
    start = target + way / length * np.minimum(NEAR_M, 0.5 * length)
    knots = np.concatenate([np.zeros((len(q), 1, 3)), Ts[:, : chain.flange_segment + 1, :3, 3]], axis=1)
    free = np.ones(len(q), dtype=np.bool_)
    for k in range(knots.shape[1] - 1):
        free &= _distance(start, p_base_tracker, knots[:, k], knots[:, k + 1]) > CLEARANCE_M
    return free


def _distance(a0: Float, a1: Float, b0: Float, b1: Float) -> Float:
    """(m,) smallest distance of the segments a0-a1 and b0-b1."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    a, b, c = np.sum(u * u, axis=-1), np.sum(u * v, axis=-1), np.sum(v * v, axis=-1)
    d, e = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    tiny = 1e-12
    s = np.clip((b * e - c * d) / np.maximum(a * c - b * b, tiny), 0.0, 1.0)
    t = np.clip((b * s + e) / np.maximum(c, tiny), 0.0, 1.0)
    s = np.clip((b * t - d) / np.maximum(a, tiny), 0.0, 1.0)
    out: Float = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=-1)
    return out
