"""Distances of coarse bodies along a program, by MuJoCo's ``mj_geomDistance``.

Bodies are placed by the kinematics of the chain; MuJoCo is asked for the distance of two convex bodies and nothing
else: no dynamics, no contact (docs/adr/0013). Its function for a capsule and a box is made for contacts that begin:
where the capsule's axis pierces the box it calls some pairs clear. So a capsule is compared with anything but another
capsule as its axis, a cylinder of 1 um radius, less the capsule's radius.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.progress import Progress, share_of, silent
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.plan.preflight.bodies import CollisionBody, pairs, tool_of
from counterflex.plan.preflight.machined_stock import LeftOver, MachinedStock
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row
from counterflex.plan.preflight.sweep import sweep_between
from counterflex.robot.elasticity.chain import ElasticChain, frames

FARTHEST_M: Final = 20.0
"""Distances beyond are not told apart."""
HOLDER_NEAR_M: Final = 5.0 * MM
"""Holders that come nearer to the blank's box are compared with what is left of it: farther away it does not matter."""
NEAR_M: Final = 0.5 * MM
"""Rows are left out only where nothing on them can be closer by that than what was found already."""
RAPID_CLEARANCE_M: Final = 1.0 * MM
"""Rapids keep a tool that far from given bodies: a robot is off by some tenths of a millimetre in motion."""
INTO_TABLE_M: Final = 1.0 * MM
"""A tool that cuts through its part goes a little into what supports it: up to that is a warning."""
ROBOT, TOOL = "robot and spindle to surroundings", "tool to surroundings"
HOLDER, ARM = "tool holder to stock and surroundings", "spindle to arm"
_CHUNK: Final = 500
_BOXES: Final = ("box", "mesh")
"""Shapes whose size is that of a box."""
_CORE_M: Final = 1e-6
"""Radius of the axis of a capsule."""
_TOUCH_M: Final = 2e-5
_EXACT_M: Final = 1e-9
_ROUNDING_M: Final = 1e-5
"""What MuJoCo's distances may be off."""
_NUDGE_M: Final = 1e-5 * np.array([0.8, 0.5, 0.3])
"""Two centres that coincide exactly are as good as touching to MuJoCo: they are asked again this far apart."""


class Scene:
    """Bodies that can be placed and asked for their distances."""

    def __init__(self, bodies: Sequence[CollisionBody]) -> None:
        """Build the bodies.

        Args:
            bodies: At least one.
        """
        import mujoco  # of whoever looks for collisions alone

        kinds = {
            "box": mujoco.mjtGeom.mjGEOM_BOX,
            "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
            "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
        }
        spec = mujoco.MjSpec()
        meshes: dict[int, str] = {}
        for k, body in enumerate(bodies):
            if body.vertices_m is not None:
                meshes[k] = f"mesh{k}"
                spec.add_mesh(name=meshes[k], uservert=np.ravel(body.vertices_m))
                spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=meshes[k])
            else:
                spec.worldbody.add_geom(type=kinds[body.shape], size=[*body.size_m, 0.0, 0.0][:3])
        self._core = [k for k, body in enumerate(bodies) if body.shape == "capsule"]
        for k in self._core:
            spec.worldbody.add_geom(type=kinds["cylinder"], size=[_CORE_M, bodies[k].size_m[1], 0.0])
        self._axis = {k: len(bodies) + n for n, k in enumerate(self._core)}
        self._radius = {k: bodies[k].size_m[0] - _CORE_M for k in self._core}
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._distance_of: Any = mujoco.mj_geomDistance
        self._turned: Any = mujoco.mju_quat2Mat
        self._T_body_geom = {k: self._shifted(name) for k, name in meshes.items()}

    def _shifted(self, mesh: str) -> Float:
        """(4, 4) where MuJoCo has put the axes of a mesh: along those of its inertia."""
        number = self._model.mesh(mesh).id
        R = np.zeros(9)
        self._turned(R, self._model.mesh_quat[number])
        return pose.make(R.reshape(3, 3), np.array(self._model.mesh_pos[number]))

    def place(self, Ts_base_body: Float) -> None:
        """Put all bodies where they are; (k, 4, 4) m."""
        both = np.concatenate([Ts_base_body, Ts_base_body[self._core]])
        for k, T_body_geom in self._T_body_geom.items():
            both[k] = Ts_base_body[k] @ T_body_geom
        self._data.geom_xpos[:] = both[:, :3, 3]
        self._data.geom_xmat[:] = both[:, :3, :3].reshape(-1, 9)

    def distance(self, first: int, second: int, most_m: float = FARTHEST_M) -> float:
        """Signed distance of two bodies, m.

        Args:
            most_m: Distances from here on need not be told apart.

        Returns:
            To 5 um where the bodies are apart; negative where they overlap: a depth, not always the least one.
        """
        a, b, radius = first, second, 0.0
        if (first in self._axis) != (second in self._axis):
            a, b = self._axis.get(first, first), self._axis.get(second, second)
            radius = self._radius.get(first, 0.0) + self._radius.get(second, 0.0)
        value = self._ask(a, b, most_m + radius)
        if abs(value) < _EXACT_M:
            self._data.geom_xpos[a] += _NUDGE_M
            value = self._ask(a, b, most_m + radius)
            self._data.geom_xpos[a] -= _NUDGE_M
        return value - radius

    def _ask(self, a: int, b: int, most_m: float) -> float:
        return float(self._distance_of(self._model, self._data, a, b, most_m, None))


