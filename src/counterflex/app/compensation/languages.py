"""Program languages by name: what ``compensate --as`` may say, and what each writes.

Another package adds one with an entry point of the group ``counterflex.languages`` (docs/extend.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from counterflex.app.compensation.language_names import LANGUAGES
from counterflex.app.compensation.robot_program import omissions, other_lengths, routine_name, tool_data
from counterflex.app.external_moves import written_places
from counterflex.app.inputs import Job
from counterflex.app.robot_axes import (
    axes_in,
    axes_of_posture,
    fanuc_configuration,
    in_world,
    other_maker,
    part_in_world,
    val3_configuration,
)
from counterflex.app.robot_programs import refuse_held_part
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError, OutputError
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.path.turning import TurnedPath
from counterflex.plan.feed_schedule import at_feed, share_between
from counterflex.plan.plan import Plan, job_hash
from counterflex.programs.apt.writer import write_apt
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.fanuc.in_place import write_fanuc_in_place
from counterflex.programs.fanuc.program import FanucProgram
from counterflex.programs.fanuc.writer import FanucSettings, FanucWriter
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.krl.in_place import write_krl_in_place
from counterflex.programs.krl.program import KrlProgram
from counterflex.programs.krl.writer import KrlSettings, KrlWriter
from counterflex.programs.program import ROBOT_DIALECTS, Program
from counterflex.programs.rapid.in_place import write_rapid_in_place
from counterflex.programs.rapid.program import RapidProgram
from counterflex.programs.rapid.writer import RapidSettings, RapidWriter
from counterflex.programs.robot_writer.statement_forms import Dialect
from counterflex.programs.rotary.poses import commanded_words
from counterflex.programs.val3.application import Val3Settings
from counterflex.programs.val3.in_place import write_val3_in_place
from counterflex.programs.val3.program import Val3Program
from counterflex.programs.val3.writer import Val3Writer
from counterflex.robot.kinematics.inverse_seeds import branch_of

RESULTS: Final = ("plan.parquet", "summary.json", "report.html")
"""What stands beside the program files."""
TOLERANCE_M: Final = (0.1 * UM, 1000.0 * UM)
"""Smallest and largest tolerance of the written path."""
Written = tuple[dict[str, str], dict[str, Any]]
"""Program files by name, and what the writer says about them: SI, the unit as suffix; ``warnings`` a list of texts."""


@dataclass(frozen=True, eq=False)
class WritingOrder:
    """What is to be written.

    Attributes:
        job: The program as read, its path and its samples.
        plan: With the correction of every point.
        cell: The cell.
        tolerance_m: Largest distance between the written path and the planned one.
        R_part_plane: (3, 3) axes that the plan is given in, where the tool is tilted; job and cell are in part axes.
    """

    job: Job
    plan: Plan
    cell: Cell
    tolerance_m: float
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


@dataclass(frozen=True)
class LanguageKind:
    """A language that a program can be written in.

    Attributes:
        title: One line for help.
        write: Makes the files. Raises a CounterflexError where the language cannot say what is asked for.
        orientation: The language states the orientation of the tool, so that it can be corrected.
        dialect: Of the machine functions in ``[controller.spindle]``, or None where the program keeps its own words.
    """

    title: str
    write: Callable[[WritingOrder], Written]
    orientation: bool = True
    dialect: Dialect | None = None


def written(name: str, order: WritingOrder) -> Written:
    """The program in a language.

    Raises:
        InputError: There is no such language.
        OutputError: The writer of another package fails, or names a file that it must not.
    """
    kind: LanguageKind = LANGUAGES[name]
    if name in LANGUAGES.own:
        return kind.write(order)
    try:
        files, details = kind.write(order)
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


def _gcode(order: WritingOrder) -> Written:
    job, plan = order.job, order.plan
    if own_language(job.program) != "gcode":
        raise InputError(
            "a robot program is not written as G-code",
            where=Path(job.program.name).name,
            value="gcode",
            limit=own_language(job.program),
            hint="Leave --as out: the same language comes out",
        )
    correction, rotvec = order.corrections
    commanded = CompensatedPath.from_correction(job.sampled, correction, rotvec)
    words = None
    if job.turned is not None and job.words is not None:
        words = commanded_words(job.turned, job.words, correction, rotvec)
    text = (write_apt if job.program.dialect == "apt" else write_gcode)(
        job.program,
        commanded,
        tolerance_m=order.tolerance_m,
        cell=order.cell.label,
        job=job_hash(plan),
        words=words,
    )
    facts = {key: value for key, value in dataclasses.asdict(text).items() if key != "text"}
    return {Path(job.program.name).name: text.text}, facts


def own_language(program: Program) -> str:
    """Name of the language that a program is written in: what it is written back in unless another one is asked for."""
    return program.dialect if program.dialect in ROBOT_DIALECTS else "gcode"


def _in_place(write: Callable[..., Any], order: WritingOrder) -> Written:
    correction, rotvec = order.corrections
    text = write(
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


def _krl(order: WritingOrder) -> Written:
    if isinstance(order.job.program, KrlProgram):
        return _in_place(write_krl_in_place, order)
    job, plan, cell = order.job, order.plan, order.cell
    controller, data = cell.tables.controller, tool_data(order.job.program, order.cell, "krl")
    settings = KrlSettings(
        name=routine_name(Path(job.program.name).stem),
        start_axes_rad=axes_of_posture(cell, "krl", plan.q[0]),
        tool=controller.tool_number,
        base=controller.base_number,
        rapid_m_s=controller.rapid_m_s,
        acc_m_s2=controller.acceleration_m_s2,
        blend_m=controller.blending_m,
        cycle_s=controller.cycle_s,
        cell=cell.label,
        job=job_hash(plan),
        **external(order, "krl"),
        tool_data={tool: int(value) for tool, value in data.items()},
        fixed_tool=cell.holds_part,
    )
    return _robot_text(order, KrlWriter, settings, "krl")


def held_axes(cell: Cell) -> dict[int, float]:
    """Value of each external axis by its number, mm or deg."""
    return {int(axis.name[1:]): axis.shown for axis in cell.tables.external_axes}


def turning_axes(cell: Cell) -> frozenset[int]:
    """Numbers of the external axes that turn."""
    return frozenset(int(axis.name[1:]) for axis in cell.tables.external_axes if axis.kind == "turning")


def external(order: WritingOrder, language: Dialect) -> dict[str, Any]:
    """Return what a writer needs of the external axes: where they begin, and the places that they take."""
    cell, places = order.cell, order.job.places
    taken = [] if language == "val3" else written_places(places, cell, language)
    return {"external_axes": held_axes(cell), "places": taken, "turning_axes": turning_axes(cell)}


def _rapid(order: WritingOrder) -> Written:
    if isinstance(order.job.program, RapidProgram):
        return _in_place(write_rapid_in_place, order)
    job, plan, cell = order.job, order.plan, order.cell
    controller = cell.tables.controller
    mass, com = payload(cell)
    settings = RapidSettings(
        name=routine_name(Path(job.program.name).stem),
        start_axes_rad=axes_of_posture(cell, "rapid", plan.q[0]),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        T_base_part=part_in_world(cell, "rapid"),
        work_object=controller.work_object or "",
        T_base_tcp=None if cell.T_base_tcp is None else in_world(cell, "rapid", cell.T_base_tcp),
        tool_mass_kg=mass,
        p_flange_cog=com,
        rapid_m_s=controller.rapid_m_s,
        cycle_s=controller.cycle_s,
        cell=cell.label,
        job=job_hash(plan),
        **external(order, "rapid"),
        tool_data=tool_data(job.program, cell, "rapid"),
    )
    return _robot_text(order, RapidWriter, settings, "rapid")


def _fanuc(order: WritingOrder) -> Written:
    if isinstance(order.job.program, FanucProgram):
        return _in_place(write_fanuc_in_place, order)
    job, plan, cell = order.job, order.plan, order.cell
    refuse_held_part(cell, "FANUC")
    controller, data = cell.tables.controller, tool_data(job.program, cell, "fanuc")
    start = axes_of_posture(cell, "fanuc", plan.q[0])
    settings = FanucSettings(
        name=routine_name(Path(job.program.name).stem),
        start_axes_rad=start,
        configuration=fanuc_configuration(branch_of(cell.controller_chain, plan.q[0]), start),
        T_world_part=part_in_world(cell, "fanuc"),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        tool=controller.tool_number,
        base=controller.base_number,
        rapid_m_s=controller.rapid_m_s,
        cycle_s=controller.cycle_s,
        cell=cell.label,
        job=job_hash(plan),
        **external(order, "fanuc"),
        tool_data={tool: int(value) for tool, value in data.items()},
    )
    return _robot_text(order, FanucWriter, settings, "fanuc")


def _val3(order: WritingOrder) -> Written:
    if isinstance(order.job.program, Val3Program):
        return _in_place(write_val3_in_place, order)
    job, plan, cell = order.job, order.plan, order.cell
    refuse_held_part(cell, "VAL3")
    controller = cell.tables.controller
    settings = Val3Settings(
        name=routine_name(Path(job.program.name).stem),
        start_axes_rad=axes_of_posture(cell, "val3", plan.q[0]),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        T_world_part=part_in_world(cell, "val3"),
        configuration=val3_configuration(branch_of(cell.controller_chain, plan.q[0])),
        blend_m=controller.blending_m,
        rapid_m_s=controller.rapid_m_s,
        cycle_s=controller.cycle_s,
        cell=cell.label,
        job=job_hash(plan),
        **external(order, "val3"),
        tool_data=tool_data(job.program, cell, "val3"),
    )
    return _robot_text(order, Val3Writer, settings, "val3")


def _robot_text(order: WritingOrder, writer: Callable[..., Any], settings: Any, dialect: Dialect) -> Written:
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


GCODE: Final = LanguageKind("the language of the program itself", _gcode, orientation=False)
KRL: Final = LanguageKind("KUKA KRL", _krl, dialect="krl")
RAPID: Final = LanguageKind("ABB RAPID", _rapid, dialect="rapid")
FANUC: Final = LanguageKind("FANUC TP listings", _fanuc, dialect="fanuc")
VAL3: Final = LanguageKind("Staubli VAL3", _val3, dialect="val3")


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
