"""Commands of the operator panel: panel, panel-user."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option

PORT = 8642
Role = Annotated[str, option("--role", "viewer watches; operator stops, acknowledges, arms.")]


def panel(
    log: Annotated[Path, argument("Folder that `run` is given with --out.", arguments.output_folder, "DIR")],
    host: Annotated[str, option("--host", "Address to listen on; others need users and TLS.")] = "127.0.0.1",
    port: Annotated[int, option("--port", "TCP port; 0 takes a free one.", min=0, max=65535)] = PORT,
    users: Annotated[Path | None, option("--users", "File of users (panel-user).", arguments.file, "FILE")] = None,
    certificate: Annotated[
        Path | None, option("--certificate", "TLS certificate (.pem).", arguments.file, "FILE")
    ] = None,
    key: Annotated[
        Path | None, option("--key", "Private key of the certificate (.pem).", arguments.file, "FILE")
    ] = None,
    metrics_key: Annotated[
        Path | None,
        option("--metrics-key", "File with the key that reads /metrics (OpenMetrics) only.", arguments.file, "FILE"),
    ] = None,
    range_um: Annotated[
        float, option("--range-um", "Deviation at which the colours end, um.", min=1.0, max=10000.0)
    ] = 200.0,
) -> None:
    """Show a run in the browser: state, limits, deviation, force, link, the part as it is cut; stop, acknowledge, arm.

    Start it before or during the run; it waits for a run in DIR. It is a process beside the loop and cannot stop or
    delay it. Ctrl-C closes it; with `without_panel = "hold"` in [online] the loop then holds. Needs the extra
    `panel`. This is no emergency stop; use that of the robot.

    Without --users it serves this computer only, and prints a link for an operator and one for a viewer. With --host
    of a network it needs --users, --certificate and --key.

    Example: `counterflex panel log`
    """
    from counterflex.app.panel.settings import PanelSettings, require_safe

    settings = PanelSettings(log, host, port, users, certificate, key, metrics_key, range_um=range_um)
    require_safe(settings)
    from counterflex.app.panel.server import serve

    serve(settings, _started)


def _started(links: list[tuple[str, str]]) -> None:
    for who, link in links:
        typer.echo(f"{who}: {link}")
    sys.stdout.flush()


def panel_user(
    users: Annotated[Path, argument("File of users (.toml); made when missing.", arguments.output_file, "FILE")],
    name: Annotated[str | None, argument("Name to log in with.", metavar="NAME")] = None,
    role: Role = "viewer",
    remove: Annotated[
        str | None, option("--remove", "Remove this user instead; open sessions end.", metavar="NAME")
    ] = None,
    listed: Annotated[bool, option("--list", "List the users instead.")] = False,
) -> None:
    """Add a user of the panel, or give him another role and password. The password is asked for, or read from stdin.

    The file holds a hash of it (scrypt) and can be read by you only. A running panel reads it again within 1 s.

    Example: `counterflex panel-user users.toml anna --role operator`
    """
    from counterflex.core.errors import InputError
    from counterflex.core.next_command import next_command
    from counterflex.files.panel_users import LEAST, PanelUsers, remove_user, set_user

    if role not in ("viewer", "operator"):
        raise InputError("no such role", where="--role", value=role, limit="viewer or operator")
    if (name is not None) + (remove is not None) + listed != 1:
        raise InputError(
            "give either NAME, --remove NAME or --list",
            where=str(users),
            hint=next_command("panel-user", users, "NAME", role=role),
        )
    if listed:
        for one, its_role in PanelUsers(users).roles().items():
            typer.echo(f"{one}: {its_role}")
    elif remove is not None:
        remove_user(users, remove)
        typer.echo(f"wrote {users}: {remove} is removed")
    elif name is not None:
        password = _password(f"password, at least {LEAST} characters")
        set_user(users, name, "operator" if role == "operator" else "viewer", password)
        typer.echo(f"wrote {users}: {name} is {role}")


def _password(question: str) -> str:
    if sys.stdin.isatty():
        return str(typer.prompt(question, hide_input=True, confirmation_prompt=True))
    return sys.stdin.readline().rstrip("\n")
