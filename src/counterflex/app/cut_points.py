"""Points at which a deflection known only by its distribution is judged: of a cut, or a corner of the blank."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from counterflex.app.unknown_stiffness import FORCE_N, UNDER_FORCE, corner_of_blank
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.progress import Progress, silent
from counterflex.files.cell.cell import Cell

if TYPE_CHECKING:
    from counterflex.app.inputs import Job
    from counterflex.path.external_axes import ExternalPlaces
    from counterflex.plan.plan import Plan
    from counterflex.plan.posture.cut_path import LoadedPath

_POINTS: Final = 500  # Points of a cut that are looked at, evenly along it
_SHARE: Final = 0.997


@dataclass(frozen=True, eq=False)
class CutPoints:
    """Points with the load on the tool."""

    q: Float  # (n, 6) rad
    w_tcp_base: Float  # (n, 6) N, N m
    feed_base: Float  # (n, 3) direction of the path, base axes; zero where every direction counts
    weight_m: Float  # (n,) length of path that each stands for
    of: str
    row: Int  # (n,) rows of the path

    def sizes(self, displacements: Float) -> Float:
        """Return what 99.7 % of the path stay below, square to it.

        Args:
            displacements: (draws, n, 3) m, base axes.

        Returns:
            (draws,) m.
        """
        along = np.sum(displacements * self.feed_base, axis=2, keepdims=True) * self.feed_base
        size = np.linalg.norm(displacements - along, axis=2)
        weights = np.broadcast_to(self.weight_m, size.shape)
        out: Float = np.quantile(size, _SHARE, axis=1, weights=weights, method="inverted_cdf")
        return out


def points_of_plan(plan: Plan, cell: Cell, name: str, places: ExternalPlaces | None = None) -> CutPoints | None:
    """Points of the cut of a plan; None where nothing is cut."""
    Ts_base_part = None if places is None else places.Ts_base_part(plan.path.place)
    return _points(cell, plan.path.p_part_tcp, plan.q, plan.w_tcp_part, plan.judged, name, Ts_base_part)


def points_of_program(job: Job, cell: Cell, progress: Progress = silent) -> CutPoints | None:
    """Points of the cut of a program, with the force of the undisturbed cut.

    Args:
        cell: The cell; what its robot yields does not matter.

    Returns:
        The points; None where nothing is cut.

    Raises:
        CounterflexError: The program does not fit the cell.
    """
    from counterflex.app.inputs import faults_in, setting_of  # the planner is heavy, a cell is judged without it
    from counterflex.plan.inputs import CompensationInputs, solve_joints
    from counterflex.plan.undisturbed_cut import undisturbed_cut

    setting = setting_of(cell, job, chain=cell.chain)
    path, line = job.path, job.line_of_motion[job.path.motion]
    with faults_in(job):
        q = solve_joints(path, line, setting).q
        cut = undisturbed_cut(CompensationInputs(path, line, cell.stock(), setting, q), progress)
    return _points(cell, path.p_part_tcp, q, cut.w_tcp_part, cut.contact, Path(job.program.name).name)


def points_of_posture(cell: Cell, cut: LoadedPath, q: Float, T_base_part: Float | None, name: str) -> CutPoints | None:
    """Points of a cut in a posture and a place of the part that the cell file need not have; None where none is cut.

    Args:
        q: (n, 6) rad along it.
        T_base_part: (4, 4) where the part stands; None: where the cell file has it.
    """
    return _points(cell, cut.p_part, q, cut.w_tcp_part, cut.weight_m > 0.0, name, T_base_part)


def corner_points(cell: Cell) -> CutPoints:
    """The first corner of the blank's top under 500 N along each of the base axes, the softest of which counts.

    Raises:
        CounterflexError: There is no blank, or it cannot be reached.
    """
    w = np.zeros((3, 6))
    w[:, :3] = FORCE_N * np.eye(3)
    q = np.tile(corner_of_blank(cell), (3, 1))
    return CutPoints(q, w, np.zeros((3, 3)), np.ones(3), UNDER_FORCE, np.arange(3))


def _points(
    cell: Cell, p_part: Float, q: Float, w_tcp_part: Float, cutting: Bool, name: str, T_base_part: Float | None = None
) -> CutPoints | None:
    if cell.holds_part:
        return None
    rows = np.flatnonzero(cutting)
    rows = rows[:: max(1, len(rows) // _POINTS)]
    if not len(rows):
        return None
    step = np.diff(p_part, axis=0, prepend=p_part[:1])[rows]
    length = np.linalg.norm(step, axis=1)
    T = cell.T_base_part if T_base_part is None else T_base_part
    R_base_part = np.broadcast_to(T, (len(q), 4, 4))[rows, :3, :3]
    feed = np.einsum("nij,nj->ni", R_base_part, step / np.where(length > 0.0, length, 1.0)[:, None])
    w = np.einsum("nij,nkj->nki", R_base_part, w_tcp_part[rows].reshape(-1, 2, 3)).reshape(-1, 6)
    what = f"in {name} ({100.0 * _SHARE:g} % of the path in the cut)"
    return CutPoints(q[rows], w, feed, np.maximum(length, 1e-12), what, rows)
