"""Strain datagrams over a real socket: what is written is read, what is none is counted, which bridges are believed."""

from __future__ import annotations

import math
import socket
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.protocols.strain import kernel as reading
from counterflex.protocols.strain.kernel import FROZEN
from counterflex.protocols.strain.link import StrainLink
from counterflex.protocols.strain.telegram import HEAD, MOST, StrainSample

STRAIN: Float = np.array([1.5e-6, -20e-6, 3e-6, 0.0, 7e-6, -1e-6])


def datagram(sequence: int, strain: Float = STRAIN, *, status: int = 0, warm_c: float = 22.5) -> bytes:
    return StrainSample(sequence, sequence * 1_000_000, status, warm_c, strain).telegram()


@pytest.fixture
def link() -> Iterator[StrainLink]:
    opened = StrainLink("127.0.0.1", 0, 6, range_=1e-3)
    yield opened
    opened.close()


def send(link: StrainLink, *data: bytes) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for one in data:
            out.sendto(one, link.address)
        return link.drain()


def read(data: bytes) -> tuple[int, StrainSample | None]:
    """Outcome of the kernel that reads datagrams, and the reading of a good one."""
    rows = np.zeros((1, reading.LONGEST), dtype=np.uint8)
    rows[0, : min(len(data), reading.LONGEST)] = np.frombuffer(data[: reading.LONGEST], dtype=np.uint8)
    strain = np.zeros(MOST)
    outcome = reading.read_datagram(rows, 0, len(data), strain)
    if outcome in (reading.NO_DATAGRAM, reading.UNKNOWN_STATUS, reading.OUT_OF_RANGE):
        return outcome, None
    _, sequence, time_ns, status, count, warm_c = HEAD.unpack(data[: HEAD.size])
    return outcome, StrainSample(sequence, time_ns, status, warm_c, strain[:count])


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**63 - 1),
    st.lists(st.floats(-0.09, 0.09) | st.just(math.nan), min_size=3, max_size=12),
    st.floats(-50.0, 150.0) | st.just(math.nan),
)
def test_what_is_written_is_read(sequence: int, time_ns: int, strain: list[float], warm_c: float) -> None:
    status = (1 << len(strain)) - 1
    _, back = read(StrainSample(sequence, time_ns, status, warm_c, np.array(strain)).telegram())
    assert back is not None
    assert (back.sequence, back.time_ns, back.status) == (sequence, time_ns, status)
    np.testing.assert_allclose(back.strain, strain, rtol=1e-12, equal_nan=True)
    np.testing.assert_equal(back.temperature_c, warm_c)


def test_the_layout_is_the_documented_one() -> None:
    data = datagram(7, status=2)
    assert data[:4] == b"CFS1"
    assert len(data) == 32 + 8 * 6
    assert struct.unpack_from("<IQIId", data, 4) == (7, 7_000_000, 2, 6, 22.5)
    assert struct.unpack_from("<6d", data, 32) == pytest.approx(STRAIN * 1e6)


@pytest.mark.parametrize(
    ("data", "outcome"),
    [
        (datagram(1)[:-1], reading.NO_DATAGRAM),
        (b"CFP1" + datagram(1)[4:], reading.NO_DATAGRAM),
        (datagram(1) + b"\0" * 8, reading.NO_DATAGRAM),
        (datagram(1, status=64), reading.UNKNOWN_STATUS),
        (datagram(1, np.array([0.0, 0.2, 0.0])), reading.OUT_OF_RANGE),
        (datagram(1, warm_c=1000.0), reading.OUT_OF_RANGE),
        (b"", reading.NO_DATAGRAM),
    ],
)
def test_what_is_no_datagram_is_named(data: bytes, outcome: int) -> None:
    assert read(data) == (outcome, None)


def test_the_link_counts_and_orders(link: StrainLink) -> None:
    assert (
        send(link, datagram(1), datagram(2), datagram(5), datagram(4), datagram(5), b"no", datagram(6, STRAIN[:5])) == 3
    )
    received = link.received
    assert (received.lost, received.malformed, received.other) == (2, 1, 1)
    np.testing.assert_allclose(link.strain[:3, :6], np.tile(STRAIN, (3, 1)))
    assert link.times_ns[:3].tolist() == [1_000_000, 2_000_000, 5_000_000]
    assert send(link) == 0


def test_bridges_that_are_not_believed_show_nothing(link: StrainLink) -> None:
    """One out of range, one reported by the amplifier, one without a number: three are left, too few."""
    wild = STRAIN.copy()
    wild[1], wild[2] = 2e-3, math.nan
    assert send(link, datagram(1, wild, status=1)) == 1
    assert np.flatnonzero(np.isnan(link.strain[0, :6])).tolist() == [0, 1, 2]
    assert link.saturated
    assert send(link, datagram(2)) == 1
    assert not link.saturated


def test_a_bridge_that_repeats_itself_is_not_believed(link: StrainLink) -> None:
    rng = np.random.default_rng(0)
    for k in range(FROZEN):
        moving = STRAIN + 1e-7 * rng.standard_normal(6)
        moving[4] = STRAIN[4]
        assert send(link, datagram(k + 1, moving)) == 1
        assert np.isnan(link.strain[0, 4]) == (k == FROZEN - 1)
    assert not link.frozen
    for k in range(FROZEN):
        send(link, datagram(100 + k))
    assert link.frozen


def test_what_cannot_be_a_holder_is_refused() -> None:
    with pytest.raises(InputError, match="bridges of the holder"):
        StrainLink("127.0.0.1", 0, 2, range_=1e-3)
    with pytest.raises(InputError, match="range of the bridges"):
        StrainLink("127.0.0.1", 0, 6, range_=0.0)
