"""The command ``correct``: the program of the next part, corrected from measured ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.core.units import UM


def correct(
    program: Program,
    cell: CellFile,
    plan: Annotated[
        Path,
        option(
            "--plan",
            "Folder of compensate or correct: the program that the measured parts were made by.",
            arguments.folder,
            "DIR",
        ),
    ],
    scan: Annotated[
        list[Path],
        option(
            "--scan",
            "A measured part: deviations (or folder) of inspect, or a folder of simulate or prove. Repeatable.",
            arguments.file_or_folder,
            "PART",
        ),
    ],
    out: Out,
    limit_um: Annotated[
        float, option("--limit-um", "Largest change of a correction; more is refused.", min=5.0, max=5000.0)
    ] = 1500.0,
    apply: Annotated[
        Path | None,
        option(
            "--apply",
            "Write a new cell file with the constants of the likeliest explanation; no file is overwritten.",
            arguments.output_file,
            "CELL",
        ),
    ] = None,
    report: Annotated[bool, option("--report/--no-report", "Write report.html.")] = True,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Correct the next part: measured deviations in, the program that takes back what repeats of them out.

    PROGRAM is the original program; --plan says by which corrected one the parts were made. Every place of a scan is
    attributed to the stretch of path that made it; noise is told from error by the evidence of the data, and only
    error is taken back, normal to the surface. What would explain it (force, stiffness, part frame) is weighed and
    printed; a cell file is written only with --apply.

    Writes into DIR: the program, plan.parquet, path-error.parquet, parts/ (all parts so far), summary.json and
    report.html. Either all of them or none. DIR is the --plan of the next time.

    Example: `counterflex correct part.ngc --cell cell.toml --plan out --scan part1 --out out2`
    """
    keep_inputs(out, program, cell, plan, *scan)
    keep_inputs(apply, program, cell, option="--apply")
    from counterflex.app.correction import correct as job

    with progress_bar(f"correcting {program.name}") as progress:
        summary = job.run(
            program, cell, plan, scan, out, apply=apply, report=report, progress=progress, limit_m=limit_um * UM
        )
    files = ": {files}, plan.parquet, path-error.parquet, parts/, summary.json ({seconds:.1f} s)"
    print_summary(summary, as_json, out, files)
