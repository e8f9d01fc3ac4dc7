"""Choose the posture of a program on a cell: a new cell file, the deflection of every posture, a summary."""

from __future__ import annotations

import csv
import io
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.coarse_bodies import coarse_bodies
from counterflex.app.cut_points import points_of_posture
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, read_in_plane, setting_of
from counterflex.app.prediction_interval import expected_deflection
from counterflex.core import atomic
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import DEG, UM, plain
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import text_with_posture
from counterflex.files.summary_file import write_summary
from counterflex.path.tool_rotation import ToolRotation
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import CompensationInputs, Setting, feed_runs
from counterflex.plan.posture.choose import ChosenPosture, Freedom, choose
from counterflex.plan.posture.clearance import Surroundings
from counterflex.plan.posture.cut_path import LoadedPath, Surface, cut_path
from counterflex.plan.posture.held import Held, PostureTask
from counterflex.plan.posture.survey import RobotHere
from counterflex.plan.undisturbed_cut import undisturbed_cut
from counterflex.report.glossary import EXPECTED_NOTE, EXPECTED_UM, MODEL_UM, expected_text
from counterflex.robot.model.controller_axes import ControllerAxes
from counterflex.robot.model.opw import BRANCHES

READING, CUTTING, CHOOSING = "reading the program", "cutting", "choosing the posture"
MAP: Final = "postures.csv"


@dataclass(frozen=True, eq=False)
class PostureOf:
    """A posture chosen for a program."""

    job: Job
    cell: Cell
    task: PostureTask
    chosen: ChosenPosture
    summary: dict[str, Any]  # In shop units

    @classmethod
    def of(
        cls,
        program: str | Path,
        cell: Cell,
        *,
        reading: Reading = AS_IT_IS,
        surface: Surface = "both",
        freedom: Freedom | None = None,
        progress: Progress = silent,
    ) -> PostureOf:
        """Choose the posture of a program.

        Args:
            cell: The cell; its present posture is what the result is compared with.
            freedom: What may be chosen; None is a posture held all along.

        Raises:
            CounterflexError: The program, the cell or the reach does not allow it.
            InputError: The program cuts nothing.
        """
        freedom = Freedom() if freedom is None else freedom
        begin, parts = time.perf_counter(), in_parts(progress, {READING: 1.0, CUTTING: 2.0, CHOOSING: 3.0})
        parts[READING](0.0)
        cell, job = read_in_plane(program, cell, reading=reading)
        setting, path = setting_of(cell, job, part_may_be_held=True), job.machined
        line: Int = job.line_of_motion[path.motion]
        with faults_in(job):
            cut = loaded_path(path, line, cell.stock(), setting, surface, parts[CUTTING])
            if not np.any(cut.weight_m > 0.0):
                raise InputError(
                    "the program cuts nothing, so that no deflection tells one posture from another",
                    where=Path(job.program.name).name,
                    hint="Check the blank (part.stock) and the program's zero",
                )
            task = PostureTask(path, line, cut, setting, robot_of(cell, setting), surroundings_of(job, cell))
            chosen = choose(task, freedom, parts[CHOOSING])
        progress(1.0)
        summary = _summary(job, cell, cut, chosen, surface)
        summary |= {"seconds": round(time.perf_counter() - begin, 3), "counterflex": __version__}
        return cls(job, cell, task, chosen, summary)


def loaded_path(
    path: ToolPath, line: Int, stock: HeightMap, setting: Setting, surface: Surface, progress: Progress = silent
) -> LoadedPath:
    """The path of a program with the force of the tool that does not yield; no posture is needed for it.

    Args:
        path: n points.
        line: (n,) source line of each.

    Raises:
        CounterflexError: The program cannot be cut so.
    """
    inputs = CompensationInputs(path, line, stock, setting, np.zeros((len(path), 6)))
    return cut_path(path, undisturbed_cut(inputs, progress), feed_runs(path), surface)


def robot_of(cell: Cell, setting: Setting) -> RobotHere:
    """Robot, tool and place of the part of a cell."""
    tables = cell.tables
    bounds = tables.limits.preflight(tables.controller, cell.robot)
    return RobotHere(
        setting.chain,
        setting.controller_chain,
        setting.T_base_part,
        setting.limits,
        bounds.joint_speeds_rad_s,
        bounds.joint_accelerations_rad_s2,
        bounds.acceleration_m_s2,
        bounds.cables_rad,
        setting.T_base_tcp,
    )


def surroundings_of(job: Job, cell: Cell) -> Surroundings:
    """Coarse bodies of a cell, as preflight compares them."""
    bounds = cell.tables.limits.preflight(cell.tables.controller, cell.robot)
    return Surroundings(coarse_bodies(job, cell, cell.stock()), job.machined.tool, bounds.clearance_m)


_SURFACE_WORDS: Final = {"both": "wall and floor", "wall": "the wall", "floor": "the floor"}


