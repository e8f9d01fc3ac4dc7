"""Listening sockets that count: strangers are few and short, users stay, whoever comes in crowds ends himself."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator

import pytest

from counterflex.app.panel.door import AT_A_TIME, KNOWN, PATIENCE_S, STRANGERS, Door, network_of


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


class Crowd:
    """A door, and connections to it from addresses of this computer."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.door = Door(self.clock)
        (self.listening,) = self.door.listen("127.0.0.1", 0)
        self.listening.listen(64)
        self.ends: list[socket.socket] = [self.listening]

    def come(self, source: str = "127.0.0.1") -> tuple[socket.socket, socket.socket]:
        client = socket.create_connection(self.listening.getsockname(), source_address=(source, 0))
        server, _ = self.listening.accept()
        client.settimeout(10.0)
        self.ends += [client, server]
        return client, server

    def ended(self, client: socket.socket) -> bool:
        """The server has sent an end; a connection that is open would have nothing to read."""
        client.setblocking(False)
        try:
            return client.recv(1) == b""
        except BlockingIOError:
            return False
        except ConnectionError:
            return True


@pytest.fixture
def crowd() -> Iterator[Crowd]:
    made = Crowd()
    yield made
    for one in made.ends:
        one.close()


def test_strangers_are_bounded_and_the_crowd_ends_its_own(crowd: Crowd) -> None:
    other, _ = crowd.come("127.0.0.2")
    crowded = [crowd.come("127.0.0.3")[0] for _ in range(STRANGERS + 30)]
    assert crowd.door.strangers() == STRANGERS
    assert not crowd.ended(other)
    assert [crowd.ended(one) for one in crowded] == [True] * 31 + [False] * (STRANGERS - 1)  # the oldest


def test_users_are_not_ended_by_strangers_nor_by_time(crowd: Crowd) -> None:
    user, server = crowd.come("127.0.0.3")
    crowd.door.know(server.getpeername())
    for _ in range(2 * STRANGERS):
        crowd.come("127.0.0.3")
    crowd.clock.now += PATIENCE_S + 1.0
    crowd.door.end_old()
    assert crowd.door.strangers() == 0
    assert not crowd.ended(user)


def test_a_stranger_has_his_time(crowd: Crowd) -> None:
    first, _ = crowd.come()
    crowd.clock.now += PATIENCE_S - 1.0
    second, _ = crowd.come()
    crowd.door.end_old()
    assert not crowd.ended(first)
    crowd.clock.now += 1.0
    crowd.door.end_old()
    assert (crowd.ended(first), crowd.ended(second)) == (True, False)


def test_what_is_closed_is_forgotten(crowd: Crowd) -> None:
    made = [crowd.come() for _ in range(6)]
    for _, server in made[:3]:
        crowd.door.know(server.getpeername())
    for client, server in made:
        server.close()
        client.close()
    assert crowd.door.strangers() == len(crowd.door._known) == 0


def test_connections_of_users_are_bounded_too() -> None:
    door = Door(Clock())
    door._known = {("x", k) for k in range(KNOWN)}
    end, other = socket.socketpair()
    door._strangers[("10.0.0.1", 1)] = (100.0, end)  # type: ignore[assignment]
    door.know(("10.0.0.1", 1))
    assert door.strangers() == 1
    end.close()
    other.close()


def test_an_event_loop_takes_a_few_at_a_time_and_ends_reach_its_server() -> None:
    """While hundreds wait the loop comes back to what it has already: between two looks it takes AT_A_TIME at most."""

    async def serve() -> tuple[list[int], int]:
        clock = Clock()
        door = Door(clock)
        (listening,) = door.listen("127.0.0.1", 0)
        lost: list[object] = []

        class Protocol(asyncio.Protocol):
            def connection_lost(self, _: Exception | None) -> None:
                lost.append(self)

        taken: list[int] = []
        server = await asyncio.get_running_loop().create_server(Protocol, sock=listening, backlog=AT_A_TIME)
        door.widen()
        clients = []
        for _ in range(10 * AT_A_TIME):
            client = socket.socket()
            client.setblocking(False)
            client.connect_ex(listening.getsockname())
            clients.append(client)
        came, before = [0], door.count

        def counted(connection: object, address: object) -> None:
            came[0] += 1
            before(connection, address)  # type: ignore[arg-type]

        door.count = counted  # type: ignore[method-assign]
        last = 0
        while came[0] < len(clients):
            await asyncio.sleep(0)
            taken.append(came[0] - last)
            last = came[0]
        clock.now += PATIENCE_S + 1.0
        door.end_old()
        while len(lost) < len(clients):
            await asyncio.sleep(0)
        for client in clients:
            client.close()
        server.close()
        await server.wait_closed()
        return taken, door.strangers()

    taken, left = asyncio.run(asyncio.wait_for(serve(), 60.0))
    assert max(taken) <= AT_A_TIME
    assert left == 0


@pytest.mark.parametrize(
    ("host", "network"),
    [
        ("10.0.0.7", "10.0.0.7"),
        ("::ffff:10.0.0.7", "10.0.0.7"),
        ("2001:db8:0:1:2:3:4:5", "2001:db8:0:1::"),
        ("fe80::1%eth0", "fe80::"),
        ("unknown", "unknown"),
    ],
)
def test_who_counts_as_one(host: str, network: str) -> None:
    assert network_of(host) == network
