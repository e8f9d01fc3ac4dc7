"""What operators did: handed over whole or not at all, in order, and kept in the run log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, settings, strategies as st

from counterflex.app.run import log as job
from counterflex.files.logs.repair import repair_segment
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.protocols.processes.actions import COMMAND_LANE, PANEL_LANE, WORDS, Actions, actions_path, note_command
from counterflex.protocols.processes.shared_words import SharedWords
from counterflex.runtime.record_ring import CYCLE, WIDTH


def test_both_lanes_come_in_the_order_of_their_times(tmp_path: Path) -> None:
    made = Actions(tmp_path / "a", make=True)
    joined = Actions(tmp_path / "a")
    made.note(PANEL_LANE, {"who": "anna", "action": "stop"}, 20)
    joined.note(COMMAND_LANE, {"who": "command line", "action": "arm"}, 10)
    assert [one["action"] for one in made.take()] == ["arm", "stop"]
    assert made.take() == []
    for k in range(100):
        made.note(PANEL_LANE, {"k": k}, k)
    assert [one["k"] for one in joined.take() if "k" in one] == list(range(36, 100))
    joined.close()
    made.close()
    assert not (tmp_path / "a").exists()


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    facts=st.dictionaries(st.text(max_size=8), st.text(max_size=300) | st.integers(-5, 5) | st.booleans(), max_size=6),
    place=st.integers(0, WORDS - 1),
    value=st.integers(-(2**63), 2**63 - 1),
)
def test_any_text_is_taken_as_it_is_or_cut_and_a_damaged_one_is_not(
    tmp_path: Path, facts: dict[str, object], place: int, value: int
) -> None:
    made = Actions(tmp_path / "b", make=True)
    try:
        made.note(PANEL_LANE, facts, 1)
        (one,) = made.take()
        whole = {"time_ns": 1, **facts} if "time_ns" not in facts else {**facts}
        assert one == whole or "text" in one or any(len(str(v)) > 40 for v in facts.values())
        again = Actions(tmp_path / "b")
        before = made._words[place]
        made._words[place] = value
        taken = again.take()
        made._words[place] = before
        assert all(entry.get("time_ns") is not None for entry in taken)
        again.close()
    finally:
        made.close()


def test_a_run_of_before_takes_no_note(tmp_path: Path) -> None:
    with SharedWords(8) as words:
        note_command(words.path, "stop", {"done": True, "refused": "", "state": "hold"})
        made = Actions(actions_path(words.path), make=True)
        note_command(words.path, "stop", {"done": False, "refused": "why", "state": "hold"})
        (one,) = made.take()
        assert (one["who"], one["action"], one["done"], one["refused"]) == ("command line", "stop", False, "why")
        made.close()
        words.remove()


def rows(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    out = np.zeros((count, WIDTH))
    out[:, CYCLE] = np.arange(1, count + 1)
    out[:, 1] = 1e9 + 4e6 * np.arange(count)
    out[:, 3] = 1
    return out


def test_the_run_log_keeps_them_and_repair_too(tmp_path: Path) -> None:
    log = RunLogWriter(tmp_path, {})
    log.add(rows(10))
    log.note({"time_ns": 1_500_000_000, "who": "anna", "from": "127.0.0.1", "action": "stop", "done": True})
    log.close()
    (run,) = job.show(tmp_path)["runs"]
    assert run["operator_actions"] == [
        {"time_s": 0.5, "who": "anna", "from": "127.0.0.1", "action": "stop", "done": True}
    ]
    file = tmp_path / "run-000.mcap"
    file.write_bytes(file.read_bytes()[:-300])
    assert repair_segment(file, now_s=1e12) is not None
    assert job.show(tmp_path)["runs"][0]["operator_actions"] == run["operator_actions"]
