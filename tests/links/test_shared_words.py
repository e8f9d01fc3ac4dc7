"""Numbers that processes share: seen by all who join, by their user only; and whether processes live."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.links.control_array import CONTROL, Kept, Life, Request, Shown, Tally
from counterflex.links.living import Beat, Living
from counterflex.links.shared_words import SharedWords


def test_every_place_of_the_array_is_named_once() -> None:
    places = [int(place) for group in (Request, Tally, Kept, Life, Shown) for place in group]
    assert places == list(range(CONTROL))


def test_what_one_writes_the_other_reads_also_in_another_process() -> None:
    with SharedWords(5) as mine:
        assert mine.words.tolist() == [0] * 5
        if sys.platform != "win32":
            assert stat.S_IMODE(mine.path.stat().st_mode) == 0o600
        with SharedWords(5, mine.path) as other:
            other.words[3] = -(2**62)
            assert mine.words[3] == -(2**62)
        code = (
            "import sys, pathlib; from counterflex.links.shared_words import SharedWords;"
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
