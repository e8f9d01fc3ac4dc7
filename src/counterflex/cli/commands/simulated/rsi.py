"""Command that starts a simulated KUKA controller by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import given
from counterflex.cli.bounds import MOST_RECORDS
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
from counterflex.core.errors import InputError


def register(twin: typer.Typer) -> None:
    """Add this command."""
    twin.command("rsi")(rsi)


def rsi(
    rsi: Annotated[
        Path,
        typer.Argument(
            help="ETHERNET configuration file of the RSI context (.xml).", metavar="RSI", callback=given.file
        ),
    ],
    program: Annotated[
        Path | None,
        typer.Option(
            "--program", help="G-code that the robot runs, with --cell.", metavar="PROGRAM", callback=given.file
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option("--cell", help="Cell file: robot, tool and part as the controller has them.", callback=given.file),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            help="Without a program and cell: where the tool stands still, mm and deg; 0 where nothing is said.",
            metavar="X,...,C",
            callback=given.numbers_of(6),
        ),
    ] = None,
    joints_deg: Annotated[
        str,
        typer.Option(
            "--joints-deg",
            help="Without a program: the axis angles there; with --cell the tool stands where they have it.",
            metavar="A1,...,A6",
            callback=given.numbers_of(6),
        ),
    ] = "0,-90,90,0,30,0",
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="How long; 10 s without a program.", min=0.01)
    ] = None,
    peer: Annotated[
        str | None,
        typer.Option(
            "--peer", help="Where telegrams go, instead of RSI's own.", metavar="HOST:PORT", callback=given.host_port
        ),
    ] = None,
    realtime: Realtime = False,
    mode: Annotated[
        str,
        typer.Option(
            "--mode",
            help="RSI_ON: absolute or relative corrections.",
            callback=given.one_of(("absolute", "relative"), "mode"),
        ),
    ] = "absolute",
    cycle_ms: Annotated[
        int,
        typer.Option(
            "--cycle-ms",
            help="4 (#IPO_FAST) or 12 (#IPO).",
            min=4,
            max=12,
            callback=given.one_of((4, 12), "cycle of RSI"),
        ),
    ] = 4,
    timeout: Annotated[
        int, typer.Option("--timeout", help="ETHERNET: late answers at which it stops.", min=1, max=MOST_RECORDS)
    ] = 100,
    precision: Annotated[int, typer.Option("--precision", help="ETHERNET: decimals sent.", min=0, max=9)] = 4,
    clamp_mm: Annotated[float, typer.Option("--clamp-mm", help="POSCORR: limit per axis, clamped in silence.")] = 5.0,
    clamp_deg: Annotated[float, typer.Option("--clamp-deg", help="POSCORR: MaxRotAngle.")] = 5.0,
    axis_clamp_deg: Annotated[float, typer.Option("--axis-clamp-deg", help="AXISCORR: limit per axis.")] = 5.0,
    monitor_mm: Annotated[float, typer.Option("--monitor-mm", help="POSCORRMON: MaxTrans, it stops beyond.")] = 6.0,
    monitor_deg: Annotated[float, typer.Option("--monitor-deg", help="POSCORRMON: MaxRotAngle.")] = 6.0,
    empty_first: Annotated[
        bool, typer.Option("--empty-first", help="KR C2: the first telegram holds the counter only.")
    ] = False,
    answer_ms: Annotated[
        float | None, typer.Option("--answer-ms", help="Real time: how long an answer may take, if not the cycle.")
    ] = None,
    dead_ms: DeadMs = 12.0,
    natural_hz: NaturalHz = 5.0,
    damping: Damping = 0.7,
    wait_s: WaitS = 60.0,
    gate_s: Annotated[float, typer.Option("--gate-s", help="Rest before the program starts.", min=0.0)] = 0.8,
    faults: FaultsFile = None,
    fault: Fault = None,
    seed: Seed = None,
    record: RecordFile = None,
    as_json: AsJson = False,
) -> None:
    """A simulated KUKA controller alone: sends RSI telegrams, applies the answers as a real one does, and reports.

    It runs a program or stands still; no physics, no instruments. It shows what a compensator did to the robot: largest
    correction and step, late and refused answers, the age of the correction in force, and why it ended.

    Exit status: 0 the program or the time ended, or an answer stopped the robot; 2 refused, or nobody ever answered;
    3 nobody answered any more.

    Example: `counterflex twin rsi rsi.xml --seconds 5 --fault lost=0.05,direction=in --record applied.csv`
    """
    if record is not None:
        keep_inputs(record, *(path for path in (rsi, program, cell, faults) if path is not None), option="--record")
    if program is not None and cell is None:
        raise InputError("a program needs the cell it runs in", value=program.name, hint="Give --cell")
    if cell is not None and program is None and at is not None:
        raise InputError(
            "where a robot of a cell stands follows from its axis angles",
            where="--at",
            value=at,
            hint="Give --joints-deg instead, or leave out --cell",
        )
    from dataclasses import replace

    import numpy as np

    from counterflex.app.simulated_cell import rsi as job
    from counterflex.core.units import DEG, MM, MS
    from counterflex.geometry import pose
    from counterflex.twin.devices.kuka_rsi import RsiContext
    from counterflex.twin.devices.path_answer import PathAnswer

    place = np.zeros(6) if at is None else np.array(numbers(at, "--at", 6))
    settings = job.LoneRsiSettings(
        rsi=rsi,
        program=program,
        cell=cell,
        T_part_tcp=pose.from_xyz_zyx(place[:3] * MM, place[3:] * DEG),
        q=np.array(numbers(joints_deg, "--joints-deg", 6)) * DEG,
        seconds=10.0 if seconds is None and program is None else seconds,
        peer=None if peer is None else address(peer, "--peer"),
        realtime=realtime,
        wait_s=wait_s,
        gate_s=gate_s,
        answer_s=None if answer_ms is None else answer_ms * MS,
        answer=PathAnswer(dead_ms * MS, natural_hz, damping),
        faults=schedule(faults, fault, seed),
    )
    context = RsiContext(
        mode="absolute" if mode == "absolute" else "relative",
        cycle_s=cycle_ms * MS,
        timeout=timeout,
        precision=precision,
        clamp_m=clamp_mm * MM,
        clamp_rad=clamp_deg * DEG,
        monitor_m=monitor_mm * MM,
        monitor_rad=monitor_deg * DEG,
        axis_clamp_rad=axis_clamp_deg * DEG,
        empty_first=empty_first,
    )

    def started(_: tuple[str, int], where: tuple[str, int]) -> None:
        typer.echo(f"sending to {where[0]}:{where[1]}", err=True)

    with progress_bar(f"RSI {rsi.name}") as progress:
        found = job.run(
            replace(settings, context=context), record=record, started=started, priority=realtime, progress=progress
        )
    if as_json:
        print_json(found)
    else:
        _tell_rsi(found)
    left_alone(found["ended"])


def _tell_rsi(found: dict[str, Any]) -> None:
    correction, step = found["largest_correction"], found["largest_step"]
    typer.echo(f"{found['ended']} after {found['cycles']} telegrams, {found['late_answers']} answers late or refused")
    tell_refused(found)
    for name, value in (("largest correction", correction), ("largest step", step)):
        typer.echo(f"{name}: {value['mm']:g} mm, {value['deg']:g} deg, axes {value['axes_deg']:g} deg")
    age = found["age_cycles"]
    typer.echo(f"correction in force at most {age['max']} cycles old; 4 or less in {age['share_at_most_4']:.4%}")
    tell_reply(found)
    if found["stalls"]:
        typer.echo(f"{found['stalls']} telegrams left late: this computer is too slow for real time", err=True)
