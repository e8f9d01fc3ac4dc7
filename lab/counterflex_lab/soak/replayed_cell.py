"""Files and a recorded pass of the demonstration cell, made so that the online loop can be run on it for hours."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.plan_file import read_plan, write_plan
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import ToolPath
from counterflex.plan.plan import Plan
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.live.live_cell import LiveCell
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.soak.recorded_pass import RecordedPass, record_pass

SEED: Final = 1
_PROGRAM: Final = """(One groove, 6 mm deep, through the blank of the demonstration cell)
G17 G54 G40 G49 G80 G90
G21
M6 T1
G43 H1
M3 S13000
G0 Z60
G0 X-12 Y15
G0 Z42
G1 Z34 F3000
G1 X212 F1500
G0 Z60
M5
M30
"""
_ENDS: Final = 15_000
"""Cycles that a cell goes on while panel, servers and recorder are ended: a minute."""
_CYCLES: Final = 2500
"""10 s: nearly the whole groove."""


@dataclass(frozen=True, eq=False)
class SteadyJob:
    """Files of the job."""

    cell: Path  # cell file: its sensor and tracker as an identification without error would have found them
    rsi: Path  # ETHERNET configuration, with the tag ``State``
    plan: Path  # plan file of the program
    played: RecordedPass  # the uncorrected pass


def prepare(
    folder: Path, cycles: int, *, force: str = "scale", tracker: str = "observer", progress: Progress = silent
) -> SteadyJob:
    """Write cell, RSI configuration, program and plan into a folder, and record the pass.

    Args:
        folder: That is there.
        cycles: For how many the pass is to be played, there and back: so many laps the plan has, and more for the time
            in which all else is ended.
        force: Value of the key of the table ``[online]``.
        tracker: Likewise.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        InputError: An unknown mode.
    """
    if force not in ("none", "measured", "pilot", "scale") or tracker not in ("none", "integrator", "observer"):
        raise InputError("mode of the online loop", value=(force, tracker))
    demo = resources.files("counterflex.app") / "demo"
    text = (demo / "cell.toml").read_text(encoding="utf-8")
    program, cell_file, rsi = folder / "groove.ngc", folder / "cell.toml", folder / "rsi.xml"
    program.write_text(_PROGRAM, encoding="utf-8")
    rsi.write_text(_telling((demo / "rsi.xml").read_text(encoding="utf-8")), encoding="utf-8")
    cell_file.write_text(text, encoding="utf-8")
    bare = read_cell(cell_file)
    truth = truth_of(bare, SEED)
    room = laboratory(SEED)
    sensor = force_sensor(truth, SEED, "sensor", hose_share=0.0)
    weight = next(body.mass_kg for body in truth.bodies if body.name == "spindle")
    weighed = text.replace("mass_kg = 75", f"mass_kg = {weight:.4f}")
    bias = f"bias_n = {sensor.w_bias[:3].tolist()}\nbias_nm = {sensor.w_bias[3:].tolist()}\n"
    weighed += f'\n[sensor]\nsegment = "sensor"\n{bias}'
    cell_file.write_text(weighed, encoding="utf-8")
    cell = read_cell(cell_file)
    with tempfile.TemporaryDirectory(dir=folder) as work:
        compensate(program, cell_file, Path(work) / "plan", report=False, programmed_feed=True, progress=progress)
        plan, about = read_plan(Path(work) / "plan" / "plan.parquet")
    job = read_job(program, cell)
    live = LiveCell(
        job.machined,
        truth=truth,
        controller=simulate.controller(cell),
        stock=cell.stock(),
        cutter=cell.cutter(simulate.tool_of(job.path)),
        datum_points_part=cell.datum_points_part if cell.part.measured_with == "robot" else None,
    )
    # The tracker was registered on the part as the robot found it, so that it shows what the cut does to the path.
    T_base_tracker = cell.T_base_part @ pose.inverse(live.T_base_part) @ room.T_base_tracker
    tables = (
        f"\n[tracker]\n{_pose(T_base_tracker)}{_pose(room.T_tcp_target, 'target_')}"
        f'\n[online]\nforce = "{force}"\ntracker = "{tracker}"\ncorrection_mm = 3\nspeed_mm_s = 40\n'
        "acceleration_mm_s2 = 2500\n"
    )
    cell_file.write_text(weighed + tables, encoding="utf-8")
    played = record_pass(live, sensor, room, _CYCLES, progress)
    ends = played.T_part_nominal[[0, -1], :3, 3]
    write_plan(
        folder / "plan.parquet", there_and_back(plan, ends, math.ceil((cycles + _ENDS) / played.cycles) + 1), about
    )
    return SteadyJob(cell_file, rsi, folder / "plan.parquet", played)


def _telling(configuration: str) -> str:
    """With the tag by which the robot program sees what the loop is doing, so that it can wait until it is armed."""
    head, mark, tail = configuration.rpartition("</ELEMENTS>")
    return f'{head}<ELEMENT TAG="State" TYPE="LONG" INDX="16" HOLDON="1"/>{mark}{tail}'


def there_and_back(plan: Plan, ends_part: Float, laps: int) -> Plan:
    """A plan run to one end, backwards to the other, and so on; what it predicts at a point stays what it was.

    Args:
        plan: Of one lap.
        ends_part: (2, 3) m, where it begins and where it ends: the rows between the nearest ones are used.
        laps: How many.
    """
    p = plan.path.p_part_tcp
    first, last = (int(np.argmin(np.linalg.norm(p - end, axis=1))) for end in ends_part)
    there = np.arange(first, last + 1)
    rows = np.concatenate([there if lap % 2 == 0 else there[::-1] for lap in range(laps)])
    step = np.diff(plan.path.time_s, prepend=plan.path.time_s[0])
    step = np.where(np.diff(rows, prepend=rows[0]) < 0, step[np.minimum(rows + 1, len(step) - 1)], step[rows])
    step[0] = 0.0
    columns = {f.name: getattr(plan, f.name) for f in fields(plan) if f.name != "path"}
    arrays = {name: np.ascontiguousarray(values[rows]) for name, values in columns.items() if values is not None}
    path = {f.name: np.ascontiguousarray(getattr(plan.path, f.name)[rows]) for f in fields(plan.path)}
    path |= {"time_s": np.cumsum(step), "motion": np.repeat(np.arange(laps), len(there))}
    return Plan(path=ToolPath(**path), **arrays)


def _pose(T: Float, prefix: str = "") -> str:
    p, angles = T[:3, 3] / MM, rotation.to_zyx(T[:3, :3]) / DEG
    names = ("x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg")
    values = (*p.tolist(), *angles.tolist())
    return "".join(f"{prefix}{name} = {value:.9f}\n" for name, value in zip(names, values, strict=True))
