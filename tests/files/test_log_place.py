"""A log whose folder or file is removed, moved or replaced while it is written is lost, and said to be."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from counterflex.files.logs.place import GONE, LOOKED_S, trouble_message
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.logs.segments import read_log
from counterflex.runtime.record_ring import WIDTH


def _removed(log: Path) -> None:
    shutil.rmtree(log)


def _file_removed(log: Path) -> None:
    (log / "run-000.mcap").unlink()


def _moved(log: Path) -> None:
    log.rename(log.with_name("elsewhere"))


def _replaced(log: Path) -> None:
    _moved(log)
    log.mkdir()


@pytest.mark.parametrize("happens", [_removed, _file_removed, _moved, _replaced])
def test_it_is_noticed_within_a_second_and_counted(tmp_path: Path, happens: Callable[[Path], None]) -> None:
    log = RunLogWriter(tmp_path / "log", {})
    rows = np.zeros((10, WIDTH))
    now = 100.0
    for _ in range(5):
        log.add(rows, now)
        now += 0.1
    assert (log.written, log.lost, log.trouble_number) == (50, 0, 0)
    happens(tmp_path / "log")
    begin = now
    while not log.trouble:
        log.add(rows[:0], now)  # also where nothing comes
        now += 0.02
        assert now - begin < 1.0
    assert (log.written, log.lost, log.trouble_number) == (0, 50, GONE)
    assert "removed, moved or replaced" in log.trouble == trouble_message(GONE)
    log.close()


def test_a_folder_that_is_there_again_is_written_to_and_what_was_lost_stays_counted(tmp_path: Path) -> None:
    log = RunLogWriter(tmp_path / "log", {})
    rows = np.zeros((10, WIDTH))
    log.add(rows, 100.0)
    shutil.rmtree(tmp_path / "log")
    log.add(rows, 101.0)
    log.add(rows, 103.0)
    assert log.trouble
    (tmp_path / "log").mkdir()
    log.add(rows, 105.0)
    log.close()
    assert log.trouble == ""
    assert (log.written, log.lost) == (10, 30)
    assert len(read_log(tmp_path / "log")[0]) == 10


def _segments(folder: Path, monkeypatch: pytest.MonkeyPatch, *, refused: bool) -> RunLogWriter:
    """A log with 10 records in each of two segments before the present one, which holds 10 too."""
    log = RunLogWriter(folder, {})
    rows = np.zeros((10, WIDTH))
    for k in range(2):
        with monkeypatch.context() as patch:
            if not refused:
                patch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 1)
            log.add(rows, 100.0 + 10 * k)
            if refused:
                patch.setattr("counterflex.files.logs.run_log.os.fsync", _full)
                log.add(rows[:0], 105.0 + 10 * k)
    log.add(rows, 120.0)
    assert (log.written, log.lost, log.trouble) == (30, 0, "")
    return log


def _full(_: int) -> NoReturn:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("refused", [False, True], ids=["finished", "ended by a full disk"])
@pytest.mark.parametrize("names", [["run-000.mcap"], ["run-000.mcap", "run-001.mcap"]])
def test_earlier_segments_that_are_removed_are_noticed_while_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list[str], refused: bool
) -> None:
    log = _segments(tmp_path, monkeypatch, refused=refused)
    for name in names:
        (tmp_path / name).unlink()
    for _ in range(3):  # counted once
        log.add(np.zeros((0, WIDTH)), 120.0 + LOOKED_S)
    assert (log.written, log.lost) == (30 - 10 * len(names), 10 * len(names))
    log.add(np.zeros((10, WIDTH)), 122.0)
    log.close()
    assert (log.written, log.lost) == (40 - 10 * len(names), 10 * len(names))
    assert len(read_log(tmp_path)[0]) == log.written


def test_an_earlier_segment_that_is_removed_just_before_the_end_is_noticed_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = _segments(tmp_path, monkeypatch, refused=False)
    (tmp_path / "run-001.mcap").unlink()
    log.close()
    assert (log.written, log.lost) == (20, 10)


def test_a_folder_that_is_removed_takes_all_segments_with_it_and_each_record_is_counted_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = _segments(tmp_path / "log", monkeypatch, refused=False)
    shutil.rmtree(tmp_path / "log")
    monkeypatch.setattr("counterflex.files.logs.run_log.SEGMENT_BYTES", 1)
    log.add(np.zeros((10, WIDTH)), 120.1)  # the segment is full before the next look
    log.close()
    assert (log.written, log.lost, bool(log.trouble)) == (0, 40, True)


def test_one_that_is_removed_just_before_the_end_is_noticed_too(tmp_path: Path) -> None:
    log = RunLogWriter(tmp_path / "log", {})
    log.add(np.zeros((10, WIDTH)), 100.0)
    shutil.rmtree(tmp_path / "log")
    log.close()
    assert (log.written, log.lost, log.trouble_number) == (0, 10, GONE)
