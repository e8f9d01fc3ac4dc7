"""Sensors described by frames in the cell file: the documented bytes of four makers, streams, and bad descriptions."""

from __future__ import annotations

import select
import socket
import struct
from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import CounterflexError, InputError, OutputError
from counterflex.files.cell.sensing import FrameTable, SensorTable
from counterflex.files.schema import parse
from counterflex.protocols.force.frame_format import COMPONENTS, FrameFormat, crc16_x25
from counterflex.protocols.force.sensors import Opening, opened
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.frame.link import FrameLink

W = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
ONROBOT: dict[str, Any] = {
    "start": "1234000200000000", "stop": "1234000000000000", "byte_order": "big",
    "fields": ["uint32 sequence", "uint32 -", "uint32 status", *(f"int32 {c}" for c in COMPONENTS)],
    "counts_per_n": 10000, "counts_per_nm": 100000, "invalid_bits": 0xFFFFFFFF,
}  # fmt: skip
AXIA_TCP: dict[str, Any] = {
    "transport": "tcp", "request": "00" * 20, "header": "1234", "byte_order": "big",
    "fields": ["uint16 status", *(f"int16 {c}" for c in COMPONENTS)],
    "counts_per_n": 100, "counts_per_nm": 1000, "invalid_bits": 0x8000,
}  # fmt: skip
BOTA: dict[str, Any] = {
    "transport": "tcp", "header": "aa", "byte_order": "little",
    "fields": ["uint16 status", *(f"float32 {c}" for c in COMPONENTS), "uint32 -", "float32 -", "uint16 crc16_x25"],
    "crc_from": 1, "saturated_bits": 2, "invalid_bits": 5,
}  # fmt: skip
MATRIX = (100.0 * (np.eye(6) + 0.1 * np.arange(36).reshape(6, 6) / 36.0)).tolist()
GSV8: dict[str, Any] = {
    "transport": "tcp", "start": "aa902485", "stop": "aa902385", "header": "aa", "footer": "85", "byte_order": "big",
    "fields": ["uint8 -", "uint8 status", *(f"float32 ch{k}" for k in range(1, 7)), "float32 -", "float32 -"],
    "matrix": MATRIX, "saturated_bits": 1, "invalid_bits": 2,
}  # fmt: skip


def table(data: dict[str, Any], **change: Any) -> FrameTable:
    return parse(FrameTable, {**data, **change}, where="[sensor.frame]")


def frame(data: dict[str, Any], **change: Any) -> FrameFormat:
    return table(data, **change).source().frame


def test_crc_of_the_catalogue() -> None:
    assert crc16_x25(b"123456789") == 0x906E


@pytest.mark.parametrize(
    ("data", "golden"),
    [
        (ONROBOT, struct.pack(">III6i", 7, 0, 0, 10000, -20000, 30000, 10000, -20000, 30000)),
        (AXIA_TCP, b"\x12\x34" + struct.pack(">H6h", 0, 100, -200, 300, 100, -200, 300)),
        (BOTA, (b := b"\xaa" + struct.pack("<H6fIf", 0, *W, 0, 0.0)) + struct.pack("<H", crc16_x25(b[1:]))),
        (GSV8, b"\xaa\0\0" + struct.pack(">8f", *np.linalg.solve(np.array(MATRIX), W), 0.0, 0.0) + b"\x85"),
    ],
)
def test_documented_frames_are_read_and_written(data: dict[str, Any], golden: bytes) -> None:
    one = frame(data)
    assert one.size == len(golden)
    assert one.write(W, 7) == golden
    rows, good = one.rows(golden + golden[:-1] + bytes([golden[-1] ^ 1]))
    assert good[0]
    assert good[1] == (data in (ONROBOT, AXIA_TCP)), "footer and checksum find a flipped bit"
    np.testing.assert_allclose(one.wrench(rows)[0], W, rtol=1e-6)


def test_udp_frames_that_come_by_themselves_gaps_status_and_several_in_a_datagram() -> None:
    own = table(ONROBOT, start="", stop="").source()
    source = opened("frame", Opening("127.0.0.1", 0, frame=own, range_n=1000.0))
    assert isinstance(source, FrameLink)
    assert isinstance(source, ForceSource)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:
        for data in (
            own.frame.write(W, 1) + own.frame.write(3.0 * W, 2),
            own.frame.write(W, 5),
            own.frame.write(W, 6, status=1),
            b"x" * 35,
        ):
            sensor.sendto(data, source.address)
        assert source.drain() == 3
        np.testing.assert_allclose(source.w_sensor, 5.0 / 3.0 * W)
        assert (source.lost, source.bad, source.malformed, source.saturated) == (2, 1, 1, False)
        sensor.sendto(own.frame.write(1000.0 * W, 7), source.address)
        assert source.drain() == 1
        assert source.saturated
    source.close()


