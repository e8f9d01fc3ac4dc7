"""The job ``correct``: measured parts in, the program for the next part out, and what explains them.

read (program, plan, scans, history) -> which stretch made which place (``evaluate.path_error.contacts``) -> error of
the path (``estimate``) -> next step (``learning``) -> plan (``plan.measured_correction``) -> write.
"""

from __future__ import annotations

import datetime
import json
import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.compensation.languages import write
from counterflex.app.compensation.prediction import summary_of
from counterflex.app.correction.causes import Known, shown
from counterflex.app.correction.decide import LIMIT_M, measured_error, next_step
from counterflex.app.correction.scans import Corrected, MeasuredScan, PartScan
from counterflex.app.cost_of_unknown_stiffness import assumed
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, in_plane_of, read_in_plane, setting_of
from counterflex.app.plan_of_cell import require_of_cell
from counterflex.app.robot_programs import inputs_of, with_files
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary, Warned, fill
from counterflex.core.units import UM
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.evaluate.path_error.band_solver import Observations
from counterflex.evaluate.path_error.contacts import Nodes, nodes_of
from counterflex.evaluate.path_error.explanations import ALIKE, explanations
from counterflex.evaluate.path_error.learning import MeasuredError, expected
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.update import new_file, require_new
from counterflex.files.part_deviations import MeasuredPart, read_path_error, write_part_deviations, write_path_error
from counterflex.files.plan_file import CLASS_ASSUMED, WORKING_PLANE, read_plan, write_plan
from counterflex.files.summary_file import read_summary, write_folder_summary
from counterflex.path.toolpath import FEED
from counterflex.plan.feed_schedule import at_feed, share_between
from counterflex.plan.inputs import CompensationInputs
from counterflex.plan.plan import Plan
from counterflex.plan.static_correction import LoadedRobot, loaded_robot
from counterflex.plan.undisturbed_cut import undisturbed_cut
from counterflex.report import correction_page as page


def correction_page(result: Corrected) -> str:
    """The page, as HTML text."""
    nodes, last = result.measured[-1].estimate.nodes, result.measured[-1].estimate
    begin = np.diff(nodes.chain, prepend=-1) != 0
    way = np.cumsum(np.where(begin, 0.0, np.diff(nodes.station_m, prepend=0.0)))
    data = page.CorrectionData(
        title=f"{result.summary['program']}, corrected from {len(result.summary['correct']['parts'])} part(s)",
        subtitle=f"on {result.cell.name}",
        created=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        summary=result.summary["correct"],
        way_m=way,
        error_m=page.broken(last.error_m, nodes.chain),
        sigma_m=last.sigma_m,
        change_m=page.broken(result.change_m[nodes.row], nodes.chain),
    )
    return data.page()


PARTS: Final = "parts"
ERROR, SCAN, FACTS = "path-error.parquet", "deviations.parquet", "part.json"
_INCOMPLETE: Final = "Copy the folder of the plan again, or write it again with counterflex correct"


@dataclass(frozen=True, eq=False)
class HistoryPart:
    """A part of the history."""

    error: MeasuredError
    facts: dict[str, Any]


def read_parts(plan_folder: Path) -> list[HistoryPart]:
    """Parts that a plan was corrected from, in their order; none for a plan of ``compensate``.

    Raises:
        FileFormatError: A part is not complete.
    """
    out = []
    for folder in sorted((plan_folder / PARTS).glob("[0-9]*")):
        error, _ = read_path_error(folder / ERROR)
        facts = file_content.json_value(folder / FACTS, hint=_INCOMPLETE)
        out.append(HistoryPart(error, facts))
    return out


def keep_parts(
    plan_folder: Path, out: Path, new: list[tuple[PartDeviations, MeasuredPart, HistoryPart]], about: dict[str, Any]
) -> None:
    """Write the history of the next program: that of the plan, and the new parts."""
    target, count = out / PARTS, 0
    target.mkdir()
    for folder in sorted((plan_folder / PARTS).glob("[0-9]*")):
        shutil.copytree(folder, target / folder.name)
        count += 1
    for number, (deviations, measured, part) in enumerate(new, count + 1):
        folder = target / f"{number:03d}"
        folder.mkdir()
        write_part_deviations(folder / SCAN, deviations, measured)
        write_path_error(folder / ERROR, part.error, about)
        atomic.write_text(folder / FACTS, json.dumps(part.facts, indent=2) + "\n")


