"""Arguments of :func:`counterflex.plan.cut_kernel.cut_rows`: path, tool, state and results, each with its type."""

from __future__ import annotations

from typing import Final, NamedTuple

from counterflex.core.arrays import Float1, Float2, Float3, Int1
from counterflex.core.jit import bundle
from counterflex.core.records import record
from counterflex.cutting.kernel_arrays import Workspace

STATE: Final = record(
    displacement=(float, 6), rate=(float, 6), tip=(float, 3), stamped=int, bend=float, force=(float, 6)
)
"""Carried from row to row: displacement of the tool (m, rad) and its rate, the last tip (m, part frame), whether the
last segment was stamped, how far the force of the last contact bends the tool (m), and the force that has come to act
on the robot in motion (N, N m)."""


class CutPath(NamedTuple):
    """Path of a cut, rows as in :func:`counterflex.plan.cut.cut`: commanded tips, kinds, times, speeds, bending."""

    p_command: Float2
    kind: Int1
    time_s: Float1
    spindle_rad_s: Float1
    compliance: Float3
    offset: Float2


class CutTool(NamedTuple):
    """Tool of a cut: cutter and weights of its mean force, and working space for them."""

    flutes: float
    shape: Float1
    workspace: Workspace
    terms: Float2
    arc: Float3
    levels: Float2
    edges: Float1
    depth: Float2
    extra: Float1
    wrench_feed: Float1
    force: Float1
    space: Float1
    thrust: Float1


class CutRows(NamedTuple):
    """Results of a cut, a row per path row, as in :class:`counterflex.plan.cut.Cut`."""

    wrench: Float2
    displacement: Float2
    volume: Float1
    axial: Float1
    entry: Float1
    exit_: Float1
    feed_tooth: Float1
    chip: Float1


CUT_PATH: Final = bundle(CutPath)
CUT_TOOL: Final = bundle(CutTool)
CUT_ROWS: Final = bundle(CutRows)
