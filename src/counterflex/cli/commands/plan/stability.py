"""Command plan stability: margin of a program against chatter."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import CellFile, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar


@with_records
def stability(
    program: Annotated[Path, argument("G-code file.", arguments.file, "PROGRAM")],
    cell: CellFile,
    out: Annotated[
        Path | None,
        option(
            "--out",
            "Folder for report.html (lobes, margin along the path), stability.csv, lobes.csv and summary.json; "
            "made when missing.",
            arguments.output_folder,
            "DIR",
        ),
    ] = None,
    response: Annotated[
        Path | None,
        option(
            "--response",
            "Measured frequency response of the tool tip (.csv): direction (x, y, z of the TCP frame), "
            "frequency_hz, real_um_per_n, imaginary_um_per_n.",
            arguments.file,
            "CSV",
        ),
    ] = None,
    modal: Annotated[
        Path | None,
        option(
            "--modal",
            "Modal parameters of spindle and tool (.csv): direction, frequency_hz, damping_ratio, stiffness_n_per_um.",
            arguments.file,
            "CSV",
        ),
    ] = None,
    damping: Annotated[
        float | None,
        option(
            "--damping",
            "Damping ratio of the robot's modes, 0.001 to 0.7. Default: that of the tap test in the cell file, "
            "otherwise 0.1 is assumed, which stands for 0.02 to 0.3.",
            arguments.between(0.001, 0.7),
            "RATIO",
        ),
    ] = None,
    *,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Compute the margin of a program against chatter along its path, and name the worst line.

    The margin is the factor by which the cut could be deeper; below 1 it chatters. The robot's modes depend on the
    posture and come from the masses and compliances of the cell file; spindle and tool come from a measured response
    or from modal parameters. Without either they are taken as rigid.

    Verdicts: stable; chatter (exit status 1). Where the damping ratio was not measured, the least one needed is
    printed, and the verdict is marked as open if it changes within the interval of the assumed ratio.

    Example: `counterflex plan stability part.ngc --cell cell.toml --out stability`
    """
    keep_inputs(out, cell, program, source.parameters, response, modal)
    from counterflex.app import stability as job

    with progress_bar(f"stability of {program.name}") as progress:
        summary = job.run(
            program,
            cell,
            out,
            response=response,
            modal=modal,
            damping_ratio=damping,
            reading=source.reading(),
            progress=progress,
        )
    print_summary(summary, as_json, out, ": report.html, stability.csv, lobes.csv, summary.json")
    if summary["verdict"] == "chatter":
        raise typer.Exit(1)
