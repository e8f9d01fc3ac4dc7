"""Beckhoff ADS over real loopback sockets: Beckhoff's own library against the simulated TwinCAT."""

from __future__ import annotations

import contextlib
import itertools
import queue
import random
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import CounterflexError, FileFormatError, InputError, OutputError, ProtocolError
from counterflex.files.cell.cell import read_cell
from counterflex.integrations.beckhoff import jobs as job
from counterflex.integrations.beckhoff.alone import LoneAds, run, variables
from counterflex.integrations.beckhoff.link import telegram as ads
from counterflex.integrations.beckhoff.link.link import AdsLink, AdsReader, AdsReading, AdsSettings, AdsSymbol
from counterflex.integrations.beckhoff.simulated import AdsServer, PlcVariable
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE
from counterflex.twin.devices.pose_source import CircleTarget
from counterflex.twin.network.faults import Fault, FaultSchedule

CELL = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
NET_ID = "127.0.0.9.1.1"
GAUGES = "".join(
    f"[[holder.gauges]]\nx_mm = {x}\ny_mm = {y}\nz_mm = {z}\nangle_deg = {a}\n"
    for x, y, z, a in (
        (75.0, 0.0, 40.0, 0.0),
        (-75.0, 0.0, 40.0, 0.0),
        (65.0, 30.0, 60.0, 45.0),
        (-65.0, 30.0, 60.0, -45.0),
        (75.0, 10.0, 120.0, 0.0),
        (-65.0, -30.0, 90.0, 45.0),
    )
)
HOLDER = (
    "\n[holder]\nlength_mm = 200\ncheek_distance_mm = 140\ncheek_thickness_mm = 10\ncheek_width_mm = 60\n"
    "tcp_mm = [0.0, 0.0, 400.0]\nbias_um_m = [1.0, -2.0, 3.0, 0.0, 5.0, -6.0]\n" + GAUGES
)


def table(host: str, more: str = "") -> str:
    strain = ", ".join(f'"GVL.fStrain{k}"' for k in range(1, 7))
    return (
        f'\n[ads]\nnet_id = "{NET_ID}"\nhost = "{host}"\ntimeout_ms = 2000\nperiod_ms = 1\nstrain = [{strain}]\n{more}'
        '[ads.tracker]\ndistance = "GVL.fD"\nazimuth = "GVL.fHz"\nzenith = "GVL.fV"\nqw = "GVL.q[0]"\nqx = "GVL.q[1]"\n'
        'qy = "GVL.q[2]"\nqz = "GVL.q[3]"\nbeam_ok = "GVL.bBeam"\nangle_unit = "deg"\n'
        '[[ads.parameters]]\nname = "filter_hz"\nsymbol = "MAIN.fFilter"\nunit = "Hz"\nwrite = true\n'
        "low = 1\nhigh = 50\n"
        '[[ads.parameters]]\nname = "feed"\nsymbol = "MAIN.fFeed"\nunit = "mm/min"\n'
    )


def server(symbols: dict[str, PlcVariable], faults: tuple[Fault, ...] = ()) -> AdsServer:
    """On an address of this computer's own, because Beckhoff's library knows one port only."""
    for _ in range(50):
        host = f"127.{random.randrange(1, 255)}.{random.randrange(1, 255)}.{random.randrange(2, 255)}"
        try:
            return AdsServer(symbols, host=host, faults=FaultSchedule(faults, 1))
        except OutputError:
            continue
    raise AssertionError("no free address")


def link(at: AdsServer, *symbols: AdsSymbol, timeout_s: float = 2.0) -> AdsLink:
    return AdsLink(AdsSettings(NET_ID, at.address[0], timeout_s=timeout_s), symbols)


@pytest.fixture
def plc() -> Iterator[AdsServer]:
    found = server({kind: PlcVariable(kind, 1.0) for kind in ads.TYPES} | {"GVL.f": PlcVariable(value=2.5)})
    yield found
    found.close()


