"""The surface of a part from lines along x, y and z: exact points, and a mesh through them.

A closed mesh between the points at which a surface crosses the edges of a lattice of cubes.

Surface nets: a vertex in each cube, a quadrilateral about each crossed edge. A cube in which several pieces of the
surface pass has a vertex for each of them (dual marching cubes, Nielson 2004), else pieces that only come near each
other would share an edge of the mesh: on a face of a cube with material in two opposite corners alone the surface runs
about either corner. What still shares an edge is told apart by a vertex of its own in the middle of it, so that every
edge has two triangles.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.atomic import write_made
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.cutting.tridexel.lattice_kernels import edges_across, edges_up

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


LIMIT_POINTS: Final = 20_000_000


@dataclass(frozen=True, eq=False)
class Surface:
    """Points where the lines of the lattice leave the material, and a closed mesh between them."""

    points: Float  # (c, 3) m, part frame: exact ends of material on the lines
    along: Int  # (c,) 0, 1 or 2: along which axis the line of each runs
    cut: Bool  # (c,) whether a motion made it; the others are faces of the blank
    # (v, 3) m of the mesh: in each cube of the lattice, for each piece of the surface in it, the mean of the points on
    # its edges
    vertices: Float
    triangles: Int  # (t, 3) vertices, counterclockwise seen from outside
    around: Int  # (c, 4) vertices about the line of each point

    def at_vertices(self, values: Float) -> Float:
        """Values (c,) of points as those (v,) of the vertices about them: their mean; nan where there is none."""
        known = ~np.isnan(values)
        places = self.around[known].ravel()
        total = np.bincount(places, np.repeat(values[known], 4), len(self.vertices))
        count = np.bincount(places, minlength=len(self.vertices))
        mean: Float = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
        return mean

    def turned(self, R_part_plane: Float) -> Surface:
        """The same surface, given in a plane's frame, in that of the part."""
        return replace(self, points=self.points @ R_part_plane.T, vertices=self.vertices @ R_part_plane.T)

    def save(self, path: Path, deviation_m: Float | None = None, range_m: float = 0.1 * MM) -> None:
        """Write the mesh in mm as STL, or as PLY with a deviation: in colours, and as the scalar ``deviation_um``.

        Args:
            path: ``.stl`` or ``.ply``.
            deviation_m: (v,) of each vertex, m; nan is grey. For PLY only.
            range_m: Deviation of full red (material left) and full blue (gouged).

        Raises:
            InputError: Another ending, or a range that is not above zero.
        """
        import trimesh  # heavy

        if path.suffix not in (".stl", ".ply"):
            raise InputError("a mesh is written as .stl or .ply", value=path.name)
        if not range_m > 0.0:
            raise InputError("range of the colours is not above zero", value=f"{range_m / MM:g} mm")
        mesh = trimesh.Trimesh(self.vertices / MM, self.triangles, process=False)
        if deviation_m is not None:
            share = np.clip(np.nan_to_num(deviation_m / range_m), -1.0, 1.0)
            white = 1.0 - np.abs(share)
            red, blue = white + np.maximum(share, 0.0), white + np.maximum(-share, 0.0)
            colours = np.stack([red, white, blue], axis=1)
            colours[np.isnan(deviation_m)] = 0.7
            mesh.visual.vertex_colors = np.round(255.0 * colours).astype(np.uint8)
            mesh.vertex_attributes["deviation_um"] = (deviation_m / UM).astype(np.float32)
        write_made(path, lambda stream: mesh.export(stream, file_type=path.suffix[1:]))


def surface(stock: ColumnStock, log: CutLog, pitch_m: float | None = None) -> Surface:
    """The surface that motions have left of a stock.

    Columns say which nodes of the lattice hold material and where lines along z leave it; between two nodes of which
    one holds material and the other none, lines along x and y end where the first sweep of ``log`` begins, exactly.
    What is thinner than a cell and lies between two nodes is not seen.

    Args:
        stock: After all cuts.
        log: All motions that made it.
        pitch_m: Distance of the lattice's levels in z, m; None: that of the columns.

    Raises:
        InputError: Nothing is left, or the surface would have more than 20 million points.
    """
    lattice = _Lattice.of(stock, pitch_m)
    ends = [_Ends.across(lattice, 0, stock, log), _Ends.across(lattice, 1, stock, log), _Ends.up(lattice, stock)]
    points = np.concatenate([one.points for one in ends])
    vertices, triangles, quads = net(
        lattice.cubes, [CrossedEdges(one.along, one.edge, one.filled) for one in ends], points
    )
    return Surface(
        points,
        np.concatenate([np.full(len(one.edge), one.along) for one in ends]),
        np.concatenate([one.cut for one in ends]),
        vertices,
        triangles,
        quads,
    )


