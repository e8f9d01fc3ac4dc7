"""Choose where the part of a program stands in its cell: a new cell file, all candidates, a summary."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, read_in_plane, setting_of
from counterflex.app.placement.candidates_table import table_of, values_of
from counterflex.app.placement.region import Mounting, ProgramInCell, Stand, Wish, shown
from counterflex.app.posture import expected_um, held_row, loaded_path, robot_of, surroundings_of
from counterflex.core import atomic
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary, fill
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import text_with_place
from counterflex.files.summary_file import write_summary
from counterflex.plan.placement.candidate import Candidate, Site, pareto, site_of, worth
from counterflex.plan.placement.search import CandidatePoses, JudgedPlacements, search
from counterflex.plan.posture.choose import ChosenPosture, Freedom, choose
from counterflex.plan.posture.clearance import kept
from counterflex.plan.posture.cut_path import Surface
from counterflex.plan.posture.held import Held, PostureTask, held
from counterflex.plan.stability.stretches import Stretch, stretches_of
from counterflex.report.glossary import EXPECTED_NOTE, EXPECTED_UM, MODEL, MODEL_NOTE, MODEL_UM, expected_text

READING, CUTTING, SEARCHING, CHOOSING = "reading the program", "cutting", "searching the place", "choosing the posture"
TABLE: Final = "candidates.csv"
CANDIDATES: Final = 1024
FINALISTS: Final = 3
"""Places whose posture is chosen along the whole path; the best of them is taken."""
_APART_M: Final = 0.05
_APART_RAD: Final = 15.0 * DEG
ROUNDING: Final = 0.01
"""Damping ratio that the whole path, its finer grid and the rounded pose may take from that of a candidate."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A place chosen for a program."""

    stand: Stand  # Pose of the part and values of external axes
    chosen: ChosenPosture
    judged: JudgedPlacements
    summary: dict[str, Any]  # In shop units


@dataclass(frozen=True, eq=False)
class Prepared:
    """A program whose place is searched."""

    job: Job
    cell: Cell
    task: PostureTask  # The program on it, with its load
    stretches: list[Stretch]
    frame: ProgramInCell  # Where it may be


def prepared(
    program: str | Path, cell: Cell, reading: Reading, surface: Surface, progress: Progress = silent
) -> Prepared:
    """Read a program and cut its stock, for :func:`placement_of`."""
    job, cell, task = task_of(program, cell, reading, surface, progress)
    return Prepared(job, cell, task, stretches_of_task(task, cell), frame_of(task, cell))


def task_of(
    program: str | Path, cell: Cell, reading: Reading, surface: Surface, progress: Progress = silent
) -> tuple[Job, Cell, PostureTask]:
    """A program with its load on its cell. Raises CounterflexError: the program cannot be cut so, or cuts nothing."""
    if any(axis.moves for axis in cell.tables.external_axes):
        cell = cell.at_external({})  # places are chosen anew
    cell, job = read_in_plane(program, cell, reading=reading)
    setting, path = setting_of(cell, job, part_may_be_held=True), job.machined
    line: Int = job.line_of_motion[path.motion]
    with faults_in(job):
        cut = loaded_path(path, line, cell.stock(), setting, surface, progress)
        if not np.any(cut.weight_m > 0.0):
            raise InputError(
                "the program cuts nothing, so that no deflection tells one place from another",
                where=Path(job.program.name).name,
                hint="Check the blank (part.stock) and the program's zero",
            )
    return job, cell, PostureTask(path, line, cut, setting, robot_of(cell, setting), surroundings_of(job, cell))


def frame_of(task: PostureTask, cell: Cell) -> ProgramInCell:
    """Return where a program may be: by the middle of what is cut, or by the tip of a spindle that stands."""
    return ProgramInCell(cell, np.zeros(3) if cell.holds_part else task.middle_of_cut)


