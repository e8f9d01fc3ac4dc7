"""Judging a machine: percentiles that were met, verdicts on synthetic samples, reasons that say what to do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as arrays

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MS
from counterflex.evaluate.loop_timing import ENOUGH_CYCLES, SHARE, LoopSamples, Percentiles, TimingVerdict, judge

N = 2500
PERIOD = 4.0 * MS


def samples(**changes: Any) -> LoopSamples:
    rng = np.random.default_rng(7)
    good = LoopSamples(
        period_s=PERIOD,
        late_s=60e-6 * rng.random(N),
        compute_s=10e-6 + 5e-6 * rng.random(N),
        echo_s=40e-6 + 30e-6 * rng.random(N),
        write_s=1e-5 * np.ones(100),
        sync_s=2e-3 * np.ones(10),
    )
    return replace(good, **changes)


def spikes(count: int, height: float) -> Float:
    late = np.full(N, 50e-6)
    late[:count] = height
    return late


@given(arrays.arrays(np.float64, st.integers(1, 3000), elements=st.floats(0.0, 1.0)))
def test_percentiles_are_values_that_were_met(values: Float) -> None:
    found = Percentiles.of(values)
    for share, value in ((0.5, found.p50_s), (0.99, found.p99_s), (0.999, found.p999_s), (1.0, found.max_s)):
        assert value in values
        assert np.mean(values <= value) >= share - 1e-9
        assert np.mean(values < value) < share
    assert found.n == len(values)


def test_percentiles_of_known_values() -> None:
    found = Percentiles.of(np.arange(1, 1001, dtype=float))
    assert (found.p50_s, found.p99_s, found.p999_s, found.max_s) == (500.0, 990.0, 999.0, 1000.0)
    assert Percentiles.of(np.array([3.0, np.nan])).max_s == np.inf
    with pytest.raises(InputError):
        Percentiles.of(np.zeros(0))


def test_a_good_machine_fits() -> None:
    found = judge(samples())
    assert (found.verdict, found.reasons, found.in_time) == (TimingVerdict.FITS, (), 1.0)
    assert found.budget_s == SHARE * PERIOD


@pytest.mark.parametrize(
    ("count", "verdict"), [(0, TimingVerdict.FITS), (2, TimingVerdict.TIGHT), (3, TimingVerdict.UNFIT)]
)
def test_a_thousandth_of_slow_cycles_is_the_limit(count: int, verdict: TimingVerdict) -> None:
    """2500 cycles: two late ones are 0.08 %, three are 0.12 %."""
    found = judge(samples(late_s=spikes(count, 10.0 * MS)))
    assert found.verdict == verdict
    assert found.in_time == 1.0 - count / N
    assert bool(found.reasons) == (count > 0)


@pytest.mark.parametrize(
    ("part", "blamed"), [("late_s", "wake-up latency"), ("compute_s", "the step itself"), ("echo_s", "network stack")]
)
def test_the_reason_names_the_slow_part(part: str, blamed: str) -> None:
    found = judge(samples(**{part: spikes(30, 8.0 * MS)}))
    assert found.verdict == TimingVerdict.UNFIT
    assert blamed in found.reasons[0]
    assert "3 ms" in found.reasons[0]


def test_answers_that_never_come_are_late() -> None:
    lost = samples().echo_s.copy()
    lost[:3] = np.nan
    found = judge(samples(echo_s=lost))
    assert found.verdict == TimingVerdict.UNFIT
    assert "more than a cycle" in found.reasons[0]


def test_too_few_cycles_say_nothing() -> None:
    few = {name: getattr(samples(), name)[: ENOUGH_CYCLES - 1] for name in ("late_s", "compute_s", "echo_s")}
    found = judge(samples(**few))
    assert found.verdict == TimingVerdict.UNFIT
    assert "measure for 4 s" in found.reasons[0]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"fifo": False}, "rtprio"),
        ({"locked": False}, "ulimit -l"),
        ({"cores": 1}, "two or more"),
        ({"governor": "powersave"}, "governor performance"),
        ({"clock_source": "hpet"}, "clocksource"),
        ({"steal": 0.05}, "5.0%"),
        ({"compute_s": np.full(N, 1.2 * MS)}, "faster processor"),
        ({"sync_s": np.full(10, 0.8)}, "power failure"),
    ],
)
def test_each_weakness_is_said_and_does_not_forbid(change: dict[str, Any], word: str) -> None:
    found = judge(samples(**change))
    assert found.verdict == TimingVerdict.TIGHT
    assert len(found.reasons) == 1
    assert word in found.reasons[0]


def test_without_room_for_records_nothing_is_armed() -> None:
    assert judge(samples(ring_fits=False)).verdict == TimingVerdict.UNFIT


@given(st.floats(0.1, 10.0), st.integers(0, 20))
def test_slower_is_never_better(factor: float, count: int) -> None:
    order = [TimingVerdict.FITS, TimingVerdict.TIGHT, TimingVerdict.UNFIT]
    base = samples(late_s=spikes(count, 2.5 * MS))
    slower = replace(base, late_s=base.late_s * max(1.0, factor))
    assert order.index(judge(slower).verdict) >= order.index(judge(base).verdict)


def test_samples_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(InputError):
        judge(samples(echo_s=np.zeros(3)))
    with pytest.raises(InputError):
        judge(samples(late_s=np.full(N, np.nan)))
    with pytest.raises(InputError):
        judge(samples(period_s=0.0))
