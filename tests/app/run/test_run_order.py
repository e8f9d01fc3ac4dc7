"""Order in which the processes of a run begin: the robot may send as soon as the loop is there."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from counterflex.app.run import run as online
from counterflex.protocols.processes.control_array import CONTROL, Life, Request
from counterflex.protocols.system import system_calls


def test_recorder_and_permission_to_arm_do_not_wait_for_the_beat_without_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program that begins before the loop may be armed is never corrected."""
    control = np.zeros(CONTROL, dtype=np.int64)
    told: list[object] = []
    seen: list[tuple[int, bool]] = []
    words = iter([(("127.0.0.1", 49152), "hash", (), ["feed"], ["tooth"], "former"), 1])
    for name, stand_in in {
        "OneRun": lambda _: None,
        "Beat": lambda *_: SimpleNamespace(unlock=lambda _: None),
        "OperatorFile": lambda *_: None,
        "StatusReader": lambda *_: None,
        "first_word": lambda *_: next(words),
        "_about": lambda *_: {},
    }.items():
        monkeypatch.setattr(online, name, stand_in)

    def beat() -> Any:
        seen.append((int(control[Request.ARM]), bool(told)))
        return None

    monkeypatch.setattr(system_calls, "unlocked_beat", beat)
    process = SimpleNamespace(start=lambda: None)
    run: Any = SimpleNamespace(
        _out=tmp_path,
        _settings=SimpleNamespace(arm=True),
        _words=SimpleNamespace(path=tmp_path),
        _ring=SimpleNamespace(name=""),
        _pipes=[],
        _up=[],
        _loop_pipe=None,
        _recorder_pipe=SimpleNamespace(send=told.append),
        loop=process,
        recorder=process,
        control=control,
    )
    _, lines = online.Supervised.begin(cast("online.Supervised", run))
    assert seen == []
    online.Supervised._permit(cast("online.Supervised", run))
    assert lines[:2] == ["feed", "tooth"]
    assert len(lines) == 3
    assert "its log: former" in lines[2]
    assert run._about["not_looked_at"] == ["tooth"]  # and so in the log
    assert run._about["not_closed"] == "former"
    assert seen == [(1, True)]
    assert control[Life.MAY_ARM] == 1
