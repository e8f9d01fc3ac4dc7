"""A closed mesh between the points at which a surface crosses the edges of a lattice of cubes.

Surface nets: a vertex in each cube, a quadrilateral about each crossed edge. A cube in which several pieces of the
surface pass has a vertex for each of them (dual marching cubes, Nielson 2004), else pieces that only come near each
other would share an edge of the mesh: on a face of a cube with material in two opposite corners alone the surface runs
about either corner. What still shares an edge is told apart by a vertex of its own in the middle of it, so that every
edge has two triangles.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Int

_CORNERS = tuple(itertools.product((0, 1), repeat=3))
"""Corners of a cube as (z, y, x)."""


class CrossedEdges(NamedTuple):
    """Crossed edges of a lattice: along x (0), y (1) or z (2); lower nodes (m, 3) z, y, x; whether they are filled."""

    along: int
    edge: Int
    filled: Bool


def net(cubes: tuple[int, int, int], crossed: Sequence[CrossedEdges], points: Float) -> tuple[Float, Int, Int]:
    """Close the surface between its points.

    Args:
        cubes: How many cubes there are along z, y and x. No crossed edge lies on the outside of them.
        crossed: Edges along x, y and z.
        points: (c, 3) m, where the surface crosses them, in that order.

    Returns:
        Vertices (v, 3) m; triangles (t, 3), counterclockwise seen from outside; vertices (c, 4) about each edge.
    """
    cube, place, filled = (
        np.concatenate(parts) for parts in zip(*(_around(one, cubes) for one in crossed), strict=True)
    )
    used, row = np.unique(cube, return_inverse=True)
    row = row.reshape(-1, 4)
    corners = np.bincount(row.ravel(), (1 << place).ravel(), len(used)).astype(np.int64)
    first = np.full(len(used), 12)
    np.minimum.at(first, row.ravel(), place.ravel())
    begins = place == first[row]
    below = np.zeros(len(used), np.int64)
    below[row[begins]] = np.broadcast_to(filled[:, None], row.shape)[begins]
    piece = _pieces()[2 * corners[row] + below[row], place]
    vertex, quads = np.unique(4 * row + piece, return_inverse=True)
    quads = quads.reshape(-1, 4)
    weight, each = np.bincount(quads.ravel()), np.repeat(points, 4, axis=0)
    total = np.stack([np.bincount(quads.ravel(), each[:, c], len(vertex)) for c in range(3)], axis=1)
    vertices = total / weight[:, None]
    turned = np.concatenate([one.filled if one.along == 1 else ~one.filled for one in crossed])
    quads[turned] = quads[turned][:, ::-1]  # (others, axis) in the order z, y, x; along y the sense is the other one
    return *_triangles(vertices, quads, points), quads


def _around(one: CrossedEdges, cubes: tuple[int, int, int]) -> tuple[Int, Int, Bool]:
    """Cubes about each edge (m, 4), which of their twelve edges it is, and whether its lower node is filled."""
    axis = 2 - one.along
    others = [a for a in (0, 1, 2) if a != axis]
    around, places = [], []
    for first, second in ((-1, -1), (-1, 0), (0, 0), (0, -1)):
        cube = one.edge.copy()
        cube[:, others[0]] += first
        cube[:, others[1]] += second
        around.append(np.ravel_multi_index(tuple(cube.T), cubes))
        places.append(np.full(len(cube), 4 * axis - 2 * first - second))
    return np.stack(around, axis=1), np.stack(places, axis=1), one.filled


@cache
def _edges() -> tuple[tuple[int, int], ...]:
    """Corners at the ends of the twelve edges: four along z, y and x, by the place of their others."""
    out = []
    for axis in range(3):
        for rest in itertools.product((0, 1), repeat=2):
            ends = []
            for end in (0, 1):
                corner = list(rest)
                corner.insert(axis, end)
                ends.append(_CORNERS.index(tuple(corner)))
            out.append((ends[0], ends[1]))
    return tuple(out)


def _joined_on_faces(crossed: Sequence[int], inside: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """Pairs of crossed edges that one piece of the surface joins across a face of the cube."""
    # A face with four crossed edges is ambiguous: the pairs about its filled corners are joined, in both cubes alike.
    edges = _edges()
    for axis, side in itertools.product(range(3), (0, 1)):
        face = [c for c, corner in enumerate(_CORNERS) if corner[axis] == side]
        here = [e for e in crossed if edges[e][0] in face and edges[e][1] in face]
        about = [here] if len(here) == 2 else [[e for e in here if c in edges[e]] for c in face if inside[c]]
        for pair in about:
            if len(pair) == 2:
                yield pair[0], pair[1]


@cache
def _pieces() -> Int:
    """(8192, 12) which piece of the surface crosses each edge of a cube."""
    # By twice the crossed edges (bits), plus one where the lower end of the first of them is filled.
    edges, out = _edges(), np.zeros((2 << 12, 12), np.int64)
    for filled in range(1, 255):
        inside = [bool(filled >> c & 1) for c in range(8)]
        crossed = [e for e, (a, b) in enumerate(edges) if inside[a] != inside[b]]
        piece = {e: e for e in crossed}
        for first, second in _joined_on_faces(crossed, inside):
            one, two = piece[first], piece[second]
            piece = {e: one if p == two else p for e, p in piece.items()}
        names = sorted(set(piece.values()))
        key = 2 * sum(1 << e for e in crossed) + inside[edges[crossed[0]][0]]
        for e in crossed:
            out[key, e] = names.index(piece[e])
    return out


def _triangles(vertices: Float, quads: Int, points: Float) -> tuple[Float, Int]:
    """Two triangles for each quadrilateral, more where an edge is shared by four."""
    begin, end = quads, np.roll(quads, -1, axis=1)
    key = np.minimum(begin, end) * len(vertices) + np.maximum(begin, end)
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    shared = (count[which] > 2).reshape(key.shape)
    if not shared.any():
        return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    middle, extra = _told_apart(np.argwhere(shared), key, begin < end)
    number = len(vertices)
    added = [0.5 * (vertices[a] + vertices[b]) for a, b in (divmod(edge, number) for edge in extra)]
    plain = np.ones(len(quads), np.bool_)
    fans: list[tuple[int, int, int]] = []
    for row in sorted({row for row, _ in middle}):
        plain[row] = False
        ring: list[int] = []
        for side in range(4):
            ring.append(int(quads[row, side]))
            if (row, side) in middle:
                ring.append(number + middle[row, side])
        apex = number + len(added)
        added.append(points[row])
        fans += [(apex, a, b) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    kept = quads[plain]
    triangles = np.concatenate([kept[:, [0, 1, 2]], kept[:, [0, 2, 3]], np.array(fans, np.int64).reshape(-1, 3)])
    return np.concatenate([vertices, np.array(added).reshape(-1, 3)]), triangles


def _told_apart(sides: Int, key: Int, forward: Bool) -> tuple[dict[tuple[int, int], int], list[int]]:
    """Sides of quadrilaterals that take a vertex of their own, numbered, and the edge that each of these is on."""
    by_edge: dict[int, tuple[list[tuple[int, int]], list[tuple[int, int]]]] = {}
    for row, side in sides.tolist():
        by_edge.setdefault(int(key[row, side]), ([], []))[int(forward[row, side])].append((row, side))
    middle: dict[tuple[int, int], int] = {}
    extra: list[int] = []
    for edge, (back, forth) in by_edge.items():
        for one, two in list(zip(back, forth, strict=True))[1:]:
            middle[one] = middle[two] = len(extra)
            extra.append(edge)
    return middle, extra
