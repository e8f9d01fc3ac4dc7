"""The proxy command: a bad network between robot or sensor and the loop."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import address, option
from counterflex.cli.scenario import Layers


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
