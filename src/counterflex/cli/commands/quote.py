"""The command ``quote``: probability that a part keeps its tolerances, before any cut."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import AssumeClass, Dialect, Out, Parameters, Program, WithoutEnd
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.programs.language import BY_ENDING


def quote(
    part: Annotated[
        Path,
        argument(
            "CAD solid in the part frame (STEP: faces, tolerances), or table of tolerances of the program's features "
            "(.csv: feature, quantity, tolerance_mm).",
            arguments.file,
            "PART",
        ),
    ],
    program: Program,
    cell: Annotated[Path, argument("Cell file (.toml).", arguments.file, "CELL")],
    out: Out,
    placements: Annotated[
        int,
        option(
            "--placements",
            "Places of the part to try as a remedy; 256 take minutes.",
            min=0,
            max=65536,
        ),
    ] = 0,
    dialect: Dialect = BY_ENDING,
    parameters: Parameters = None,
    without_end: WithoutEnd = False,
    assume_class: AssumeClass = False,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Quote a part: the probability that each feature holds its tolerance, before any cut, and what raises it most.

    The program is planned as compensate plans it. Its features, and the faces of a STEP file that it makes, are
    measured on 1000 drawn cells, which differ by all that is not known of this one. Remedies are compared: measure
    stiffness, force, play or drives, another posture or place, a finishing pass, online correction, a second part.
    What is not looked at is listed, and never counts as held. Writes into DIR: report.html, summary.json.

    Example: `counterflex quote tolerances.csv part.ngc cell.toml --out quote`
    """
    keep_inputs(out, part, program, cell, parameters)
    from counterflex.app.inputs import Reading
    from counterflex.app.quote import quote as job

    with progress_bar(f"quoting {part.name}") as progress:
        summary = job.run(
            part,
            program,
            cell,
            out,
            reading=Reading(dialect, parameters, complete=not without_end),
            placements=placements,
            assume_class=assume_class,
            progress=progress,
        )
    print_summary(summary, as_json, out, ": report.html, summary.json ({seconds:.1f} s)")