def test_a_sensor_that_is_asked_to_start_and_to_stop() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:
        sensor.bind(("127.0.0.1", 0))
        sensor.settimeout(5.0)
        link = FrameLink("127.0.0.1", int(sensor.getsockname()[1]), table(ONROBOT).source())
        data, peer = sensor.recvfrom(100)
        assert data.hex() == "1234000200000000"
        sensor.sendto(frame(ONROBOT).write(W, 1), peer)
        assert link.drain() == 1
        link.close()
        assert sensor.recvfrom(100)[0].hex() == "1234000000000000"


def test_a_stream_is_cut_by_header_and_checksum_wherever_it_begins() -> None:
    own = table(BOTA).source()
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = FrameLink("127.0.0.1", int(server.getsockname()[1]), own)
        peer = server.accept()[0]
        stream = b"\x01\xaa\x02" + b"".join(own.frame.write(k * W, 0, status=2 * (k == 4)) for k in range(1, 5))
        seen, total = 0, np.zeros(6)
        for k in range(0, len(stream), 11):  # pieces that end anywhere
            peer.sendall(stream[k : k + 11])
            assert select.select([link._socket], [], [], 5.0)[0]
            good = link.drain()
            seen, total = seen + good, total + good * link.w_sensor
        assert seen == 3
        np.testing.assert_allclose(total, 6.0 * W, rtol=1e-6)
        assert link.saturated
        peer.close()
        link.close()


def test_a_request_is_sent_in_every_cycle() -> None:
    own = table(AXIA_TCP).source()
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = FrameLink("127.0.0.1", int(server.getsockname()[1]), own)
        peer = server.accept()[0]
        peer.settimeout(5.0)
        assert link.drain() == 0
        assert peer.recv(100) == bytes(20)
        peer.close()
        link.close()
    with pytest.raises(OutputError, match="cannot be reached"):
        FrameLink("127.0.0.1", 1, own, wait_s=0.2)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"fields": ["int32 fx"] * 6}, "twice"),
        ({"fields": ["int33 fx", *ONROBOT["fields"]]}, "unknown field"),
        ({"fields": ONROBOT["fields"][:-1]}, "six components"),
        ({"fields": [f"int32 ch{k}" for k in range(1, 7)]}, "need a matrix"),
        ({"fields": ["int16 status", *ONROBOT["fields"][3:]]}, "type of the field status"),
        ({"counts_per_nm": None}, "belong together"),
        ({"counts_per_n": 0}, "counts_per_n"),
        ({"matrix": MATRIX}, "excludes"),
        ({"header": "1"}, "header"),
        ({"transport": "tcp"}, "need a header"),
        ({"crc_from": 99}, "first byte of the checksum"),
        ({"byte_order": "middle"}, "byte_order"),
        ({"scale": 1.0}, "scale"),
    ],
)
def test_bad_descriptions_are_one_line(change: dict[str, Any], said: str) -> None:
    with pytest.raises(CounterflexError, match=said) as told:
        table(ONROBOT, **change)
    assert "\n" not in str(told.value)


def test_a_singular_matrix_and_bits_without_a_status_are_refused() -> None:
    flat = [[1.0] * 6] * 6
    with pytest.raises(CounterflexError, match="singular"):
        table(GSV8, matrix=flat)
    with pytest.raises(CounterflexError, match="no field status"):
        table(ONROBOT, fields=ONROBOT["fields"][3:])
    with pytest.raises(InputError, match="belong together|needs the table"):
        opened("frame", Opening("127.0.0.1", 0))


@pytest.mark.parametrize("data", [{"protocol": "frame"}, {"frame": ONROBOT}])
def test_the_protocol_and_its_table_belong_together(data: dict[str, Any]) -> None:
    with pytest.raises(CounterflexError, match="belong together"):
        parse(SensorTable, {"segment": "sensor", **data}, where="[sensor]")
    assert parse(SensorTable, {"segment": "sensor", "protocol": "frame", "frame": ONROBOT}, where="x").frame is not None
