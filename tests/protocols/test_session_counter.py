"""R7 and R9: telegrams of one session, repeated and overtaken ones, and those of another session."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from counterflex.protocols.robot.port import Verdict
from counterflex.protocols.robot.session_counter import SessionCounter

START = 4_208_163_000


def running(cycles: int = 50) -> SessionCounter:
    line = SessionCounter(4)
    for k in range(cycles):
        assert line.judge(START + 4 * k) == Verdict.NEW
        assert line.advance() == (1, False)
    return line


def test_the_newest_wins() -> None:
    """Numbers 2, 1, 4, 2, 3 in one drain: 4 is answered."""
    line = SessionCounter(4)
    verdicts = [line.judge(START + 4 * k) for k in (2, 1, 4, 2, 3)]
    assert verdicts == [Verdict.NEW, Verdict.OLD, Verdict.NEW, Verdict.OLD, Verdict.OLD]
    assert line.newest == START + 16


@given(st.integers(1, 250))
def test_elapsed_cycles_are_those_of_the_counter(n: int) -> None:
    """R8."""
    line = running()
    assert line.judge(line.newest + 4 * n) == Verdict.NEW
    assert line.advance() == (n, False)


@pytest.mark.parametrize("back", [-(10**9), -60_000, -1004, -1000, -996, -200, -4, 0, 1004, 60_000, 10**9])
def test_another_session_is_believed_within_ten_telegrams(back: int) -> None:
    """Back or ahead, near or far: never passed over for ever."""
    line = running()
    first = line.newest + back
    for k in range(10):
        if line.judge(first + 4 * k) == Verdict.NEW:
            break
    else:
        pytest.fail("never believed")
    elapsed, another = line.advance()
    if back > -36:  # it has caught up with the counter of before: nothing tells it from telegrams that come twice
        assert another or line.newest > first
    else:
        assert (elapsed, another) == (1, True)
    assert line.judge(line.newest + 4) == Verdict.NEW
    assert line.advance() == (1, False)


def test_a_counter_that_wraps_is_another_session() -> None:
    """At 2^32."""
    line = SessionCounter(4)
    line.judge(2**32 - 4)
    line.advance()
    assert [line.judge(4 * k) for k in range(3)] == [Verdict.ASTRAY, Verdict.ASTRAY, Verdict.NEW]
    assert line.advance() == (1, True)


@given(st.integers(0, 2**32), st.integers(0, 49))
def test_one_damaged_counter_changes_nothing(wrong: int, after: int) -> None:
    """Unless it lies within the next second: then cycles seem lost, and the loop holds or stops by their number."""
    line = running()
    newest = line.newest
    if 0 < wrong - newest <= 1000:
        return
    assert line.judge(wrong) != Verdict.NEW
    for k in range(1, 2 + after):
        assert line.judge(newest + 4 * k) == Verdict.NEW
        assert line.advance() == (1, False)


@given(st.lists(st.sampled_from([-3, -2, -1, 0]), max_size=100))
def test_copies_between_good_ones_never_make_a_session(copies: list[int]) -> None:
    line = running()
    newest = line.newest
    for back in copies:
        line.judge(newest + 4 * back)
        newest += 4
        assert line.judge(newest) == Verdict.NEW
        assert line.advance() == (1, False)
