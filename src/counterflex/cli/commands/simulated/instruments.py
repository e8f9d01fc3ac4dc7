"""Commands that start one simulated instrument or a TwinCAT by itself, on real sockets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import given
from counterflex.cli.commands.program import CellFile
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.simulated.options import Fault, FaultsFile, Host, Seconds, Seed, schedule
from counterflex.cli.given import address, numbers, status_word, target_shape
from counterflex.cli.output import print_json
from counterflex.core.errors import InputError


def register(twin: typer.Typer) -> None:
    """Add these commands."""
    twin.command("netft")(netft)
    twin.command("tracker")(tracker)
    twin.command("ads")(ads)


def netft(
    port: Annotated[int, typer.Option("--port", help="UDP port; 0: a free one.", min=0, max=65535)] = 49152,
    http_port: Annotated[
        int, typer.Option("--http-port", help="Of the scaling document; 0: a free one.", min=0, max=65535)
    ] = 49380,
    host: Host = "127.0.0.1",
    rate_hz: Annotated[int, typer.Option("--rate-hz", help="Samples per second.", min=1, max=7000)] = 1000,
    wrench: Annotated[
        str,
        typer.Option(
            "--wrench", help="Constant load, N and N m.", metavar="FX,FY,FZ,MX,MY,MZ", callback=given.numbers_of(6)
        ),
    ] = "0,0,0,0,0,0",
    amplitude: Annotated[
        str,
        typer.Option(
            "--amplitude", help="Of a sine on top, N and N m.", metavar="FX,...,MZ", callback=given.numbers_of(6)
        ),
    ] = "0,0,0,0,0,0",
    sine_hz: Annotated[float, typer.Option("--sine-hz", help="Its frequency.", min=0.0)] = 1.0,
    file: Annotated[
        Path | None,
        typer.Option(
            "--file",
            help="Recorded load instead: time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm.",
            metavar="CSV",
            callback=given.file,
        ),
    ] = None,
    repeat: Annotated[bool, typer.Option("--repeat", help="Begin the record again after its end.")] = False,
    noise_n: Annotated[float, typer.Option("--noise-n", help="Standard deviation of a force.", min=0.0)] = 1.0,
    noise_nm: Annotated[float, typer.Option("--noise-nm", help="Standard deviation of a moment.", min=0.0)] = 0.1,
    status: Annotated[
        str, typer.Option("--status", help="Status word of every record, 0x...", callback=given.status)
    ] = "0",
    seconds: Seconds = None,
    faults: FaultsFile = None,
    fault: Fault = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """A simulated ATI Net F/T alone: RDT records over UDP, its scaling over HTTP.

    It shows a constant load, a sine or a record, with noise; faults further: saturated, frozen, status=0x80020000,
    offset (of the force), counter=STEP, silent, dying.

    Example: `counterflex twin netft --wrench 0,0,-50,0,0,0 --fault saturated@5+0.1 --seconds 10`
    """
    import numpy as np

    from counterflex.app.simulated_cell import instruments as job
    from counterflex.files.logs.wrench_log import read_wrench_log
    from counterflex.twin.devices.wrench_source import NoisyWrench, RecordedWrench, SteadyWrench, WrenchSource

    source: WrenchSource
    if file is not None:
        source = RecordedWrench(*read_wrench_log(file), repeat=repeat)
    else:
        constant, swing = numbers(wrench, "--wrench", 6), numbers(amplitude, "--amplitude", 6)
        source = SteadyWrench(np.array(constant), np.array(swing), sine_hz)
    planned = schedule(faults, fault, seed)
    settings = job.LoneNetft(
        source=NoisyWrench(source, noise_n, noise_nm, planned.seed),
        rate_hz=rate_hz,
        seconds=seconds,
        host=host,
        port=port,
        http_port=http_port,
        status=status_word(status, "--status"),
        faults=planned,
    )

    def started(udp: tuple[str, int], http: tuple[str, int]) -> None:
        typer.echo(f"force sensor at {udp[0]}:{udp[1]}, scaling at port {http[1]}", err=True)

    found = job.run_netft(settings, started=started)
    if as_json:
        print_json(found)
        return
    typer.echo(f"{found['ended']} after {found['samples']} samples; {found['records']} records left")
    _given_up(found["given_up"])


def tracker(
    to: Annotated[str, typer.Argument(help="Where datagrams go.", metavar="HOST:PORT", callback=given.host_port)],
    at: Annotated[
        str,
        typer.Option(
            "--at",
            help="Pose of the target, or middle of its path, mm and deg.",
            metavar="X,...,C",
            callback=given.numbers_of(6),
        ),
    ] = "3000,0,0,0,0,0",
    path: Annotated[
        str | None,
        typer.Option(
            "--path",
            help="circle:RADIUS or square:SIDE, mm, in the xy plane of --at.",
            metavar="PATH",
            callback=given.target_path,
        ),
    ] = None,
    feed_mm_min: Annotated[float, typer.Option("--feed-mm-min", help="Along the path.", min=0.001)] = 700.0,
    rate_hz: Annotated[int, typer.Option("--rate-hz", help="Measurements per second.", min=1, max=7000)] = 1000,
    noise_um: Annotated[float, typer.Option("--noise-um", help="Of the position, per axis.", min=0.0)] = 15.0,
    noise_urad: Annotated[float, typer.Option("--noise-urad", help="Of the orientation.", min=0.0)] = 30.0,
    log: Annotated[
        Path | None,
        typer.Option(
            "--log", help="Replay a tracker log instead, with its own clock.", metavar="CSV", callback=given.file
        ),
    ] = None,
    run_log: Annotated[
        Path | None,
        typer.Option(
            "--run-log", help="Replay what a run has logged, with --cell.", metavar="DIR", callback=given.folder
        ),
    ] = None,
    cell: Annotated[
        Path | None, typer.Option("--cell", help="Cell file of that run.", metavar="CELL", callback=given.file)
    ] = None,
    speed: Annotated[float, typer.Option("--speed", help="Of a replay; 2: twice as fast.", min=0.01, max=100.0)] = 1.0,
    repeat: Annotated[bool, typer.Option("--repeat", help="Begin a log again after its end.")] = False,
    clock_offset_s: Annotated[float, typer.Option("--clock-offset-s", help="Of the tracker's clock.")] = 0.0,
    clock_drift_ppm: Annotated[float, typer.Option("--clock-drift-ppm", help="How much faster it runs.")] = 0.0,
    seconds: Seconds = None,
    faults: FaultsFile = None,
    fault: Fault = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """A simulated laser tracker alone: sends the pose datagrams of 88 bytes, from a path or from a log.

    Faults further: beam_broken@2+0.5, offset=0:1:0 (mm: a wrong reflector), nan, frozen, status=4 (inaccurate),
    counter=STEP, silent, dying.

    Example: `counterflex twin tracker 127.0.0.1:5001 --path circle:150 --fault beam_broken@2+0.5 --seconds 10`
    """
    if log is not None and run_log is not None:
        raise InputError("two logs to replay", value=f"{log}, {run_log}", hint="Give --log or --run-log")
    if (run_log is None) != (cell is None):
        raise InputError("--run-log and --cell belong together", hint="Give both, or none of them")
    import numpy as np

    from counterflex.app.simulated_cell import instruments as job
    from counterflex.core.units import DEG, MM, MM_PER_MIN, UM, URAD
    from counterflex.files.logs.tracker_log import read_tracker_log
    from counterflex.geometry import pose
    from counterflex.twin.devices.pose_source import CircleTarget, NoisyPose, PoseSource, SquareTarget, StandingTarget

    planned = schedule(faults, fault, seed)
    place = np.array(numbers(at, "--at", 6))
    T = pose.from_xyz_zyx(place[:3] * MM, place[3:] * DEG)
    source: PoseSource | None = None
    recorded = None
    if log is not None:
        recorded = read_tracker_log(log)
    elif run_log is not None and cell is not None:
        from counterflex.app.run.tracker_replay import run_log_as_tracker

        recorded = run_log_as_tracker(run_log, cell)
    else:
        shape, size = target_shape(path)
        source = StandingTarget(T)
        if shape == "circle":
            source = CircleTarget(T, size * MM, feed_mm_min * MM_PER_MIN)
        elif shape == "square":
            source = SquareTarget(T, size * MM, feed_mm_min * MM_PER_MIN)
        source = NoisyPose(source, noise_um * UM, noise_urad * URAD, planned.seed)
    settings = job.LoneTracker(
        peer=address(to, "HOST:PORT"),
        source=source,
        log=recorded,
        rate_hz=rate_hz,
        seconds=seconds,
        sigma_m=noise_um * UM,
        speed=speed,
        repeat=repeat,
        clock_offset_s=clock_offset_s,
        clock_drift_ppm=clock_drift_ppm,
        faults=planned,
    )
    found = job.run_tracker(settings)
    if as_json:
        print_json(found)
        return
    typer.echo(f"{found['ended']} after {found['measurements']} measurements")
    _given_up(found["given_up"])


def _given_up(count: int) -> None:
    if count:
        typer.echo(f"{count} samples were given up: this computer is too slow for the rate", err=True)


def ads(
    cell: CellFile,
    force_n: Annotated[
        str,
        typer.Option(
            "--force-n",
            help="At the tool, holder axes: what strain terminals show.",
            metavar="X,Y,Z",
            callback=given.numbers_of(3),
        ),
    ] = "0,0,0",
    noise_um_m: Annotated[float, typer.Option("--noise-um-m", help="Of a strain terminal.", min=0.0)] = 0.0,
    host: Host = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", help="TCP port; Beckhoff's own library knows no other.", min=0, max=65535)
    ] = 48898,
    path: Annotated[
        str | None,
        typer.Option(
            "--path", help="Of the tracker's target: circle:RADIUS or square:SIDE, mm.", callback=given.target_path
        ),
    ] = None,
    feed_mm_min: Annotated[float, typer.Option("--feed-mm-min", help="Along it.", min=0.001)] = 700.0,
    seconds: Seconds = None,
    faults: FaultsFile = None,
    fault: Fault = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """A simulated TwinCAT alone: the symbols of the cell file's table [ads], over Beckhoff ADS.

    Strain terminals show the strain of a force at the tool, tracker symbols a target that moves, parameters what was
    written. Faults further: silent, dying, frozen, nan.

    Example: `counterflex twin ads --cell cell.toml --force-n 0,200,-50 --seconds 60`
    """
    import numpy as np

    from counterflex.app.simulated_cell import ads as job
    from counterflex.core.units import MICRO, MM, MM_PER_MIN
    from counterflex.geometry import pose
    from counterflex.twin.devices.pose_source import CircleTarget, PoseSource, SquareTarget

    shape, size = target_shape(path)
    middle = pose.make(p=np.array([3.0, 0.0, 0.0]))
    source: PoseSource | None = None
    if shape == "circle":
        source = CircleTarget(middle, size * MM, feed_mm_min * MM_PER_MIN)
    elif shape == "square":
        source = SquareTarget(middle, size * MM, feed_mm_min * MM_PER_MIN)
    settings = job.LoneAds(
        cell=cell,
        force_n=np.array(numbers(force_n, "--force-n", 3)),
        source=source,
        noise=noise_um_m * MICRO,
        host=host,
        port=port,
        seconds=seconds,
        faults=schedule(faults, fault, seed),
    )
    found = job.run(
        settings, started=lambda server: typer.echo(f"TwinCAT at {server.address[0]}:{server.address[1]}", err=True)
    )
    if as_json:
        print_json(found)
        return
    typer.echo(f"{found['ended']} after {found['requests']} requests")
