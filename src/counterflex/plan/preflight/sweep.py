"""Rows of a path at which bodies must be asked for their distance: the others are bounded by how far bodies can move.

A distance that was found at one row is, less the motion between the rows, a bound of the distance at any later row: the
surroundings stand still and the stock only shrinks. Rows are bounded by the row before them that was looked at, and by
rows near the same place, which a path of parallel passes visits many times: places are kept in cells of several sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.plan.preflight.bodies import CollisionBody, joint_offsets
from counterflex.robot.elasticity.chain import ElasticChain, frames

CELLS_M: Final = (8.0 * MM, 2.0 * MM, 0.5 * MM)
"""Sides of the cells: large ones leave out rows far from the closest place, the smallest is as fine as the result."""
_CHUNK: Final = 2000
_FACTORS: Final = np.array([1, 73856093, 19349663, 83492791, 49979687, 15485863, 67867967], dtype=np.int64)
"""Factors that number the cells (the first primes of Teschner et al. 2003, Optimized spatial hashing)."""


class JointSweep:
    """Rows of a path that need no distance computation, for bodies that move alike.

    Args:
        place: (n, k) m, coordinates of the bodies.
        turn: (n, 3, 3) orientation of the bodies, None where ``place`` bounds their motion alone.
        reach_m: Farthest point of a body from ``place``, by which its turning counts.
        tool: (n,) number of the tool in the spindle; what was found with another one bounds nothing.
    """

    def __init__(self, place: Float, turn: Float | None, reach_m: float, tool: Int) -> None:
        self._place, self._turn, self._reach, self._tool = place, turn, reach_m, tool
        self.moved: Float = np.concatenate([[0.0], np.cumsum(self._steps())]) if len(place) else np.zeros(0)
        self._keys: list[Int] = [_cell_numbers(place, side) for side in CELLS_M]
        self._bounds: list[dict[int, tuple[int, float]]] = [{} for _ in CELLS_M]
        self._changes = np.append(np.flatnonzero(np.diff(tool)) + 1, len(tool))
        self._until = 0

    def _steps(self) -> Float:
        """(n - 1,) m, bound of the motion from row to row."""
        way = self._length(np.diff(self._place, axis=0))
        if self._turn is None:
            return way
        R = np.swapaxes(self._turn[:-1], 1, 2) @ self._turn[1:]
        out: Float = way + self._reach * _chord(np.trace(R, axis1=1, axis2=2))
        return out

    def _length(self, step: Float) -> Float:
        """Motion by a change of place: joint angles times levers add up, coordinates are those of one point."""
        out: Float = np.abs(step).sum(axis=-1) if self._turn is None else np.sqrt((step * step).sum(axis=-1))
        return out

    def motion(self, first: int, second: int) -> float:
        """Return a bound of the motion of any point between two rows, m."""
        way = float(self._length(self._place[second] - self._place[first]))
        if self._turn is None:
            return way
        return way + self._reach * float(_chord(np.sum(self._turn[first] * self._turn[second])))

    def skips(self, row: int, least_m: float) -> bool:
        """Return whether nothing from a row up to :meth:`next_row` is closer than a distance.

        Args:
            row: Rising from call to call.
            least_m: The distance.
        """
        if row < self._until:
            return True
        for keys, bounds in zip(self._keys, self._bounds, strict=True):
            before = bounds.get(int(keys[row]))
            if before is not None and self._tool[before[0]] == self._tool[row]:
                free = before[1] - self.motion(before[0], row) - least_m
                if free > 0.0:
                    self._until = self._behind(row, free)
                    return True
        return False

    def take(self, row: int, distance_m: float, least_m: float) -> None:
        """Take what was found at a row.

        ``distance_m``: distance found there, or less; ``least_m``: closer ones count.
        """
        for keys, bounds in zip(self._keys, self._bounds, strict=True):
            bounds[int(keys[row])] = (row, distance_m)
        self._until = self._behind(row, distance_m - least_m)

    def next_row(self, row: int) -> int:
        """Return the first row behind a row that is not left out for what was found before it."""
        return max(row + 1, self._until)

    def _behind(self, row: int, free_m: float) -> int:
        """First row behind this one at which a body can have moved by ``free_m``, or the tool is another."""
        following = int(np.searchsorted(self.moved, self.moved[row] + free_m))
        change = int(self._changes[np.searchsorted(self._changes, row, side="right")])
        return min(max(following, row + 1), change)


def sweep_between(
    chain: ElasticChain, bodies: Sequence[CollisionBody], q: Float, tool: Int, low: int = 0, high: int = 6,
    moved_m: Float | None = None,
) -> JointSweep:  # fmt: skip
    """Return the sweep of bodies that ``high`` axes move, against those that ``low`` axes move.

    The axes between move the one against the other. What the flange carries has its own bound against what stands.

    Args:
        q: (n, 6) rad.
        tool: (n,).
        low: Axes that move the one body.
        high: Axes that move the other.
        moved_m: (n,) bound of the way that surroundings have gone from row 0 on; None: they stand.
    """
    if (low, high) == (0, 6) and moved_m is None:
        return sweep_of_flange(chain, bodies, q, tool)
    return sweep_of_joints(chain, bodies, q, tool, low, high, moved_m)


def sweep_of_joints(
    chain: ElasticChain, bodies: Sequence[CollisionBody], q: Float, tool: Int, low: int = 0, high: int = 6,
    moved_m: Float | None = None,
) -> JointSweep:  # fmt: skip
    """Return the sweep of any bodies of a robot: ``sum |dq_j| R_j`` bounds the motion of every one of their points.

    ``R_j`` is the longest way from axis j outward along the chain, with the farthest corner of what the flange carries.

    Args:
        q: (n, 6) rad.
        tool: (n,).
        low: Axes that move the one body of a pair.
        high: Axes that move the other.
        moved_m: See :func:`sweep_between`.
    """
    steps = np.array([np.linalg.norm(offset) for offset in joint_offsets(chain)])
    way = np.cumsum(steps[::-1])[::-1][1:]  # from axis j to the flange
    beyond = float(np.linalg.norm(chain.T_flange_tcp[:3, 3])) if chain.flange_segment < chain.n else 0.0
    size = max((_reach(b, np.eye(4)) for b in bodies if b.link), default=0.0)
    place = (q * (way + beyond + size))[:, low:high]
    return JointSweep(place if moved_m is None else np.column_stack([place, moved_m]), None, 0.0, tool)


def sweep_of_flange(chain: ElasticChain, bodies: Sequence[CollisionBody], q: Float, tool: Int) -> JointSweep:
    """Return the sweep of bodies that the flange carries, by the motion of the tool centre point and its turning.

    ``q``: (n, 6) rad; ``tool``: (n,).
    """
    parts = [frames(chain, q[k : k + _CHUNK])[:, -1] @ chain.T_last_tcp for k in range(0, len(q), _CHUNK)]
    T = np.concatenate(parts) if parts else np.empty((0, 4, 4))
    reach = 0.0
    if len(T):
        ahead = {"flange": pose.inverse(chain.T_flange_tcp), "tcp": np.eye(4)}
        carried = [body for body in bodies if body.link == 6]
        reach = max((_reach(b, ahead.get(b.frame, ahead["flange"])) for b in carried), default=0.0)
        reach += float(np.linalg.norm(chain.T_segment_flange[:3, 3]))  # the frame of axis 6 lies behind the flange
    return JointSweep(np.ascontiguousarray(T[:, :3, 3]), np.ascontiguousarray(T[:, :3, :3]), reach, tool)


def _reach(body: CollisionBody, T_tcp_frame: Float) -> float:
    """Distance of the farthest corner of a body from the origin that its frame is given in, m."""
    centre = (T_tcp_frame @ body.T_frame_body)[:3, 3]
    return float(np.linalg.norm(centre) + np.linalg.norm(body.size_m) + body.size_m[0])


def _chord(trace: Float) -> Float:
    """``2 sin(angle / 2)`` of rotations, from their trace."""
    out: Float = np.sqrt(np.maximum(3.0 - trace, 0.0))
    return out


def _cell_numbers(place: Float, side_m: float) -> Int:
    """(n,) number of the cell of each row; cells that share one cost time, the motion is bounded in any case."""
    cells = np.floor(place / side_m).astype(np.int64)
    out: Int = (cells * _FACTORS[: cells.shape[1]]).sum(axis=1)
    return out