def trend(parts: list[HistoryPart]) -> list[dict[str, Any]]:
    """A row for each part: its figures, and how far what it asks for is from what the parts before it asked for."""
    rows: list[dict[str, Any]] = []
    for number, part in enumerate(parts, 1):
        row = {"part": number, **part.facts}
        if number > 1:
            before = parts[number - 2].error
            both = part.error.seen & before.seen
            if np.any(both):
                change = (part.error.taken_m + part.error.error_m - before.taken_m - before.error_m)[both]
                sigma = np.hypot(part.error.sigma_m, before.sigma_m)[both]
                row["changed_um"] = round(float(np.sqrt(np.mean(change**2))) / UM, 1)
                row["changed_sigmas"] = round(float(np.sqrt(np.mean((change / sigma) ** 2))), 1)
        rows.append(row)
    return rows


PLAN, SUMMARY, TAKEN = "plan.parquet", "summary.json", "path-error.parquet"
_SAME_M: Final = 1e-8
READING, FINDING, PLANNING, EXPLAINING = "reading the scans", "error of the path", "planning", "explaining"
WORK: Final = {READING: 1.0, FINDING: 5.0, PLANNING: 2.0, EXPLAINING: 4.0}


def _require_one_direction(job: Job, cell: Cell) -> None:
    fed = job.path.kind == FEED
    if np.any(job.path.axis_part[fed, 2] < np.cos(cell.tables.limits.limits.rotation_rad)):
        raise InputError(
            "the tool turns in the cut, and attribution knows one direction of the tool only",
            where=Path(job.program.name).name,
            hint="Correct programs with one direction of the tool each",
        )


def correct(
    program: Path,
    cell: Cell,
    plan_folder: Path,
    scans: list[Path],
    *,
    reading: Reading = AS_IT_IS,
    limit_m: float = LIMIT_M,
    progress: Progress = silent,
) -> Corrected:
    """Correct the program of the next part.

    Args:
        plan_folder: Of ``compensate`` or of an earlier ``correct``: the program that the measured parts were made by.
        limit_m: Largest change of a correction.

    Raises:
        CounterflexError: Files do not fit together, or a limit is exceeded; one line says what and where.
    """
    if not scans:
        raise InputError("no measured part is given", where="--scan")
    begin, parts = time.perf_counter(), in_parts(progress, WORK)
    parts[READING](0.0)
    cell, job = read_in_plane(program, cell, reading=reading)
    _require_one_direction(job, cell)
    plan = _read_plan(plan_folder, job, cell)
    language = str(read_summary(plan_folder / SUMMARY).get("language", "gcode"))
    history, taken = read_parts(plan_folder), _taken(plan_folder, plan)
    setting = setting_of(cell, orientation=bool(np.any(plan.rotvec_part)), part_may_be_held=True)
    with faults_in(job):
        inputs = CompensationInputs(plan.path, plan.line, cell.stock(), setting, plan.q)
        loaded = loaded_robot(inputs, undisturbed_cut(inputs, silent))
    nodes = nodes_of(plan.path, plan.deflection_part[:, :3])
    measured = []
    for number, path in enumerate(scans):
        scan = PartScan.read(path, program, job, cell, number)
        own = in_parts(parts[FINDING], {str(path): 1.0 for path in scans})[str(path)]
        measured.append(measured_error(scan, plan, nodes, cell, taken, own))
    parts[PLANNING](0.0)
    with faults_in(job):
        step = next_step(plan, loaded, [*(part.error for part in history), *(one.error for one in measured)], limit_m)
    next_plan, further, state = step.plan, step.further_m, step.state
    parts[EXPLAINING](0.0)
    last = measured[-1].estimate
    known = Known.of(plan, cell, nodes.row)
    bent = np.linalg.norm(plan.deflection_part[loaded.cut.contact, :3], axis=1)
    size = max(float(np.sqrt(np.mean(bent**2))) if len(bent) else 0.0, UM)
    weighed = explanations(
        _in_all(last.observed, taken[nodes.row]), nodes, last.prior, size, known.causes, known.together
    )
    files, facts = write(job, next_plan, cell, language)
    summary = summary_of(job, next_plan, cell, language, files=files, written=facts, tolerance_m=5.0 * UM)
    change = next_plan.correction_part - plan.correction_part
    new_parts = [HistoryPart(one.error, one.facts()) for one in measured]
    ahead = step.next_error_m[nodes.row] - measured[-1].error.error_m[nodes.row]
    prediction = expected(last, measured[-1].contacts, ahead, step.unsure_m[:, nodes.row], state.scatter_m)
    summary |= in_plane_of(cell)
    summary["job"] = "correct"
    summary["correct"] = {
        "parts": trend([*history, *new_parts]),
        "between_parts_um": None if np.isnan(state.between_m) else round(state.between_m / UM, 1),
        "scatter_um": round(state.scatter_m / UM, 1),
        "change_um": round(float(np.max(np.linalg.norm(change, axis=1))) / UM, 1),
        "changed": bool(np.any(further)),
        "expected": prediction.shown(),
        "not_seen": _not_seen(measured, plan, loaded, nodes),
        "explanations": shown(weighed),
        "alike": [e.name for e in weighed if weighed[0].log_evidence - e.log_evidence < ALIKE],
    }
    summary = with_files(summary, job.program)
    summary |= {"seconds": round(time.perf_counter() - begin, 3), "counterflex": __version__}
    progress(1.0)
    return Corrected(
        next_plan, files, job.program.encoding, measured, state, step.taken, weighed, job, cell, change, summary
    )


