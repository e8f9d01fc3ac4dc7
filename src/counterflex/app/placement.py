"""Choose where the part of a program stands in its cell: a new cell file, all candidates, a summary."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, in_working_plane, read_job, setting_of
from counterflex.app.posture import held_row, loaded_path, robot_of, surroundings_of
from counterflex.app.spindle_mounting import Mounting
from counterflex.core import atomic
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import POSE_KEYS, text_with_place
from counterflex.files.summary_file import write_summary
from counterflex.geometry import pose
from counterflex.plan.placement.candidate import pareto, site_of
from counterflex.plan.placement.search import Judged, Region, placed, search, usual_region
from counterflex.plan.posture.choose import Chosen, Freedom, choose
from counterflex.plan.posture.cut_path import Surface
from counterflex.plan.posture.held import Held, Task, held

READING, CUTTING, SEARCHING, CHOOSING = "reading the program", "cutting", "searching the place", "choosing the posture"
TABLE: Final = "candidates.csv"
CANDIDATES: Final = 1024
FINALISTS: Final = 3
"""Places whose posture is chosen along the whole path; the best of them is taken."""
_APART_M: Final = 0.05
_APART_RAD: Final = 15.0 * DEG


@dataclass(frozen=True)
class Wish:
    """Where the part may stand.

    Attributes:
        box_mm: Least and largest x and y of the middle of the program, and z of the part frame, robot base; None: as
            :func:`counterflex.plan.placement.search.usual_region` has it.
        turned_deg: Least and largest rotation of the part about z, from the present one.
    """

    box_mm: tuple[float, ...] | None = None
    turned_deg: tuple[float, ...] = (-180.0, 180.0)


@dataclass(frozen=True, eq=False)
class Placed:
    """A place chosen for a program.

    Attributes:
        pose: Of the part, ``x_mm`` ... ``c_deg``.
        chosen: Its posture.
        judged: All candidates.
        summary: In shop units.
    """

    pose: dict[str, float]
    chosen: Chosen
    judged: Judged
    summary: dict[str, Any]


@dataclass(frozen=True, eq=False)
class _Frame:
    """How a candidate becomes a pose of the part."""

    cell: Cell
    middle: Float

    @property
    def part(self) -> Float:
        """(4, 4) present pose of the part in the base."""
        return self.cell.part.matrix()

    def keys(self, place: Float) -> dict[str, float]:
        """Pose of the part as a cell file has it, to 0.1 mm and 0.01 deg."""
        now, p = self.cell.part, placed(place, self.middle, self.cell.T_base_part[:3, :3])[:3, 3] / MM
        a = (now.a_deg + place[3] / DEG + 180.0) % 360.0 - 180.0
        return dict(zip(POSE_KEYS, (*np.round(p, 1).tolist(), round(float(a), 2), now.b_deg, now.c_deg), strict=True))

    def seen(self, keys: dict[str, float]) -> Float:
        """(4, 4) frame of the program in the base, where the part stands so; it is tilted with the working plane."""
        p, angles = [keys[k] * MM for k in POSE_KEYS[:3]], [keys[k] * DEG for k in POSE_KEYS[3:]]
        out: Float = pose.from_xyz_zyx(np.array(p), np.array(angles)) @ pose.inverse(self.part) @ self.cell.T_base_part
        return out


def region_of(wish: Wish, cell: Cell) -> Region:
    """The region that is searched.

    Raises:
        InputError: It is empty, or the robot has no closed-form geometry and no region is given.
    """
    angles = [a * DEG for a in wish.turned_deg]
    if wish.box_mm is None:
        opw = cell.controller_chain.opw
        if opw is None:
            raise InputError("the reach of this robot is not known", where=cell.label, hint="Give --region")
        usual = usual_region(opw)
        low, high = [*usual.low[:3], angles[0]], [*usual.high[:3], angles[1]]
    else:
        low, high = [*(v * MM for v in wish.box_mm[::2]), angles[0]], [*(v * MM for v in wish.box_mm[1::2]), angles[1]]
    for name, least, most, unit in zip(("x", "y", "z", "rotation"), low, high, (MM, MM, MM, DEG), strict=True):
        if least > most:
            raise InputError(
                f"the region is empty along {name}",
                value=f"{least / unit:g} to {most / unit:g}",
                limit="the least first",
                hint="Give --region X0,X1,Y0,Y1,Z0,Z1 and --turned A,B with the least before the largest",
            )
    return Region((low[0], low[1], low[2], low[3]), (high[0], high[1], high[2], high[3]))


def task_of(
    program: str | Path, cell: Cell, reading: Reading, surface: Surface, progress: Progress = silent
) -> tuple[Job, Cell, Task]:
    """A program with its load on its cell.

    Raises:
        CounterflexError: The program cannot be cut so, or cuts nothing.
    """
    if cell.tables.external_axes:
        raise InputError(
            "the place of a part in a cell with external axes is not searched",
            where=cell.label,
            value=", ".join(axis.name for axis in cell.tables.external_axes),
            hint="Compare values of the axes with plan posture, or leave the axes out of the cell file",
        )
    cell = in_working_plane(program, cell, reading)
    job = read_job(program, cell, reading=reading)
    setting, path = setting_of(cell), job.machined
    line: Int = job.line_of_motion[path.motion]
    with faults_in(job):
        cut = loaded_path(path, line, cell.stock(), setting, surface, progress)
        if not np.any(cut.weight_m > 0.0):
            raise InputError(
                "the program cuts nothing, so that no deflection tells one place from another",
                where=Path(job.program.name).name,
                hint="Check the blank (part.stock) and the program's zero",
            )
    return job, cell, Task(path, line, cut, setting, robot_of(cell, setting), surroundings_of(job, cell))


def middle_of(task: Task) -> Float:
    """(3,) m, middle of what is cut, in the frame of the program."""
    p = task.cut.p_part[task.cut.weight_m > 0.0]
    out: Float = 0.5 * (p.min(axis=0) + p.max(axis=0))
    return out


def placement_of(
    program: str | Path,
    cell: Cell,
    *,
    reading: Reading = AS_IT_IS,
    surface: Surface = "both",
    wish: Wish | None = None,
    count: int = CANDIDATES,
    progress: Progress = silent,
) -> Placed:
    """Choose the place of a program.

    Args:
        program: G-code file.
        cell: The cell; its present place is what the result is compared with.
        reading: How the program is read.
        surface: Which surface matters.
        wish: Where the part may stand.
        count: Candidates.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        CounterflexError: The program or the cell does not allow it.
        ReachError: No candidate can be run; says which constraint refused how many.
    """
    parts = in_parts(progress, {CUTTING: 2.0, SEARCHING: 6.0, CHOOSING: 4.0})
    region = region_of(Wish() if wish is None else wish, cell)
    parts[CUTTING](0.0)
    job, cell, task = task_of(program, cell, reading, surface, parts[CUTTING])
    frame, begin = _Frame(cell, middle_of(task)), time.perf_counter()
    site = site_of(task)
    judged = search(site, region, frame.middle, cell.T_base_part[:3, :3], count, progress=parts[SEARCHING])
    seconds = time.perf_counter() - begin
    parts[CHOOSING](0.0)
    with faults_in(job):
        keys, chosen = _best(task, frame, judged)
    alone, present = _here(task)
    progress(1.0)
    now = {key: float(getattr(cell.part, key)) for key in POSE_KEYS}
    rows = {"present": (now, present), "posture_alone": (now, alone), "chosen": (keys, chosen.best)}
    summary = {
        "program": job.program.name,
        "cell": cell.label,
        "robot": cell.robot.name,
        "surface": surface,
        **{name: None if what is None else {**place, **held_row(what, job)} for name, (place, what) in rows.items()},
        "reduction_percent": None
        if present is None or present.share_m == 0.0
        else round(100.0 * (1.0 - chosen.best.share_m / present.share_m), 1),
        "region": {"low": _shop(region.low), "high": _shop(region.high)},
        "candidates": len(judged.candidates),
        "refused": judged.refusals(),
        "pareto": len(pareto(_values(judged))),
        "poses": site.poses * len(judged.candidates),
        "search_s": round(seconds, 3),
        "counterflex": __version__,
    }
    return Placed(keys, chosen, judged, summary)


def _here(task: Task) -> tuple[Held | None, Held | None]:
    """Best posture in the present place, and the present posture; None where not possible."""
    try:
        chosen = choose(task, Freedom())
    except ReachError:
        try:
            return None, held(task, task.setting)
        except ReachError:
            return None, None
    return chosen.best, chosen.present


def _best(task: Task, frame: _Frame, judged: Judged) -> tuple[dict[str, float], Chosen]:
    """Choose the posture of the best places along the whole path, and the best of them.

    Raises:
        ReachError: None can be run.
    """
    done: list[tuple[dict[str, float], Chosen]] = []
    tried: list[Float] = []
    failed: ReachError | None = None
    for k in judged.by_deflection():
        place = judged.places[k]
        if any(_near(place, other) for other in tried):
            continue
        tried.append(place)
        keys = frame.keys(place)
        T = frame.seen(keys)
        there = replace(task, setting=replace(task.setting, T_base_part=T), robot=replace(task.robot, T_base_part=T))
        try:
            done.append((keys, choose(there, Freedom())))
        except ReachError as fault:
            failed = fault
        if len(done) == FINALISTS or len(tried) == 4 * FINALISTS:
            break
    if done:
        return min(done, key=lambda pair: pair[1].best.share_m)
    if failed is not None:
        raise failed
    refused = ", ".join(f"{count} {reason}" for reason, count in judged.refusals().items())
    raise ReachError(
        "the program can be run in none of the places that were tried",
        value=f"of {len(judged.candidates)} refused: {refused}",
        limit="every point in one posture within all limits",
        hint="Widen --region or --turned; the limits are [limits] of the cell file, bodies are [[cell.body]]",
    )


def _near(place: Float, other: Float) -> bool:
    """Whether two places are so close that one posture's worth tells the other's."""
    turn = abs((place[3] - other[3] + np.pi) % (2.0 * np.pi) - np.pi)
    return bool(np.linalg.norm(place[:3] - other[:3]) < _APART_M and turn < _APART_RAD)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    mounting: Mounting | None = None,
    progress: Progress = silent,
    **options: Any,
) -> dict[str, Any]:
    """Write ``cell.toml`` with the chosen place, ``candidates.csv`` and ``summary.json`` into ``out``: all or none.

    Args:
        program: G-code file.
        cell_file: Cell file.
        out: Folder; made when missing.
        mounting: Angles of the spindle to choose from; every one costs a search. None: it stays as it is.
        progress: Progress callback, fraction 0 to 1.
        options: As for :func:`placement_of`.

    Returns:
        The summary.
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
        text = text_with_place(cell.path, done.pose, best.branch, best.rotation_rad / DEG, Path(out), mounted)
        atomic.write_text(staging / "cell.toml", text)
        atomic.write_text(staging / TABLE, _table(done.judged))
        write_summary(staging / "summary.json", done.summary)
    return done.summary