@dataclass(frozen=True)
class Closest:
    """The smallest distance along a path."""

    distance_m: float  # signed, m
    point: int  # row of the path
    first: int  # index of the body that moves
    second: int  # index of the other


@dataclass(frozen=True, eq=False)
class PartAlongPath:
    """Part and floor in the robot base along a path of n rows, where external axes carry them or the robot."""

    Ts_base_part: Float  # (n, 4, 4), or (4, 4) where nothing moves
    # (n, 4, 4) the base that bodies on the floor are given in, in the base along the path; None where the robot stands
    Ts_base_before: Float | None = None
    # (n,) bound of the way that a point of these bodies has gone from row 0 on, rising; None: nothing moves
    moved_m: Float | None = None

    def rows(self, rows: Int | slice) -> PartAlongPath:
        """The same for some rows."""
        if self.Ts_base_part.ndim == 2:
            return self
        before, moved = self.Ts_base_before, self.moved_m
        return PartAlongPath(
            self.Ts_base_part[rows], None if before is None else before[rows], None if moved is None else moved[rows]
        )


def poses(chain: ElasticChain, bodies: Sequence[CollisionBody], q: Float, standing: PartAlongPath) -> Float:
    """Poses of bodies in the base.

    Args:
        chain: As the controller has it.
        bodies: k bodies.
        q: (n, 6) rad.
        standing: Part and floor.

    Returns:
        (n, k, 4, 4) m.
    """
    Ts = frames(chain, q)
    driven = np.flatnonzero(chain.joint >= 0)
    base = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    of = {"base": base, "part": np.broadcast_to(standing.Ts_base_part, (len(q), 4, 4))}
    floor = base if standing.Ts_base_before is None else standing.Ts_base_before
    of |= {f"joint{n + 1}": Ts[:, segment] for n, segment in enumerate(driven)}
    of["flange"] = Ts[:, chain.flange_segment] @ chain.T_segment_flange
    of["tcp"] = Ts[:, -1] @ chain.T_last_tcp
    on_floor = [body.frame == "base" and body.surrounds for body in bodies]
    placed = [(floor if on else of[body.frame]) @ body.T_frame_body for body, on in zip(bodies, on_floor, strict=True)]
    return np.stack(placed, axis=1)


def at_least(bodies: Sequence[CollisionBody], compared: Sequence[tuple[int, int]], Ts_base_body: Float) -> Float:
    """Lower bounds of distances of pairs of bodies: core of one (axis or box) against the sphere around the other.

    Args:
        bodies: k bodies.
        compared: p pairs of indices.
        Ts_base_body: (n, k, 4, 4) m, their poses.

    Returns:
        (n, p) m: no distance is below that; -inf where they may overlap.
    """
    half = np.array([b.size_m if b.shape in _BOXES else (0.0, 0.0, b.size_m[1]) for b in bodies])
    thick = np.array([0.0 if b.shape in _BOXES else b.size_m[0] for b in bodies])
    sphere = np.linalg.norm(half, axis=1) + thick
    pairs_of = np.array(compared, dtype=np.int64).reshape(-1, 2)
    out = np.full((len(Ts_base_body), len(pairs_of)), -np.inf)
    for a, b in (pairs_of.T, pairs_of[:, ::-1].T):
        T = Ts_base_body[:, a]
        way = Ts_base_body[:, b][..., :3, 3] - T[..., :3, 3]
        local = np.einsum("npij,npi->npj", T[..., :3, :3], way)
        beyond = np.maximum(np.abs(local) - half[a], 0.0)
        np.maximum(out, np.sqrt(np.sum(beyond * beyond, axis=-1)) - thick[a] - sphere[b], out=out)
    return np.where(out > 0.0, out, -np.inf)


