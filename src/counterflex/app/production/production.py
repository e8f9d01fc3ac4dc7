"""The job ``identify production``: run logs and their plans in, constants and the drift of the tool out.

read (logs, plans, history) -> maps of the plan -> place and delay -> steady stretches -> constants (``find``) -> factor
of each run -> drift -> write. Nothing goes into a cell file but with ``apply``.
"""

from __future__ import annotations

import datetime
import hashlib
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.identification.cell_model import Setting, model_of, settings_of
from counterflex.app.plan_of_cell import require_of_cell
from counterflex.app.production.history import KeptRun, keep_runs, read_history, require_alike, require_unchanged
from counterflex.app.production.result import Produced, identification_of, result_of
from counterflex.app.production.runs import LoggedRun, planned_cut, read_runs
from counterflex.app.unknowns import IDENTIFIED
from counterflex.core import atomic, file_content, held as file_lock
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, ModelError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import MM, N_PER_MM, plain
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.monitor import feed_exponent
from counterflex.files.cell.update import new_file, require_new, updated_text, write_new
from counterflex.files.identification_file import parameter_rows, write_identification
from counterflex.files.plan_file import read_plan
from counterflex.files.shop_unit import unit_of_name
from counterflex.identify.cutting.considered import CROSS_TALK, RUNOUT_M, SCALE, SensorAccuracy
from counterflex.identify.cutting.force_forms import NAMES
from counterflex.identify.cutting.steady_cuts import Cutting
from counterflex.identify.data.model import CellModel
from counterflex.identify.production import TITLE
from counterflex.identify.production.alignment import PlannedCut
from counterflex.identify.production.constants import ConstantEstimate, find, reference_m
from counterflex.identify.production.drift import ForceDrift, RunFactor, drift, run_factor
from counterflex.identify.production.residuals import TOP_SIGMA_M, ProductionResiduals, geometry_of
from counterflex.identify.production.stretches import joined, stretches_of
from counterflex.identify.recipe import Identification
from counterflex.runtime.monitoring.plan import lost_tooth


def apply_constants(
    p: Produced, identification: Identification, target: Path, place: Path, date: str
) -> dict[str, Any]:
    """Write a cell file with the constants found.

    ``place``: Where it is written until the results are complete. Raises InputError: the target is the cell file or any
    file that is there. Raises ModelError: nothing is proposed, or the new cell is no possible one.
    """
    require_new(target, p.cell.path)
    mean, before = p.estimate.held_out.mean()
    if not p.is_proposed:
        raise ModelError(
            "the runs give no reason to change the constants; nothing was written",
            value=f"probability of the difference {p.estimate.difference.chance:.2g}, error on stretches held out "
            f"{100 * mean:.2f} % (before {100 * before:.2f} %)",
            limit="below 0.01, and a smaller error than before",
            hint="Leave --apply out, or give more runs",
        )
    names = [kept.facts["run"] for kept in p.runs]
    entry = IdentifiedTable(
        recipe="production",
        date=date,
        data=tuple(names),
        data_sha256=tuple(kept.facts["sha256"] for kept in p.runs),
        counterflex=__version__,
        holdout=f"mean error of the mean force held out: {100 * mean:.4g} % ({100 * before:.4g} % before), "
        + ("on whole runs in turn" if len(p.runs) >= 3 else "on parts of the runs in turn"),
        values=tuple(
            IdentifiedValue(
                name=row["name"], value=row["value"], sigma=row["sigma"], unit=row["unit"], seen=row["seen"]
            )
            for row in parameter_rows(p.estimate.fit)
            if row["free"] and row["name"] in NAMES
        ),
    )
    text = updated_text(p.cell, identification.changes, entry, target.parent)
    write_new(text, target, place, "what the runs show")
    return {"cell": target.name, "constants": p.estimate.level}


RECIPES: Final = ("cutting", "production")


