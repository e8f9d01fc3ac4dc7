"""Postures in which coarse bodies of robot, spindle, part and table come too close to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.geometry import pose
from counterflex.plan.posture.survey import RobotHere
from counterflex.plan.preflight.bodies import CollisionBody, holds_stock, pairs, tool_of
from counterflex.plan.preflight.collision import Closest, PartAlongPath, Scene, at_least, closest, poses

PLACES: Final = 12
"""Stations at which every posture is looked at, evenly along the path; the chosen posture is looked at everywhere."""
_NEAR_M: Final = 1e-3
"""Distances that are told apart beyond the least one."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Bodies that must not touch."""

    bodies: Sequence[CollisionBody]  # coarse bodies, see counterflex.plan.preflight.bodies
    tool: Int  # (n,) number of the tool in the spindle at each point of the path
    clearance_m: float  # least distance; tools need none

    def seen_from(self, T_base_before: Float) -> Surroundings:
        """The same from a robot that was carried away: what stands on the floor is elsewhere in its base.

        Args:
            T_base_before: (4, 4) the robot base as it was, in the robot base as it is.
        """
        bodies = [_carried_away(body, T_base_before) for body in self.bodies]
        return replace(self, bodies=bodies)

    def facing(self, before: RobotHere, after: RobotHere, T_base_before: Float | None) -> Surroundings:
        """The same where part or spindle stand elsewhere; bodies that belong to the spindle go with it.

        Args:
            before: The robot as these bodies are given.
            after: The same with part or spindle elsewhere.
            T_base_before: (4, 4) the base of the first in that of the second, where the robot was carried away.
        """
        around = self if T_base_before is None else self.seen_from(T_base_before)
        if before.T_base_tcp is None or after.T_base_tcp is None:
            return around
        motion = after.T_base_tcp @ pose.inverse(before.T_base_tcp)
        bodies = [
            replace(now, T_frame_body=motion @ then.T_frame_body) if then.of_spindle else now
            for then, now in zip(self.bodies, around.bodies, strict=True)
        ]
        return replace(around, bodies=bodies)

    def compared(self) -> list[tuple[int, int, float]]:
        """Pairs of bodies, and the distance that each must keep."""
        outer, inner = pairs(self.bodies)
        return [
            (a, b, self.clearance_m if tool_of(self.bodies[a], self.bodies[b]) is None else 0.0)
            for a, b in (*inner, *outer)
            if not holds_stock(self.bodies[a], self.bodies[b])
        ]


def _carried_away(body: CollisionBody, T_base_before: Float) -> CollisionBody:
    if body.frame != "base" or not body.surrounds:
        return body
    T_before_body = body.T_frame_body
    return replace(body, T_frame_body=T_base_before @ T_before_body)


def too_close(q: Float, rows: Int, robot: RobotHere, around: Surroundings) -> Bool:
    """Postures that come too close.

    ``q``: (m, r, 8, 6) rad at stations; NaN where a posture is not possible. ``rows``: (m,) rows of the path that the
    stations are.

    Returns:
        (r, 8) too close at one of :data:`PLACES` stations; False where no posture is possible.
    """
    places = np.unique(np.linspace(0, len(rows) - 1, min(PLACES, len(rows))).astype(np.int64))
    out = np.zeros(q.shape[1:3], dtype=np.bool_)
    compared = around.compared()
    if not compared:
        return out
    scene, pairs = Scene(around.bodies), [(a, b) for a, b, _ in compared]
    least = np.array([keep for _, _, keep in compared])
    tools = [tool_of(around.bodies[a], around.bodies[b]) for a, b in pairs]
    mounted = {
        number: np.array([of in (None, number) for of in tools])
        for number in np.unique(around.tool[rows[places]]).tolist()
    }
    for slot in np.flatnonzero(~np.isnan(q[:, :, :, 0]).all(axis=(0, 1))):
        place, turn = np.nonzero(~np.isnan(q[places][:, :, slot, 0]))
        placed = poses(
            robot.controller_chain, around.bodies, q[places[place], turn, slot], PartAlongPath(robot.T_base_part)
        )
        # A bound first: MuJoCo is asked for pairs that may be too close, a small share of all.
        near = at_least(around.bodies, pairs, placed) < least + _NEAR_M
        near &= np.array([mounted[int(around.tool[rows[k]])] for k in places])[place]
        for row in np.flatnonzero(near.any(axis=1)):
            if out[turn[row], slot]:
                continue
            scene.place(placed[row])
            some = (compared[pair] for pair in np.flatnonzero(near[row]))
            out[turn[row], slot] = any(scene.distance(a, b, keep + _NEAR_M) < keep for a, b, keep in some)
    return out


def worst(q: Float, robot: RobotHere, around: Surroundings) -> Closest | None:
    """The pair that comes closest on a path, less the distance that it must keep; None where none is too close.

    Args:
        q: (n, 6) rad at every point.
        robot: Robot, tool and place of the part.
        around: What must not touch.
    """
    return kept(q, robot, around)[0]


def kept(
    q: Float, robot: RobotHere, around: Surroundings, standing: PartAlongPath | None = None
) -> tuple[Closest | None, float]:
    """The pair that is too close as :func:`worst` has it, and the clearance of the path.

    ``q``: (n, 6) rad at every point. ``standing``: part and floor where external axes move them; None: they stand.

    Returns:
        The pair, None where none is too close; the smallest distance of bodies that must keep one (all but tools), m,
        infinite where none are compared.
    """
    compared = [(a, b, tool_of(around.bodies[a], around.bodies[b])) for a, b, _ in around.compared()]
    blunt = [(a, b) for a, b, tool in compared if tool is None]
    sharp = [(a, b) for a, b, tool in compared if tool is not None]
    problems, clearance = [], np.inf
    standing = PartAlongPath(robot.T_base_part) if standing is None else standing
    for some, least in ((blunt, around.clearance_m), (sharp, 0.0)):
        result = closest(robot.controller_chain, around.bodies, some, q, around.tool, standing)
        if result is not None and some is blunt:
            clearance = result.distance_m
        if result is not None and result.distance_m < least:
            problems.append((result.distance_m - least, result))
    return min(problems, key=lambda pair: pair[0])[1] if problems else None, float(clearance)
