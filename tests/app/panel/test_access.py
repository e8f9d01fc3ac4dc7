"""Who may see and operate a panel: roles, tries, links, hosts and origins; without a browser and without a server."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.panel.access import (
    BLOCK_S,
    COOKIE,
    LONGEST_S,
    LOOPBACK,
    SESSION,
    TRIES,
    Gate,
    Sessions,
)
from counterflex.app.panel.settings import PanelSettings, require_safe
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.panel_users import LEAST, PanelUsers, set_user


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
) -> list[dict[str, Any]]:
    """What the gate itself answers; nothing where the request went through."""
    headers = [(b"host", host.encode())]
    headers += [(b"cookie", f"{COOKIE}={cookie}".encode())] if cookie else []
    headers += [(b"origin", origin.encode())] if origin is not None else []
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


def test_a_wrong_key_opens_nothing_and_tries_are_limited(gate: tuple[Gate, Behind, Sessions], clock: Clock) -> None:
    door, behind, _ = gate
    for _k in range(TRIES):
        assert dict(ask(door, query="key=guess")[0]["headers"])[b"location"] == b"/login"
    assert dict(ask(door, query="key=secret-of-operators")[0]["headers"])[b"location"] == b"/login"
    clock.now += BLOCK_S + 1.0
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


def test_static_files_and_the_login_are_open(gate: tuple[Gate, Behind, Sessions]) -> None:
    door, behind, _ = gate
    assert ask(door, "/login") == ask(door, "/_nicegui/3.18.0/static/vue.js") == []
    assert behind.came == [None, None]


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
