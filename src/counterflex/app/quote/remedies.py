"""Remedies of a quotation: probabilities again with one doubt less, another plan, or a correction.

Each is compared with today on the same draws, so that differences are known better than the probabilities themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.correction.decide import tool_response_of
from counterflex.app.inputs import faults_in, read_in_plane, setting_of
from counterflex.app.placement.placement import placement_of
from counterflex.app.posture import PostureOf
from counterflex.app.prediction_interval import SERVO
from counterflex.app.quote.path_errors import ALL, PathErrors, doubts, path_errors, points_of
from counterflex.app.quote.probability import Quoted, QuotedPart
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError
from counterflex.core.next_command import next_command
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG
from counterflex.evaluate.path_error.learning import LOCAL, SCATTER_M, ToolResponse
from counterflex.files.cell.cell import Cell, resolve
from counterflex.path.toolpath import RAPID, ToolPath
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.inputs import CompensationInputs
from counterflex.plan.plan import Plan
from counterflex.plan.posture.held import Held
from counterflex.plan.static_correction import loaded_robot
from counterflex.plan.undisturbed_cut import undisturbed_cut

DRAWS: Final = 200
"""Cells that remedies are compared on: the first of those that are drawn."""
LEFT: Final = {"stiffness": 0.05, "cutting": 0.05}
"""Doubt after measuring, as a share of the deflection: compliances are determined within 2 to 9 % (docs/identify),
force constants to 5 % (:data:`counterflex.app.unknowns.IDENTIFIED`)."""
LEFT_OF_ITSELF: Final = {"play": 0.2, SERVO: 0.2}
"""The same as a share of the doubt before: play and friction are known to 20 % then (docs/tracker)."""
SENSOR: Final = 0.02
"""Doubt of a measured force: uncertainty of 1 to 2 % of the range of each axis (docs/identify)."""
TRACKED_S: Final = 1.0 / (2.0 * np.pi * 1.3)
"""Time constant of what a tracker corrects: the slower designed crossover of docs/tracker, 1.3 Hz."""
TRACKED: Final = 0.07
"""Share of slow errors that it leaves: circles keep 5 to 9 % (docs/tracker)."""
_SEED: Final = 36
_NAMES: Final = {
    "stiffness": "measure the stiffness",
    "cutting": "measure the cutting force",
    "play": "measure play and friction",
    SERVO: "measure the drives",
}
POSTURE, PLACE, FINISH = "another posture", "another place of the part", "repeat the program as a finishing pass"
ONLINE, SECOND = "correct online", "correct the second part from the first"


@dataclass(frozen=True)
class Remedy:
    """Something that may raise the probabilities, with what it is worth or why that was not looked at."""

    name: str
    how: str  # The command, or what to do
    quoted: Quoted | None = None
    today: Quoted | None = None  # On the same draws
    why_not: str = ""

    @property
    def gain(self) -> tuple[float, float]:
        """Rise of the probability that all features hold, and of their mean."""
        if self.quoted is None or self.today is None:
            return -1.0, -1.0
        before, after = self.today, self.quoted
        return after.all_held.probability - before.all_held.probability, after.mean - before.mean


@dataclass(frozen=True, eq=False)
class Today:
    """The quotation that remedies are compared with."""

    program: Path
    drawing: QuotedPart
    plan: Plan
    placements: int = 0  # Places of the part that are tried; 0: none

    @property
    def cell(self) -> Cell:
        """Cell that makes the part."""
        return self.drawing.cell

    def errors(self, kept: dict[str, float] | None = None) -> PathErrors:
        """Errors of the compensated program on the draws that remedies are compared on."""
        points = points_of(self.plan, self.cell, self.program.name)
        return path_errors(self.plan, self.cell, points, kept=ALL if kept is None else kept).first(DRAWS)


def remedies(today: Today, progress: Progress = silent) -> tuple[Remedy, ...]:
    """All remedies, the largest gain first, those that were not looked at last."""
    tries: list[tuple[str, str, Callable[[], Quoted | str]]] = []
    cell, program = today.cell.path, today.program
    for recipe, name in _NAMES.items():
        how = next_command(f"identify {recipe}", propose=20, cell=cell, out="proposal")
        tries.append((name, how, partial(_measured, today, (recipe,))))
    tries.append(("measure all of these", "all four", lambda: _measured(today, tuple(_NAMES))))
    how = next_command("plan posture", program, cell=cell, out="posture")
    tries.append((POSTURE, how, lambda: _in_posture(today)))
    how = next_command("plan placement", program, cell=cell, out="place")
    tries.append((PLACE, how, lambda: _in_place(today)))
    tries.append((FINISH, "append the program to itself", lambda: _finished(today)))
    tries.append((ONLINE, "counterflex run with the sensor of the cell file", lambda: _online(today)))
    how = next_command("correct", program, cell=cell, plan="plan", scan="scan", out="plan-2")
    tries.append((SECOND, how, lambda: today.drawing.quoted(_second_part(today))))
    parts = in_parts(progress, {"today": 1.0} | {name: 1.0 for name, _, _ in tries})
    base = today.drawing.quoted(today.errors())
    out = []
    for name, how, quoted in tries:
        parts[name](0.0)
        try:
            result = quoted()
        except CounterflexError as fault:
            result = str(fault)
        if isinstance(result, str):
            out.append(Remedy(name, how, why_not=result))
        else:
            out.append(Remedy(name, how, result, base))
    progress(1.0)
    return tuple(sorted(out, key=lambda one: one.gain, reverse=True))


def _measured(today: Today, recipes: tuple[str, ...]) -> Quoted | str:
    """The same plan, made with what these recipes find."""
    before = doubts(today.cell, points_of(today.plan, today.cell, today.program.name))
    kept = {}
    for recipe in recipes:
        doubt = before.get(recipe, 0.0)
        known = LEFT_OF_ITSELF.get(recipe)
        kept[recipe] = known if known is not None else (min(1.0, LEFT[recipe] / doubt) if doubt > 0.0 else 1.0)
        if any(one.recipe == recipe for one in today.cell.tables.identified):
            kept[recipe] = 1.0
    if all(value == 1.0 for value in kept.values()):
        return "it is known as well already"
    return today.drawing.quoted(today.errors(kept))


def _in_posture(today: Today) -> Quoted | str:
    chosen = PostureOf.of(today.program, today.cell).chosen
    best, present = chosen.best, chosen.present
    if present is not None and best.share_m > 0.99 * present.share_m:
        return "the planner offers no stiffer one"
    return _planned_anew(today, today.cell, best)


def _in_place(today: Today) -> Quoted | str:
    if today.placements == 0:
        return "a search takes minutes: --placements 256"
    if today.cell.tables.external_axes:
        return "the cell has external axes: plan placement chooses their values too"
    placed = placement_of(today.program, today.cell, count=today.placements)
    part = today.cell.part.model_copy(update=placed.stand.part)
    moved = _resolved(today.cell, today.cell.tables.model_copy(update={"part": part}))
    return _planned_anew(today, moved, placed.chosen.best)


def _planned_anew(today: Today, cell: Cell, best: Held) -> Quoted:
    """Probabilities of the program in a posture and place."""
    shoulder, elbow, wrist = best.branch.split()
    posture = {"shoulder": shoulder, "elbow": elbow, "wrist": wrist, "rotation_about_tool_deg": best.rotation_rad / DEG}
    kept = cell.tables.posture.model_copy(update={**posture, "turning_mm_deg": (), "turning_at_mm": ()})
    changed, job = read_in_plane(today.program, _resolved(cell, cell.tables.model_copy(update={"posture": kept})))
    with faults_in(job):
        plan = make_plan(job.path, job.line_of_motion, changed.stock(), setting_of(changed, job), feeds=job.feeds)
    points = points_of(plan, changed, today.program.name)
    drawing = replace(today.drawing, cell=changed, job=job)
    return drawing.quoted(path_errors(plan, changed, points).first(DRAWS))


def _resolved(cell: Cell, tables: object) -> Cell:
    return resolve(tables, cell.path, assume_class=cell.class_stiffness is not None)  # type: ignore[arg-type]


def _finished(today: Today) -> Quoted | str:
    """The compensated program run twice: the second time it takes what the first left."""
    job, cell = today.drawing.job, today.cell
    top, ends = float(cell.stock().z.max()), job.path.p_part_tcp[[0, -1], 2]
    if float(ends.min()) < top:
        return "the program begins or ends below the top of the blank"
    twice = repeated(job.path)
    lines = np.concatenate([job.line_of_motion, job.line_of_motion])
    with faults_in(job):
        plan = make_plan(twice, lines, cell.stock(), setting_of(cell))
    return today.drawing.quoted(path_errors(plan, cell, points_of(plan, cell, today.program.name)).first(DRAWS))


def repeated(path: ToolPath) -> ToolPath:
    """A path run twice, with a rapid between."""
    motions, pause_s = int(path.motion[-1]) + 1, 1.0
    second = {
        "time_s": path.time_s + path.time_s[-1] + pause_s,
        "motion": path.motion + motions,
        "kind": np.concatenate([[RAPID], path.kind[1:]]),
    }
    names = ("p_part_tcp", "axis_part", "kind", "feed_m_s", "spindle_rad_s", "time_s", "motion", "tool", "place")
    return ToolPath(**{n: np.concatenate([getattr(path, n), second.get(n, getattr(path, n))]) for n in names})


def _online(today: Today) -> Quoted | str:
    """Force measured by a sensor or holder, or slow errors taken back by a tracker."""
    tables = today.cell.tables
    if tables.tracker is not None:
        errors = today.errors()
        return today.drawing.quoted(replace(errors, error_m=tracked(errors)))
    if tables.sensor is None and tables.holder is None:
        return "the cell file has no [sensor], [holder] or [tracker]"
    doubt = doubts(today.cell, points_of(today.plan, today.cell, today.program.name)).get("cutting", 0.0)
    return today.drawing.quoted(today.errors({"cutting": min(1.0, SENSOR / doubt) if doubt > 0.0 else 1.0}))


def tracked(errors: PathErrors) -> Float:
    """Errors that a tracker leaves: fast ones, and a share of slow ones, of each run of feed."""
    time, out = errors.plan.path.time_s[errors.nodes.row], np.array(errors.error_m)
    slow = np.zeros_like(out[:, 0])
    for k in range(len(time)):
        begins = k == 0 or errors.nodes.chain[k] != errors.nodes.chain[k - 1]
        if begins:
            slow[:] = 0.0
        else:
            slow += (1.0 - np.exp(-(time[k] - time[k - 1]) / TRACKED_S)) * (errors.error_m[:, k] - slow)
        out[:, k] -= (1.0 - TRACKED) * slow
    return out


def _second_part(today: Today) -> PathErrors:
    """Errors of the next part, made with the error of the first taken back as ``correct`` does, drawn by its doubts."""
    errors, plan, cell = today.errors(), today.plan, today.cell
    inputs = CompensationInputs(plan.path, plan.line, cell.stock(), setting_of(cell), plan.q)
    with faults_in(today.drawing.job):
        whole = tool_response_of(loaded_robot(inputs, undisturbed_cut(inputs, silent)))
    rows = errors.nodes.row
    # where motion pauses the derivative of the response is taken within the run of feed of the nodes
    response = ToolResponse(
        whole.time_s[rows], errors.nodes.chain, whole.gain[:, rows], whole.delay_s[:, rows], whole.aside_m
    )
    rng, out = np.random.default_rng(_SEED), np.empty_like(errors.error_m)
    for k, error in enumerate(errors.error_m):
        left = np.tensordot(rng.standard_normal(len(response.gain)), response.patterns(error), 1)
        left += response.aside(error) * rng.standard_normal(3)
        out[k] = left + LOCAL * rng.standard_normal() * error + SCATTER_M * rng.standard_normal(3)
    return replace(errors, error_m=out)
