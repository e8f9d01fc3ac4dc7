"""A second run in the same folder is refused before it takes the operator's way to the first."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from counterflex.core.errors import OutputError
from counterflex.protocols.processes.control_array import CONTROL, Life
from counterflex.protocols.processes.one_run import LOCK, OneRun
from counterflex.protocols.processes.operator_words import FILE, OperatorFile, find
from counterflex.protocols.processes.shared_words import SharedWords

HOLD = """
import pathlib, sys
from counterflex.protocols.processes.one_run import OneRun
one = OneRun(pathlib.Path(sys.argv[1]))
print("held", flush=True)
input()
"""


@pytest.fixture
def words() -> Iterator[SharedWords]:
    made = SharedWords(CONTROL)
    yield made
    made.remove()
    made.close()


def test_a_folder_in_which_a_run_goes_on_is_refused_and_left_as_it_is(tmp_path: Path, words: SharedWords) -> None:
    """The second one's start took the first one's file away: its operator stop answered that no run goes on."""
    run = OneRun(tmp_path)
    file = OperatorFile(tmp_path, words.path)
    with pytest.raises(OutputError, match="another run goes on in this folder") as caught:
        OneRun(tmp_path)
    assert str(os.getpid()) in str(caught.value)
    with find(tmp_path, tmp_path) as found:
        assert found.path == words.path
    file.close()
    run.close()
    OneRun(tmp_path).close()
    assert list(tmp_path.iterdir()) == []


def test_of_two_that_start_together_one_is_refused(tmp_path: Path) -> None:
    """Before either has written anything by which an operator could find it."""
    folder = tmp_path / "new" / "log"
    run = OneRun(folder)
    for _ in range(2):
        with pytest.raises(OutputError, match="another run goes on in this folder"):
            OneRun(folder)
    run.close()
    assert list(tmp_path.iterdir()) == []  # nothing was written: nothing is left
    OneRun(folder).close()


@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be removed there")
def test_a_lock_that_is_given_back_meanwhile_is_not_taken_for_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first ends between opening and holding of the second: what the second then holds has no name any more."""
    first, opened = OneRun(tmp_path), os.open

    def slow(path: Path, *args: int) -> int:
        handle = opened(path, *args)
        monkeypatch.setattr("counterflex.protocols.processes.one_run.os.open", opened)
        first.close()
        return handle

    monkeypatch.setattr("counterflex.protocols.processes.one_run.os.open", slow)
    second = OneRun(tmp_path)
    with pytest.raises(OutputError, match="another run"):
        OneRun(tmp_path)
    second.close()


def test_what_a_killed_run_has_left_is_no_run(tmp_path: Path, words: SharedWords) -> None:
    """Its process is gone and its loop says nothing any more; one whose loop still speaks is one.

    The number of the process has been given to another one meanwhile.
    """
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == b"held"
        with pytest.raises(OutputError):
            OneRun(tmp_path)
        other.kill()
    assert (tmp_path / LOCK).exists()
    (tmp_path / FILE).write_text(json.dumps({"words": str(words.path), "pid": os.getpid()}), encoding="utf-8")
    OneRun(tmp_path).close()
    words.words[Life.LOOP_NS] = time.monotonic_ns()
    with pytest.raises(OutputError):
        OneRun(tmp_path)
    (tmp_path / FILE).write_text("rubbish", encoding="utf-8")
    OneRun(tmp_path).close()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="the run log cannot be written"):
        OneRun(tmp_path / "file" / "log")