def closest(
    chain: ElasticChain,
    bodies: Sequence[CollisionBody],
    compared: Sequence[tuple[int, int]],
    q: Float,
    tool: Int,
    standing: PartAlongPath,
    progress: Progress = silent,
    left_over: LeftOver | None = None,
) -> Closest | None:
    """The smallest distance of some pairs of bodies along a path, to :data:`NEAR_M`.

    A row is left out where the bodies cannot be closer than what was found (:mod:`~counterflex.plan.preflight.sweep`);
    so the result is that of all rows, not of a sample.

    Args:
        chain: As the controller has it.
        compared: Pairs of indices.
        q: (n, 6) rad.
        tool: (n,) number of the tool in the spindle.
        standing: Part and floor.
        progress: Progress callback, fraction 0 to 1.
        left_over: What is left of the blank, for pairs with its box that come nearer than a distance.

    Returns:
        The closest pair; None where nothing is compared.
    """
    if not compared or len(q) == 0:
        return None
    by_links: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for first, second in compared:
        low, high = sorted((bodies[first].link, bodies[second].link))
        by_links.setdefault((low, high), []).append((first, second))
    watched = [(of, sweep_between(chain, bodies, q, tool, *links, standing.moved_m)) for links, of in by_links.items()]
    placed = PlacedBody(chain, bodies, q, standing, left_over)
    best: Closest | None = None
    row = reported = 0
    while row < len(q):
        for of, sweep in watched:
            least = FARTHEST_M if best is None else best.distance_m
            if sweep.skips(row, least - NEAR_M):
                continue
            first, second, here = placed.closest(of, row, int(tool[row]), least)
            if here < least:
                best = Closest(here, row, first, second)
            sweep.take(row, here, min(here, least) - NEAR_M)
        row = min(sweep.next_row(row) for _, sweep in watched)
        if row >= reported + _CHUNK:
            reported = row
            progress(row / len(q))
    progress(1.0)
    return best


class PlacedBody:
    """Bodies at the rows of a path.

    Args:
        chain: As the controller has it.
        q: (n, 6) rad.
        standing: Part and floor.
        left_over: What is left of the blank.
    """

    def __init__(
        self,
        chain: ElasticChain,
        bodies: Sequence[CollisionBody],
        q: Float,
        standing: PartAlongPath,
        left_over: LeftOver | None,
    ) -> None:
        self._chain, self._bodies, self._q, self._standing = chain, bodies, q, standing
        self._left_over, self._scene, self._row = left_over, Scene(bodies), -1
        self._Ts: Float = np.empty(0)

    def closest(
        self, compared: Sequence[tuple[int, int]], row: int, tool: int, least_m: float
    ) -> tuple[int, int, float]:
        """Return the closest pair of some at a row, and its distance, m.

        Args:
            compared: Pairs of indices.
            tool: Number of the tool in the spindle.
            least_m: Least distance of the rows before: of what is farther away, a bound will do.
        """
        if row != self._row:
            only = slice(row, row + 1)
            self._Ts = poses(self._chain, self._bodies, self._q[only], self._standing.rows(only))
            self._scene.place(self._Ts[0])
            self._row = row
        bound_m = at_least(self._bodies, compared, self._Ts)[0]
        here, closest_pair = FARTHEST_M, compared[0]
        for k in np.argsort(bound_m, kind="stable").tolist():
            first, second = compared[k]
            if bound_m[k] > here + _ROUNDING_M:
                break
            if tool_of(self._bodies[first], self._bodies[second]) not in (None, tool):
                continue
            distance = self._scene.distance(first, second, here)
            if self._left_over is not None and distance < min(here, self._left_over.near_m):
                left = self._left_over.distance((first, second), row, self._Ts[0], here, least_m)
                distance = max(distance, left)
            if distance < here:
                here, closest_pair = distance, (first, second)
        return *closest_pair, here


