"""Commands that start one simulated instrument or a TwinCAT by itself, on real sockets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import address, argument, option
from counterflex.cli.commands.program import CellFile
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.simulated.options import Fault, Seconds, say_force_device
from counterflex.cli.output import Layers, host_port, print_summary
from counterflex.core.errors import InputError
from counterflex.core.result import Lines

LoadFile = Annotated[
    Path | None,
    option("--file", "Recorded load instead: time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm.", arguments.file, "CSV"),
]


def netft(
    file: LoadFile = None,
    seconds: Seconds = None,
    scenario: Layers = None,
    fault: Fault = None,
    as_json: AsJson = False,
) -> None:
    """Simulate an ATI Net F/T force sensor: RDT records over UDP, scaling document over HTTP.

    It shows a constant load, a sine or a record, with noise; faults further: saturated, frozen, status=0x80020000,
    offset (of the force), counter=STEP, silent, dying.

    Tables of the scenario: force_sensor, faults.

    Example: `counterflex twin netft -s force_sensor.wrench_n_nm=0,0,-50,0,0,0 --fault saturated@5+0.1 --seconds 10`
    """
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("force_sensor",))
    from counterflex.app.simulated_cell import instruments as job
    from counterflex.app.simulated_cell.scenario import load, schedule
    from counterflex.twin.devices.force_device import ForceStart

    table, faults = trial.force_sensor, schedule(trial, fault)
    host, port = host_port(table.address) or ("127.0.0.1", 49152)
    start = ForceStart(
        host=host,
        port=port,
        http_port=49380 if table.http_port is None else table.http_port,
        rate_hz=table.rate_hz,
        status=table.status,
        faults=faults,
    )
    shown = load(table, file, faults.seed)

    summary = job.LoneForce("netft", shown, start, seconds).run(started=say_force_device)
    _print_end(summary, as_json, "{samples} samples; {records} records left")


def wrench(
    to: Annotated[str, argument("Where datagrams go.", arguments.host_port, "HOST:PORT")],
    file: LoadFile = None,
    source_id: Annotated[
        int, option("--source", "Source id of the datagrams.", metavar="ID", min=0, max=2**31 - 1)
    ] = 0,
    seconds: Seconds = None,
    scenario: Layers = None,
    fault: Fault = None,
    as_json: AsJson = False,
) -> None:
    """Simulate any force sensor behind a bridge: it sends the generic wrench datagram of 72 bytes.

    It shows a constant load, a sine or a record, with noise. Faults further: saturated, frozen, nan, status=4 (a
    warning), offset (of the force), counter=STEP, silent, dying.

    Tables of the scenario: force_sensor, faults.

    Example: `counterflex twin wrench 127.0.0.1:49300 -s force_sensor.wrench_n_nm=0,0,-50,0,0,0 --seconds 0.1`
    """
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("force_sensor",))
    from counterflex.app.simulated_cell import instruments as job
    from counterflex.app.simulated_cell.scenario import load, schedule
    from counterflex.twin.devices.force_device import ForceStart

    table, faults = trial.force_sensor, schedule(trial, fault)
    host, port = address(to, "HOST:PORT")
    values = {"source": source_id}
    start = ForceStart(host=host, port=port, rate_hz=table.rate_hz, status=table.status, faults=faults, values=values)
    shown = load(table, file, faults.seed)
    summary = job.LoneForce("wrench", shown, start, seconds).run()
    _print_end(summary, as_json, "{samples} samples")


def tracker(
    to: Annotated[str, argument("Where datagrams go.", arguments.host_port, "HOST:PORT")],
    log: Annotated[
        Path | None, option("--log", "Replay a tracker log instead, with its own clock.", arguments.file, "CSV")
    ] = None,
    run_log: Annotated[
        Path | None, option("--run-log", "Replay what a run has logged, with --cell.", arguments.folder, "DIR")
    ] = None,
    cell: Annotated[Path | None, option("--cell", "Cell file of that run.", arguments.file, "CELL")] = None,
    seconds: Seconds = None,
    scenario: Layers = None,
    fault: Fault = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a laser tracker: it sends the pose datagrams of 88 bytes, from a path or from a log.

    Faults further: beam_broken@2+0.5, offset=0:1:0 (mm: a wrong reflector), nan, frozen, status=4 (inaccurate),
    counter=STEP, silent, dying.

    Tables of the scenario: tracker, target, faults.

    Example: `counterflex twin tracker 127.0.0.1:5001 -s target.circle_radius_mm=150 --fault beam_broken@2+0.5`
    """
    if log is not None and run_log is not None:
        raise InputError("two logs to replay", value=f"{log}, {run_log}", hint="Give --log or --run-log")
    if (run_log is None) != (cell is None):
        raise InputError("--run-log and --cell belong together", hint="Give both, or none of them")
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("tracker", "target"))
    from counterflex.app.simulated_cell import instruments as job
    from counterflex.app.simulated_cell.scenario import late, schedule, target
    from counterflex.core.units import UM, URAD
    from counterflex.files.logs.tracker_log import read_tracker_log
    from counterflex.twin.devices.pose_source import NoisyPose

    table = trial.tracker
    faults = schedule(trial, fault, late(table))
    recorded, sigma_m = None, table.noise_um * UM
    if log is not None:
        recorded = read_tracker_log(log)
    elif run_log is not None and cell is not None:
        from counterflex.app.run.tracker_replay import run_log_as_tracker

        recorded = run_log_as_tracker(run_log, cell)
    seen = NoisyPose(target(trial.target), sigma_m, table.noise_urad * URAD, faults.seed)
    settings = job.LoneTracker(
        peer=address(to, "HOST:PORT"),
        source=seen if recorded is None else None,
        log=recorded,
        rate_hz=table.rate_hz,
        seconds=seconds,
        sigma_m=sigma_m,
        speed=table.speed,
        repeat=table.repeat,
        clock_offset_s=table.clock_offset_s,
        clock_drift_ppm=table.clock_drift_ppm,
        faults=faults,
    )
    summary = settings.run()
    _print_end(summary, as_json, "{measurements} measurements")


