"""Size of a program for the controller that runs it: as it stands, or in a robot's language."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.compensation.robot_program import routine_name
from counterflex.app.inputs import Job
from counterflex.app.robot_axes import other_maker
from counterflex.core.errors import InputError
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.plan.preflight.size import ProgramSize
from counterflex.programs.language import LANGUAGES, is_robot, robot_dialects
from counterflex.programs.limits import Limits
from counterflex.programs.program import Block
from counterflex.programs.robot_writer.points import choose_points, event_motions
from counterflex.programs.robot_writer.writer import robot_parts
from counterflex.robot.model.controller_axes import MAKERS

TOLERANCE_M: Final = 5.0 * UM
"""Of the points, as ``compensate`` has it."""
_TOLERANCE_RAD: Final = 1e-4


class _Counted:
    """A language without words: parts are counted, not written."""

    def block(self, _block: Block) -> list[str]:
        """Nothing."""
        return []

    def dwell(self, _time_s: float) -> str:
        """An empty line."""
        return ""

    def point(self, _index: int) -> list[str]:
        """Nothing."""
        return []

    def enter(self, _tool: int, _place: int) -> list[str]:
        """Nothing."""
        return []


def language_of(job: Job, cell: Cell) -> str:
    """Language that the robot gets the program in: its own, else that of the maker of the cell's robot.

    A robot whose maker is not stated has the language of the one table in ``[controller.spindle]``, if there is one.

    Returns:
        A dialect; ``linuxcnc`` and the like where the robot's language is not known: the program as it stands.
    """
    if is_robot(job.program.dialect):
        return job.program.dialect
    robot, maker = cell.tables.robot, cell.nominal_robot.axes.maker
    stated = robot.controller_axes is not None and robot.controller_axes.maker is not None
    if maker is not None and (stated or robot.catalog is not None):
        return MAKERS[maker].language
    tables = cell.tables.controller.spindle.model_fields_set & set(robot_dialects())
    return tables.pop() if len(tables) == 1 else job.program.dialect


def program_size(job: Job, cell: Cell, language: str | None = None) -> ProgramSize:
    """Motions, files, names and lines of a program.

    A milling program counts as ``compensate --as`` would write it, without corrections, which add points where they
    change; a program of a robot counts as it stands.

    Args:
        language: Of the robot, one of :func:`~counterflex.programs.language.robot_dialects`; None: :func:`language_of`.

    Raises:
        InputError: The program is in the language of another robot.
    """
    own = job.program.dialect
    if language is not None and is_robot(own) and own != language:
        raise InputError(
            "the program is in the language of another robot", where=Path(job.program.name).name, value=own,
            limit=language, hint="Convert it first: counterflex convert, and check what comes out",
        )  # fmt: skip
    language = language or language_of(job, cell)
    limits = LANGUAGES[language].limits
    stem = Path(job.program.name).stem
    if language != job.program.dialect:
        points, parts = _written(job, cell, limits)
        name = routine_name(stem)
        names = (name, *(f"{name}_{number:03d}" for number in range(1, parts + 1))) if parts > 1 else (name,)
        return ProgramSize(
            LANGUAGES[language].short,
            limits.source,
            points,
            limits.points_per_file,
            names,
            limits.name_characters,
            written=True,
            foreign=other_maker(cell, language),
        )
    lengths = [len(line) for line in job.program.lines]
    longest = int(np.argmax(lengths)) if lengths else 0
    return ProgramSize(
        LANGUAGES[language].short, limits.source,
        sum(motion.kind != "dwell" for motion in job.program.motions), limits.points_per_file,
        (stem,), limits.name_characters, written=False, line=max(lengths, default=0),
        line_limit=limits.line_characters, line_number=longest + 1, line_point=_row_of_line(job, longest + 1),
        foreign=other_maker(cell, language),
    )  # fmt: skip


def _row_of_line(job: Job, line: int) -> int | None:
    """Row of the machined path at the first motion of a line; None where it makes none."""
    motions = np.flatnonzero(job.line_of_motion == line)
    if len(motions) == 0:
        return None
    row = int(np.searchsorted(job.machined.motion, motions[0]))
    return row if row < len(job.machined) else None


def _written(job: Job, cell: Cell, limits: Limits) -> tuple[int, int]:
    """Points and parts of a program in a robot's language."""
    path = job.path if job.turned is None else job.turned.path
    Rs_part_tcp = tool_orientation(path.axis_part, cell.tables.posture.rotations_rad(path.p_part_tcp))
    controller = cell.tables.controller
    points = choose_points(
        job.program,
        path,
        pose.make(Rs_part_tcp, path.p_part_tcp),
        tolerance_m=TOLERANCE_M,
        tolerance_rad=_TOLERANCE_RAD,
        cycle_s=controller.cycle_s,
        rapid_m_s=controller.rapid_m_s,
        events=event_motions(job.program, _nothing),
    )
    return len(points.row), len(robot_parts(job.program, points, _Counted(), limits.points_per_file).parts)


def _nothing(_: Block) -> Sequence[str]:
    return ()
