"""Seeds of the inverse kinematics, and what its solutions are called."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import ElasticChain, frames
from counterflex.robot.model import opw
from counterflex.robot.model.description import Opw

_STARTS = 96  # Newton starts where no closed form exists
_PULLS_M = (1e-4, 1e-3, 3e-3)  # a pose this far outside the OPW reach may still be reached by the calibrated chain


def seeds(chain: ElasticChain, target: Float) -> list[Float]:
    """Starts of the Newton iteration.

    Closed form where the chain has OPW geometry (within one turn, limits ignored); where that has no solution, the
    pose is pulled by 3 mm at most towards the arm's reach. Without OPW geometry evenly spread angles within limits.

    Args:
        target: (4, 4) T_base_tcp, m.

    Returns:
        List of (6,) rad, empty where the pose is out of reach.
    """
    if chain.opw is not None:
        rows = opw.branches(chain.opw, flange_of(chain, target))
        results = [row for row in rows if np.all(np.isfinite(row))]
        if results:
            return results
        return _edge(chain.opw, flange_of(chain, target))
    limits = chain.joint_limits_rad
    low = np.maximum(limits[:, 0], limits.mean(axis=1) - np.pi)
    high = np.minimum(limits[:, 1], limits.mean(axis=1) + np.pi)
    # Evenly spread and the same on every machine: what is reached must not depend on random numbers.
    return [low + (high - low) * u for u in _halton(_STARTS)]


def _edge(geometry: Opw, T_base_flange: Float) -> list[Float]:
    reach = T_base_flange[:3, 3] - np.array([0.0, 0.0, geometry.c1_m])
    outward = reach / max(float(np.linalg.norm(reach)), 1e-9)
    for pull in _PULLS_M:
        # Too far out the arm is too short, too near the elbow cannot fold: the pull goes either way.
        for sign in (1.0, -1.0):
            moved = T_base_flange.copy()
            moved[:3, 3] -= sign * pull * outward
            results = [row for row in opw.branches(geometry, moved) if np.all(np.isfinite(row))]
            if results:
                return results
    return []


def _halton(count: int) -> Float:
    """(count, 6) evenly spread points of the unit cube."""
    out = np.empty((count, 6))
    for column, base in enumerate((2, 3, 5, 7, 11, 13)):
        for row in range(count):
            index, part, value = row + 1, 1.0, 0.0
            while index:
                part /= base
                value += part * (index % base)
                index //= base
            out[row, column] = value
    return out


def flange_of(chain: ElasticChain, T_base_tcp: Float) -> Float:
    """Rigid flange pose of a TCP pose: ``T_base_flange = T_base_tcp T_tcp_flange``; (..., 4, 4) to (..., 4, 4)."""
    out: Float = T_base_tcp @ pose.inverse(chain.T_flange_tcp)
    return out


def extension(chain: ElasticChain, Ts_base_tcp: Float, branch: str) -> Float | None:
    """Reserve of reach of a branch (rigid OPW geometry), m; (..., 4, 4) to (...). None without OPW geometry."""
    if chain.opw is None:
        return None
    return opw.extension(chain.opw, flange_of(chain, Ts_base_tcp), back=branch.startswith("back"))


def branch_of(chain: ElasticChain, q: Float) -> str:
    """Name of the branch that controller angles (6,) lie in, see :func:`branches_of`."""
    return branches_of(chain, as_float("q", q, (6,))[None])[0]


def branches_of(chain: ElasticChain, q: Float) -> list[str]:
    """Names of the branches that rows of controller angles lie in.

    With OPW geometry see :mod:`counterflex.robot.model.opw`. Without, the same three questions are asked of the axes:
    wrist (axis 5) ahead of axis 1 seen along ``z2 x z1``, elbow side by the turn from link arm to forearm about
    axis 3, wrist by the side of axis 6 against axis 4 about axis 5.

    Args:
        q: (n, 6) rad.
    """
    if chain.opw is not None:
        return [opw.BRANCHES[slot] for slot in opw.slots_of(chain.opw, q)]
    return [_branch_by_axes(chain, row) for row in q]


def _branch_by_axes(chain: ElasticChain, q: Float) -> str:
    Ts = frames(chain, q)[chain.joint >= 0]
    z, p = Ts[:, :3, 2], Ts[:, :3, 3]
    back = float((p[4] - p[0]) @ np.cross(z[1], z[0])) < 0.0
    low = float(z[2] @ np.cross(p[2] - p[1], p[4] - p[2])) < 0.0
    flip = float(z[4] @ np.cross(z[3], z[5])) < 0.0
    return opw.BRANCHES[4 * int(flip) + 2 * int(back) + int(low)]


def arm_length(chain: ElasticChain) -> float:
    """Length of the arm from axis 2 to the flange: the sum of its offsets, m; for scaling only."""
    first = int(np.flatnonzero(chain.joint == 1)[0])
    steps = [chain.fixed[i, :3, 3] for i in range(first + 1, chain.flange_segment + 1)]
    steps.append(chain.T_segment_flange[:3, 3])
    total = float(sum(np.linalg.norm(step) for step in steps))
    return total if total > 0.0 else 1.0
