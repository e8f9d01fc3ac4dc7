"""A controller that speaks over TCP: messages are cut as they are, however the stream is; an ended one begins again."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError, OutputError
from counterflex.protocols.robot.port import RobotPort, Verdict
from counterflex.protocols.robot.stream_wire import NO_MESSAGE, StreamWire, line_length

LONG = 5_000_000_000
"""ns; nothing waits so long where it works."""


def counted(data: bytes) -> int:
    """Length of a message that says its own length in its first two bytes, most significant first."""
    length = int.from_bytes(data[:2], "big") if len(data) > 1 else 0
    return NO_MESSAGE if 0 < length < 3 else length if len(data) >= length else 0


@pytest.fixture
def wire() -> Iterator[StreamWire]:
    own = StreamWire("127.0.0.1", 0, 40, line_length)
    yield own
    own.close()


def message(wire: StreamWire) -> bytes:
    """Return the next message, or nothing."""
    return wire.rows[0][: wire.lengths[0]].tobytes() if wire.receive(LONG) else b""


@given(st.lists(st.binary(min_size=1, max_size=30), min_size=1, max_size=6), st.data())
def test_messages_come_as_they_were_however_the_stream_is_cut(bodies: list[bytes], data: st.DataObject) -> None:
    sent = [(len(body) + 2).to_bytes(2, "big") + body for body in bodies]
    stream, at = b"".join(sent), 0
    own = StreamWire("127.0.0.1", 0, 40, counted)
    try:
        with socket.create_connection(own.address) as controller:
            received: list[bytes] = []
            while at < len(stream):
                end = data.draw(st.integers(at + 1, len(stream)))
                controller.sendall(stream[at:end])
                at = end
                whole = sum(np.cumsum([len(one) for one in sent]) <= at)
                received += [message(own) for _ in range(whole - len(received))]
            assert received == sent
            assert own.receive(0) == 0
    finally:
        own.close()


def test_what_is_no_message_or_never_ends_one_ends_the_connection(wire: StreamWire) -> None:
    for rubbish in (b"x" * 41, b"x" * 60 + b"\n"):
        with socket.create_connection(wire.address) as controller:
            controller.sendall(b"good\n" + rubbish)
            assert message(wire) == b"good\n"
            assert wire.receive(0) == 0
            assert not wire.send(b"answer\n", wire.address)
        with socket.create_connection(wire.address) as controller:
            controller.sendall(b"again\n")
            assert message(wire) == b"again\n"


def test_a_controller_that_connects_again_is_answered(wire: StreamWire) -> None:
    port = RobotPort("127.0.0.1", 0, 40, None, wire)
    for number in range(2):
        with socket.create_connection(port.address) as controller:
            controller.sendall(f"{number}\n".encode())
            assert port.wait(5.0, lambda _: Verdict.NEW)
            assert port.send(b"answer\n")
            assert controller.recv(20) == b"answer\n"
        assert not port.wait(0.0, lambda _: Verdict.NEW)
        assert not port.send(b"to nobody\n")
        port.forget()


def test_a_controller_that_listens_is_connected_to() -> None:
    with socket.create_server(("127.0.0.1", 0)) as controller:
        own = StreamWire("127.0.0.1", 0, 40, line_length, controller.getsockname())
        assert own.receive(0) == 0
        session = controller.accept()[0]
        session.sendall(b"one\ntwo\n")
        assert [message(own), message(own)] == [b"one\n", b"two\n"]
        assert own.send(b"back\n", own.address)
        assert session.recv(20) == b"back\n"
        session.close()
        assert own.receive(0) == 0
        assert own.receive(0) == 0  # the end is seen, then it is connected to again
        with controller.accept()[0] as session:
            session.sendall(b"three\n")
            assert message(own) == b"three\n"
        own.close()


def test_one_that_is_off_is_a_cycle_without_a_telegram() -> None:
    with socket.create_server(("127.0.0.1", 0)) as controller:
        place = controller.getsockname()
    own = StreamWire("127.0.0.1", 0, 40, line_length, place)
    assert own.receive(1_000_000) == 0
    assert not own.send(b"x\n", place)
    own.close()


def test_a_stranger_does_not_take_the_place_of_the_controller() -> None:
    own = StreamWire("127.0.0.1", 0, 40, line_length, ("192.0.2.1", 0))
    with socket.create_connection(own.address) as stranger:
        stranger.sendall(b"lies\n")
        assert own.receive(0) == 0
        assert not own.send(b"x\n", stranger.getsockname())
    own.close()


def test_a_controller_whose_cable_was_pulled_begins_again_and_no_stranger_in_its_place(wire: StreamWire) -> None:
    with socket.create_connection(wire.address) as before, socket.socket() as stranger:
        before.sendall(b"one\nhalf of")
        assert message(wire) == b"one\n"
        stranger.bind(("127.0.0.2", 0))
        stranger.connect(wire.address)
        stranger.sendall(b"lies\n")
        assert wire.receive(0) == 0
        assert wire.send(b"still here\n", before.getsockname())
        with socket.create_connection(wire.address) as again:
            again.sendall(b"two\n")
            assert message(wire) == b"two\n"
            assert wire.senders[0] & 0xFFFF == again.getsockname()[1]


def test_a_port_that_is_taken_or_a_host_that_is_none_is_said(wire: StreamWire) -> None:
    with pytest.raises(OutputError, match="cannot be opened"):
        StreamWire("127.0.0.1", wire.address[1], 40, line_length)
    with pytest.raises(InputError, match="address is none"):
        StreamWire("127.0.0.1", 0, 40, line_length, ("no such host.", 1))
