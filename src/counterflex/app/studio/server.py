"""The process of the studio: the pages of a project behind the gate of the panel, on this computer only."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from nicegui import Client, app, ui
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from counterflex.app.panel.gated_server import GatedServer
from counterflex.app.panel.settings import PanelSettings, require_safe
from counterflex.app.studio import texts
from counterflex.app.studio.desk import UPLOAD
from counterflex.app.studio.jobs import CommandQueue
from counterflex.app.studio.project import Project
from counterflex.app.studio.shell import Shell

_CSS: Final = Path(__file__).with_name("studio.css")
_ALONE: Final = {"content-security-policy": "sandbox allow-scripts allow-downloads", "cache-control": "no-store"}
"""A file of the project is shown without the rights of the studio: its scripts reach no socket and no page of it."""
_SPARE: Final = 1 << 20


class StudioServer(GatedServer):
    """A studio.

    Args:
        started: Told the link that opens it, once.
    """

    def __init__(self, settings: PanelSettings, started: Callable[[list[tuple[str, str]]], None]) -> None:
        super().__init__(settings, started, roles=("operator",), cookie="counterflex-studio")
        os.chdir(settings.folder)  # files are named as the commands name them, in faults too
        self._title = f"counterflex studio: {Path.cwd().name}"
        self._project = Project(Path())
        self._queue = CommandQueue(Path())

    def serve(self) -> None:
        """Serve until the process is asked to end. Raises OutputError: the port cannot be opened."""
        ui.page("/", title=self._title)(self._page)
        app.on_shutdown(self._queue.close)
        try:
            self._run(
                [Route("/login", _closed), Route("/files/{name:path}", self._file)],
                title=self._title, dark=None, body=UPLOAD + _SPARE,
            )  # fmt: skip
        finally:
            self._queue.close()

    def _page(self, client: Client) -> None:
        ui.add_css(_CSS, shared=False)
        Shell(client, self._project, self._queue, self._title)

    async def _file(self, request: Request) -> Response:
        """A file of the project: a page to look at, anything else to keep."""
        path = self._project.inside(request.path_params["name"])
        if path is None:
            return PlainTextResponse(texts.OUTSIDE, 404)
        page = path.suffix == ".html" and "save" not in request.query_params
        return FileResponse(path, filename=None if page else path.name, headers=_ALONE)


async def _closed(_: Request) -> Response:
    return PlainTextResponse(texts.CLOSED, headers={"cache-control": "no-store"})


def serve(settings: PanelSettings, started: Callable[[list[tuple[str, str]]], None]) -> None:
    """Serve a studio until the process is asked to end.

    Args:
        started: Told the link that opens it: whose, and the address.

    Raises:
        InputError: The page library is missing.
    """
    require_safe(settings)
    StudioServer(settings, started).serve()
