"""Figures of a run's record: the same in one piece or many; states, causes, losses of records that are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.run_record import RunRecord
from counterflex.runtime import record_ring as record
from counterflex.runtime.state.supervisor import Cause, State


def rows(states: list[State]) -> Float:
    """A record every 4 ms, answered after 20, 21, ... us; correction grows by 1 um along x while active."""
    out = np.zeros((len(states), record.WIDTH))
    out[:, record.CYCLE] = np.arange(1, len(states) + 1)
    out[:, 0] = 4.0 * out[:, record.CYCLE]
    out[:, 1] = 1e9 + 4e6 * out[:, record.CYCLE]
    out[:, 2] = out[:, 1] + 20_000 + 1000 * np.arange(len(states))
    out[:, 3] = 1
    out[:, record.column("out_state")] = states
    out[:, record.RESULTS] = np.cumsum([1e-6 * (s == State.ACTIVE) for s in states])
    return out


KNOWN = [State.IDLE] * 3 + [State.READY] * 2 + [State.ARMED] + [State.ACTIVE] * 10 + [State.HOLD] * 4


def known() -> Float:
    out = rows(KNOWN)
    out[16:, record.column("out_cause")] = Cause.FORCE_STALE
    out[16:18, record.column("out_soft")] = Cause.FORCE_STALE
    out[8, 3], out[12, 3] = 0, 2
    return out


def test_known_figures() -> None:
    record_ = RunRecord()
    record_.add(known())
    found = record_.figures()
    assert (found.records, found.answered, found.waited, found.telegrams_lost, found.records_lost) == (20, 19, 1, 1, 0)
    assert found.time_s == pytest.approx(0.076)
    assert {s: c for s, (c, _) in found.states.items()} == {
        State.IDLE: 3,
        State.READY: 2,
        State.ARMED: 1,
        State.ACTIVE: 10,
        State.HOLD: 4,
    }
    assert sum(t for _, t in found.states.values()) == pytest.approx(found.time_s)
    assert found.states[State.ACTIVE][1] == pytest.approx(0.040)
    assert found.causes == {Cause.FORCE_STALE: 2}
    assert [(c.cycle, c.before, c.after, c.cause) for c in found.changes] == [
        (4, State.IDLE, State.READY, Cause.NONE),
        (6, State.READY, State.ARMED, Cause.NONE),
        (7, State.ARMED, State.ACTIVE, Cause.NONE),
        (17, State.ACTIVE, State.HOLD, Cause.FORCE_STALE),
    ]
    assert found.reply is not None
    assert found.reply.n == 19
    assert found.reply.max_s == pytest.approx(39e-6)
    assert found.largest_m == pytest.approx(10e-6)
    assert found.largest_step_m == pytest.approx(1e-6)


@given(st.lists(st.integers(0, 20), max_size=6))
def test_pieces_change_nothing(cuts: list[int]) -> None:
    whole, parts = RunRecord(), RunRecord()
    whole.add(known())
    for piece in np.split(known(), sorted(cuts)):
        parts.add(piece)
    a, b = whole.figures(), parts.figures()
    assert {s: c for s, (c, _) in a.states.items()} == {s: c for s, (c, _) in b.states.items()}
    for state in a.states:
        assert a.states[state][1] == pytest.approx(b.states[state][1])
    assert (a.changes, a.causes, a.reply, a.records_lost) == (b.changes, b.causes, b.reply, b.records_lost)
    assert (a.largest_m, a.largest_step_m, a.time_s) == (b.largest_m, b.largest_step_m, b.time_s)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=30),
       st.lists(st.integers(0, 30), max_size=4))  # fmt: skip
def test_changes_of_what_is_used_are_told_from_and_to_in_any_pieces(
    used: list[tuple[int, int, int]], cuts: list[int]
) -> None:
    """Force sensors and sources each by itself; telegrams lost are what the controller counts besides."""
    pair, sources, elapsed = (list(column) for column in zip(*used, strict=True))
    data = rows([State.ACTIVE] * len(used))
    data[:, record.column("pair_used")], data[:, record.column("out_sources")], data[:, 3] = pair, sources, elapsed
    made = RunRecord()
    for piece in np.split(data, sorted(cuts)):
        made.add(piece)
    found = made.figures()
    for values, changes in ((pair, found.pair_changes), (sources, found.sources_changes)):
        expected = [(k + 1, a, b) for k, (a, b) in enumerate(itertools.pairwise(values), 1) if a != b]
        assert [(c.cycle, int(c.before), int(c.after)) for c in changes] == expected
        assert [c.time_s for c in changes] == pytest.approx([4e-3 * (k - 1) for k, _, _ in expected])
    assert found.telegrams_lost == sum(e - 1 for e in elapsed if e > 0)
    assert (found.answered, found.waited) == (sum(e > 0 for e in elapsed), elapsed.count(0))
    assert found.largest_m == pytest.approx(1e-6 * len(used))


def test_lost_records_are_counted_and_make_no_step() -> None:
    record_ = RunRecord()
    record_.add(np.delete(known(), [0, 9, 10, 11], axis=0))
    found = record_.figures()
    assert (found.records, found.records_lost) == (16, 4)
    assert found.largest_step_m == pytest.approx(1e-6)


def test_nothing_recorded() -> None:
    found = RunRecord().figures()
    assert (found.records, found.reply, found.states, found.changes) == (0, None, {}, ())


@pytest.mark.parametrize("value", [7.0, -1.0, 0.5, np.nan])
def test_a_state_that_does_not_exist(value: float) -> None:
    bad = known()
    bad[3, record.column("out_state")] = value
    with pytest.raises(InputError, match="state"):
        RunRecord().add(bad)
    with pytest.raises(InputError, match="shape"):
        RunRecord().add(np.zeros((2, 3)))
