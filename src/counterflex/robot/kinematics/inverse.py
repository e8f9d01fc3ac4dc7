"""Inverse kinematics on the calibrated elastic chain: seed in closed form, polish by damped Newton steps.

The identified geometry of a chain may deviate from its OPW lengths, and a wrench and the own weight displace the TCP:
the polished angles bring the *loaded* TCP of :func:`counterflex.robot.elasticity.chain.forward_elastic` to the
target. Chains without OPW geometry are seeded from a fixed set of starts within the joint limits.

Lengths are compared to angles by ``L``, half the arm's length from axis 2 to the flange; ``sigma_min`` is the
smallest singular value of the Jacobian with its linear rows divided by L.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError, ReachError
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.kinematics import inverse_kernel, reach_errors
from counterflex.robot.kinematics.inverse_seeds import arm_length, branches_of, extension, seeds
from counterflex.robot.model import opw
from counterflex.robot.model.controller_axes import room

SIGMA_FLOOR: Final = 0.005
"""Scaled sigma_min below which :func:`inverse` and :func:`inverse_path` refuse (about 0.6 deg of axis 5)."""

_SAME_RAD = 1e-6


@dataclass(frozen=True)
class Solution:
    """Joint angles that reach a pose, and how comfortably."""

    q: Float  # (6,) rad controller angles
    branch: str  # such as `front up noflip`, see counterflex.robot.model.opw
    limit_margin_rad: float  # distance of the axis nearest to its limit; negative outside
    limit_axis: int  # that axis, 0..5
    wrist: float  # `|sin|` of the angle between axes 4 and 6; 0 is the wrist singularity
    sigma_min: float  # smallest singular value of the scaled Jacobian; 0 at any singularity
    extension_m: float | None  # how far the wrist centre lies inside the arm's reach (rigid OPW geometry), or None

    def breaks_coupled(self, chain: ElasticChain) -> bool:
        """True where only the controller's coupled axis 3 is out of its limits."""
        return chain.axes.coupled and self.limit_margin_rad < -opw.LIMIT_SLACK_RAD


@dataclass(frozen=True)
class PathSolution:
    """Joint angles along a path of n poses on one branch."""

    q: Float  # (n, 6) rad, continuous
    branch: str  # of the first point
    limit_margin_rad: Float  # (n,) distance of the axis nearest to its limit
    limit_axis: Int  # (n,) that axis, 0..5
    wrist: Float  # (n,) `|sin|` of the angle between axes 4 and 6
    sigma_min: Float  # (n,) smallest value of the scaled Jacobian at the point and on the way to it
    extension_m: Float | None  # (n,) reserve of reach (rigid OPW geometry), or None without such geometry

    def passing(self) -> PathSolution:
        """The same as rows on which no linear motion passes."""
        n = len(self.q)
        return replace(self, wrist=np.ones(n), sigma_min=np.full(n, np.inf))


def inverse_all(
    chain: ElasticChain,
    T_base_tcp: Float,
    *,
    w_tcp_base: Float | None = None,
    gravity: bool = False,
    within_limits: bool = True,
) -> list[Solution]:
    """All solutions of a pose: every branch, and every full turn of the axes within limits.

    Args:
        T_base_tcp: (4, 4) m, pose of the loaded TCP.
        w_tcp_base: (6,) N, N m, about the TCP in base axes; None is no load.
        gravity: Own weight and payload act.
        within_limits: Leave out solutions outside the joint limits; False gives one solution per branch, each axis
            turned as near to its range as it goes.

    Returns:
        Solutions by falling limit margin. Singular ones are in the list and say so; there only some of the
        infinitely many angles are returned.

    Raises:
        InputError: The pose is no rigid motion.
        ReachError: There is none; the message says by how much the pose is out of reach or which axis fails.
    """
    return _all(_Problem(chain, w_tcp_base, gravity), _pose(T_base_tcp), within_limits)


