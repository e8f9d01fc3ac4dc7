"""Commands of the operator of a run that goes on: status, stop, reset, arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli.commands.operator_now import asked
from counterflex.cli.commands.question import AsJson

_operator = typer.Typer(no_args_is_help=True, help="Operate a run that goes on: its state, stop, reset, arm.")
Log = Annotated[Path, typer.Argument(help="Folder that `run` was given with --out.", metavar="DIR")]


def register(app: typer.Typer) -> None:
    """Add these commands."""
    for command in (status, stop, reset, arm):
        _operator.command()(command)
    _operator.callback()(_group)
    app.add_typer(_operator, name="operator")


def _group() -> None:
    """Operate a run that goes on, from another terminal of the same computer and user."""


def status(log: Log, as_json: AsJson = False) -> None:
    """Say in what state a run is and why, where on the plan, under which force, how old what it knows is.

    Foreign telegrams that were dropped and records that are lost are counted. Asked of the loop itself: it answers also
    where the process that started it has died.

    Example: `counterflex operator status log`
    """
    _ask(log, "status", as_json=as_json)


def stop(log: Log, as_json: AsJson = False) -> None:
    """End the correction: a feed hold is asked for, the correction is ramped out, the robot is told to stop.

    In the cut it is ramped out as soon as the robot stands. One that goes on is told to stop with its correction.

    The loop itself takes it in its next cycle, also where the process that started it, or the recorder, has died. The
    run goes on and can be armed again. The robot's own stop is for emergencies; this is none.

    Example: `counterflex operator stop log`
    """
    _ask(log, "stop", as_json=as_json)


def reset(log: Log, as_json: AsJson = False) -> None:
    """Acknowledge: leave a fault, give a held feed free, take the zero of the force sensor again.

    See to the cause first. A fault is left only when no correction is in force any more: end the robot program. Then
    the run is idle, and ready when all checks are passed; it is not armed by this. A feed hold that is given free lets
    a robot program that was not stopped go on without a correction.

    Example: `counterflex operator reset log`
    """
    _ask(log, "reset", as_json=as_json)


def arm(log: Log, as_json: AsJson = False) -> None:
    """Arm a run that is ready again; the robot program then has to switch the correction on.

    Only for a run that was started with --arm.

    Example: `counterflex operator arm log`
    """
    _ask(log, "arm", as_json=as_json)


def _ask(log: Path, action: str, *, as_json: bool) -> None:
    status = asked(log, action, as_json=as_json)
    if status:
        raise typer.Exit(status)
