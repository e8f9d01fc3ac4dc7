"""Access to a panel: roles, links, hosts and origins, sizes; without a browser and without a server."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.panel.access import (
    BODY,
    COOKIE,
    LONGEST_S,
    LOOPBACK,
    SESSION,
    SESSIONS,
    Gate,
    Sessions,
)
from counterflex.app.panel.settings import PanelSettings, read_metrics_key, require_safe
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.panel_users import LEAST, PanelUsers, remove_user, set_user


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


class Behind:
    """What is behind the gate: remembers who came through."""

    def __init__(self) -> None:
        self.came: list[Any] = []

    async def __call__(self, scope: Any, _receive: Any, _send: Any) -> None:
        self.came.append(scope[SESSION])


def ask(
    gate: Gate,
    path: str = "/",
    *,
    kind: str = "http",
    query: str = "",
    cookie: str = "",
    host: str = "localhost:8642",
    origin: str | None = None,
    method: str = "GET",
    more: dict[str, str] | None = None,
) -> list[dict[str, Any]]:
    """What the gate itself answers; nothing where the request went through."""
    headers = [(b"host", host.encode())]
    headers += [(b"cookie", f"{COOKIE}={cookie}".encode())] if cookie else []
    headers += [(b"origin", origin.encode())] if origin is not None else []
    headers += [(name.encode(), value.encode()) for name, value in (more or {}).items()]
    scope = {
        "type": kind,
        "path": path,
        "method": method,
        "query_string": query.encode(),
        "headers": headers,
        "client": ("10.0.0.7", 4711),
    }
    sent: list[dict[str, Any]] = []

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    async def receive() -> dict[str, str]:
        return {"type": "websocket.connect"}

    asyncio.run(gate(scope, receive, send))
    return sent


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def gate(clock: Clock) -> tuple[Gate, Behind, Sessions]:
    behind, sessions = Behind(), Sessions(clock)
    keys = {"secret-of-operators": ("operator", "operator"), "secret-of-viewers": ("viewer", "viewer")}
    return Gate(behind, sessions, hosts=LOOPBACK, keys=keys, secure=False), behind, sessions  # type: ignore[arg-type]


def test_a_page_needs_a_session_and_a_link_begins_one(gate: tuple[Gate, Behind, Sessions]) -> None:
    door, behind, sessions = gate
    (start, _) = ask(door)
    assert (start["status"], dict(start["headers"])[b"location"]) == (303, b"/login")
    (start, _) = ask(door, query="key=secret-of-viewers")
    cookie = dict(start["headers"])[b"set-cookie"].decode()
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    secret = cookie.split("=", 1)[1].split(";")[0]
    assert ask(door, cookie=secret) == []
    (came,) = behind.came
    assert (came.name, came.role, came.operates, came.source) == ("viewer", "viewer", False, "10.0.0.7")
    assert sessions.of(secret) == came
    sessions.end(secret)
    assert ask(door, cookie=secret)[0]["status"] == 303


def test_a_link_begins_its_own_session_also_where_there_is_one(gate: tuple[Gate, Behind, Sessions]) -> None:
    door, behind, sessions = gate
    operator = sessions.begin("anna", "operator", "10.0.0.7")
    (start, _) = ask(door, query="key=secret-of-viewers", cookie=operator)
    secret = dict(start["headers"])[b"set-cookie"].decode().split("=", 1)[1].split(";")[0]
    assert ask(door, cookie=secret) == []
    assert behind.came[0].role == "viewer"


def test_wrong_keys_open_nothing_and_lock_nobody_out(gate: tuple[Gate, Behind, Sessions]) -> None:
    """A page of another site can have a browser of this computer ask for wrong keys: they are not counted."""
    door, behind, _ = gate
    for _k in range(100):
        assert dict(ask(door, query="key=guess")[0]["headers"])[b"location"] == b"/login"
    assert b"set-cookie" in dict(ask(door, query="key=secret-of-operators")[0]["headers"])
    assert behind.came == []


@pytest.mark.parametrize("path", ["/_nicegui_ws/socket.io/", "/_nicegui/client/x/../../y", "/live", "/api"])
def test_sockets_and_all_else_are_shut_without_a_session(gate: tuple[Gate, Behind, Sessions], path: str) -> None:
    door, behind, _ = gate
    assert ask(door, path, kind="websocket", origin="http://localhost:8642") == [
        {"type": "websocket.close", "code": 4401}
    ]
    assert ask(door, path, method="POST")[0]["status"] == 401
    assert behind.came == []


def test_a_key_reads_its_one_path_and_begins_no_session(clock: Clock) -> None:
    behind, key = Behind(), "k" * 24
    door = Gate(behind, Sessions(clock), hosts=LOOPBACK, keys={}, secure=False)
    door.reads = {"/metrics": key, "/none": ""}
    given = {"authorization": f"Bearer {key}"}
    for path, method, more in (
        ("/", "GET", given), ("/metrics", "POST", given), ("/metrics/x", "GET", given), ("/none", "GET", given),
        ("/metrics", "GET", {}), ("/metrics", "GET", {"authorization": "Bearer "}),
        ("/metrics", "GET", {"authorization": key}), ("/none", "GET", {"authorization": "Bearer "}),
        ("/metrics", "GET", {"authorization": "Bearer \xe4"}),
    ):  # fmt: skip
        assert ask(door, path, method=method, more=more)[0]["status"] in (303, 401), (path, method, more)
    assert ask(door, "/metrics", query=f"key={key}")[0]["status"] == 401
    assert ask(door, "/metrics", kind="websocket", origin="http://localhost:8642", more=given)[0]["code"] == 4401
    assert ask(door, "/metrics", host="evil.example", more=given)[0]["status"] == 403
    assert behind.came == []
    (start, *_) = [*ask(door, "/metrics", more=given), {"status": "through"}]
    assert start["status"] == "through"
    assert behind.came == [None]


def test_a_short_key_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text("k" * 24 + "\n", encoding="ascii")
    assert read_metrics_key(file) == "k" * 24
    for text in ("", "k" * 23, "two words " * 9, "\xfc" * 30):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError, match="no key"):
            read_metrics_key(file)


def test_only_the_login_is_open(gate: tuple[Gate, Behind, Sessions]) -> None:
    door, behind, _ = gate
    assert ask(door, "/login") == []
    assert behind.came == [None]
    assert ask(door, "/_nicegui/3.18.0/static/vue.js")[0]["status"] == 401


@pytest.mark.parametrize("path", ["/", "/login", "/logout", "/_nicegui/x.js", "/else"])
@pytest.mark.parametrize("host", ["localhost:8642", "evil.example"])
def test_every_answer_keeps_the_page_to_itself(host: str, path: str) -> None:
    async def behind(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
        await send({"type": "http.response.body", "body": b""})

    sessions = Sessions()
    door = Gate(behind, sessions, hosts=LOOPBACK, keys={}, secure=False)
    for cookie in ("", sessions.begin("anna", "operator", "10.0.0.7")):
        headers = dict(ask(door, path, host=host, cookie=cookie)[0]["headers"])
        assert (headers.get(b"connection") == b"close") == (cookie == "")  # a stranger asks once a connection
        assert headers[b"x-frame-options"] == b"DENY"
        assert headers[b"x-content-type-options"] == b"nosniff"
        assert headers[b"referrer-policy"] == b"same-origin"
        policy = headers[b"content-security-policy"].decode()
        assert "frame-ancestors 'none'" in policy
        assert "default-src 'self'" in policy or "default-src 'none'" in policy
        assert not any(place in policy for place in ("http:", "https:", "ws:", "*"))  # nothing of another site


@pytest.mark.parametrize(
    "more", [{"content-length": str(BODY + 1)}, {"content-length": "9" * 5000}, {"transfer-encoding": "chunked"}]
)
def test_a_long_request_is_refused_by_its_head(gate: tuple[Gate, Behind, Sessions], more: dict[str, str]) -> None:
    door, behind, sessions = gate
    secret = sessions.begin("ben", "viewer", "10.0.0.7")
    assert ask(door, "/_nicegui/client/x", method="POST", cookie=secret, more=more)[0]["status"] == 413
    assert behind.came == []


def test_pages_are_bounded_and_connections_of_users_are_told(clock: Clock) -> None:
    behind, sessions, full = Behind(), Sessions(clock), [False]
    known: list[Any] = []
    door = Gate(
        behind, sessions, hosts=LOOPBACK, keys={}, secure=False, known=known.append, full=lambda: full[0]
    )  # fmt: skip
    secret = sessions.begin("ben", "viewer", "10.0.0.7")
    assert ask(door, cookie=secret) == []
    full[0] = True
    assert ask(door, cookie=secret)[0]["status"] == 503
    assert ask(door, "/_nicegui/x.js", cookie=secret) == []  # pages that are open go on
    assert known == [("10.0.0.7", 4711)] * 3
    ask(door)
    assert len(known) == 3


def test_sessions_are_bounded(clock: Clock) -> None:
    sessions = Sessions(clock)
    secrets = [sessions.begin("ben", "viewer", "here") for _ in range(SESSIONS + 5)]
    assert [sessions.of(secret) is None for secret in secrets] == [True] * 5 + [False] * SESSIONS


def test_the_session_of_a_user_who_is_removed_ends(clock: Clock) -> None:
    sessions = Sessions(clock)
    anna, ben = (sessions.begin(name, "operator", "here") for name in ("anna", "ben"))
    sessions.keep({"anna": "operator", "ben": "viewer"})  # ben has another role now
    assert sessions.of(anna) is not None
    assert sessions.of(ben) is None
    sessions.keep({})
    assert sessions.of(anna) is None


@pytest.mark.parametrize("host", ["evil.example:8642", "localhost.evil.example", "", "127.0.0.1.evil:1", "[::"])
def test_another_host_name_is_not_served(gate: tuple[Gate, Behind, Sessions], host: str) -> None:
    """A name of another site that resolves to this computer would else give its pages the panel."""
    door, _, sessions = gate
    secret = sessions.begin("anna", "operator", "10.0.0.7")
    assert ask(door, host=host, cookie=secret)[0]["status"] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://localhost:9999", "http://[", None])
def test_a_socket_of_another_origin_is_shut_even_with_the_cookie(
    gate: tuple[Gate, Behind, Sessions], origin: str | None
) -> None:
    door, behind, sessions = gate
    secret = sessions.begin("anna", "operator", "10.0.0.7")
    sent = ask(door, "/_nicegui_ws/socket.io/", kind="websocket", cookie=secret, origin=origin)
    assert sent == [{"type": "websocket.close", "code": 4403}]
    own = ask(door, "/_nicegui_ws/socket.io/", kind="websocket", cookie=secret, origin="http://localhost:8642")
    assert own == []
    assert len(behind.came) == 1


def test_a_session_ends_by_itself(clock: Clock) -> None:
    sessions = Sessions(clock)
    secret = sessions.begin("anna", "operator", "here")
    clock.now += LONGEST_S - 1.0
    assert sessions.of(secret) is not None
    clock.now += 2.0
    assert sessions.of(secret) is None


def test_users_have_roles_and_only_their_own_password_opens(tmp_path: Path) -> None:
    file = tmp_path / "users.toml"
    set_user(file, "anna", "operator", "correct horse")
    set_user(file, "ben", "viewer", "another password")
    users = PanelUsers(file)
    assert users.role("anna", "correct horse") == "operator"
    assert users.role("ben", "another password") == "viewer"
    assert users.role("anna", "another password") is users.role("nobody", "correct horse") is users.role("", "") is None
    assert file.stat().st_mode & 0o777 == 0o600
    assert "horse" not in file.read_text()
    set_user(file, "anna", "viewer", "a new password")
    assert PanelUsers(file).role("anna", "a new password") == "viewer"
    assert PanelUsers(file).role("anna", "correct horse") is None


def test_users_who_are_added_or_removed_count_at_once(tmp_path: Path) -> None:
    file = tmp_path / "users.toml"
    set_user(file, "anna", "operator", "correct horse")
    users = PanelUsers(file)
    set_user(file, "ben", "viewer", "another password")
    assert users.role("ben", "another password") == "viewer"
    remove_user(file, "anna")
    assert users.roles() == {"ben": "viewer"}
    assert users.role("anna", "correct horse") is None
    assert file.stat().st_mode & 0o777 == 0o600
    with pytest.raises(InputError, match="no such user") as fault:
        remove_user(file, "anna")
    assert "ben" in str(fault.value)
    file.write_text("broken")
    assert users.roles() == {}  # nobody, rather than those of before
    file.unlink()
    assert users.roles() == {}


def test_a_name_that_stands_there_twice_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "users.toml"
    set_user(file, "anna", "operator", "correct horse")
    text = file.read_text()
    file.write_text(text + text[text.index("[[users]]") :])
    with pytest.raises(FileFormatError, match="twice"):
        PanelUsers(file)


def test_bad_users_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="wrong length"):
        set_user(tmp_path / "u.toml", "anna", "viewer", "x" * (LEAST - 1))
    with pytest.raises(FileFormatError, match="name"):
        set_user(tmp_path / "u.toml", "an na", "viewer", "x" * LEAST)
    assert not (tmp_path / "u.toml").exists()
    (tmp_path / "u.toml").write_text('format = "counterflex-cell"\nversion = 1\n')
    with pytest.raises(FileFormatError, match="counterflex-panel-users"):
        PanelUsers(tmp_path / "u.toml")


@pytest.mark.parametrize(
    ("lacking", "chosen"),
    [
        ("passwords", {"certificate": "c.pem", "key": "k.pem"}),
        ("TLS", {"users": "u.toml"}),
        ("passwords (--users FILE) and TLS", {}),
    ],
)
def test_a_network_needs_passwords_and_tls(lacking: str, chosen: dict[str, str]) -> None:
    paths = {name: Path(value) for name, value in chosen.items()}
    with pytest.raises(InputError) as fault:
        require_safe(PanelSettings(Path("log"), "0.0.0.0", **paths))  # type: ignore[arg-type]
    assert lacking in str(fault.value)


def test_half_of_tls_is_refused() -> None:
    with pytest.raises(InputError, match="TLS needs a certificate and its key"):
        require_safe(PanelSettings(Path("log"), certificate=Path("c.pem")))
