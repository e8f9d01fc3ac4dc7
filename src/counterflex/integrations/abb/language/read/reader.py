"""Read ABB RAPID programs strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.frames import RapidCell
from counterflex.integrations.abb.language.read.interpreter import Interpreter, replaced
from counterflex.integrations.abb.language.read.job_files import joined, modules_of
from counterflex.integrations.abb.language.read.memory import LAST_RUN
from counterflex.integrations.abb.language.read.routines import Modules
from counterflex.integrations.abb.language.read.scanner import FilePart, Source
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.program import same_motions
from counterflex.programs.source_text import refuse_mark


def read_rapid(
    text: str,
    *,
    name: str = "program.mod",
    cell: RapidCell | None = None,
    complete: bool = True,
    parts: Sequence[FilePart] = (),
) -> RapidProgram:
    """Execute the text of modules and return the statements passed and the motions made.

    Positions are of the tool tip in the work object, which is the part frame; the tool axis and the rotation about it
    are those of the quaternion. A program that keeps the tool along z of the part has motions without rotary angles;
    another one has the components of the tool axis there, see :data:`~counterflex.programs.program.TOOL_VECTOR`. The
    first target is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        text: The modules, one after the other; that of the program first.
        name: File of the program, for errors.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        complete: Refuse a text without ENDMODULE: it may have been cut off.
        parts: Place of each file in the text; none: it is one file.

    Returns:
        The program as executed: ``PROC main``, or the only routine that no other calls.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    source = Source(text, name, parts)
    modules = Modules(source, complete=complete)
    interpreter = _executed(source, modules, cell)
    starts = [move.start for move in interpreter.moves]
    main = text[: source.parts[0].end]
    return RapidProgram(
        **interpreter.fields(name, main),
        dialect="rapid",
        straight=len(set(starts)) == len(starts),
        external=interpreter.targets.external.changes(interpreter.motions),
        text=text,
        files=tuple((part.name, part.start, part.end) for part in source.parts),
        moves=tuple(interpreter.moves),
        calls=tuple(replaced(interpreter.calls)),
        declarations=modules.modules[0].declarations,
        names=frozenset(name for module in modules.modules for name in (*module.data, *module.routines)),
    )


def _executed(source: Source, modules: Modules, cell: RapidCell | None) -> Interpreter:
    """Return the program as executed."""
    # Persistent data that it changes begins with what the last run left. If that matters, the program is executed from
    # the declared values, and again from what this run leaves: it is known if both runs do the same and leave the same.
    try:
        return _run(source, modules, cell, None)
    except ProgramError as fault:
        if LAST_RUN not in str(fault):
            raise
        try:
            first = _run(source, modules, cell, {})
            left = first.memory.kept()
            again = _run(source, modules, cell, left)
        except ProgramError:
            raise fault from None
        if (
            not left
            or again.memory.kept() != left
            or not same_motions(first.motions, again.motions, first.rotations, again.rotations)
        ):
            raise
        return first


def _run(
    source: Source, modules: Modules, cell: RapidCell | None, kept_from: Mapping[int, object] | None
) -> Interpreter:
    def executed(part_object: str) -> Interpreter:
        interpreter = Interpreter(source, modules, cell, lines, part_object)
        interpreter.memory.kept_from = kept_from
        interpreter.run()
        return interpreter

    lines = split_lines(source.text)
    first = executed("")
    objects = first.frames.objects
    if len(objects) < 2:
        return first
    try:  # without a cell: most motions are in the part frame
        return executed(max(objects, key=lambda key: objects[key]))
    except ProgramError:  # that frame begins unknown, because the program itself changes it
        return first


def read_rapid_file(
    path: str | os.PathLike[str], *, cell: RapidCell | None = None, complete: bool = True
) -> RapidProgram:
    """Read a program: a module with those of its folder that it uses, or the modules of a ``.pgf``.

    Args:
        path: The file, UTF-8 or Latin-1.
        cell: See :func:`read_rapid`.
        complete: Refuse a file without ENDMODULE.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    files = modules_of(Path(path))
    text, encoding, parts = joined(files)
    refuse_mark(encoding, files[0], "not every controller reads")
    program = read_rapid(text, name=files[0].name, cell=cell, complete=complete, parts=parts)
    return replace(program, encoding=encoding)
