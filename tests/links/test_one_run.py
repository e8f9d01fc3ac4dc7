"""A second run in the same folder is refused before it takes the operator's way to the first."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from counterflex.core.errors import OutputError
from counterflex.links.control_array import CONTROL, Life
from counterflex.links.one_run import require_free
from counterflex.links.operator_words import FILE, OperatorFile, find
from counterflex.links.shared_words import SharedWords


@pytest.fixture
def words() -> Iterator[SharedWords]:
    made = SharedWords(CONTROL)
    yield made
    made.remove()
    made.close()


def _ended() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_folder_in_which_a_run_goes_on_is_refused_and_left_as_it_is(tmp_path: Path, words: SharedWords) -> None:
    """The second one's start took the first one's file away: its operator stop answered that no run goes on."""
    require_free(tmp_path)
    file = OperatorFile(tmp_path, words.path)
    with pytest.raises(OutputError, match="another run goes on in this folder"):
        require_free(tmp_path)
    with find(tmp_path, tmp_path) as found:
        assert found.path == words.path
    file.close()
    require_free(tmp_path)


def test_what_a_killed_run_has_left_is_no_run(tmp_path: Path, words: SharedWords) -> None:
    """Its process is gone and its loop says nothing any more; one whose loop still speaks is one."""
    (tmp_path / FILE).write_text(json.dumps({"words": str(words.path), "pid": _ended()}), encoding="utf-8")
    require_free(tmp_path)
    words.words[Life.LOOP_NS] = time.monotonic_ns()
    with pytest.raises(OutputError):
        require_free(tmp_path)
    (tmp_path / FILE).write_text("rubbish", encoding="utf-8")
    require_free(tmp_path)
