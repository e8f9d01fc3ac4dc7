"""Simulated controller, instruments and TwinCAT started from the command line, and what they say of bad input."""

from __future__ import annotations

import json
import re
import socket
import threading
from pathlib import Path
from typing import Any

import pytest

from counterflex.app import examples
from counterflex.core.errors import OutputError
from counterflex.integrations.beckhoff.simulated import AdsServer, PlcVariable
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, read_pose


@pytest.fixture
def sensor_program() -> Any:
    """Answers every telegram with a correction of 0.25 mm in x, in lockstep."""
    program = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    program.bind(("127.0.0.1", 0))
    program.settimeout(60.0)

    def answer() -> None:
        while True:
            data, where = program.recvfrom(65536)
            counter = re.search(rb"<IPOC>\d+</IPOC>", data)
            if counter is None:
                return
            correction = b'<RKorr X="0.25" Y="0" Z="0" A="0" B="0" C="0"/>'
            program.sendto(b'<Sen Type="Counterflex">' + correction + counter.group(0) + b"</Sen>", where)

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    yield f"127.0.0.1:{program.getsockname()[1]}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.sendto(b"end", program.getsockname())
    thread.join(60.0)
    program.close()


def _set(*keys: str) -> tuple[str, ...]:
    return tuple(word for key in keys for word in ("-s", key))


def _to(peer: str) -> tuple[str, ...]:
    return _set(f"controller.peer={peer}", "controller.gate_s=0")


def test_a_controller_alone_says_what_was_done_to_it(folder: Path, counterflex: Any, sensor_program: str) -> None:
    (folder / "rsi.xml").write_text(examples.text("rsi.xml"), encoding="utf-8")
    words = ("twin", "rsi", "rsi.xml", "--seconds", "0.4", *_to(sensor_program))
    ended = counterflex(*words, "--fault", "lost@0.2+0.1", "--record", "applied.csv", "--json")
    assert ended.status == 0, ended.err
    found = json.loads(ended.out)
    assert (found["ended"], found["cycles"], found["late_answers"]) == ("finished", 100, 25)
    assert found["refused"] == {"no answer": 25}
    assert found["largest_correction"]["mm"] == 0.25
    assert found["age_cycles"] == {"max": 25, "share_at_most_4": 0.79}
    lines = (folder / "applied.csv").read_text(encoding="ascii").splitlines()
    assert len(lines) == 101
    assert lines[-1].split(",")[lines[0].split(",").index("x_mm")] == "0.250000"
    told = counterflex(*words)
    assert "finished after 100 telegrams, 0 answers late" in told.out
    assert "largest correction: 0.25 mm" in told.out


def test_a_controller_alone_runs_a_program(folder: Path, counterflex: Any, sensor_program: str) -> None:
    (folder / "rsi.xml").write_text(examples.text("rsi.xml"), encoding="utf-8")
    words = ("twin", "rsi", "rsi.xml", "--program", "part.ngc", "--cell", "cell.toml")
    ended = counterflex(*words, *_to(sensor_program), "-s", "rsi.cycle_ms=12", "--record", "applied.csv", "--json")
    assert ended.status == 0, ended.err
    assert json.loads(ended.out)["ended"] == "finished"
    head, *rows = [line.split(",") for line in (folder / "applied.csv").read_text(encoding="ascii").splitlines()]
    counters = [int(row[head.index("counter_ms")]) for row in rows]
    assert counters[1] - counters[0] == 12
    assert float(rows[-1][head.index("shift_x_mm")]) == pytest.approx(0.25, abs=1e-3)


def test_instruments_alone_say_how_it_went(folder: Path, counterflex: Any) -> None:
    free = (*_set("force_sensor.address=127.0.0.1:0", "force_sensor.http_port=0"), "--seconds", "0.003")
    found = json.loads(counterflex("twin", "netft", *free, "--json").out)
    assert (found["ended"], found["samples"], found["records"]) == ("finished", 3, 0)
    (folder / "loads.csv").write_text("time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n0,0,0,0,0,0,0\n1,9,0,0,0,0,0\n")
    assert counterflex("twin", "netft", *free, "--file", "loads.csv").status == 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(20.0)
        to = f"127.0.0.1:{listener.getsockname()[1]}"
        ended = counterflex(
            "twin", "tracker", to, "-s", "target.square_side_mm=400", "--seconds", "0.004", "--fault", "beam_broken#2"
        )
        assert "finished after 4 measurements" in ended.out
        assert [read_pose(listener.recv(2048)).status for _ in range(4)] == [0, 0, BEAM_BROKEN, BEAM_BROKEN]
        (folder / "log.csv").write_text("time_s,distance_mm,azimuth_deg,zenith_deg\n0,2000,0,90\n0.001,2000,90,90\n")
        assert "2 measurements" in counterflex("twin", "tracker", to, "--log", "log.csv").out
        assert [read_pose(listener.recv(2048)).T_tracker_target[1, 3] for _ in range(2)] == pytest.approx([0.0, 2.0])
        assert "2 datagrams sent, 0 lines skipped" in counterflex("tracker", "bridge", to, "--file", "log.csv").out


