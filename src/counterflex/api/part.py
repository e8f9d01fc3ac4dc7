"""Parts: as machined on a simulated cell or as a scan measured them, judged against what the program was to make."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from counterflex.api.cell import Cell, file_of
from counterflex.api.program import Program, program_file
from counterflex.app.inputs import Reading, read_job
from counterflex.app.proof import simulate as cell_twin
from counterflex.app.proof.judge import JudgedRun, ProofReference, judge, reference_of
from counterflex.core import atomic, file_content
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Figure, Result
from counterflex.core.units import MM
from counterflex.evaluate.summary import SeedResult, summary
from counterflex.files.summary_file import write_folder_summary

if TYPE_CHECKING:
    from counterflex.app.inspection.judging import Inspection
    from counterflex.files.cell import cell as cell_file
    from counterflex.twin.plant.record import Record
    from counterflex.twin.truth.truth import Truth

BEFORE, AFTER = "nominal", "compensated"
_PARTS: Final = ("path", "entry", "exit", "plateau", "along", "surface")
_FIGURES: Final = ("p997_mm", "max_mm", "rms_mm")


class Part(Result):
    """A part as the simulated cell machined it.

    Attributes:
        original: The program that it is judged against.
        cell: What the controller knows, SI.
        reading: How the original was read.
        truth: Constants of the simulated cell, SI.
        record: Path, forces, angles, and the part, SI.
    """

    def __init__(self, original: Path, cell: cell_file.Cell, reading: Reading, truth: Truth, record: Record) -> None:
        self.original, self.cell, self.reading, self.truth, self.record = original, cell, reading, truth, record

    @cached_property
    def evaluation(self) -> Comparison:
        """The part judged against the original program."""
        return compare(self)

    @property
    def table(self) -> pl.DataFrame:
        """Figures of its error, mm: a row for each of ``path.p997_mm`` and so on."""
        return self.evaluation.table

    @property
    def samples(self) -> pl.DataFrame:
        """One row per sample: ``time_s``, tool tip as commanded and as it was (mm, part frame), force (N)."""
        record = self.record
        columns: dict[str, Any] = {"time_s": record.time_s}
        for name, values in (("command_", record.p_part_command / MM), ("", record.p_part_tcp / MM)):
            columns |= {f"{name}{axis}_mm": values[:, i] for i, axis in enumerate("xyz")}
        columns |= {f"f{axis}_n": record.force_part[:, i] for i, axis in enumerate("xyz")}
        return pl.DataFrame(columns | {"axial_depth_mm": record.depth_m / MM})

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of machining and of the error."""
        return {"machining": cell_twin.figures(self.record), **self.evaluation.summary}

    def save(self, folder: str | Path) -> Path:
        """Write samples (``samples.parquet``), part (height map or columns) and ``summary.json`` into a folder."""
        with atomic.atomic_folder(folder) as staging:
            atomic.write_made(staging / "samples.parquet", self.samples.write_parquet)
            cell_twin.save_part(self.record.stock, cell_twin.columns_of(self.record), staging)
            write_folder_summary(staging, self.summary)
        return Path(folder)

    def _lines(self) -> list[str]:
        seed = "exact cell" if self.truth.seed is None else f"seed {self.truth.seed} of {self.truth.family}"
        return [f"{self.original.name} as machined on a simulated cell, {seed}", *_errors(self.table, BEFORE)]

    def _pictures(self) -> dict[str, Figure]:
        return {"path": self._path_figure}

    def _path_figure(self) -> dict[str, Any]:
        from counterflex.report import figure_data
        from counterflex.report.series_figure import components_figure

        return components_figure((("as machined", figure_data.BEFORE, self.evaluation.judged[BEFORE].deviation),))


