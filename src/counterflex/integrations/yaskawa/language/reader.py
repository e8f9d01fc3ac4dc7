"""Read INFORM jobs strictly: what cannot be known exactly is refused with its line, its column and what to do."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import cast

from counterflex.integrations.yaskawa.language.frames import InformCell
from counterflex.integrations.yaskawa.language.interpreter import InformInterpreter
from counterflex.integrations.yaskawa.language.program import DIALECT, InformProgram
from counterflex.integrations.yaskawa.language.source import InformFolder, InformJob, jobs_beside
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.source_text import common_encoding, read_text, refuse_mark

_CM_PER_MIN_MM_S = 10.0 / 60.0


def read_inform(
    text: str,
    *,
    name: str = "program.jbi",
    cell: RobotTextCell | None = None,
    complete: bool = True,
    folder: InformFolder | None = None,
) -> InformProgram:
    """Execute a job and return the instructions passed and the motions made.

    Positions are of the tool tip in the user frame, which is the part frame, or in the frame of the robot. The first
    position is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        cell: What frames and process words are checked against; None takes the first frame for the part frame and
            knows no process words.
        complete: Refuse a text without END: it may have been cut off.
        folder: Jobs that it can call; None has none.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    job, folder = InformJob(text, name, complete=complete), folder or InformFolder()
    interpreter = InformInterpreter(job, folder, cast("InformCell | None", cell))
    interpreter.run()
    return InformProgram(
        **interpreter.fields(name, text),
        dialect=DIALECT,
        straight=not folder.jobs and max(interpreter.runs.values(), default=1) == 1,
        jobs={name: job.about(), **{key: one.about() for key, one in folder.jobs.items()}},
        moves=tuple(interpreter.moves),
        doubts=_doubts(interpreter),
    )


def _doubts(interpreter: InformInterpreter) -> tuple[str, ...]:
    """Speeds without decimals: controllers show mm/s with one, cm/min with none; and variables that others may set."""
    out = []
    if interpreter.whole_speeds:
        speed, line, more = _first(interpreter.whole_speeds)
        out.append(
            f"V={speed} in line {line}{more} has no decimal and is read as {speed} mm/s; a controller set to cm/min "
            f"writes speeds so and goes {float(speed) * _CM_PER_MIN_MM_S:.4g} mm/s"
        )
    if interpreter.loaded_targets:
        name, line, more = _first(interpreter.loaded_targets)
        out.append(f"{name} in line {line}{more} is read as //POS has it; another job of the controller may set it")
    return tuple(out)


def _first(lines_of: dict[str, list[int]]) -> tuple[str, int, str]:
    """The first one with its line, and how many more there are."""
    name, lines = next(iter(lines_of.items()))
    count = sum(len(one) for one in lines_of.values())
    return name, lines[0], f" and {count - 1} more" if count > 1 else ""


def read_inform_file(
    path: str | os.PathLike[str], *, cell: RobotTextCell | None = None, complete: bool = True
) -> InformProgram:
    """Read a job, with those of its folder that it calls.

    Args:
        path: The file, UTF-8 or Latin-1.
        cell: See :func:`read_inform`.
        complete: Refuse a file without END.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no job that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    folder = InformFolder(jobs_beside(file), complete=complete)
    refuse_mark(encoding, file)
    program = read_inform(text, name=file.name, cell=cell, complete=complete, folder=folder)
    texts = {file.name: (text, encoding)} | {name: (job.text, job.encoding) for name, job in folder.jobs.items()}
    return replace(program, encoding=common_encoding(texts))
