"""R30 and R31: one loop for a robot, one peer for a session; rubbish and strangers do not end a wait."""

from __future__ import annotations

import errno
import json
import multiprocessing
import socket
import threading
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import InputError, OutputError
from counterflex.core.held import boot_id
from counterflex.protocols.processes.instance_lock import InstanceLock
from counterflex.protocols.robot.port import RobotPort, Verdict
from counterflex.protocols.robot.wire import UdpWire
from counterflex.protocols.system import system_calls


@pytest.fixture
def sender() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        yield own


def take(port: RobotPort) -> tuple[bool, list[bytes]]:
    """What a wait that never waits finds, and what was looked at."""
    seen: list[bytes] = []

    def read(length: int) -> Verdict:
        seen.append(bytes(port.data[:length]))
        return Verdict.NEW if seen[-1].startswith(b"good") else Verdict.MALFORMED

    return port.wait(0.0, read), seen


def test_the_first_good_sender_is_the_only_one(sender: socket.socket) -> None:
    port = RobotPort("127.0.0.1", 0, 1000)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"rubbish", port.address)
            assert take(port) == (False, [b"rubbish"])
            assert port.peer is None
            sender.sendto(b"good 1", port.address)
            assert take(port)[0]
            assert port.peer == sender.getsockname()
            for _ in range(20):
                stranger.sendto(b"good lies", port.address)
            assert take(port) == (False, [])
            assert port.counters.foreign == 20
            port.forget()
            stranger.sendto(b"good 2", port.address)
            assert take(port)[0]
    finally:
        port.close()


def test_a_session_that_is_forgotten_goes_on_from_another_port_of_its_computer_alone(sender: socket.socket) -> None:
    port = RobotPort("127.0.0.1", 0, 1000)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger, socket.socket(type=socket.SOCK_DGRAM) as moved:
        stranger.bind(("127.0.0.2", 0))
        moved.bind(("127.0.0.1", 0))
        try:
            sender.sendto(b"good 1", port.address)
            assert take(port)[0]
            for _ in range(3):
                moved.sendto(b"good 2", port.address)
                stranger.sendto(b"good lies", port.address)
            assert take(port) == (False, [])
            assert (port.counters.foreign, port.counters.moved) == (6, 3)
            assert port.counters.moved_port == moved.getsockname()[1]
            port.forget()
            stranger.sendto(b"good lies", port.address)
            assert take(port) == (False, [])
            assert not port.send(b"answer")
            moved.sendto(b"good 3", port.address)
            assert take(port)[0]
            assert port.peer == moved.getsockname()
        finally:
            port.close()


@pytest.mark.parametrize("any_port", [True, False])
def test_an_allowed_peer_is_the_only_one_from_the_start(sender: socket.socket, any_port: bool) -> None:
    host, number = sender.getsockname()
    port = RobotPort("127.0.0.1", 0, 1000, (host, 0 if any_port else number))
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.bind(("127.0.0.2", 0))
            stranger.sendto(b"good lies", port.address)
            assert take(port) == (False, [])
            assert port.counters.foreign == 1
        sender.sendto(b"good", port.address)
        assert take(port)[0]
    finally:
        port.close()


