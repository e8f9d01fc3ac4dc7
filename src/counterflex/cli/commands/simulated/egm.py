"""Command that starts a simulated ABB controller by itself."""

from __future__ import annotations

from typing import Annotated

import typer

from counterflex.cli import given
from counterflex.cli.commands.program import CellFile, Program
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.simulated.options import (
    Damping,
    DeadMs,
    Fault,
    FaultsFile,
    NaturalHz,
    Realtime,
    RecordFile,
    Seed,
    WaitS,
    left_alone,
    schedule,
    tell_refused,
    tell_reply,
)
from counterflex.cli.given import address, numbers
from counterflex.cli.output import keep_inputs, print_json, progress_bar


def register(twin: typer.Typer) -> None:
    """Add this command."""
    twin.command("egm")(egm)


def egm(
    program: Program,
    cell: CellFile,
    peer: Annotated[
        str,
        typer.Option(
            "--egm",
            help="Where messages go: counterflex run --egm PORT.",
            metavar="HOST:PORT",
            callback=given.host_port,
        ),
    ] = "127.0.0.1:6510",
    robotware: Annotated[
        int,
        typer.Option(
            "--robotware",
            help="6 or 7: how the own force is written.",
            min=6,
            max=7,
            callback=given.one_of((6, 7), "RobotWare"),
        ),
    ] = 7,
    force_n: Annotated[
        str | None,
        typer.Option(
            "--force-n",
            help="The robot measures this force itself, N and N m.",
            metavar="FX,FY,FZ,MX,MY,MZ",
            callback=given.numbers_of(6),
        ),
    ] = None,
    timeout_ms: Annotated[
        float | None, typer.Option("--timeout-ms", help="CommTimeout, instead of the cell's; ABB's default is 1000.")
    ] = None,
    dead_ms: DeadMs = 12.0,
    natural_hz: NaturalHz = 5.0,
    damping: Damping = 0.7,
    seconds: Annotated[float | None, typer.Option("--seconds", help="At most so long.", min=0.01)] = None,
    realtime: Realtime = False,
    wait_s: WaitS = 60.0,
    gate_s: Annotated[float, typer.Option("--gate-s", help="Rest before the movement starts.", min=0.0)] = 3.0,
    faults: FaultsFile = None,
    fault: Fault = None,
    seed: Seed = None,
    record: RecordFile = None,
    as_json: AsJson = False,
) -> None:
    """A simulated ABB controller alone: sends EGM messages, applies what comes as a real one does, and reports.

    The table [egm] of the cell says which way: mode = "path" runs the program and lets it be corrected, mode = "pose"
    goes where it is sent. No physics, no instruments.

    Example: `counterflex twin egm part.ngc --cell cell.toml --egm 127.0.0.1:6510 --record applied.csv`
    """
    if record is not None:
        keep_inputs(record, *(path for path in (program, cell, faults) if path is not None), option="--record")
    import numpy as np

    from counterflex.app.simulated_cell import egm as job
    from counterflex.core.units import MS
    from counterflex.twin.devices.path_answer import PathAnswer

    settings = job.LoneEgmSettings(
        program=program,
        cell=cell,
        peer=address(peer, "--egm"),
        robotware=robotware,
        force=None if force_n is None else np.array(numbers(force_n, "--force-n", 6)),
        timeout_s=None if timeout_ms is None else timeout_ms * MS,
        dead_s=dead_ms * MS,
        answer=PathAnswer(dead_ms * MS, natural_hz, damping),
        seconds=seconds,
        realtime=realtime,
        wait_s=wait_s,
        gate_s=gate_s,
        faults=schedule(faults, fault, seed),
    )

    def started(_: tuple[str, int], where: tuple[str, int]) -> None:
        typer.echo(f"sending to {where[0]}:{where[1]}", err=True)

    with progress_bar(f"EGM {program.name}") as progress:
        found = job.run(settings, record=record, started=started, progress=progress)
    if as_json:
        print_json(found)
        left_alone(found["ended"])
        return
    typer.echo(f"{found['ended']} after {found['cycles']} messages, {found['late_answers']} cycles without one for us")
    tell_refused(found)
    typer.echo(f"largest distance of the tool from its program: {found['largest_shift_mm']:g} mm")
    tell_reply(found)
    left_alone(found["ended"])
