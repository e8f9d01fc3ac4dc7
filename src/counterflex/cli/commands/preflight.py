"""Command preflight: check a program on a cell before it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import CellFile, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.programs.language import robot_dialects


@with_records
def preflight(
    program: Annotated[Path, argument("Program file.", arguments.file, "PROGRAM")],
    cell: CellFile,
    out: Annotated[
        Path | None,
        option(
            "--out",
            "Folder for report.html (pictures along the path) and summary.json; made when missing.",
            arguments.output_folder,
            "DIR",
        ),
    ] = None,
    language: Annotated[
        str | None,
        option(
            "--as",
            f"Language that the robot gets the program in, for its size: {', '.join(robot_dialects())} (that of "
            "the program, of the robot's maker).",
            arguments.one_of(robot_dialects, "language"),
        ),
    ] = None,
    nominal: Annotated[
        Path | None,
        option(
            "--nominal",
            "Part that the program is to make (STEP, part frame): gouges and material left on each of its faces.",
            arguments.file,
            "STEP",
        ),
    ] = None,
    *,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Check a program on a cell before it runs: one table with the worst line of each check.

    Reach, joint limits, speeds and accelerations, cables; collisions of robot, spindle, tool holder and tool with the
    stock as it is machined so far and with bodies; first motion, rapids, tool changes and end of the program; tool
    length and work offsets; spindle speed, torque and power, force, deflection, feed per tooth, plunging; reversals,
    block time, look-ahead, rounding of corners, size of the program. All hazards: docs/preflight.md.

    Verdicts: ok; warning (costs accuracy or time); fail; not looked at (names the key of the cell file that is
    missing). Exit status 1 if a check fails.

    Example: `counterflex preflight part.ngc --cell cell.toml --out preflight`
    """
    keep_inputs(out, cell, program, source.parameters, nominal)
    from counterflex.app import preflight as job

    with progress_bar(f"checking {program.name}") as progress:
        reading = source.reading()
        summary = job.run(program, cell, out, reading=reading, language=language, nominal=nominal, progress=progress)
    print_summary(summary, as_json, out, ": report.html, summary.json")
    if summary["failed"]:
        raise typer.Exit(1)
