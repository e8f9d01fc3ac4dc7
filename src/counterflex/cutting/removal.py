"""Cut a tool path into the stock: what each segment removed, and where on the cutter."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Float, Float32, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.progress import Progress, silent
from counterflex.cutting.booking_kernels import AREA, BINS, BOTTOM, EVENTS, QUANTUM_M, VISITED, VOLUME
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.envelope_kernels import LANES, NODES, OUT, ROWS, SIDE
from counterflex.cutting.kernel_arrays import Scratch, StockGrid, Workspace
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.sweep_kernels import stamp_runs
from counterflex.cutting.tilted_stock import require_upright_cuts
from counterflex.path import FEED, RAPID, ToolPath

UInt16 = npt.NDArray[np.uint16]

CHUNK_BYTES = 24_000_000
"""Memory of the engagement accumulators of one worker; the path is cut in chunks of segments that fit."""


def bin_edges_rad() -> Float:
    """Edges of the immersion-angle bins, (65,) rad from 0 to pi."""
    out: Float = np.linspace(0.0, np.pi, BINS + 1)
    return out


def unit_widths() -> Float:
    """``cos(phi_j) - cos(phi_j+1)`` of each bin, (64,): chip width across the feed per unit radius."""
    out: Float = -np.diff(np.cos(bin_edges_rad()))
    return out


def grid_of(stock: HeightMap) -> StockGrid:
    """The height map as the kernels take it; it shares the map's arrays."""
    return StockGrid(stock.z, stock.tops, stock.x0_m, stock.y0_m, stock.cell_m, stock.bottom_m)


def stamp_workspace(cutter: Cutter, longest: int = 1) -> Workspace:
    """Scratch arrays for :func:`~counterflex.cutting.sweep_kernels.stamp_segment` with this cutter.

    Args:
        longest: Segments of the longest run that is stamped as one.
    """
    return Workspace(
        scratch=_scratch(longest),
        path=np.empty((2, 3)),
        booked=np.empty((1, cutter.n_levels, BINS), np.int64),
        totals=np.empty((1, 4), np.int64),
        unit_width=unit_widths(),
    )


def _scratch(longest: int) -> Scratch:
    return Scratch(
        lane=np.empty(2 * SIDE, np.float32),
        bit=(1 << np.arange(LANES)).astype(np.int32),
        hits=np.empty(ROWS, np.int32),
        out=np.zeros(OUT, np.float32),
        minimiser=np.empty(NODES + 2, np.float32),
        stations=np.empty(longest + 1),
        event=np.empty((7, EVENTS), np.float32),
        code=np.empty((6, EVENTS), np.int32),
    )


@dataclass(frozen=True)
class Engagement:
    """Booked engagement of many segments, stored sparsely.

    ``depth[l, j]`` of a segment is the axial length in m of cutting edge engaged at level l and immersion-angle bin j,
    averaged over the segment: ``V[l, j] / (L R_l (cos phi_j - cos phi_j+1))``.
    """

    n_levels: int  # axial levels of the cutter
    offsets: Int  # (n + 1,) first entry of each segment
    cell: UInt16  # (entries,) uint16 `level * 64 + bin`
    depth_m: Float32  # (entries,) float32 m

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.offsets) - 1

    def dense(self, first: int, last: int | None = None) -> Float:
        """Engagement of segments [first, last) as (last - first, n_levels, 64) m; one segment when last is None.

        Raises:
            InputError: The range lies outside the path.
        """
        stop = first + 1 if last is None else last
        if not 0 <= first <= stop <= len(self):
            raise InputError("segment range is outside the path", value=(first, stop), limit=f"0 to {len(self)}")
        out = np.zeros((stop - first, self.n_levels * BINS))
        low, high = self.offsets[first], self.offsets[stop]
        row = np.repeat(np.arange(stop - first), np.diff(self.offsets[first : stop + 1]))
        out[row, self.cell[low:high]] = self.depth_m[low:high]
        return out.reshape(stop - first, self.n_levels, BINS)


@dataclass(frozen=True)
class RemovalResult:
    """Material that each segment of a path removed; entry i belongs to the segment from path point i to i + 1."""

    volume_m3: Float  # (n,) volume removed, m^3
    bottom_volume_m3: Float  # (n,) the part of it removed by the end face (descending moves and plunges), m^3
    # (n,) horizontal area lowered under the cutter at the segment's end, 0 unless descending, m^2
    bottom_area_m2: Float
    length_m: Float  # (n,) horizontal length, m
    engagement: Engagement | None  # booked engagement, or None when it was not asked for
    collisions: Int  # (k,) indices of rapid segments that removed material; `volume_m3` says how much
    cells_visited: int  # number of cell evaluations, for benchmarks
    segments_cutting: int  # number of segments that removed something