def _all(problem: _Problem, target: Float, within_limits: bool, near: Float | None = None) -> list[Solution]:
    """See :func:`inverse_all`; ``near`` is one start more, which decides where a singular pose leaves angles free."""
    # With `near` and without limits every solution is turned as near to it as full turns go.
    chain = problem.chain
    results: list[Solution] = []
    outside: list[Solution] = []
    for q, sigma, wrist in _distinct(problem, target, [*seeds(chain, target), *([] if near is None else [near])]):
        if near is not None and not within_limits:
            row = q + opw.TURN * np.round((near - q) / opw.TURN)
            results += _solutions(chain, target, row[None], sigma, wrist)
            continue
        q = _wrapped(q)
        choices = opw.turns(q, chain.joint_limits_rad)
        for one in _solutions(chain, target, choices, sigma, wrist):
            (outside if one.breaks_coupled(chain) else results).append(one)
        # No turn is within limits: the one nearest to the middle of the range breaks them least, and the error says by
        # how much.
        if len(choices) == 0:
            middle = chain.joint_limits_rad.mean(axis=1)
            row = opw.nearest_turn(q, middle, chain.joint_limits_rad)
            outside += _solutions(chain, target, row[None], sigma, wrist)
    if not within_limits and near is None:
        per_branch: dict[str, Solution] = {}
        for s in sorted(results + outside, key=lambda s: -s.limit_margin_rad):
            per_branch.setdefault(s.branch, s)
        results = list(per_branch.values())
    if not results:
        best = max(outside, key=lambda s: s.limit_margin_rad, default=None)
        worst = None if best is None else (best.branch, best.limit_axis, best.q)
        raise reach_errors.unreached(chain, target, worst)
    return sorted(results, key=lambda s: -s.limit_margin_rad)


def inverse(
    chain: ElasticChain,
    T_base_tcp: Float,
    near: Float | str,
    *,
    w_tcp_base: Float | None = None,
    gravity: bool = False,
    sigma_floor: float = SIGMA_FLOOR,
) -> Solution:
    """The solution of a pose nearest to given angles, or of a named branch.

    Args:
        T_base_tcp: (4, 4) m, pose of the loaded TCP.
        near: (6,) rad, the solution with the smallest largest joint move from there is taken; or a branch name, of
            which the turn with the largest limit margin is taken.
        w_tcp_base: (6,) N, N m, about the TCP in base axes; None is no load.
        gravity: Own weight and payload act.
        sigma_floor: Smallest scaled sigma_min accepted.

    Raises:
        InputError: The pose is no rigid motion, the branch name is unknown.
        ReachError: No solution, none in that branch, or it is too close to a singularity.
    """
    if isinstance(near, str):
        _check_branch(near)
    else:
        near = as_float("near", near, (6,))
    start = None if isinstance(near, str) else near
    solutions = _all(_Problem(chain, w_tcp_base, gravity), _pose(T_base_tcp), True, start)
    if isinstance(near, str):
        matching = [s for s in solutions if s.branch == near]
        if not matching:
            raise ReachError(
                f"the pose is not reached in branch {near!r}",
                limit="one of " + ", ".join(sorted({s.branch for s in solutions})),
                hint="Choose another branch",
            )
        best = matching[0]
    else:
        best = min(solutions, key=lambda s: float(np.max(np.abs(s.q - near))))
    if best.sigma_min < sigma_floor:
        raise reach_errors.near_singularity(best.wrist, best.sigma_min, sigma_floor)
    return best


