"""Coarse bodies of a cell: links as capsules along the kinematic chain, spindle, tool, stock and table.

Radii of links are shares of the arm's length from axis 2 to the flange. They are assumptions, not a data sheet: a cell
file can replace each body by its name (``[[cell.body]]``). Adjacent bodies overlap; pairs that cannot be told apart by
capsules are not compared, see :func:`pairs`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import ElasticChain

Shape = Literal["box", "capsule", "cylinder", "mesh"]
FRAMES: Final = ("base", "joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "flange", "tcp", "part")
"""Frames a body can be fixed to; ``jointN`` turns with axis N, its z along the axis."""
_LINK: Final = {"base": 0, "part": 0, "flange": 6, "tcp": 6} | {f"joint{n}": n for n in range(1, 7)}

SHARES: Final = {
    "foot": 0.14,
    "column": 0.12,
    "link arm": 0.08,
    "elbow": 0.10,
    "forearm": 0.06,
    "wrist": 0.05,
    "hand": 0.05,
}
"""Assumed radius of each link by the length of the arm; the elbow carries the motors of the wrist."""
SLENDER_SHARE: Final = 0.06
"""Of every link of an arm without a spherical wrist: what lies between its axes is not said by their numbers."""
SPINDLE_SHARE: Final = 0.03
BRACKET_SHARE: Final = 0.025
"""Likewise of the spindle and of what holds it: a robot carries what it is made for."""
SPINDLE_LENGTH_M: Final = 150.0 * MM
"""Assumed spindle: at least that long; it ends where the flange's centre is square to the tool axis."""
TABLE_M: Final = 100.0 * MM
TABLE_BEYOND_M: Final = 50.0 * MM
"""Assumed table: below the stock, that thick, and that much larger than it on each side."""
_SPHERE_M: Final = 1e-6
STOCK: Final = "stock"
"""Name of the blank's box."""


@dataclass(frozen=True, eq=False)
class CollisionBody:
    """A convex body fixed to a frame."""

    name: str  # for messages, and by which a cell file replaces it
    frame: str  # one of FRAMES
    shape: Shape  # `box`, `capsule`, `cylinder` or `mesh`
    T_frame_body: Float  # (4, 4) its centre; the axis of a capsule or cylinder is z
    # half lengths along x, y, z of a box, or of the box around a mesh; radius and half length of the axis otherwise (a
    # capsule's caps come on top of it)
    size_m: tuple[float, ...]
    assumed: bool = True  # not given by the cell file
    tool: int | None = None  # number of the tool that it is, or None
    surrounds: bool = field(default=False)  # belongs to the surroundings; False for bodies of the robot
    cuts: bool = False  # it removes what it meets of the stock
    of_spindle: bool = False  # stands in the base with a spindle against which the robot holds the part
    vertices_m: Float | None = None  # (k, 3) m, corners of the convex hull of a mesh, from its centre
    faces: Float | None = None  # (f, 4) outward normals and offsets of its faces: `n p + d <= 0` inside

    @property
    def link(self) -> int:
        """Number of axes that move it: 0 is fixed, 6 is carried by the flange."""
        return _LINK[self.frame]


def along(
    name: str,
    frame: str,
    p_frame_from: Float,
    p_frame_to: Float,
    radius_m: float,
    shape: Shape = "capsule",
    *,
    assumed: bool = True,
    tool: int | None = None,
    surrounds: bool = False,
) -> CollisionBody:
    """A capsule or cylinder whose axis runs between two points; a capsule between equal points is a sphere.

    Args:
        name: See :class:`CollisionBody`.
        p_frame_from: (3,) m.
        p_frame_to: (3,) m.
        radius_m: > 0.
        shape: ``capsule`` or ``cylinder``.
        assumed: See :class:`CollisionBody`.
    """
    line = np.asarray(p_frame_to, dtype=np.float64) - p_frame_from
    length = float(np.linalg.norm(line))
    z = line / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    other = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = other - (other @ z) * z
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z], axis=1)
    T = pose.make(R, 0.5 * (np.asarray(p_frame_from) + p_frame_to))
    return CollisionBody(name, frame, shape, T, (radius_m, max(0.5 * length, _SPHERE_M)), assumed, tool, surrounds)