def test_a_line_that_is_gone_does_not_end_the_loop(sender: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    """R10: with the cable pulled the system says that there is no route; the answer is lost, nothing else."""
    port = RobotPort("127.0.0.1", 0, 1000)

    class Unplugged:
        def sendto(self, *_: object) -> int:
            raise OSError(errno.ENETUNREACH, "Network is unreachable")

        def close(self) -> None:
            pass

    with sender:
        sender.sendto(b"good", port.address)
        assert take(port)[0]
        assert port.send(b"answer")
        port.close()
        monkeypatch.setattr(port._wire, "_socket", Unplugged())
        assert not port.send(b"answer")


@pytest.mark.parametrize("many", [True, False])
def test_all_that_wait_are_looked_at_in_order_and_one_is_answered(
    sender: socket.socket, many: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than one system call takes at once, a stranger in between; the same without such a call."""
    if not many:
        monkeypatch.setattr(system_calls, "THERE", False)
    port = RobotPort("127.0.0.1", 0, 1000)
    sent = [b"good %d" % k for k in range(20)]
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for k, data in enumerate(sent):
                sender.sendto(data, port.address)
                if k == 12:
                    stranger.sendto(b"good lies", port.address)
        assert take(port) == (True, sent)
        assert (port.counters.drained, port.counters.foreign) == (19, 1)
        assert take(port) == (False, [])
        assert port.send(b"answer")
        assert sender.recv(100) == b"answer"
        assert (port.target >= 0) == (many and system_calls.THERE)
        port.forget()
        assert port.target == -1
        assert not port.send(b"answer")
    finally:
        port.close()


def test_a_kernel_sends_to_the_peer_itself(sender: socket.socket) -> None:
    port = RobotPort("127.0.0.1", 0, 1000)
    try:
        sender.sendto(b"good", port.address)
        assert take(port)[0]
        data = np.frombuffer(b"answer and more", dtype=np.uint8).copy()
        assert system_calls.send_to(port.target, data, 6, port.name) == system_calls.THERE
        assert not system_calls.THERE or sender.recv(100) == b"answer"
    finally:
        port.close()
    assert not system_calls.send_to(-1, data, 6, port.name)


def test_a_name_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="address"):
        RobotPort("127.0.0.1", 0, 100, ("no such host.invalid", 1))


def test_rubbish_does_not_end_a_wait(sender: socket.socket) -> None:
    """R13: a wait that ends early would look like a cycle without a telegram."""
    port = RobotPort("127.0.0.1", 0, 1000)
    sender.sendto(b"rubbish", port.address)

    def later() -> None:
        sender.sendto(b"good", port.address)

    def read(length: int) -> Verdict:
        data = bytes(port.data[:length])
        if data == b"rubbish":
            threading.Thread(target=later).start()
        return Verdict.NEW if data == b"good" else Verdict.MALFORMED

    try:
        assert port.wait(20.0, read)
        assert port.counters.malformed == 1
    finally:
        port.close()


@pytest.mark.skipif(not system_calls.THERE, reason="other systems sleep")
@pytest.mark.parametrize("due_us", [-3_600_000_000, -100, 0, 100, 400, 3_600_000_000])
def test_a_poll_misses_no_telegram_and_ends_in_time(sender: socket.socket, due_us: int) -> None:
    """Whatever moment was learnt: a telegram that is there is taken, and without one the wait ends as without polls."""
    wire = UdpWire("127.0.0.1", 0, 1000)
    port = RobotPort("127.0.0.1", 0, 1000, wire=wire)
    port.poll(4e-3, 500e-6)
    try:
        for there in (True, False, True):
            wire.window["due_ns"], wire.window["jitter_ns"] = time.monotonic_ns() + 1000 * due_us, 100_000
            if there:
                sender.sendto(b"good", port.address)
            before = time.monotonic_ns()
            assert port.wait(6e-3, lambda _: Verdict.NEW) == there
            assert there or time.monotonic_ns() - before >= 6_000_000
        due_ns = int(wire.window["due_ns"][0]) - 4_000_000
        assert abs(due_us) < 1000 or before <= due_ns <= time.monotonic_ns()  # far off: learnt anew
    finally:
        port.close()


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_a_port_has_one_owner(host: str) -> None:
    port = RobotPort("127.0.0.1", 0, 100)
    try:
        with pytest.raises(OutputError, match="One at a time"):
            RobotPort(host, port.address[1], 100)
    finally:
        port.close()


def _hold(folder: Path, pipe: Connection) -> None:
    with InstanceLock(folder, 49152, run="former log"):
        pipe.send("held")
        pipe.recv()


def test_a_lock_is_refused_while_held_and_free_when_its_holder_is_killed(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    own, other = context.Pipe()
    process = context.Process(target=_hold, args=(tmp_path, other))
    process.start()
    other.close()  # a process that cannot start ends the wait
    try:
        assert own.recv() == "held"
        with pytest.raises(OutputError, match=f"process {process.pid}"):
            InstanceLock(tmp_path, 49152)
        InstanceLock(tmp_path, 49153).close()
    finally:
        process.kill()
        process.join(10)
    with InstanceLock(tmp_path, 49152) as lock:
        assert lock.not_closed == "former log"
        text = lock.path.read_text(encoding="utf-8")
        assert '"pid"' in text
        assert boot_id() in text
    InstanceLock(tmp_path, 49152).close()


def test_a_lock_tells_of_a_holder_that_did_not_end_by_itself_until_that_was_seen(tmp_path: Path) -> None:
    first = InstanceLock(tmp_path, 49152, run="a")
    assert first.not_closed == ""
    first.close(ended=False)
    InstanceLock(tmp_path, 49152, run="b").close(acknowledged=False)
    unseen = InstanceLock(tmp_path, 49152, run="c")
    assert unseen.not_closed == "a"
    unseen.close(ended=False)
    seen = InstanceLock(tmp_path, 49152, run="d")
    assert seen.not_closed == "c"
    seen.close()
    last = InstanceLock(tmp_path, 49152)
    assert last.not_closed == ""
    last.close()


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("", ""),
        ("\n", ""),
        ('{"pid": 1, "boot": "another start of the machine", "run": "log"}', ""),
        (json.dumps({"pid": 1, "boot": boot_id()}), "unknown"),
        (json.dumps({"pid": 1, "boot": boot_id(), "given": False, "run": "log"}), ""),
        ("{", "unknown"),
        ("[" * 3000, "unknown"),
        ("7", "unknown"),
    ],
)
def test_what_a_lock_file_says_is_judged(tmp_path: Path, text: str, left: str) -> None:
    """What cannot be read is of somebody who did not close it; a loop of another start of the machine is none."""
    (tmp_path / "robot-49152.lock").write_text(text, encoding="utf-8")
    with InstanceLock(tmp_path, 49152) as lock:
        assert lock.not_closed == left
