"""Joint angles of a program that goes along lines and, between them, by axes.

A linear motion keeps the branch and the turns of its start. A motion by axes (PTP, MoveJ, J, movej) starts and ends all
axes at the same time: in joint space it is a straight line, whatever the tool does meanwhile. So the path falls into
linear pieces; each begins where a motion by axes ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ReachError
from counterflex.core.units import DEG
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.kinematics.inverse import SIGMA_FLOOR, PathSolution, inverse_all, inverse_path
from counterflex.robot.model.controller_axes import ControllerAxes, room

_SAME_RAD: Final = 1.0 * DEG  # A target at the end of a range of turns may be rounded to its other side


@dataclass(frozen=True, eq=False)
class Turns:
    """Ranges in which a program asks for axes of the controller, so that full turns are told apart."""

    axes: ControllerAxes  # as the controller of the program shows them
    numbers: tuple[int, ...]  # indices of the axes
    low_rad: Float  # lower ends
    high_rad: Float  # upper ends
    words: str  # of the program

    def agree(self, q: Float) -> bool:
        """Return whether angles (6,) of the model lie in the ranges."""
        shown = self.axes.shown(q)[list(self.numbers)]
        return bool(np.all((shown >= self.low_rad - _SAME_RAD) & (shown <= self.high_rad + _SAME_RAD)))


@dataclass(frozen=True, eq=False)
class ByAxes:
    """Motions of a program that its controller makes by axes."""

    motions: frozenset[int] = frozenset()  # their indices
    # by motion, (6,) angles of the model at its end, where the program states them
    stated_rad: Mapping[int, Float] = field(default_factory=dict)
    # by motion, the turns of the axes at its end, where the program states them beside a pose
    turns: Mapping[int, Turns] = field(default_factory=dict)

    def rows(self, motion: Int) -> tuple[Bool, Bool]:
        """Rows at which a motion by axes ends, and rows between its ends.

        Args:
            motion: (n,) motion of each row.
        """
        made = np.isin(motion, np.fromiter(self.motions, dtype=np.int64, count=len(self.motions)))
        made[:1] = False
        last = np.append(motion[1:] != motion[:-1], True)[: len(motion)]
        return made & last, made & ~last


@dataclass(frozen=True, eq=False)
class JointPieces:
    """Linear pieces of a path of n rows."""

    begins: Bool  # (n,) rows at which a motion by axes ends and a piece begins; row 0 begins one in any case
    stated_rad: Mapping[int, Float]  # by such a row, (6,) angles that the program states there
    turns: Mapping[int, Turns] = field(default_factory=dict)  # by such a row, the turns that it states there


def solve_pieces(
    chain: ElasticChain,
    Ts_base_tcp: Float,
    branch: str,
    pieces: JointPieces,
    *,
    enforce_limits: bool = True,
    sigma_floor: float = SIGMA_FLOOR,
) -> PathSolution:
    """Solve a path piece by piece.

    Where the program states the axes at the begin of a piece, the piece starts from them. Elsewhere it starts in the
    branch, with the turns that the program states, else with those that are nearest to the end of the piece before. A
    piece of one row is no linear motion: it passes no singularity.

    ``Ts_base_tcp``: (n, 4, 4) m; ``pieces``: where they begin; ``enforce_limits``: as
    :func:`~counterflex.robot.kinematics.inverse.inverse_path`.

    Raises:
        ReachError: Names the first row that fails.
    """
    starts = np.union1d([0], np.flatnonzero(pieces.begins)).astype(int).tolist()
    solved: list[PathSolution] = []
    for first, end in zip(starts, [*starts[1:], len(Ts_base_tcp)], strict=True):
        before = solved[-1].q[-1] if solved else None
        stated = pieces.stated_rad.get(first)
        Ts = Ts_base_tcp[first:end]
        try:
            if stated is not None and end - first == 1:
                solved.append(_stated(chain, stated, branch))
                continue
            start = (
                stated
                if stated is not None
                else _start(chain, Ts[0], branch, before, enforce_limits, pieces.turns.get(first))
            )
            alone = end - first == 1 and first > 0
            one = inverse_path(
                chain, Ts, start, enforce_limits=enforce_limits, sigma_floor=0.0 if alone else sigma_floor
            )
        except ReachError as fault:
            point = first + int(fault.data.get("point", 0))
            raise ReachError(
                fault.what, where=f"path point {point}", value=fault.value, limit=fault.limit, hint=fault.hint,
                **(fault.data | {"point": point}),
            ) from fault  # fmt: skip
        solved.append(one.passing() if alone else one)
    return _joined(solved)


def _start(
    chain: ElasticChain,
    T_base_tcp: Float,
    branch: str,
    before: Float | None,
    enforce_limits: bool,
    turns: Turns | None,
) -> Float | str:
    """Angles in a branch, with the turns that are stated, that are nearest to those before, at the start to zero.

    The branch itself where there are none.
    """
    if before is None and turns is None:
        return branch
    try:
        near = [one.q for one in inverse_all(chain, T_base_tcp, within_limits=enforce_limits) if one.branch == branch]
    except ReachError:
        return branch
    if turns is not None:
        # Where none has the stated turns the nearest is taken; preflight names these targets (swung_arcs.axes_row).
        near = [q for q in near if turns.agree(q)] or ([] if before is None else near)
    origin = 0.0 if before is None else before
    return near[int(np.argmin(np.abs(np.array(near) - origin).max(axis=1)))] if near else branch


def _stated(chain: ElasticChain, q: Float, branch: str) -> PathSolution:
    """A row whose angles are stated."""
    margin = room(chain.axes, chain.joint_limits_rad, q[None])
    axis = margin.argmin(axis=1)
    one, big = np.ones(1), np.full(1, np.inf)
    return PathSolution(q[None].copy(), branch, margin.min(axis=1), axis, one, big, None)


def _joined(solved: list[PathSolution]) -> PathSolution:
    """All pieces as one; the reserve of reach is that of the path where every piece has one."""
    extension = None
    if all(one.extension_m is not None for one in solved):
        extension = np.concatenate([one.extension_m for one in solved if one.extension_m is not None])
    return PathSolution(
        np.concatenate([one.q for one in solved]),
        solved[0].branch,
        np.concatenate([one.limit_margin_rad for one in solved]),
        np.concatenate([one.limit_axis for one in solved]),
        np.concatenate([one.wrist for one in solved]),
        np.concatenate([one.sigma_min for one in solved]),
        extension,
    )
