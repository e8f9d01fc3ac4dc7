"""``simulate``, ``compare``, ``prove``: machine programs on the simulated cell, and judge what became of the part."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from counterflex.api.compensation import Compensation
from counterflex.app.inputs import AS_IT_IS, Reading, in_working_plane, read_job
from counterflex.app.proof import prove as job
from counterflex.app.proof import simulate as cell_twin
from counterflex.app.proof.judge import Judged, Reference, judge, reference_of
from counterflex.app.proof.truth import truth_of
from counterflex.core import file_content
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.evaluate.summary import SeedResult, summary
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.twin.plant.record import Record
from counterflex.twin.truth.family import family_of
from counterflex.twin.truth.truth import Truth

if TYPE_CHECKING:
    import plotly.graph_objects as go

BEFORE, AFTER = "nominal", "compensated"
_PARTS: Final = ("path", "entry", "exit", "plateau", "along", "surface")
_FIGURES: Final = ("p997_mm", "max_mm", "rms_mm")


@dataclass(frozen=True, eq=False)
class Machined:
    """A program as the simulated cell machined it.

    Attributes:
        original: The program that it is judged against.
        cell: What the controller believes.
        reading: How the original was read.
        truth: The simulated cell.
        record: Path, forces, angles, and the part.
    """

    original: Path
    cell: Cell
    reading: Reading
    truth: Truth
    record: Record

    @property
    def table(self) -> pl.DataFrame:
        """One row per sample: ``time_s``, tool tip as commanded and as it was (mm, part frame), force (N)."""
        record = self.record
        columns: dict[str, Any] = {"time_s": record.time_s}
        for name, values in (("command_", record.p_part_command / MM), ("", record.p_part_tcp / MM)):
            columns |= {f"{name}{axis}_mm": values[:, i] for i, axis in enumerate("xyz")}
        columns |= {f"f{axis}_n": record.force_part[:, i] for i, axis in enumerate("xyz")}
        return pl.DataFrame(columns | {"axial_depth_mm": record.depth_m / MM})


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One or two machined programs, judged against the original.

    Attributes:
        reference: What they are judged against.
        judged: ``nominal`` and, where there is one, ``compensated``.
        summary: What ``summary.json`` of the command holds.
    """

    reference: Reference
    judged: Mapping[str, Judged]
    summary: dict[str, Any]

    @property
    def table(self) -> pl.DataFrame:
        """Figures in mm: a row for each of ``path.p997_mm`` and so on, a column for each program."""
        variants = self.summary["variants"]
        rows = [
            {"figure": f"{part}.{figure}"} | {name: variants[name].get(part, {}).get(figure) for name in variants}
            for part in _PARTS
            for figure in _FIGURES
            if any(figure in variants[name].get(part, {}) for name in variants)
        ]
        return pl.DataFrame(rows)

    def plot(self, kind: str = "path") -> go.Figure:
        """A picture of two judged programs.

        Args:
            kind: ``path`` (signed error of both along the path), ``map`` (deviation of both surfaces, from above),
                ``histogram`` (distribution of the surface's deviation).

        Raises:
            InputError: There is no such picture: only one program, or a tool that turned and left no surface.
        """
        from counterflex.api.figures import figure
        from counterflex.report.distribution_figure import histogram_figure
        from counterflex.report.figure_data import scale_limit_mm
        from counterflex.report.map_figure import callouts, map_figure, map_picture
        from counterflex.report.series_figure import signed_figure

        if not {BEFORE, AFTER} <= set(self.judged):
            raise InputError("the pictures compare two programs", where="plot", value=", ".join(self.judged))
        one, two = self.judged[BEFORE], self.judged[AFTER]
        pictures: dict[str, Any] = {"path": lambda: signed_figure(one.deviation, two.deviation)}
        nominal, before, after = self.reference.surface, one.surface, two.surface
        if nominal is not None and before is not None and after is not None:
            limit = scale_limit_mm(max(before.surface.max_m, after.surface.max_m) / MM)
            shown = (map_picture(nominal, before), map_picture(nominal, after))
            pictures |= {
                "map": lambda: map_figure(*shown, callouts(*shown), limit),
                "histogram": lambda: histogram_figure(nominal, before, after, limit),
            }
        return figure(pictures, kind)


@dataclass(frozen=True, eq=False)
class Proof(Evaluation):
    """A compensation, proven on simulated cells; pictures and ``table`` are those of the first truth.

    Attributes:
        seeds: One row per truth: error before and after, and what remains.
        files: Text of the compensated program by file name.
    """

    seeds: pl.DataFrame
    files: dict[str, str]