def _best_mounting(
    program: str | Path, cell: Cell, mounting: Mounting, progress: Progress, options: Mapping[str, Any]
) -> tuple[Placed, float]:
    """The best place of the best angle, and that angle in deg; the summary has all angles.

    Raises:
        ReachError: No angle lets the program be run.
    """
    present = mounting.present_deg(cell)
    angles = list(dict.fromkeys([present, *mounting.values_deg]))
    parts = in_parts(progress, {str(angle): 1.0 for angle in angles})
    done: dict[float, Placed] = {}
    rows: list[dict[str, Any]] = []
    last: ReachError | None = None
    for angle in angles:
        row: dict[str, Any] = {"angle_deg": angle, "deflection_um": None, "refused": ""}
        try:
            placed = placement_of(program, mounting.cell(cell, angle), progress=parts[str(angle)], **options)
        except ReachError as fault:
            last, row["refused"] = fault, fault.value or fault.what
        else:
            done[angle] = placed
            row["deflection_um"] = placed.summary["chosen"]["deflection_um"]
        rows.append(row)
    if not done:
        assert last is not None
        raise last
    angle, best = min(done.items(), key=lambda pair: pair[1].chosen.best.share_m)
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


def _shop(bounds: tuple[float, float, float, float]) -> list[float]:
    """x, y, z in mm and a rotation in deg."""
    return [*(round(v / MM, 1) for v in bounds[:3]), round(bounds[3] / DEG, 2)]