def collision_rows(
    chain: ElasticChain,
    bodies: Sequence[CollisionBody],
    q: Float,
    tool: Int,
    standing: PartAlongPath,
    clearance_m: float,
    progress: Progress = silent,
    machined: Callable[[], MachinedStock] | None = None,
    rapid: Bool | None = None,
) -> list[Row]:
    """Robot, spindle, tool and its holder against the surroundings, and what the flange carries against the own arm.

    Args:
        chain: As the controller has it.
        q: (n, 6) rad.
        tool: (n,).
        standing: Part and floor.
        clearance_m: Least distance; tools and holders need none, they are as large as they are.
        progress: Progress callback, fraction 0 to 1.
        machined: Begins to cut the stock anew; None compares with the blank as it is.
        rapid: (n,) rows of rapids, in which tools keep away from the bodies that the cell file gives.
    """
    compared_by = _by_row(bodies)
    rows = []
    for k, (name, compared) in enumerate(compared_by.items()):
        least = {TOOL: None, HOLDER: 0.0}.get(name, clearance_m)
        near = HOLDER_NEAR_M if name == HOLDER else least
        left = None if machined is None or near is None or not compared else LeftOver(machined(), bodies, near)
        part = share_of(progress, k / 4.0, (k + 1.0) / 4.0)
        result = closest(chain, bodies, compared, q, tool, standing, part, left)
        if name == HOLDER:
            rows.append(_holder_row(result, bodies, tool, 0.0 if left is None else left.grain_m))
        else:
            rows.append(_row(name, result, bodies, least))
    if rapid is not None and rows[1].verdict == "ok":
        given = [pair for pair in compared_by[TOOL] if not any(_is_assumed(bodies[k]) for k in pair)]
        at = np.flatnonzero(rapid)
        passed = closest(chain, bodies, given, q[at], tool[at], standing.rows(at))
        if passed is not None and passed.distance_m < RAPID_CLEARANCE_M:
            what = f"{bodies[passed.first].name} to {bodies[passed.second].name} in a rapid"
            rows[1] = Row(TOOL, "warning", passed.distance_m, RAPID_CLEARANCE_M, "m", int(at[passed.point]), what,
                          advice="Raise the rapids, or go there at feed")  # fmt: skip
    return rows


def _by_row(bodies: Sequence[CollisionBody]) -> dict[str, list[tuple[int, int]]]:
    """Pairs that each row compares, in the order of the rows."""
    outer, inner = pairs(bodies)
    out: dict[str, list[tuple[int, int]]] = {ROBOT: [], TOOL: [], HOLDER: [], ARM: inner}
    for a, b in outer:
        out[HOLDER if _holds(bodies, (a, b)) else ROBOT if tool_of(bodies[a], bodies[b]) is None else TOOL].append(
            (a, b)
        )
    return out


def _is_assumed(body: CollisionBody) -> bool:
    return body.assumed and body.tool is None


def _holds(bodies: Sequence[CollisionBody], pair: tuple[int, int]) -> bool:
    return any(bodies[k].tool is not None and not bodies[k].cuts for k in pair)


def _holder_row(result: Closest | None, bodies: Sequence[CollisionBody], tool: Int, grain_m: float) -> Row:
    """The row of the holders; not looked at for tools whose holder is not known."""
    known = {body.tool for body in bodies if body.tool is not None and not body.cuts}
    lacking = [f"T{n}" for n in np.unique(tool).tolist() if n and n not in known]
    if result is not None and result.distance_m < -(grain_m + _TOUCH_M):
        what = f"{bodies[result.first].name} to {bodies[result.second].name}"
        return Row(HOLDER, "fail", result.distance_m, 0.0, "m", result.point, what,
                   advice="Use a longer tool, cut less deep, or make room for the holder")  # fmt: skip
    if lacking or result is None:
        return Row(HOLDER, NOT_LOOKED_AT, what=", ".join(lacking), missing="tools.holder_mm")
    what = f"{bodies[result.first].name} to {bodies[result.second].name}"
    return Row(HOLDER, "ok", max(0.0, result.distance_m), 0.0, "m", result.point, what)


def _row(name: str, result: Closest | None, bodies: Sequence[CollisionBody], clearance_m: float | None) -> Row:
    """A row; without a clearance that of a tool."""
    if result is None:
        return Row(name, NOT_LOOKED_AT, what="nothing to compare", missing="[[cell.body]]")
    first, second = bodies[result.first], bodies[result.second]
    guessed = [body.name for body in (first, second) if body.assumed]
    row = Row(name, "ok", result.distance_m, clearance_m or 0.0, "m", result.point, f"{first.name} to {second.name}")
    contact = -INTO_TABLE_M if clearance_m is None else 0.0
    if result.distance_m >= (clearance_m or -_TOUCH_M):
        return row
    advice = "Move the part, turn the tool about its axis, use a longer tool, or raise the rapids"
    if guessed:
        advice += f"; {' and '.join(guessed)}: size assumed, give it in [[cell.body]]"
    return replace(row, verdict="fail" if result.distance_m < contact else "warning", advice=advice)