def placement_of(
    program: str | Path,
    cell: Cell,
    *,
    reading: Reading = AS_IT_IS,
    surface: Surface = "both",
    wish: Wish | None = None,
    count: int = CANDIDATES,
    given: Prepared | None = None,
    progress: Progress = silent,
) -> Placed:
    """Choose the place of a program.

    Args:
        cell: The cell; its present place is what the result is compared with.
        given: The program as :func:`prepared` has it; None: it is read here.

    Raises:
        ReachError: No candidate can be run; says which constraint refused how many.
    """
    parts = in_parts(progress, {CUTTING: 2.0, SEARCHING: 6.0, CHOOSING: 4.0})
    wish = Wish() if wish is None else wish
    parts[CUTTING](0.0)
    given = prepared(program, cell, reading, surface, parts[CUTTING]) if given is None else given
    job, cell, task, frame = given.job, given.cell, given.task, given.frame
    begin = time.perf_counter()
    region = wish.region(frame)
    site = site_of(task, given.stretches)
    judged = search(site, region, frame.seen, count, progress=parts[SEARCHING])
    alone, present = _here(task)
    now = Candidate() if present is None else Candidate("", 1.0, *worth(site, task.robot, present.q[site.rows]))
    judged = judged.steadied(now)
    seconds = time.perf_counter() - begin
    parts[CHOOSING](0.0)
    with faults_in(job):
        stand, chosen = _best(task, site, frame, judged)
    progress(1.0)
    here = frame.stand(frame.here)
    rows = {"present": (here, present), "posture_alone": (here, alone), "chosen": (stand, chosen.best)}
    summary = {
        "program": job.program.name,
        "cell": cell.label,
        "robot": cell.robot.name,
        "surface": surface,
        "external_axes": [axis.name for axis in frame.axes],
        "least_damping": None if np.isinf(judged.least_damping) else round(judged.least_damping, 4),
        **{
            name: None
            if what is None
            else {**where.part, **where.axes, **_row(what, where, task, site, frame, job, cell, surface)}
            for name, (where, what) in rows.items()
        },
        "reduction_percent": None
        if present is None or present.share_m == 0.0
        else round(100.0 * (1.0 - chosen.best.share_m / present.share_m), 1),
        "region": {"low": shown(region.low, cell), "high": shown(region.high, cell)},
        "candidates": len(judged.candidates),
        "refused": judged.refusals(),
        "pareto": len(pareto(values_of(judged))),
        "poses": site.poses * len(judged.candidates),
        "search_s": round(seconds, 3),
        "counterflex": __version__,
    }
    return Placed(stand, chosen, judged, summary)


def _row(
    what: Held,
    stand: Stand,
    task: PostureTask,
    site: Site,
    frame: ProgramInCell,
    job: Job,
    cell: Cell,
    surface: Surface,
) -> dict[str, Any]:
    """Return what a posture in a place is worth, in shop units."""
    there = _moved(task, frame.at(stand))
    _, error, damping = worth(site, there.robot, what.q[site.rows])
    clearance = np.inf if there.around is None else kept(what.q, there.robot, there.around)[1]
    return {
        **held_row(what, job, task.robot.chain.axes),
        **expected_um(what, job, cell, task.cut, there.robot.T_base_part, surface),
        "error_um": round(error / UM, 2),
        "damping_in_cut": None if np.isnan(damping) else round(damping, 4),
        "clearance_mm": None if np.isinf(clearance) else round(clearance / MM, 1),
    }


def stretches_of_task(task: PostureTask, cell: Cell) -> list[Stretch]:
    """Cuts of the program, for the criterion of chatter."""
    return stretches_of(task.path, cell.stock(), task.setting.cutter_of, cell.blank_box())


def _here(task: PostureTask) -> tuple[Held | None, Held | None]:
    """Best posture in the present place, and the present posture; None where not possible."""
    try:
        chosen = choose(task, Freedom())
    except ReachError:
        try:
            return None, held(task, task.setting)
        except ReachError:
            return None, None
    return chosen.best, chosen.present


