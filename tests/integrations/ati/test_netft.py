"""Records and scaling of the force sensor: observed bytes, round trips, faults."""

from __future__ import annotations

import math
import socket
import threading

import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import OutputError, ProtocolError
from counterflex.integrations.ati.link import telegram as netft
from counterflex.integrations.ati.link.link import fetch_scaling

U32 = st.integers(0, 2**32 - 1)
I32 = st.integers(-(2**31), 2**31 - 1)


def read_record(data: bytes) -> netft.NetftRecord:
    """Record of its bytes."""
    sequence, sample, status, *counts = netft.RECORD.unpack(data)
    return netft.NetftRecord(sequence, sample, status, tuple(counts))


def test_an_observed_record() -> None:
    data = bytes.fromhex("0000000200000002000000000" + "00f4240ffe17b80002dc6c000002710ffffb1e000007530")
    record = read_record(data)
    scaling = netft.Scaling.of(netft.write_scaling(1_000_000, 1_000_000, 1000, "Net F/T"))
    assert record.sequence == record.sample == 2
    assert [c * scaling.force_n for c in record.counts[:3]] == pytest.approx([1.0, -2.0, 3.0])
    assert [c * scaling.moment_nm for c in record.counts[3:]] == pytest.approx([0.01, -0.02, 0.03])


def test_requests_are_the_documented_bytes() -> None:
    assert netft.request(netft.START).hex() == "1234000200000000"
    assert netft.request(netft.SET_BIAS).hex() == "1234004200000000"
    assert netft.read_request(netft.request(netft.START, 5)) == (netft.START, 5)


@given(U32, U32, U32, st.tuples(I32, I32, I32, I32, I32, I32))
def test_records_round_trip(sequence: int, sample: int, status: int, counts: tuple[int, ...]) -> None:
    record = netft.NetftRecord(sequence, sample, status, counts)  # type: ignore[arg-type]
    assert read_record(record.written()) == record


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("N-m", 1.0), ("Nm", 1.0), ("N-mm", 1e-3), ("Lbf-in", 0.1129848290276167), ("kg-cm", 0.0980665)],
)
def test_units_of_real_devices(unit: str, factor: float) -> None:
    document = netft.write_scaling(1000, 1000, 7000, "Axia").replace(b"N-m", unit.encode())
    assert netft.Scaling.of(document).moment_nm == pytest.approx(factor / 1000)


@pytest.mark.parametrize(("unit", "factor"), [("Klbf", 4448.2216152605), ("Kg", 9.80665), ("kN", 1000.0)])
def test_units_of_force(unit: str, factor: float) -> None:
    document = netft.write_scaling(1000, 1000, 7000, "Axia").replace(b">N<", f">{unit}<".encode())
    assert netft.Scaling.of(document).force_n == pytest.approx(factor / 1000)
    with pytest.raises(ProtocolError, match=r"unit is not known.*stone.*kgf"):
        netft.Scaling.of(document.replace(f">{unit}<".encode(), b">stone<"))


@pytest.mark.parametrize(
    ("old", "new", "rate_hz", "product"),
    [
        (b"", b"", 7000.0, "Axia"),
        (b"<comrdtrate>7000</comrdtrate>", b"", None, "Axia"),
        (b"<prodname>Axia</prodname>", b"", 7000.0, ""),
        (b"<comrdtrate>7000", b"<comrdtrate>fast", None, "Axia"),
        (b"<comrdtrate>7000", b"<comrdtrate>0", None, "Axia"),
        (b"<prodname>Axia", b"<prodname>", 7000.0, ""),
    ],
)
def test_sensors_that_tell_neither_name_nor_rate_are_read(
    old: bytes, new: bytes, rate_hz: float | None, product: str
) -> None:
    document = netft.write_scaling(1000, 2000, 7000, "Axia")
    assert old in document
    scaling = netft.Scaling.of(document.replace(old, new, 1))
    assert (scaling.force_n, scaling.moment_nm) == (1e-3, 5e-4)
    assert (scaling.rate_hz, scaling.product) == (rate_hz, product)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"<cfgcpf>1000</cfgcpf>", b"", "cfgcpf"),
        (b"<cfgcpf>1000", b"<cfgcpf>0", "positive"),
        (b"<cfgcpf>1000", b"<cfgcpf>nan", "positive"),
        (b"<scfgfu>N", b"<scfgfu>furlong", "furlong"),
        (b"<netft>", b"<!DOCTYPE a [<!ENTITY b 'c'>]><netft>", "not an XML"),
        (b"</netft>", b"", "not an XML"),
    ],
)
def test_scaling_faults_are_named(old: bytes, new: bytes, said: str) -> None:
    with pytest.raises(ProtocolError, match=said):
        netft.Scaling.of(netft.write_scaling(1000, 1000, 1000, "x").replace(old, new))


