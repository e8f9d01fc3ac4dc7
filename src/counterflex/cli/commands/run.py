"""Commands that correct while milling: run, and the simulated cell to run against."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments, interrupt
from counterflex.cli.arguments import address, option
from counterflex.cli.commands.program import CellFile, MachineOptions, Out, Program
from counterflex.cli.commands.simulated.options import require_not_abandoned, say_force_device
from counterflex.cli.option_records import with_records
from counterflex.cli.output import Layers, host_port, keep_inputs, line_period_s, print_summary, progress_bar
from counterflex.core.errors import InputError
from counterflex.core.result import Parts, ShownTable, Summary

Rsi = Annotated[
    Path | None, option("--rsi", "KUKA: ETHERNET configuration file of the RSI context (.xml).", arguments.file, "FILE")
]


def one_link(rsi: Path | None, egm: object) -> tuple[str, Path | None] | None:
    """The link that is given and its file; None where the cell file is to name it. Raises InputError: two are given."""
    if rsi is not None and egm is not None:
        raise InputError(
            "the robot's protocol is not clear",
            value="both",
            limit="--rsi FILE for a KUKA robot or --egm for an ABB robot",
        )
    if rsi is None:
        return None if egm is None else ("egm", None)
    return "rsi", rsi


def run(
    cell: CellFile,
    out: Out,
    rsi: Rsi = None,
    egm: Annotated[
        int | None, option("--egm", "ABB: UDP port for EGM, set up by [egm].", metavar="PORT", min=0, max=65535)
    ] = None,
    plan: Annotated[
        Path | None, option("--plan", "Plan file of the program (.parquet).", arguments.file, "PLAN")
    ] = None,
    original: Annotated[
        bool, option("--original", "The robot runs the original program, not the compensated one.")
    ] = False,
    arm: Annotated[
        bool, option("--arm", "Arm when all checks have passed. Without it the loop only monitors.")
    ] = False,
    trust_machine: Annotated[
        bool, option("--trust-machine", "Arm although counterflex doctor has not passed this computer.")
    ] = False,
    scenario: Layers = None,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Correct the robot during milling from force, plan and tracker, and log every cycle.

    Without --arm every answer is zero: start this way. With a real robot --arm needs a computer that `doctor` has
    passed. The log goes to DIR as run-000.mcap, run-001.mcap, ... During the run `operator stop DIR`, `operator reset
    DIR` and `operator arm DIR` from another terminal stop the correction, acknowledge and arm again. Ctrl-C ramps the
    correction out before it ends.

    Exit status: 0 the program ended as planned; 2 refused before it began; 3 a fault, or a hold that did not end, ended
    the correction; 4 never armed; 5 records are missing in the log; 6 the operator ended the correction; 1 the loop
    died; 130 Ctrl-C, 143 request to terminate, 129 terminal closed, unless there was a fault or a lost log.

    Tables of the scenario: run, force_sensor (addresses), strain (address), tracker (address).

    Example: `counterflex run --cell cell.toml --rsi rsi.xml --plan plan.parquet --scenario trial.toml --out log`
    """
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("run", "force_sensor", "strain", "tracker"))
    sensor, program, lockstep = trial.force_sensor, trial.run.program, trial.run.lockstep
    keep_inputs(out, cell, rsi, plan, program)
    robot = one_link(rsi, egm)
    from counterflex.app.run import run as job
    from counterflex.app.run.session import RunSettings
    from counterflex.cli.commands.operate.status_line import Preparing, StatusLines

    tracker, strain = host_port(trial.tracker.address), host_port(trial.strain.address)
    if arm and not lockstep and not trust_machine:
        from counterflex.app.doctor import require_fit

        require_fit()
    settings = RunSettings(
        cell=cell,
        robot=robot,
        plan=plan,
        program=program,
        compensated=not original,
        host=trial.run.listen,
        port=egm,
        force=host_port(sensor.address),
        force_http_port=80 if sensor.http_port is None else sensor.http_port,
        currents=trial.run.currents,
        tracker_port=None if tracker is None else tracker[1],
        strain_port=None if strain is None else strain[1],
        peer=host_port(trial.run.peer),
        arm=arm,
        lockstep=lockstep,
        force_wait_s=60.0 if lockstep else 10.0,
    )

    if line_period_s() > 0.0:
        other = "; start the simulated cell now, it is waited for" if lockstep else ""
        typer.echo(f"preparing the loop: cell, plan, sensors{other}", err=True)
    summary = job.run(
        settings,
        out,
        watch=StatusLines(),
        most_s=trial.run.seconds,
        started=lambda where: _started(out, where),
        warn=_warn,
        preparing=Preparing(line_period_s()),
    )
    print_summary(_RunSummary(summary), as_json, out)
    if summary["ended"]["wrong"]:
        interrupt.went_wrong(summary["ended"]["status"])
    if summary["ended"]["status"]:
        typer.echo(f"ended: {summary['ended']['said']}", err=True)
        raise typer.Exit(summary["ended"]["status"])


