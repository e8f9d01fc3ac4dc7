"""The schedule of a bad network: shares, lengths and times are those asked for, and the same seed gives the same."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import InputError
from counterflex.twin.network.impairment import Burst, Delivery, Impairment, Schedule, Stall

N = 40_000


def lost(made: Impairment, n: int = N, seed: int = 1) -> np.ndarray:
    schedule = Schedule(made, seed)
    return np.array([not schedule.decide(k) for k in range(n)])


def runs(gone: np.ndarray) -> list[int]:
    return [len(list(group)) for value, group in itertools.groupby(gone.tolist()) if value]


def test_random_loss_is_as_often_as_asked_and_independent() -> None:
    gone = lost(Impairment(loss=0.05))
    assert abs(gone.mean() - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / N)
    assert np.mean(runs(gone)) == pytest.approx(1.0 / 0.95, rel=0.03)


@pytest.mark.parametrize("mean", [3.0, 8.0])
def test_bursts_have_their_share_and_length(mean: float) -> None:
    """Gilbert chain: lengths are geometric with the mean asked for."""
    gone = lost(Impairment(burst=Burst(0.05, mean)))
    lengths = runs(gone)
    spread = np.sqrt(mean * (mean - 1.0) / len(lengths))
    assert abs(np.mean(lengths) - mean) < 4.0 * spread
    assert gone.mean() == pytest.approx(0.05, rel=8.0 / np.sqrt(len(lengths)))


def test_patterns_repeat_between_first_and_end() -> None:
    gone = lost(Impairment(pattern="10", first=10, end=20), 30)
    assert np.flatnonzero(gone).tolist() == [11, 13, 15, 17, 19]


def test_stalled_datagrams_come_together_at_the_end() -> None:
    schedule = Schedule(Impairment(stalls=(Stall(5, 3),)))
    arrivals = [4e-3 * k + schedule.decide(k)[0].delay_s for k in range(10)]
    assert arrivals[5:8] == pytest.approx([32e-3] * 3)
    assert arrivals[8] == pytest.approx(32e-3)
    dropped = Schedule(Impairment(stalls=(Stall(5, 3, lost=True),)))
    assert [len(dropped.decide(k)) for k in range(4, 9)] == [1, 0, 0, 0, 1]


def test_delay_and_jitter_stay_in_their_band() -> None:
    schedule = Schedule(Impairment(delay_s=2e-3, jitter_s=10e-3), 3)
    delays = np.array([schedule.decide(k)[0].delay_s for k in range(2000)])
    assert delays.min() >= 2e-3
    assert delays.max() < 12e-3
    assert delays.mean() == pytest.approx(7e-3, rel=0.05)


def test_dying_is_for_good() -> None:
    assert lost(Impairment(dies=7), 12).tolist() == [False] * 7 + [True] * 5


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.permutations(list(range(40))))
def test_the_same_seed_gives_the_same_whatever_is_asked_first(seed: int, order: list[int]) -> None:
    made = Impairment(
        loss=0.1, burst=Burst(0.1, 3.0), jitter_s=5e-3, duplicate=0.2, reorder=0.2, flip=0.2, truncate=0.2, garbage=0.1
    )
    first, second = Schedule(made, seed), Schedule(made, seed)
    wanted = {47 * k: first.decide(47 * k) for k in range(40)}
    assert {47 * k: second.decide(47 * k) for k in order} == wanted


def test_another_fault_leaves_the_losses_where_they_were() -> None:
    plain, more = Impairment(loss=0.05), Impairment(loss=0.05, jitter_s=1e-3, duplicate=0.5, flip=0.5)
    np.testing.assert_array_equal(lost(plain, 2000), lost(more, 2000))


def test_two_ways_are_independent() -> None:
    made = Impairment(loss=0.5)
    a, b = Schedule(made, 5, 0), Schedule(made, 5, 1)
    same = np.mean([bool(a.decide(k)) == bool(b.decide(k)) for k in range(4000)])
    assert abs(same - 0.5) < 4.0 * 0.5 / np.sqrt(4000)


@given(st.binary(min_size=1, max_size=300), st.floats(0.0, 1.0, exclude_max=True))
def test_a_flip_turns_exactly_one_bit(data: bytes, place: float) -> None:
    out = Delivery(flip=place).of(data)
    assert sum((x ^ y).bit_count() for x, y in zip(data, out, strict=True)) == 1


@given(st.binary(min_size=1, max_size=300), st.floats(0.0, 1.0, exclude_max=True))
def test_truncation_leaves_a_beginning(data: bytes, keep: float) -> None:
    out = Delivery(keep=keep).of(data)
    assert len(out) < len(data)
    assert data.startswith(out)


def test_garbage_has_the_length_and_nothing_else() -> None:
    data = bytes(600)
    out = Delivery(garbage=3).of(data)
    assert len(out) == 600
    assert out == Delivery(garbage=3).of(data)
    assert len(set(out)) > 200


@pytest.mark.parametrize(
    "bad",
    [
        {"loss": 1.1},
        {"flip": -0.1},
        {"delay_s": float("nan")},
        {"pattern": "102"},
        {"first": 5, "end": 4},
        {"period_s": 0.0},
    ],
)
def test_numbers_out_of_range_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(InputError):
        Impairment(**bad)  # type: ignore[arg-type]


def test_chains_and_stalls_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError):
        Burst(0.9, 3.0)
    with pytest.raises(InputError):
        Burst(0.05, 0.5)
    with pytest.raises(InputError):
        Stall(0, 0)
    with pytest.raises(InputError):
        Schedule(Impairment(), -1)
    with pytest.raises(InputError):
        Schedule(Impairment()).decide(-1)
