"""Numbers that processes share: seen by all who join, by their user only; and whether processes live."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError
from counterflex.protocols.processes.control_array import CONTROL, Course, Kept, Life, Panel, Request, Shown, Tally
from counterflex.protocols.processes.living import SILENT_S, Beat, Living
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.protocols.session import shared_status
from counterflex.runtime.record_ring import RecordRing


def test_every_place_of_the_array_is_named_once() -> None:
    places = [int(place) for group in (Request, Tally, Kept, Life, Shown, Panel, Course) for place in group]
    assert places == list(range(CONTROL))


@given(st.floats())
def test_any_number_fits_into_a_shared_word(x: float) -> None:
    """A damaged telegram that says 1e300 must not end the loop that shows it."""
    words = np.zeros(1, dtype=np.int64)
    words[0] = shared_status._shown(x)
    assert words[0] == -1 or math.isclose(words[0], max(-(2.0**62), min(2.0**62, x)), rel_tol=1e-9, abs_tol=0.5)


def test_what_one_writes_the_other_reads_also_in_another_process() -> None:
    with SharedWords(5) as mine:
        assert mine.words.tolist() == [0] * 5
        if sys.platform != "win32":
            assert stat.S_IMODE(mine.path.stat().st_mode) == 0o600
        with SharedWords(5, mine.path) as other:
            other.words[3] = -(2**62)
            assert mine.words[3] == -(2**62)
        code = (
            "import sys, pathlib; from counterflex.protocols.processes.shared_words import SharedWords;"
            " SharedWords(5, pathlib.Path(sys.argv[1])).words[1] = 7"
        )
        subprocess.run([sys.executable, "-c", code, str(mine.path)], check=True)
        assert mine.words[1] == 7
        mine.remove()
        assert not mine.path.exists()
        mine.words[0] = 1  # who has joined goes on


def test_what_is_no_shared_memory_of_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no shared memory there"):
        SharedWords(5, tmp_path / "none")
    (tmp_path / "short").write_bytes(b"12345678")
    with pytest.raises(InputError, match="not the shared memory"):
        SharedWords(5, tmp_path / "short")


def test_a_killed_process_is_seen_at_once_and_one_that_lives_is_not() -> None:
    control = np.zeros(CONTROL, dtype=np.int64)
    living = Living(control, Life.RUN_PID, Life.RECORDER_PID)
    assert not living.gone()  # nobody is known yet
    control[Life.RECORDER_PID] = os.getpid()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        control[Life.RUN_PID] = other.pid
        assert not living.gone()
        other.kill()
        other.wait()
        assert living.gone()
        control[Life.RUN_PID] = 0
        assert living.gone()
    living.close()


def test_a_process_that_waits_for_its_parent_has_died_too() -> None:
    """Killed, and nobody has looked at it yet: a signal would still reach it."""
    control = np.zeros(CONTROL, dtype=np.int64)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        control[Life.RUN_PID] = other.pid
        living = Living(control, Life.RUN_PID)
        assert not living.gone()
        other.kill()
        os.waitid(os.P_PID, other.pid, os.WEXITED | os.WNOWAIT)
        assert living.gone()
    living.close()


def test_a_beat_goes_on_until_it_is_closed() -> None:
    control = np.zeros(CONTROL, dtype=np.int64)
    beat = Beat(control, Life.RUN_NS, Life.RUN_PID)
    assert control[Life.RUN_PID] == os.getpid()
    first = control[Life.RUN_NS]
    while control[Life.RUN_NS] == first:
        pass
    beat.close()
    last = int(control[Life.RUN_NS])
    assert last > first
    assert int(control[Life.RUN_NS]) == last


def test_a_silent_process_is_gone_where_the_system_has_no_handles(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows and macOS: it is still there, or nobody has looked at it yet, but it says nothing any more."""
    monkeypatch.delattr(os, "pidfd_open", raising=False)
    control, now = np.zeros(CONTROL, dtype=np.int64), [5 * 10**9]
    living = Living(control, Life.RECORDER_PID, clock_ns=lambda: now[0])
    control[Life.RECORDER_PID] = os.getpid()
    assert not living.gone()  # it has not spoken yet
    control[Life.RECORDER_NS] = now[0]
    now[0] += round(0.99 * SILENT_S * 1e9)
    assert not living.gone()
    control[Life.RECORDER_NS] = now[0]
    now[0] += round(1.01 * SILENT_S * 1e9)
    assert living.gone()
    control[Life.RECORDER_NS] = now[0]
    assert living.gone()
    living.close()


LEAVE = """
import sys
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.runtime.record_ring import RecordRing
words = SharedWords(5)
print(words.path, flush=True)
ring = RecordRing()
print("/dev/shm/" + ring.name, flush=True)
input()
"""


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="shared memory is no file there")
def test_what_killed_processes_have_left_in_memory_is_cleared_and_what_is_held_is_not() -> None:
    """All processes of a run killed at once, with those of Python that would clear behind them."""
    options = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "start_new_session": True}
    with (
        subprocess.Popen([sys.executable, "-c", LEAVE], **options) as dead,  # type: ignore[call-overload]
        subprocess.Popen([sys.executable, "-c", LEAVE], **options) as alive,  # type: ignore[call-overload]
    ):
        left, kept = ([Path(p.stdout.readline().strip()) for _ in range(2)] for p in (dead, alive))
        assert all(path.exists() for path in (*left, *kept))
        with SharedWords(5, left[0]), contextlib.closing(RecordRing(left[1].name)):
            os.killpg(dead.pid, signal.SIGKILL)
            dead.wait()
            _start()
            assert all(path.exists() for path in (*left, *kept))  # another process of that run lives
        _start()
        assert [path.exists() for path in (*left, *kept)] == [False, False, True, True]
        alive.communicate("\n")


def _start() -> None:
    """What every run makes first."""
    with SharedWords(5) as words:
        words.remove()
    RecordRing().close()


def test_words_that_are_cleared_before_they_are_held_are_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another run starts between the making and the holding of this one's."""
    made: list[str] = []
    make = tempfile.mkstemp

    def cleared(**kwargs: Any) -> tuple[int, str]:
        handle, name = make(**kwargs)
        made.append(name)
        if len(made) == 1:
            Path(name).unlink()
        return handle, name

    monkeypatch.setattr("counterflex.protocols.processes.shared_words.tempfile.mkstemp", cleared)
    with SharedWords(5) as words:
        assert (len(made), str(words.path), words.path.exists()) == (2, made[1], True)
        words.remove()