def _started(out: Path, where: tuple[str, int]) -> None:
    interrupt.keeps(f"the log up to here is in {out}; the loop ramps the correction out and ends by itself")
    typer.echo(f"waiting for the robot at {where[0]}:{where[1]}", err=True)


def _warn(line: str) -> None:
    typer.echo(f"warning: {line}", err=True)


class _RunSummary(Summary):
    """Counts, times and events of an online run."""

    def _shown(self) -> Parts:
        from counterflex.app.run.log_summary import process_parts
        from counterflex.protocols.session.comparison import summary_lines

        columns = "cycles:g | seconds:g | largest correction um:g | compute p50 us=compute_us[p50]:g | "
        yield ShownTable.of("Online run", columns + "p99 us=compute_us[p99]:g | records lost", [self])
        yield "states: " + ", ".join(f"{name} {count}" for name, count in self["states"].items())
        yield from process_parts(self)
        yield from summary_lines(self["compared"])
        if self["causes"]:
            yield "causes: " + ", ".join(name.replace("_", " ") for name in self["causes"])


@with_records
def cell(
    program: Program,
    cell: CellFile,
    truth: Annotated[Path, option("--truth", "Truth file (.toml).", arguments.file, "TRUTH")],
    out: Out,
    rsi: Rsi = None,
    egm: Annotated[
        str | None,
        option("--egm", "ABB: where EGM messages go; set up by [egm] of the cell.", arguments.host_port, "HOST:PORT"),
    ] = None,
    original: Annotated[
        Path | None,
        option("--original", "The uncompensated program, reference of a compensated one.", arguments.file, "PROGRAM"),
    ] = None,
    *,
    source: MachineOptions,
    scenario: Layers = None,
) -> None:
    """Run a program on the simulated cell behind its real protocols: RSI or EGM, force sensor, strains, tracker.

    It sends at once: start `counterflex run` first. Writes the files of `simulate` into DIR, and nothing without an
    answer; it ends when `counterflex run` has ended.

    Tables of the scenario: controller, rsi, egm, force_sensor (addresses), strain (address, ads, rate_hz, warm_k),
    tracker (address, rate_hz, late_ms), faults (of the strain amplifiers).

    Example: `counterflex twin cell part.ngc --cell cell.toml --truth truth.toml --rsi rsi.xml --out part`
    """
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("controller", "rsi", "egm", "force_sensor", "strain", "tracker"))
    keep_inputs(out, program, cell, truth, rsi, original, source.parameters)
    robot = one_link(rsi, egm)
    from counterflex.app.simulated_cell import cell as job, scenario as shown

    sensor, own_force = trial.force_sensor, trial.egm.own_force
    force_host, force_port = host_port(sensor.address) or ("127.0.0.1", 0)
    strained, terminals = host_port(trial.strain.address), host_port(trial.strain.ads)
    settings = job.LiveSettings(
        program=program,
        cell=cell,
        truth=truth,
        robot=robot,
        original=original,
        reading=source.reading(),
        peer=host_port(trial.controller.peer) or (None if egm is None else address(egm, "--egm")),
        own_force=own_force,
        force_port=None if own_force or ((strained or terminals) and not force_port) else force_port,
        force_http_port=sensor.http_port or 0,
        force_host=force_host,
        tracker_peer=host_port(trial.tracker.address),
        tracker_hz=trial.tracker.rate_hz,
        tracker_faults=shown.late(trial.tracker),
        strain_peer=strained,
        strain_plc=None if terminals is None else ("ads", terminals),
        strain_hz=trial.strain.rate_hz,
        strain_warm_k=trial.strain.warm_k,
        strain_faults=shown.schedule(trial).faults if strained or terminals else (),
        seed=trial.seed,
        timing=shown.timing(trial.controller, gate_s=0.8),
        scenario=trial,
        answer=shown.path_answer(trial.controller),
    )

    known = bool(force_port and sensor.http_port)  # the ports are the caller's
    with progress_bar(f"milling {program.name}") as progress:
        summary = job.run(settings, out, started=_silent if known else say_force_device, progress=progress)
    online = summary["online"]
    typer.echo(f"{online['ended']} after {online['cycles']} telegrams, {online['late_answers']} late; wrote {out}")
    require_not_abandoned(online["ended"])


def _silent(_: object) -> None:
    pass