def _print_end(summary: dict[str, Any], as_json: bool, what: str) -> None:
    """Print how many telegrams of an instrument went out, and whether this computer was too slow."""
    print_summary(Lines(summary, "{ended} after " + what), as_json)
    if not as_json and summary.get("given_up"):
        typer.echo(f"{summary['given_up']} samples were given up: this computer is too slow for the rate", err=True)


def ads(
    cell: CellFile,
    host: Annotated[str, option("--host", "Address to bind; by default this computer only.")] = "127.0.0.1",
    port: Annotated[
        int, option("--port", "TCP port; Beckhoff's own library knows no other.", min=0, max=65535)
    ] = 48898,
    seconds: Seconds = None,
    scenario: Layers = None,
    fault: Fault = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a TwinCAT: the symbols of the table [ads] of the cell file, over Beckhoff ADS.

    Strain terminals show the strain of a force at the tool, tracker symbols a target that moves, parameters what was
    written. Faults further: silent, dying, frozen, nan.

    Tables of the scenario: strain, target, faults.

    Example: `counterflex twin ads --cell cell.toml -s strain.force_n=0,200,-50 --seconds 60`
    """
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("strain", "target"))
    import numpy as np

    from counterflex.app.plc import PLCS
    from counterflex.app.simulated_cell.scenario import schedule, target
    from counterflex.core.registry import imported
    from counterflex.core.units import MICRO

    summary = imported(PLCS["ads"].alone)(
        cell=cell,
        force_n=np.array(trial.strain.force_n),
        source=target(trial.target),
        noise=trial.strain.noise_um_m * MICRO,
        host=host,
        port=port,
        seconds=seconds,
        faults=schedule(trial, fault),
        started=lambda server: typer.echo(f"TwinCAT at {server.address[0]}:{server.address[1]}", err=True),
    )
    _print_end(summary, as_json, "{requests} requests")
