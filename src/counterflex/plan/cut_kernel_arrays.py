"""What :func:`counterflex.plan.cut_kernel.cut_rows` takes: path, tool, state and results, each with its type."""

from __future__ import annotations

from typing import Final, NamedTuple

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import bundle
from counterflex.core.records import record
from counterflex.cutting.kernel_arrays import WORKSPACE, Workspace

STATE: Final = record(
    displacement=(float, 6), rate=(float, 6), tip=(float, 3), stamped=int, bend=float, force=(float, 6)
)
"""Carried from row to row: displacement of the tool (m, rad) and its rate, the last tip (m, part frame), whether the
last segment was stamped, how far the force of the last contact bends the tool (m), and the force that has come to act
on the robot in motion (N, N m)."""


class CutPath(NamedTuple):
    """What is cut, rows as in :func:`counterflex.plan.cut.cut`: commanded tips, kinds, times, speeds, bending."""

    p_command: Float
    kind: Int
    time_s: Float
    spindle_rad_s: Float
    compliance: Float
    offset: Float


class CutTool(NamedTuple):
    """What cuts: cutter and weights of its mean force, and working space for them."""

    flutes: float
    shape: Float
    workspace: Workspace
    terms: Float
    arc: Float
    levels: Float
    edges: Float
    depth: Float
    extra: Float
    wrench_feed: Float
    force: Float
    space: Float
    thrust: Float


class CutRows(NamedTuple):
    """What comes out, a row per path row, as in :class:`counterflex.plan.cut.Cut`."""

    wrench: Float
    displacement: Float
    volume: Float
    axial: Float
    entry: Float
    exit_: Float
    feed_tooth: Float
    chip: Float


CUT_PATH: Final = bundle(
    CutPath,
    p_command="float64[:, ::1]",
    kind="int64[::1]",
    time_s="float64[::1]",
    spindle_rad_s="float64[::1]",
    compliance="float64[:, :, ::1]",
    offset="float64[:, ::1]",
)
CUT_TOOL: Final = bundle(
    CutTool,
    flutes="float64",
    shape="float64[::1]",
    workspace=WORKSPACE,
    terms="float64[:, ::1]",
    arc="float64[:, :, ::1]",
    levels="float64[:, ::1]",
    edges="float64[::1]",
    depth="float64[:, ::1]",
    extra="float64[::1]",
    wrench_feed="float64[::1]",
    force="float64[::1]",
    space="float64[::1]",
    thrust="float64[::1]",
)
CUT_ROWS: Final = bundle(
    CutRows,
    wrench="float64[:, ::1]",
    displacement="float64[:, ::1]",
    volume="float64[::1]",
    axial="float64[::1]",
    entry="float64[::1]",
    exit_="float64[::1]",
    feed_tooth="float64[::1]",
    chip="float64[::1]",
)
