"""Write a plan in a program language: ``compensate --as``, and what the writers of robots' languages share."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from counterflex.app.compensation.robot_program import omissions, other_lengths, routine_name
from counterflex.app.external_moves import written_places
from counterflex.app.inputs import Job
from counterflex.app.robot_axes import axes_in, axes_of_posture, other_maker
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError, OutputError
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.path.turning import TurnedPath
from counterflex.plan.feed_schedule import at_feed, share_between
from counterflex.plan.plan import Plan, job_hash
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.language import GCODE, LANGUAGES, dialect_at, object_at
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.writer import RobotWriter, require_language
from counterflex.programs.rotary.poses import CommandedWords

RESULTS: Final = ("plan.parquet", "summary.json", "report.html")
"""What stands beside the program files."""
TOLERANCE_M: Final = (0.1 * UM, 1000.0 * UM)
"""Smallest and largest tolerance of the written path."""
Written = tuple[dict[str, str], dict[str, Any]]
"""Program files by name, and what the writer says about them: SI, the unit as suffix; ``warnings`` a list of texts."""


@dataclass(frozen=True, eq=False)
class WritingOrder:
    """Order to write a program."""

    job: Job  # The program as read, its path and its samples
    plan: Plan  # With the correction of every point
    cell: Cell
    tolerance_m: float  # Largest distance between the written path and the planned one
    # (3, 3) axes that the plan is given in, where the tool is tilted; job and cell are in part axes
    R_part_plane: Float | None = None

    @property
    def Ts_part_tcp(self) -> Float:
        """(n, 4, 4) poses of the tool in the part frame that are to be commanded, a row for each point of the path."""
        correction, rotvec = self.corrections
        commanded = CompensatedPath.from_correction(self.job.path, correction, rotvec)
        turned = self.cell.tables.posture.rotations_rad(self.job.path.p_part_tcp)
        return commanded.poses(tool_orientation(self.job.path.axis_part, turned))

    @property
    def corrections(self) -> tuple[Float, Float]:
        """(n, 3) m and (n, 3) rad that are added to position and orientation, in part axes."""
        correction, rotvec = self.plan.correction_part, self.plan.rotvec_part
        R = self.R_part_plane
        return (correction, rotvec) if R is None else (correction @ R.T, rotvec @ R.T)


def written(name: str, order: WritingOrder) -> Written:
    """Return the program in a language: its own with other targets, or another one.

    Raises:
        InputError: There is no such language.
        OutputError: The writer of another package fails, or names a file that it must not.
    """
    dialect = order.job.program.dialect if name == own_language(order.job.program) else dialect_at(name, "write")
    language = LANGUAGES[dialect]
    if dialect == order.job.program.dialect and language.in_place is not None:
        write = _robot_in_place if language.robot else _machine_in_place
    else:
        write = object_at(language.write)
    if dialect in LANGUAGES.own:
        result: Written = write(order)
        return result
    try:
        files, details = write(order)
        texts = {str(file): str(text) for file, text in files.items()}
        facts = dict(details)
    except CounterflexError:
        raise
    except Exception as fault:
        raise OutputError(
            f"the writer of another package fails: {type(fault).__name__}: {fault}", where=name
        ) from fault
    for file in texts:
        if file in RESULTS or file in ("", ".", "..") or PurePosixPath(file).name != file or "\\" in file:
            raise OutputError("the writer of another package names a file that it must not", where=name, value=file)
    return texts, facts


def refuse_robot_program(order: WritingOrder) -> Written:
    """Refuse a robot program that is asked for as G-code. Raises InputError: always."""
    raise InputError(
        "a robot program is not written as G-code",
        where=Path(order.job.program.name).name,
        value=LANGUAGES[GCODE].prompt,
        limit=own_language(order.job.program),
        hint="Leave --as out: the same language comes out",
    )


def _machine_in_place(order: WritingOrder) -> Written:
    job = order.job
    correction, rotvec = order.corrections
    commanded = CompensatedPath.from_correction(job.sampled, correction, rotvec)
    words = None
    if job.turned is not None and job.words is not None:
        words = CommandedWords.of(job.turned, job.words, correction, rotvec)
    text = object_at(LANGUAGES[job.program.dialect].in_place)(
        job.program,
        commanded,
        tolerance_m=order.tolerance_m,
        cell=order.cell.label,
        job=job_hash(order.plan),
        words=words,
    )
    facts = {key: value for key, value in dataclasses.asdict(text).items() if key != "text"}
    return {Path(job.program.name).name: text.text}, facts


def own_language(program: Program) -> str:
    """Name of the language that a program is written in: what it is written back in unless another one is asked for."""
    language = LANGUAGES[program.dialect]
    return language.prompt or program.dialect if language.robot else LANGUAGES[GCODE].prompt


def _robot_in_place(order: WritingOrder) -> Written:
    correction, rotvec = order.corrections
    text = object_at(LANGUAGES[order.job.program.dialect].in_place)(
        order.job.program,
        CompensatedPath.from_correction(order.job.sampled, correction, rotvec),
        tolerance_m=order.tolerance_m,
        cycle_s=order.cell.tables.controller.cycle_s,
        cell=order.cell.label,
        job=job_hash(order.plan),
    )
    facts = {key: value for key, value in dataclasses.asdict(text).items() if key != "files"}
    foreign = other_maker(order.cell, order.job.program.dialect)
    if foreign:
        facts["warnings"] = (*facts.get("warnings", ()), foreign)
    return text.files, facts


def held_axes(cell: Cell) -> dict[int, float]:
    """Value of each external axis by its number, mm or deg."""
    return {int(axis.name[1:]): axis.shown for axis in cell.tables.external_axes}


def turning_axes(cell: Cell) -> frozenset[int]:
    """Numbers of the external axes that turn."""
    return frozenset(int(axis.name[1:]) for axis in cell.tables.external_axes if axis.kind == "turning")


def writer_settings(order: WritingOrder, dialect: str, *, moving: bool = True) -> dict[str, Any]:
    """Return what every :class:`~counterflex.programs.robot_writer.writer.RobotSettings` needs, by field.

    Args:
        moving: The writer has words for external axes that move along the program.
    """
    job, cell = order.job, order.cell
    return {
        "name": routine_name(Path(job.program.name).stem),
        "start_axes_rad": axes_of_posture(cell, dialect, order.plan.q[0]),
        "rapid_m_s": cell.tables.controller.rapid_m_s,
        "cycle_s": cell.tables.controller.cycle_s,
        "cell": cell.label,
        "job": job_hash(order.plan),
        "external_axes": held_axes(cell),
        "places": written_places(job.places, cell, dialect) if moving else [],
        "turning_axes": turning_axes(cell),
    }


def robot_text(order: WritingOrder, writer: type[RobotWriter[Any]], settings: Any, dialect: str) -> Written:
    """Write a path as a robot program by a class of writers, with what stays out of it as warnings."""
    require_language(writer.language, dialect)
    job = order.job
    lines = order.cell.machine_functions(dialect).lines
    text = writer(
        job.program, job.path, order.Ts_part_tcp, settings, tolerance_m=order.tolerance_m, block_lines=lines
    ).text()
    assumed = axes_in(order.cell, dialect)[1]
    text = replace(text, warnings=(*text.warnings, *omissions(job.program), *other_lengths(job.program), *assumed))
    return text.files, {key: value for key, value in dataclasses.asdict(text).items() if key != "files"}


def payload(cell: Cell) -> tuple[float, list[float]]:
    """Mass and centre of gravity of the end effector in the flange frame."""
    T_flange_body, total, moment = np.eye(4), 0.0, np.zeros(3)
    for body in cell.end_effector.segments:
        T_flange_body = T_flange_body @ body.T_prev_seg
        total += body.mass_kg
        moment = moment + body.mass_kg * pose.transform(T_flange_body, body.p_seg_com)
    if total == 0.0:
        return 1.0, [0.0, 0.0, 0.001]
    return total, [float(value) for value in moment / total]


def require_tolerance(tolerance_m: float) -> None:
    """Refuse a distance between the written path and the planned one outside :data:`TOLERANCE_M`."""
    if not TOLERANCE_M[0] <= tolerance_m <= TOLERANCE_M[1]:
        raise InputError(
            "the tolerance of the written path is out of range",
            where="compensation.tolerance_um",
            value=f"{tolerance_m / UM:g}",
            limit=f"{TOLERANCE_M[0] / UM:g} to {TOLERANCE_M[1] / UM:g}",
        )


def write(
    job: Job, plan: Plan, cell: Cell, language: str, tolerance_m: float = 5.0 * UM
) -> tuple[dict[str, str], dict[str, Any]]:
    """Write a plan in a program language, see :func:`written`.

    Returns:
        Program files by name, and what the writer says about them, in shop units.
    """
    share = share_between(job.path, plan.path)
    if np.any(share != 1.0):
        job = replace(job, path=plan.path, sampled=at_feed(job.sampled, share), turned=_turned_at(job.turned, share))
    R = cell.R_part_plane
    if job.turned is not None:
        job = replace(job, path=job.turned.path, sampled=job.turned.path)
        cell = replace(cell, R_part_plane=None)
    files, facts = written(language, WritingOrder(job, plan, cell, tolerance_m, R))
    return files, _shop(facts)


def _turned_at(turned: TurnedPath | None, share: Float) -> TurnedPath | None:
    if turned is None:
        return None
    return replace(turned, path=at_feed(turned.path, share), programmed=at_feed(turned.programmed, share))


def _shop(facts: dict[str, Any]) -> dict[str, Any]:
    """Writer's figures with shop units in their names."""
    out: dict[str, Any] = {}
    for key, value in facts.items():
        if key.endswith("_m"):
            out[key[:-2] + "_um"] = round(float(value) / UM, 3)
        elif key.endswith("_rad"):
            out[key[:-4] + "_deg"] = round(float(value) / DEG, 5)
        else:
            out[key] = list(value) if isinstance(value, tuple) else value
    return out
