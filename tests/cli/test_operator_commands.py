"""The operator's commands: what came of a request in one line, and a status that a script can use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

SAID = {
    "done": True,
    "refused": "",
    "state": "ramp_out",
    "cause": "operator",
    "feed_hold": True,
    "correction_mm": 0.4213,
    "robot_heard": True,
    "age_ms": {"robot": 3.2, "force": 2.1, "tracker": None},
    "place": 0.4271,
    "force_n": 352.4,
    "planned_n": 346.0,
    "foreign": 12,
    "log_trouble": "",
    "records_lost": 0,
}
SEEN = """place: 42.7 % of the plan
force: 352 N measured, 346 N planned
age: robot 3 ms, force 2 ms, tracker nothing yet
foreign telegrams dropped: 12
records lost: 0
"""


@pytest.mark.parametrize("action", ["status", "stop", "reset", "arm"])
def test_what_came_of_it_is_one_line(
    tmp_path: Path, counterflex: Any, monkeypatch: pytest.MonkeyPatch, action: str
) -> None:
    asked: list[tuple[Path, str]] = []

    def request(folder: Path, what: str) -> dict[str, Any]:
        asked.append((folder, what))
        return SAID

    monkeypatch.setattr("counterflex.app.run.operator_requests.request", request)
    ended = counterflex("operator", action, str(tmp_path))
    assert (ended.status, ended.err) == (0, "")
    assert ended.out == "ramp out (operator), correction 0.421 mm, feed held\n" + (SEEN if action == "status" else "")
    assert asked == [(tmp_path, action)]
    assert json.loads(counterflex("operator", action, str(tmp_path), "--json").out) == SAID


def test_what_is_refused_says_why_and_is_status_1(
    tmp_path: Path, counterflex: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = {**SAID, "done": False, "refused": "a correction is in force", "state": "fault"}
    monkeypatch.setattr("counterflex.app.run.operator_requests.request", lambda *_: refused)
    ended = counterflex("operator", "reset", str(tmp_path))
    assert ended.status == 1
    assert "reset refused: a correction is in force" in ended.err


def test_without_a_run_there_is_one_clear_line(tmp_path: Path, counterflex: Any) -> None:
    ended = counterflex("operator", "stop", str(tmp_path))
    assert ended.status == 2
    assert ended.err.startswith("error: ")
    assert "no run goes on there" in ended.err
    assert ended.err.count("\n") == 1
