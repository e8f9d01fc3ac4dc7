"""Judge machined programs against the original one: path, surface, features."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app import simulate
from counterflex.app.inputs import Job, read_job
from counterflex.core.arrays import Bool
from counterflex.core.errors import InputError
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.feature_finding import find_features
from counterflex.evaluate.features import FeatureRow, Machined, measure_features
from counterflex.evaluate.path_deviation import PathDeviation, path_deviation, path_figures
from counterflex.evaluate.summary import SeedResult, TruthLevel, Variant, summary
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation, nominal_surface, surface_deviation
from counterflex.files.cell import Cell, read_cell
from counterflex.files.run_file import Run, read_run
from counterflex.files.summary_file import write_summary
from counterflex.path.toolpath import FEED
from counterflex.twin.truth_file import read_truth


@dataclass(frozen=True, eq=False)
class Reference:
    """What runs are judged against.

    Attributes:
        job: The original program.
        cell: Where it is machined.
        surface: Floors and walls of the undisturbed part.
    """

    job: Job
    cell: Cell
    surface: NominalSurface

    @property
    def radius_m(self) -> float:
        """Radius of the cutter."""
        return self.surface.cutter.radius_m


@dataclass(frozen=True, eq=False)
class Judged:
    """One run, judged.

    Attributes:
        run: As recorded.
        actual: As-machined height map.
        deviation: Of the path.
        surface: Of the part.
    """

    run: Run
    actual: HeightMap
    deviation: PathDeviation
    surface: SurfaceDeviation

    @property
    def variant(self) -> Variant:
        """Its figures."""
        force = np.linalg.norm(self.run.force_part, axis=1)
        return Variant(path_figures(self.deviation), self.surface, float(np.max(force, initial=0.0)))

    @property
    def joined(self) -> Bool:
        """Stations that continue the one before."""
        out: Bool = ~self.deviation.broken
        return out


def reference_of(job: Job, cell: Cell) -> Reference:
    """Removal simulation of the undisturbed path, and what it machines."""
    cutter = cell.cutter(simulate.tool_of(job.path))
    nominal = simulate.undisturbed(job, cell)
    cut = job.path.p_part_tcp
    return Reference(job, cell, nominal_surface(cell.stock(), nominal, cut, cutter))


def judge(reference: Reference, run: Run, actual: HeightMap) -> Judged:
    """Judge one run.

    Args:
        reference: What it is judged against.
        run: Its record.
        actual: Its part.
    """
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
    surface = surface_deviation(reference.surface, actual, deviation.p_part_actual, ~deviation.broken)
    return Judged(run, actual, deviation, surface)


def features(reference: Reference, judged: Mapping[str, Judged]) -> tuple[FeatureRow, ...]:
    """Grooves, ramps and pockets of the part, measured on every run."""
    return measure_features(
        reference.surface,
        reference.job.path.p_part_tcp,
        find_features(reference.job.path, reference.radius_m),
        {name: Machined(item.actual, item.deviation.p_part_actual, item.joined) for name, item in judged.items()},
    )


def read_folder(folder: str | Path) -> tuple[Reference, Judged, int | None]:
    """Read a folder that ``simulate`` wrote and judge its run.

    Returns:
        Reference, judged run, and the seed of its truth.

    Raises:
        FileFormatError: The folder misses a file or one is damaged.
    """
    path = Path(folder)
    if not (path / simulate.RUN).is_file():
        raise InputError(
            "no machined program in this folder",
            where=str(path),
            limit=f"{simulate.RUN} and the files beside it",
            hint="counterflex simulate PROGRAM --cell CELL --truth TRUTH --out DIR makes one",
        )
    cell = read_cell(path / simulate.CELL)
    reference = reference_of(read_job(path / simulate.ORIGINAL, cell), cell)
    run, _ = read_run(path / simulate.RUN)
    return (
        reference,
        judge(reference, run, HeightMap.load(path / simulate.SURFACE)),
        read_truth(path / simulate.TRUTH).seed,
    )


def compare(folders: list[str | Path], *, truth_level: TruthLevel = "seeded") -> dict[str, Any]:
    """Summary of one or two machined programs: the first is the uncompensated one.

    Raises:
        InputError: More than two folders, or their originals, cells or truths differ.
    """
    if not 1 <= len(folders) <= 2:
        raise InputError("evaluate compares one or two runs", value=len(folders), limit="DIR [DIR]")
    variants: dict[str, Variant] = {}
    same = (simulate.ORIGINAL, simulate.CELL, simulate.TRUTH)
    texts: list[tuple[str, ...]] = []
    seed = None
    for name, folder in zip(("nominal", "compensated"), folders, strict=False):
        reference, judged, seed = read_folder(folder)
        variants[name] = judged.variant
        texts.append(tuple((Path(folder) / file).read_text(encoding="utf-8") for file in same))
        program = reference.job.program.name
    if len(set(texts)) > 1:
        raise InputError(
            "the runs cannot be compared: original program, cell or truth differ",
            value=", ".join(str(folder) for folder in folders),
            hint="Simulate both with the same --original, --cell and --truth",
        )
    about = {"job": "evaluate", "program": Path(program).name, "counterflex": __version__}
    return summary([SeedResult(seed or 0, truth_level, variants)], about)


def run(folders: list[str | Path], out: str | Path | None) -> dict[str, Any]:
    """Do the job on files: ``summary.json`` in ``out``, where it is given. Returns the summary."""
    found = compare(folders)
    if out is not None:
        write_summary(Path(out) / "summary.json", found)
    return found
