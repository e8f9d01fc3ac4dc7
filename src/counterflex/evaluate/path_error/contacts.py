"""Stretches of the path that made the places of a machined surface.

A place x of the nominal surface is where the tool bodies along the path leave the material: ``min_k gap_k(x) = 0``,
with ``gap_k`` the distance of x to the tool in stretch k. Where the tool is off by ``d_k`` there, its body moves with
it, and what is left at x along the normal n of the surface is

    deviation(x) = min_k (gap_k / (m_k . n) + n . d_k)

with ``m_k`` the normal of the tool at the point nearest to x, into the tool: first order in d. A floor under an end
mill was passed by every stretch within a radius and keeps the lowest; a wall keeps what reached furthest. So every
stretch near a place is listed, whichever came last, and the smallest decides. What the tool is off along a surface
leaves nothing on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.path.toolpath import FEED, ToolPath

MADE_M: Final = 60.0 * UM
"""A place farther than this from every undisturbed tool was not made by the program: chords of scans and of arcs."""
SPACING_M: Final = 0.5 * MM
"""Distance of the nodes at which the error of the path is looked for, on short programs."""
UNREST: Final = 3.0
UNREST_M: Final = 8.0 * MM
"""Narrow errors are 1 + UNREST times as large where the deflection changes, within that way to either side, by its
largest size: entries, exits, corners. Tuning seeds of the groove: peaks of 40 to 230 um in the last millimetres are
missed by 16 to 21 um instead of 21 to 37; with 4 mm by 16 to 27, with 8 times by 16 to 24."""
_FACING: Final = 0.5
"""Cosine of the angle between surface and tool beyond which a stretch does not make a place, but ends beside it."""
_MOST_NODES: Final = 4000
_BATCH: Final = 2000


@dataclass(frozen=True, eq=False)
class Nodes:
    """Points of the path at which its error is looked for; k of them."""

    row: Int  # (k,) row of the path
    chain: Int  # (k,) number of the run of feed, from rapid to rapid, each begins with its start
    station_m: Float  # (k,) length along the run
    unrest: Float  # (k,) factor of the size of narrow errors: 1 where the force is even

    def __len__(self) -> int:
        """Number of nodes."""
        return len(self.row)

    def at_rows(self, values: Float, path: ToolPath, seen: Bool) -> Float:
        """Values at all rows of a path; before the first and behind the last node of a run that is seen, its value.

        ``values``: (k, c) at the nodes. ``seen``: (k,) nodes that count; a run without one has zeros.

        Returns:
            (n, c); zero on rapids.
        """
        p = path.p_part_tcp
        station = np.cumsum(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1))
        out = np.zeros((len(path), values.shape[1]))
        for number in np.unique(self.chain):
            own = np.flatnonzero(self.chain == number)
            known = own[seen[own]]
            if len(known) == 0:
                continue
            rows = np.arange(self.row[own[0]], self.row[own[-1]] + 1)
            at = np.clip(station[rows], station[self.row[known[0]]], station[self.row[known[-1]]])
            for c in range(values.shape[1]):
                out[rows, c] = np.interp(at, station[self.row[own]], values[own, c])
        return out


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of a measured place and a stretch of path between two nodes that may have made it."""

    place: Int  # (p,) number of the place, not decreasing
    node: Int  # (p,) node that ends the stretch; it begins at the node before
    share: Float  # (p,) where on the stretch, 0 at its begin, 1 at its end
    gap_m: Float  # (p,) distance of the place to the undisturbed tool, along the normal of the surface
    normal: Float  # (p, 3) unit normal n of the surface at the place
    made: Bool  # (n,) True for places that the program made

    def left_on(self, error_m: Float) -> Float:
        """Deviation (made,) m of the places that the program made, by errors (k, 3) m of the nodes: forward law."""
        begin = error_m[self.node - 1]
        own = begin + self.share[:, None] * (error_m[self.node] - begin)
        left = self.gap_m + np.sum(self.normal * own, axis=1)
        out: Float = np.minimum.reduceat(left, np.flatnonzero(np.diff(self.place, prepend=-1)))
        return out


def nodes_of(path: ToolPath, deflection_m: Float | None = None) -> Nodes:
    """Nodes on every run of feed: ends of motions, and between them every :data:`SPACING_M` or more.

    ``deflection_m``: (n, 3) m that the plan expects at the rows of the path; None: the force is even.
    """
    feed = path.kind == FEED
    step = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1)
    spacing = max(SPACING_M, float(np.sum(step[feed])) / _MOST_NODES)
    rows: list[int] = []
    chains: list[int] = []
    stations: list[float] = []
    begins = np.flatnonzero(feed & ~np.concatenate([[False], feed[:-1]]))
    for number, first in enumerate(begins.tolist()):
        behind = np.flatnonzero(~feed[first:])
        last = first + (int(behind[0]) if len(behind) else len(feed) - first) - 1
        begin = max(first - 1, 0)
        station = np.cumsum(step[begin : last + 1])
        station -= station[0]
        kept, at = [begin], 0.0
        for row in range(begin + 1, last + 1):
            ends = row == last or path.motion[row] != path.motion[row + 1]
            if station[row - begin] - at >= spacing * (1.0 - 1e-9) or (ends and station[row - begin] > at):
                kept.append(row)
                at = float(station[row - begin])
        rows += kept
        chains += [number] * len(kept)
        stations += station[np.array(kept) - begin].tolist()
    unrest = _unrest(np.array(rows, dtype=np.int64), step, deflection_m)
    return Nodes(np.array(rows, dtype=np.int64), np.array(chains, dtype=np.int64), np.array(stations), unrest)


