"""The log commands as a user types them: on a log of a loop's own cycles, on altered, cut and wrong ones."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from mcap.reader import make_reader

from counterflex import __version__
from counterflex.app.environment import environment
from counterflex.app.run.loop import online_loop
from counterflex.app.run.missing import counted
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.mcap_salvage import MAGIC, salvage
from counterflex.files.logs.run_log import LAYOUT, RunLogWriter
from counterflex.files.logs.segments import read_log, read_segment
from counterflex.files.summary_file import write_summary
from counterflex.geometry import pose, rotation
from counterflex.runtime import record_ring as record
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import COLUMNS, WIDTH
from counterflex.runtime.state.memory_layout import Arrays, Layout, layout_of, words_of
from counterflex.runtime.state.supervisor import Cause
from counterflex.runtime.state_slots import LoopState

ONLINE = '\n[online]\nforce = "measured"\nalong_feed = true\n'
CYCLES = 200


def other_way(loop: Loop) -> Arrays:
    """What a loop remembers, in another order than its own."""
    return dict(reversed(loop.memory.items()))


def cycles(loop: Loop, states: dict[int, LoopState] | None = None, *, backwards: bool = False) -> Float:
    """Records of a loop that is armed, corrects a noisy force, and holds when the force is stale.

    Into ``states`` goes what it remembers after every 50 cycles.
    """
    rng = np.random.default_rng(4)
    out = np.zeros((CYCLES, WIDTH))
    for k in range(CYCLES):
        loop.feed(
            CycleInputs(
                T_part_tcp=pose.make(rotation.about_x(np.pi), np.array([1e-4 * k, 0.0, 0.0])),
                q=np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0]),
                w_tcp_part=np.r_[0.0, 200.0, -50.0, 0.0, 0.0, 0.0] + rng.standard_normal(6),
                arm=k == 2,
                enable=k > 10,
                soft=Cause.FORCE_INVALID if 150 <= k < 160 else Cause.NONE,
            )
        )
        loop.run()
        out[k, :5] = 4 * k, 1e9 + 4e6 * k, 1e9 + 4e6 * k + 2e4 + 100 * k, 1, 28
        out[k, record.GIVEN : record.FLAGS] = loop.inputs[0]
        out[k, record.FLAGS : record.RESULTS] = loop.inputs[1]
        out[k, record.RESULTS : record.OUTCOME] = loop.answers[0]
        out[k, record.OUTCOME : record.MONITOR] = loop.answers[1]
        fast, found, events = loop.monitor.columns
        out[k, record.FAST : record.SENSOR] = fast
        out[k, record.MONITOR : record.MONITOR_OUTCOME] = found
        out[k, record.MONITOR_OUTCOME : record.CYCLE] = events
        out[k, record.CYCLE] = loop.cycle
        if states is not None and loop.cycle % 50 == 0:
            words = words_of(other_way(loop) if backwards else loop.memory)
            states[loop.cycle] = LoopState(loop.cycle, int(out[k, 1]), words)
    return out


@pytest.fixture
def logged(folder: Path) -> Float:
    """A folder with ``cell.toml`` that corrects online and ``log``, finished, of two segments."""
    with (folder / "cell.toml").open("a", encoding="utf-8") as stream:
        stream.write(ONLINE)
    loop = online_loop(read_cell(folder / "cell.toml"), None, compensated=False)
    rows = cycles(loop)
    write(folder, rows, loop)
    return rows


def write(
    folder: Path,
    rows: Float,
    loop: Loop,
    name: str = "log",
    states: dict[int, LoopState] | None = None,
    layout: Layout = (),
) -> None:
    import hashlib

    sha = {"cell": hashlib.sha256((folder / "cell.toml").read_bytes()).hexdigest()}
    about = {
        "counterflex": __version__,
        "files": {"cell": "cell.toml"},
        "sha256": sha,
        "compensated": True,
        "loop_sha256": loop.sha256(),
        "machine": environment(),
        **({LAYOUT: layout or loop.layout} if layout or not states else {}),
    }
    log = RunLogWriter(folder / name, about)
    for k in range(0, len(rows), 20):
        found = [(states or {}).get(int(row[record.CYCLE])) for row in rows[k : k + 20]]
        log.add(rows[k : k + 20], 0.2 * (k + 1), state=next((one for one in found if one is not None), None))
    log.close()


def cut(folder: Path) -> None:
    """As after ``kill -9`` some time ago: the end of the file is missing."""
    file = folder / "log" / "run-000.mcap"
    content = file.read_bytes()
    file.write_bytes(content[: int(0.6 * len(content))])
    os.utime(file, (1e9, 1e9))


def test_replay_is_the_same(folder: Path, logged: Float, counterflex: Any) -> None:
    ended = counterflex("log", "replay", "log", "--cell", "cell.toml")
    assert (ended.status, ended.err) == (0, "")
    assert ended.out == f"{CYCLES} of {CYCLES} cycles bit for bit the same\n"


def test_replay_finds_the_first_difference(folder: Path, logged: Float, counterflex: Any) -> None:
    altered = logged.copy()
    column = COLUMNS.index("correction_y")
    altered[70, column] = np.nextafter(altered[70, column], 1.0)
    altered[90, column] += 1e-6
    write(folder, altered, online_loop(read_cell(folder / "cell.toml"), None, compensated=False), "altered")
    ended = counterflex("log", "replay", "altered", "--cell", "cell.toml")
    assert ended.status == 1
    for word in ("cycle 71", "counter 280", "correction_y", repr(float(altered[70, column]))):
        assert word in ended.out
    assert repr(float(logged[70, column])) in ended.out
    found = json.loads(counterflex("log", "replay", "altered", "--cell", "cell.toml", "--json").out)
    assert (found["same"], found["compared"], found["difference"]["column"]) == (False, 70, "correction_y")


def test_replay_says_that_the_files_are_others(folder: Path, logged: Float, counterflex: Any) -> None:
    text = (folder / "cell.toml").read_text(encoding="utf-8")
    (folder / "cell.toml").write_text(text + "# another byte\n", encoding="utf-8")
    ended = counterflex("log", "replay", "log", "--cell", "cell.toml")
    assert ended.status == 0
    assert "cell file is not the one of the run" in ended.out
    assert "other numbers" not in ended.out
    (folder / "cell.toml").write_text(text.replace("along_feed = true", "along_feed = true\nproportional = 0.9"))
    ended = counterflex("log", "replay", "log", "--cell", "cell.toml", "--original")
    assert ended.status == 1
    assert "other numbers" in ended.out
    assert "ran the compensated program" in ended.out
    assert "first difference" in ended.out


def test_replay_of_a_log_with_missing_records_is_no_proof(folder: Path, logged: Float, counterflex: Any) -> None:
    loop = online_loop(read_cell(folder / "cell.toml"), None, compensated=False)
    write(folder, np.delete(logged, np.arange(50, 60), axis=0), loop, "gap")
    ended = counterflex("log", "replay", "gap", "--cell", "cell.toml")
    assert ended.status == 5
    assert "10 cycles missing after cycle 50" in ended.out
    assert f"50 of {CYCLES} cycles bit for bit the same, 10 cycles missing, {CYCLES - 60} not computed" in ended.out


@pytest.mark.parametrize(("repaired", "backwards"), [(False, False), (True, False), (False, True)])
def test_a_damaged_chunk_is_told_by_every_command_and_what_is_behind_it_is_used(
    folder: Path, logged: Float, counterflex: Any, repaired: bool, backwards: bool
) -> None:
    """Cycles 61 to 80 cannot be read: replay goes on behind the state of cycle 100, nothing else is lost.

    Logs of before do not say what the words of a state mean, later ones do, whatever their order is.
    """
    states: dict[int, LoopState] = {}
    loop = online_loop(read_cell(folder / "cell.toml"), None, compensated=False)
    rows = cycles(loop, states, backwards=backwards)
    write(folder, rows, loop, "bad", states, layout_of(other_way(loop)) if backwards else ())
    file = folder / "bad" / "run-000.mcap"
    content = bytearray(file.read_bytes())
    content[salvage(bytes(content)).chunks[3].begin + 1000] ^= 1
    file.write_bytes(content)
    if repaired:
        ended = counterflex("log", "repair", "bad")
        assert ended.status == 5
        assert f"{CYCLES - 20} records" in ended.out
        assert "20 cycles missing after cycle 60" in ended.out
        assert read_segment(file).whole
    ended = counterflex("log", "replay", "bad", "--cell", "cell.toml")
    assert ended.status == 5
    assert "began from the state recorded after cycle 100" in ended.out
    assert f"160 of {CYCLES} cycles bit for bit the same, 20 cycles missing, 20 not computed" in ended.out
    assert repaired or "cannot be read" in ended.out
    found = counterflex("log", "replay", "bad", "--cell", "cell.toml", "--json")
    assert (found.status, json.loads(found.out)["missing"], json.loads(found.out)["same"]) == (5, 20, False)
    ended = counterflex("log", "show", "bad")
    assert (ended.status, ended.err) == (5, "")
    assert "20 cycles missing after cycle 60" in ended.out
    shown = counterflex("log", "show", "bad", "--json")
    assert (shown.status, json.loads(shown.out)["missing_cycles"]) == (5, 20)
    ended = counterflex("log", "export", "bad", "--csv", "bad.csv")
    assert ended.status == 5
    assert "20 cycles missing after cycle 60" in ended.out
    np.testing.assert_array_equal(
        polars.read_csv(folder / "bad.csv").drop("run").cast(polars.Float64).to_numpy(),
        np.delete(logged, np.arange(60, 80), axis=0),
    )


def test_two_runs_in_one_folder(folder: Path, logged: Float, counterflex: Any) -> None:
    write(folder, logged[:120], online_loop(read_cell(folder / "cell.toml"), None, compensated=False))
    ended = counterflex("log", "replay", "log", "--cell", "cell.toml")
    assert ended.status == 0
    assert f"{CYCLES + 120} of {CYCLES + 120}" in ended.out
    shown = json.loads(counterflex("log", "show", "log", "--json").out)
    assert [(run["run"], run["records"], run["records_lost"]) for run in shown["runs"]] == [
        (0, CYCLES, 0),
        (1, 120, 0),
    ]


def test_runs_whose_segments_alternate(
    folder: Path, logged: Float, counterflex: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is replayed by itself, and gaps are counted by run and cycle; the second misses cycles 61 to 80."""
    loop = online_loop(read_cell(folder / "cell.toml"), None, compensated=False)
    logs = [
        RunLogWriter(folder / "two", {"compensated": True, "loop_sha256": loop.sha256(), "who": k}) for k in range(2)
    ]
    monkeypatch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 1)  # a segment of its own for every piece
    for k in range(0, CYCLES, 20):
        logs[0].add(logged[k : k + 20], 0.2 * (k + 1))
        if k != 60:
            logs[1].add(logged[k : k + 20], 0.2 * (k + 1))
    for log in logs:
        log.close()
    found = counterflex("log", "replay", "two", "--cell", "cell.toml", "--json")
    shown = json.loads(found.out)
    assert (found.status, shown["missing"], len(shown["gaps"])) == (5, 20, 1)
    assert shown["compared"] == CYCLES + 60  # nothing behind a gap without a recorded state
    assert counted(folder / "two") == (2 * CYCLES - 20, 20)


