"""Logs of the code before records: they say no layout of their states, and replay bit for bit but for what is mended.

The two logs were written by a session of fixed seed (``tests.runtime.test_replay.recorded``) through the arrays with
index constants that the loop had then; a state stands behind every 70th cycle.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.runtime.test_replay import loop

from counterflex.core.errors import InputError
from counterflex.files.logs.segments import LogSegment, read_segment
from counterflex.runtime.record_ring import column
from counterflex.runtime.replay import Replay
from counterflex.runtime.settings import ForceMode, TrackerMode
from counterflex.runtime.state.supervisor import State

LOGS = Path(__file__).parent / "logs_before_records"
MODES = {"pilot": (ForceMode.PILOT, TrackerMode.OBSERVER), "fused": (ForceMode.FUSED, TrackerMode.NONE)}


def same_but_for_what_is_mended(name: str, replay: Replay) -> bool:
    """True where the first row that differs, if any, does so in nothing but what the loop does otherwise since.

    These are the limit of chatter, and what the observer wants: it compared with the deflection of a whole ring ago
    where its delay is no cycle.
    """
    other = replay.difference
    if other is None or (other.column == "limit_chatter" and other.columns == 1):
        return True
    return name == "pilot" and other.column.startswith("wanted_") and other.columns <= 3


def log_of(name: str) -> LogSegment:
    return read_segment(LOGS / name / "run-000.mcap")


@pytest.mark.parametrize("name", MODES)
def test_it_replays_bit_for_bit_from_its_beginning(name: str) -> None:
    log = log_of(name)
    assert State.ACTIVE in log.rows[:, column("out_state")]
    assert np.linalg.norm(log.rows[:, column("correction_x") : column("correction_z") + 1], axis=1).max() > 100e-6
    replay = Replay(loop(*MODES[name]))
    replay(log.rows, log.states)
    assert same_but_for_what_is_mended(name, replay)
    assert replay.skipped == 0


@pytest.mark.parametrize("name", MODES)
@pytest.mark.parametrize("cycle", [70, 140])
def test_it_replays_bit_for_bit_from_a_state(name: str, cycle: int) -> None:
    """The words of then are placed among the names of today, and what stood free between them is left out."""
    log = log_of(name)
    assert [state.layout for state in log.states] == [(), ()]
    replay = Replay(loop(*MODES[name]), after=cycle)
    replay(log.rows, log.states)
    assert same_but_for_what_is_mended(name, replay)
    assert replay.begun == [cycle]


def test_a_state_of_then_that_lacks_words_is_refused() -> None:
    log = log_of("pilot")
    short = [replace(state, words=state.words[:-1]) for state in log.states]
    with pytest.raises(InputError, match="another loop's"):
        Replay(loop(*MODES["pilot"]), after=70)(log.rows, short)
