"""Repair of a run log: cut anywhere, a reader that is not ours takes what is written anew; the original stays."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from mcap.reader import make_reader

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.files.logs.repair import repair_segment
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segments import read_log, read_segment, segments
from counterflex.runtime.record_ring import WIDTH

LATER = 4e9


def rows(n: int) -> Float:
    out = np.random.default_rng(n).standard_normal((n, WIDTH))
    out[:, 1] = np.arange(n) * 4_000_000
    return out


def unfinished(folder: Path, data: Float) -> Path:
    log = RunLogWriter(folder, {"seed": 3})
    for k in range(0, len(data), 25):
        log.add(data[k : k + 25], 0.1 * (k + 1))
    file = folder / "run-000.mcap"
    whole = file.read_bytes()
    log.close()
    file.write_bytes(whole)
    return file


def by_another_reader(file: Path) -> Float:
    with file.open("rb") as stream:
        messages = [message.data for _, _, message in make_reader(stream, validate_crcs=True).iter_messages()]
    return np.array([np.frombuffer(data, dtype="<f8") for data in messages]).reshape(-1, WIDTH)


@dataclass(frozen=True, repr=False, eq=False)
class Written:
    """Records and the file that was made of them but not finished."""

    rows: Float
    content: bytes


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    data = rows(200)
    return Written(data, unfinished(tmp_path_factory.mktemp("log"), data).read_bytes())


def test_an_unfinished_segment_is_saved_whole(tmp_path: Path) -> None:
    data = rows(100)
    file = unfinished(tmp_path, data)
    before = file.read_bytes()
    with pytest.raises(Exception, match=r".*"):
        by_another_reader(file)
    done = repair_segment(file, LATER)
    assert done is not None
    assert (done.records, done.kept, done.note) == (100, "run-000.mcap.cut", "")
    np.testing.assert_array_equal(by_another_reader(file), data)
    found, about, still = read_log(tmp_path)
    np.testing.assert_array_equal(found, data)
    assert (about["seed"], about["repaired"]["original"], still) == (3, "run-000.mcap.cut", [])
    assert (tmp_path / "run-000.mcap.cut").read_bytes() == before
    assert repair_segment(file, LATER) is None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run-000.mcap", "run-000.mcap.cut"]


@pytest.mark.long
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.0, 1.0), st.none() | st.floats(0.0, 1.0, exclude_max=True), st.integers(0, 7))
def test_cut_or_damaged_anywhere(written: Written, tmp_path: Path, share: float, place: float | None, bit: int) -> None:
    """Another reader finds as many records as ours did before, and each is one that was written."""
    damaged = bytearray(written.content[: int(share * len(written.content))])
    if damaged and place is not None:
        damaged[int(place * len(damaged))] ^= 1 << bit
    file = tmp_path / "run-000.mcap"
    for old in tmp_path.iterdir():
        old.unlink()
    file.write_bytes(damaged)
    try:
        expected = read_segment(file).rows
        done = repair_segment(file, LATER)
    except FileFormatError:
        try:
            left = repair_segment(file, LATER)
        except FileFormatError:
            left = None
        assert left is None or left.note
        assert file.read_bytes() == bytes(damaged)
        return
    assert done is not None
    found = by_another_reader(file)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(found, written.rows[np.rint(found[:, 1] / 4e6).astype(int)])
    assert np.all(np.diff(found[:, 1]) > 0)
    assert (tmp_path / done.kept).read_bytes() == bytes(damaged)


def test_a_segment_that_a_living_process_holds_is_left_alone_and_a_dead_one_s_is_repaired_at_once(
    tmp_path: Path,
) -> None:
    """A log whose robot is silent, or whose disk stands still, is not written to for minutes; clocks may be wrong."""
    log = RunLogWriter(tmp_path, {"seed": 3})
    log.add(rows(50), 1.0)
    file = tmp_path / "run-000.mcap"
    before = file.read_bytes()
    for age in (0.0, 600.0, -600.0):
        with pytest.raises(InputError, match="a living process writes to it"):
            repair_segment(file, file.stat().st_mtime + age)
    assert file.read_bytes() == before
    log.close()
    file.write_bytes(before)  # as after kill -9
    done = repair_segment(file)
    assert done is not None
    assert done.records == 50


def test_a_killed_process_holds_nothing_any_more(tmp_path: Path) -> None:
    code = (
        "import sys, numpy as np; from counterflex.files.logs.run_log import RunLogWriter;"
        " from counterflex.runtime.record_ring import WIDTH;"
        " log = RunLogWriter(sys.argv[1], {}); log.add(np.zeros((5, WIDTH)), 1.0);"
        " print('written', flush=True); input()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == b"written"
        with pytest.raises(InputError, match="being written"):
            repair_segment(tmp_path / "run-000.mcap", LATER)
        other.kill()
    done = repair_segment(tmp_path / "run-000.mcap")
    assert done is not None
    assert done.records == 5


def test_where_no_lock_tells_the_time_of_the_file_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another computer has written it, perhaps to a folder that both see: its locks need not be known here."""
    file = unfinished(tmp_path, rows(50))
    before = file.read_bytes()
    monkeypatch.setattr("counterflex.files.logs.repair.boot_id", lambda: "another")
    os.utime(file, (1000.0, 1000.0))
    for age, told in ((4.0, "4.0"), (0.0, "0.0"), (-4.0, "0.0")):
        with pytest.raises(InputError, match=f"being written; got changed {told} s ago"):
            repair_segment(file, 1000.0 + age)
    assert file.read_bytes() == before
    assert repair_segment(file, 1006.0) is not None


def test_a_file_stamped_in_the_future_is_not_being_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a computer whose clock is ahead, or before the clock here was set back: it stays no longer than any other."""
    file = unfinished(tmp_path, rows(50))
    monkeypatch.setattr("counterflex.files.logs.repair.boot_id", lambda: "another")
    os.utime(file, (5000.0, 5000.0))
    done = repair_segment(file, 1000.0)
    assert done is not None
    assert done.records == 50


def test_an_older_original_is_never_replaced(tmp_path: Path) -> None:
    file = unfinished(tmp_path, rows(50))
    (tmp_path / "run-000.mcap.cut").write_bytes(b"older")
    done = repair_segment(file, LATER)
    assert done is not None
    assert done.kept == "run-000.mcap.cut-2"
    assert (tmp_path / "run-000.mcap.cut").read_bytes() == b"older"


def test_a_full_disk_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = unfinished(tmp_path, rows(50))
    before = file.read_bytes()

    def full(_: int) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("counterflex.files.logs.repair.os.fsync", full)
    with pytest.raises(OutputError, match="space"):
        repair_segment(file, LATER)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"run-000.mcap": before}


def test_an_empty_segment_does_not_hide_the_others(tmp_path: Path) -> None:
    """After power loss the newest file can be empty; a new run goes on in the same folder."""
    data = rows(50)
    unfinished(tmp_path, data)
    (tmp_path / "run-001.mcap").write_bytes(b"")
    log = RunLogWriter(tmp_path, {})
    log.add(data, 1.0)
    log.close()
    found = list(segments(tmp_path))
    assert [(s.name, len(s.rows), s.whole) for s in found] == [
        ("run-000.mcap", 50, False),
        ("run-001.mcap", 0, False),
        ("run-002.mcap", 50, True),
    ]
    assert (found[0].run, found[2].run) == (0, 2)
    left = repair_segment(tmp_path / "run-001.mcap", LATER)
    assert left is not None
    assert "nothing to save" in left.note
    assert read_log(tmp_path)[2] == ["run-000.mcap", "run-001.mcap"]