def test_show(folder: Path, logged: Float, counterflex: Any) -> None:
    ended = counterflex("log", "show", "log")
    assert (ended.status, ended.err) == (0, "")
    for word in ("active", "hold", "force invalid", "p99.9", "segments: 1"):
        assert word in ended.out
    run = json.loads(counterflex("log", "show", "log", "--json").out)["runs"][0]
    assert run["answered"] == CYCLES
    assert run["reply_us"] == {"p50": 29.9, "p99": 39.7, "p99.9": 39.9, "max": 39.9}
    assert run["causes"] == {"force_invalid": 10}
    assert sum(state["cycles"] for state in run["states"].values()) == CYCLES


def test_export_reads_back_bit_for_bit(folder: Path, logged: Float, counterflex: Any) -> None:
    assert counterflex("log", "export", "log", "--csv", "run.csv").status == 0
    table = polars.read_csv(folder / "run.csv", infer_schema_length=None)
    assert table.columns == ["run", *COLUMNS]
    np.testing.assert_array_equal(table.drop("run").cast(polars.Float64).to_numpy(), logged)


def test_a_cut_log_is_shown_repaired_and_replayed(folder: Path, logged: Float, counterflex: Any) -> None:
    cut(folder)
    shown = counterflex("log", "show", "log")
    assert "cut short: run-000.mcap" in shown.out
    before, _, _ = read_log(folder / "log")
    assert 0 < len(before) < CYCLES
    assert "run-000.mcap.cut" in counterflex("log", "repair", "log").out
    with (folder / "log" / "run-000.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == len(before)
    after, _, still = read_log(folder / "log")
    np.testing.assert_array_equal(after, before)
    assert still == []
    ended = counterflex("log", "replay", "log", "--cell", "cell.toml")
    assert ended.status == 0
    assert f"{len(before)} of {len(before)}" in ended.out
    assert "no segment is cut short or damaged" in counterflex("log", "repair", "log").out


def test_bad_input_in_one_line(folder: Path, logged: Float, refused: Any) -> None:
    for words in (("show",), ("repair",), ("export", "--csv", "x.csv")):
        assert "nowhere: no such folder" in refused("log", words[0], "nowhere", *words[1:])
        (folder / "empty").mkdir(exist_ok=True)
        assert "no run log" in refused("log", words[0], "empty", *words[1:])
    assert "nowhere.toml" in refused("log", "replay", "log", "--cell", "nowhere.toml")
    assert "replace" in refused("log", "export", "log", "--csv", "log/run-000.mcap")
    (folder / "log" / "run-000.mcap").write_bytes(b"hello world")
    assert "not an MCAP file" in refused("log", "show", "log")


def test_a_finished_log_that_was_cut_off_later_says_how_much_is_missing(
    folder: Path, logged: Float, counterflex: Any
) -> None:
    """By itself it looks like that of a killed run; what the run said at its end tells how long it was."""
    write_summary(folder / "log" / "summary.json", {"job": "run", "run": 0, "records": CYCLES - 3, "records_lost": 3})
    assert counterflex("log", "show", "log").status == 0
    last = max((folder / "log").glob("run-*.mcap"))
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 3])
    os.utime(last, (1e9, 1e9))
    kept, _, _ = read_log(folder / "log")
    left = f"{CYCLES - len(kept)} cycles missing"
    assert 0 < len(kept) < CYCLES
    for words in (("show", "log"), ("replay", "log", "--cell", "cell.toml"), ("export", "log", "--csv", "x.csv")):
        said = counterflex("log", *words)
        assert (said.status, left in said.out) == (5, True)
    repaired = counterflex("log", "repair", "log")
    assert (repaired.status, left in repaired.out) == (5, True)
    assert (counterflex("log", "show", "log").status, counted(folder / "log")) == (5, (len(kept), CYCLES - len(kept)))


