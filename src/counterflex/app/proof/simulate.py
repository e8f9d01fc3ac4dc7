"""Machine a program on the simulated cell and keep everything that evaluation needs in one folder."""

from __future__ import annotations

import itertools
import time
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, in_working_plane, read_job
from counterflex.app.proof.truth import truth_of
from counterflex.app.robot_programs import companions, digest, inputs_of
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.next_command import next_command
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.cutting.removal import remove_tool_path
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.column_file import load_columns, save_columns
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.schema import write_toml
from counterflex.files.summary_file import write_folder_summary, write_run
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.language import LANGUAGES
from counterflex.programs.reading import dialect_of
from counterflex.twin.plant.controller import Controller, controller_of
from counterflex.twin.plant.record import Record
from counterflex.twin.plant.simulate import mounted_tools, simulate
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex.twin.truth.truth import Truth

PROGRAM, ORIGINAL, CELL, TRUTH = "program", "original", "cell.toml", "truth.toml"
RUN, SURFACE, COLUMNS, SUMMARY, BLANKS = "run.parquet", "surface.npz", "columns.npz", "summary.json", "blank.*"
PARAMETERS = "parameters.var"
_GCODE: Final = ".ngc"  # Ending of programs as LinuxCNC reads them
OTHER_CELL_M = 20.0 * MM
"""Distance of a body from where the cell has it, beyond which a truth is taken for another cell's."""


def require_simulated(cell: Cell) -> None:
    """Refuse a tilted or turning tool on a part that the robot holds: the twin moves such a tool along the path.

    Raises:
        InputError: The cell and its program are such.
    """
    if cell.holds_part and cell.tool_turns:
        raise InputError(
            "a part that the robot holds is machined on the simulated cell with the tool along its own z only",
            where=str(cell.path), value="a tilted tool", limit="rotary words at 0",
            hint="Turn the part frame ([part] a_deg, b_deg, c_deg) so that its z is along the tool; compensate and "
            "preflight take the program as it is",
        )  # fmt: skip


def controller(cell: Cell) -> Controller:
    """The robot controller as a cell file describes it: nominal geometry, part frame, speeds."""
    require_simulated(cell)
    tables = cell.tables
    return controller_of(
        cell.nominal_robot,
        cell.nominal_end_effector,
        np.eye(4) if cell.holds_part else cell.T_base_part,
        T_base_tcp=cell.T_base_tcp,
        branch=tables.posture.branch,
        rotation_about_tool_rad=tables.posture.rotation_about_tool_rad,
        turning=tables.posture.turning,
        blending_m=tables.controller.blending_m,
        acceleration_m_s2=tables.controller.acceleration_m_s2,
        rapid_m_s=tables.controller.rapid_m_s,
    )


def machine(job: Job, cell: Cell, truth: Truth, *, progress: Progress = silent) -> Record:
    """Machine a program on the twin of a cell.

    Raises:
        InputError: The program never comes near the blank.
        SimulationError: The simulated cell left its physical range.
    """
    record = simulate(
        job.machined,
        truth=truth,
        controller=controller(cell),
        stock=cell.stock(),
        cutter={number: cell.cutter(number) for number in tools_of(job.path)},
        datum_points_part=cell.datum_points_part if cell.part.measured_with == "robot" else None,
        turning=cell.tool_turns,
        progress=progress,
    )
    if len(record.time_s) == 0:
        raise InputError(
            "the program never comes near the blank",
            where=Path(job.program.name).name,
            hint="Check the part frame, the blank and the program's zero",
        )
    return record


def columns_of(record: Record) -> ColumnStock | None:
    """Columns of material that a tool that turned has left; None of one along z of the part."""
    left = record.columns
    if left is None:
        return None
    low, high = (np.ascontiguousarray(np.moveaxis(ends, 2, 0)) for ends in (left.low, left.high))
    return ColumnStock(left.x0_m, left.y0_m, left.cell_m, low, high, left.held)


def save_part(part: HeightMap, columns: ColumnStock | None, folder: Path, prefix: str = "") -> None:
    """Write the part as machined: its height map, or columns of material where there are some."""
    if columns is None:
        part.save(folder / f"{prefix}{SURFACE}")
    else:
        save_columns(columns, folder / f"{prefix}{COLUMNS}")