@pytest.mark.parametrize(
    ("document", "said"),
    [
        (b"<!DOCTYPE html>\n<html><head><title>Router</title></head></html>", "a web page"),
        (b"<HTML><BODY>404<BR></BODY></HTML>", "a web page"),
        (b"<?xml version='1.0'?><html xmlns='http://www.w3.org/1999/xhtml'><body/></html>", "a web page"),
        (b"\x1f\x8b\x08\x00abc", "compressed"),
    ],
)
def test_a_web_page_is_no_sensor(document: bytes, said: str) -> None:
    """Another device at the address: an XML error or a missing field told nobody so."""
    with pytest.raises(ProtocolError, match=said) as told:
        netft.Scaling.of(document, "http://192.168.1.1:80/netftapi2.xml")
    assert "address" in str(told.value)


RATED = b"<cfgmr>330;330;990;30;30;30</cfgmr>"


@pytest.mark.parametrize(
    ("more", "forces", "moments"),
    [
        (b"", (math.inf,) * 3, (math.inf,) * 3),
        (RATED, (330.0, 330.0, 990.0), (30.0,) * 3),
        (RATED.replace(b";", b", "), (330.0, 330.0, 990.0), (30.0,) * 3),
        (RATED.replace(b"990", b"0"), (330.0, 330.0, math.inf), (30.0,) * 3),
        (b"<cfgmr>empty</cfgmr>", (math.inf,) * 3, (math.inf,) * 3),
        (RATED + b"<scfgtdu>mm</scfgtdu><cfgtfx>0;0;100;0;0;0</cfgtfx>", (330.0, 330.0, 990.0), (139.45,) * 3),
        (RATED + b"<scfgtdu>mm</scfgtdu><cfgtfx>0;0;0;0;0;45</cfgtfx>", (1094.4861,) * 3, (51.9615,) * 3),
    ],
)
def test_what_a_sensor_is_calibrated_for(more: bytes, forces: tuple[float, ...], moments: tuple[float, ...]) -> None:
    """As a Net F/T states it, in its own units and about its own origin."""
    document = netft.write_scaling(1000, 1000, 7000, "Gamma").replace(b"</netft>", more + b"</netft>")
    scaling = netft.Scaling.of(document)
    assert scaling.range_n == pytest.approx(forces)
    assert scaling.range_nm == pytest.approx(moments, rel=1e-4)


def test_requests_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ProtocolError):
        netft.request(0x10000)
    with pytest.raises(ProtocolError, match="0x1234"):
        netft.read_request(b"\0" * 8)
    with pytest.raises(ProtocolError):
        netft.NetftRecord(0, 0, 0, (2**31, 0, 0, 0, 0, 0)).written()


def test_a_port_that_says_back_what_it_hears_is_no_sensor_yet() -> None:
    """As a connection does that has met itself, while the sensor's port is free: it is tried again, not given up."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def echo() -> None:
            with server.accept()[0] as met:
                met.sendall(met.recv(4096))

        thread = threading.Thread(target=echo)
        thread.start()
        with pytest.raises(OutputError, match="does not serve its scaling: GET"):
            fetch_scaling("127.0.0.1", server.getsockname()[1])
        thread.join()
