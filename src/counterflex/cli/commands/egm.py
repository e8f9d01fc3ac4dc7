"""Commands about ABB EGM set-ups: egm check, egm make."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.output import keep_inputs, print_json

_egm = typer.Typer(no_args_is_help=True, help="ABB EGM set-ups: check a RAPID program, or generate one for a cell.")


def register(app: typer.Typer) -> None:
    """Add these commands."""
    _egm.command("check")(check)
    _egm.command("make")(make)
    app.add_typer(_egm, name="egm")


def check(
    program: Annotated[Path, argument("RAPID module that sets up EGM (.mod).", arguments.file, "MODULE")],
    cell: Annotated[
        Path | None, option("--cell", "Cell file, for the tables [online] and [egm].", arguments.file, "CELL")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print JSON instead of lines.")] = False,
) -> None:
    """Check a RAPID program that uses EGM: dangerous (error) or ineffective (warning) settings, with their remedy.

    Exit status 1 when there is an error.

    Example: `counterflex egm check part.mod --cell cell.toml`
    """
    from counterflex.app.robot_folder import SETUPS

    findings = SETUPS["egm"].check(program, cell)
    errors = sum(item.severity == "error" for item in findings)
    if as_json:
        counts = {"errors": errors, "warnings": len(findings) - errors}
        print_json({"file": str(program), **counts, "findings": [dataclasses.asdict(item) for item in findings]})
    else:
        for item in findings:
            typer.echo(item.line())
        blind = "; not checked without --cell" if cell is None else ""
        typer.echo(f"{errors} errors, {len(findings) - errors} warnings{blind}")
    if errors:
        raise typer.Exit(1)


def make(
    cell: CellFile,
    program: Annotated[
        Path, option("--program", "RAPID program that compensate --as rapid wrote.", arguments.file, "MODULE")
    ],
    out: Out,
    host: Annotated[str, option("--host", "Address of the sensor computer.")] = "192.168.125.10",
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Generate a RAPID program with EGM around its path, and a README with the settings of the controller.

    The table [egm] of the cell file selects the mode: mode = "path" corrects the path of the program, mode = "pose"
    removes the path and streams it. Writes all files into DIR or none.

    Example: `counterflex egm make --cell cell.toml --program plan/part.mod --out robot`
    """
    keep_inputs(out, cell, program)
    from counterflex.app.robot_folder import SETUPS

    summary = SETUPS["egm"].make(out, cell=cell, program=program, host=host)
    if as_json:
        print_json(summary)
        return
    for warning in summary["warnings"]:
        typer.echo(warning)
    typer.echo(f"wrote {out}: {', '.join([*summary['files'], 'README.txt', 'summary.json'])}")
    typer.echo("not tried on a controller: read README.txt first")
