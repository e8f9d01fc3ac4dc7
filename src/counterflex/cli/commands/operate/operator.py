"""Commands of the operator of a current run: status, stop, reset, arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli.arguments import argument
from counterflex.cli.commands.operate.requests import send_request
from counterflex.cli.commands.question import AsJson

operator = typer.Typer(no_args_is_help=True, help="Operate a current run: status, stop, reset, arm.")
Log = Annotated[Path, argument("Folder that `run` was given with --out.", metavar="DIR")]


def status(log: Log, as_json: AsJson = False) -> None:
    """Show the state of a run and its cause, the place on the plan, the force, and the age of its inputs.

    Counts dropped telegrams of unknown senders and lost records. The loop itself answers, even if the process that
    started it has died.

    Example: `counterflex operator status log`
    """
    _ask(log, "status", as_json=as_json)


def stop(log: Log, as_json: AsJson = False) -> None:
    """Stop the correction: request a feed hold, ramp the correction out, stop the robot.

    In the cut it is ramped out as soon as the robot stands. A robot that moves on is stopped with its correction.

    The loop reads the request in its next cycle, even if the process that started it, or the recorder, has died. The
    run continues and can be armed again. This is no emergency stop; use that of the robot.

    Example: `counterflex operator stop log`
    """
    _ask(log, "stop", as_json=as_json)


def reset(log: Log, as_json: AsJson = False) -> None:
    """Acknowledge: leave a fault, release the feed hold, tare the force sensor.

    Remove the cause first. A fault is left only when no correction is in effect any more: end the robot program. Then
    the run is idle, and ready when all checks have passed; it does not arm. After the release of a feed hold a robot
    program that was not stopped continues without correction.

    Example: `counterflex operator reset log`
    """
    _ask(log, "reset", as_json=as_json)


def arm(log: Log, as_json: AsJson = False) -> None:
    """Arm a run that is ready; the robot program must then enable the correction.

    Only for a run that was started with --arm.

    Example: `counterflex operator arm log`
    """
    _ask(log, "arm", as_json=as_json)


def _ask(log: Path, action: str, *, as_json: bool) -> None:
    status = send_request(log, action, as_json=as_json)
    if status:
        raise typer.Exit(status)


for command in (status, stop, reset, arm):
    operator.command()(command)
