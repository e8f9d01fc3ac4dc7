"""Options that the commands of simulated controllers and instruments share, and what they print alike."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.core.result import PlainLine

Fault = Annotated[
    list[str] | None,
    option(
        "--fault",
        "One fault, repeatable: lost=0.05, late=0.1,late_ms=6, silent@2+0.5 (from 2 s for 0.5 s), garbage#100+3 "
        "(datagrams 100 to 102), dying@3.",
        arguments.faults,
        "FAULT",
    ),
]
Seconds = Annotated[float | None, option("--seconds", "How long; else until Ctrl-C.", min=0.001)]
RecordFile = Annotated[
    Path | None, option("--record", "Write what was applied in every cycle.", arguments.output_file, "CSV")
]


def refused_lines(summary: dict[str, Any]) -> list[PlainLine]:
    """Answers that were refused, by cause."""
    counts = ", ".join(f"{why} {count}" for why, count in summary["refused"].items())
    return [PlainLine(f"refused: {counts}")] if counts else []


def reply_lines(summary: dict[str, Any]) -> list[PlainLine]:
    """Times of reply."""
    times = ", ".join(f"{name} {value:g} us" for name, value in (summary["reply_us"] or {}).items())
    return [PlainLine(f"reply: {times}")] if times else []


def print_start(_: tuple[str, int], where: tuple[str, int]) -> None:
    """Print where a controller sends to."""
    typer.echo(f"sending to {where[0]}:{where[1]}", err=True)


ABANDONED = ("no more answers from the sensor program", "RSITimeout", "ERR_UDPUC_COMM")
"""Ends of a simulated controller for which it had no part in it: nobody answered any more."""


def require_not_abandoned(ended: str) -> None:
    """End with status 3 where the partner has vanished before the program had ended; a Stop from it is an answer.

    Raises:
        typer.Exit: It was left alone.
    """
    if ended in ABANDONED:
        raise typer.Exit(3)


def say_force_device(device: Any) -> None:
    """Say where a simulated force sensor with a scaling document listens."""
    udp, http = (None, None) if device is None else (device.address, device.http_address)
    if udp and http:
        typer.echo(f"force sensor at {udp[0]}:{udp[1]}, scaling at port {http[1]}", err=True)