def box(name: str, frame: str, low_m: Float, high_m: Float, *, assumed: bool = True) -> CollisionBody:
    """A box of the surroundings along the axes of its frame, between two corners (3,) m."""
    low, high = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
    half = tuple((0.5 * (high - low)).tolist())
    return CollisionBody(name, frame, "box", pose.make(p=0.5 * (low + high)), half, assumed, surrounds=True)


def hull(name: str, frame: str, T_frame_mesh: Float, points_m: Float, *, surrounds: bool) -> CollisionBody:
    """The convex hull of points as a body.

    Args:
        name: See :class:`CollisionBody`.
        T_frame_mesh: (4, 4) pose of the axes that the points are given in.
        points_m: (k, 3) m, not all in one plane.
    """
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    centre = 0.5 * (low + high)
    shape_hull = scipy.spatial.ConvexHull(points_m - centre)
    T = T_frame_mesh @ pose.make(p=centre)
    half = tuple((0.5 * (high - low)).tolist())
    corners: Float = (points_m - centre)[shape_hull.vertices]
    return CollisionBody(
        name, frame, "mesh", T, half, False, None, surrounds, vertices_m=corners, faces=shape_hull.equations
    )


def holder(number: int, outline_m: Sequence[tuple[float, float]]) -> list[CollisionBody]:
    """The outline of what does not cut of a tool, as cylinders as wide as its wider end, in the TCP's frame.

    Args:
        outline_m: Height above the tip and radius, from the tip upward.
    """
    pieces = [(low, high) for low, high in itertools.pairwise(outline_m) if high[0] > low[0]]
    return [
        along(
            f"holder of T{number}",
            "tcp",
            np.array([0.0, 0.0, -low]),
            np.array([0.0, 0.0, -high]),
            max(r_low, r_high),
            "cylinder",
            assumed=False,
            tool=number,
        )
        for (low, r_low), (high, r_high) in pieces
    ]


def joint_offsets(chain: ElasticChain) -> list[Float]:
    """Place of the frame of the next axis in the frame of each body: base, axis 1 ... axis 6 (there the flange).

    These places do not depend on the joint angles: an axis turns about its own origin.

    Returns:
        7 arrays (3,) m.
    """
    out = []
    T = np.eye(4)
    for i in range(chain.flange_segment + 1):
        T = T @ chain.fixed[i]
        if chain.joint[i] >= 0:
            out.append(T[:3, 3].copy())
            T = np.eye(4)
    return [*out, (T @ chain.T_segment_flange)[:3, 3].copy()]


def arm_reach(chain: ElasticChain) -> float:
    """Length of the arm from axis 2 to the flange along its joint frames, m."""
    return sum(float(np.linalg.norm(offset)) for offset in joint_offsets(chain)[2:])


def links(chain: ElasticChain) -> list[CollisionBody]:
    """The robot as seven capsules between its joint frames, as :data:`SHARES` of its arm's length.

    The forearm ends at the wrist's centre with its cap: behind it is a fork, in which the hand turns.
    """
    offsets = joint_offsets(chain)
    reach = arm_reach(chain)
    shares = SHARES if chain.opw is not None else dict.fromkeys(SHARES, SLENDER_SHARE)
    ends = list(offsets)
    length = max(float(np.linalg.norm(offsets[4])), 1e-9)
    ends[4] = offsets[4] * max(0.0, 1.0 - shares["forearm"] * reach / length)
    frames = ("base", *(f"joint{n}" for n in range(1, 7)))
    return [
        along(name, frame, np.zeros(3), offset, share * reach)
        for (name, share), frame, offset in zip(shares.items(), frames, ends, strict=True)
    ]