def read_part(folder: Path) -> tuple[HeightMap, ColumnStock | None]:
    """The part that :func:`save_part` wrote; of columns the height map is the highest material.

    Raises:
        FileFormatError: The file is missing or damaged.
    """
    if not (folder / COLUMNS).is_file():
        return HeightMap.load(folder / SURFACE), None
    columns = load_columns(folder / COLUMNS)
    return columns.tops(), columns


def undisturbed(job: Job, cell: Cell, *, threads: int = 1) -> HeightMap:
    """The part that a program would give if nothing bent: the nominal surface of every comparison."""
    stock = cell.stock()
    path, mounted = job.path, mounted_tools(job.path)
    changes = np.flatnonzero(np.diff(mounted[1:])) + 1
    for first, last in itertools.pairwise([0, *changes.tolist(), len(path) - 1]):
        if last > first:
            some = slice(first, last + 1)
            rows = {field.name: getattr(path, field.name)[some] for field in fields(path)}
            rows["tool"] = np.full(last + 1 - first, mounted[last])
            remove_tool_path(
                stock, ToolPath(**rows), cell.cutter(int(mounted[last])), engagement=False, threads=threads
            )
    return stock


def run(
    program: str | Path,
    cell_file: str | Path,
    truth_file: str | Path,
    out: str | Path,
    *,
    original: str | Path | None = None,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes ``run.parquet`` (path, forces), ``surface.npz`` (as-machined height map; ``columns.npz`` with columns of
    material where the tool turns in the cut), the program, the original program
    it stands for, cell (with the blank that it names by a file) and truth as they were, and ``summary.json``; all of
    them or none.

    Args:
        original: The uncompensated program, when ``program`` is a compensated one: accuracy is always judged against
            the original. None: the program itself.
    """
    begin = time.perf_counter()
    inputs = inputs_of(program if original is None else original, cell_file)
    cell, truth = read_cell(cell_file), read_truth(truth_file)
    check_same_cell(cell, truth, str(truth_file))
    reference = Path(program if original is None else original)
    cell = in_working_plane(reference, cell, reading)
    job = read_job(program, cell, reading=reading)
    if original is not None:
        read_job(reference, cell, reading=reading)
    with atomic.atomic_folder(out) as staging:
        record = machine(job, cell, truth, progress=progress)
        summary = {
            "job": "simulate",
            "program": Path(program).name,
            "original": reference.name,
            "cell": cell.name,
            "truth": truth.name,
            "seed": truth.seed,
            "family": truth.family,
            "inputs": inputs | {"machined_sha256": digest(program)},
            "machining": figures(record),
            "seconds": round(time.perf_counter() - begin, 3),
            "counterflex": __version__,
        }
        keep_inputs(cell, program, reference, staging, reading)
        write_truth(staging / TRUTH, truth)
        write_run(staging / RUN, record, {key: summary[key] for key in ("program", "cell", "seed", "counterflex")})
        save_part(record.stock, columns_of(record), staging)
        write_folder_summary(staging, summary)
    return summary


def keep_inputs(
    cell: Cell, program: str | Path, original: str | Path, folder: Path, reading: Reading = AS_IT_IS
) -> None:
    """Copy the program, the one it stands for, the machine's parameters and the cell file into a run folder."""
    if reading.parameters is not None:
        atomic.write_bytes(folder / PARAMETERS, _source(reading.parameters))
    for name, source in ((PROGRAM, Path(program)), (ORIGINAL, Path(original))):
        ending = next(iter(LANGUAGES[dialect_of(source, reading.dialect)].endings), _GCODE)
        files = companions(source)
        parts = [file for file in files if file.stem.upper() != source.stem.upper()]
        inside = folder / name if parts else folder
        inside.mkdir(exist_ok=True)
        atomic.write_bytes(inside / f"{name}{ending}", _source(source))
        for file in files:
            own = file.name if file in parts else f"{name}{file.suffix.lower()}"
            atomic.write_bytes(inside / own, _source(file))
    keep_cell(cell, folder)


def read_original(folder: Path, cell: Cell) -> Job:
    """The program that a run is judged against, read as it was for the run."""
    return read_job(kept(folder, ORIGINAL), cell, reading=reading_of(folder))


def kept(folder: Path, name: str) -> Path:
    """The program of a run folder, :data:`PROGRAM` or :data:`ORIGINAL`; its ending tells the language.

    A program of several files has a folder of its own there, in which its parts have the names by which it calls them.
    """
    endings = [ending for _, one in LANGUAGES.items() for ending in one.endings[:1]]
    files = (inside / f"{name}{ending}" for inside in (folder, folder / name) for ending in endings)
    return next((file for file in files if file.is_file()), folder / f"{name}{_GCODE}")


def reading_of(folder: Path) -> Reading:
    """Return how the programs of a run were read."""
    parameters = folder / PARAMETERS
    return Reading(parameters=parameters if parameters.is_file() else None, complete=False)


def read_cell_of(folder: Path) -> Cell:
    """The cell of a run, its part seen along the tool of the original program."""
    return in_working_plane(kept(folder, ORIGINAL), read_cell(folder / CELL), reading_of(folder))


def keep_cell(cell: Cell, folder: Path) -> None:
    """Write the cell file into a folder as it was; a blank that it names by a file goes along, under a new name."""
    stock = cell.part.stock
    named = None if stock is None else stock.stl or stock.result
    if stock is None or named is None:
        atomic.write_bytes(folder / CELL, _source(cell.path))
        return
    name = BLANKS.replace(".*", Path(named).suffix)
    atomic.write_bytes(folder / name, _source(cell.path.parent / named))
    tables = cell.tables.model_dump(mode="json", exclude_none=True)
    tables["part"]["stock"]["stl" if stock.stl else "result"] = name
    write_toml(folder / CELL, tables, comment=f"As {cell.path.name}, with the blank beside it.")


def check_same_cell(cell: Cell, truth: Truth, where: str) -> None:
    """Check that a truth is one of this cell: the same bodies, in about the same places.

    Raises:
        FileFormatError: It is another cell's.
    """
    nominal = truth_of(cell, None)
    hint = f"Make one from this cell: {next_command('truth', 'CELL', out='FILE')}"
    names, expected = [body.name for body in truth.bodies], [body.name for body in nominal.bodies]
    if names != expected:
        raise FileFormatError(
            "the truth belongs to another cell: its bodies are not those of the cell",
            where=where,
            value=", ".join(names),
            limit=", ".join(expected),
            hint=hint,
        )
    places = zip(
        [*expected, "tcp"],
        [*(body.T_prev_seg for body in truth.bodies), truth.T_last_tcp],
        [*(body.T_prev_seg for body in nominal.bodies), nominal.T_last_tcp],
        strict=True,
    )
    for name, T_true, T_nominal in places:
        off = float(np.linalg.norm(T_true[:3, 3] - T_nominal[:3, 3]))
        if off > OTHER_CELL_M:
            raise FileFormatError(
                f"the truth belongs to another cell: '{name}' is elsewhere",
                where=where,
                value=f"{off / MM:.1f} mm off",
                limit=f"at most {OTHER_CELL_M / MM:g} mm",
                hint=hint,
            )


def figures(record: Record) -> dict[str, Any]:
    """Peak force, time, distance of the tool from its command."""
    force: Float = np.linalg.norm(record.force_part, axis=1)
    off: Float = np.linalg.norm(record.p_part_tcp - record.p_part_command, axis=1)
    engaged = record.engaged & (record.kind == FEED)
    return {
        "duration_s": round(float(record.time_s[-1]), 3),
        "cutting_s": round(float(np.count_nonzero(engaged)) * float(np.median(np.diff(record.time_s))), 3),
        "peak_force_n": round(float(np.max(force, initial=0.0)), 2),
        "largest_offset_mm": round(float(np.max(off[engaged], initial=0.0) / MM), 4),
    }


def tools_of(path: ToolPath) -> list[int]:
    """Numbers of the tools that a path is simulated with, rising."""
    return [int(number) for number in np.unique(mounted_tools(path))]


def tool_of(path: ToolPath) -> int:
    """Number of the one tool that a path cuts with; InputError when there are several."""
    tools = np.unique(path.tool[path.kind == FEED])
    if len(tools) == 0:
        return int(path.tool[-1])
    if len(tools) > 1:
        raise InputError(
            "a run with online correction has one tool",
            value=", ".join(f"T{number}" for number in tools),
            hint="Split the program at the tool change and give the first result to the second cell as stock",
        )
    return int(tools[0])


def _source(path: str | Path) -> bytes:
    return file_content.content(path)
