"""The process of the panel: one web server, one look at the run per tick, one message per page."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import escape
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs

from nicegui import Client, app, ui
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from counterflex.app.panel.access import COOKIE, SESSION, PanelSession, Sessions, cookie_of, cookie_text, source_of
from counterflex.app.panel.cell_scene import CellScene
from counterflex.app.panel.gated_server import GatedServer
from counterflex.app.panel.metrics import CONTENT
from counterflex.app.panel.page import PanelPage
from counterflex.app.panel.settings import PanelSettings, read_metrics_key, require_safe
from counterflex.app.panel.tries import RefusedLogins, Tries
from counterflex.app.panel.watched_run import WatchedRun
from counterflex.core.errors import CounterflexError
from counterflex.core.printable import all_printable
from counterflex.files.panel_users import PanelUsers

_LONGEST: Final = 2048
_PAGE: Final = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>counterflex panel</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
body {{ background: #05080b; color: #e8eef4; font: 28px Roboto, "Segoe UI", sans-serif; display: grid;
  place-items: center; min-height: 100vh; margin: 0; }}
form {{ display: grid; gap: 18px; width: min(520px, 90vw); }} h1 {{ margin: 0; }}
input, button {{ font: inherit; padding: 16px; border-radius: 10px; border: 1px solid #33424f; background: #11181f;
  color: inherit; }} button {{ background: #1d4f87; font-weight: 700; cursor: pointer; }}
p {{ color: #f2b134; margin: 0; }}
</style></head><body><form method="post" action="/login"><h1>counterflex panel</h1>{form}</form></body></html>"""
_FORM: Final = """<p>{text}</p><input name="name" placeholder="name" autocomplete="username" required autofocus>
<input name="password" type="password" placeholder="password" autocomplete="current-password" required>
<button>LOG IN</button>"""
_CLOSED: Final = "<p>Open the link that counterflex panel has printed: it holds the key.</p>"


class LoginRoutes:
    """Pages to log in and out.

    Passwords are hashed in one thread of their own: what an operator asks never waits for it.

    Args:
        users: Who may; None: nobody, a link opens the panel.
        note: Told of who logs in and out: name, address, what he did.
        tries: Which passwords are looked at; None: by the clock of the computer.
    """

    def __init__(
        self,
        users: PanelUsers | None,
        sessions: Sessions,
        *,
        secure: bool,
        note: Callable[[str, str, str], None],
        refused: RefusedLogins,
        tries: Tries | None = None,
    ) -> None:
        self._users, self._sessions, self._secure = users, sessions, secure
        self._note, self._refused = note, refused
        self._tries = tries if tries is not None else Tries()
        self._hashing = ThreadPoolExecutor(1, "hashing")

    def routes(self) -> list[Route]:
        """Routes of the web server."""
        return [
            Route("/login", self._ask, methods=["GET"]),
            Route("/login", self._enter, methods=["POST"]),
            Route("/logout", self._leave, methods=["GET"]),
        ]

    async def _ask(self, _: Request) -> Response:
        return self._page("")

    def _page(self, text: str, status: int = 200) -> Response:
        form = _CLOSED if self._users is None else _FORM.format(text=escape(text))
        return HTMLResponse(_PAGE.format(form=form), status_code=status, headers={"cache-control": "no-store"})

    async def _enter(self, request: Request) -> Response:
        source = source_of(request.scope)
        if self._users is None:
            return self._page("", 403)
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > _LONGEST:
                return self._page("That is too long.", 413)
        given = parse_qs(body.decode("utf-8", "replace"))
        name, password = (given.get(key, [""])[0] for key in ("name", "password"))
        if why := self._tries.begin(source, name):
            self._refused.add(name, source)
            return self._page(why, 429)
        role = None
        try:
            role = await asyncio.get_running_loop().run_in_executor(self._hashing, self._users.role, name, password)
        except asyncio.CancelledError:  # the panel is closed meanwhile
            return self._page("The panel is being closed.", 503)
        finally:
            self._tries.end(source, name, right=role is not None)
        if role is None:
            self._refused.add(name, source)
            return self._page("Name or password is wrong.", 401)
        self._note(name, source, f"log in as {role}")
        answer = RedirectResponse("/", status_code=303)
        secret = self._sessions.begin(name, role, source)
        answer.headers["set-cookie"] = cookie_text(secret, secure=self._secure)
        return answer

    async def _leave(self, request: Request) -> Response:
        key = cookie_of({"cookie": request.headers.get("cookie", "")})
        one: PanelSession | None = self._sessions.of(key)
        if one is not None:
            self._note(one.name, one.source, "log out")
        self._sessions.end(key)
        return RedirectResponse("/login", status_code=303)


ACTIONS: Final = 6
"""Actions of operators that a page shows."""
PAGES: Final = 64
"""Pages that may be open."""
USERS_S: Final = 1.0
"""Period at which the file of users is looked at."""
METRICS: Final = "/metrics"
METRICS_S: Final = 1.0
"""Period after which the text for a monitoring server is made anew."""
_CSS: Final = Path(__file__).with_name("panel.css")


