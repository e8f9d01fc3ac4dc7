"""Judge machined programs against the original one: path, surface, features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import Job
from counterflex.app.proof import simulate
from counterflex.app.proof.cut_logs import log_of_path, log_of_run, top_of, undisturbed_columns
from counterflex.core import file_content
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.next_command import next_command
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock
from counterflex.cutting.tridexel.surface import surface as surface_of
from counterflex.evaluate.feature_finding import Feature, find_features
from counterflex.evaluate.features import FeatureRow, Machined, measure_features
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures, path_deviation
from counterflex.evaluate.summary import SeedResult, TruthLevel, Variant, summary
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation, nominal_surface
from counterflex.evaluate.turned_surface import TurnedDeviation, TurnedSurface, turned_surface
from counterflex.files.cell.cell import Cell
from counterflex.files.summary_file import read_run, read_summary
from counterflex.path.toolpath import FEED, Run, ToolPath
from counterflex.plan.plan import Plan
from counterflex.twin.plant.simulate import mounted_tools
from counterflex.twin.truth.file import read_truth
from counterflex.twin.truth.truth import Truth


@dataclass(frozen=True, eq=False)
class ProofReference:
    """Reference that runs are judged against."""

    job: Job
    cell: Cell  # Where it is machined
    widest: Cutter
    surface: NominalSurface | None  # Floors and walls of the undisturbed part; None where the tool turns
    turned: TurnedSurface | None = None  # Where the undisturbed part is judged when the tool turns

    @property
    def radius_m(self) -> float:
        """Radius of the cutter; of several the largest."""
        return self.widest.radius_m

    def outline_at(self, motion: Int) -> Float | None:
        """(k, 2) m, radius and corner radius of the tool in each of (k,) motions; None where one tool cuts all."""
        path = self.job.path
        if len(simulate.tools_of(path)) < 2:
            return None
        last = np.maximum(np.searchsorted(path.motion, motion, side="right") - 1, 0)
        return _outlines(mounted_tools(path)[last], self.cell)

    @property
    def outline(self) -> Float | None:
        """(n, 2) m, the same at each row of the program's path."""
        return outline_of(self.job.path, self.cell)


@dataclass(frozen=True, eq=False)
class JudgedRun:
    """One run, judged."""

    run: Run
    actual: HeightMap
    deviation: PathDeviation
    surface: SurfaceDeviation | None  # Of the part; None where the tool turned
    columns: ColumnStock | None = None  # Columns of material where the tool turned
    turned: TurnedDeviation | None = None  # Deviation of the part where the tool turned

    @property
    def variant(self) -> Variant:
        """Its figures."""
        force = np.linalg.norm(self.run.force_part, axis=1)
        surface = self.turned if self.surface is None else self.surface
        return Variant(PathFigures.of(self.deviation), surface, float(np.max(force, initial=0.0)))

    @property
    def joined(self) -> Bool:
        """Stations that continue the one before."""
        out: Bool = ~self.deviation.broken
        return out


def reference_of(job: Job, cell: Cell) -> ProofReference:
    """Removal simulation of the undisturbed path, and what it machines."""
    tools = simulate.tools_of(job.path)
    widest = max((cell.cutter(number) for number in tools), key=lambda cutter: cutter.radius_m)
    if cell.tool_turns:
        left = undisturbed_columns(job.path, cell)
        nominal_part = turned_surface(surface_of(left, log_of_path(job.path, cell, top_of(cell))), left.cell_m)
        return ProofReference(job, cell, widest, None, nominal_part)
    outline = outline_of(job.path, cell)
    nominal = simulate.undisturbed(job, cell)
    surface = nominal_surface(cell.stock(), nominal, job.path.p_part_tcp, widest, outline=outline)
    return ProofReference(job, cell, widest, surface)


def outline_of(path: ToolPath, cell: Cell) -> Float | None:
    """(n, 2) m, radius and corner radius of the tool that each row of a path is run to with; None: one cuts all."""
    return None if len(simulate.tools_of(path)) < 2 else _outlines(mounted_tools(path), cell)


def candidates_of(path: ToolPath, cell: Cell) -> tuple[Feature, ...]:
    """Features that a program may make, each with the radius of its cutter."""
    return find_features(path, _outlines(mounted_tools(path), cell)[:, 0])


def _outlines(tool: Int, cell: Cell) -> Float:
    """(n, 2) m, radius and corner radius of tools by their numbers (n,)."""
    numbers, place = np.unique(tool, return_inverse=True)
    cutters = [cell.cutter(int(number)) for number in numbers]
    out: Float = np.array([[cutter.radius_m, cutter.corner_radius_m] for cutter in cutters])[place]
    return out


