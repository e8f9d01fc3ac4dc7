"""Access to a panel: sessions, and a gate before every page and socket."""

from __future__ import annotations

import secrets
import ssl
import time
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, Final, Protocol
from urllib.parse import parse_qs, urlsplit

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.file_content import readable
from counterflex.files.panel_users import Role

COOKIE: Final = "counterflex-panel"
SESSION: Final = "counterflex.session"
"""Key of the session in the scope of a request."""
LONGEST_S: Final = 12.0 * 3600.0
"""A session ends after a shift and a half."""
SESSIONS: Final = 256
"""Sessions at a time; a further one ends the oldest."""
BODY: Final = 1 << 20
"""Bytes of a request that is sent to the page library."""
_PLACE: Final = "'self' 'unsafe-inline'"
_POLICIES: Final = {
    # The page library compiles its templates in the browser and starts by a script in the page.
    "/": f"default-src 'self'; script-src {_PLACE} 'unsafe-eval'; style-src {_PLACE}; img-src 'self' data: blob:; "
    "font-src 'self' data:; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "/login": "default-src 'none'; style-src 'unsafe-inline'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'",
}
_HEADERS: Final = (
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),  # none at all would make the origin of the login "null"
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
LOOPBACK: Final = ("127.0.0.1", "localhost", "::1")

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


@dataclass(frozen=True)
class PanelSession:
    """Somebody who has shown who he is."""

    name: str
    role: Role
    source: str
    end_s: float  # When he has to do so again, monotonic

    @property
    def operates(self) -> bool:
        """He may ask something of the loop."""
        return self.role == "operator"


class Served(Protocol):
    """Settings of a server that others may reach."""

    @property
    def host(self) -> str: ...  # noqa: D102
    @property
    def users(self) -> Path | None: ...  # noqa: D102
    @property
    def certificate(self) -> Path | None: ...  # noqa: D102
    @property
    def key(self) -> Path | None: ...  # noqa: D102


def require_protected(server: str, encryption: str, settings: Served) -> None:
    """Refuse a server that other computers could reach without a password or could listen to.

    Raises:
        InputError: Users or encryption are missing, or only one of certificate and key is given.
    """
    if (settings.certificate is None) != (settings.key is None):
        raise InputError(
            f"{encryption} needs a certificate and its key", value="one of them",
            limit="--certificate FILE --key FILE",
        )  # fmt: skip
    lacking = [] if settings.users is not None else ["passwords (--users FILE)"]
    lacking += [] if settings.certificate is not None else [f"{encryption} (--certificate FILE --key FILE)"]
    if settings.host not in LOOPBACK and lacking:
        raise InputError(
            f"{server} that other computers reach needs passwords and {encryption}",
            where=f"--host {settings.host}",
            value=f"without {' and '.join(lacking)}",
            hint="Make users with counterflex panel-user; leave out --host to serve this computer only",
        )
    if settings.certificate is not None and settings.key is not None:
        _require_usable(settings.certificate, settings.key)


def _require_usable(certificate: Path, key: Path) -> None:
    """Refuse a certificate and a key that are none, or do not belong to each other."""
    with readable(certificate, "a certificate"):
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
        except ssl.SSLError as fault:
            raise FileFormatError(
                "no certificate with its key", where=f"--certificate {certificate} --key {key}",
                value=fault.reason or str(fault), limit="two PEM files, of which the key is that of the certificate",
                hint="Write both with the tool of your certificate authority; the key without a password",
            ) from fault  # fmt: skip