def known_constants(cell: Cell) -> dict[str, float]:
    """Standard deviations of identified constants by name, for the weight of the stated values.

    Of k relative, of m as it is, of e in N/m; to those of k :data:`IDENTIFIED` is added, what another edge, blank or
    day makes of an identified constant. Empty with handbook constants.
    """
    entry = next((e for e in reversed(cell.tables.identified) if e.recipe in RECIPES), None)
    out: dict[str, float] = {}
    for one in () if entry is None else entry.values:
        if one.name in NAMES[:3] and one.value != 0.0:
            out[one.name] = math.hypot(one.sigma / abs(one.value), IDENTIFIED)
        elif one.name in NAMES[3:6]:
            out[one.name] = max(one.sigma, 1e-3)
        elif one.name in NAMES[6:]:
            out[one.name] = max(one.sigma * N_PER_MM if one.unit == "N/mm" else one.sigma, 1.0)
    return out


RESULT, REPORT = "result.json", "report.html"
NAME: Final = "production"
SETTINGS: Final[dict[str, Setting]] = {
    "tool": 0,
    "constants": "auto",
    "new_tool": False,
    "wear_limit": 0.3,
    "trim_diameters": 0.6,
    "settle_s": 0.15,
    "top_sigma_m": TOP_SIGMA_M,
    "runout_sigma_m": RUNOUT_M,
    "force_scale_sigma": SCALE,
    "force_cross_talk_sigma": CROSS_TALK,
}
READING, FITTING, WRITING = "reading the runs", "finding constants", "writing the results"
WORK: Final = {READING: 3.0, FITTING: 5.0, WRITING: 1.0}
_RANGES: Final = {
    "wear_limit": (0.01, 3.0),
    "trim_diameters": (0.0, 10.0),
    "settle_s": (0.0, 5.0),
    "top_sigma_m": (1e-6, 5e-3),
    "runout_sigma_m": (0.0, 1e-4),
    "force_scale_sigma": (0.0, 0.5),
    "force_cross_talk_sigma": (0.0, 0.5),
}


def checked_settings(values: Mapping[str, Setting], seed: int) -> dict[str, Any]:
    """Settings with defaults. Raises InputError: an unknown key, a wrong kind, or out of range."""
    out = settings_of(NAME, SETTINGS, values, seed)
    for key, (low, high) in _RANGES.items():
        if not low <= out[key] <= high:
            raise InputError(
                "the setting is out of range",
                where=f"--set {key}={out[key]}",
                value=out[key],
                limit=f"{low:g} .. {high:g}",
            )
    return out


_WEAR_WORDS = {
    "beyond": "worn beyond its limit",
    "at": "perhaps beyond its limit",
    "within": "within its limit",
    "unknown": "not known",
}


class ProductionResult(Summary):
    """Constants of tool and material, and the runs with the factor of each."""

    def _shown(self) -> Parts:
        figures = [one | {"unit": unit_of_name(one["name"])} for one in (*self["headline"], *self["figures"])]
        title = self.line("Production with T{tool} in {material}: {cell}")
        yield ShownTable.of(title, "figure=text | found=value:D4 | stated=nominal:D4 | unit", figures)
        yield self.rows(
            "runs",
            f"Force over the life of the tool: {_WEAR_WORDS[self['wear']]}",
            "run | edge={edge}{new_edge: new: %s} | cut by it m=edge_cut_m:.3f | removed cm3=edge_removed_cm3:.2f | "
            "force=factor:.4f | standard deviation=factor_sigma:.4f | event | "
            "delay ms={delay_ms:g} +- {delay_sigma_ms:g}",
        )
        yield from self.each("remarks", "note: {}")
        if "applied" in self:
            runs = ", ".join(row["run"] for row in self["runs"][:4])
            yield f"wrote {self['applied']['cell']}: constants of {runs}"


