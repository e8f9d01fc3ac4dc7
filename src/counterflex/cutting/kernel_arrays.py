"""The arrays that the removal kernels work on, bundled by what they are for."""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from counterflex.core.arrays import Float1, Float2, Float32, Int2, Int3
from counterflex.core.jit import bundle
from counterflex.cutting.envelope_kernels import Int32


class StockGrid(NamedTuple):
    """A height map as the kernels see it: heights, block maxima, centre of cell [0, 0], cell side, bottom (m)."""

    z: Annotated[Float32, "float32[:, ::1]"]
    tops: Annotated[Float32, "float32[:, ::1]"]
    x0: float
    y0: float
    cell: float
    floor: float


class Scratch(NamedTuple):
    """Scratch arrays of one thread."""

    lane: Annotated[Float32, "float32[::1]"]
    bit: Annotated[Int32, "int32[::1]"]
    hits: Annotated[Int32, "int32[::1]"]
    out: Annotated[Float32, "float32[::1]"]
    minimiser: Annotated[Float32, "float32[::1]"]
    stations: Float1
    event: Annotated[Float32, "float32[:, ::1]"]
    code: Annotated[Int32, "int32[:, ::1]"]


class Workspace(NamedTuple):
    """Working arrays of :func:`stamp_segment`; one for each thread that stamps. Made by ``stamp_workspace``."""

    scratch: Scratch
    path: Float2
    booked: Int3
    totals: Int2
    unit_width: Float1


GRID: Final = bundle(StockGrid)
SCRATCH: Final = bundle(Scratch)
