"""The arrays that the removal kernels work on, bundled by what they are for."""

from __future__ import annotations

from typing import Final, NamedTuple

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.jit import bundle
from counterflex.cutting.envelope_kernels import Int32


class Grid(NamedTuple):
    """A height map as the kernels see it: heights, block maxima, centre of cell [0, 0], cell side, bottom (m)."""

    z: Float32
    tops: Float32
    x0: float
    y0: float
    cell: float
    floor: float


class Scratch(NamedTuple):
    """Scratch arrays of one thread."""

    lane: Float32
    bit: Int32
    sums: Int
    out: Float32
    minimiser: Float32
    stations: Float
    event: Float32
    code: Int32


class Workspace(NamedTuple):
    """What :func:`stamp_segment` needs besides; one for each thread that stamps. Made by ``stamp_workspace``."""

    scratch: Scratch
    path: Float
    booked: Int
    totals: Int
    unit_width: Float


GRID: Final = bundle(
    Grid,
    z="float32[:, ::1]",
    tops="float32[:, ::1]",
    x0="float64",
    y0="float64",
    cell="float64",
    floor="float64",
)
SCRATCH: Final = bundle(
    Scratch,
    lane="float32[::1]",
    bit="int32[::1]",
    sums="int64[::1]",
    out="float32[::1]",
    minimiser="float32[::1]",
    stations="float64[::1]",
    event="float32[:, ::1]",
    code="int32[:, ::1]",
)
WORKSPACE: Final = bundle(
    Workspace,
    scratch=SCRATCH,
    path="float64[:, ::1]",
    booked="int64[:, :, ::1]",
    totals="int64[:, ::1]",
    unit_width="float64[::1]",
)