class Sessions:
    """Sessions of a panel, in memory only: they end with it."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._sessions: dict[str, PanelSession] = {}

    def begin(self, name: str, role: Role, source: str) -> str:
        """A new session; the secret that stands for it."""
        now = self._clock_s()
        self._sessions = {key: one for key, one in self._sessions.items() if one.end_s > now}
        if len(self._sessions) >= SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        key = secrets.token_urlsafe(32)
        self._sessions[key] = PanelSession(name, role, source, now + LONGEST_S)
        return key

    def of(self, key: str) -> PanelSession | None:
        """The session that a secret stands for, as long as it lasts."""
        one = self._sessions.get(key)
        return one if one is not None and one.end_s > self._clock_s() else None

    def end(self, key: str) -> None:
        """End a session."""
        self._sessions.pop(key, None)

    def keep(self, roles: Mapping[str, Role]) -> None:
        """End the sessions of users who are no more, or who have another role.

        Args:
            roles: By name, of the users that there are.
        """
        self._sessions = {key: one for key, one in self._sessions.items() if roles.get(one.name) == one.role}


class Gate:
    """Lets through to the panel whoever may.

    The page to log in at is open to all; everything else, sockets above all, needs a session. A page of another site
    cannot reach the sockets: their origin must be the host that they are asked of. Nor can it show the panel in
    a frame.

    A wrong key of a link is not counted: nobody guesses 24 random bytes, and a page of another site that asks for wrong
    ones in a browser of this computer would lock out who sits at it.

    A key of ``reads``, by the one path that it reads, is given as ``Authorization: Bearer``; it begins no session.

    Args:
        hosts: Names that it may be asked under; None: any.
        keys: Secrets in a link that begin a session, each with name and role; none where users log in.
        opened: Told of each session that such a link began.
        known: Told of each connection of somebody who has a session: address and port that it comes from.
        full: Tells whether there are too many pages to open another one.
        cookie: Name of the cookie that holds the secret of a session.
        body: Most bytes of a request of a user.
    """

    def __init__(
        self,
        app: App,
        sessions: Sessions,
        *,
        hosts: tuple[str, ...] | None,
        keys: Mapping[str, tuple[str, Role]],
        secure: bool,
        opened: Callable[[PanelSession], None] = lambda _: None,
        known: Callable[[Any], None] = lambda _: None,
        full: Callable[[], bool] = lambda: False,
        cookie: str = COOKIE,
        body: int = BODY,
    ) -> None:
        self.reads: Mapping[str, str] = {}
        self._app, self._sessions, self._hosts, self._keys, self._cookie = app, sessions, hosts, keys, cookie
        self._secure, self._opened, self._known, self._full, self._body = secure, opened, known, full, body

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request or socket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _headers_of(scope)
        path: str = scope["path"]
        session = self._sessions.of(cookie_of(headers, self._cookie))
        if scope["type"] == "http":
            send = _with_headers(send, path, close=session is None)
        if not self._right_host(headers) or not _own_origin(headers, scope):
            await _refuse(scope, receive, send, 403, "this host or origin is not served")
            return
        scope[SESSION] = session
        if scope["type"] == "http" and (cookie := self._by_key(scope)) is not None:
            await _redirect(send, path, cookie)  # also who has a session already begins the one of the link
            return
        if session is not None:
            self._known(scope.get("client"))
            if refusal := self._beyond(scope, headers):
                await _refuse(scope, receive, send, *refusal)
                return
        if session is not None or self._may_read(scope, headers):
            await self._app(scope, receive, send)
        elif _is_get(scope) and path not in self.reads and not path.startswith("/_nicegui"):
            await _redirect(send, "/login", None)
        else:
            await _refuse(scope, receive, send, 401, "log in first")

    def _beyond(self, scope: Scope, headers: Mapping[str, str]) -> tuple[int, str] | None:
        """Status and text for a request of a user that takes too much memory."""
        if scope["type"] != "http":
            return None
        length = headers.get("content-length", "0")
        if "transfer-encoding" in headers or not length.isdecimal() or int(length[:20]) > self._body:
            return 413, "that is too long"
        if scope["path"] == "/" and self._full():
            return 503, "too many pages are open: close some"
        return None

    def _may_read(self, scope: Scope, headers: Mapping[str, str]) -> bool:
        """Without a session: the page to log in at, and with its key the path that it reads."""
        if scope["path"] == "/login":
            return bool(scope["type"] == "http")
        key = self.reads.get(scope["path"], "")
        if not key or not _is_get(scope):
            return False
        return secrets.compare_digest(f"Bearer {key}".encode(), headers.get("authorization", "").encode())

    def _right_host(self, headers: Mapping[str, str]) -> bool:
        return self._hosts is None or _host(headers.get("host", "")) in self._hosts

    def _by_key(self, scope: Scope) -> str | None:
        """Cookie of a new session where the link holds a secret."""
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("key", [""])[0]
        if not given:
            return None
        for key, (name, role) in self._keys.items():
            if secrets.compare_digest(key.encode(), given.encode()):
                secret = self._sessions.begin(name, role, source_of(scope))
                one = self._sessions.of(secret)
                if one is not None:
                    self._opened(one)
                return cookie_text(secret, secure=self._secure, name=self._cookie)
        return None


def _is_get(scope: Scope) -> bool:
    return bool(scope["type"] == "http" and scope["method"] == "GET")


def _headers_of(scope: Scope) -> dict[str, str]:
    return {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}


def cookie_text(secret: str, *, secure: bool, name: str = COOKIE) -> str:
    """A cookie that no script can read and no other site sends."""
    return f"{name}={secret}; Path=/; HttpOnly; SameSite=Strict" + ("; Secure" if secure else "")


def cookie_of(headers: Mapping[str, str], name: str = COOKIE) -> str:
    """The secret that a request brings, or empty."""
    try:
        match = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return ""
    return "" if match is None else match.value


def source_of(scope: Mapping[str, Any]) -> str:
    """Address that a request comes from."""
    client = scope.get("client")
    return str(client[0]) if client else "unknown"


def _host(text: str) -> str:
    try:
        return urlsplit(f"//{text}").hostname or ""
    except ValueError:
        return ""


def _own_origin(headers: Mapping[str, str], scope: Scope) -> bool:
    origin = headers.get("origin")
    if origin is None:  # a browser always sends one with a socket; what sends none is no page
        return bool(scope["type"] == "http")
    try:
        own: str = headers.get("host", "").lower()
        return own != "" and bool(urlsplit(origin).netloc.lower() == own)
    except ValueError:
        return False


def _with_headers(send: Send, path: str, *, close: bool) -> Send:
    """Return what sends an answer with the headers that keep a page to itself; a stranger asks once a connection."""
    policy = _POLICIES.get(path, _POLICIES["/"]).encode()

    async def sent(message: Any) -> None:
        if message["type"] == "http.response.start":
            ends = [(b"connection", b"close")] if close else []
            own = [*_HEADERS, (b"content-security-policy", policy), *ends]
            message["headers"] = [*message.get("headers", ()), *own]
        await send(message)

    return sent


async def _redirect(send: Send, where: str, cookie: str | None) -> None:
    place = where if where.startswith("/") and not where.startswith("//") else "/"
    headers = [
        (b"location", place.encode("latin-1", "replace")),
        (b"cache-control", b"no-store"),
        (b"content-length", b"0"),
    ]
    if cookie is not None:
        headers.append((b"set-cookie", cookie.encode("latin-1")))
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, text: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 4000 + status})
        return
    body = text.encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