def run(
    folders: Sequence[Path],
    cell_file: Path,
    plans: Sequence[Path],
    out: Path,
    *,
    settings: Mapping[str, Setting] | None = None,
    seed: int = 0,
    apply: Path | None = None,
    progress: Progress = silent,
) -> ProductionResult:
    """Write ``result.json``, ``report.html`` and the new runs in ``runs/``: all of them or none.

    Args:
        folders: Run logs; all runs of each.
        plans: Plan files of the runs.
        out: Folder; runs that it has from before go in.
        settings: Those that differ from :data:`SETTINGS`.
        apply: New cell file with the constants, or None.

    Returns:
        Content of ``result.json``.

    Raises:
        CounterflexError: Files do not fit together, or say too little; one line says what and where.
    """
    begin, parts = time.perf_counter(), in_parts(progress, WORK)
    options = checked_settings(settings or {}, seed)
    cell = read_cell(cell_file)
    cell.require_milling()
    parts[READING](0.0)
    produced = produce(folders, cell, plans, out, options, parts[READING], parts[FITTING])
    parts[WRITING](0.0)
    date = datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    identification = identification_of(produced)
    result = ProductionResult(result_of(produced, identification, date))
    with new_file(apply) as place, file_lock.alone(out), atomic.atomic_folder(out) as staging:
        require_unchanged(out, len(produced.runs) - len(produced.new))
        if apply is not None and place is not None:
            result["applied"] = apply_constants(produced, identification, apply, place, date)
        result["seconds"] = round(time.perf_counter() - begin, 3)
        write_identification(staging / RESULT, result)
        keep_runs(staging, len(produced.runs) - len(produced.new) + 1, list(produced.new))
        from counterflex.report.identification_page import identification_page
        from counterflex.report.page import write_page

        write_page(identification_page(identification, result), staging / REPORT)
    progress(1.0)
    return result


def produce(
    folders: Sequence[Path],
    cell: Cell,
    plans: Sequence[Path],
    out: Path,
    options: Mapping[str, Any],
    reading: Progress = silent,
    fitting: Progress = silent,
) -> Produced:
    """Find constants and drift; see :func:`run`. Nothing is written."""
    model = model_of(cell)
    material = cell.material.name or str(cell.material.catalog or "material")
    history = read_history(out)
    logged = sorted((one for folder in folders for one in read_runs(folder)), key=lambda one: one.begun_s)
    digests = {plan: hashlib.sha256(file_content.content(plan)).hexdigest() for plan in plans}
    known = {kept.facts["sha256"] for kept in history}
    remarks: list[str] = []
    new: list[KeptRun] = []
    cuts: dict[tuple[Path, bool], PlannedCut] = {}
    tool = int(options["tool"])
    for number, one in enumerate(logged):
        reading(number / max(len(logged), 1), one.record.name)
        if one.sha256 in known:
            remarks.append(f"{one.record.name} is in the history already and is not taken twice")
            continue
        known.add(one.sha256)
        plan_file = one.plan_among(plans, digests)
        key = (plan_file, one.compensated)
        if key not in cuts:
            plan, about = read_plan(plan_file)
            require_of_cell(plan, about, cell, plan_file)
            cuts[key] = planned_cut(plan, about, cell, plan_file, compensated=one.compensated)
        tool = _tool(tool, cuts[key], plan_file)
        require_alike(history, tool, material, cell.chain.name, out)
        is_new = bool(options["new_tool"]) and not new
        new.append(_taken(one, cuts[key], model, tool, material, plan_file, digests[plan_file], is_new, options))
        if one.cell_sha256 and one.cell_sha256 != hashlib.sha256(file_content.content(cell.path)).hexdigest():
            remarks.append(
                f"{one.record.name} was made with another state of the cell file: the weight behind its sensor was "
                "taken off as identified then; the zero is that of its own air cuts"
            )
    runs = sorted([*history, *new], key=lambda kept: kept.facts["begun_s"])
    if not runs:
        raise InputError("no run is given and the history is empty", where=str(out))
    tool = int(runs[0].facts["tool"])
    estimate, factors, grown = _estimated(runs, model, cell, tool, options, fitting)
    return Produced(
        cell, model, tool, material, runs, new, estimate, factors, grown, known_constants(cell), dict(options),
        tuple(remarks), tuple(plans), TITLE,
    )  # fmt: skip