def wall_points(stock: ColumnStock, log: CutLog, pitch_m: float | None = None) -> Float:
    """Points (n, 3) m at which lines along x and y meet what was cut: walls and slopes, without the mesh.

    Args:
        stock: See :func:`surface`.
        pitch_m: See there.

    Raises:
        InputError: See there.
    """
    lattice = _Lattice.of(stock, pitch_m)
    ends = [_Ends.across(lattice, along, stock, log, 0) for along in (0, 1)]
    return np.concatenate([one.points[one.cut] for one in ends])


@dataclass(frozen=True, eq=False)
class _Lattice:
    """Nodes at (x, y, z): one more than the columns on every side, one level below and above the material."""

    x: Float
    y: Float
    z: Float

    @classmethod
    def of(cls, stock: ColumnStock, pitch_m: float | None) -> _Lattice:
        pitch = stock.cell_m if pitch_m is None else pitch_m
        held = stock.count > 0
        if not held.any():
            raise InputError("nothing is left of the stock, so that it has no surface")
        bottom = float(stock.low[0].min(where=held, initial=np.inf))
        layers = range(int(stock.count.max()))
        top = max(float(stock.high[k].max(where=stock.count > k, initial=-np.inf)) for k in layers)
        ny, nx = stock.count.shape
        # half a pitch off the ends, so that faces at whole pitches fall between two levels
        levels = np.arange(int(np.ceil((top - bottom) / pitch)) + 2, dtype=np.float64)
        return cls(
            stock.x0_m - stock.cell_m + stock.cell_m * np.arange(nx + 2, dtype=np.float64),
            stock.y0_m - stock.cell_m + stock.cell_m * np.arange(ny + 2, dtype=np.float64),
            bottom + pitch * (levels - 0.5),
        )

    @property
    def pitch(self) -> float:
        return float(self.z[1] - self.z[0])

    @property
    def cubes(self) -> tuple[int, int, int]:
        return len(self.z) - 1, len(self.y) - 1, len(self.x) - 1


@dataclass(frozen=True, eq=False)
class _Ends:
    """Ends of material on edges: lower nodes (k, j, i), which side is filled, points, made by a cut."""

    along: int
    edge: Int
    filled: Bool
    points: Float
    cut: Bool

    @classmethod
    def across(cls, lattice: _Lattice, along: int, stock: ColumnStock, log: CutLog, outer: int = 1) -> _Ends:
        """Ends on lines along x (0) or y (1); outer 0 leaves out the sides of the blank."""
        z0, pitch = float(lattice.z[0]), lattice.pitch
        edge, filled = _room(stock.count.size // 4)
        count = edges_across(stock.columns, along, outer, z0, pitch, edge, filled)
        if count > len(edge):
            edge, filled = _room(count)
            edges_across(stock.columns, along, outer, z0, pitch, edge, filled)
        edge, filled = edge[:count], filled[:count]
        k, j, i = edge.T
        start = np.stack([lattice.x[i], lattice.y[j], lattice.z[k]], axis=1)
        ends = log.ends(along, start, stock.cell_m, filled)
        cut = ~np.isnan(ends)
        ends = np.where(
            cut, np.clip(ends, 0.0, stock.cell_m), 0.5 * stock.cell_m
        )  # faces of the blank end half a cell out
        outer = (i == 0) | (i == len(lattice.x) - 2) if along == 0 else (j == 0) | (j == len(lattice.y) - 2)
        blank = np.where(filled, ends > 0.5 * stock.cell_m, ends < 0.5 * stock.cell_m) & outer
        ends = np.where(blank, 0.5 * stock.cell_m, ends)
        points = start.copy()
        points[:, along] += ends
        return cls(along, edge, filled, points, cut & ~blank)

    @classmethod
    def up(cls, lattice: _Lattice, stock: ColumnStock) -> _Ends:
        """Ends on lines along z, from the columns."""
        z0, pitch = float(lattice.z[0]), lattice.pitch
        edge, filled = _room(edges_up(stock.columns, z0, pitch, *_room(0), np.empty(0)))
        z = np.empty(len(edge))
        edges_up(stock.columns, z0, pitch, edge, filled, z)
        k, j, i = edge.T
        points = np.stack([lattice.x[i], lattice.y[j], np.clip(z, lattice.z[k], lattice.z[k + 1])], axis=1)
        faces = (k == 0) | (k == len(lattice.z) - 2)
        return cls(2, edge, filled, points, ~faces)


def _room(count: int) -> tuple[Int, Bool]:
    """Arrays for so many edges."""
    if count > LIMIT_POINTS:
        raise InputError(
            "the surface has too many points",
            value=str(count),
            limit=str(LIMIT_POINTS),
            hint="Take larger cells of the stock (cell_mm)",
        )
    return np.empty((count, 3), np.int64), np.empty(count, np.bool_)
