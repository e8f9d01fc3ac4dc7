"""Compensate a robot program whose loops need another target in each pass: write it out, then compensate that."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app import conversion
from counterflex.app.compensation import compensate
from counterflex.app.inputs import AS_IT_IS, Reading, machine_of
from counterflex.app.robot_programs import rotation_about_tool
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.progress import Progress, share_of, silent
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import write_folder_summary
from counterflex.programs.language import LANGUAGES
from counterflex.programs.listing import Orientations
from counterflex.programs.program import TOOL_VECTOR, Program
from counterflex.programs.reading import dialect_of
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.rotary.fitted import fitted, turns
from counterflex.programs.rotary.machine import RotaryMachine
from counterflex.programs.rotary.poses import RotaryWords

_NONE: Final = 1e-9


def listed(program: str | Path, reading: Reading, cell_file: str | Path | None = None) -> tuple[Program, Orientations]:
    """Read a program to list its motions.

    Motions to and from places that are not known (G53, G28) are kept and marked.

    Args:
        cell_file: Its tools (by name), frames, work offsets and rotary machine are used.

    Returns:
        The program, and how the tool is held at the end of each motion.
    """
    cell = None if cell_file is None else read_cell(cell_file)
    read = replace(reading, listed=True).program(program, cell)
    return read, orientations(read, cell)


def orientations(program: Program, cell: Cell | None) -> Orientations:
    """Return how the tool is held at the end of each motion."""
    count = len(program.motions)
    if isinstance(program, RobotProgram) and program.Rs_part_tcp is not None and count:
        return Orientations(-program.Rs_part_tcp[:, :, 2], rotation_about_tool(program.Rs_part_tcp))
    axes = np.tile(np.array([0.0, 0.0, 1.0]), (count, 1))
    if turns(program):
        machine = None if cell is None else machine_of(cell)
        axes = _turned(program if machine is None else fitted(program, machine), machine)
    return Orientations(axes, np.full(count, np.nan))


def _turned(program: Program, machine: RotaryMachine | None) -> Float:
    """Tool axes (motions, 3); NaN where rotary words turn the tool and no machine says how."""
    ends = np.array([motion.abc_end for motion in program.motions])
    if machine is not None:
        points = np.array([motion.p_end for motion in program.motions])
        return RotaryWords.of(program, machine).pose(points, ends, np.arange(len(ends)))[1]
    vector = np.array([program.blocks[m.block].modal.tool_centre == TOOL_VECTOR for m in program.motions])
    length = np.linalg.norm(ends, axis=1, keepdims=True)
    axes = np.where(length > _NONE, ends / np.where(length > _NONE, length, 1.0), [0.0, 0.0, 1.0])
    axes[~vector & (length[:, 0] > _NONE)] = np.nan
    return axes


FOLDER: Final = "written-out"
"""Folder of the program with each motion once; lines in results are lines of it."""


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
    **options: Any,
) -> dict[str, Any]:
    """Compensate a program; one that cannot be written back in its loops is written out first.

    Args:
        out: Folder; of a program that was written out it also has that one, in :data:`FOLDER`.
    """
    try:
        return compensate.run(program, cell_file, out, reading=reading, progress=progress, **options)
    except ProgramError as fault:
        if not fault.data.get("each_pass"):
            raise
        place = fault.where
    dialect = dialect_of(program, reading.dialect)
    language = LANGUAGES[dialect].prompt or dialect
    with tempfile.TemporaryDirectory() as folder, atomic.atomic_folder(out) as staging:
        files = conversion.run(program, cell_file, folder, language, reading=reading)["files"]
        again = share_of(progress, 0.5, 1.0)
        place_of_it = Path(out) / FOLDER / files[0]
        summary = compensate.run(
            Path(folder) / files[0], cell_file, staging, shown=place_of_it, progress=again, **options
        )
        (staging / FOLDER).mkdir()
        for name in files:
            atomic.write_bytes(staging / FOLDER / name, file_content.content(Path(folder) / name))
        message = (
            f"{place} runs several times and each pass needs another correction: the program was written out, each "
            f"motion once, as counterflex convert does; lines are those of {FOLDER}/{files[0]}"
        )
        summary["written"]["warnings"] = [message, *summary["written"]["warnings"]]
        write_folder_summary(staging, summary)
    return summary