def carried(chain: ElasticChain, cutters: Mapping[int, Cutter], overhang_m: Mapping[int, float]) -> list[CollisionBody]:
    """Spindle, what holds it to the flange, and the tools, from the TCP: its z points out of the spindle.

    The tool is a cylinder as long as its overhang, or where that is not known as its flutes and one diameter more;
    behind the shortest stands the spindle, up to the foot of the perpendicular from the flange's centre on the tool
    axis; a bracket fills the way from there to the flange.

    ``overhang_m``: by tool number, where known.
    """
    T_tcp_flange = pose.inverse(chain.T_flange_tcp)
    flange = T_tcp_flange[:3, 3]
    reach = arm_reach(chain)
    radius = SPINDLE_SHARE * reach
    tools, nose = _tools(cutters, overhang_m)
    first = np.array([0.0, 0.0, -nose - radius])
    foot = np.array([0.0, 0.0, min(flange[2], -nose - SPINDLE_LENGTH_M)])
    bracket_end = np.array([0.0, 0.0, min(flange[2], first[2])])
    return [
        along("spindle", "tcp", first, foot, radius),
        along("bracket", "tcp", flange, bracket_end, BRACKET_SHARE * reach),
        *tools,
    ]


def _tools(cutters: Mapping[int, Cutter], overhang_m: Mapping[int, float]) -> tuple[list[CollisionBody], float]:
    """Tools in the TCP's frame, and the stick-out of the shortest, m."""
    stick_out = {n: overhang_m.get(n, cutter.flute_length_m + cutter.diameter_m) for n, cutter in cutters.items()}
    tools = [
        along(f"tool T{n}", "tcp", np.zeros(3), np.array([0.0, 0.0, -length]), 0.5 * cutters[n].diameter_m, "cylinder",
              tool=n)
        for n, length in stick_out.items()
    ]  # fmt: skip
    return [replace(tool, cuts=True) for tool in tools], min(stick_out.values(), default=0.0)


def standing(
    chain: ElasticChain, cutters: Mapping[int, Cutter], overhang_m: Mapping[int, float], T_base_tcp: Float
) -> list[CollisionBody]:
    """Spindle and tools that stand, of a robot that holds the part: as :func:`carried`, without a bracket.

    Args:
        chain: Robot and what it holds.
        cutters: By tool number.
        overhang_m: By tool number, where known.
        T_base_tcp: (4, 4) m, the tip of the tool, z out of the spindle.
    """
    radius = SPINDLE_SHARE * arm_reach(chain)
    tools, nose = _tools(cutters, overhang_m)
    behind = np.array([0.0, 0.0, -1.0])
    spindle = along("spindle", "tcp", (nose + radius) * behind, (nose + SPINDLE_LENGTH_M) * behind, radius)
    return [turned_round(body, T_base_tcp) for body in (spindle, *tools)]


def held_part(chain: ElasticChain, stock: HeightMap) -> list[CollisionBody]:
    """The blank in the robot's hand as its bounding box, and a gripper from the flange to the middle of its underside.

    The gripper is a capsule that ends at the underside: it is no thicker than it is long.

    Args:
        chain: Robot and what it holds; its last frame is the part frame.
    """
    low, high = _bounds(stock)
    T_flange_part = chain.T_flange_tcp
    underside = pose.transform(T_flange_part, np.array([*(0.5 * (low + high))[:2], low[2]]))
    up = T_flange_part[:3, 2]
    height = float(underside @ up)
    thick = BRACKET_SHARE * arm_reach(chain)
    radius = min(thick, height) if height > 0.0 else thick
    blank = replace(box(STOCK, "tcp", low, high), surrounds=False)
    return [along("gripper", "flange", np.zeros(3), underside - radius * up, radius), blank]


