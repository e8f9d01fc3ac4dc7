"""A process of a run says that it lives while it imports, which takes a minute on a busy computer."""

from __future__ import annotations

import pickle
import threading
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.run import child as room
from counterflex.protocols.processes.control_array import CONTROL, Life
from counterflex.protocols.processes.shared_words import SharedWords

_MOST_S = 60.0
_SAID: list[int] = []


class Import:
    """An argument whose reading takes until the process has said twice that it lives, as one whose imports are slow."""

    def __init__(self, words: Path, lives: int) -> None:
        self._of = words, lives

    def __reduce__(self) -> Any:
        return slow_import, self._of


def slow_import(words: Path, lives: int) -> int:
    shared, pause, seen = SharedWords(CONTROL, words), threading.Event(), set[int]()
    for _ in range(round(_MOST_S / 0.01)):
        seen.add(int(shared.words[lives]))
        if len(seen - {0}) > 1:
            break
        pause.wait(0.01)
    return len(seen - {0})


def target(times: int, pipe: Any) -> None:
    _SAID.append(times)


@pytest.mark.parametrize("lives", [Life.LOOP_NS, Life.RECORDER_NS])
def test_a_process_lives_while_it_imports(lives: Life, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_LIVE_S", 0.001)
    monkeypatch.setattr(room, "_count_compilations", lambda _: None)
    shared = SharedWords(CONTROL)
    _SAID.clear()
    try:
        room.child(pickle.dumps((target, (Import(shared.path, int(lives)),))), shared.path, int(lives), None)
        assert _SAID == [2]
        for thread in threading.enumerate():
            if thread.name == "imports":
                thread.join(5.0)
                assert not thread.is_alive()
    finally:
        shared.remove()
