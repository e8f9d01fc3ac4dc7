"""Scripted faults: a pure schedule, seeded, and the line that carries datagrams by it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError
from counterflex.twin.network.faults import SOUND, Fault, FaultSchedule, FaultyLine

N = 4000


def carried(schedule: FaultSchedule, count: int, period_s: float = 0.004) -> list[bytes]:
    line = FaultyLine(schedule)
    out: list[bytes] = []
    for i in range(count):
        line.put(i.to_bytes(4, "big"), i * period_s, out.append)
    line.release(math.inf, out.append)
    return out


@pytest.mark.parametrize("share", [0.01, 0.05, 0.1])
def test_the_share_that_is_lost_is_the_one_asked_for(share: float) -> None:
    left = len(carried(FaultSchedule((Fault("lost", share=share),), seed=3), N))
    sigma = math.sqrt(N * share * (1.0 - share))
    assert abs(N - left - N * share) < 4.0 * sigma


def test_one_fault_more_changes_none_of_the_others() -> None:
    lost = Fault("lost", share=0.1)
    alone = set(carried(FaultSchedule((lost,), 7), N))
    both = set(carried(FaultSchedule((lost, Fault("repeated", share=0.1)), 7), N))
    assert alone == both
    assert alone != set(carried(FaultSchedule((lost,), 8), N))


def test_a_late_datagram_is_overtaken() -> None:
    out = carried(FaultSchedule((Fault("late", first=2, count=1, late_s=0.010),)), 8)
    assert [int.from_bytes(d, "big") for d in out] == [0, 1, 3, 4, 2, 5, 6, 7]


def test_a_reordered_datagram_changes_places_with_the_next() -> None:
    out = carried(FaultSchedule((Fault("reordered", first=2, count=1),)), 6)
    assert [int.from_bytes(d, "big") for d in out] == [0, 1, 3, 2, 4, 5]


def test_repeated_truncated_garbage() -> None:
    faults = (
        Fault("repeated", first=1, count=1),
        Fault("truncated", first=2, count=1),
        Fault("garbage", first=3, count=1),
    )
    out = carried(FaultSchedule(faults, 5), 5)
    assert out[:3] == [b"\0\0\0\0", b"\0\0\0\1", b"\0\0\0\1"]
    assert len(out[3]) < 4
    assert b"\0\0\0\2".startswith(out[3])
    assert len(out[4]) == 4
    assert out[4] != b"\0\0\0\3"
    assert out[4] == carried(FaultSchedule(faults, 5), 5)[4]


@given(
    st.lists(
        st.sampled_from(["lost", "bursts", "late", "reordered", "repeated", "garbage", "truncated", "flipped"]),
        max_size=6,
    ),
    st.floats(0.01, 0.5),
    st.integers(0, 1000),
)
def test_a_line_makes_nothing_of_nothing(kinds: list[Any], share: float, seed: int) -> None:
    """Without losses everything comes out, without repetition nothing twice; lines of one seed are alike."""
    schedule = FaultSchedule(tuple(Fault(k, share=share, late_s=0.009, mean=2.0) for k in kinds), seed)
    out = carried(schedule, 60)
    assert out == carried(schedule, 60)
    if not {"lost", "bursts", "reordered"} & set(kinds):
        assert len(out) >= 60
    if "repeated" not in kinds:
        assert len(out) <= 60


def test_directions_do_not_mix() -> None:
    schedule = FaultSchedule((Fault("lost", direction="in"),))
    assert schedule.deliveries(b"a", 0, 0.0, "in") == []
    assert len(schedule.deliveries(b"a", 0, 0.0, "out")) == 1


def test_the_condition_follows_its_windows() -> None:
    schedule = FaultSchedule(
        (
            Fault("silent", from_s=1.0, for_s=0.5),
            Fault("dying", from_s=3.0),
            Fault("status", first=10, count=2, bits=4),
            Fault("status", first=11, count=2, bits=3),
            Fault("offset", from_s=2.0, for_s=0.1, offset=(1e-3, 0.0, 0.0)),
            Fault("counter", from_s=0.5, step=-8),
        )
    )
    assert schedule.condition(0, 0.0) == SOUND
    assert [schedule.condition(i, 0.0).bits for i in range(9, 14)] == [0, 4, 7, 3, 0]
    assert schedule.condition(0, 0.6).step == -8
    assert schedule.condition(0, 1.2).silent
    assert not schedule.condition(0, 1.6).silent
    assert schedule.condition(0, 2.05).offset == (1e-3, 0.0, 0.0)
    assert schedule.condition(0, 1e6).dead


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "sleepy"},
        {"kind": "lost", "share": 0.0},
        {"kind": "lost", "share": 1.5},
        {"kind": "lost", "share": math.nan},
        {"kind": "late"},
        {"kind": "late", "late_s": 61.0},
        {"kind": "bursts", "mean": 0.5},
        {"kind": "bursts", "share": 0.9, "mean": 2.0},
        {"kind": "silent", "from_s": -1.0},
        {"kind": "silent", "share": 0.5},
        {"kind": "silent", "for_s": 0.0},
        {"kind": "status"},
        {"kind": "status", "bits": 1 << 32},
        {"kind": "offset"},
        {"kind": "offset", "offset": (math.nan, 0.0, 0.0)},
        {"kind": "counter"},
        {"kind": "frozen", "direction": "in"},
        {"kind": "lost", "count": 0},
    ],
)
def test_a_fault_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        Fault(**wrong)


def test_an_instrument_refuses_what_it_cannot_show() -> None:
    schedule = FaultSchedule((Fault("lost"), Fault("beam_broken")))
    schedule.require(("beam_broken",), "a tracker")
    with pytest.raises(InputError, match="a force sensor cannot show this fault"):
        schedule.require(("saturated",), "a force sensor")
