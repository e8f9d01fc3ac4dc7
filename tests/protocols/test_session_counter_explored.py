"""The counter of a session explored: every state within reach of counters at and around its limits."""

from __future__ import annotations

import copy
import functools
from typing import Final

from counterflex.protocols.robot.port import Verdict
from counterflex.protocols.robot.session_counter import SessionCounter

CYCLE_MS: Final = 4
SESSION_MS: Final = 1000
"""How far ahead a counter may jump within one session, by the page of the protocol."""
BEGIN: Final = 10**9
STEPS: Final = (-(10**8), -1008, -1004, -1000, -996, -44, -36, -32, -28, -4, 0, 4, 8, 40, 44, 996, 1000, 1004, 10**8)
"""Counters by the newest one, ms."""
FOLLOWING: Final = (4, 40)
"""Counters by the last one that was not believed, ms, that follow it."""
APART: Final = (-4, 0, 44)
"""Likewise, that do not."""
NEAR_RUN, FAR_RUN = 8, 3
Key = tuple[int, int, bool]


def key(line: SessionCounter) -> Key:
    """What decides about the next telegram, wherever the counter stands."""
    return (line._other - line.newest if line._run else 0, line._run, line._another)


def next_counters(line: SessionCounter, behind: tuple[int, ...] = FOLLOWING + APART) -> set[int]:
    inside = {line.newest + step for step in STEPS}
    return inside | {line._other + step for step in behind if line._run}


@functools.cache
def reached() -> tuple[SessionCounter, ...]:
    """One line for each state that can be reached, by telegrams and by going on to the newest."""
    line = SessionCounter(CYCLE_MS)
    line.judge(BEGIN)
    line.advance()
    found, frontier = {key(line): line}, [line]
    while frontier:
        line = frontier.pop()
        for counter in (None, *sorted(next_counters(line, FOLLOWING))):
            after = copy.copy(line)
            if counter is None:
                after.advance()
            else:
                after.judge(counter)
            if key(after) not in found:
                found[key(after)] = after
                frontier.append(after)
    return tuple(found.values())


def test_the_states_are_few_and_all_runs_are_met() -> None:
    lines = reached()
    assert {line._run for line in lines} == set(range(NEAR_RUN))
    assert {line._another for line in lines} == {False, True}
    assert len(lines) > 300


def test_every_telegram_in_every_state_is_judged_by_the_rules() -> None:
    for line in reached():
        for counter in next_counters(line):
            after = copy.copy(line)
            step, verdict = counter - line.newest, after.judge(counter)
            assert (after.newest == counter) == (verdict == Verdict.NEW or step == 0)
            assert after.newest == (counter if verdict == Verdict.NEW else line.newest)
            if 0 < step <= SESSION_MS:
                assert verdict == Verdict.NEW
                assert after._another == line._another
            elif verdict == Verdict.NEW:  # another session is said, and only after a run of telegrams
                assert after._another
                assert line._run >= (NEAR_RUN if -SESSION_MS < step <= 0 else FAR_RUN) - 1
                assert 0 < counter - line._other <= 10 * CYCLE_MS
            else:
                assert verdict == (Verdict.OLD if -SESSION_MS < step <= 0 else Verdict.ASTRAY)
                assert after._another == line._another


def test_no_session_is_passed_over_for_ever() -> None:
    """From every state, wherever it begins: at the 8th telegram, the 3rd where it is far, or as it catches up."""
    for line in reached():
        for step in STEPS:
            after, first = copy.copy(line), line.newest + step
            verdicts = [after.judge(first + CYCLE_MS * k) for k in range(NEAR_RUN + 2)]
            believed = verdicts.index(Verdict.NEW)
            assert believed < NEAR_RUN + 2
            if not -SESSION_MS - 8 * CYCLE_MS < step <= SESSION_MS:
                assert believed < FAR_RUN
            elapsed, _ = after.advance()
            assert elapsed >= 1


def test_a_single_damaged_counter_never_makes_another_session() -> None:
    for line in reached():
        if line._another or line._run:
            continue
        for step in STEPS:
            if 0 < step <= SESSION_MS:
                continue
            after = copy.copy(line)
            assert after.judge(line.newest + step) != Verdict.NEW
            assert after.judge(line.newest + CYCLE_MS) == Verdict.NEW
            after.advance()
            assert not after._another


def test_cycles_are_counted_from_the_last_telegram_that_was_taken() -> None:
    for line in reached():
        for step in (4, 8, 40, 1000):
            after = copy.copy(line)
            after.advance()
            after.judge(after.newest + step)
            assert after.advance() == (step // CYCLE_MS, False)
        after = copy.copy(line)
        if line._another:
            assert after.advance() == (1, True)
        assert after.advance()[1] is False