@kernel(
    "int64(int64[:, :, :, ::1], float64[::1], float64, float64[::1], float64[::1], uint16[::1], "
    "float32[::1], int64[::1], int64[::1], int64)",
    waits=True,
    entry=True,
)
def compress(
    booked: Int,
    length: Float,
    unit: float,
    radii: Float,
    unit_width: Float,
    cell: UInt16,
    depth: Float32,
    offsets: Int,
    side: Int,
    first: int,
) -> int:
    """Sum the workers' books into depths, append the non-zero ones, clear the books; returns the number of entries.

    The n segments are those from ``first`` on in the books. side (n,) receives the quanta booked to each.
    """
    workers, _, levels, bins = booked.shape
    n = len(length)
    at = 0
    for i in range(n):
        side[i] = 0
        for level in range(levels):
            sums = booked[0, first + i, level]
            for worker in range(1, workers):
                other = booked[worker, first + i, level]
                for j in range(sums.size):
                    sums[j] += other[j]
                    other[j] = 0
            total = np.int64(0)
            for j in range(sums.size):
                total += sums[j]
            if total == 0:
                continue
            side[i] += total
            per = unit / (length[i] * radii[level])
            for j in range(bins):
                if sums[j] != 0:
                    cell[at] = level * bins + j
                    depth[at] = sums[j] * per / unit_width[j]
                    sums[j] = 0
                    at += 1
        offsets[i + 1] = at
    return at


def runs_of(p_part_tcp: Float, kind: Int, cutter: Cutter) -> Int:
    """Join consecutive collinear level segments of a flat end mill; returns (n_runs, 2) first segment and count."""
    n = len(p_part_tcp) - 1
    step = np.diff(p_part_tcp, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    # Joined runs are booked by the station at which the rim arrived, which says where a flat mill on the level cut a
    # column; on a slope, or under a corner, the height along the run would count too.
    joined = np.zeros(n, dtype=bool)
    if cutter.is_flat and n > 1:
        cross = step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0]
        dot = step[:-1, 0] * step[1:, 0] + step[:-1, 1] * step[1:, 1]
        joined[1:] = (
            (np.abs(cross) <= 1e-9 * length[:-1] * length[1:])
            & (dot > 0.0)
            & (step[:-1, 2] == 0.0)
            & (step[1:, 2] == 0.0)
            & (kind[:-1] == kind[1:])
        )
    first = np.flatnonzero(~joined)
    return np.stack([first, np.diff(np.append(first, n))], axis=1).astype(np.int64)


def _in_threads(work: Callable[..., Any], shares: list[tuple[Any, ...]]) -> list[Any]:
    """Call a kernel with the arguments of each share, each in a thread of its own."""
    # No prange: its threads spin between two calls, which took a quarter of the processor time of a ball's path.
    if len(shares) == 1:
        return [work(*shares[0])]
    with ThreadPoolExecutor(len(shares)) as pool:
        return list(pool.map(work, *zip(*shares, strict=True)))


def _sparse(
    booked: Int, length: Float, unit: float, cutter: Cutter, side: Int, room: tuple[UInt16, Float32]
) -> Engagement:
    """Sum and clear the workers' books, each worker those of its share of the segments; see :func:`compress`."""
    (workers, _, levels, bins), n = booked.shape, len(length)
    ends = np.linspace(0, n, workers + 1).astype(int)
    offsets = [np.zeros(b - a + 1, np.int64) for a, b in itertools.pairwise(ends)]
    cell, depth = ([array[k * levels * bins :] for k in ends[:-1]] for array in room)
    used = _in_threads(compress, [
        (booked, length[a:b], unit, cutter.level_radii(), unit_widths(), cell[k], depth[k], offsets[k], side[a:b], a)
        for k, (a, b) in enumerate(itertools.pairwise(ends))
    ])  # fmt: skip
    counts = np.concatenate([[0], *map(np.diff, offsets)])
    kept = (np.concatenate([array[:n] for array, n in zip(arrays, used, strict=True)]) for arrays in (cell, depth))
    return Engagement(levels, np.cumsum(counts), *kept)


