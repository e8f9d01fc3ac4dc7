"""The command opcua: a run for the plant."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option

PORT = 4840


def opcua(
    log: Annotated[Path, argument("Folder that `run` is given with --out.", arguments.output_folder, "DIR")],
    host: Annotated[str, option("--host", "Address to listen on; others need users and encryption.")] = "127.0.0.1",
    port: Annotated[int, option("--port", "TCP port; 0 takes a free one.", min=0, max=65535)] = PORT,
    users: Annotated[Path | None, option("--users", "File of users (panel-user).", arguments.file, "FILE")] = None,
    certificate: Annotated[
        Path | None, option("--certificate", "Certificate of the server (.pem, .der).", arguments.file, "FILE")
    ] = None,
    key: Annotated[Path | None, option("--key", "Private key of the certificate.", arguments.file, "FILE")] = None,
) -> None:
    """Serve state, figures and alarms of a run over OPC UA, named after OPC 40010-1 as far as it fits.

    Start it before or during the run; it waits for a run in DIR. It is a process beside the loop that only reads: it
    cannot stop or delay it. With --users, operators may call one method, Acknowledge, as `operator reset`. Ctrl-C
    closes it. Needs the extra `opcua`.

    Without --users whoever reaches it may read. With --host of a network it needs --users, --certificate and --key.

    Example: `counterflex opcua log`
    """
    from counterflex.app.opcua.settings import OpcuaSettings

    settings = OpcuaSettings(log, host, port, users, certificate, key)
    settings.require_safe()
    from counterflex.app.opcua.server import serve

    serve(settings, _started)


def _started(address: str) -> None:
    typer.echo(f"OPC UA: {address}")
    sys.stdout.flush()
