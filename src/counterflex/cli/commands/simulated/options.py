"""Options that the commands of simulated controllers and instruments share, and what they print alike."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from counterflex.cli import given
from counterflex.cli.bounds import LARGEST_SEED

if TYPE_CHECKING:
    from counterflex.twin.network.faults import FaultSchedule

FaultsFile = Annotated[
    Path | None,
    typer.Option("--faults", help="Fault file (.toml): what goes wrong when.", metavar="FILE", callback=given.file),
]
Fault = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        help="One fault, repeatable: lost=0.05, late=0.1,late_ms=6, silent@2+0.5 (from 2 s for 0.5 s), garbage#100+3 "
        "(datagrams 100 to 102), dying@3.",
        metavar="FAULT",
        callback=given.faults,
    ),
]
Seed = Annotated[
    int | None,
    typer.Option("--seed", help="Of chance, instead of the file's; 0 without a file.", min=0, max=LARGEST_SEED),
]
Realtime = Annotated[
    bool, typer.Option("--realtime", help="Keep real time; else wait for every answer, as fast as both can.")
]
Seconds = Annotated[float | None, typer.Option("--seconds", help="How long; else until Ctrl-C.", min=0.001)]
WaitS = Annotated[
    float, typer.Option("--wait-s", help="How long it waits for the sensor program; 0: not at all.", min=0.0)
]
DeadMs = Annotated[float, typer.Option("--dead-ms", help="Dead time of the path's answer.", min=0.0)]
NaturalHz = Annotated[
    float, typer.Option("--natural-hz", help="Natural frequency of the path's answer; 0: no lag.", min=0.0)
]
Damping = Annotated[float, typer.Option("--damping", help="Its damping ratio.", min=0.01)]
RecordFile = Annotated[
    Path | None,
    typer.Option("--record", help="Write what was applied in every cycle.", metavar="CSV", callback=given.output_file),
]
Host = Annotated[str, typer.Option("--host", help="Address to bind; only this computer unless told.")]


def schedule(file: Path | None, short: list[str] | None, seed: int | None) -> FaultSchedule:
    """The faults of the options ``--faults``, ``--fault`` and ``--seed``."""
    from counterflex.files.fault_file import read_faults

    return read_faults(file, short or (), seed)


def tell_refused(found: dict[str, Any]) -> None:
    """Answers that were refused, by reason."""
    if found["refused"]:
        typer.echo("refused: " + ", ".join(f"{why} {count}" for why, count in found["refused"].items()))


def tell_reply(found: dict[str, Any]) -> None:
    """Time that replies took, where it was real time."""
    if found["reply_us"] is not None:
        typer.echo("reply: " + ", ".join(f"{name} {value:g} us" for name, value in found["reply_us"].items()))


LEFT = ("sensor program gone", "RSITimeout", "ERR_UDPUC_COMM")
"""Ends of a simulated controller for which it had no part in it: nobody answered any more."""


def left_alone(ended: str) -> None:
    """End with status 3 where the partner has vanished before the program had ended; a Stop from it is an answer.

    Args:
        ended: Why the simulated controller ended.

    Raises:
        typer.Exit: It was left alone.
    """
    if ended in LEFT:
        raise typer.Exit(3)
