"""Poses that can be measured: within joint limits, above the floor, clear of the arm itself, seen by the tracker.

A tracker sees its target past the arm where the straight line between them clears the arm as a chain of capsules.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG
from counterflex.geometry import pose, rotation
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.order import order_of_poses
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.kinematics.inverse_seeds import branch_of
from counterflex.robot.model.controller_axes import coupled_inside

CLEARANCE_M: Final = 0.15
"""Distance that the line keeps from the axes of the arm's bodies."""
NEAR_M: Final = 0.25
"""Stretch of the line next to the target that is not looked at: the target sits on the tool."""


def seen(chain: ElasticChain, q: Float, p_base_tracker: Float, p_tcp_target: Float) -> Bool:
    """Mask of the poses in which the tracker sees its target.

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
    # Once more for s: clipping t to its segment moves the nearest point on the other (Ericson, 5.1.9).
    s = np.clip((b * t - d) / np.maximum(a, tiny), 0.0, 1.0)
    out: Float = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=-1)
    return out


FLOOR_M: Final = 0.25
ORDINARY_RAD_S: Final = 1.5
"""Speed of an axis where the robot's are not known."""
COLUMN_M: Final = 0.45
"""Distance of the tool and the wrist from the first axis, per metre of arm beyond one metre more."""
_LEAST_SINE = 0.1
_ROUNDS = 60


def measurable(
    cell: CellModel,
    count: int,
    rng: np.random.Generator,
    *,
    tracker: Float | None = None,
    p_tcp_target: Float | None = None,
    around_part: float = 0.5,
) -> Float:
    """Candidate poses of the cell's posture, spread over its work space and around the part.

    ``tracker``: (3,) m, place of the tracker in the base, or None where line of sight is not asked for.
    ``p_tcp_target``: (3,) m, its target on the tool. ``around_part``: Share of poses with the tool within 0.4 m and 45
    deg of its place on the part. Returns (count, 6) rad. Raises ReachError: hardly any pose passes.
    """
    chain = cell.nominal_chain
    offset = np.zeros(3) if p_tcp_target is None else p_tcp_target
    out: list[Float] = []
    have = 0
    for _ in range(_ROUNDS):
        near = _near_part(cell, chain, round(around_part * count), rng)
        far = _spread(cell, chain, 4 * count, rng)
        q = np.concatenate([near, far[: max(4 * (count - len(near)), 1)]])
        q = q[_clear(chain, q)]
        if tracker is not None and len(q):
            q = q[seen(chain, q, tracker, offset)]
        q = rng.permutation(q)
        out.append(q)
        have += len(q)
        if have >= count:
            return np.concatenate(out)[:count]
    raise ReachError(
        "hardly any pose can be measured",
        value=f"{have} of {count}",
        hint="Move the tracker to a position with line of sight to the tool, or choose another posture of the robot",
    )


def in_order(chain: ElasticChain, q: Float) -> Float:
    """Poses (m, 6) rad in an order with short travel in which few axes arrive against their play."""
    speeds = chain.joint_speeds_rad_s
    out: Float = q[order_of_poses(q, np.full(6, ORDINARY_RAD_S) if speeds is None else speeds)]
    return out


def _spread(cell: CellModel, chain: ElasticChain, count: int, rng: np.random.Generator) -> Float:
    """Joint angles within limits and half a turn around the middle, of the cell's posture."""
    limits = chain.joint_limits_rad + cell.joint_margin_rad * np.array([1.0, -1.0])
    middle = limits.mean(axis=1)
    low, high = np.maximum(limits[:, 0], middle - 120.0 * DEG), np.minimum(limits[:, 1], middle + 120.0 * DEG)
    q = low + (high - low) * rng.random((count, 6))
    out: Float = q[np.array([branch_of(chain, row) == cell.branch for row in q], dtype=np.bool_)]
    return out


def _near_part(cell: CellModel, chain: ElasticChain, count: int, rng: np.random.Generator) -> Float:
    rows = []
    tool = cell.T_base_part @ pose.make(rotation.about_x(180.0 * DEG))
    for _ in range(count):
        turn = rotation.exp(_ball(rng) * 45.0 * DEG) @ tool[:3, :3] @ rotation.about_z(rng.uniform(-1.0, 1.0) * np.pi)
        target = pose.make(turn, tool[:3, 3] + 0.4 * _ball(rng))
        try:
            rows.append(inverse(chain, target, cell.branch).q)
        except ReachError:
            continue
    q = np.array(rows, dtype=np.float64).reshape(-1, 6)
    limits = chain.joint_limits_rad + cell.joint_margin_rad * np.array([1.0, -1.0])
    out: Float = q[np.all((q >= limits[:, 0]) & (q <= limits[:, 1]), axis=1)]
    return out


def _ball(rng: np.random.Generator) -> Float:
    v = rng.standard_normal(3)
    out: Float = v / np.linalg.norm(v) * rng.random() ** (1.0 / 3.0)
    return out


def _clear(chain: ElasticChain, q: Float) -> Bool:
    """Above the floor, not inside the column, not at a stretched or folded wrist."""
    if len(q) == 0:
        return np.zeros(0, dtype=np.bool_)
    Ts, T = frames(chain, q), forward(chain, q)
    driven = np.flatnonzero(chain.joint >= 0)
    wrist, flange, tip = Ts[:, driven[4], :3, 3], Ts[:, driven[5], :3, 3], T[:, :3, 3]
    column = min(COLUMN_M, 0.3 * float(np.median(np.linalg.norm(wrist, axis=1))))
    ok = np.ones(len(q), dtype=np.bool_)
    for p in (wrist, flange, tip):
        ok &= (p[:, 2] > min(FLOOR_M, column)) & (np.hypot(p[:, 0], p[:, 1]) > column)
    sine = np.linalg.norm(np.cross(Ts[:, driven[3], :3, 2], Ts[:, driven[5], :3, 2]), axis=1)
    out: Bool = ok & (sine > _LEAST_SINE) & coupled_inside(chain.axes, chain.joint_limits_rad, q)
    return out
