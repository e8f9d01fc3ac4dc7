"""All waiting datagrams at once: the same with and without the system call that takes many."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import numpy as np
import pytest

from counterflex.protocols.system import system_calls
from counterflex.protocols.system.datagrams import ROWS, SIZE, Datagrams, host_number


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        receiver.bind(("127.0.0.1", 0))
        sender.connect(receiver.getsockname())
        yield receiver, sender


@pytest.mark.parametrize("many", [True, False])
def test_takes_all_in_order_with_length_and_sender(
    pair: tuple[socket.socket, socket.socket], many: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not many:
        monkeypatch.setattr(system_calls, "THERE", False)
    receiver, sender = pair
    inbox = Datagrams(receiver)
    assert inbox.take() == 0
    sent = [bytes([k]) * (k + 1) for k in range(ROWS + 5)] + [b"", b"x" * SIZE]
    for data in sent:
        sender.send(data)
    got: list[bytes] = []
    for expected in (ROWS, len(sent) - ROWS, 0):
        count = inbox.take()
        assert count == expected
        assert np.all(inbox.hosts[:count] == host_number("127.0.0.1"))
        got += [inbox.data[k, : inbox.lengths[k]].tobytes() for k in range(count)]
    assert got == sent


@pytest.mark.parametrize("many", [True, False])
def test_never_raises(pair: tuple[socket.socket, socket.socket], many: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody at the other end, and a socket that is closed."""
    if not many:
        monkeypatch.setattr(system_calls, "THERE", False)
    receiver, sender = pair
    inbox = Datagrams(sender)
    receiver.close()
    sender.send(b"to nobody")
    assert inbox.take() == 0
    sender.close()
    assert inbox.take() == 0


def test_host_numbers() -> None:
    assert host_number("127.0.0.1") == 0x7F000001
    assert host_number("no.such.host.invalid") == -1
