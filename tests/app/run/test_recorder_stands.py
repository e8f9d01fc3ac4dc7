"""A recorder that stands still at the end of a run is not waited for without end; what is missing is said."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from counterflex.app.run import run as online
from counterflex.app.run.end import End, ended_how
from counterflex.app.run.run import Supervised
from counterflex.files.logs.segments import read_log
from counterflex.protocols.processes.control_array import Kept, Life, Shown
from counterflex.runtime.record_ring import CYCLE, column
from counterflex.runtime.state.supervisor import State

ROWS, TAKEN = 40, 25


class Standing:
    """A process that says nothing; a kill ends it unless a disk holds it."""

    pid = 1

    def __init__(self, *, mortal: bool) -> None:
        self._mortal, self._lives = mortal, True
        self.exitcode = 0

    def is_alive(self) -> bool:
        return self._lives

    def kill(self) -> None:
        self._lives = not self._mortal

    def join(self, _: float) -> None:
        pass


@pytest.fixture
def supervised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Supervised]:
    monkeypatch.setattr(online, "END_S", 0.05)
    monkeypatch.setattr(online, "RECORDER_END_S", 0.2)
    made = Supervised(cast(Any, None), tmp_path / "log")
    made.loop = cast(Any, Standing(mortal=True))
    made.control[Life.ENDED] = 1
    made.control[Kept.TAKEN], made.control[Shown.CYCLES] = TAKEN, ROWS
    for k in range(ROWS):
        row = made._ring.row()
        row[:] = 0.0
        row[1] = 4e6 * k
        row[column("out_state")], row[CYCLE] = State.IDLE, k + 1
        made._ring.commit()
    yield made
    made.close()


def test_one_that_can_be_ended_is_and_the_rest_is_written(supervised: Supervised, tmp_path: Path) -> None:
    supervised.recorder = cast(Any, Standing(mortal=True))
    found = supervised.summary()
    rows, _, cut = read_log(tmp_path / "log")
    np.testing.assert_array_equal(rows[:, CYCLE], np.arange(TAKEN + 1, ROWS + 1))
    assert cut == []
    assert not supervised.recorder.is_alive()
    ended = ended_how(found, arm=False)
    assert (ended["status"], ended["wrong"]) == (End.LOG_LOST, True)
    assert ended["said"].startswith("the log is not whole (the recorder stood still")


@pytest.mark.parametrize("mortal", [False, True])
def test_where_the_disk_stands_still_too_what_is_missing_is_counted(
    supervised: Supervised, monkeypatch: pytest.MonkeyPatch, mortal: bool
) -> None:
    """The recorder cannot be ended, or the log cannot be gone on with."""
    supervised.recorder = cast(Any, Standing(mortal=mortal))
    supervised.control[Life.RECORDER_NS] = 2**62  # it says that it lives to the end
    waiting = threading.Event()
    monkeypatch.setattr(Supervised, "_inherited", lambda _: waiting.wait() and {})
    found = supervised.summary()
    waiting.set()
    assert (found["records_lost"], found["records"], found["cycles"]) == (ROWS - TAKEN, TAKEN, ROWS)
    assert supervised.disk_stands
    ended = ended_how(found, arm=False)
    assert ended["status"] == End.LOG_LOST
    assert ended["said"].startswith(
        f"{ROWS - TAKEN} records are missing in the log (neither the recorder nor the disk responds"
    )
