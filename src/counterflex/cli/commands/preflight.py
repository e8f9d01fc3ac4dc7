"""Command preflight: check a program on a cell before it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.commands.program import CellFile, Dialect, Parameters, WithoutEnd
from counterflex.cli.output import keep_inputs, print_json, print_table, progress_bar, say_written
from counterflex.programs.limits import BY_ENDING
from counterflex.programs.robot_writer.statement_forms import FORMS


def register(app: typer.Typer) -> None:
    """Add this command."""
    app.command()(preflight)


def preflight(
    program: Annotated[Path, typer.Argument(help="Program file.", metavar="PROGRAM", callback=arguments.file)],
    cell: CellFile,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Folder for report.html (pictures along the path) and summary.json; made when missing.",
            metavar="DIR",
            callback=arguments.output_folder,
        ),
    ] = None,
    language: Annotated[
        str | None,
        typer.Option(
            "--as",
            help=f"Language that the robot gets the program in, for its size: {', '.join(FORMS)} (that of the "
            "program, of the robot's maker).",
            callback=arguments.one_of(FORMS, "language"),
        ),
    ] = None,
    dialect: Dialect = BY_ENDING,
    parameters: Parameters = None,
    without_end: WithoutEnd = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Check a program on a cell before it runs: one table with the worst line of each check.

    Reach, joint limits, wrist singularity, joint speed and acceleration at feed, cables of axes 4 and 6, collisions of
    coarse bodies (robot, spindle, tool, stock, table), rapids into the stock, axes that turn round or are unloaded in
    the cut, block time and look-ahead of the controller, rounding of corners, path speed that the robot holds, size of
    the program for its language.

    Verdicts: ok; warning (costs accuracy or time); unknown (names the key of the cell file that is missing); fail.
    Exit status 1 if a check fails.

    Example: `counterflex preflight part.ngc --cell cell.toml --out preflight`
    """
    if out is not None:
        keep_inputs(out, cell, program, *([] if parameters is None else [parameters]))
    from counterflex.app import preflight as job
    from counterflex.app.inputs import Reading

    with progress_bar(f"checking {program.name}") as progress:
        reading = Reading(dialect, parameters, complete=not without_end)
        summary = job.run(program, cell, out, reading=reading, language=language, progress=progress)
    if as_json:
        print_json(summary)
    else:
        _show(summary)
    if out is not None and not as_json:
        say_written(out, f"wrote {out}: report.html, summary.json")
    if summary["failed"]:
        raise typer.Exit(1)


def _show(summary: dict[str, Any]) -> None:
    rows = [
        [
            row["check"],
            row["verdict"],
            _number(row["value"], row["unit"]),
            _number(row["limit"], row["unit"]),
            "" if row["line"] is None else f"line {row['line']}",
            row["what"],
        ]
        for row in summary["checks"]
    ]
    print_table(
        f"{summary['program']} on {summary['cell']}", ["check", "verdict", "value", "limit", "worst", "what"], rows
    )
    for row in summary["checks"]:
        text = row["advice"] or (f"give {row['missing']} in the cell file" if row["missing"] else "")
        if text:
            typer.echo(f"{row['verdict']}: {row['check']}: {text}")
    counts = summary["counts"]
    passed = f"{counts['not looked at']} not looked at, {counts['ok']} ok"
    typer.echo(f"{counts['fail']} fail, {counts['warning']} warnings, {passed}")


def _number(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.4g} {unit}".rstrip()
