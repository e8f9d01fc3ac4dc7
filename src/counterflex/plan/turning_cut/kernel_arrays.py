"""What :func:`counterflex.plan.turning_cut.kernel.cut_turning_rows` takes beside the arrays of upright cuts."""

from __future__ import annotations

from typing import Final, NamedTuple

from counterflex.core.arrays import Float
from counterflex.core.jit import bundle
from counterflex.core.records import record
from counterflex.cutting.tridexel.step_kernels import STEP_SPACE, StepSpace

TURNING_STATE: Final = record(
    displacement=(float, 6),
    rate=(float, 6),
    tip=(float, 3),
    bend=float,
    force=(float, 6),
    height=float,
    full=int,
)
"""As :data:`counterflex.plan.cut_kernel_arrays.STATE`, with the height on the cutter at the middle of what it cut last
(m above the tip), and the row to go on with after the stock was given room; negative: the row that found none."""


class TurningTool(NamedTuple):
    """What cuts: cutter and weights of its mean force, and working space for them."""

    flutes: float
    space: StepSpace
    terms: Float
    arc: Float
    levels: Float
    edges: Float
    depth: Float
    extra: Float
    wrench_feed: Float
    force: Float
    ends: Float
    space_wrench: Float
    thrust: Float


TURNING_TOOL: Final = bundle(
    TurningTool,
    flutes="float64",
    space=STEP_SPACE,
    terms="float64[:, ::1]",
    arc="float64[:, :, ::1]",
    levels="float64[:, ::1]",
    edges="float64[::1]",
    depth="float64[:, ::1]",
    extra="float64[::1]",
    wrench_feed="float64[::1]",
    force="float64[::1]",
    ends="float64[:, ::1]",
    space_wrench="float64[::1]",
    thrust="float64[::1]",
)
