"""A web server of one page library behind the gate: loopback or TLS, sessions, bounded connections of strangers."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
import socket
from collections.abc import Callable, Iterable, Mapping
from typing import Final, Protocol

import uvicorn
from fastapi import FastAPI
from nicegui import app, ui
from starlette.routing import BaseRoute

from counterflex.app.panel.access import BODY, COOKIE, LOOPBACK, Gate, PanelSession, Served, Sessions
from counterflex.app.panel.door import AT_A_TIME, Door
from counterflex.core.errors import OutputError
from counterflex.files.panel_users import Role

HEADERS: Final = 1 << 14
"""Bytes of the headers of a request."""
NICE: Final = 5
"""Priority below that of everything that runs beside it, the loop above all."""


class Listened(Served, Protocol):
    """Settings of a server that listens on a port."""

    @property
    def port(self) -> int: ...  # noqa: D102
    @property
    def local(self) -> bool: ...  # noqa: D102
    @property
    def secure(self) -> bool: ...  # noqa: D102


class GatedServer:
    """A server whose links or users are the only way in.

    Args:
        settings: Host, port, certificate and key.
        started: Told the links that open it, once: whose, and the address.
        roles: A link with a secret is made for each; none where users log in.
        cookie: Name of the cookie of its sessions: cookies of one host are shared by all of its ports.
    """

    def __init__(
        self,
        settings: Listened,
        started: Callable[[list[tuple[str, str]]], None],
        *,
        roles: Iterable[Role],
        cookie: str = COOKIE,
    ) -> None:
        self._listened, self._started, self._cookie = settings, started, cookie
        self._sessions = Sessions()
        self._keys: dict[str, tuple[str, Role]] = {secrets.token_urlsafe(24): (role, role) for role in roles}
        self._door = Door()

    def _run(
        self, routes: Iterable[BaseRoute], *, title: str, dark: bool | None = True,
        opened: Callable[[PanelSession], None] = lambda _: None, full: Callable[[], bool] = lambda: False,
        body: int = BODY, reads: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        """Serve the pages of the page library until the process is asked to end.

        Args:
            routes: Further ones, in front of the pages.
            opened: Told of each session that a link began.
            full: Tells whether there are too many pages to open another one.
            body: Most bytes of a request of a user.
            reads: Keys by the one path that each may read.

        Raises:
            OutputError: The port cannot be opened.
        """
        settings = self._listened
        with contextlib.suppress(OSError, AttributeError):
            os.nice(NICE)
        behind = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        behind.router.routes.extend(routes)
        app.on_startup(self._begin)
        ui.run_with(
            behind, title=title, dark=dark, show_welcome_message=False, reconnect_timeout=15.0,
            message_history_length=0, binding_refresh_interval=None,
        )  # fmt: skip
        gate = Gate(
            behind,
            self._sessions,
            hosts=LOOPBACK if settings.local else None,
            keys=self._keys,
            secure=settings.secure,
            opened=opened,
            known=self._door.know,
            full=full,
            cookie=self._cookie,
            body=body,
        )
        gate.reads = {} if reads is None else reads
        logging.getLogger("nicegui").setLevel(logging.ERROR)
        config = uvicorn.Config(
            gate,
            loop="counterflex.app.panel.gated_server:event_loop",
            http="h11",  # of the two that there are the one that bounds headers
            h11_max_incomplete_event_size=HEADERS,
            backlog=AT_A_TIME,
            log_level="error",
            access_log=False,
            proxy_headers=False,  # a stranger could say that he comes from another address
            server_header=False,
            timeout_graceful_shutdown=2,
            ssl_certfile=settings.certificate,
            ssl_keyfile=settings.key,
            ws_max_size=1 << 20,
        )
        self._server = uvicorn.Server(config)
        with contextlib.suppress(KeyboardInterrupt):  # it has closed in order; a server leaves nothing unwritten
            self._server.run(self._listening())

    def _listening(self) -> list[socket.socket]:
        settings = self._listened
        try:
            return self._door.listen(settings.host, settings.port)
        except OSError as fault:
            raise OutputError(
                "the port cannot be opened",
                where=f"{settings.host}:{settings.port}",
                value=fault.strerror or str(fault),
                hint="Is another one running? Give another --port",
            ) from None

    def _begin(self) -> None:
        """Called in the event loop when it runs."""
        asyncio.get_running_loop().create_task(self._announce())

    async def _announce(self) -> None:
        while not self._server.started:
            await asyncio.sleep(0.02)
        self._door.widen()
        port = self._server.servers[0].sockets[0].getsockname()[1]
        host = f"[{self._listened.host}]" if ":" in self._listened.host else self._listened.host
        base = f"{'https' if self._listened.secure else 'http'}://{host}:{port}/"
        links: list[tuple[str, str]] = [(role, f"{base}?key={key}") for key, (_, role) in self._keys.items()]
        self._started(links or [("log in", base)])


def event_loop() -> asyncio.AbstractEventLoop:
    """Return an event loop that takes connections by ``accept`` of their socket, which counts them."""
    return asyncio.SelectorEventLoop()
