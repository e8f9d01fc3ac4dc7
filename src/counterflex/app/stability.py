"""Stability of a program on a cell: margin of every stretch, lobes at the worst of each tool, in shop units."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, read_in_plane, setting_of
from counterflex.app.robot_programs import with_files
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import DEG, MM, RPM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stability.process import mean_chip_of_arcs
from counterflex.cutting.stability.response import Response
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import write_summary
from counterflex.files.tool_tip import read_modal, read_response
from counterflex.plan.lowest_mode import ASSUMED, Damping
from counterflex.plan.stability.along import Margin, Structure, confirmed, margins
from counterflex.plan.stability.criterion import LARGEST
from counterflex.plan.stability.diagram import Diagram, diagram, needed_damping
from counterflex.report.data import Head
from counterflex.report.glossary import line_of
from counterflex.report.page import render
from counterflex.report.series_figure import lobe_figure, margin_figure

_TEXTS: Final = {"stable": "Stable along the whole path.", "chatter": "The program chatters: do not run it as it is."}


READING, MARGINS, DIAGRAMS = "reading the program", "margin along the path", "lobes"
_ENGAGED: Final = 0.05
_LINES: Final = 8  # Lines at which the damping that is needed is computed


@dataclass(frozen=True, eq=False)
class JudgedProgram:
    """A judged program."""

    job: Job
    margins: list[Margin]  # Of every stretch
    diagrams: dict[int, Diagram]
    summary: dict[str, Any]  # What is printed as JSON and written to ``summary.json``
    table: pl.DataFrame  # One row for each stretch

    def lobes_table(self) -> pl.DataFrame:
        """The diagrams: tool, method, spindle speed and deepest stable cut; no depth where there is no limit."""
        rows = []
        for number, one in self.diagrams.items():
            depth = next(tool["worst"]["axial_depth_mm"] for tool in self.summary["tools"] if tool["tool"] == number)
            for method, speeds, factors in (
                ("zeroth order", one.spindle_rad_s, one.zeroth),
                ("semi-discretisation", one.checked_rad_s, one.semi_discretisation),
            ):
                rows += [
                    {
                        "tool": number,
                        "method": method,
                        "spindle_rpm": round(float(speed / RPM), 1),
                        "depth_mm": None if factor > LARGEST else round(float(factor) * depth, 4),
                    }
                    for speed, factor in zip(speeds, factors, strict=True)
                ]
        return pl.DataFrame(rows, infer_schema_length=None)


def structure_of(
    cell: Cell, damping_ratio: float | None, response: str | Path | None, modal: str | Path | None
) -> Structure:
    """The swinging structure.

    Args:
        damping_ratio: Of the robot's modes; None: of the cell's tap test, or assumed.
        response: CSV of a measured response of the tool tip, or None.
        modal: CSV of modal parameters of spindle and tool, or None.

    Raises:
        InputError: Both are given.
    """
    if response is not None and modal is not None:
        raise InputError("the tool tip is given twice", where="--response and --modal", hint="Give one of them")
    dynamics = cell.tables.dynamics
    tip = read_response(response) if response is not None else None if modal is None else read_modal(modal)
    damping = dynamics.damping if damping_ratio is None else Damping.of(None, damping_ratio)
    return Structure(damping, dynamics.mode, tip)


def judge(
    program: str | Path, cell: Cell, structure: Structure, *, reading: Reading = AS_IT_IS, progress: Progress = silent
) -> JudgedProgram:
    """Judge a program.

    Raises:
        CounterflexError: The program cannot be read, reached or cut, cuts nothing, or no modes are known.
    """
    begin = time.perf_counter()
    parts = in_parts(progress, {READING: 1.0, MARGINS: 5.0, DIAGRAMS: 4.0})
    cell, job = read_in_plane(program, cell, reading=reading, may_move=True)
    parts[READING](1.0)
    with faults_in(job):
        setting = setting_of(cell, job, part_may_be_held=True)
        values = margins(job.machined, cell.stock(), setting, structure, cell.blank_box(), progress=parts[MARGINS])
    if not values:
        raise ProgramError("the program cuts nothing sideways", where=str(program), hint="Does it reach the blank?")
    rows = [_shown(margin, job, cell.cutter(margin.stretch.tool)) for margin in values]
    numbers = sorted({margin.stretch.tool for margin in values})
    diagrams, tools = {}, []
    for number in numbers:
        own = [i for i, margin in enumerate(values) if margin.stretch.tool == number]
        worst = min(own, key=lambda i: values[i].margin)
        diagrams[number] = diagram(values[worst], structure, progress=parts[DIAGRAMS])
        needed = max(needed_damping(values[i]) for i in _softest(own, values, rows))
        tools.append(_of_tool(values[worst], rows[worst], structure, diagrams[number], needed))
    parts[DIAGRAMS](1.0)
    at = int(np.argmin([margin.margin for margin in values]))
    needed = max(tool["needed_damping_ratio"] for tool in tools)
    summary = {
        "program": job.program.name,
        "cell": cell.label,
        "robot": cell.robot.name,
        "verdict": "stable" if values[at].margin >= 1.0 else "chatter",
        "verdict_over_interval": _over_interval(values[at], tools, needed, structure.damping),
        "worst": rows[at],
        "stretches": len(rows),
        "below_1": int(sum(margin.margin < 1.0 for margin in values)),
        "tools": tools,
        "robot_modes_hz": [round(float(w) / (2.0 * math.pi), 2) for w in values[at].robot.omega_rad_s],
        "robot_damping_ratio": structure.damping.ratio,
        "robot_damping_between": [structure.damping.low, structure.damping.high],
        "robot_damping_from": structure.damping.origin,
        "cell_mm": round(cell.stock().cell_m / MM, 6),
        "engagement": "closed form" if cell.blank_box() is not None else "booked on cells of the stock",
        "robot_mode_measured": structure.measured is not None,
        "tool_tip": _tip(structure),
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }
    return JudgedProgram(job, values, diagrams, with_files(summary, job.program), pl.DataFrame(rows))


def _over_interval(worst: Margin, tools: list[dict[str, Any]], needed: float, damping: Damping) -> str:
    """``stable`` or ``chatter`` for every ratio that the damping may have, ``open`` where it depends on the ratio."""
    if min(tool["worst"]["tool_margin"] or LARGEST for tool in tools) < 1.0:
        return "chatter"
    if damping.origin != ASSUMED:
        return "stable" if worst.margin >= 1.0 else "chatter"
    return "stable" if needed <= damping.low else "chatter" if needed > damping.high else "open"


def _softest(own: list[int], values: list[Margin], rows: list[dict[str, Any]]) -> list[int]:
    """Of each line the stretch with the least margin of the robot; the :data:`_LINES` lowest of them."""
    least: dict[int, int] = {}
    for i in sorted(own, key=lambda i: values[i].robot_margin):
        least.setdefault(rows[i]["line"], i)
    return list(least.values())[:_LINES]


def _of_tool(worst: Margin, row: dict[str, Any], structure: Structure, lobes: Diagram, needed: float) -> dict[str, Any]:
    factor = confirmed(worst, structure) if worst.margin < LARGEST else math.inf
    depth = row["axial_depth_mm"]
    rpm = lobes.spindle_rad_s / RPM
    best = int(np.argmax(np.minimum(lobes.zeroth, LARGEST)))
    return {
        "tool": worst.stretch.tool,
        "worst": row,
        "semi_discretisation_margin": _finite(factor, 4),
        "needed_damping_ratio": 1.0 if math.isinf(needed) else round(needed, 4),
        "deepest_stable_at_any_speed_mm": _finite(float(lobes.zeroth.min()) * depth, 3),
        "best_speed_rpm": round(float(rpm[best])),
        "depth_at_best_speed_mm": _finite(min(float(lobes.zeroth[best]), LARGEST) * depth, 3),
    }


def _shown(margin: Margin, job: Job, cutter: Cutter) -> dict[str, Any]:
    """A stretch in shop units."""
    piece, path = margin.stretch, job.machined
    depth, entry, leave, width = _engagement(piece.arcs, cutter)
    return {
        "line": int(job.line_of_motion[path.motion[piece.row]]),
        **dict(zip(("x_mm", "y_mm", "z_mm"), np.round(path.p_part_tcp[piece.row] / MM, 3).tolist(), strict=True)),
        "time_s": round(float(path.time_s[piece.row]), 4),
        "tool": piece.tool,
        "spindle_rpm": round(float(path.spindle_rad_s[piece.row] / RPM), 1),
        "axial_depth_mm": round(depth / MM, 3),
        "radial_width_mm": round(width / MM, 3),
        "entry_deg": round(entry / DEG, 1),
        "exit_deg": round(leave / DEG, 1),
        "feed_per_tooth_mm": round(piece.feed_per_tooth_m / MM, 5),
        "mean_chip_um": round(mean_chip_of_arcs(piece.arcs, piece.feed_per_tooth_m) / UM, 3),
        "low_frequency_margin": _finite(margin.low_frequency, 4),
        "robot_margin": _limited(margin.robot_margin),
        "tool_margin": _limited(margin.tool_margin),
        "margin": round(margin.margin, 4),
        "method": margin.method if margin.margin < LARGEST else "no limit",
        "chatter_hz": _finite(margin.chatter_hz, 2),
    }  # fmt: skip


def _engagement(arcs: Float, cutter: Cutter) -> tuple[float, float, float, float]:
    """Axial depth, entry and exit angle, radial width: the mean over the engaged angles, by chip width."""
    marks = np.unique(arcs[:, :2])
    middle, share = 0.5 * (marks[1:] + marks[:-1]), -np.diff(np.cos(marks))
    column = ((middle[:, None] > arcs[:, 0]) & (middle[:, None] < arcs[:, 1])) @ arcs[:, 2]
    engaged = np.flatnonzero(column > _ENGAGED * column.max())
    width = float(share[engaged].sum())
    axial = float(column @ share) / width
    return axial, float(marks[engaged[0]]), float(marks[engaged[-1] + 1]), width * cutter.radius_m


def _tip(structure: Structure) -> dict[str, Any]:
    """Return what is known of spindle and tool."""
    modes, unexplained = structure.tip_modes()
    if modes is None:
        return {"from": "none: spindle and tool are taken as rigid", "modes": []}
    return {
        "from": "measured response" if isinstance(structure.tip, Response) else "modal parameters",
        "unexplained": round(unexplained, 4),
        "modes": [
            {
                "frequency_hz": round(float(w) / (2.0 * math.pi), 2),
                "damping_ratio": round(float(z), 5),
                "stiffness_n_per_um": round(float(w**2 / (u @ u)) * UM, 4),
                "direction": "xyz"[int(np.argmax(np.abs(u)))],
            }
            for w, z, u in zip(modes.omega_rad_s, modes.damping_ratio, modes.shape.T, strict=True)
        ],
    }


def _finite(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _limited(value: float) -> float | None:
    return round(value, 4) if value < LARGEST else None


class Stability(Summary):
    """Margins against chatter."""

    def _shown(self) -> Parts:
        yield ShownTable.of(
            self.line("{program} on {cell}: the worst stretch of each tool"),
            "tool=T{tool} | worst=place | depth={worst[axial_depth_mm]:.3g} mm | "
            "engaged={worst[entry_deg]:.0f} to {worst[exit_deg]:.0f} deg | speed={worst[spindle_rpm]:.0f} rpm | "
            "margin robot=worst[robot_margin]:.3g~no limit | margin tool=worst[tool_margin]:.3g~no limit | "
            "semi-discr.=semi_discretisation_margin:.3g~no limit | chatter at={worst[chatter_hz]:.3g} Hz",
            [tool | {"place": line_of(tool["worst"])} for tool in self["tools"]],
        )
        yield (
            self.line("{verdict}: least margin {worst[margin]:.3g} at ")
            + line_of(self["worst"])
            + self.line(" ({worst[method]}); {below_1} of {stretches} stretches below 1")
        )
        needed = max(tool["needed_damping_ratio"] for tool in self["tools"])
        low, high = self["robot_damping_between"]
        between = "" if low == high else f", {low:g} to {high:g}"
        yield (
            f"robot: damping ratio {self['robot_damping_ratio']:g} ({self['robot_damping_from']}{between}); "
            f"stable from {needed:.3g} upwards"
        )
        if self["verdict_over_interval"] == "open":
            yield (
                f"open: the damping ratio was not measured; below {needed:.3g} the program chatters. Give --damping, "
                "or measure it: counterflex identify servo"
            )
        if self["engagement"] != "closed form":
            yield self.line("engagement: {engagement} ({cell_mm:g} mm): the blank is no box")
        yield self.line("spindle and tool: {tool_tip[from]}")

    def page(self, stretches: Sequence[Mapping[str, Any]], lobes: Sequence[Mapping[str, Any]]) -> str:
        """The page, as HTML text; rows of ``stability.csv`` and of ``lobes.csv``."""
        figures = {"margins": margin_figure(stretches)}
        for tool in self["tools"]:
            rows = [row for row in lobes if row["tool"] == tool["tool"]]
            figures[f"lobes{tool['tool']}"] = lobe_figure(rows, tool["worst"])
        worst = self["worst"]
        least = f"{worst['margin']:.3g} at line {worst['line']} ({worst['method']})"
        verdict = f"{_TEXTS[self['verdict']]} Least margin {least}."
        needed = max(tool["needed_damping_ratio"] for tool in self["tools"])
        if self["verdict_over_interval"] == "open":
            low, high = self["robot_damping_between"]
            verdict += (
                f" Open: the damping ratio was not measured and may be {low:g} to {high:g}; below {needed:.3g} "
                "the program chatters."
            )
        return render(
            "stability.html.j2",
            figures,
            [],
            data=Head(f"Stability: {self['program']}", f"{self['cell']}, {self['robot']}"),
            summary=self,
            verdict=verdict,
            needed=needed,
        )


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path | None = None,
    *,
    response: str | Path | None = None,
    modal: str | Path | None = None,
    damping_ratio: float | None = None,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> Stability:
    """Judge a program; with ``out``, write ``summary.json``, ``stability.csv``, ``lobes.csv`` and ``report.html``.

    Args:
        out: Folder, made when missing; None writes nothing.
        response: CSV of a measured response of the tool tip.
        modal: CSV of modal parameters of spindle and tool.
        damping_ratio: Of the robot's modes.
    """
    cell = read_cell(cell_file)
    structure = structure_of(cell, damping_ratio, response, modal)
    if out is None:
        return Stability(judge(program, cell, structure, reading=reading, progress=progress).summary)
    with atomic.atomic_folder(out) as staging:
        done = judge(program, cell, structure, reading=reading, progress=progress)
        write_summary(staging / "summary.json", done.summary)
        atomic.write_text(staging / "stability.csv", done.table.write_csv())
        atomic.write_text(staging / "lobes.csv", done.lobes_table().write_csv())
        from counterflex.report.page import write_page

        result = Stability(done.summary)
        write_page(result.page(done.table.to_dicts(), done.lobes_table().to_dicts()), staging / "report.html")
    return result
