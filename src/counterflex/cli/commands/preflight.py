"""Command preflight: check a program on a cell before it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import CellFile, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_result, print_table, progress_bar, say_written
from counterflex.core.remarks import shown
from counterflex.programs.language import robot_dialects

_ORDER: Final = ("fail", "warning", "ok")


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
    print_result(summary, as_json, _show)
    if out is not None and not as_json:
        say_written(out, f"wrote {out}: report.html, summary.json")
    if summary["failed"]:
        raise typer.Exit(1)


def _show(summary: dict[str, Any]) -> None:
    looked_at = [row for row in summary["checks"] if row["verdict"] != "not looked at"]
    looked_at.sort(key=lambda row: _ORDER.index(row["verdict"]))
    rows = [
        [
            row["check"],
            row["verdict"],
            _number(row["value"], row["unit"]),
            _number(row["limit"], row["unit"]),
            row["place"] or "",
            row["what"],
        ]
        for row in looked_at
    ]
    print_table(
        f"{summary['program']} on {summary['cell']}", ["check", "verdict", "value", "limit", "worst", "what"], rows
    )
    for row in looked_at:
        if row["advice"]:
            typer.echo(f"{row['verdict']}: {row['check']}: {row['advice']}")
    left_out = [row for row in summary["checks"] if row["verdict"] == "not looked at"]
    if left_out:
        typer.echo("not looked at, and what it needs:")
    for row in left_out:
        typer.echo(f"  {row['check']}: {_needs(row)}")
        shown(row["what"])
    counts = summary["counts"]
    passed = f"{counts['not looked at']} not looked at, {counts['ok']} ok"
    typer.echo(f"{counts['fail']} fail, {counts['warning']} warning, {passed}")


def _needs(row: dict[str, Any]) -> str:
    """Key that a check needs, and what the program does there."""
    value = _number(row["value"], row["unit"])
    at = row["place"] or ""
    here = ", ".join(text for text in (value, row["what"], at) if text)
    return f"{row['missing']} ({here})" if row["missing"] and here else row["missing"] or here


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return ""
    return f"{value:.0f} {unit}".rstrip() if abs(value) >= 1000.0 else f"{value:.4g} {unit}".rstrip()