@pytest.fixture
def plc() -> Any:
    """A TwinCAT on an address of its own."""
    variables = {"GVL.fFilter": PlcVariable(value=25.0), "GVL.nCount": PlcVariable("DINT", 7)}
    for last in range(2, 250):
        try:
            server = AdsServer(variables, host=f"127.31.{last}.9")
        except OutputError:
            continue
        yield server
        server.close()
        return


def test_a_twincat_is_listed_read_and_written(folder: Path, counterflex: Any, plc: AdsServer) -> None:
    table = f'\n[ads]\nnet_id = "127.31.0.9.1.1"\nhost = "{plc.address[0]}"\n[[ads.parameters]]\nname = "filter_hz"\n'
    with (folder / "cell.toml").open("a", encoding="utf-8") as file:
        file.write(table + 'symbol = "GVL.fFilter"\nunit = "Hz"\nwrite = true\nlow = 1\nhigh = 50\n')
    listed = json.loads(counterflex("ads", "list", "--cell", "cell.toml", "--json").out)
    assert [(one["name"], one["type"]) for one in listed] == [("GVL.fFilter", "LREAL"), ("GVL.nCount", "DINT")]
    assert json.loads(counterflex("ads", "read", "--cell", "cell.toml", "--json").out)["values"] == {"filter_hz": 25.0}
    assert "25.0 before, 8.0 now" in counterflex("ads", "write", "filter_hz", "8", "--cell", "cell.toml").out
    assert plc.value("GVL.fFilter") == 8.0
    refused = counterflex("ads", "write", "filter_hz", "80", "--cell", "cell.toml")
    assert refused.status == 2
    assert "'filter_hz' is out of range; got 80; expected 1 .. 50" in refused.err
    assert "has no tracker" in counterflex("ads", "forward", "127.0.0.1:9", "--cell", "cell.toml").err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("twin", "rsi", "rsi.xml", "-s", "rsi.mode=both"), "'mode' cannot be used; got 'both'; expected 'absolute'"),
        (("twin", "rsi", "rsi.xml", "-s", "rsi.cycle_ms=5"), "'cycle_ms' cannot be used; got 5; expected 4 or 12"),
        (("twin", "rsi", "rsi.xml", "--program", "part.ngc"), "a program needs the cell"),
        (("twin", "rsi", "rsi.xml", "--record", "rsi.xml"), "would replace rsi.xml"),
        (("twin", "rsi", "rsi.xml", "--fault", "lsot=1"), "Did you mean 'lost'"),
        (("twin", "rsi", "rsi.xml", "--fault", "beam_broken@1"), "a robot controller cannot show this fault"),
        (("twin", "rsi", "nowhere.xml"), "nowhere.xml: no such file"),
        (("twin", "netft", "-s", "force_sensor.wrench_n_nm=1,2"), "faults in this file); got 2 numbers"),
        (("twin", "netft", "-s", "force_sensor.status=bad"), "expected a whole number"),
        (("twin", "netft", "--fault", "nan@1"), "a force sensor cannot show this fault"),
        (("twin", "netft", "--file", "nowhere.csv"), "nowhere.csv: no such file"),
        (("twin", "tracker", "localhost"), "HOST:PORT is no address"),
        (("twin", "tracker", "127.0.0.1:9", "-s", "target.oval_mm=3"), "unknown key 'oval_mm'"),
        (("twin", "tracker", "127.0.0.1:9", "--run-log", "."), "belong together"),
        (("twin", "tracker", "127.0.0.1:9", "-s", "nowhere.toml"), "nowhere.toml: no such scenario"),
        (("tracker", "bridge", "127.0.0.1:9", "--file", "nowhere.csv"), "nowhere.csv: no such file"),
        (("twin", "ads", "--cell", "cell.toml"), "has no address of a TwinCAT"),
        (("ads", "read", "--cell", "cell.toml"), "has no address of a TwinCAT"),
    ],
)
def test_bad_input_ends_in_one_line(folder: Path, counterflex: Any, words: tuple[str, ...], said: str) -> None:
    (folder / "rsi.xml").write_text(examples.text("rsi.xml"), encoding="utf-8")
    ended = counterflex(*words)
    assert ended.status == 2
    assert said in ended.err
    assert ended.err.count("\n") == 1
