"""Commands of the operator of a current run: status, stop, reset, arm."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli.arguments import argument
from counterflex.cli.commands.question import AsJson

_ACTIONS: Final = ("status", "stop", "reset", "arm")


def quick(words: Sequence[str]) -> int | None:
    """Do a request of the operator at once, past the command parser, which takes longer to load than a stop may take.

    Returns:
        Exit status; None where this is no plain request, so that the parser has to look at it.
    """
    plain = [word for word in words[2:] if word != "--json"]
    if words[:1] != ["operator"] or len(words) < 2 or words[1] not in _ACTIONS or len(plain) != 1:
        return None
    if plain[0].startswith("-") or len(words) - 2 - len(plain) > 1:
        return None
    return send_request(Path(plain[0]), words[1], as_json="--json" in words[2:])


def send_request(log: Path, action: str, *, as_json: bool) -> int:
    """Ask something of a run and print the answer.

    Args:
        action: ``status``, ``stop``, ``reset`` or ``arm``.

    Returns:
        Exit status: 1 where it was refused.

    Raises:
        CounterflexError: No run goes on there, or it does not answer.
    """
    from counterflex.app.run.operator_requests import request

    reply = request(log, action)
    if as_json:
        import json

        print(json.dumps(reply, indent=2, allow_nan=False))
    else:
        cause = "" if reply["cause"] == "none" else f" ({reply['cause'].replace('_', ' ')})"
        feed = ", feed held" if reply["feed_hold"] else ""
        robot = "" if reply["robot_heard"] else ", no telegram yet"
        print(f"{reply['state'].replace('_', ' ')}{cause}, correction {reply['correction_mm']:.3f} mm{feed}{robot}")
        if action == "status":
            for line in _seen(reply):
                print(line)
        if not reply["done"]:
            print(f"{action} refused: {reply['refused']}", file=sys.stderr)
    return int(not reply["done"])


def _seen(reply: dict[str, Any]) -> list[str]:
    """Return what else is to be seen of a run: place, force, how old each source is, strangers, losses."""
    lines = []
    if reply["place"] is not None:
        lines.append(f"place: {100.0 * reply['place']:.1f} % of the plan")
    force = [
        f"{reply[key]:.0f} N {word}"
        for key, word in (("force_n", "measured"), ("planned_n", "planned"))
        if reply[key] is not None
    ]
    if force:
        lines.append("force: " + ", ".join(force))
    ages = [f"{name} {'nothing yet' if age is None else f'{age:.0f} ms'}" for name, age in reply["age_ms"].items()]
    lines.append("age: " + ", ".join(ages))
    if reply.get("tracker_off") is not None:
        from counterflex.protocols.session.tracker_off import offset_message

        lines.append(offset_message(reply["tracker_off"]))
    lines.append(f"foreign telegrams dropped: {reply['foreign']}")
    lost = f" ({reply['log_trouble']})" if reply["log_trouble"] else ""
    lines.append(
        f"{'LOGGING STOPPED, ' if lost or reply['records_lost'] else ''}records lost: {reply['records_lost']}{lost}"
    )
    return lines


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