def test_every_elementary_type_is_read_in_one_exchange_and_converted(plc: AdsServer) -> None:
    symbols = tuple(AdsSymbol(kind.lower(), kind, 1e-3) for kind in ads.TYPES)
    connection = link(plc, *symbols, AdsSymbol("f", "gvl.F"))
    first = connection.read()
    before = plc.requests
    assert connection.read() == first
    assert plc.requests == before + 1
    assert {first[kind.lower()] for kind in ads.TYPES} == {1e-3}
    assert first["f"] == 2.5
    assert connection.kinds["ulint"] == "ULINT"
    connection.close()


@pytest.mark.parametrize(("kind", "value"), [("LREAL", -1.25e-7), ("INT", -32768.0), ("BOOL", 1.0), ("ULINT", 2.0**60)])
def test_what_is_written_is_what_the_plc_holds(plc: AdsServer, kind: str, value: float) -> None:
    connection = link(plc, AdsSymbol("x", kind, writable=True))
    connection.write("x", value)
    assert plc.value(kind) == value
    assert connection.read()["x"] == value
    connection.close()


def test_an_answer_that_is_too_short_is_an_error_and_no_zero(plc: AdsServer, monkeypatch: pytest.MonkeyPatch) -> None:
    connection = link(plc, AdsSymbol("a", "LREAL"), AdsSymbol("b", "INT"))
    whole = plc._read_write
    monkeypatch.setattr(plc, "_read_write", lambda *given: whole(*given)[:-2])
    with pytest.raises(OutputError, match=r"the symbols cannot be read: Insufficient data \(expected 23 bytes, 21"):
        connection.read()
    connection.close()


def test_places_of_another_program_of_the_plc_are_not_read(plc: AdsServer) -> None:
    """Beckhoff, TC3 ADS: an online change moves variables; the version of the symbols changes with it."""
    connection = link(plc, AdsSymbol("a", "LREAL"))
    assert connection.read() == {"a": 1.0}
    plc.version = 2
    with pytest.raises(OutputError, match=r"program of the PLC has changed.*got version 2 of its symbols; expected 1"):
        connection.read()
    connection.close()