def _starts(problem: _Problem, T_base_tcp: Float, start: Float | str | None, enforce_limits: bool) -> list[Solution]:
    """Solutions of the first point of a path from which it may be followed, in the order in which to try."""
    if isinstance(start, str):
        _check_branch(start)
    near = None if start is None or isinstance(start, str) else as_float("start", start, (6,))
    try:
        starts = _all(problem, T_base_tcp, enforce_limits, near)
    except ReachError as fault:
        raise reach_errors.at_point(fault, 0) from fault
    if near is not None:
        return [min(starts, key=lambda s: float(np.max(np.abs(s.q - near))))]
    if start is None:
        return starts
    named = [s for s in starts if s.branch == start]
    if not named:
        raise ReachError(
            f"the first point is not reached in branch {start!r}",
            where="path point 0",
            limit="one of " + ", ".join(sorted({s.branch for s in starts})),
            hint="Choose another branch",
            point=0,
        )
    return named


def inverse_path(
    chain: ElasticChain,
    Ts_base_tcp: Float,
    start: Float | str | None = None,
    *,
    w_tcp_base: Float | None = None,
    gravity: bool = False,
    enforce_limits: bool = True,
    sigma_floor: float = SIGMA_FLOOR,
) -> PathSolution:
    """Follow a path on one branch, every point seeded by the one before.

    Points farther apart than 50 mm or 0.15 rad are joined along the straight line and the shortest turn, so the
    angles run as they would in a linear move.

    Args:
        Ts_base_tcp: (n, 4, 4) m, n >= 1.
        start: (6,) rad to start near; a branch name; or None: the branches and turns of the first point are tried by
            falling limit margin until one carries through the whole path.
        w_tcp_base: (6,) or (n, 6) N, N m, about the TCP in base axes; None is no load.
        gravity: Own weight and payload act.
        enforce_limits: A point outside the joint limits is an error; otherwise its margin is negative.
        sigma_floor: Smallest scaled sigma_min accepted at and between the points.

    Raises:
        InputError: Wrong shapes, not finite, no rigid motions, unknown branch.
        ReachError: Names the first path point that fails, the axis, its value and limit.
    """
    Ts = np.array(as_float("Ts_base_tcp", Ts_base_tcp, (None, 4, 4)))
    if len(Ts) == 0:
        raise InputError("the path has no points")
    _check_rotations(Ts)
    loads = None if w_tcp_base is None else np.atleast_2d(as_float("w_tcp_base", w_tcp_base))
    if loads is not None and loads.shape not in ((1, 6), (len(Ts), 6)):
        raise InputError("w_tcp_base has the wrong shape", value=loads.shape, limit=f"(6,) or ({len(Ts)}, 6)")
    problem = _Problem(chain, None if loads is None else loads[0], gravity)
    starts = _starts(problem, Ts[0], start, enforce_limits)
    furthest: ReachError | None = None
    for first in starts:
        try:
            return _follow(problem, Ts, loads, first, enforce_limits, sigma_floor)
        # Of the starts that fail the one that came farthest says most about the program.
        except ReachError as fault:
            if furthest is None or fault.data["point"] > furthest.data["point"]:
                furthest = fault
    raise furthest or ReachError("the path has no start", where="path point 0", point=0)


class _Problem:
    """A loaded chain in the arrays of the kernels."""

    def __init__(self, chain: ElasticChain, w: Float | None, gravity: bool) -> None:
        self.chain = chain
        self.length = arm_length(chain) / 2.0
        self.w = np.zeros(6) if w is None else np.array(as_float("w_tcp_base", w, (6,)))
        self.gravity = int(gravity)
        self.loaded = int(gravity or w is not None)

    def polish(self, target: Float, seed: Float) -> tuple[Float, float, float] | None:
        q, measures = np.array(seed, dtype=np.float64), np.empty(3)
        done = inverse_kernel.newton(
            self.chain.compact, np.array(target), self.w, self.gravity, self.loaded, self.length, q,
            measures,
        )  # fmt: skip
        return (q, float(measures[0]), float(measures[1])) if done else None