def _stands_on_class(folder: Path) -> bool:
    """Return whether a plan took the median of the robot's class for its stiffness: the next one does so too."""
    return (folder / PLAN).is_file() and bool(read_plan(folder / PLAN)[1].get(CLASS_ASSUMED, False))


def _read_plan(folder: Path, job: Job, cell: Cell) -> Plan:
    """A plan on the program's own path, at the plan's feed."""
    if not (folder / PLAN).is_file():
        raise FileFormatError(
            "no plan in this folder", where=str(folder), limit=f"{PLAN} of counterflex compensate or correct"
        )
    plan, about = read_plan(folder / PLAN)
    path = job.path
    if len(plan.path) != len(path) or np.max(np.abs(plan.path.p_part_tcp - path.p_part_tcp)) > _SAME_M:
        raise InputError(
            "the plan is of another program",
            where=str(folder / PLAN),
            value=f"{about.get('program', '')}, {len(plan.path)} points",
            limit=f"{Path(job.program.name).name}, {len(path)} points",
        )
    require_of_cell(plan, about, cell, folder / PLAN)
    share = share_between(path, plan.path)
    share = np.where(np.abs(share - 1.0) < 1e-9, 1.0, share)
    return replace(plan, path=path if np.all(share == 1.0) else at_feed(path, share))


def _taken(folder: Path, plan: Plan) -> Float:
    """(n, 3) m, what the plan takes back because of earlier parts."""
    if plan.measured_part is None:
        return np.zeros((len(plan.path), 3))
    error, _ = read_path_error(folder / TAKEN)
    if len(error.taken_m) != len(plan.path):
        raise FileFormatError("the file does not belong to the plan beside it", where=str(folder / TAKEN))
    return error.taken_m


def _in_all(seen: Observations, taken: Float) -> Observations:
    """Places as they would be had nothing been taken back because of earlier parts; ``taken`` (k, 3) m at the nodes."""
    begin, end = taken[seen.node - 1], taken[seen.node]
    return replace(seen, y_m=seen.y_m + np.sum(seen.normal * (begin + seen.share[:, None] * (end - begin)), axis=1))


def _not_seen(measured: list[MeasuredScan], plan: Plan, loaded: LoadedRobot, nodes: Nodes) -> dict[str, Any]:
    """Return how much of the cut no surface shows: overrun by a later or deeper pass, or cut in air."""
    contact = loaded.cut.contact
    shown_rows = (
        nodes.at_rows(
            np.any([m.estimate.seen for m in measured], axis=0).astype(np.float64),
            plan.path,
            np.ones(len(nodes), dtype=np.bool_),
        )
        > 0.5
    )
    step = np.linalg.norm(np.diff(plan.path.p_part_tcp, axis=0, prepend=plan.path.p_part_tcp[:1]), axis=1)
    length = float(np.sum(step[contact])) or 1.0
    hidden = contact & ~np.any(shown_rows, axis=1)
    lines = sorted(set(plan.line[hidden].tolist()))
    return {
        "of_cut_percent": round(100.0 * float(np.sum(step[hidden])) / length, 1),
        "lines": lines[:8],
        "by_direction_percent": {
            axis: round(100.0 * float(np.sum(step[contact & ~shown_rows[:, k]])) / length, 1)
            for k, axis in enumerate("xyz")
        },
    }


