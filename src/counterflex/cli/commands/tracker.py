"""Commands of real trackers."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import address, argument, option
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.standards.options import Format
from counterflex.core import file_content

tracker = typer.Typer(no_args_is_help=True, help="Laser trackers: bring their measurements to the loop.")


def _complain(what: str) -> None:
    typer.echo(f"left out: {what}", err=True)


def bridge(
    to: Annotated[str, argument("Where datagrams go: the loop's tracker.address.", arguments.host_port, "HOST:PORT")],
    file: Annotated[
        Path | None, option("--file", "Read lines from there; else from standard input.", arguments.file, "CSV")
    ] = None,
    form: Format = "counterflex",
    as_json: AsJson = False,
) -> None:
    """Convert the text output of a tracker's own program into pose datagrams, line by line.

    In the format counterflex the first line names the columns: time_s (or time_ns); distance_mm,azimuth_deg,zenith_deg
    as a tracker measures them, or x_mm,y_mm,z_mm; qw,qx,qy,qz where the target has an orientation; status and sigma_mm
    where known. --format reads exports of other programs (docs/iso9283.md). An invalid line is skipped with a message.
    Lines come from standard input: tracker_program | counterflex ...

    Example: `counterflex tracker bridge 127.0.0.1:5001`
    """
    from counterflex.app.run.tracker_bridge import forward
    from counterflex.cli.output import print_json

    peer = address(to, "HOST:PORT")
    if file is None:
        summary = forward(sys.stdin, peer, "standard input", form=form, complain=_complain)
    else:
        lines = file_content.text(file).splitlines()
        summary = forward(lines, peer, str(file), form=form, complain=_complain)
    if as_json:
        print_json(summary)
    else:
        typer.echo(f"{summary['sent']} datagrams sent, {summary['left_out']} lines skipped")


tracker.command("bridge")(bridge)