@pytest.mark.parametrize("summary", ["no JSON", '{"format": "counterflex-summary"}', '{"job": "run"}'])
def test_a_summary_that_says_nothing_of_the_run_is_left_alone(
    folder: Path, logged: Float, counterflex: Any, summary: str
) -> None:
    (folder / "log" / "summary.json").write_text(summary, encoding="utf-8")
    assert counterflex("log", "show", "log").status == 0


@pytest.mark.parametrize(
    ("content", "said"), [(b"", "empty"), (b"a text\n" * 900, "not an MCAP file"), (MAGIC, "not one record")]
)
def test_what_is_no_log_says_what_to_do(folder: Path, logged: Float, refused: Any, content: bytes, said: str) -> None:
    for file in (folder / "log").glob("run-*.mcap"):
        file.write_bytes(content)
    for words in (("show", "log"), ("replay", "log", "--cell", "cell.toml"), ("repair", "log")):
        line = refused("log", *words)
        assert said in line
        assert "remove it, or move it out of this folder" in line


def test_a_footer_that_points_nowhere_is_no_end(folder: Path, logged: Float, counterflex: Any) -> None:
    """Every record is there, but another reader finds nothing: it is written anew."""
    file = min((folder / "log").glob("run-*.mcap"))
    content = bytearray(file.read_bytes())
    content[-28:-8] = b"\xff" * 20
    file.write_bytes(content)
    os.utime(file, (1e9, 1e9))
    assert f"cut short: {file.name}" in counterflex("log", "show", "log").out
    assert counterflex("log", "repair", "log").status == 0
    with file.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) > 0