def _best(task: PostureTask, site: Site, frame: ProgramInCell, judged: JudgedPlacements) -> tuple[Stand, ChosenPosture]:
    """Choose the posture of the best places along the whole path, and the best of them."""
    done: list[tuple[float, Stand, ChosenPosture]] = []
    tried: list[Float] = []
    failed: ReachError | None = None
    for k in judged.ranked():
        place, candidate = judged.places[k], judged.candidates[k]
        if any(_near(place, other) for other in tried):
            continue
        tried.append(place)
        stand = frame.stand(place)
        there = _moved(task, frame.at(stand))
        try:
            chosen = choose(there, Freedom(about=(candidate.branch, candidate.rotation_rad)))
        except ReachError as fault:
            failed = fault
        else:
            _, error, damping = worth(site, there.robot, chosen.best.q[site.rows])
            short = max(0.0, judged.least_damping - damping - ROUNDING) if np.isfinite(judged.least_damping) else 0.0
            done.append((error + short, stand, chosen))
        if len(done) == FINALISTS or len(tried) == 4 * FINALISTS:
            break
    if done:
        _, stand, chosen = min(done, key=lambda one: one[0])
        return stand, chosen
    if failed is not None:
        raise failed
    refused = ", ".join(f"{count} {reason}" for reason, count in judged.refusals().items())
    raise ReachError(
        "the program can be run in none of the places that were tried",
        value=f"of {len(judged.candidates)} refused: {refused}",
        limit="every point in one posture within all limits",
        hint="Widen --region, --turned or --axis; the limits are [limits] of the cell file, bodies are [[cell.body]]",
    )


def _moved(task: PostureTask, seen: CandidatePoses) -> PostureTask:
    """A task where program and floor are elsewhere."""
    robot = task.robot.facing(seen.T_base_standing)
    around = None if task.around is None else task.around.facing(task.robot, robot, seen.T_base_before)
    setting = replace(task.setting, T_base_part=robot.T_base_part, T_base_tcp=robot.T_base_tcp)
    return replace(task, setting=setting, robot=robot, around=around)


def _near(place: Float, other: Float) -> bool:
    """Return whether two places are so close that one posture's worth tells the other's."""
    turn = abs((place[3] - other[3] + np.pi) % (2.0 * np.pi) - np.pi)
    aside = float(np.abs(place[4:] - other[4:]).max(initial=0.0))
    return bool(np.linalg.norm(place[:3] - other[:3]) < _APART_M and turn < _APART_RAD and aside < _APART_M)


class PlacementSummary(Summary):
    """Place of the part, of the robot, or of each operation."""

    def _shown(self) -> Parts:
        axes = "".join(f"{name}={name}:g | " for name in self["external_axes"])
        if self["chosen"] is not None:
            yield from self._chosen(axes)
        if "per_operation" in self:
            yield from self._operations(axes)

    def _chosen(self, axes: str) -> Parts:
        rows = [
            defaultdict(lambda: None, self[name] or {"x_mm": "out of reach", "expected_um": ()}, place=name)
            for name in ("present", "posture_alone", "chosen")
        ]
        for row in rows:
            row["worth"] = "" if row["expected_um"] == () else expected_text(row)
        yield ShownTable.of(
            self.line("{program} on {cell}"),
            f"place | x mm:g | y mm:g | z mm:g | a deg:g | {axes}branch | rotation deg=rotation_about_tool_deg:g | "
            f"{EXPECTED_UM}=worth | {MODEL_UM}=deflection_um:g | with lost motion um=error_um:g | damping in cut:g | "
            "reversals:g | limit margin deg:g | wrist deg:g | clearance mm:g",
            rows,
            f"Deflection at rest, not compensated: 99.7 % of the cut stay below it. {EXPECTED_NOTE} With lost motion: "
            "power mean of the error with lost motion and swing, by the model too.",
        )
        for row in self.get("mountings", []):
            yield _angle(row, self["mounting"])
        if self["reduction_percent"] is not None:
            yield self.line("{reduction_percent:g} % less deflection than in the present place and posture")
        refused = ", ".join(f"{count} {reason}" for reason, count in self["refused"].items())
        yield f"{self['candidates']} places judged in {self['search_s']:g} s; refused: {refused or 'none'}"

    def _operations(self, axes: str) -> Parts:
        whole = self["per_operation"]
        yield self.rows(
            "operations",
            "Operations",
            f"lines={{lines[0]}}-{{lines[1]}} | cut mm:g | {axes}{MODEL_UM}=error_um:g | in one place um:g",
            "One posture for all: {per_operation[branch]}, {per_operation[rotation_about_tool_deg]:g} deg about the "
            f"tool. {MODEL_NOTE}",
        )
        if whole["in_one_place_um"] is None:
            yield f"one place for all cannot be run ({self.get('one_place_refused', 'in this posture')})"
        else:
            yield f"{whole['moves']} moves between operations, {MODEL}: " + fill(
                "{error_um:g} um of error, {reduction_percent:g} % less than {in_one_place_um:g} um in the best place "
                "for all",
                whole,
            )