class PanelServer(GatedServer):
    """A panel.

    Args:
        started: Told the links that open it, once: whose, and the address.

    Raises:
        FileFormatError: The file of users is none, or that of the key of /metrics.
        OutputError: Another panel watches the run.
    """

    def __init__(self, settings: PanelSettings, started: Callable[[list[tuple[str, str]]], None]) -> None:
        self._settings = settings
        self._users = None if settings.users is None else PanelUsers(settings.users)
        super().__init__(settings, started, roles=("operator", "viewer") if self._users is None else ())
        self.run = WatchedRun(settings.folder)
        self.run.require_free()
        self.pages: dict[str, PanelPage] = {}
        self._actions: deque[str] = deque(maxlen=ACTIONS)
        self._refused = RefusedLogins(self.run.note)
        self._users_due = 0.0
        self._scene: CellScene | None = None
        self._scene_of = -1
        self._trouble = ""
        self._last: dict[str, Any] = {}
        self._metrics_key = read_metrics_key(settings.metrics_key)
        self._metrics, self._metrics_due = b"", 0.0

    def serve(self) -> None:
        """Serve until the process is asked to end. Raises OutputError: the port cannot be opened."""
        routes = LoginRoutes(
            self._users, self._sessions, secure=self._settings.secure, note=self._note_login, refused=self._refused
        ).routes()
        self._pages()
        app.on_shutdown(self.run.close)
        try:
            self._run(
                [*routes, Route(METRICS, self._read_metrics, methods=["GET"])], title="counterflex",
                opened=lambda one: self._note_login(one.name, one.source, f"link opened as {one.role}"),
                full=lambda: len(self.pages) >= PAGES, reads={METRICS: self._metrics_key},
            )  # fmt: skip
        finally:
            self.run.close()

    async def _read_metrics(self, _: Request) -> Response:
        """The run for a monitoring server; made once a period however often it is asked for."""
        now = time.monotonic()
        if now >= self._metrics_due:
            self._metrics_due, self._metrics = now + METRICS_S, self.run.open_metrics().encode()
        return Response(self._metrics, media_type=CONTENT, headers={"cache-control": "no-store"})

    def _note_login(self, name: str, source: str, what: str) -> None:
        self.run.note({"who": name, "from": source, "action": what, "done": True})
        self._tell(f"{name} {what}")

    def _tell(self, text: str) -> None:
        self._actions.append(f"{time.strftime('%H:%M:%S')} {text}")

    def _pages(self) -> None:
        ui.page("/", title="counterflex panel")(self._live)

    def _live(self, request: Request, client: Client) -> None:
        session: PanelSession = request.scope[SESSION]
        cookie = request.cookies.get(COOKIE, "")
        ui.add_css(_CSS, shared=False)
        self.pages[client.id] = PanelPage(
            client,
            session,
            self.run,
            self._settings.range_um,
            valid=lambda: self._sessions.of(cookie) is not None,
            report_action=self._tell,
        )
        client.on_delete(lambda: self.pages.pop(client.id, None))

    def _begin(self) -> None:
        super()._begin()
        asyncio.get_running_loop().create_task(self._tick())

    async def _tick(self) -> None:
        """One look at the run after another; what goes wrong in one is shown, and the next one comes all the same."""
        period = 1.0 / self._settings.rate_hz
        due = time.monotonic()
        while True:
            try:
                await self._look()
            except Exception as fault:
                self._trouble = f"{type(fault).__name__}: {fault}"
                logging.getLogger("counterflex.panel").exception("a look at the run failed")
            due = max(due + period, time.monotonic())
            await asyncio.sleep(max(0.001, due - time.monotonic()))

    def _look_at_doors(self) -> None:
        """End what strangers have left open, write what was refused, end sessions of users who were removed."""
        self._door.end_old()
        self._refused.flush()
        now = time.monotonic()
        if self._users is not None and now >= self._users_due:
            self._users_due = now + USERS_S
            self._sessions.keep(self._users.roles())

    async def _look(self) -> None:
        self._look_at_doors()
        run = self.run
        connected = [page for page in list(self.pages.values()) if page.client.has_socket_connection]
        new = run.poll(len(connected))
        if self._scene_of != run.runs and run.about:
            self._scene_of = run.runs
            self._scene = await asyncio.to_thread(self._read_scene, Path(run.about["files"]["cell"]))
        message: dict[str, Any] = all_printable(
            {
                "seen": run.seen.value,
                "why": run.why,
                "age_s": run.age_s(),
                "trouble": self._trouble,
                "actions": [*self._actions, *self._refused_words()],
            }
        )
        if new:
            self._last = {"figures": all_printable(run.figures)}
            if self._scene is not None and run.last is not None:
                self._last["frames"] = self._scene.frames(run.last.q)
            message |= self._last
        bodies = [] if self._scene is None else self._scene.bodies
        for page in connected:
            page.show(message, self._last, bodies)

    def _refused_words(self) -> list[str]:
        return [f"logins refused: {self._refused.total}"] if self._refused.total else []

    def _read_scene(self, cell: Path) -> CellScene | None:
        try:
            return CellScene(cell)
        except CounterflexError as fault:
            self._trouble = f"the cell cannot be drawn: {fault}"
            return None


def serve(settings: PanelSettings, started: Callable[[list[tuple[str, str]]], None]) -> None:
    """Serve a panel until the process is asked to end.

    Args:
        started: Told the links that open it: whose, and the address.

    Raises:
        InputError: It would not be safe, or the page library is missing.
    """
    require_safe(settings)
    PanelServer(settings, started).serve()