def turned_round(body: CollisionBody, T_base_tcp: Float) -> CollisionBody:
    """A body of a cell in which the robot holds the part, fixed to a frame of the chain, which ends in the part frame.

    Args:
        body: Fixed to one of :data:`FRAMES`, where ``tcp`` stands and ``part`` moves.
        T_base_tcp: (4, 4) m, the tip of the tool that stands.

    Returns:
        What was fixed to ``part`` is fixed to the chain's end, ``tcp``; what was fixed to ``tcp`` to the base.
    """
    if body.frame == "part":
        return replace(body, frame="tcp", surrounds=False)
    if body.frame == "tcp":
        T_tcp_body = body.T_frame_body
        return replace(body, frame="base", T_frame_body=T_base_tcp @ T_tcp_body, surrounds=True, of_spindle=True)
    return body


def part_bodies(stock: HeightMap) -> list[CollisionBody]:
    """The blank as its bounding box, and a table below it."""
    low, high = _bounds(stock)
    beyond = np.array([TABLE_BEYOND_M, TABLE_BEYOND_M, 0.0])
    under, over = low - beyond - [0.0, 0.0, TABLE_M], np.array([*high[:2], low[2]]) + beyond
    return [box(STOCK, "part", low, high), box("table", "part", under, over)]


def _bounds(stock: HeightMap) -> tuple[Float, Float]:
    """Lower and upper corner (3,) of the blank's bounding box, part frame, m."""
    ny, nx = stock.z.shape
    half = 0.5 * stock.cell_m
    low = np.array([stock.x0_m - half, stock.y0_m - half, stock.bottom_m])
    size = np.array([nx * stock.cell_m, ny * stock.cell_m, float(stock.z.max()) - stock.bottom_m])
    return low, low + np.maximum(size, _SPHERE_M)


def with_given(
    assumed: Iterable[CollisionBody], given: Sequence[CollisionBody], removed: Iterable[str] = ()
) -> list[CollisionBody]:
    """Bodies of a cell file beside the assumed ones; one of the same name replaces it, a removed one is left out.

    A body in place of a tool is that tool.
    """
    before = {body.name: body for body in assumed}
    gone = {body.name for body in given} | set(removed)
    present = [
        replace(body, tool=(was := before[body.name]).tool, cuts=was.cuts) if body.name in before else body
        for body in given
    ]
    return [*(body for name, body in before.items() if name not in gone), *present]


def pairs(bodies: Sequence[CollisionBody]) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Pairs of bodies that are compared, by their index.

    Whatever an axis moves is compared with the surroundings, but a tool not with the stock, which it cuts (that rapids
    cut is another check). What the flange carries is compared with foot, column, link arm, elbow and forearm. Links
    among themselves are kept apart by the joint limits, and their capsules overlap at the joints.

    Returns:
        Against the surroundings, and against the own arm.
    """
    link = np.array([body.link for body in bodies])
    surrounds = np.array([body.surrounds for body in bodies], dtype=np.bool_)
    carried = np.array([body.name != "hand" and body.tool is None for body in bodies], dtype=np.bool_) & (link == 6)
    fixed, moved = np.flatnonzero((link == 0) & surrounds).tolist(), np.flatnonzero(link > 0).tolist()
    hand, arm = np.flatnonzero(carried).tolist(), np.flatnonzero((link <= 4) & ~surrounds).tolist()
    outer = [
        (a, b)
        for a, b in itertools.product(moved, fixed)
        if not _cuts(bodies[a], bodies[b]) and not _cuts(bodies[b], bodies[a])
    ]
    return outer, list(itertools.product(hand, arm))


def _cuts(first: CollisionBody, second: CollisionBody) -> bool:
    return first.cuts and second.name == STOCK


def holds_stock(first: CollisionBody, second: CollisionBody) -> bool:
    """Return whether a pair is the holder of a tool and the blank: no posture changes how they stand to each other."""
    return any(a.tool is not None and not a.cuts and b.name == STOCK for a, b in ((first, second), (second, first)))


def tool_of(first: CollisionBody, second: CollisionBody) -> int | None:
    """Number of the tool in a pair of bodies, or None."""
    return first.tool if first.tool is not None else second.tool