class Comparison(Result):
    """One or two machined parts, judged against the original program.

    Attributes:
        reference: What they are judged against.
        judged: ``nominal`` and, where there is one, ``compensated``.
    """

    def __init__(self, reference: ProofReference, judged: Mapping[str, JudgedRun], content: dict[str, Any]) -> None:
        self.reference, self.judged, self._summary = reference, judged, content

    @property
    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json`` of the command ``evaluate``."""
        return self._summary

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

    def _lines(self) -> list[str]:
        names = [name for name in (BEFORE, AFTER) if name in self.judged]
        return [
            f"{self.summary['program']} in {self.summary['cell']}",
            *(line for name in names for line in _errors(self.table, name)),
        ]

    def _pictures(self) -> dict[str, Figure]:
        """Pictures of two parts.

        ``path`` (signed error of both along the path), ``map`` (deviation of both surfaces, from above), ``histogram``
        (distribution of the surface's deviation); a tool that turned leaves no surface.
        """
        from counterflex.report.distribution_figure import histogram_figure
        from counterflex.report.figure_data import scale_limit_mm
        from counterflex.report.map_figure import callouts, map_figure, map_picture
        from counterflex.report.series_figure import signed_figure

        if not {BEFORE, AFTER} <= set(self.judged):
            raise InputError("the pictures compare two parts", where="plot", value=", ".join(self.judged))
        one, two = self.judged[BEFORE], self.judged[AFTER]
        pictures: dict[str, Figure] = {"path": lambda: signed_figure(one.deviation, two.deviation)}
        nominal, before, after = self.reference.surface, one.surface, two.surface
        if nominal is not None and before is not None and after is not None:
            limit = scale_limit_mm(max(before.surface.max_m, after.surface.max_m) / MM)
            shown = (map_picture(nominal, before), map_picture(nominal, after))
            pictures |= {
                "map": lambda: map_figure(*shown, callouts(*shown), limit),
                "histogram": lambda: histogram_figure(nominal, before, after, limit),
            }
        return pictures


def _errors(table: pl.DataFrame, name: str) -> list[str]:
    """Say the path error of a program."""
    known = dict(table.select("figure", name).iter_rows())
    p997, largest = known.get("path.p997_mm"), known.get("path.max_mm")
    return (
        []
        if p997 is None or largest is None
        else [f"{name}: path error {p997:.3f} mm (99.7 %), {largest:.3f} mm at most"]
    )


def compare(before: Part, after: Part | None = None) -> Comparison:
    """Judge one or two machined parts against the original program.

    Args:
        before: Made by the uncompensated program, or the only one.
        after: Made by the compensated one.

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
    return Comparison(reference, judged, summary([result], about))


class Proof(Comparison):
    """A compensation, proven on simulated cells; pictures and ``table`` are those of the first cell.

    Attributes:
        seeds: One row per simulated cell: error before and after, and what remains.
        files: Text of the compensated program by file name.
    """

    def __init__(
        self,
        reference: ProofReference,
        judged: Mapping[str, JudgedRun],
        content: dict[str, Any],
        seeds: pl.DataFrame,
        files: dict[str, str],
    ) -> None:
        super().__init__(reference, judged, content)
        self.seeds, self.files = seeds, files


def prove(
    program: Program | str | Path,
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
        program: Program, or program file.
        cell: Cell, or cell file.
        seeds: Numbers of the simulated cells.
        family: That they are drawn from.
        exact: Also plan with the constants of each simulated cell: what remains then is the error of the method.
        workers: Processes; more than one needs a script with ``if __name__ == "__main__":``; None is one per core.
        progress: Called with the share done, 0 to 1; may raise to interrupt.

    Raises:
        CounterflexError: Program, cell or reach do not allow it.
    """
    from counterflex.app.proof import prove as job
    from counterflex.twin.truth.family import family_of

    with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
        proof = job.prove(
            program_file(program),
            file_of(cell),
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


class Inspected(Result):
    """A real part, measured and judged against what its program was to make.

    Attributes:
        inspection: Registration, deviations and features, SI.
    """

    def __init__(self, program: Path, inspection: Inspection) -> None:
        self.program, self.inspection = program, inspection

    @property
    def table(self) -> pl.DataFrame:
        """One row per feature, quantity and part: ``nominal_mm``, ``worst_mm``, ``tolerance_mm``, ``within`` ..."""
        parts = self.summary["parts"]
        rows = [
            {"part": name, **{key: value for key, value in row.items() if key not in parts}, **row[name]}
            for row in self.summary["features"]
            for name in parts
            if name in row
        ]
        return pl.DataFrame(rows, infer_schema_length=None)

    @property
    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json``: figures, registration and features with their uncertainties."""
        return self.inspection.summary

    def save(self, folder: str | Path) -> Path:
        """Write ``deviations.parquet``, ``summary.json`` and ``report.html`` as the command does."""
        from counterflex.app.inspection.inspect import write_folder

        with atomic.atomic_folder(folder) as staging:
            write_folder(self.inspection, self.program, staging)
        return Path(folder)

    def _lines(self) -> list[str]:
        rows = self.table
        outside = 0 if rows.is_empty() else rows.filter(~pl.col("within")).height
        return [
            f"{self.summary['program']} as measured",
            f"{rows.height} quantities of features, {outside} outside of their tolerance",
        ]

    def _pictures(self) -> dict[str, Figure]:
        """``map``: deviation of the surface of the last part, from above."""
        return {"map": self._map_figure}

    def _map_figure(self) -> dict[str, Any]:
        from counterflex.report.figure_data import scale_limit_mm
        from counterflex.report.map_figure import callouts, map_picture

        name, one = list(self.inspection.parts.items())[-1]
        deviation, surface = one.part.surface_deviation(), one.part.part.surface
        picture = map_picture(surface, deviation)
        limit = scale_limit_mm(deviation.surface.max_m / MM)
        return picture.figure(callouts(picture, picture), limit, name)


def inspect(
    program: Program | str | Path,
    cell: Cell | str | Path,
    scan: str | Path,
    *,
    unit: str | None = None,
    before: str | Path | None = None,
    progress: Progress = silent,
) -> Inspected:
    """Judge the scan of a real part against what its program was to make.

    Args:
        program: The uncompensated program, or its file.
        cell: Cell, or cell file: blank and tools.
        scan: Point cloud, mesh or table of touched points.
        unit: ``mm``, ``inch``, ``m``; None: found.
        before: Scan of an earlier part to compare with.
        progress: Called with the share done, 0 to 1.

    Raises:
        CounterflexError: A scan that cannot be read, or is of another part.
    """
    from counterflex.app.inspection import judging

    file = program_file(program)
    inspection = judging.inspect(
        file,
        file_of(cell),
        Path(scan),
        how=judging.How(unit=unit),
        before=None if before is None else Path(before),
        progress=progress,
    )
    return Inspected(file, inspection)
