"""A log whose folder or file is removed, moved or replaced while it is written is lost, and said to be."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from counterflex.files.log_place import GONE, trouble_said
from counterflex.files.run_log import RunLog, read_log
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
    log = RunLog(tmp_path / "log", {})
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
    assert "removed, moved or replaced" in log.trouble == trouble_said(GONE)
    log.close()


def test_a_folder_that_is_there_again_is_written_to_and_what_was_lost_stays_counted(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "log", {})
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


def test_one_that_is_removed_just_before_the_end_is_noticed_too(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "log", {})
    log.add(np.zeros((10, WIDTH)), 100.0)
    shutil.rmtree(tmp_path / "log")
    log.close()
    assert (log.written, log.lost, log.trouble_number) == (0, 10, GONE)