def _angle(row: dict[str, Any], made: dict[str, Any]) -> str:
    best_um = row["deflection_um"]
    worth = row["refused"] if best_um is None else f"{best_um:g} um in its best place ({MODEL})"
    marks = [word for word in ("present", "chosen") if row["angle_deg"] == made[f"{word}_deg"]]
    remark = f" ({', '.join(marks)})" if marks else ""
    return f"{made['body']}.{made['key']} = {row['angle_deg']:g}: {worth}{remark}"


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    mounting: Mounting | None = None,
    progress: Progress = silent,
    **options: Any,
) -> PlacementSummary:
    """Write ``cell.toml`` with the chosen place, ``candidates.csv`` and ``summary.json`` into ``out``: all or none.

    Args:
        mounting: Angles of the spindle to choose from; every one costs a search. None: it stays as it is.
    """
    cell = read_cell(cell_file)
    with atomic.atomic_folder(out) as staging:
        mounted = None
        if mounting is None:
            done = placement_of(program, cell, progress=progress, **options)
        else:
            done, angle = _best_mounting(program, cell, mounting, progress, options)
            mounted = None if angle == mounting.present_deg(cell) else (mounting.body, mounting.key, angle)
        best = done.chosen.best
        text = text_with_place(
            cell.path, done.stand.part, best.branch, best.rotation_rad / DEG, Path(out), mounted, done.stand.axes
        )
        atomic.write_text(staging / "cell.toml", text)
        atomic.write_text(staging / TABLE, table_of(done.judged, cell))
        write_summary(staging / "summary.json", done.summary)
    return PlacementSummary(done.summary)


def _best_mounting(
    program: str | Path, cell: Cell, mounting: Mounting, progress: Progress, options: Mapping[str, Any]
) -> tuple[Placed, float]:
    """The best place of the best angle, and that angle in deg; the summary has all angles."""
    present = mounting.present_deg(cell)
    angles = list(dict.fromkeys([present, *mounting.values_deg]))
    parts = in_parts(progress, {str(angle): 1.0 for angle in angles})
    done: dict[float, Placed] = {}
    rows: list[dict[str, Any]] = []
    last: ReachError | None = None
    for angle in angles:
        row: dict[str, Any] = {"angle_deg": angle, "deflection_um": None, "error_um": None, "refused": ""}
        try:
            placed = placement_of(program, mounting.cell(cell, angle), progress=parts[str(angle)], **options)
        except ReachError as fault:
            last, row["refused"] = fault, fault.value or fault.what
        else:
            done[angle] = placed
            row |= {key: placed.summary["chosen"][key] for key in ("deflection_um", "error_um")}
        rows.append(row)
    if not done:
        assert last is not None
        raise last
    angle, best = min(done.items(), key=lambda pair: float(pair[1].summary["chosen"]["error_um"]))
    own = done[present].summary if present in done else {}
    summary = best.summary | {
        "mounting": {"body": mounting.body, "key": mounting.key, "present_deg": present, "chosen_deg": angle},
        "mountings": rows,
        **{key: own.get(key) for key in ("present", "posture_alone")},
    }
    before = summary["present"]
    summary["reduction_percent"] = None
    if before is not None and before["deflection_um"] > 0.0:
        less = 1.0 - summary["chosen"]["deflection_um"] / before["deflection_um"]
        summary["reduction_percent"] = round(100.0 * less, 1)
    return replace(best, summary=summary), angle
