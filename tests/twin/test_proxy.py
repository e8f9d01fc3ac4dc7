"""The proxy on real sockets: carries, loses and damages by its schedule, logs it, and does it again from the log."""

from __future__ import annotations

import io
import socket
from pathlib import Path

import pytest

from counterflex.core.errors import FileFormatError, OutputError
from counterflex.twin.network.impairment import Delivery, Impairment, Schedule, Stall
from counterflex.twin.network.proxy import DecisionLog, UdpProxy, read_decisions

N = 60
BAD = Impairment(loss=0.2, duplicate=0.2, flip=0.2, truncate=0.1, garbage=0.1, reorder=0.2, reorder_s=0.5)


class _Clock:
    """A clock that is moved by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def udp() -> socket.socket:
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.bind(("127.0.0.1", 0))
    own.settimeout(2.0)
    return own


def all_of(own: socket.socket) -> list[bytes]:
    own.setblocking(False)
    found = []
    while True:
        try:
            found.append(own.recv(65536))
        except BlockingIOError:
            return found


def carried(there: object, back: object, log: DecisionLog | None = None) -> tuple[list[bytes], list[bytes]]:
    """Send numbered datagrams there, then back: what arrives on both sides."""
    clock = _Clock()
    with udp() as robot, udp() as loop:
        proxy = UdpProxy(("127.0.0.1", 0), loop.getsockname(), there, back, log=log, clock=clock)  # type: ignore[arg-type]
        try:
            for k in range(N):
                robot.sendto(b"telegram %03d" % k, proxy.address)
                clock.now += 4e-3
                proxy.step(1.0)
            clock.now += 5.0
            proxy.step()
            first = all_of(loop)
            front = proxy._rear.getsockname()
            for k in range(N):
                loop.sendto(b"answer %03d" % k, front)
                clock.now += 4e-3
                proxy.step(1.0)
            clock.now += 5.0
            proxy.step()
            return first, all_of(robot)
        finally:
            proxy.close()


def test_a_good_network_changes_nothing() -> None:
    there, back = carried(Schedule(Impairment()), Schedule(Impairment(), 0, 1))
    assert there == [b"telegram %03d" % k for k in range(N)]
    assert back == [b"answer %03d" % k for k in range(N)]


def test_what_arrives_is_what_the_schedule_says() -> None:
    made = Impairment(loss=0.3, flip=0.3)
    schedule = Schedule(made, 4)
    there, _ = carried(Schedule(made, 4), Schedule(Impairment()))
    assert there == [d.of(b"telegram %03d" % k) for k in range(N) for d in schedule.decide(k)]


def test_late_ones_are_overtaken_and_none_is_made() -> None:
    there, _ = carried(Schedule(Impairment(stalls=(Stall(10, 5),), delay_s=1e-3)), Schedule(Impairment()))
    assert sorted(there) == [b"telegram %03d" % k for k in range(N)]
    delayed, _ = carried(Schedule(Impairment(reorder=0.3, reorder_s=0.02), 2), Schedule(Impairment()))
    assert delayed != sorted(delayed)
    assert sorted(delayed) == sorted(there)


def test_a_log_does_it_again_without_seed_and_settings(tmp_path: Path) -> None:
    stream = io.StringIO()
    before = carried(Schedule(BAD, 7), Schedule(BAD, 7, 1), DecisionLog(stream))
    path = tmp_path / "log.csv"
    path.write_text(stream.getvalue(), encoding="utf-8")
    there, back = read_decisions(path)
    assert carried(there, back) == before
    assert there.decide(N + 5) == (Delivery(),)
    for k in range(N):
        assert there.decide(k) == Schedule(BAD, 7).decide(k)


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match="not a log"):
        read_decisions(path)
    with pytest.raises(FileFormatError):
        read_decisions(tmp_path / "none.csv")
    stream = io.StringIO()
    carried(Schedule(BAD, 7), Schedule(BAD, 7, 1), DecisionLog(stream))
    first, second, *rest = stream.getvalue().splitlines()
    for row in (f"{second},7", second.rsplit(",", 1)[0]):
        path.write_text("\n".join([first, row, *rest]) + "\n", encoding="utf-8")
        with pytest.raises(FileFormatError, match="a row of another length"):
            read_decisions(path)


def test_an_address_in_use_is_said() -> None:
    with udp() as taken, pytest.raises(OutputError, match="proxy"):
        UdpProxy(taken.getsockname(), ("127.0.0.1", 9), Schedule(Impairment()), Schedule(Impairment()))
