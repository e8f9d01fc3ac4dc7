"""The same G-code back with only the targets changed."""

from __future__ import annotations

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.write.emit import Emitter
from counterflex.programs.gcode.write.written_line import without_comments
from counterflex.programs.motion_rows import MotionRows
from counterflex.programs.program import Program


class GcodeInPlace(Emitter):
    """G-code of each dialect.

    Where a block leaves out an axis word, a motion word or counts from the current position, and the position or the
    motion it would inherit is no longer that of the source, the missing word is written. A program with loops or calls
    is written in the order of execution, its expressions replaced by their values.
    """

    def run(self) -> list[str]:
        """All lines of the written program, none too long for its interpreter."""
        _refuse_unsaid(self.program, self.rows)
        most = self.spelling.line_characters
        return [part for line in super().run() for part in _short_enough(line, self.program, most)]

    def put_head(self, lines: list[str], texts: list[str]) -> None:
        """Behind what must stand first."""
        place = self.spelling.first_line(lines)
        lines[place:place] = [self.spelling.remark(text) for text in texts]


write_gcode = GcodeInPlace.write


def _refuse_unsaid(program: Program, rows: MotionRows) -> None:
    """Refuse corrections that the writer cannot say."""
    # Mirror images, polar coordinates; of Sinumerik drilling cycles, CIP, loops and subprograms.
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
        if block.cycle and any(rows.moved[index] for index in block.motions):
            raise ProgramError(
                "a drilling cycle or CIP is corrected, and is not written back", where=block.where(program.name),
                value=block.text.strip()[:60], hint=hint,
            )  # fmt: skip


def _short_enough(line: str, program: Program, most: int) -> list[str]:
    """A line that added words made too long for the interpreter, with its comments on lines of their own before it."""
    if len(line) <= most or line in program.lines:
        return [line]
    code, comments = without_comments(line)
    if len(code) > most:
        raise ProgramError(
            "a corrected block is longer than the interpreter takes", where=program.name,
            value=f"{len(code)} characters", limit=f"<= {most}", hint="Shorten the expressions of the block",
        )  # fmt: skip
    return [*comments, code]
