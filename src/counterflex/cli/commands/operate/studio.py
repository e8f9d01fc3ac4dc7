"""Command of the studio."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option

PORT = 8643


def studio(
    folder: Annotated[
        Path, argument("Folder of the project; made when missing.", arguments.output_folder, "FOLDER")
    ] = Path(),
    port: Annotated[int, option("--port", "TCP port; 0 takes a free one.", min=0, max=65535)] = PORT,
    browser: Annotated[bool, option("--browser/--no-browser", "Open the link in the browser.")] = True,
) -> None:
    """Work in the browser: from a robot of the catalogue and a CAM program to a compensated, proved program.

    FOLDER is the project: its files are those that the commands read and write. Pages for the cell, the program, its
    check, plan and proof, the inspection of the part and the correction of the next one. Each button shows the
    command that does the same, and runs it in FOLDER; studio-commands.txt there lists them.

    It serves this computer only, by the link that it prints. Ctrl-C closes it and ends what it runs. Needs the extra
    `panel`.

    Example: `counterflex studio part-17`
    """
    from counterflex.app.panel.settings import PanelSettings, require_safe

    settings = PanelSettings(folder, port=port)
    require_safe(settings)
    from counterflex.app.studio.server import serve

    folder.mkdir(parents=True, exist_ok=True)
    serve(settings, _opened if browser else _started)


def _started(links: list[tuple[str, str]]) -> None:
    for _, link in links:
        typer.echo(f"studio: {link}")
    sys.stdout.flush()


def _opened(links: list[tuple[str, str]]) -> None:
    import threading
    import webbrowser

    _started(links)
    threading.Thread(target=webbrowser.open, args=(links[0][1],), daemon=True).start()  # a browser of text stays in it