def remove_segments(
    stock: HeightMap,
    p_part_tcp: Float,
    kind: Int,
    cutter: Cutter,
    *,
    engagement: bool = True,
    threads: int = 1,
    progress: Progress = silent,
) -> Iterator[tuple[int, RemovalResult]]:
    """Cut a path chunk by chunk, for long paths whose engagement should not be held at once.

    Args and errors as :func:`remove_path`.

    Yields:
        First segment of the chunk, and the chunk's result (indices in ``collisions`` count from the whole path).
    """
    path = as_float("p_part_tcp", p_part_tcp, (None, 3))
    n = len(path) - 1
    if n < 1:
        raise InputError("tool path has no segment", value=f"{len(path)} points", limit=">= 2 points")
    if len(kind) == n + 1:
        kind = kind[1:]  # entry i of a tool path ends segment i - 1: the first ends none
    kinds: Int = np.ascontiguousarray(kind, dtype=np.int64)
    if kinds.shape != (n,):
        raise InputError("kind has the wrong length", value=kinds.shape, limit=f"({n},) or ({n + 1},)")
    if threads < 1:
        raise InputError("number of threads is out of range", value=threads, limit=">= 1")
    shape = cutter.kernel_parameters()
    levels = cutter.n_levels
    runs = runs_of(path, kinds, cutter)
    book = (kinds == FEED) & engagement
    length = np.hypot(np.diff(path[:, 0]), np.diff(path[:, 1]))
    per_chunk = max(256, CHUNK_BYTES // (8 * BINS * levels)) if engagement else 65536
    unit = QUANTUM_M * stock.cell_m**2
    grid = grid_of(stock)
    longest = int(runs[:, 1].max())
    # a run is never divided: the last one of a chunk reaches beyond it
    booked = np.zeros((threads, per_chunk + longest, levels if engagement else 0, BINS), np.int64)
    room = np.empty(booked[0].size, np.uint16), np.empty(booked[0].size, np.float32)
    scratch = [_scratch(longest) for _ in range(threads)]
    at = 0
    while at < len(runs):
        first = int(runs[at, 0])
        stop = int(np.searchsorted(runs[:, 0], first + per_chunk))
        stop = min(max(stop, at + 1), len(runs))
        last = int(runs[stop - 1].sum())
        count = last - first
        chunk = runs[at:stop] - np.array([first, 0])
        totals = np.zeros((threads, count, 4), np.int64)
        part = grid, path[first : last + 1], chunk, shape, first > 0, book[first:last]
        # Each worker cuts its share of every segment, with scratch arrays of its own.
        _in_threads(stamp_runs, [(*part, booked[k], totals[k], k, threads, scratch[k]) for k in range(threads)])
        sums = totals.sum(axis=0)
        side = np.zeros(count, np.int64)
        booked_engagement = None
        if engagement:
            booked_engagement = _sparse(booked, length[first:last], unit, cutter, side, room)
        quanta = sums[:, VOLUME] + sums[:, BOTTOM] + side  # whole numbers: the same for any number of threads
        volume = quanta * unit
        yield (
            first,
            RemovalResult(
                volume,
                sums[:, BOTTOM] * unit,
                sums[:, AREA] * stock.cell_m**2,
                length[first:last],
                booked_engagement,
                first + np.flatnonzero((kinds[first:last] == RAPID) & (volume > 0.0)),
                int(sums[:, VISITED].sum()),
                int(np.count_nonzero(quanta)),
            ),
        )
        at = stop
        progress(last / n, "removing material")


def remove_path(
    stock: HeightMap,
    p_part_tcp: Float,
    kind: Int,
    cutter: Cutter,
    *,
    engagement: bool = True,
    threads: int = 1,
    progress: Progress = silent,
) -> RemovalResult:
    """Cut a path into the stock, in place, by the exact swept envelope of every straight segment.

    Args:
        stock: Height map, cut in place.
        p_part_tcp: (n + 1, 3) tool tip, m, part frame.
        kind: (n,) or (n + 1,) kind of each segment (:data:`~counterflex.path.FEED` or ``RAPID``); with n + 1 entries
            entry i ends segment i - 1 as in :class:`~counterflex.path.ToolPath`.
        engagement: Book what feed segments remove by level and immersion angle. Rapids are never booked.
        threads: Number of threads; the result is the same to the bit for any.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        InputError: Path, kinds or threads are not as described.
    """
    parts = [
        piece
        for _, piece in remove_segments(
            stock, p_part_tcp, kind, cutter, engagement=engagement, threads=threads, progress=progress
        )
    ]
    booked = [part.engagement for part in parts if part.engagement is not None]
    merged = None
    if booked:
        counts = np.concatenate([np.diff(piece.offsets) for piece in booked])
        merged = Engagement(
            cutter.n_levels,
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.concatenate([piece.cell for piece in booked]),
            np.concatenate([piece.depth_m for piece in booked]),
        )
    return RemovalResult(
        np.concatenate([part.volume_m3 for part in parts]),
        np.concatenate([part.bottom_volume_m3 for part in parts]),
        np.concatenate([part.bottom_area_m2 for part in parts]),
        np.concatenate([part.length_m for part in parts]),
        merged,
        np.concatenate([part.collisions for part in parts]),
        sum(part.cells_visited for part in parts),
        sum(part.segments_cutting for part in parts),
    )


def remove_tool_path(
    stock: HeightMap,
    path: ToolPath,
    cutter: Cutter,
    *,
    engagement: bool = True,
    threads: int = 1,
    progress: Progress = silent,
) -> RemovalResult:
    """Cut a :class:`~counterflex.path.ToolPath` with one tool into the stock; see :func:`remove_path`.

    Raises:
        ModelError: The tool axis is tilted against part z.
        InputError: The path uses more than one tool, or is otherwise not as :func:`remove_path` needs it.
    """
    fed = path.kind == FEED
    require_upright_cuts(stock, path.p_part_tcp[fed], path.axis_part[fed], cutter)
    if len(path) > 1 and np.any(path.tool[1:] != path.tool[1]):
        raise InputError("tool path changes the tool", hint="Cut it tool by tool")
    return remove_path(
        stock, path.p_part_tcp, path.kind, cutter, engagement=engagement, threads=threads, progress=progress
    )