def test_a_device_without_versions_of_its_symbols_is_read(plc: AdsServer, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = plc._read

    def without(group: int, offset: int, length: int, frozen: bool, not_a_number: bool) -> bytes:
        return whole(0x7777 if group == ads.SYMBOL_VERSION else group, offset, length, frozen, not_a_number)

    monkeypatch.setattr(plc, "_read", without)
    connection = link(plc, AdsSymbol("a", "LREAL"))
    plc.version = 2
    assert connection.read() == {"a": 1.0}
    connection.close()


def test_what_may_not_be_written_is_not(plc: AdsServer) -> None:
    connection = link(
        plc, AdsSymbol("a", "LREAL"), AdsSymbol("b", "INT", 1.0, True), AdsSymbol("c", "REAL", 1e-3, True, 0.0, 1e-2)
    )
    for name, value, said in (
        ("a", 1.0, "may not be written"),
        ("b", 40000.0, "does not fit into INT"),
        ("c", 0.02, "'c' is out of range.*got 20.*0 .. 10"),
        ("c", float("nan"), "out of range"),
        ("d", 1.0, "no such symbol"),
    ):
        with pytest.raises(InputError, match=said):
            connection.write(name, value)
    assert plc.value("INT") == 1.0
    connection.close()


def test_the_device_says_what_it_has(plc: AdsServer) -> None:
    connection = link(plc)
    found = {one.name: one.kind for one in connection.device_symbols()}
    assert found == {kind: kind for kind in ads.TYPES} | {"GVL.f": "LREAL"}
    assert connection.read() == {}
    connection.close()


def test_a_symbol_that_is_not_there_and_a_plc_that_is_not_there(plc: AdsServer) -> None:
    with pytest.raises(OutputError, match="'GVL.nowhere' cannot be found.*ads list"):
        link(plc, AdsSymbol("x", "GVL.nowhere"))
    with pytest.raises(OutputError, match="PLC does not run on this AMS port"):
        AdsLink(AdsSettings(NET_ID, plc.address[0], port=852))
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as closed:
        closed.bind(("127.0.0.1", 0))
    with pytest.raises(OutputError, match="cannot be reached"):
        AdsLink(AdsSettings(NET_ID, "127.255.254.253", timeout_s=1.0))
    with pytest.raises(ProtocolError, match="not an AMS net id"):
        AdsLink(AdsSettings("127.0.0.1", plc.address[0]))


def test_a_lost_answer_is_an_error_in_time_and_the_next_reading_is_good() -> None:
    plc = server({"GVL.f": PlcVariable(value=2.5)}, (Fault("lost", first=5, count=1),))
    connection = link(plc, AdsSymbol("f", "GVL.f"), timeout_s=0.05)
    said: list[float | str] = []
    for _ in range(6):
        try:
            said.append(connection.read()["f"])
        except OutputError as fault:
            said.append(str(fault))
    assert [s for s in said if isinstance(s, str)] == [next(s for s in said if isinstance(s, str))]
    assert said.count(2.5) == 5
    connection.close()
    plc.close()


def test_frozen_values_and_not_a_number() -> None:
    ticks = itertools.count(1.0)
    faults = (Fault("frozen", first=10, count=3), Fault("nan", first=16, count=1))
    plc = server({"GVL.f": PlcVariable(source=lambda _: next(ticks))}, faults)
    connection = link(plc, AdsSymbol("f", "GVL.f"))
    connection.read()
    values = np.array([connection.read()["f"] for _ in range(20)])
    assert np.sum(np.isnan(values)) == 1
    assert np.sum(np.diff(values) == 0.0) in (2, 3)
    connection.close()
    plc.close()


def test_the_reader_reads_in_a_thread_of_its_own(plc: AdsServer) -> None:
    connection = link(plc, AdsSymbol("f", "GVL.f"))
    came: queue.SimpleQueue[AdsReading] = queue.SimpleQueue()
    reader = AdsReader(connection, 1e-4, take=came.put)
    reader.start()
    first, second = came.get(timeout=20.0), came.get(timeout=20.0)
    reader.end()
    assert (first.number, second.number) == (1, 2)
    assert second.time_ns > first.time_ns
    assert second.took_s > 0.0
    assert reader.newest is not None
    assert reader.newest.values == {"f": 2.5}
    plc.close()
    failing = AdsReader(connection, 1e-4)
    failing.start()
    for _ in range(2000):
        if failing.failed:
            break
        failing.join(0.01)
    failing.end()
    assert failing.failed
    assert "cannot be read" in failing.trouble
    connection.close()


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Path]:
    """A cell file whose TwinCAT runs, alone, with a force at the tool and a target on a circle."""
    ready, ending = threading.Event(), threading.Event()
    where: list[str] = []

    def started(at: AdsServer) -> None:
        where.append(at.address[0])
        ready.set()

    file = tmp_path / "cell.toml"
    probe = server({})
    host = probe.address[0]
    probe.close()
    file.write_text(CELL.read_text() + HOLDER + table(host))
    settings = LoneAds(file, np.array([120.0, -80.0, 40.0]), CircleTarget(np.eye(4), 0.5, 0.01), host=host)
    twin = threading.Thread(target=run, args=(settings,), kwargs={"started": started, "ending": ending}, daemon=True)
    twin.start()
    assert ready.wait(60.0)
    yield file
    ending.set()
    twin.join(20.0)


def test_strain_terminals_give_back_the_force(cell: Path) -> None:
    found = job.read(cell)
    assert found["force_n"] == pytest.approx([120.0, -80.0, 40.0], abs=1e-3)
    assert found["values"]["tracker_distance"] == pytest.approx(500.0, abs=1e-3)
    assert found["values"]["tracker_beam_ok"] == 1.0
    assert found["types"]["tracker_beam_ok"] == "BOOL"
    assert found["values"]["filter_hz"] == 25.5


def test_a_parameter_is_written_and_read_back(cell: Path) -> None:
    assert job.write(cell, "filter_hz", 8.0) == {"job": "ads write", "name": "filter_hz", "before": 25.5, "after": 8.0}
    assert job.read(cell)["values"]["filter_hz"] == 8.0
    with pytest.raises(InputError, match="may not be written"):
        job.write(cell, "feed", 100.0)
    with pytest.raises(InputError, match="got 51; expected 1 .. 50"):
        job.write(cell, "filter_hz", 51.0)
    assert [one.name for one in job.list_symbols(cell, "main")] == ["MAIN.fFeed", "MAIN.fFilter"]