class PostureSummary(Summary):
    """Present and chosen posture."""

    def _shown(self) -> Parts:
        rows = [
            defaultdict(lambda: None, held or {}, posture=name, worth=expected_text(held) if held else "out of reach")
            for name, held in ((name, self[name]) for name in ("present", "chosen"))
        ]
        yield ShownTable.of(
            self.line("{program} on {cell}"),
            f"posture | {EXPECTED_UM}=worth | branch | rotation deg=rotation_about_tool_deg:g | turned deg:g | "
            f"{MODEL_UM}=deflection_um:g | largest um:g | in line=largest_in_line:g | reversals:g | unloadings:g | "
            "limit margin deg:g | wrist deg:g",
            rows,
            "Deflection without compensation: 99.7 % of the cut stay below it, normal to "
            f"{_SURFACE_WORDS[self['surface']]}. {EXPECTED_NOTE}",
        )
        if self["reduction_percent"] is not None:
            yield self.line("{reduction_percent:g} % less deflection than in the present posture")
        yield self.line("{poses} postures tried; no posture could be below {bound_um:g} um in the mean")


def run(
    program: str | Path, cell_file: str | Path, out: str | Path, *, progress: Progress = silent, **options: Any
) -> PostureSummary:
    """Write ``cell.toml`` with the chosen posture, ``postures.csv`` and ``summary.json`` into ``out``: all or none."""
    cell = read_cell(cell_file)
    with atomic.atomic_folder(out) as staging:
        done = PostureOf.of(program, cell, progress=progress, **options)
        best = done.chosen.best
        turning = None if best.turning is None else _sparse(best.turning).placed(done.job.machined.p_part_tcp)
        text = text_with_posture(cell.path, best.branch, best.rotation_rad / DEG, Path(out), turning)
        atomic.write_text(staging / "cell.toml", text)
        atomic.write_text(staging / MAP, _map(done.chosen))
        write_summary(staging / "summary.json", done.summary)
    return PostureSummary(done.summary)


def _sparse(turning: ToolRotation) -> ToolRotation:
    """The same with the first and the last only of places at one angle."""
    rows = list(zip(turning.length_m, turning.angle_rad, strict=True))
    inner = [b for a, b, c in zip(rows, rows[1:], rows[2:], strict=False) if not a[1] == b[1] == c[1]]
    places, angles = zip(*[rows[0], *inner, *rows[1:][-1:]], strict=True)
    return ToolRotation(places, angles)


def _map(chosen: ChosenPosture) -> str:
    """Deflection of every posture held all along, um; empty where the path cannot be run so."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["rotation_about_tool_deg", *(f"{branch} um" for branch in BRANCHES)])
    for k, costs in enumerate(chosen.costs_m):
        angle = f"{360.0 * k / len(chosen.costs_m):g}"
        rows.writerow([angle, *("" if not np.isfinite(cost) else f"{cost / UM:.2f}" for cost in costs)])
    return text.getvalue()


def _summary(job: Job, cell: Cell, cut: LoadedPath, chosen: ChosenPosture, surface: Surface) -> dict[str, Any]:
    shown = {"present": chosen.present, "chosen": chosen.best}
    return {
        "program": job.program.name,
        "cell": cell.label,
        "robot": cell.robot.name,
        "surface": surface,
        **{
            name: None
            if held is None
            else held_row(held, job, cell.chain.axes) | expected_um(held, job, cell, cut, None, surface)
            for name, held in shown.items()
        },
        "reduction_percent": None
        if chosen.present is None or chosen.present.share_m == 0.0
        else round(100.0 * (1.0 - chosen.best.share_m / chosen.present.share_m), 1),
        "cost": round(chosen.way.cost, 4),
        "bound_um": _um(chosen.bound_m),
        "points": len(cut),
        "poses": chosen.poses,
    }


def held_row(held: Held, job: Job, axes: ControllerAxes) -> dict[str, Any]:
    """Return what a posture is worth, as summaries have it: um, deg."""
    row = int(np.argmax(held.deflection_m))
    return {
        "branch": held.branch,
        "rotation_about_tool_deg": round(held.rotation_rad / DEG, 4),
        "turned_deg": 0.0
        if held.turning is None
        else round(float(np.sum(np.abs(np.diff(held.turning.angle_rad)))) / DEG, 3),
        **plain(held, "deflection_um=share_m:2 largest_um:2"),
        "largest_in_line": int(job.line_of_motion[job.machined.motion[row]]),
        **plain(held, "reversals unloadings limit_margin_deg:2 wrist_deg:2"),
        "start_axes_deg": np.round(axes.shown(held.q[0]) / DEG, 3).tolist(),
    }


def expected_um(
    what: Held, job: Job, cell: Cell, cut: LoadedPath, T_base_part: Float | None, surface: Surface
) -> dict[str, list[float] | None]:
    """Deflection to plan with: median and the ends between which nine of ten such cells lie, um.

    None where one surface alone matters or the robot holds the part: neither is counted.

    Args:
        T_base_part: (4, 4) where the part stands; None: where the cell file has it.
    """
    points = None
    if surface == "both":
        points = points_of_posture(cell, cut, what.q, T_base_part, job.program.name)
    if points is None:
        return {"expected_um": None}
    deflection = expected_deflection(cell, points)
    return {"expected_um": [_um(value) for value in (deflection.median_m, deflection.low_m, deflection.high_m)]}


def _um(value_m: float) -> float:
    return round(value_m / UM, 2)
