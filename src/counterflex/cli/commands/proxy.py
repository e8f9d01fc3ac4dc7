"""The proxy command: a bad network between robot or sensor and the loop."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import given
from counterflex.cli.bounds import LARGEST_SEED, MOST_RECORDS
from counterflex.cli.given import address
from counterflex.core.units import MS


def register(app: typer.Typer) -> None:
    """Add this command."""
    app.command()(proxy)


def proxy(
    listen: Annotated[
        str,
        typer.Option(
            "--listen", help="Where the side that begins sends to.", metavar="HOST:PORT", callback=given.host_port
        ),
    ],
    to: Annotated[str, typer.Option("--to", help="The other side.", metavar="HOST:PORT", callback=given.host_port)],
    log: Annotated[
        Path | None,
        typer.Option("--log", help="Log of what was done (CSV).", metavar="FILE", callback=given.output_file),
    ] = None,
    replay: Annotated[
        Path | None,
        typer.Option("--replay", help="Do again what such a log says.", metavar="FILE", callback=given.file),
    ] = None,
    way: Annotated[
        str,
        typer.Option(
            "--way", help="Bad way: both, there, back.", callback=given.one_of(("both", "there", "back"), "way")
        ),
    ] = "both",
    loss: Annotated[float, typer.Option("--loss", help="Share lost, each datagram by itself.", min=0.0, max=1.0)] = 0.0,
    burst_share: Annotated[float, typer.Option("--burst-share", help="Share lost in bursts.", min=0.0, max=1.0)] = 0.0,
    burst_mean: Annotated[float, typer.Option("--burst-mean", help="Mean length of a burst.", min=1.0)] = 3.0,
    pattern: Annotated[str, typer.Option("--pattern", help="Repeated: 1 comes, 0 is lost; for example 10.")] = "",
    delay_ms: Annotated[float, typer.Option("--delay-ms", help="Delay of all.", min=0.0)] = 0.0,
    jitter_ms: Annotated[float, typer.Option("--jitter-ms", help="Up to this more, by chance.", min=0.0)] = 0.0,
    duplicate: Annotated[float, typer.Option("--duplicate", help="Share that comes twice.", min=0.0, max=1.0)] = 0.0,
    reorder: Annotated[float, typer.Option("--reorder", help="Share that comes later.", min=0.0, max=1.0)] = 0.0,
    reorder_ms: Annotated[float, typer.Option("--reorder-ms", help="How much later.", min=0.0)] = 6.0,
    flip: Annotated[float, typer.Option("--flip", help="Share with one bit turned over.", min=0.0, max=1.0)] = 0.0,
    truncate: Annotated[float, typer.Option("--truncate", help="Share whose end is missing.", min=0.0, max=1.0)] = 0.0,
    garbage: Annotated[float, typer.Option("--garbage", help="Share of random bytes.", min=0.0, max=1.0)] = 0.0,
    stall: Annotated[
        str, typer.Option("--stall", help="Hold back COUNT datagrams from number FIRST on.", metavar="FIRST:COUNT")
    ] = "",
    period_ms: Annotated[float, typer.Option("--period-ms", help="Of --stall, between datagrams.", min=0.01)] = 4.0,
    first: Annotated[
        int, typer.Option("--first", help="Number of the first datagram that may suffer.", min=0, max=MOST_RECORDS)
    ] = 0,
    seed: Annotated[int, typer.Option("--seed", help="Of chance.", min=0, max=LARGEST_SEED)] = 0,
    seconds: Annotated[float | None, typer.Option("--seconds", help="End after so long.", min=0.0)] = None,
) -> None:
    """Stand between two programs that talk over UDP and be a bad network: lose, delay, repeat and damage datagrams.

    The robot (or the client of a sensor) sends to --listen, the proxy hands on to --to and carries back what is
    answered. The same seed does the same to datagram 0, 1, 2, ... in every run.

    Example: `counterflex twin proxy --listen 127.0.0.1:49160 --to 127.0.0.1:49152 --loss 0.05 --log proxy.csv`
    """
    from counterflex.app.simulated_cell import proxy as job

    settings = job.ProxySettings(
        listen=address(listen, "--listen"),
        to=address(to, "--to"),
        way=way,
        loss=loss,
        burst_share=burst_share,
        burst_mean=burst_mean,
        pattern=pattern,
        delay_s=delay_ms * MS,
        jitter_s=jitter_ms * MS,
        duplicate=duplicate,
        reorder=reorder,
        reorder_s=reorder_ms * MS,
        flip=flip,
        truncate=truncate,
        garbage=garbage,
        stall=job.stall_of(stall),
        period_s=period_ms * MS,
        first=first,
        seed=seed,
        replay=replay,
    )

    def started(where: tuple[str, int]) -> None:
        typer.echo(f"carrying from {where[0]}:{where[1]} to {to}; Ctrl-C ends", err=True)

    with contextlib.suppress(KeyboardInterrupt):
        found = job.run(settings, log=log, seconds=seconds, started=started)
        typer.echo(
            f"there: {found['there']['carried']} datagrams, {found['there']['lost']} lost; "
            f"back: {found['back']['carried']}, {found['back']['lost']} lost"
            + ("" if log is None else f"; wrote {log}")
        )