def _unrest(row: Int, step_m: Float, deflection_m: Float | None) -> Float:
    """Factor of the size of narrow errors at rows of the path; ``step_m`` (n,) m to each row."""
    largest = 0.0 if deflection_m is None else float(np.max(np.linalg.norm(deflection_m, axis=1), initial=0.0))
    if deflection_m is None or largest == 0.0:
        return np.ones(len(row))
    way = np.cumsum(step_m)
    low, high = np.searchsorted(way, way[row] - UNREST_M), np.searchsorted(way, way[row] + UNREST_M, side="right")
    change = [np.linalg.norm(np.ptp(deflection_m[a:b], axis=0)) for a, b in zip(low, high, strict=True)]
    return 1.0 + UNREST * np.array(change) / largest


def contacts_of(
    path: ToolPath, nodes: Nodes, cutter_of: Callable[[int], Cutter], points: Float, normals: Float, reach_m: float
) -> Contacts:
    """List the stretches near each place.

    Args:
        path: The nominal path, tool along z of its axes.
        cutter_of: Gives the cutter of a tool number.
        points: (n, 3) m, places on the nominal surface, axes of the path.
        normals: (n, 3) unit normals of the surface there, out of the material.
        reach_m: Stretches with a larger gap are left out: by so much no two errors of the path differ.
    """
    end = np.flatnonzero(np.diff(nodes.chain, prepend=-1) == 0)
    p = path.p_part_tcp[nodes.row]
    tool = path.tool[nodes.row]
    parts: list[tuple[Int, Int, Float, Float, Float]] = []
    for number in np.unique(tool[end]).tolist():
        cutter, own = cutter_of(int(number)), end[tool[end] == number]
        a, b = p[own - 1], p[own]
        half = 0.5 * float(np.max(np.linalg.norm((b - a)[:, :2], axis=1), initial=0.0))
        tree = scipy.spatial.cKDTree(0.5 * (a + b)[:, :2])
        radius = cutter.radius_m + reach_m + half
        for first in range(0, len(points), _BATCH):
            some = points[first : first + _BATCH]
            listed = tree.query_ball_point(some[:, :2], radius, return_sorted=True)
            count = np.array([len(one) for one in listed], dtype=np.int64)
            if not count.any():
                continue
            segment = np.concatenate([np.asarray(one, dtype=np.int64) for one in listed])
            place = np.repeat(np.arange(len(some)), count)
            gap, normal, share = _gaps(some[place], a[segment], b[segment], cutter)
            facing = np.sum(normal * normals[first + place], axis=1)
            near = (gap <= reach_m) & (facing > _FACING)
            at = place[near] + first
            parts.append((at, own[segment[near]], share[near], gap[near] / facing[near], normals[at]))
    if parts:
        place, node, share, gap, normal = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    else:
        place, node = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        share, gap, normal = np.zeros(0), np.zeros(0), np.zeros((0, 3))
    order = np.argsort(place, kind="stable")
    least = np.full(len(points), np.inf)
    np.minimum.at(least, place, gap)
    made: Bool = np.abs(least) <= MADE_M
    order = order[made[place[order]]]
    return Contacts(place[order], node[order], share[order], gap[order], normal[order], made)


def _gaps(x: Float, a: Float, b: Float, cutter: Cutter) -> tuple[Float, Float, Float]:
    """Distance (n,) of places to the tool on stretches a to b, its normal there into the tool, and where on them."""
    step = b - a
    square = np.sum(step[:, :2] ** 2, axis=1)
    flat = np.sum((x - a)[:, :2] * step[:, :2], axis=1) / np.where(square > 0.0, square, 1.0)
    aside = np.where(square > 0.0, np.clip(flat, 0.0, 1.0), 1.0)
    best = np.full(len(x), np.inf)
    normal, share = np.zeros((len(x), 3)), np.zeros(len(x))
    for at in (aside, np.zeros(len(x)), np.ones(len(x))):  # beside the place, and the lower end of a ramp or plunge
        gap, own = _gap(x - (a + at[:, None] * step), cutter)
        closer = gap < best - 1e-12
        best = np.where(closer, gap, best)
        normal[closer], share[closer] = own[closer], at[closer]
    return best, normal, share


def _gap(q: Float, cutter: Cutter) -> tuple[Float, Float]:
    """Signed distance (n,) of points (n, 3), from the tip, to a cutter along z; normals (n, 3) into the tool."""
    rho = np.hypot(q[:, 0], q[:, 1])
    out = np.stack([q[:, 0], q[:, 1]], axis=1) / np.where(rho > 0.0, rho, 1.0)[:, None]
    corner = cutter.corner_radius_m
    aside, below = rho - (cutter.radius_m - corner), corner - q[:, 2]
    length = np.hypot(aside, below)
    edge = (aside > 0.0) & (below > 0.0)
    side = aside >= below
    gap = np.where(edge, length, np.maximum(aside, below)) - corner
    safe = np.where(length > 0.0, length, 1.0)
    radial = np.where(edge, aside / safe, side.astype(np.float64))
    axial = np.where(edge, below / safe, (~side).astype(np.float64))
    return gap, np.column_stack([-radial[:, None] * out, axial])