def _tool(tool: int, plan: PlannedCut, where: Path) -> int:
    numbers = sorted(set(plan.tool[plan.cutting].tolist()))
    if tool and tool not in numbers:
        raise InputError(
            "the plan does not cut with this tool",
            where=str(where),
            value=f"T{tool}",
            limit=", ".join(f"T{n}" for n in numbers),
        )
    if not tool and len(numbers) != 1:
        raise InputError(
            "the plan cuts with several tools; constants and wear are those of one",
            where=str(where),
            value=", ".join(f"T{n}" for n in numbers),
            hint=f"Choose one: --set tool={numbers[0]}",
        )
    return tool or int(numbers[0])


def _taken(
    one: LoggedRun,
    plan: PlannedCut,
    model: CellModel,
    tool: int,
    material: str,
    plan_file: Path,
    digest: str,
    is_new: bool,
    options: Mapping[str, Any],
) -> KeptRun:
    at = one.record.aligned(plan)
    choice = Cutting(float(options["trim_diameters"]), float(options["settle_s"]))
    result = stretches_of(model, one.record, plan, at, tool, choice)
    facts = {
        "run": one.record.name,
        "sha256": one.sha256,
        "plan": plan_file.name,
        "plan_sha256": digest,
        "tool": tool,
        "material": material,
        "robot": model.robot.name,
        "begun_s": one.begun_s,
        "compensated": one.compensated,
        "new_tool": is_new,
        "stretches": len(result.stretches),
        "contacts": len(np.unique(result.stretches.cut)),
        "cut_mm": round(result.cut_m / MM, 3),
        "removed_cm3": round(result.volume_m3 * 1e6, 4),
        "contact_s": round(result.contact_s, 3),
        **plain(at, "delay_ms:2 delay_sigma_ms:2 edges"),
        **result.shown(),
    }
    return KeptRun(result.stretches, facts)


def _estimated(
    runs: Sequence[KeptRun], model: CellModel, cell: Cell, tool: int, options: Mapping[str, Any], progress: Progress
) -> tuple[ConstantEstimate, list[RunFactor], ForceDrift]:
    """Constants as in the first run, the factor of each run, the drift; changes are out of the constants."""
    every = joined([kept.stretches for kept in runs])
    number: Int = np.repeat(np.arange(len(runs)), [len(kept.stretches) for kept in runs])
    geometry = geometry_of(every, number, float(options["top_sigma_m"]))
    cutter = model.cutter_of(tool)
    length: Float = np.array([kept.facts["cut_mm"] * MM for kept in runs])
    is_new = np.array([bool(kept.facts["new_tool"]) for kept in runs])
    sensor = SensorAccuracy(float(options["force_scale_sigma"]), float(options["force_cross_talk_sigma"]))
    known, growth, growth_sigma = known_constants(cell), np.ones(len(every)), np.zeros(len(every))
    for turn in range(2):
        block = ProductionResiduals(every, geometry, cutter, MM, every.cut, growth)
        block.h_ref_m = reference_m(block)[0]
        estimate = find(
            block,
            model.force_law,
            known,
            run=number,
            level=str(options["constants"]),
            sensor=sensor,
            runout_m=float(options["runout_sigma_m"]),
            growth_sigma=growth_sigma,
            seed=int(options["seed"]),
        )
        progress(0.5 * (turn + 1), "constants")
        factors = [run_factor(block.subset(number == r), estimate.fit.values) for r in range(len(runs))]
        exponent = feed_exponent(model.force_law, block.h_ref_m)
        lost = float(lost_tooth(np.array([cutter.flutes]), exponent)[0]) if cutter.flutes > 1 else 0.0
        grown = drift(factors, length, is_new, lost)
        if not grown.is_significant or turn:
            break
        growth, growth_sigma = grown.force[number], grown.force_sigma[number]
    return estimate, factors, grown