def _values(judged: Judged) -> Float:
    """(n, 3) deflection, time and margin, each to be small."""
    return np.array([[c.deflection_m, c.time_s, -c.margin_rad] for c in judged.candidates])


def _table(judged: Judged) -> str:
    """All candidates, one a row."""
    text, front = io.StringIO(), set(pareto(_values(judged)).tolist())
    rows = csv.writer(text, lineterminator="\n")
    head = ["x_mm", "y_mm", "z_mm", "turned_deg", "refused", "reached_percent", "deflection_um", "time_s", "margin_deg"]
    rows.writerow([*head, "branch", "rotation_about_tool_deg", "pareto"])
    for k, (place, c) in enumerate(zip(judged.places, judged.candidates, strict=True)):
        x, y, z, turned = place / [MM, MM, MM, DEG]
        worth = ["", "", "", "", ""]
        if not c.refused:
            worth = [f"{c.deflection_m / UM:.2f}", f"{c.time_s:.2f}", f"{c.margin_rad / DEG:.2f}", c.branch]
            worth.append(f"{c.rotation_rad / DEG:g}")
        first = [f"{x:.1f}", f"{y:.1f}", f"{z:.1f}", f"{turned:.2f}", c.refused, f"{100.0 * c.passed:.1f}"]
        rows.writerow([*first, *worth, "yes" if k in front else ""])
    return text.getvalue()
