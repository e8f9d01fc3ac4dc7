"""Cut a path in the model: engagement, force and displacement per row, undisturbed or bending."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError, ModelError, ProgramError
from counterflex.core.progress import Progress, silent
from counterflex.core.records import records
from counterflex.core.units import MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.mean_force import mean_force_weights
from counterflex.cutting.removal import bin_edges_rad, grid_of, stamp_workspace
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tilted_stock import cuts_tilted
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan.bending_kernels import THRUST_SIZE
from counterflex.plan.cut_kernel import cut_rows
from counterflex.plan.cut_kernel_arrays import STATE, CutPath, CutRows, CutTool
from counterflex.plan.elastic_motion import STILL
from counterflex.plan.elastic_motion_kernel import MotionArrays
from counterflex.plan.turning_cut.cut import TurningCut
from counterflex.signals.preview import Mode

ROWS_PER_CALL = 2000


@dataclass(frozen=True, eq=False)
class Cut:
    """Forces and engagement of a cut, one row per path point (row i: the segment that ends there). Part axes, SI."""

    w_tcp_part: Float  # (n, 6) N, N m, mean wrench on the tool about its tip
    displacement_part: Float  # (n, 6) m, rad, displacement of the tool at the end of the row (zero when undisturbed)
    volume_m3: Float  # (n,) removed, by rapids too
    axial_depth_m: Float  # (n,) largest engaged axial depth
    entry_rad: Float  # (n,) immersion angle where the engagement begins; NaN out of the cut
    exit_rad: Float  # (n,) where it ends
    feed_per_tooth_m: Float  # (n,) along the path actually run
    chip_m: Float  # (n,) mean chip thickness `f_z mean(sin phi)`; 0 out of the cut

    def collisions(self, kind: Int) -> Int:
        """Rows of rapids that removed material."""
        out: Int = np.flatnonzero((kind == RAPID) & (self.volume_m3 > 1e-12))
        return out


def cut(
    path: ToolPath,
    p_part_command: Float,
    stock: HeightMap,
    cutter_of: Callable[[int], Cutter],
    law: ForceLaw,
    *,
    compliance_part: Float | None = None,
    mode: Mode | None = None,
    correction_part: Float | None = None,
    motion: MotionArrays | None = None,
    progress: Progress = silent,
) -> Cut:
    """Cut the stock along a commanded path.

    Args:
        path: Times, kinds, speeds and tools of the rows.
        p_part_command: (n, 3) m commanded tool tips, part frame (``path.p_part_tcp`` for the program as it is).
        stock: The blank; it is cut in place, but for a tool that is tilted in the cut: columns of material are
            made from it then.
        cutter_of: Gives the cutter of a tool number.
        law: Force law.
        compliance_part: (n, 6, 6) compliance at the tool tip in part axes, to let the tool bend; None keeps it where
            it is commanded.
        mode: The mode through which it bends; needed with ``compliance_part``.
        correction_part: (n, 3) m added to the command; it reaches the tool through the mode, as the force does.
        motion: The elastic robot in motion, which then bends the tool instead of the one mode; it contains the
            commanded angles, corrections included. Compliance and mode still choose the length of steps.
        progress: Progress callback, fraction of the rows 0 to 1; may raise to interrupt.

    Returns:
        The cut, row by row.

    Raises:
        ProgramError: Material is cut in feed motion with the spindle stopped.
        ModelError: The spindle turns backwards (M4), or a column of the stock holds too many stretches.
        InputError: Shapes differ, or compliance without mode.
    """
    n = len(path)
    command = as_float("p_part_command", p_part_command, (n, 3))
    C, offset = _bending(n, compliance_part, correction_part, mode)
    omega, zeta = (0.0, 1.0) if mode is None else (mode.omega_rad_s, mode.damping_ratio)
    w, x = np.zeros((n, 6)), np.zeros((n, 6))
    volume, axial, feed_tooth, chip = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    entry, exit_ = np.full(n, np.nan), np.full(n, np.nan)
    if n < 2:
        return Cut(w, x, volume, axial, entry, exit_, feed_tooth, chip)
    grid, edges, states = grid_of(stock), bin_edges_rad(), records(STATE)
    state = states[0]
    state.tip[:] = command[0]
    kind, numbers = np.ascontiguousarray(path.kind, dtype=np.int64), path.tool
    rows_of_path = CutPath(command, kind, path.time_s, path.spindle_rad_s, C, offset)
    rows = CutRows(w, x, volume, axial, entry, exit_, feed_tooth, chip)
    moving = STILL if motion is None else motion
    turned = None
    if any_tilted(path, stock, cutter_of):
        turned = TurningCut(stock, path.axis_part, law, rows_of_path, omega, zeta, moving, rows)
    # Row i belongs to the tool at its end; row 0 ends no segment.
    changes = [1, *(np.flatnonzero(np.diff(numbers[1:])) + 2).tolist(), n]
    for begin, end in itertools.pairwise(changes):
        # A robot in motion swings on above the stock, so its air is not skipped.
        passes = motion is None and not np.any(kind[begin:end] == FEED)
        if passes and _far_above(command[begin - 1 : end], path.axis_part[begin - 1 : end], stock):
            state.tip[:] = command[end - 1]
            state.stamped = 0
            if turned is not None:
                turned.jump_to(command[end - 1])
            continue
        cutter = cutter_of(int(numbers[begin]))
        if turned is not None:
            turned.cut(begin, end, cutter, progress)
            continue
        tool = _tool(cutter, law, edges)
        state.stamped = 0
        for at in range(begin, end, ROWS_PER_CALL):
            stop = min(at + ROWS_PER_CALL, end)
            cut_rows(at, stop, rows_of_path, tool, grid, omega, zeta, moving, states, rows)
            progress(stop / n)
    # Asked behind the cut: a spindle may start late as long as nothing has been cut.
    _check_spindle(path, kind, volume)
    return Cut(w, x, volume, axial, entry, exit_, feed_tooth, chip)


def _check_spindle(path: ToolPath, kind: Int, volume: Float) -> None:
    """Refuse feeds that take material with the spindle stopped or turning backwards."""
    stopped = (kind == FEED) & (volume > 1e-12) & (path.spindle_rad_s == 0.0)
    if np.any(stopped):
        row = int(np.argmax(stopped))
        raise ProgramError(
            "the program cuts material with the spindle stopped",
            where=f"motion {int(path.motion[row])}, at {np.round(path.p_part_tcp[row] / MM, 3).tolist()} mm",
            hint="Start the spindle (M3 S...) before the first cut; for a robot's program whose spindle a person or "
            "the line controller starts, give its speed: spindle_rpm in [[tools]] of the cell file",
            row=row,
            motion=int(path.motion[row]),
        )
    backward = (kind == FEED) & (volume > 1e-12) & (path.spindle_rad_s < 0.0)
    if np.any(backward):
        row = int(np.argmax(backward))
        raise ModelError(
            "the force model is that of a spindle turning clockwise (M3)",
            where=f"motion {int(path.motion[row])}",
            value="M4",
            hint="Cut with M3",
            motion=int(path.motion[row]),
        )


def at_points(w: Float, contact: Bool) -> Float:
    """Force at the points from force over the segments: the mean of the segments that meet there, while in contact.

    At the last point of a stretch that ends inside the material (the tool then lifts) the last segment's force stands.
    """
    out = np.where(contact[:, None], w, 0.0)
    both = contact[:-1] & contact[1:]
    out[:-1][both] = 0.5 * (w[:-1][both] + w[1:][both])
    return out


def any_tilted(path: ToolPath, stock: HeightMap, cutter_of: Callable[[int], Cutter]) -> bool:
    """Return whether a feed of a path may touch the stock with the tool elsewhere than along z."""
    for number in np.unique(path.tool[path.kind == FEED]):
        fed = (path.kind == FEED) & (path.tool == number)
        if cuts_tilted(stock, path.p_part_tcp[fed], path.axis_part[fed], cutter_of(int(number))):
            return True
    return False


def _far_above(points: Float, axis: Float, stock: HeightMap) -> bool:
    """True when a tool moving through these points with these axes stays above the stock."""
    return bool(np.min(points[:, 2]) > float(stock.z.max()) and np.min(axis[:, 2]) >= 0.0)


def _tool(cutter: Cutter, law: ForceLaw, edges: Float) -> CutTool:
    """A tool with the working space of its kernel."""
    weights = mean_force_weights(cutter, law)
    return CutTool(
        flutes=float(cutter.flutes),
        shape=cutter.kernel_parameters(),
        workspace=stamp_workspace(cutter),
        terms=weights.terms,
        arc=weights.arc,
        levels=weights.levels,
        edges=edges,
        depth=np.zeros((weights.n_levels, weights.n_bins)),
        extra=np.zeros(2),
        wrench_feed=np.zeros(6),
        force=np.zeros(6),
        space=np.zeros(6),
        thrust=np.zeros(THRUST_SIZE),
    )


def _bending(
    n: int, compliance_part: Float | None, correction_part: Float | None, mode: Mode | None
) -> tuple[Float, Float]:
    """Compliance (n, 6, 6) and correction (n, 3) of every row, zero where none are given."""
    if (compliance_part is None) != (mode is None):
        raise InputError("bending needs both a compliance and a mode")
    C = np.zeros((n, 6, 6)) if compliance_part is None else as_float("compliance_part", compliance_part, (n, 6, 6))
    offset = np.zeros((n, 3)) if correction_part is None else as_float("correction_part", correction_part, (n, 3))
    if correction_part is not None and mode is None:
        raise InputError("a correction acts through a mode", hint="Give compliance_part and mode")
    return C, offset