_SHOWN: Final = 6  # Explanations that the prompt lists


class Correction(Summary):
    """Correction of the next part, and what explains it."""

    def _shown(self) -> Parts:
        values = self["correct"]
        parts = [one | {"error": "believed" if one["believed"] else "noise only"} for one in values["parts"]]
        columns = "part | measured in=source | places | noise um:g | surface 99.7 % um=surface_p997_um:g | error | "
        yield ShownTable.of(f"Parts of {self['program']}", columns + "changed um=changed_um?:g", parts)
        factor = "{name} {value:+g} +- {standard_deviation:g} {unit}"
        rows = [
            one | {"causes": "; ".join(fill(factor, cause) for cause in one["factors"])}
            for one in values["explanations"][:_SHOWN]
        ]
        columns = "explanation | log evidence:g | explained={explained_percent:g} % | factors=causes"
        yield ShownTable.of("What explains it", columns, rows)
        if len(values["alike"]) > 1:
            yield f"not to be told apart by this part: {'; '.join(values['alike'])}"
        if values["not_seen"]["of_cut_percent"] > 0.0:
            yield self.line(
                "no surface shows {correct[not_seen][of_cut_percent]:g} % of the cut: run over later, or cut in air"
            )
        if values["changed"]:
            yield fill(
                "largest change of the correction {change_um:g} um; surface, 99.7 %: {expected[now_p997_um]:g} um now, "
                "{expected[next_p997_um]:g} um ({expected[next_5_percent_um]:g} to "
                "{expected[next_95_percent_um]:g}) expected",
                values,
            )
        else:
            yield "the parts show nothing but noise, or less than 5 um: the program stays as it is"
        if "stiffness" in self.get("assumed", {}):
            yield Warned(f"the stiffness of axes is assumed, as in the plan: {self['assumed']['stiffness']['from']}")
        if "applied" in self:
            yield self.line("wrote {applied[cell]}: {applied[explanation]}")


def run(
    program: str | Path,
    cell_file: str | Path,
    plan_folder: str | Path,
    scans: list[Path],
    out: str | Path,
    *,
    apply: str | Path | None = None,
    report: bool = True,
    progress: Progress = silent,
    **options: Any,
) -> Correction:
    """Write the program, ``plan.parquet``, ``path-error.parquet``, ``parts/``, ``summary.json`` and ``report.html``.

    All of them or none. With ``apply`` the likeliest constants go into a new cell file.

    Args:
        plan_folder: Of ``compensate`` or ``correct``.
        apply: New cell file, or None.
    """
    folder = Path(plan_folder)
    cell = read_cell(cell_file, assume_class=_stands_on_class(folder))
    target = None if apply is None else Path(apply)
    if target is not None:
        require_new(target, cell.path)
    with new_file(target) as place, atomic.atomic_folder(out) as staging:
        result = correct(Path(program), cell, folder, scans, progress=progress, **options)
        summary = result.summary
        summary["inputs"] = inputs_of(program, cell_file)
        summary |= assumed(cell)
        if target is not None and place is not None:
            from counterflex.app.correction.causes import apply_constants

            summary["applied"] = apply_constants(result, cell, target, place, scans)
        about = {key: summary[key] for key in ("program", "cell", "robot", "counterflex")}
        about |= {} if cell.class_stiffness is None else {CLASS_ASSUMED: True}
        about |= {key: summary[key] for key in (WORKING_PLANE,) if key in summary}
        lowered = summary["calm_feed"]["extra_s"]
        for name, text in result.files.items():
            atomic.write_bytes(staging / name, text.encode(result.encoding, errors="replace"))
        write_plan(staging / PLAN, result.plan, {**about, "feed_lowered_s": lowered}, cell.chain.axes)
        write_path_error(staging / TAKEN, result.taken, about)
        new = [
            (m.scan.deviations.turned(result.cell.R_part_plane), m.scan.part, HistoryPart(m.error, m.facts()))
            for m in result.measured
        ]
        keep_parts(folder, staging, new, about)
        write_folder_summary(staging, summary)
        if report:
            from counterflex.report.page import write_page

            write_page(correction_page(result), staging / "report.html")
    return Correction(summary)