def test_a_parameter_that_the_plc_overwrites_is_an_error(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AdsServer, "_write", lambda *_: None)
    with pytest.raises(OutputError, match=r"the TwinCAT does not keep 'filter_hz'; got [\d.]+; expected 12"):
        job.write(cell, "filter_hz", 12.0)


def test_the_tracker_of_a_twincat_reaches_the_loop_as_datagrams(cell: Path) -> None:
    receiver = TrackerLink()
    found = job.forward(cell, receiver.address, readings=5)
    assert found["sent"] == 5
    assert found["unusable"] == 0
    assert receiver.drain()
    p = receiver.T_tracker_target[:3, 3]
    assert np.linalg.norm(p) == pytest.approx(0.5, abs=1e-9)
    assert p[2] == pytest.approx(0.0, abs=1e-9)
    receiver.close()


def test_a_tracker_that_shows_nonsense_says_so() -> None:
    good = {"tracker_distance": 2.0, "tracker_azimuth": 0.0, "tracker_zenith": np.pi / 2}
    quat = {"tracker_qw": 1.0, "tracker_qx": 0.0, "tracker_qy": 0.0, "tracker_qz": 0.0}
    assert job.tracker_pose(good | quat, 1, 0).status == 0
    assert job.tracker_pose(good | quat | {"tracker_distance": np.nan}, 1, 0).status & INACCURATE
    assert job.tracker_pose(good | quat | {"tracker_distance": 0.0}, 1, 0).status & INACCURATE
    assert job.tracker_pose(good | quat | {"tracker_qw": 0.5}, 1, 0).status & INACCURATE
    assert job.tracker_pose(good | quat | {"tracker_qw": np.nan}, 1, 0).status & INACCURATE
    assert job.tracker_pose(good | {"tracker_beam_ok": 0.0}, 1, 0).status & BEAM_BROKEN


def test_strain_in_volts_per_volt_gives_the_same_force(tmp_path: Path) -> None:
    """A full bridge with gauge factor 2 shows ``(1 + nu) eps`` per volt of supply."""
    file = tmp_path / "cell.toml"
    file.write_text(CELL.read_text() + HOLDER + table("127.0.0.1", 'strain_unit = "mV/V"\n'))
    whole, force = read_cell(file), np.array([30.0, 60.0, -90.0])
    plc = variables(LoneAds(file, force), whole)
    values = {f"strain{k}": plc[f"GVL.fStrain{k}"].source(0.0) * 1e-3 for k in range(1, 7)}  # type: ignore[misc]
    assert job.holder_force(whole, values) == pytest.approx(force, abs=1e-6)
    with pytest.raises(InputError, match="shows no number"):
        job.holder_force(whole, values | {"strain3": np.nan})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (NET_ID, "127.0.0.1", "not an AMS net id"),
        (NET_ID, "127.0.0.1.1.256", "not an AMS net id"),
        ('unit = "Hz"', 'unit = "furlong"', "the unit 'furlong' is not known"),
        ('angle_unit = "deg"', 'angle_unit = "mm"', "angle_unit is no unit of rad"),
        ("low = 1\n", "low = 60\n", "low is not below high"),
        ('name = "feed"', 'name = "filter_hz"', "two parameters are named"),
        ('name = "feed"', 'name = "strain7"', "is taken"),
        ('qz = "GVL.q[3]"\n', "", "qw, qx, qy and qz belong together"),
        ("write = true", "wrte = true", "Did you mean 'write'"),
        ('"GVL.fD"', '"GVL fD"', "distance"),
    ],
)
def test_a_table_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    file = tmp_path / "cell.toml"
    text = table("127.0.0.1")
    assert old in text
    file.write_text(CELL.read_text() + HOLDER + text.replace(old, new, 1))
    with pytest.raises(FileFormatError, match=said):
        read_cell(file)


