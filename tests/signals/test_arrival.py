"""Age of samples by another clock's stamps: the clock is set back, forth, or one stamp is wrong."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from counterflex.signals.arrival import ArrivalClock

LEAST_S = 4e-3
PERIOD_S = 4e-3


def ages(clock: ArrivalClock, begin: int, n: int, *, ahead_s: float = 0.0, late_s: float = 0.0) -> list[float]:
    """Ages of n samples, one a cycle, by a clock that is ahead; each comes late_s later than the quickest."""
    return [clock.age(PERIOD_S * k + late_s, PERIOD_S * k - LEAST_S + ahead_s) for k in range(begin, begin + n)]


@settings(max_examples=60, deadline=None)
@given(st.floats(0.005, 30.0), st.integers(10, 500))
def test_a_clock_that_is_set_back_is_taken_anew_whatever_the_step(back_s: float, before: int) -> None:
    """Less than 2 s was taken for samples that are late, for hours: the floor rises by 0.1 ms in a second."""
    clock = ArrivalClock(LEAST_S)
    assert ages(clock, 0, before)[-1] == pytest.approx(LEAST_S, abs=1e-3)
    assert clock.set_back == 0
    found = ages(clock, before, 10, ahead_s=-back_s)
    assert found[0] > LEAST_S + 0.9 * back_s  # whoever uses it sees that it is older than the last one
    assert found[-1] == pytest.approx(LEAST_S, abs=1e-3)
    assert clock.set_back == 1


@pytest.mark.parametrize("wrong_s", [-0.5, -0.01, 0.5])
def test_one_wrong_stamp_is_forgotten(wrong_s: float) -> None:
    clock = ArrivalClock(LEAST_S)
    ages(clock, 0, 100)
    ages(clock, 100, 1, ahead_s=wrong_s)
    assert ages(clock, 101, 10)[-1] == pytest.approx(LEAST_S, abs=1e-3)
    if wrong_s < 0.0:
        assert clock.set_back == 0


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 990), st.integers(1, 60), st.booleans())
def test_an_old_sample_that_is_repeated_becomes_older_and_sets_no_clock(back: int, times: int, mixed: bool) -> None:
    """A duplicate is no second sample of another time; between new samples it changes nothing for them either."""
    clock = ArrivalClock(LEAST_S)
    ages(clock, 0, 1000)
    old_s = PERIOD_S * (999 - back) - LEAST_S
    for k in range(times):
        now_s = PERIOD_S * (1000 + k)
        assert clock.age(now_s, old_s) == pytest.approx(now_s - old_s, abs=1e-3)
        if mixed:
            assert clock.age(now_s, now_s - LEAST_S) == pytest.approx(LEAST_S, abs=1e-3)
    assert clock.set_back == 0
    assert ages(clock, 1000 + times, 10) == pytest.approx([LEAST_S] * 10, abs=1e-3)


def test_samples_that_come_late_are_late() -> None:
    """A network that stands still for 0.2 s is no clock that was set back: the stamps go on."""
    clock = ArrivalClock(LEAST_S)
    ages(clock, 0, 100)
    assert ages(clock, 100, 50, late_s=0.2) == pytest.approx([LEAST_S + 0.2] * 50, abs=1e-3)
    assert clock.set_back == 0


def test_a_clock_that_is_set_forth_is_followed_at_once() -> None:
    clock = ArrivalClock(LEAST_S)
    ages(clock, 0, 100)
    assert ages(clock, 100, 20, ahead_s=0.7) == pytest.approx([LEAST_S] * 20, abs=1e-3)


@pytest.mark.parametrize(("silent_s", "back_s"), [(0.5, 0.3), (5.0, 0.02), (30.0, 1.9), (1.0, 0.8)])
def test_a_clock_that_is_set_back_while_its_source_is_silent(silent_s: float, back_s: float) -> None:
    """No stamp falls, and the step is below 2 s: its samples were late for hours."""
    clock = ArrivalClock(LEAST_S)
    ages(clock, 0, 100)
    begin = 100 + round(silent_s / PERIOD_S)
    found = ages(clock, begin, 300, ahead_s=-back_s)
    assert min(found[:240]) > LEAST_S + 0.9 * back_s  # late as long as it may be the network
    assert found[-1] == pytest.approx(LEAST_S, abs=1e-3)
    assert clock.set_back == 1


def test_a_queue_behind_a_silence_is_late_until_it_is_worked_off() -> None:
    """Later and later less: the network, not the clock."""
    clock = ArrivalClock(LEAST_S)
    ages(clock, 0, 100)
    for k in range(1200):
        late = 0.4 * (1.0 - k / 1200)
        assert ages(clock, 300 + k, 1, late_s=late) == pytest.approx([LEAST_S + late], abs=2e-3)
    assert clock.set_back == 0
