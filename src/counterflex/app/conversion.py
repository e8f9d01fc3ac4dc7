"""Convert: a program in another language, the same path, speeds and process words, checked by reading it back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.compensation.languages import held_axes
from counterflex.app.compensation.robot_program import (
    omissions,
    refuse_change_in_cut,
    refuse_other_height,
    refuse_unmapped,
    routine_name,
)
from counterflex.app.inputs import AS_IT_IS, Reading, machine_of
from counterflex.app.robot_axes import remarks
from counterflex.app.robot_programs import robot_cell
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import rotation
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.convert.check import refuse_other_path
from counterflex.programs.convert.emitter import Conversion, ProgramEmitter, Written
from counterflex.programs.convert.rotary import with_tool_vectors
from counterflex.programs.convert.steps import steps
from counterflex.programs.language import LANGUAGES, dialect_at, is_robot, object_at
from counterflex.programs.program import TOOL_VECTOR, Program
from counterflex.programs.reading import read_program_file
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.robot_writer.writer import RobotSettings
from counterflex.programs.rotary.fitted import turns
from counterflex.programs.stated.two_readings import doubtful_readings, other_postures

_FASTEST_TURN_DEG_S: Final = 400.0  # Usual $VEL_MA.ORI1 of KUKA; RAPID's predefined speeds have 500


def run(
    program_file: str | Path,
    cell_file: str | Path,
    out: str | Path,
    language: str,
    *,
    reading: Reading = AS_IT_IS,
    tolerance_m: float = 1.0 * UM,
    points_per_file: int | None = None,
) -> dict[str, Any]:
    """Write a program in another language into ``out``: whole, or not at all.

    Args:
        cell_file: The cell that frames, process words and the free rotation about the tool are taken from.
        tolerance_m: Largest distance of straight pieces from a helix, for languages without one.
        points_per_file: Most motions of a file of a robot language; None takes the limit of the language.

    Returns:
        What was written: files, counts, largest distance of points that were read back, warnings.

    Raises:
        ProgramError: The program cannot be read exactly, or the language cannot say a part of it; names line and word.
        InputError: It is in that language already, and no motion of it is made several times.
        OutputError: What was written is not read back as the same program.
    """
    cell = read_cell(cell_file)
    program = reading.program(program_file, cell)
    dialect = dialect_at(language, "convert")
    loops = isinstance(program, RobotProgram) and not program.straight
    if dialect == program.dialect and not loops:  # one with loops and routines is written out, each motion once
        raise InputError(
            "the program is in that language already", where=Path(program.name).name, value=language,
            hint="Copy it, or name another language with --to",
        )  # fmt: skip
    to_robot = is_robot(dialect)
    if (isinstance(program, RobotProgram) and program.external) or any(a.moves for a in cell.tables.external_axes):
        raise InputError(
            "external axes move between the operations of the program, and convert writes one place",
            where=Path(program.name).name, limit="axes that stand",
            hint="compensate --as krl, rapid or fanuc writes a G-code program with the places of the cell file",
        )  # fmt: skip
    refuse_unmapped(program, cell)
    warnings = [*doubtful_readings(program), *omissions(program)]
    if to_robot and not isinstance(program, RobotProgram):
        refuse_change_in_cut(program, cell)
        refuse_other_height(program)
    if to_robot:
        warnings += [*remarks(cell, dialect), *other_postures(program, cell.tables.posture.branch)]
    program = _without_rotary_words(program, cell, tolerance_m)
    sequence = list(steps(program, orientations(program, cell), to_robot=to_robot))
    order = Conversion(program, Path(program.name).stem, tolerance_m, cell, points_per_file)
    emitter: ProgramEmitter = object_at(LANGUAGES[dialect].convert)(order)
    written = emitter.write(sequence)
    with atomic.atomic_folder(out) as staging:
        for name, text in written.files.items():
            atomic.write_bytes(staging / name, text.encode("ascii", errors="replace"))
        back = _read_back(written, dialect, cell, staging)
        again = list(steps(back, orientations(back, cell), to_robot=False, comments=False))
        worst = refuse_other_path(
            sequence, written.pieces, again, tolerance_m=tolerance_m,
            whole_frame=to_robot,
        )  # fmt: skip
    return _summary(program, cell, language, written, worst, [*warnings, *_free_rotation(program, language)])


def _without_rotary_words(program: Program, cell: Cell, tolerance_m: float) -> Program:
    """Tool vectors in place of the rotary words of the machine that the cell file describes."""
    machine = machine_of(cell)
    vectors = all(program.blocks[motion.block].modal.tool_centre == TOOL_VECTOR for motion in program.motions)
    if machine is None or vectors or isinstance(program, RobotProgram) or not turns(program):
        return program
    return with_tool_vectors(program, machine, tolerance_m=tolerance_m, rapid_m_s=cell.tables.controller.rapid_m_s)


def orientations(program: Program, cell: Cell) -> Callable[[int], Float]:
    """Orientation (3, 3) of the TCP frame at the end of each motion, in the part.

    Programs for machines leave the rotation about the tool free: it is that of the cell's posture.
    """
    if isinstance(program, RobotProgram) and program.Rs_part_tcp is not None:
        Rs = program.Rs_part_tcp
        return lambda index: np.asarray(Rs[index])
    motions, n = program.motions, len(program.motions)
    axes = np.tile(np.array([0.0, 0.0, 1.0]), (n, 1))
    for index, motion in enumerate(motions):
        if program.blocks[motion.block].modal.tool_centre == TOOL_VECTOR and any(motion.abc_end):
            axes[index] = np.array(motion.abc_end) / np.linalg.norm(motion.abc_end)
    points = np.array([motion.p_end for motion in motions]).reshape(n, 3)
    made = tool_orientation(axes, cell.tables.posture.rotations_rad(points))
    return lambda index: np.asarray(made[index])


def _read_back(written: Written, dialect: str, cell: Cell, staging: Path) -> Program:
    """Read what was written by the reader of its language, parts with the program that calls them."""
    robot = robot_cell(cell, dialect) if is_robot(dialect) else None
    return read_program_file(staging / next(iter(written.files)), dialect=dialect, cell=robot)


def emitter_settings(order: Conversion) -> dict[str, Any]:
    """Return what every :class:`~counterflex.programs.robot_writer.writer.RobotSettings` of a conversion needs."""
    controller = order.cell.tables.controller
    return {
        "name": routine_name(order.stem), "start_axes_rad": [0.0] * 6, "rapid_m_s": controller.rapid_m_s,
        "cycle_s": controller.cycle_s, "external_axes": held_axes(order.cell),
        "orientation_deg_s": _turning_deg_s(order.program, order.cell),
        **({} if order.points_per_file is None else {"points_per_file": order.points_per_file}),
    }  # fmt: skip


def _turning_deg_s(program: Program, cell: Cell) -> float:
    """Speed of turning that no feed of the program waits for, at most :data:`_FASTEST_TURN_DEG_S`."""
    R = orientations(program, cell)
    needed = [
        float(np.linalg.norm(rotation.log(R(index - 1).T @ R(index)))) * motion.feed_m_s / motion.length_m / DEG
        for index, motion in enumerate(program.motions)
        if index > 0 and motion.feed_m_s > 0.0 and motion.length_m > 0.0
    ]
    least = RobotSettings.orientation_deg_s
    return float(min(max(least, np.ceil(1.01 * max(needed, default=0.0))), _FASTEST_TURN_DEG_S))


def _free_rotation(program: Program, language: str) -> list[str]:
    if not isinstance(program, RobotProgram) or is_robot(dialect_at(language, "convert")):
        return []
    return [
        "the rotation about the tool axis has no word there: posture.rotation_about_tool_deg of the cell file has it"
    ]


def _summary(
    program: Program, cell: Cell, language: str, written: Written, worst_m: float, warnings: list[str]
) -> dict[str, Any]:
    moves = sum(max(1, len(shares)) for shares in written.pieces.values())
    return {
        "program": Path(program.name).name, "cell": cell.label, "from": program.dialect, "to": language,
        "files": list(written.files), "motions_in": len(program.motions), "motions_out": moves,
        "read_back_um": round(worst_m / UM, 4), "warnings": [*warnings, *written.warnings],
    }  # fmt: skip
