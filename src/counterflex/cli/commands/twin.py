"""Commands of the simulated laboratory."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED, address, argument, option
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.run import cell as of_cell
from counterflex.cli.commands.simulated.egm import egm
from counterflex.cli.commands.simulated.instruments import ads, netft, tracker, wrench
from counterflex.cli.commands.simulated.rsi import rsi
from counterflex.cli.output import Layers, keep_inputs, print_json, print_table, progress_bar
from counterflex.core.errors import InputError
from counterflex.core.next_command import next_command


def proxy(
    listen: Annotated[
        str, option("--listen", "Where the side that begins sends to.", arguments.host_port, "HOST:PORT")
    ],
    to: Annotated[str, option("--to", "The other side.", arguments.host_port, "HOST:PORT")],
    log: Annotated[Path | None, option("--log", "Log of what was done (CSV).", arguments.output_file, "FILE")] = None,
    replay: Annotated[Path | None, option("--replay", "Replay such a log.", arguments.file, "FILE")] = None,
    seconds: Annotated[float | None, option("--seconds", "End after so long.", min=0.0)] = None,
    scenario: Layers = None,
) -> None:
    """Simulate an impaired network between two programs over UDP: lose, delay, duplicate and corrupt datagrams.

    The robot (or the client of a sensor) sends to --listen, the proxy forwards to --to and returns the answers. The
    same seed has the same effect on datagram 0, 1, 2, ... in every run.

    Table of the scenario: network.

    Example: `counterflex twin proxy --listen 127.0.0.1:49160 --to 127.0.0.1:49152 -s network.loss=0.05 --log proxy.csv`
    """
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("network",))
    from counterflex.app.simulated_cell import proxy as job
    from counterflex.app.simulated_cell.scenario import impairment

    settings = job.ProxySettings(
        listen=address(listen, "--listen"),
        to=address(to, "--to"),
        way=trial.network.way,
        impairment=impairment(trial.network),
        seed=trial.seed,
        replay=replay,
    )

    with contextlib.suppress(KeyboardInterrupt):
        summary = settings.run(log=log, seconds=seconds, started=lambda where: _started(to, where))
        typer.echo(
            f"there: {summary['there']['carried']} datagrams, {summary['there']['lost']} lost; "
            f"back: {summary['back']['carried']}, {summary['back']['lost']} lost"
            + ("" if log is None else f"; wrote {log}")
        )


def _started(to: str, where: tuple[str, int]) -> None:
    typer.echo(f"carrying from {where[0]}:{where[1]} to {to}; Ctrl-C ends", err=True)


twin = typer.Typer(no_args_is_help=True, help="The simulated cell: measure on it, or run it with its protocols.")


def measure(
    proposal: Annotated[Path, argument("Proposal that identify RECIPE --propose wrote.", arguments.file, "PROPOSAL")],
    cell: CellFile,
    truth: Annotated[Path, option("--truth", "Truth file (.toml).", arguments.file, "TRUTH")],
    out: Out,
    seed: Annotated[
        int,
        option("--seed", "Of the laboratory: where its instruments stand, and their noise.", min=0, max=LARGEST_SEED),
    ] = 0,
    session: Annotated[
        str | None, option("--session", "Each session has different noise; default: the name of the folder.")
    ] = None,
) -> None:
    """Carry out the measurements of a proposal on the simulated cell: a CSV file and its manifest.

    The readings come from the truth, with friction, play, drives and noise; the files contain nothing else of it.

    Example: `counterflex twin measure proposal/proposal.toml --cell cell.toml --truth truth.toml --out data`
    """
    keep_inputs(out, proposal, cell, truth)
    from counterflex.app.campaign import laboratory

    with progress_bar(f"measuring {proposal.name}") as progress:
        measured = laboratory.measure(proposal, cell, truth, out, seed=seed, session=session, progress=progress)
    channels = ", ".join(measured["channels"])
    typer.echo(f"wrote {measured['manifest']}: {measured['rows']} rows of {measured['kind']}, {channels}")
    typer.echo(
        "next: " + next_command(f"identify {measured['recipe']}", measured["manifest"], cell=cell, out="identified")
    )


def track(
    program: Annotated[Path, argument("G-code file.", arguments.file, "PROGRAM")],
    cell: CellFile,
    truth: Annotated[Path, option("--truth", "Truth file (.toml).", arguments.file, "TRUTH")],
    out: Out,
    cycles: Annotated[int, option("--cycles", "How often the program runs.", min=1, max=1000)] = 1,
    seed: Annotated[int, option("--seed", "Of the tracker's noise.", min=0, max=LARGEST_SEED)] = 0,
) -> None:
    """Run a program in the air on the simulated cell and log it with a tracker, in the part frame: tracker.csv.

    iso9283 and iso230 judge such logs. The robot has the errors of the truth, the tracker noise of 15 um per axis.

    Example: `counterflex twin track square.ngc --cell cell.toml --truth truth.toml --cycles 3 --out tracked`
    """
    keep_inputs(out, program, cell, truth)
    from counterflex.app.simulated_cell import tracked_program as job

    with progress_bar(f"tracking {program.name}") as progress:
        summary = job.run(program, cell, truth, out, cycles=cycles, seed=seed, progress=progress)
    typer.echo(
        f"wrote {out / job.LOG}: {summary['readings']} readings, {summary['cycles']} cycles in "
        f"{summary['seconds_of_motion']:g} s"
    )


def scenarios(
    name: Annotated[str | None, argument("Print this one, to begin a file of your own with.", metavar="NAME")] = None,
    as_json: AsJson = False,
) -> None:
    """Scenarios that come with counterflex, for --scenario NAME.

    Example: `counterflex twin scenarios kr_c2`
    """
    from counterflex.files.scenario_file import read_scenario, shipped

    known = shipped()
    if name is not None:
        if name not in known:
            raise InputError("no such scenario", value=name, limit=", ".join(known))
        typer.echo(known[name], nl=False)
        return
    titles = {item: read_scenario([item], ()).title for item in known}
    if as_json:
        print_json(titles)
        return
    print_table("Scenarios", ["name", "what it sets"], [[item, title] for item, title in titles.items()])


for command in (measure, track, scenarios):
    twin.command()(command)
twin.command("cell")(of_cell)
for alone in (rsi, netft, wrench, tracker, ads, egm, proxy):
    twin.command()(alone)
