"""The job ``quote``: probability that each feature of a part keeps its tolerance, and what raises it most.

read -> plan (as ``compensate``) -> errors of the path over the cells that this one may be (``path_errors``) -> part of
each (``drawn_part``) -> features (``probability``) -> remedies (``remedies``).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.cost_of_unknown_stiffness import assumed, require_stiffness_for
from counterflex.app.inputs import AS_IT_IS, Reading, faults_in, read_in_plane, setting_of
from counterflex.app.inspection.judging import nominal_of
from counterflex.app.quote.path_errors import path_errors, points_of
from counterflex.app.quote.probability import DrawnFeature, Quoted, QuotedPart, Share
from counterflex.app.quote.remedies import Remedy, Today, remedies
from counterflex.app.robot_programs import inputs_of
from counterflex.app.unknowns import sources
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, Summary
from counterflex.core.units import MM, plain
from counterflex.evaluate.inspection.cad_rows import CadFeatures
from counterflex.evaluate.inspection.mesh_shape import CadSolid
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.small_table import read_tolerances
from counterflex.files.step_file import ENDINGS
from counterflex.files.summary_file import write_folder_summary
from counterflex.plan.compensate import plan as make_plan
from counterflex.programs.compensated import refuse_compensated
from counterflex.report.data import Head
from counterflex.report.figure_data import numbers
from counterflex.report.page import render

_SPAN = 3.0  # Deviations are shown up to this many tolerances; what is further off counts at the ends


def _figure(features: Sequence[Mapping[str, Any]], off_mm: Sequence[Float]) -> dict[str, Any]:
    """Deviation of each feature over the drawn cells, in its tolerances: between the lines it holds."""
    data = []
    for feature, off in zip(features, off_mm, strict=True):
        share = np.clip(off / feature["tolerance_mm"], -_SPAN, _SPAN)
        name = f"{feature['quantity']} of {feature['feature']}"
        data.append(
            {
                "type": "box",
                "x": numbers(np.quantile(share, np.linspace(0.0, 1.0, 101)), 3),
                "name": name,
                "boxpoints": False,
                "line": {"color": "#1d4ed8", "width": 1.5},
                "orientation": "h",
            }
        )
    line = {"type": "line", "y0": 0, "y1": 1, "yref": "paper", "line": {"color": "#b91c1c", "dash": "dot"}}
    layout = {
        "height": 80 + 28 * len(data),
        "margin": {"l": 170, "r": 12, "t": 8, "b": 44},
        "showlegend": False,
        "shapes": [{**line, "x0": end, "x1": end} for end in (-1.0, 1.0)],
        "xaxis": {"title": {"text": "× tolerance"}, "range": [-_SPAN, _SPAN], "zeroline": True},
        "yaxis": {"autorange": "reversed"},
    }
    return {"data": data, "layout": layout}


REPORT, SUMMARY = "report.html", "summary.json"
TABLES: Final = (".csv",)
CAUSES: Final = (
    "heat of robot, spindle and part",
    "wear of the tool during the program",
    "runout and bending of the tool",
    "fixture and clamping of the part",
    "where and how large the blank is",
    "roughness",
)
"""Causes that no draw holds."""
JUDGED: Final = (
    "on ten simulated cells of which the catalogue was known 32, 55, 71 and 97 % held of what was stated with 40, 60, "
    "79 and 97 % (benchmarks/quote_reliability.py): plan with those above 90 %"
)
"""What stated probabilities were worth where the truth came out; docs/quote.md has the table."""
READING, PLANNING, DRAWING, COMPARING = "reading", "planning", "drawing cells", "comparing remedies"
WORK: Final = {READING: 1.0, PLANNING: 3.0, DRAWING: 4.0, COMPARING: 12.0}


class Quotation(Summary):
    """Quotation of a part."""

    def _shown(self) -> Parts:
        yield self.rows(
            "features",
            "{part}: {program} on {cell}",
            "feature | quantity | nominal mm:.3f | tolerance mm:.3f | held with %=probability!p:.1f | "
            "uncompensated %=probability_as_it_is!p:.1f | 9 of 10 hold mm=tolerance_held_90_mm:.3f",
        )
        yield self.line(
            "all of them hold with {all_hold[probability]!p:.1f} % ({all_hold[probability_90][0]!p:.1f} to "
            "{all_hold[probability_90][1]!p:.1f} % by {draws} draws)"
        )
        yield self["judged"]
        columns = "remedy | all hold %=all_hold!p:.1f | gain %=gain!p:+.1f | mean gain %=mean_gain!p:+.1f"
        yield self.rows("remedies", "What raises it most", columns)
        yield "not looked at:"
        yield from self.each("remedies_not_looked_at", "  {remedy}: {why}")
        yield from self.each("not_looked_at", "  {what}: {why}")
        yield self.line("  {causes_not_looked_at}")

    def page(self, off_mm: Sequence[Float]) -> str:
        """The page, as HTML text; ``off_mm``: of each feature, (draws,) mm."""
        whole = self["all_hold"]
        low, high = (100.0 * value for value in whole["probability_90"])
        verdict = (
            f"All tolerances that are looked at hold with a probability of {100.0 * whole['probability']:.0f} % "
            f"({low:.0f} to {high:.0f} % by {self['draws']} drawn cells)."
        )
        head = Head(f"Quotation: {self['part']}", f"{self['program']} on {self['cell']}, {self['robot']}")
        figures = {"off": _figure(self["features"], off_mm)}
        return render("quote.html.j2", figures, [], data=head, summary=self, verdict=verdict)


def quote(
    part: Path,
    program: Path,
    cell: Cell,
    *,
    reading: Reading = AS_IT_IS,
    placements: int = 0,
    progress: Progress = silent,
) -> tuple[Quoted, Quotation]:
    """Quote a part before any cut.

    Args:
        part: CAD solid (STEP, part frame), whose faces and tolerances count beside the features of the program; or a
            table of tolerances of the features of the program.
        placements: Places of the part that are tried as a remedy; 0: none.

    Returns:
        Features of the compensated program over the drawn cells, and what ``summary.json`` holds.

    Raises:
        CounterflexError: Part, program or cell do not allow it; one line says what and where.
    """
    begin, parts = time.perf_counter(), in_parts(progress, WORK)
    parts[READING](0.0)
    drawing = drawing_of(part, program, cell, reading)
    job, cell = drawing.job, drawing.cell
    drawing.require_made()
    require_stiffness_for(job, cell, silent)
    with faults_in(job):
        plan = make_plan(
            job.path,
            job.line_of_motion,
            cell.stock(),
            setting_of(cell, job),
            feeds=job.feeds,
            progress=parts[PLANNING],
        )
    parts[DRAWING](0.0)
    points = points_of(plan, cell, program.name)
    quoted = drawing.quoted(path_errors(plan, cell, points))
    as_it_is = drawing.quoted(path_errors(plan, cell, points, compensated=False))
    ranked = remedies(Today(program, drawing, plan, placements), parts[COMPARING])
    summary = {
        "job": "quote",
        "program": program.name,
        "part": part.name,
        "cell": cell.name,
        "robot": cell.chain.name,
        **_shown(quoted, as_it_is),
        "remedies": [_remedy(one) for one in ranked if one.quoted is not None],
        "remedies_not_looked_at": [
            {"remedy": one.name, "why": one.why_not, "how": one.how} for one in ranked if one.quoted is None
        ],
        "unknown": [{"what": one.name, "known_from": one.known_from} for one in sources(cell, points)],
        "causes_not_looked_at": list(CAUSES),
        "judged": JUDGED,
        **assumed(cell),
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }
    progress(1.0)
    return quoted, Quotation(summary)


def drawing_of(part: Path, program: Path, cell: Cell, reading: Reading = AS_IT_IS) -> QuotedPart:
    """Read the part that is quoted, see :func:`quote`."""
    ending = part.suffix.lower()
    if ending not in (*ENDINGS, *TABLES):
        raise InputError(
            "a part is quoted from a CAD solid or a table of tolerances",
            where=str(part),
            value=ending or "no ending",
            limit=", ".join((*ENDINGS, *TABLES)),
        )
    tolerances = read_tolerances(part) if ending in TABLES else None
    cell, job = read_in_plane(program, cell, reading=reading)
    refuse_compensated(job.program)
    nominal = nominal_of(job, cell, None if ending in TABLES else part)
    solid = nominal.shape if isinstance(nominal.shape, CadSolid) else None
    if solid is None:
        return QuotedPart(job, cell, nominal.surface, None, tolerances)
    return QuotedPart(job, cell, nominal.surface, CadFeatures(solid, part.name), None, tuple(solid.not_measured))


def run(
    part: Path,
    program: Path,
    cell_file: Path,
    out: Path,
    *,
    assume_class: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> Quotation:
    """Write ``report.html`` and ``summary.json`` into ``out``: both or none.

    Args:
        assume_class: Give axes that no stiffness is known of the median of the robot's class, and say so.
    """
    from counterflex.report.page import write_page

    cell = read_cell(cell_file, assume_class=assume_class)
    with atomic.atomic_folder(out) as staging:
        inputs = inputs_of(program, cell_file)
        quoted, summary = quote(part, program, cell, progress=progress, **options)
        summary |= {"inputs": inputs}
        write_folder_summary(staging, summary)
        write_page(summary.page([one.off_m / MM for one in quoted.features]), staging / REPORT)
    return summary


def _shown(quoted: Quoted, as_it_is: Quoted) -> dict[str, Any]:
    before = {(one.feature, one.quantity): one for one in as_it_is.features}
    return {
        "draws": quoted.all_held.of,
        "all_hold": _share(quoted.all_held),
        "all_hold_as_it_is": _share(as_it_is.all_held),
        "features": [_feature(one, before.get((one.feature, one.quantity))) for one in quoted.features],
        "not_looked_at": [{"what": what, "why": why} for what, why in quoted.not_looked_at],
    }


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval
    return {"probability": round(share.probability, 4), "probability_90": [round(low, 4), round(high, 4)]}


def _feature(one: DrawnFeature, before: DrawnFeature | None) -> dict[str, Any]:
    return {
        **plain(one, "feature quantity nominal_mm:4 tolerance_mm:4 tolerance_source"),
        **_share(one.held()),
        "probability_as_it_is": None if before is None else round(before.held().probability, 4),
        "off_90_mm": [round(value / MM, 4) for value in one.off_90_m],
        "tolerance_held_90_mm": round(one.held_90_m / MM, 4),
    }


def _remedy(one: Remedy) -> dict[str, Any]:
    quoted = one.quoted
    assert quoted is not None
    return {
        "remedy": one.name,
        "how": one.how,
        "all_hold": round(quoted.all_held.probability, 4),
        "gain": round(one.gain[0], 4),
        "mean": round(quoted.mean, 4),
        "mean_gain": round(one.gain[1], 4),
        "draws": quoted.all_held.of,
    }