def _follow(
    problem: _Problem, Ts: Float, loads: Float | None, first: Solution, enforce: bool, sigma_floor: float
) -> PathSolution:
    chain, n = problem.chain, len(Ts)
    q, out, axes, fault = np.empty((n, 6)), np.empty((n, 3)), np.empty(n, dtype=np.int64), np.zeros(2)
    ws = np.zeros((1, 6)) if loads is None else np.array(loads)
    done, code, axis = inverse_kernel.follow(
        chain.compact, Ts, ws, problem.gravity, problem.loaded, problem.length,
        np.array(first.q), inverse_kernel.Bounds(np.array(chain.joint_limits_rad), int(enforce), float(sigma_floor)),
        inverse_kernel.Followed(q, out, axes, fault),
    )  # fmt: skip
    if chain.axes.coupled:
        # The kernel knows a box of limits. A coupled axis 3 cuts across that box, so it is held against its limits
        # here.
        rooms = room(chain.axes, chain.joint_limits_rad, q[:done])
        out[:done, 0], axes[:done] = rooms.min(axis=1), rooms.argmin(axis=1)
        beyond = np.flatnonzero(out[:done, 0] < -opw.LIMIT_SLACK_RAD)
        if enforce and len(beyond):
            point = int(beyond[0])
            raise reach_errors.outside(chain, q[point], int(axes[point]), point)
    if code == inverse_kernel.OUTSIDE:
        raise reach_errors.outside(chain, q[done], axis, done)
    if code != inverse_kernel.OK:
        raise reach_errors.path_fault(chain, Ts[done], done, code, fault, sigma_floor)
    return PathSolution(
        q=q,
        branch=first.branch,
        limit_margin_rad=out[:, 0].copy(),
        limit_axis=axes,
        wrist=out[:, 2].copy(),
        sigma_min=out[:, 1].copy(),
        extension_m=extension(chain, Ts, first.branch),
    )


def _solutions(chain: ElasticChain, target: Float, rows: Float, sigma: float, wrist: float) -> list[Solution]:
    """One solution in several turns of its axes, (n, 6): there may be hundreds."""
    branches = branches_of(chain, rows)
    reserves = {branch: extension(chain, target, branch) for branch in set(branches)}
    rooms = room(chain.axes, chain.joint_limits_rad, rows)
    results = []
    for q, branch, margin, axis in zip(rows, branches, rooms.min(axis=1), rooms.argmin(axis=1), strict=True):
        reserve = reserves[branch]
        inside = None if reserve is None else float(reserve)
        results.append(Solution(q, branch, float(margin), int(axis), wrist, sigma, inside))
    return results


def _distinct(problem: _Problem, target: Float, starts: Sequence[Float]) -> list[tuple[Float, float, float]]:
    """Angles, scaled sigma_min and wrist angle of every solution; those that are full turns apart count as one."""
    results: list[tuple[Float, float, float]] = []
    known = np.empty((0, 6))
    for start in starts:
        solved = problem.polish(target, start)
        if solved is None or np.any(np.max(np.abs(_wrapped(known - solved[0])), axis=1) <= _SAME_RAD):
            continue
        results.append(solved)
        known = np.vstack([known, solved[0]])
    return results


def _wrapped(q: Float) -> Float:
    out: Float = q - opw.TURN * np.round(q / opw.TURN)
    return out


def _check_branch(name: str) -> None:
    if name not in opw.BRANCHES:
        raise InputError("unknown branch", value=name, limit="one of " + ", ".join(opw.BRANCHES))


def _pose(T_base_tcp: Float) -> Float:
    T = as_float("T_base_tcp", T_base_tcp, (4, 4))
    _check_rotations(T[None])
    return T


def _check_rotations(Ts: Float) -> None:
    R = Ts[:, :3, :3]
    off = np.max(np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)), axis=(1, 2))
    off = np.maximum(off, np.where(np.linalg.det(R) > 0.0, 0.0, 1.0))
    worst = int(np.argmax(off))
    if off[worst] > 1e-6:
        raise InputError("a pose does not hold a proper rotation", where=f"pose {worst}", value=f"{off[worst]:.2g} off")
