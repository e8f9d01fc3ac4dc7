"""Bounds of the OPC UA server for who has not logged in: passwords, connections, sessions, message sizes."""

from __future__ import annotations

import asyncio
import struct
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the extra opcua is not installed")
from asyncua import ua
from asyncua.common.utils import ServiceError

from counterflex.app.opcua.bounded import CHUNK, MESSAGE, UNUSED, BoundedServer, Inner, Users, _Binary, _source
from counterflex.app.panel.door import KNOWN, PATIENCE_S, STRANGERS, Door
from counterflex.app.panel.tries import TRIES, Tries
from counterflex.files.panel_users import PanelUsers, remove_user, set_user
from opcua_server import PASSWORD, users


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def inner(path: str | None = None) -> tuple[Inner, Clock]:
    clock = Clock()
    given = None if path is None else PanelUsers(Path(path))
    return Inner(Users(given, Tries(clock)), Door(clock)), clock


def test_wrong_passwords_lock_out_neither_other_users_nor_other_addresses(tmp_path: Path) -> None:
    server, clock = inner(users(tmp_path))

    def enters(name: str, password: str, source: str) -> bool:
        clock.now += 1.0
        token = _source.set(source)
        try:
            return server.user_manager.get_user(server, username=name, password=password.encode()) is not None
        finally:
            _source.reset(token)

    for _ in range(4 * TRIES):
        assert not enters("ben", "a wrong password", "10.0.0.66")
    assert not enters("ben", PASSWORD, "10.0.0.66")
    assert enters("anna", PASSWORD, "10.0.0.66")
    assert enters("ben", PASSWORD, "10.0.0.7")
    assert not enters("", PASSWORD, "10.0.0.7")
    assert server.user_manager.operates("anna")
    assert not server.user_manager.operates("ben")


def session(server: Inner, name: str, port: int) -> Any:
    """A session that a client has logged in on."""
    one = server.create_session(("10.0.0.7", port), external=True)
    token = ua.UserNameIdentityToken()
    token.UserName, token.Password, token.EncryptionAlgorithm = name, PASSWORD.encode(), None
    parameters = ua.ActivateSessionParameters()
    parameters.UserIdentityToken = token
    server.supported_tokens = (ua.UserNameIdentityToken,)
    one.nonce = b""
    one.activate_session(parameters, None)
    return one


def test_sessions_that_nobody_logs_in_on_are_bounded_and_push_out_nobody_who_has(tmp_path: Path) -> None:
    async def story() -> None:
        server, _ = inner(users(tmp_path))
        anna = session(server, "anna", 1)
        for k in range(50 * UNUSED):
            server.create_session(("10.0.0.66", k), external=True)
        assert len(server._external_sessions) == UNUSED + 1
        assert server.lookup_external_session(anna.auth_token) is anna
        for k in range(KNOWN):
            one = server.create_session(("10.0.0.7", k), external=True)
            one.state = anna.state
        with pytest.raises(ServiceError):
            server.create_session(("10.0.0.7", 9999), external=True)
        await anna.close_session()

    asyncio.run(story())


def test_the_session_of_a_user_who_is_removed_ends(tmp_path: Path) -> None:
    async def story() -> None:
        path = users(tmp_path)
        server, clock = inner(path)
        set_user(Path(path), "carl", "operator", PASSWORD)
        anna, carl = session(server, "anna", 1), None
        clock.now += 1.0
        carl = session(server, "carl", 2)
        remove_user(Path(path), "carl")
        assert not server.user_manager.operates("carl")
        await server.end_removed()
        assert anna.is_activated()
        assert not carl.is_activated()
        await anna.close_session()

    asyncio.run(story())


async def ends(reader: asyncio.StreamReader) -> bool:
    """The server has ended the connection."""
    try:
        return await reader.read() == b""
    except ConnectionError:
        return True


@pytest.mark.parametrize("kind", [b"HEL", b"MSG", b"OPN", b"CLO", b"xyz"])
@pytest.mark.parametrize("size", [CHUNK + 1, 2**31, 2**32 - 1])
def test_a_chunk_that_is_too_long_ends_its_connection_by_its_head(kind: bytes, size: int) -> None:
    """Nothing but eight bytes is sent: a server that waited for the rest would not end it."""

    async def story() -> None:
        server, _ = inner()
        binary = _Binary(server, "127.0.0.1", 0, BoundedServer(server).limits)
        await binary.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", binary.port)
        writer.write(struct.pack("<3scI", kind, b"F", size))
        assert await ends(reader)
        writer.close()
        await binary.stop()

    asyncio.run(asyncio.wait_for(story(), 60.0))


def test_idle_connections_are_ended_and_bounded() -> None:
    async def story() -> None:
        server, clock = inner()
        binary = _Binary(server, "127.0.0.1", 0, BoundedServer(server).limits)
        await binary.start()
        made = [await asyncio.open_connection("127.0.0.1", binary.port) for _ in range(STRANGERS + 5)]
        for reader, _ in made[:5]:  # the oldest
            assert await ends(reader)
        while len(binary.clients) > STRANGERS:
            await asyncio.sleep(0)
        assert server.door.strangers() == STRANGERS
        clock.now += PATIENCE_S + 1.0
        server.door.end_old()
        for reader, _ in made[5:]:
            assert await ends(reader)
        while binary.clients:
            await asyncio.sleep(0)
        assert server.door.strangers() == 0
        for _, writer in made:
            writer.close()
        await binary.stop()

    asyncio.run(asyncio.wait_for(story(), 60.0))


def test_limits_of_a_message_are_not_raised_by_what_a_client_says() -> None:
    server, _ = inner()
    limits = BoundedServer(server).limits
    assert (limits.max_recv_buffer, limits.max_message_size) == (CHUNK, MESSAGE)
    hello = ua.Hello()
    hello.ReceiveBufferSize = hello.SendBufferSize = hello.MaxMessageSize = hello.MaxChunkCount = 2**31
    limits.create_acknowledge_and_set_limits(hello)
    assert limits.max_recv_buffer <= CHUNK
    assert limits.max_message_size <= MESSAGE
    assert limits.max_chunk_count <= MESSAGE // CHUNK + 1
