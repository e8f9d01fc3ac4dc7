"""The time left that is told, on a virtual clock, for jobs whose parts cost what they cost."""

from __future__ import annotations

import pytest

from counterflex.core.meter import Meter, duration
from counterflex.core.progress import in_parts


class Clock:
    """A clock that is put on by hand."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def ratios(costs_s: dict[str, float], weights: dict[str, float], steps: int = 20) -> list[float]:
    """Time left as told over the time that is left, from a quarter of the work to 95 %.

    Args:
        costs_s: Time that each part takes.
        weights: What the job takes them to be.
        steps: How often each part reports.
    """
    clock = Clock()
    meter = Meter("job", clock)
    parts = in_parts(meter, weights)
    total, spent, found = sum(costs_s.values()), 0.0, []
    for name, cost_s in costs_s.items():
        for k in range(steps):
            clock.now_s += cost_s / steps
            spent += cost_s / steps
            parts[name]((k + 1) / steps)
            left = meter.remaining_s()
            if 0.25 <= meter.fraction <= 0.95:
                assert left is not None
                found.append(left / (total - spent))
    return found


def test_an_even_job_is_told_exactly() -> None:
    assert ratios({"all": 80.0}, {"all": 1.0}) == pytest.approx([1.0] * 15, rel=1e-9)


@pytest.mark.parametrize("fast", [True, False])
def test_a_job_whose_parts_are_weighed_wrongly_is_told_within_a_factor_of_two(fast: bool) -> None:
    wrong = 1.5 if fast else 1.0 / 1.5
    costs = {"read": 4.0, "cut": 10.0 * wrong, "bend": 25.0, "try": 30.0 / wrong, "write": 6.0}
    weights = {"read": 4.0, "cut": 10.0, "bend": 25.0, "try": 30.0, "write": 6.0}
    found = ratios(costs, weights)
    assert min(found) > 0.5
    assert max(found) < 2.0


def test_a_long_part_is_told_by_its_own_rate_once_it_outweighs_short_ones() -> None:
    weights = {"read": 5.0, "plan": 30.0, "cut": 15.0, "record": 10.0, "run": 3600.0}
    found = ratios({"read": 0.5, "plan": 2.0, "cut": 1.0, "record": 57.0, "run": 3600.0}, weights, steps=200)
    assert min(found) > 0.75
    assert max(found) < 1.1


def test_a_job_that_stands_is_told_to_take_longer() -> None:
    clock = Clock()
    meter = Meter("job", clock)
    clock.now_s += 10.0
    meter.report(0.5)
    before = meter.remaining_s()
    assert before is not None
    assert before == pytest.approx(10.0, rel=0.3)
    clock.now_s += 30.0
    after = meter.remaining_s()
    assert after is not None
    assert after > 3.0 * before


def test_progress_never_falls_and_says_what_is_done() -> None:
    clock = Clock()
    meter = Meter("compensating part.ngc", clock)
    assert meter.remaining_s() is None
    assert meter.line() == "compensating part.ngc: 0 %"
    clock.now_s += 10.0
    for fraction in (0.2, 0.1, float("nan"), 7.0):
        meter.report(fraction, "cut")
    assert meter.fraction == 0.2
    assert meter.line() == "cut: 20 %, about 40 s left"


def test_times_are_for_people() -> None:
    assert [duration(s) for s in (0.4, 40.0, 200.0, 4800.0)] == ["0 s", "40 s", "3 min", "80 min"]
    assert duration(7000.0) == "1 h 57 min"


def test_many_reports_cost_little_memory() -> None:
    clock = Clock()
    meter = Meter("job", clock)
    for k in range(20_000):
        clock.now_s += 0.01
        meter.report((k + 1) / 20_000)
    assert len(meter._seen) < 500


def test_a_job_that_is_all_but_done_is_not_done_and_one_that_is_has_no_time_left() -> None:
    """It said 100 %, and that 81 minutes were left: the longer it then stood, the more."""
    now = [0.0]
    meter = Meter("soaking", lambda: now[0])
    for k in range(1, 101):
        now[0] = 60.0 * k
        meter(0.00998 * k)
    assert meter.line() == "soaking: 99 %, about 12 s left"
    meter(1.0)
    for now[0] in (6001.0, 9000.0):
        assert meter.line() == "soaking: 100 %"
