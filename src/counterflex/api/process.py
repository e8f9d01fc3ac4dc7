"""The process: what the cutter meets along a program, and the force that a cut takes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from counterflex.api.cell import Cell, model_of
from counterflex.api.program import Program, program_file, reading_of
from counterflex.app.inputs import read_in_plane
from counterflex.core.arrays import as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting.engagement import figures
from counterflex.cutting.force import engagement_of_arc, mean_force
from counterflex.cutting.removal import remove_tool_path
from counterflex.cutting.tooth_force import tooth_forces

if TYPE_CHECKING:
    import polars as pl


def engagement(program: Program | str | Path, cell: Cell | str | Path, *, every_mm: float = 1.0) -> pl.DataFrame:
    """Return what the cutter meets along a program, by removing the material step by step.

    Args:
        program: Program, or program file, with one tool along one direction.
        cell: Cell, or cell file: blank and tool.
        every_mm: Length of path that each row is the mean of.

    Returns:
        One row for each piece of path: ``line``, ``x_mm`` ... of its end, ``entry_deg`` and ``exit_deg`` (immersion
        angle, 0 along the feed's left side), ``width_mm`` radial, ``area_mm2`` of the chip, ``volume_mm3``.

    Raises:
        CounterflexError: The program cannot be read, or uses several tools.
    """
    import polars as pl

    from counterflex.app.proof.simulate import tool_of

    reading = reading_of(program)
    known, job = read_in_plane(program_file(program), model_of(cell), reading=reading)
    cutter = known.cutter(tool_of(job.path))
    stock = known.stock()
    removed = remove_tool_path(stock, job.path, cutter)
    assert removed.engagement is not None  # it is booked unless it is refused
    step = np.linalg.norm(np.diff(job.path.p_part_tcp, axis=0), axis=1)
    seen = figures(
        removed.engagement, step, cutter, least_m=as_positive("every_mm", every_mm) * MM, cell_m=stock.cell_m
    )
    place = job.path.p_part_tcp[seen.last] / MM
    return pl.DataFrame(
        {
            "line": job.line_of_motion[job.path.motion[seen.last]],
            **{f"{axis}_mm": place[:, k] for k, axis in enumerate("xyz")},
            "entry_deg": seen.entry_rad / DEG,
            "exit_deg": seen.exit_rad / DEG,
            "width_mm": seen.radial_width_m / MM,
            "area_mm2": seen.chip_area_m2 / MM**2,
            "volume_mm3": seen.volume_m3 / MM**3,
        }
    )


def forces(
    cell: Cell | str | Path,
    tool: int = 1,
    *,
    depth_mm: Any,
    feed_per_tooth_um: Any,
    arc_deg: tuple[float, float] = (0.0, 180.0),
    revolution: bool = False,
    helix_deg: float | None = None,
    runout_um: float | None = None,
    trochoid: bool = True,
) -> pl.DataFrame:
    """Return the force on the tool in a cut with one arc of engagement.

    The mean is a closed form of the force law; a revolution is summed over edges and slices of the cutter.

    Args:
        cell: Cell, or cell file: material and tools.
        tool: Number of the tool.
        depth_mm: Axial depth of cut; one or (n,), of a revolution one.
        arc_deg: Immersion angles where an edge enters and leaves; 0 to 180 is a full slot.
        revolution: Force of single teeth over one revolution instead of the mean.
        helix_deg: Of another tool of that size; None is that of the cell file.
        runout_um: Likewise.
        trochoid: In a revolution edges follow their true path; otherwise circles.

    Returns:
        Rows ``along_n`` (the feed), ``left_n``, ``up_n`` (along the tool) and their size ``force_n``; before them
        ``depth_mm`` and ``feed_per_tooth_um`` of a mean, ``angle_deg`` of the spindle in a revolution.

    Raises:
        InputError: Values out of range, or outside of the chip thickness that the law holds for.
    """
    import polars as pl

    known = model_of(cell)
    cutter = known.cutter(tool)
    cutter = cutter if helix_deg is None else replace(cutter, helix_rad=helix_deg * DEG)
    cutter = cutter if runout_um is None else replace(cutter, runout_m=runout_um * UM)
    entry, leave = (angle * DEG for angle in arc_deg)
    depth, feed = np.broadcast_arrays(*(np.atleast_1d(as_float(name, value)) for name, value in (
        ("depth_mm", depth_mm), ("feed_per_tooth_um", feed_per_tooth_um)
    )))  # fmt: skip
    if np.any(depth * MM > cutter.flute_length_m * (1.0 + 1e-9)):  # above the flutes the shank rubs, which no law has
        raise InputError(
            "the cut is deeper than the flutes of the tool are long",
            where="depth_mm",
            value=float(depth.max()),
            limit=f"at most {cutter.flute_length_m / MM:g} (tools.flute_length_mm)",
        )
    arcs = np.stack([engagement_of_arc(cutter, float(value) * MM, entry, leave) for value in depth])
    columns: dict[str, Any]
    if revolution:
        if len(depth) != 1:
            raise InputError(
                "a revolution is of one cut", where="depth_mm, feed_per_tooth_um", value=len(depth), limit=1
            )
        teeth = tooth_forces(cutter, known.force_law, arcs[0], float(feed[0]) * UM, trochoid=trochoid)
        columns, force = {"angle_deg": teeth.angle_rad / DEG}, teeth.wrench_tcp[:, :3]
    else:
        columns = {"depth_mm": depth, "feed_per_tooth_um": feed}
        force = mean_force(cutter, known.force_law, arcs, feed * UM).wrench_tcp[:, :3]
    columns |= {f"{name}_n": force[:, k] for k, name in enumerate(("along", "left", "up"))}
    return pl.DataFrame(columns | {"force_n": np.linalg.norm(force, axis=1)})
