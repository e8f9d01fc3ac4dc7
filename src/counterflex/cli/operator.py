"""Commands of the operator of a run that goes on: status, stop, reset, arm."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli.output import print_json
from counterflex.cli.question import AsJson

_operator = typer.Typer(no_args_is_help=True, help="Operate a run that goes on: its state, stop, reset, arm.")
Log = Annotated[Path, typer.Argument(help="Folder that `run` was given with --out.", metavar="DIR")]
_ACTIONS: Final = ("status", "stop", "reset", "arm")


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


def quick(words: Sequence[str]) -> int | None:
    """Do a request of the operator at once, past the command parser, which takes longer to load than a stop may take.

    Args:
        words: Of the command line.

    Returns:
        Exit status; None where this is no plain request, so that the parser has to look at it.
    """
    plain = [word for word in words[2:] if word != "--json"]
    if words[:1] != ["operator"] or len(words) < 2 or words[1] not in _ACTIONS or len(plain) != 1:
        return None
    if plain[0].startswith("-") or len(words) - 2 - len(plain) > 1:
        return None
    return _asked(Path(plain[0]), words[1], as_json="--json" in words[2:])


def _ask(log: Path, action: str, *, as_json: bool) -> None:
    status = _asked(log, action, as_json=as_json)
    if status:
        raise typer.Exit(status)


def _asked(log: Path, action: str, *, as_json: bool) -> int:
    from counterflex.app.operator_requests import request

    found = request(log, action)
    if as_json:
        print_json(found)
    else:
        cause = "" if found["cause"] == "none" else f" ({found['cause'].replace('_', ' ')})"
        held = ", feed held" if found["feed_hold"] else ""
        robot = "" if found["robot_heard"] else ", no telegram yet"
        typer.echo(
            f"{found['state'].replace('_', ' ')}{cause}, correction {found['correction_mm']:.3f} mm{held}{robot}"
        )
        if action == "status":
            for line in _seen(found):
                typer.echo(line)
        if not found["done"]:
            typer.echo(f"{action} refused: {found['refused']}", err=True)
    return int(not found["done"])


def _seen(found: dict[str, Any]) -> list[str]:
    """What else is to be seen of a run: place, force, how old each source is, strangers, losses."""
    lines = []
    if found["place"] is not None:
        lines.append(f"place: {100.0 * found['place']:.1f} % of the plan")
    force = [
        f"{found[key]:.0f} N {word}"
        for key, word in (("force_n", "measured"), ("planned_n", "planned"))
        if found[key] is not None
    ]
    if force:
        lines.append("force: " + ", ".join(force))
    ages = [f"{name} {'nothing yet' if age is None else f'{age:.0f} ms'}" for name, age in found["age_ms"].items()]
    lines.append("age: " + ", ".join(ages))
    lines.append(f"foreign telegrams dropped: {found['foreign']}")
    lost = f" ({found['log_trouble']})" if found["log_trouble"] else ""
    lines.append(f"{'LOG LOST, ' if lost or found['records_lost'] else ''}records lost: {found['records_lost']}{lost}")
    return lines
