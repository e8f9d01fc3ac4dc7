"""The same G-code back with only the targets changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import INCH, MM
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.gcode.write.emit import Emitter
from counterflex.programs.gcode.write.spelling import spelling_of
from counterflex.programs.gcode.write.written_line import without_comments
from counterflex.programs.motion_rows import MotionRows, motion_rows, written_error
from counterflex.programs.program import Program
from counterflex.programs.rotary.poses import CommandedWords


@dataclass(frozen=True)
class GcodeText:
    """A written program and what became of it.

    Attributes:
        text: The program, with the line ends of the source.
        moved_motions: Motions with at least one corrected row.
        split_motions: Motions that were written as several blocks.
        vertices_added: Blocks written in addition to those of the source.
        arcs_kept: Corrected arcs still written as one arc.
        arcs_split: Corrected arcs written as several arcs, or partly as arcs.
        arcs_as_lines: Corrected arcs written as straight moves only.
        radius_replaced: Arcs given by R in the source that needed I, J, K.
        completed_blocks: Uncorrected blocks that had to be edited because they inherited a corrected position or
            another motion word.
        cycles_expanded: Canned-cycle blocks written as single moves.
        unrolled: True when loops, calls and expressions were replaced by what they execute.
        tolerance_m: Allowed distance of the written path from the commanded samples, at the same place of the way.
        resolution_m: Last decimal written.
        largest_written_error_m: Largest distance of the written path from the commanded samples of feed motions
            (rapids count at their ends only); at most ``tolerance_m`` plus one rounding, 0.87 ``resolution_m``.
        largest_dwell_error_m: Largest distance of the commanded from the written position during dwells: a dwell keeps
            the position of the motion before it.
        largest_dropped_rotation_rad: Largest correction of orientation, which G-code without rotary axes cannot say.
    """

    text: str
    moved_motions: int
    split_motions: int
    vertices_added: int
    arcs_kept: int
    arcs_split: int
    arcs_as_lines: int
    radius_replaced: int
    completed_blocks: int
    cycles_expanded: int
    unrolled: bool
    tolerance_m: float
    resolution_m: float
    largest_written_error_m: float
    largest_dwell_error_m: float
    largest_dropped_rotation_rad: float


def write_gcode(
    program: Program,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    decimals: int = 4,
    cell: str = "",
    header: bool = True,
    job: str = "",
    words: CommandedWords | None = None,
) -> GcodeText:
    """Write a program back with its targets replaced by the commanded ones.

    Blocks whose motions are not corrected stay as they are, byte for byte, with one exception: where a block leaves
    out an axis word, a motion word or counts from the current position, and the position or the motion it would
    inherit is no longer that of the source, the missing word is written. Corrected straight moves get their axis
    words edited in place and further blocks where one straight line is not enough; corrected arcs stay arcs where the
    commanded points lie on one within the tolerance, else they become several arcs or straight moves. Rapids are
    corrected at their end points only, dwells keep the position of the motion before them. A program with loops or
    calls is written in the order of execution, its expressions replaced by their values. Nothing at all changes when
    no row is corrected.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded sample and the written path at the same place of the way
            (the same share of the motion's length), before rounding; > 0, m.
        decimals: Decimals of written words in mm programs, 2 to 6; inch programs get one more.
        cell: Name of the cell, for the header comment.
        header: Write a comment that says what made the program; never written when nothing changed.
        job: Hash of the plan, for the header comment: :func:`counterflex.plan.plan.job_hash`.
        words: Of a program that turns the tool, the words to command; ``compensated`` is not asked then.

    Returns:
        Text and counts.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: A corrected block cannot be written (its words do not lead to its target).
    """
    as_positive("tolerance_m", tolerance_m)
    if not 2 <= decimals <= 6:
        raise InputError("decimals is out of range", value=decimals, limit="2 .. 6")
    angles = None
    if words is not None:
        compensated = CompensatedPath(words.path, words.p_command, np.zeros_like(words.p_command))
        angles = (words.angle_rad, words.angle_command_rad)
    rows = motion_rows(program, compensated, tolerance_m, angles)
    units = {block.modal.unit_m for block in program.blocks} or {MM}
    resolution = max(u * 10.0 ** -(decimals + (u == INCH)) for u in units)
    dropped = float(np.max(np.linalg.norm(compensated.rotvec_part_command, axis=1), initial=0.0))
    dropped = dropped if words is None else words.dropped_rad
    if not rows.moved.any() and np.all(rows.share == 1.0):
        return GcodeText(
            text=program.newline.join(program.lines),
            moved_motions=0,
            split_motions=0,
            vertices_added=0,
            arcs_kept=0,
            arcs_split=0,
            arcs_as_lines=0,
            radius_replaced=0,
            completed_blocks=0,
            cycles_expanded=0,
            unrolled=False,
            tolerance_m=tolerance_m,
            resolution_m=resolution,
            largest_written_error_m=0.0,
            largest_dwell_error_m=rows.dwell_error_m,
            largest_dropped_rotation_rad=dropped,
        )
    _refuse_unsaid(program, rows)
    spelling = spelling_of(program.dialect)
    emitter = Emitter(program, rows, tolerance_m, decimals)
    lines = [part for line in emitter.run() for part in _short_enough(line, program)]
    if header:
        place = spelling.first_line(lines)
        lines[place:place] = [spelling.remark(text) for text in header_lines(program, tolerance_m, cell, job)]
    return GcodeText(
        text=program.newline.join(lines),
        moved_motions=int(rows.moved.sum()),
        split_motions=emitter.split_motions,
        vertices_added=emitter.vertices_added,
        arcs_kept=emitter.arcs_kept,
        arcs_split=emitter.arcs_split,
        arcs_as_lines=emitter.arcs_as_lines,
        radius_replaced=emitter.radius_replaced,
        completed_blocks=emitter.completed_blocks,
        cycles_expanded=emitter.cycles_expanded,
        unrolled=not program.straight,
        tolerance_m=tolerance_m,
        resolution_m=resolution,
        largest_written_error_m=max(written_error(rows, emitter.written, emitter.checked), emitter.arc_error_m),
        largest_dwell_error_m=rows.dwell_error_m,
        largest_dropped_rotation_rad=dropped,
    )


def _refuse_unsaid(program: Program, rows: MotionRows) -> None:
    """Refuse corrections that the writer cannot say.

    Mirror images, polar coordinates; of Sinumerik drilling cycles, CIP, loops and subprograms.

    Raises:
        ProgramError: There is one.
    """
    hint = "Post its moves as G0, G1, G2 and G3, or write another language (--as, convert)"
    for block in program.blocks:
        if block.modal.not_written and block.motion_count:
            raise ProgramError(
                f"{block.modal.not_written} is not written back with other targets",
                where=block.where(program.name), value=block.text.strip()[:60], hint=hint,
            )  # fmt: skip
    if program.dialect == "linuxcnc":
        return
    if not program.straight:
        block = next(block for block in program.blocks if not block.single)
        raise ProgramError(
            "a program with loops or subprograms is not written back", where=block.where(program.name),
            value=block.text.strip()[:60], hint=hint,
        )  # fmt: skip
    for block in program.blocks:
        here = range(block.first_motion, block.first_motion + block.motion_count)
        if block.cycle and any(rows.moved[index] for index in here):
            raise ProgramError(
                "a drilling cycle or CIP is corrected, and is not written back", where=block.where(program.name),
                value=block.text.strip()[:60], hint=hint,
            )  # fmt: skip


def _short_enough(line: str, program: Program) -> list[str]:
    """A line that added words made too long for the interpreter, with its comments on lines of their own before it."""
    most = spelling_of(program.dialect).line_characters
    if len(line) <= most or line in program.lines:
        return [line]
    code, comments = without_comments(line)
    if len(code) > most:
        raise ProgramError(
            "a corrected block is longer than the interpreter takes",
            where=program.name,
            value=f"{len(code)} characters",
            limit=f"<= {most}",
            hint="Shorten the expressions of the block",
        )
    return [*comments, code]


def header_lines(program: Program, tolerance_m: float, cell: str, job: str) -> list[str]:
    """Text of the comments that say what made a program: see :func:`write_gcode`."""

    def plain(text: str) -> str:
        printable = "".join(c for c in text if 32 <= ord(c) < 127 and c not in "()%;")
        return printable[:120]

    lines = [
        f"made by counterflex {__version__} from {plain(program.name)}",
        f"compensated targets, path tolerance {tolerance_m / MM:.4f} mm{', cell ' + plain(cell) if cell else ''}",
    ]
    if job:
        lines.append(mark(job))
    if not program.straight:
        lines.append("loops, calls and expressions written out in the order of execution")
    return lines
