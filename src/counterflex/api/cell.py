"""The cell itself: read it, ask how far it bends, identify it; checks and choices that need a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from counterflex.app import posture as posture_job
from counterflex.app import preflight as preflight_job
from counterflex.app.identification import identify as identify_job
from counterflex.app.inspection import judging
from counterflex.core.arrays import as_float
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.plan.posture.choose import Freedom
from counterflex.plan.posture.cut_path import Surface
from counterflex.robot.elasticity import compliance, gravity
from counterflex.robot.kinematics.inverse import inverse_path

__all__ = ("choose_posture", "deflection", "identify_cell", "inspect_part", "preflight", "read_cell")


def deflection(cell: Cell | str | Path, at_mm: Any, force_n: Any) -> pl.DataFrame:
    """How far forces on the tool tip bend the cell, by the elastic model.

    The tool stands along z of the part, in the posture of the cell file.

    Args:
        cell: Cell, or cell file.
        at_mm: (3,) or (n, 3) tool tips in the part frame.
        force_n: (3,) or (n, 3) forces on the tool in part axes.

    Returns:
        n rows: ``x_mm`` ..., ``fx_n`` ..., ``deflection_x_um`` ... (displacement of the tip in part axes by the force),
        ``sag_x_um`` ... (by own weight).

    Raises:
        InputError: Shapes that do not fit, or a stiffness that is not known.
        ReachError: A point is out of reach.
    """
    known = cell if isinstance(cell, Cell) else read_cell(cell)
    places = as_float("at_mm", np.atleast_2d(np.asarray(at_mm, dtype=np.float64)), (None, 3))
    forces = np.atleast_2d(np.asarray(force_n, dtype=np.float64))
    forces = as_float("force_n", np.broadcast_to(forces, places.shape) if len(forces) == 1 else forces, places.shape)
    upright = np.tile([0.0, 0.0, 1.0], (len(places), 1))
    rotation = tool_orientation(upright, known.tables.posture.rotation_about_tool_deg * DEG)
    q = inverse_path(known.chain, tool_poses(known.T_base_part, places * MM, rotation), known.tables.posture.branch).q
    R_base_part = known.T_base_part[:3, :3]
    w_base = np.pad(forces @ R_base_part.T, ((0, 0), (0, 3)))
    bent = compliance.deflection(known.chain, q, w_base)[:, :3] @ R_base_part / UM
    sag = gravity.sag(known.chain, q)[:, :3] @ R_base_part / UM
    blocks = (("{}_mm", places), ("f{}_n", forces), ("deflection_{}_um", bent), ("sag_{}_um", sag))
    return pl.DataFrame({name.format(axis): block[:, i] for name, block in blocks for i, axis in enumerate("xyz")})


def choose_posture(
    program: str | Path,
    cell: Cell | str | Path,
    *,
    surface: Surface = "both",
    rotations: int = 72,
    progress: Progress = silent,
) -> posture_job.PostureOf:
    """Choose arm configuration and rotation about the tool axis; see ``counterflex plan posture --help``.

    Args:
        program: Program file.
        cell: Cell, or cell file.
        surface: That must be true: ``wall``, ``floor``, ``both``.
        rotations: About the tool axis that are tried.
        progress: Called with the share done, 0 to 1.

    Returns:
        Its ``summary`` has both postures, ``chosen`` the angles along the path.

    Raises:
        CounterflexError: No posture is possible; says where and why.
    """
    known = cell if isinstance(cell, Cell) else read_cell(cell)
    return posture_job.posture_of(program, known, surface=surface, freedom=Freedom(rotations), progress=progress)


def preflight(program: str | Path, cell: Cell | str | Path, *, progress: Progress = silent) -> pl.DataFrame:
    """Check a program on a cell before it runs: limits, speeds, singularities, reversals, collisions.

    Args:
        program: Program file.
        cell: Cell, or cell file.
        progress: Called with the share done, 0 to 1.

    Returns:
        One row per check, as ``counterflex preflight`` prints it.

    Raises:
        CounterflexError: The program cannot be read, or the cell describes no milling.
    """
    known = cell if isinstance(cell, Cell) else read_cell(cell)
    rows = preflight_job.check(program, known, progress=progress).summary["checks"]
    return pl.DataFrame(rows, infer_schema_length=None, strict=False)


def identify_cell(
    recipe: str,
    data: Sequence[str | Path],
    cell: Cell | str | Path,
    out: str | Path,
    *,
    holdout: Sequence[str | Path] = (),
    settings: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Identify parameters of the cell from measurements; writes the new cell file into a folder.

    Args:
        recipe: ``stiffness``, ``kinematics``, ``cutting`` ...: what ``counterflex identify --help`` names.
        data: Manifests of datasets.
        cell: Cell, or cell file.
        out: Folder for ``cell.toml``, ``result.json`` and ``report.html``.
        holdout: Data that are only predicted.
        settings: Of the recipe.
        progress: Called with the share done, 0 to 1.

    Returns:
        The result, as in ``result.json``.

    Raises:
        CounterflexError: Data that do not fit, or a result that is worse than the cell file.
    """
    file = cell.path if isinstance(cell, Cell) else Path(cell)
    return identify_job.run(recipe, data, file, out, holdout=holdout, settings=settings, progress=progress)


def inspect_part(
    program: str | Path,
    cell: Cell | str | Path,
    scan: str | Path,
    *,
    unit: str | None = None,
    before: str | Path | None = None,
    progress: Progress = silent,
) -> judging.Inspection:
    """Judge the scan of a real part against what its program was to make.

    Args:
        program: The uncompensated program.
        cell: Cell, or cell file: blank and tools.
        scan: Point cloud, mesh or table of touched points.
        unit: ``mm``, ``inch``, ``m``; None: found.
        before: Scan of an earlier part to compare with.
        progress: Called with the share done, 0 to 1.

    Returns:
        Its ``summary`` has figures, registration and features with their uncertainties.

    Raises:
        CounterflexError: A scan that cannot be read, or is of another part.
    """
    file = cell.path if isinstance(cell, Cell) else Path(cell)
    earlier = None if before is None else Path(before)
    how = judging.How(unit=unit)
    return judging.inspect(Path(program), file, Path(scan), how=how, before=earlier, progress=progress)
