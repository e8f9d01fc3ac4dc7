"""The page to log in at: plain HTML without scripts, before anything of the panel is served."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import escape
from typing import Final
from urllib.parse import parse_qs

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from counterflex.app.panel.access import Session, Sessions, cookie_of, cookie_text, source_of
from counterflex.app.panel.tries import RefusedLogins, Tries
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


def login_routes(
    users: PanelUsers | None,
    sessions: Sessions,
    *,
    secure: bool,
    note: Callable[[str, str, str], None],
    refused: RefusedLogins,
    tries: Tries | None = None,
) -> list[Route]:
    """Routes to log in and out.

    Passwords are hashed in one thread of their own: what an operator asks never waits for it.

    Args:
        users: Who may; None: nobody, a link opens the panel.
        sessions: Of the panel.
        secure: It is asked by TLS.
        note: Told of who logs in and out: name, address, what he did.
        refused: Told of who was not let through.
        tries: Which passwords are looked at; None: by the clock of the computer.
    """
    tries = tries if tries is not None else Tries()
    hashing = ThreadPoolExecutor(1, "hashing")

    async def ask(_: Request) -> Response:
        return _page("")

    def _page(text: str, status: int = 200) -> Response:
        form = _CLOSED if users is None else _FORM.format(text=escape(text))
        return HTMLResponse(_PAGE.format(form=form), status_code=status, headers={"cache-control": "no-store"})

    async def enter(request: Request) -> Response:
        source = source_of(request.scope)
        if users is None:
            return _page("", 403)
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > _LONGEST:
                return _page("That is too long.", 413)
        given = parse_qs(body.decode("utf-8", "replace"))
        name, password = (given.get(key, [""])[0] for key in ("name", "password"))
        if why := tries.begin(source, name):
            refused.add(name, source)
            return _page(why, 429)
        role = None
        try:
            role = await asyncio.get_running_loop().run_in_executor(hashing, users.role, name, password)
        except asyncio.CancelledError:  # the panel is closed meanwhile
            return _page("The panel is being closed.", 503)
        finally:
            tries.end(source, name, right=role is not None)
        if role is None:
            refused.add(name, source)
            return _page("Name or password is wrong.", 401)
        note(name, source, f"log in as {role}")
        answer = RedirectResponse("/", status_code=303)
        answer.headers["set-cookie"] = cookie_text(sessions.begin(name, role, source), secure=secure)
        return answer

    async def leave(request: Request) -> Response:
        key = cookie_of({"cookie": request.headers.get("cookie", "")})
        one: Session | None = sessions.of(key)
        if one is not None:
            note(one.name, one.source, "log out")
        sessions.end(key)
        return RedirectResponse("/login", status_code=303)

    return [
        Route("/login", ask, methods=["GET"]),
        Route("/login", enter, methods=["POST"]),
        Route("/logout", leave, methods=["GET"]),
    ]
