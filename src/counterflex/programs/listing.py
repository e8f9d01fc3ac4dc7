"""List of a program as it was read: one row for each motion, in shop units."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from counterflex.core.arrays import Float
from counterflex.core.atomic import write_text
from counterflex.core.units import DEG, MM, MM_PER_MIN, RPM
from counterflex.programs.program import TOOL_VECTOR, Block, Modal, Motion, Program

# A nanometre and a microdegree: below the digits of any program, above the noise of binary fractions.
_DIGITS: Final = 6
# Cosine above which a normal is that of G17, G18 or G19: 0.03 deg, above the rounding of taught points.
_IN_PLANE: Final = 1.0 - 1e-7
SCHEMA: Final[dict[str, type[pl.DataType]]] = {
    "line": pl.Int64,
    "motion": pl.String,
    "x_mm": pl.Float64,
    "y_mm": pl.Float64,
    "z_mm": pl.Float64,
    "a_deg": pl.Float64,
    "b_deg": pl.Float64,
    "c_deg": pl.Float64,
    "feed_mm_min": pl.Float64,
    "plane": pl.String,
    "centre_x_mm": pl.Float64,
    "centre_y_mm": pl.Float64,
    "centre_z_mm": pl.Float64,
    "turns": pl.Float64,
    "dwell_s": pl.Float64,
    "tool": pl.Int64,
    "spindle_rpm": pl.Float64,
    "tool_i": pl.Float64,
    "tool_j": pl.Float64,
    "tool_k": pl.Float64,
    "tool_turn_deg": pl.Float64,
}


def _shown(value: float) -> float:
    """Round to the digits shown, without a negative zero."""
    return round(value, _DIGITS) + 0.0


@dataclass(frozen=True)
class Orientations:
    """Orientation of the tool at the end of each motion."""

    axis_part: Float  # (motions, 3) from the tip to the spindle, in the part frame; NaN where it is not known
    turn_rad: Float  # (motions,) rotation about the tool axis; NaN where the program leaves it free


def listing(program: Program, held: Orientations | None = None) -> pl.DataFrame:
    """Return the motions of a program as a table.

    Columns: ``file``, where the program has several; ``line`` in it; ``motion`` rapid, feed, arc or dwell; end point
    ``x_mm y_mm z_mm`` of the tool tip in the part frame (as programmed where the tool turns; empty where it is not
    known); ``a_deg b_deg c_deg`` of the rotary axes (empty under G43.5, which has none); ``feed_mm_min`` along the path
    (empty for rapids, dwells and moves of rotary axes alone); of arcs ``plane`` (G17, G18, G19), the centre at the
    start's height and ``turns`` = angle / 360 deg, positive for G3; ``dwell_s``; ``tool``; ``spindle_rpm``, positive
    for M3; tool axis ``tool_i tool_j tool_k`` from the tip to the spindle in the part frame; and ``tool_turn_deg``, the
    rotation about it, where the program states it.

    Args:
        held: Orientation of the tool; without it the axis is z.

    Returns:
        One row for each motion, in order of execution; empty cells are null.
    """
    name = Path(program.name).name
    files = [program.blocks[motion.block].file or name for motion in program.motions]
    columns: dict[str, list[object]] = {column: [] for column in SCHEMA}
    for index, motion in enumerate(program.motions):
        row = (*_cells(program.blocks[motion.block], motion), *_held(held, index))
        for column, value in zip(columns.values(), row, strict=True):
            column.append(value)
    table = pl.DataFrame(columns, schema=SCHEMA)
    several = any(file != name for file in files)
    return table.insert_column(0, pl.Series("file", files, dtype=pl.String)) if several else table


def _cells(block: Block, motion: Motion) -> tuple[object, ...]:
    """Cells of a motion up to the spindle."""
    vector = block.modal.tool_centre == TOOL_VECTOR
    arc: list[object] = [None] * 5
    if motion.p_centre is not None:
        centre = [_shown(value / MM) for value in motion.p_centre]
        plane, sense = _plane(block.modal, motion)
        arc = [plane, *centre, _shown(sense * motion.turn_rad / (2.0 * math.pi))]
    return (
        block.line,
        motion.kind,
        *(None if c in motion.unknown else _shown(v / MM) for c, v in zip("XYZ", motion.p_end, strict=True)),
        *(None if vector else _shown(angle / DEG) for angle in motion.abc_end),
        _shown(motion.feed_m_s / MM_PER_MIN) if motion.feed_m_s > 0.0 else None,
        *arc,
        motion.duration_s if motion.kind == "dwell" else None,
        motion.tool,
        _shown(motion.spindle_rad_s / RPM),
    )


def _plane(modal: Modal, motion: Motion) -> tuple[str, float]:
    """Plane of an arc in programmed axes, and the sign that makes its turn positive for G3; else its unit normal.

    Robots give three points of a circle, so its normal has either sign and any direction.
    """
    normal = np.array([0.0, 0.0, 1.0]) if motion.normal is None else np.asarray(motion.normal)
    work = normal if modal.R_part_work is None else normal @ np.array(modal.R_part_work)
    axis = int(np.argmax(np.abs(work)))
    if abs(work[axis]) > _IN_PLANE:
        return ("G19", "G18", "G17")[axis], math.copysign(1.0, work[axis])
    return " ".join(f"{_shown(float(value)):g}" for value in normal), 1.0


def _held(held: Orientations | None, index: int) -> tuple[float | None, ...]:
    """Cells of the orientation of the tool."""
    if held is None:
        return (0.0, 0.0, 1.0, None)
    cells = (*held.axis_part[index], held.turn_rad[index] / DEG)
    return tuple(None if math.isnan(value) else _shown(float(value)) for value in cells)


def write_listing(program: Program, target: str | os.PathLike[str], held: Orientations | None = None) -> int:
    """Write the table as comma-separated values, whole or not at all.

    Raises:
        OutputError: The file cannot be written.
    """
    table = listing(program, held)
    write_text(target, table.write_csv())
    return table.height