def simulate(
    program: str | Path | Compensation,
    cell: Cell | str | Path,
    *,
    seed: int | None = 1,
    family: str = "mild",
    original: str | Path | None = None,
    progress: Progress = silent,
) -> Machined:
    """Machine a program on the simulated cell.

    Args:
        program: Program file, or a compensation.
        cell: Cell, or cell file.
        seed: Of the truth; None is a cell that is exactly as the cell file says.
        family: That the truth is drawn from: ``mild``, ``wide``, ``other`` (docs/twin.md).
        original: Uncompensated program that a compensated one stands for; None: the program itself, or the one that
            the compensation began with.
        progress: Called with the share done, 0 to 1; may raise to interrupt.

    Raises:
        CounterflexError: The program cannot be read, or never meets the blank.
    """
    known = cell if isinstance(cell, Cell) else read_cell(cell)
    reading = program.reading if isinstance(program, Compensation) else AS_IT_IS
    truth = truth_of(known, seed, family_of(family))
    with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
        file = program.save_program(scratch)[0] if isinstance(program, Compensation) else Path(program)
        if original is None:
            original = program.program if isinstance(program, Compensation) else file
        there = in_working_plane(original, known, reading)
        record = cell_twin.machine(read_job(file, there, reading=reading), there, truth, progress=progress)
    return Machined(Path(original), there, reading, truth, record)


def compare(before: Machined, after: Machined | None = None) -> Evaluation:
    """Judge one or two machined programs against the original.

    Args:
        before: The uncompensated program as machined, or the only one.
        after: The compensated one.

    Raises:
        InputError: They were machined on different simulated cells, or stand for different programs.
    """
    runs = {BEFORE: before} | ({} if after is None else {AFTER: after})
    if after is not None and file_content.content(before.original) != file_content.content(after.original):
        raise InputError("the two stand for different programs", value=f"{before.original}, {after.original}")
    if after is not None and (before.truth.seed, before.truth.family) != (after.truth.seed, after.truth.family):
        raise InputError(
            "the two were machined on different simulated cells",
            value=f"seed {before.truth.seed} of {before.truth.family}, {after.truth.seed} of {after.truth.family}",
            hint="Give both the same seed and family",
        )
    reference = reference_of(read_job(before.original, before.cell, reading=before.reading), before.cell)
    judged = {
        name: judge(reference, run.record, run.record.stock, cell_twin.columns_of(run.record))
        for name, run in runs.items()
    }
    result = SeedResult(
        before.truth.seed,
        "exact" if before.truth.seed is None else "catalogue",
        {name: one.variant for name, one in judged.items()},
    )
    about = {"job": "evaluate", "program": before.original.name, "cell": before.cell.name}
    return Evaluation(reference, judged, summary([result], about))


def prove(
    program: str | Path,
    cell: Cell | str | Path,
    *,
    seeds: Sequence[int] = (1,),
    family: str = "mild",
    exact: bool = False,
    workers: int | None = 1,
    progress: Progress = silent,
) -> Proof:
    """Compensate a program, machine it before and after on simulated cells, and judge both.

    Args:
        program: Program file.
        cell: Cell, or cell file.
        seeds: Truths, each another simulated cell.
        family: That they are drawn from.
        exact: Also plan with the constants of each truth: what remains then is the error of the method.
        workers: Processes; more than one needs a script with ``if __name__ == "__main__":``; None is one per core.
        progress: Called with the share done, 0 to 1; may raise to interrupt.

    Raises:
        CounterflexError: Program, cell or reach do not allow it.
    """
    file = cell.path if isinstance(cell, Cell) else Path(cell)
    with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
        proof = job.prove(
            program,
            file,
            Path(scratch),
            seeds=seeds,
            family=family_of(family),
            exact=exact,
            workers=workers,
            progress=progress,
        )
    judged = {name: proof.judged[proof.first_seed, name] for name in (BEFORE, AFTER)}
    rows = [
        {
            "seed": one["seed"],
            "planner_knows": one["truth_level"],
            "before_p997_mm": one["variants"][BEFORE]["path"]["p997_mm"],
            "after_p997_mm": one["variants"][AFTER]["path"]["p997_mm"],
        }
        for one in proof.summary["seeds"]
    ]
    remains = (100.0 * pl.col("after_p997_mm") / pl.col("before_p997_mm")).alias("remains_percent")
    table = pl.DataFrame(rows).with_columns(remains)
    return Proof(proof.reference, judged, proof.summary, table, proof.program_files)