def test_a_cell_without_a_twincat_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="has no address of a TwinCAT"):
        job.read(CELL)
    file = tmp_path / "cell.toml"
    file.write_text(CELL.read_text() + HOLDER.replace(GAUGES, GAUGES[: GAUGES.rindex("[[")]) + table("127.0.0.1"))
    file.write_text(file.read_text().replace("bias_um_m = [1.0, -2.0, 3.0, 0.0, 5.0, -6.0]\n", ""))
    with pytest.raises(InputError, match="as many bridges"):
        variables(LoneAds(file), read_cell(file))


def test_frames_of_the_published_layout() -> None:
    """Byte by byte: both headers, ReadState, as Beckhoff documents them."""
    request = ads.AmsFrame((bytes([5, 1, 2, 3, 1, 1]), 851), (bytes([5, 9, 8, 7, 1, 1]), 32905), 4, 4, 0, 7, b"")
    data = request.telegram()
    assert data == bytes.fromhex(
        "0000 20000000 050102030101 5303 050908070101 8980 0400 0400 00000000 00000000 07000000"
    )
    assert ads.read_frame(data) == request
    reply = request.answered(struct.pack("<IHH", 0, 5, 0))
    assert (reply.target, reply.source, reply.flags, reply.invoke) == (request.source, request.target, 5, 7)
    entry = ads.symbol_entry("GVL.f", "LREAL", 0x4040, 16, "c")
    assert struct.unpack_from("<IIIIIIHHH", entry) == (len(entry), 0x4040, 16, 8, 5, 0, 5, 5, 1)
    assert entry[30:] == b"GVL.f\0LREAL\0c\0"


@given(st.binary(max_size=120))
def test_any_bytes_are_a_frame_or_a_clear_error(data: bytes) -> None:
    try:
        found = ads.read_frame(data).telegram()
    except ProtocolError:
        return
    assert found == data


def test_a_client_that_sends_nonsense_is_hung_up_on_and_others_are_served(plc: AdsServer) -> None:
    with socket.create_connection(plc.address, 10.0) as rude:
        rude.sendall(bytes(range(200)))
        with contextlib.suppress(ConnectionResetError):
            assert rude.recv(100) == b""
    connection = link(plc, AdsSymbol("f", "GVL.f"))
    assert connection.read()["f"] == 2.5
    connection.close()


def test_requests_that_a_plc_refuses() -> None:
    plc = server({"GVL.f": PlcVariable(value=2.5)})

    def ask(command: int, data: bytes) -> int:
        frame = ads.AmsFrame((bytes(6), 851), (bytes(6), 1), command, ads.REQUEST, 0, 1, data)
        with socket.create_connection(plc.address, 10.0) as client:
            client.sendall(frame.telegram())
            return int(struct.unpack_from("<I", client.recv(4096), ads.HEADER)[0])

    assert ask(99, b"") == ads.NOT_SUPPORTED
    assert ask(ads.READ, struct.pack("<III", 0x1234, 0, 8)) == ads.NO_GROUP
    assert ask(ads.READ, struct.pack("<III", ads.PLC_MEMORY, 80, 8)) == ads.NO_OFFSET
    assert ask(ads.READ, struct.pack("<III", ads.PLC_MEMORY, 0, 4)) == ads.WRONG_SIZE
    assert ask(ads.READ, struct.pack("<III", ads.VALUE_BY_HANDLE, 9, 8)) == ads.NO_SYMBOL
    assert ask(ads.WRITE, struct.pack("<III", ads.PLC_MEMORY, 0, 4) + bytes(4)) == ads.WRONG_SIZE
    assert ask(ads.READ_WRITE, struct.pack("<IIII", ads.HANDLE_BY_NAME, 0, 4, 2) + b"no") == ads.NO_SYMBOL
    assert ask(ads.READ, b"") == ads.WRONG_DATA
    plc.close()


def test_any_error_of_these_jobs_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(CELL.read_text() + HOLDER + table("127.255.254.253"))
    with pytest.raises(CounterflexError) as caught:
        job.read(file)
    assert "\n" not in str(caught.value)