def judge(reference: ProofReference, run: Run, actual: HeightMap, columns: ColumnStock | None = None) -> JudgedRun:
    """Judge one run."""
    feed_engagement = np.where(run.kind == FEED, run.depth_m, 0.0)
    deviation = path_deviation(
        reference.job.path,
        run.time_s,
        run.p_part_tcp,
        feed_engagement,
        reference.radius_m,
        command_part_tcp=run.p_part_command,
        progress=run.progress,
    )
    surface, turned = None, None
    if reference.turned is not None:
        cell = reference.cell
        turned = reference.turned.deviation(log_of_run(run, reference.job.path, cell, top_of(cell)))
    if reference.surface is not None:
        surface = SurfaceDeviation.of(
            reference.surface,
            actual,
            deviation.p_part_actual,
            ~deviation.broken,
            reference.outline_at(deviation.motion),
        )
    return JudgedRun(run, actual, deviation, surface, columns, turned)


def features(reference: ProofReference, judged: Mapping[str, JudgedRun]) -> tuple[FeatureRow, ...]:
    """Grooves, ramps and pockets of the part, measured on every run; none where the tool turns."""
    surface = reference.surface
    if surface is None:
        return ()
    machined = {
        name: Machined(
            item.actual, item.deviation.p_part_actual, item.joined, reference.outline_at(item.deviation.motion)
        )
        for name, item in judged.items()
    }
    return measure_features(
        surface,
        reference.job.path.p_part_tcp,
        candidates_of(reference.job.path, reference.cell),
        machined,
        outline=reference.outline,
    )


@dataclass(frozen=True, eq=False)
class ProgramComparison:
    """One or two machined programs, judged."""

    reference: ProofReference  # What they are judged against
    judged: dict[str, JudgedRun]  # ``nominal`` and, when there is one, ``compensated``
    truth: Truth
    summary: dict[str, Any]

    @classmethod
    def of(cls, folders: Sequence[str | Path]) -> ProgramComparison:
        """Read folders that ``simulate`` wrote and judge them; the first is the uncompensated program.

        Raises:
            InputError: More than two folders, a folder without a machined program, or originals, cells or truths
                differ.
            FileFormatError: A file is missing or damaged.
        """
        if not 1 <= len(folders) <= 2:
            raise InputError("evaluate compares one or two runs", value=len(folders), limit="DIR [DIR]")
        paths = [Path(folder) for folder in folders]
        for path in paths:
            if not (path / simulate.RUN).is_file():
                raise InputError(
                    "no machined program in this folder",
                    where=str(path),
                    limit=f"{simulate.RUN} and the files beside it",
                    hint=f"{next_command('simulate', 'PROGRAM', cell='CELL', truth='TRUTH', out='DIR')} makes one",
                )
        _check_same(paths)
        cell = simulate.read_cell_of(paths[0])
        reference = reference_of(simulate.read_original(paths[0], cell), cell)
        truth = read_truth(paths[0] / simulate.TRUTH)
        judged: dict[str, JudgedRun] = {}
        for name, path in zip(("nominal", "compensated"), paths, strict=False):
            run_read, _ = read_run(path / simulate.RUN)
            judged[name] = judge(reference, run_read, *simulate.read_part(path))
        made = [read_summary(path / simulate.SUMMARY) for path in paths]
        inputs = [one["inputs"] for one in made if "inputs" in one]
        about = {
            "job": "evaluate",
            "program": str(made[0].get("original", "")),
            "family": truth.family,
            "inputs": {**inputs[-1], "begun": min(one["begun"] for one in inputs)} if len(inputs) == len(made) else {},
            "cell": cell.name,
            "counterflex": __version__,
        }
        variants = {name: item.variant for name, item in judged.items()}
        level: TruthLevel = "exact" if truth.seed is None else "catalogue"
        return cls(reference, judged, truth, summary([SeedResult(truth.seed, level, variants)], about))


def _check_same(paths: Sequence[Path]) -> None:
    """Refuse runs of different programs, cells or truths."""
    for pattern, what in (
        (simulate.ORIGINAL, "original programs"),
        (simulate.CELL, "cells"),
        (simulate.TRUTH, "truths"),
        (simulate.BLANKS, "blanks"),
    ):
        hashes = set()
        for path in paths:
            name = str(simulate.kept(path, pattern).relative_to(path)) if pattern == simulate.ORIGINAL else pattern
            files = sorted(path.glob(name))
            files += sorted(file for file in (path / pattern).glob("*") if file not in files)
            if not files and pattern != simulate.BLANKS:
                raise FileFormatError("a file of the run is missing", where=str(path / name))
            hashes.add(tuple(file_content.content(file) for file in files))
        if len(hashes) > 1:
            raise InputError(
                f"the runs cannot be compared: their {what} differ",
                value=", ".join(str(path) for path in paths),
                hint="Simulate both with the same --original, --cell and --truth",
            )


@dataclass(frozen=True, eq=False)
class ProofResult:
    """Result of the job."""

    reference: ProofReference
    plan: Plan  # What the planner decided, knowing the cell file
    truths: dict[int, Truth]
    # By (seed, variant): ``nominal``, ``compensated``, ``exact`` (planned with the truth's exact constants)
    judged: dict[tuple[int, str], JudgedRun]
    program_files: dict[str, str]
    summary: dict[str, Any]  # What ``summary.json`` holds
    timing: dict[str, float]  # Seconds per step

    @property
    def first_seed(self) -> int:
        """Seed whose runs are written and shown."""
        return next(iter(self.truths))
