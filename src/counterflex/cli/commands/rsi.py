"""Commands about KUKA RSI set-ups: rsi check, rsi make, rsi tune."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.output import keep_inputs, print_json, print_table

_rsi = typer.Typer(
    no_args_is_help=True, help="KUKA RSI set-ups: check one, generate one for a cell, tune axis corrections."
)


def register(app: typer.Typer) -> None:
    """Add these commands."""
    _rsi.command("check")(check)
    _rsi.command("make")(make)
    _rsi.command("tune")(tune)
    app.add_typer(_rsi, name="rsi")


def check(
    file: Annotated[Path, argument("ETHERNET configuration file (.xml).", arguments.file, "FILE")],
    cell: Annotated[
        Path | None, option("--cell", "Cell file, for the limits of [online].", arguments.file, "CELL")
    ] = None,
    context: Annotated[
        Path | None, option("--context", "Context of the controller (.rsi.xml or .rsix).", arguments.file, "FILE")
    ] = None,
    krl: Annotated[Path | None, option("--krl", "KRL program that uses it (.src).", arguments.file, "FILE")] = None,
    tracker: Annotated[
        int | None, option("--tracker", "UDP port for tracker datagrams, as in run.", min=1, max=65535)
    ] = None,
    force_port: Annotated[
        int | None, option("--force-port", "UDP port of a simulated force sensor.", min=1, max=65535)
    ] = None,
    as_json: Annotated[bool, option("--json", "Print JSON instead of lines.")] = False,
) -> None:
    """Check an RSI set-up: dangerous (error) or ineffective (warning) settings, with their remedy.

    Each additional file adds checks. Exit status 1 if there is an error.

    Example: `counterflex rsi check rsi.xml --cell cell.toml`
    """
    from counterflex.app.robot_folder import SETUPS

    ports = {"the tracker": tracker, "the force sensor": force_port}
    given = {name: p for name, p in ports.items() if p is not None}
    findings = SETUPS["rsi"].check(config=file, cell=cell, context=context, program=krl, ports=given)
    errors = sum(item.severity == "error" for item in findings)
    if as_json:
        counts = {"errors": errors, "warnings": len(findings) - errors}
        print_json({"file": str(file), **counts, "findings": [dataclasses.asdict(item) for item in findings]})
    else:
        for item in findings:
            typer.echo(item.line())
        missing = [name for name, path in (("--context", context), ("--krl", krl), ("--cell", cell)) if path is None]
        blind = f"; not checked without {', '.join(missing)}" if missing else ""
        typer.echo(f"{errors} errors, {len(findings) - errors} warnings{blind}")
    if errors:
        raise typer.Exit(1)


def make(
    cell: CellFile,
    out: Out,
    program: Annotated[
        Path | None,
        option("--program", "Compensated KRL program; default: one that tests the link.", arguments.file, "SRC"),
    ] = None,
    host: Annotated[str, option("--host", "Address of the sensor computer.")] = "192.168.44.10",
    port: Annotated[int, option("--port", "UDP port on it.", min=1, max=65535)] = 59152,
    sentype: Annotated[str, option("--sentype", "Type of the answers.")] = "Counterflex",
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Generate an RSI set-up for a cell: ETHERNET file, context, KRL program with RSI around its path, README.

    Limits come from the table [online] of the cell file, with a margin. Writes all files into DIR or none. README.txt
    lists the tests on the controller.

    Example: `counterflex rsi make --cell cell.toml --out robot`
    """
    keep_inputs(out, cell, *([] if program is None else [program]))
    from counterflex.app.robot_folder import SETUPS

    summary = SETUPS["rsi"].make(out, cell=cell, program=program, host=host, port=port, sentype=sentype)
    if as_json:
        print_json(summary)
        return
    for warning in summary["warnings"]:
        typer.echo(warning)
    typer.echo(f"wrote {out}: {', '.join([*summary['files'], 'summary.json'])}")
    typer.echo("not tried on a controller: read README.txt first")


def tune(
    cell: CellFile,
    apply: Annotated[
        Path | None, option("--apply", "Write a new cell file with the gains.", arguments.output_file, "FILE")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Tune a PID for the correction of each axis from identified dead time, lag and lowest mode.

    The largest gains with the phase and gain margin of [online] (phase_margin_deg, gain_margin_db), also with delays
    off by 10 % and the mode by 15 %, checked by the poles of the sampled closed loop. An axis without such a gain keeps
    none. --apply writes the table [online.axis_pid] and output = "axes".

    Example: `counterflex rsi tune --cell cell.toml --apply tuned.toml`
    """
    from counterflex.app import axis_controller as job
    from counterflex.files.cell.cell import read_cell

    read = read_cell(cell)
    if apply is not None:
        keep_inputs(apply, cell, option="--apply")
    axes = job.tune(read)
    rows = job.shown(axes)
    if apply is not None:
        job.write(read, axes, apply)
    if as_json:
        print_json({"cell": str(cell), "axes": rows})
        return
    keys = ("dead_ms", "mode_hz", "mode_seen", "proportional", "integral_per_s", "derivative_ms", "filter_ms")
    checked = ("phase_margin_deg", "gain_margin_db", "sensitivity", "largest_pole")
    late = ("error_after_step_ms", "error_alone_ms")
    names: tuple[str, ...] = ("dead ms", "mode Hz", "seen", "P", "I 1/s", "D ms", "filter ms")
    names += ("phase deg", "gain dB", "Ms", "largest pole", "step error ms", "without")
    table = [[f"{row['axis']}", *(f"{row.get(key, '-')}" for key in (*keys, *checked, *late))] for row in rows]
    print_table("PID of the axis corrections", ["axis", *names], table)
    for row in rows:
        if row["refused"]:
            typer.echo(f"axis {row['axis']}: {row['refused']}")
    if apply is not None:
        typer.echo(f"wrote {apply}")
