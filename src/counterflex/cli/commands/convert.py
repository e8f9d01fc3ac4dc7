"""The command that says a program in another language: ``convert``."""

from __future__ import annotations

from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_json, warn
from counterflex.core.units import UM
from counterflex.programs.language import at_prompt


@with_records
def convert(
    program: Program,
    cell: CellFile,
    out: Out,
    language: Annotated[
        str,
        option(
            "--to",
            f"Language to write: {', '.join(at_prompt('convert'))}.",
            arguments.one_of(lambda: at_prompt("convert"), "language"),
        ),
    ],
    tolerance_um: Annotated[
        float, option("--tolerance-um", "Straight pieces of a helix, for languages without one.", min=0.1, max=1000.0)
    ] = 1.0,
    points_per_file: Annotated[
        int | None,
        option(
            "--points-per-file",
            "Most motions in a file of a robot language; a main program calls the parts (limit of the language).",
            min=10,
            max=100_000,
        ),
    ] = None,
    *,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print what was written as JSON.")] = False,
) -> None:
    """Say a program in another language: the same path, speeds and process words, nothing compensated.

    Spindle, coolant, tool change and other machine functions travel by [controller.spindle] of the cell file, frames
    by [part], [tcp] and [controller]. What the language cannot say is refused with its line. What was written is read
    back and compared before anything is kept: points within 1 um.

    Example: `counterflex convert part.ngc --to krl --cell cell.toml --out out`
    """
    keep_inputs(out, program, source.parameters)
    from counterflex.app import conversion as job

    summary = job.run(
        program,
        cell,
        out,
        language,
        reading=source.reading(),
        tolerance_m=tolerance_um * UM,
        points_per_file=points_per_file,
    )
    if as_json:
        print_json(summary)
        return
    for warning in summary["warnings"]:
        warn(warning, err=True)
    typer.echo(
        f"wrote {out}: {', '.join(summary['files'])}, {summary['motions_in']} motions as {summary['motions_out']}; "
        f"read back within {summary['read_back_um']:g} um"
    )
