"""The generic wrench datagram: golden bytes, round trips, what is refused, and what a link makes of a stream of it."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError, OutputError, ProtocolError
from counterflex.protocols.force.sensors import Opening, link_values, opened
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.force.stream import FROZEN, SampleStream
from counterflex.protocols.sequence_kernel import RESTART
from counterflex.protocols.wrench.sensor import WrenchLink
from counterflex.protocols.wrench.telegram import (
    INVALID,
    WARNING,
    Wrench,
    read_wrench,
    rows_of,
)
from counterflex.twin.devices.wrench import RANGE_N, WrenchSender
from counterflex.twin.network.faults import Fault, FaultSchedule

U32 = st.integers(0, 2**32 - 1)
PART = st.floats(-1e6, 1e6)
GOLDEN = bytes.fromhex(
    "43465731"  # CFW1
    "2a000000"  # sequence 42
    "40420f0000000000"  # 1 000 000 ns
    "04000000"  # warning
    "07000000"  # source 7
    "000000000000f03f"  # 1 N
    "00000000000000c0"  # -2 N
    "0000000000000840"  # 3 N
    "9a9999999999b93f"  # 0.1 N m
    "9a9999999999c9bf"  # -0.2 N m
    "333333333333d33f"  # 0.3 N m
)
ONE = Wrench(42, 1_000_000, WARNING, 7, (1.0, -2.0, 3.0, 0.1, -0.2, 0.3))


def test_golden_bytes() -> None:
    assert ONE.written() == GOLDEN
    assert read_wrench(GOLDEN) == ONE


@given(U32, st.integers(0, 2**64 - 1), st.integers(0, 7), U32, st.tuples(*[PART] * 6))
def test_round_trip_one_by_one_and_as_rows(
    sequence: int, time_ns: int, status: int, source: int, w: tuple[float, float, float, float, float, float]
) -> None:
    data = Wrench(sequence, time_ns, status, source, w).written()
    assert read_wrench(data) == Wrench(sequence, time_ns, status, source, w)
    row = np.frombuffer(data, dtype=np.uint8).reshape(1, 72)
    rows, good = rows_of(row, np.array([72]), 1)
    assert good.tolist() == [True]
    assert tuple(rows["wrench"][0]) == w
    assert (rows["sequence"][0], rows["time_ns"][0], rows["status"][0]) == (sequence, time_ns, status)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (GOLDEN[:-1], "71 bytes"),
        (b"CFP1" + GOLDEN[4:], "CFP1"),
        (b"CFW2" + GOLDEN[4:], "another version"),
        (GOLDEN[:16] + b"\x08\0\0\0" + GOLDEN[20:], "unknown status bits"),
        (GOLDEN[:24] + struct.pack("<d", float("nan")) + GOLDEN[32:], "not finite"),
        (GOLDEN[:24] + struct.pack("<d", -2e6) + GOLDEN[32:], "out of range"),
    ],
)
def test_what_is_refused_alone_is_refused_in_a_row(data: bytes, said: str) -> None:
    with pytest.raises(ProtocolError, match=said):
        read_wrench(data)
    row = np.zeros((1, 80), dtype=np.uint8)
    row[0, : len(data)] = np.frombuffer(data, dtype=np.uint8)
    assert rows_of(row, np.array([len(data)]), 1)[1].tolist() == [False]


def test_an_invalid_measurement_may_hold_any_numbers() -> None:
    assert read_wrench(Wrench(1, 2, INVALID, 0, (float("nan"),) * 6).written()).status == INVALID


@pytest.fixture
def link() -> Iterator[WrenchLink]:
    made = WrenchLink(range_n=1000.0)
    yield made
    made.close()


def sender(link: WrenchLink, *faults: Fault, source: int = 0) -> WrenchSender:
    return WrenchSender(link.address, FaultSchedule(faults, 3), source=source)


def play(link: WrenchLink, device: WrenchSender, count: int, begin: int = 0, hz: float = 1000.0) -> list[int]:
    """Good samples of each drain, one drain per four samples; the load rises by 1 N per sample."""
    out = []
    for k in range(begin, begin + count):
        device.send(np.array([0.1 * k, 0.0, -50.0, 0.0, 0.0, 0.0]), k / hz)
        if k % 4 == 3:
            out.append(link.drain())
    return out


def test_it_is_the_force_source_that_a_cell_file_names() -> None:
    values = link_values("wrench", {"source": 7})
    source = opened("wrench", Opening("127.0.0.1", 0, values=values))
    assert isinstance(source, WrenchLink)
    assert isinstance(source, ForceSource)
    source.close()
    with pytest.raises(ValueError, match="has no key port"):
        link_values("wrench", {"port": 1})


def test_mean_samples_and_numbers_of_a_kilohertz_stream(link: WrenchLink) -> None:
    device = sender(link)
    assert play(link, device, 400) == [4] * 100
    np.testing.assert_allclose(link.w_sensor, [39.75, 0.0, -50.0, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(link.samples[:4, 0], [39.6, 39.7, 39.8, 39.9], atol=1e-12)
    assert link.first == 397
    assert (link.lost, link.bad, link.malformed, link.foreign, link.frozen, link.saturated) == (
        0,
        0,
        0,
        0,
        False,
        False,
    )
    play(link, device, 400, 400, hz=500.0)
    assert link.first == -1, "500 Hz by the source's own clock"
    device.close()


def test_four_kilohertz_pile_up_and_lose_nothing(link: WrenchLink) -> None:
    device = sender(link)
    for k in range(200):  # 50 ms: more than a loop may be late; the system keeps some 250 datagrams
        device.send(np.array([float(k), 0.0, 0.0, 0.0, 0.0, 0.0]), k / 4000.0)
    assert link.drain() == 200
    assert link.w_sensor[0] == 99.5
    device.close()


@pytest.mark.parametrize(
    ("fault", "lost", "bad", "malformed"),
    [
        (Fault("lost", first=10, count=3), 3, 0, 0),
        (Fault("counter", first=10, step=5), 5, 0, 0),
        (Fault("nan", first=10, count=2), 0, 2, 0),
        (Fault("truncated", first=10, count=1), 1, 0, 1),
        (Fault("garbage", first=10, count=2), 2, 0, 2),
        (Fault("repeated", first=10, count=2), 0, 0, 0),
        (Fault("status", first=10, count=1, bits=8), 1, 0, 1),
        (Fault("status", first=10, count=1, bits=WARNING), 0, 0, 0),
    ],
)
def test_faults_are_counted_and_the_rest_is_used(
    link: WrenchLink, fault: Fault, lost: int, bad: int, malformed: int
) -> None:
    device = sender(link, fault)
    play(link, device, 40)
    assert (link.lost, link.bad, link.malformed) == (lost, bad, malformed)
    assert link.good == 4
    device.close()


def test_saturation_is_said_in_its_cycle_by_status_and_by_range(link: WrenchLink) -> None:
    device = sender(link, Fault("saturated", first=8, count=4))
    assert play(link, device, 8) == [4, 4]
    assert play(link, device, 4, 8) == [0]
    assert link.saturated
    assert play(link, device, 4, 12) == [4]
    assert not link.saturated
    device.send(np.array([951.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.1)
    assert link.drain() == 1
    assert link.saturated
    assert RANGE_N > 1000.0
    device.close()


def test_a_frozen_sensor_is_frozen_from_25_samples_on(link: WrenchLink) -> None:
    device = sender(link, Fault("frozen", first=3))
    play(link, device, FROZEN - 1)
    assert not link.frozen
    play(link, device, 8, FROZEN - 1)
    assert link.frozen
    device.close()


def test_a_source_that_starts_again_is_believed_after_sixteen_samples(link: WrenchLink) -> None:
    device = sender(link)
    play(link, device, 400)
    again = sender(link)
    assert play(link, again, RESTART) == [0, 0, 0, 1]
    assert play(link, again, 4, RESTART) == [4]
    assert link.restarts == 1
    assert link.lost == 0
    device.close()
    again.close()


def test_another_sender_and_another_source_are_foreign() -> None:
    own = WrenchLink(sender="127.0.0.2")
    device = sender(own)
    play(own, device, 4)
    assert (own.good, own.foreign) == (0, 4)
    device.close()
    own.close()
    own = WrenchLink(source=3)
    wrong, right = sender(own, source=2), sender(own, source=3)
    play(own, wrong, 4)
    assert (own.good, own.foreign) == (0, 4)
    assert play(own, right, 4) == [4]
    for one in (own, wrong, right):
        one.close()


def test_a_port_in_use_and_an_unknown_sender_are_refused() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(OutputError, match=r"force_sensor\.address is where the datagrams come to"):
            WrenchLink(*other.getsockname())
    with pytest.raises(InputError, match="sender"):
        WrenchLink(sender="256.1.1.1")
    with pytest.raises(InputError, match="range"):
        SampleStream(range_n=0.0)
