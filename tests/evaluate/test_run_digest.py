"""Digests of stretches of a run join to the figures of all its records; only percentiles are of classes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import Float
from counterflex.evaluate.incidents import IncidentFinder
from counterflex.evaluate.run_digest import MOST_KEPT, DigestMaker, read_digest
from counterflex.evaluate.run_record import RunFigures, RunRecord
from counterflex.runtime import record_ring as record
from counterflex.runtime.monitoring.events import EVENTS
from counterflex.runtime.state.states import Cause, State


def any_rows(seed: int, n: int) -> Float:
    """Records of a run in which everything changes now and then, cycles are missing and telegrams lost."""
    rng = np.random.default_rng(seed)

    def now_and_then(most: int) -> Float:
        values = rng.integers(0, most, n)
        stays = rng.random(n) < 0.9
        stays[0] = False
        at = np.maximum.accumulate(np.where(stays, 0, np.arange(n)))
        return np.asarray(values[at], dtype=np.float64)

    out = np.zeros((n, record.WIDTH))
    out[:, record.CYCLE] = np.cumsum(1 + (rng.random(n) < 0.05) * rng.integers(1, 9, n))
    out[:, 1] = 1e9 + 4e6 * out[:, record.CYCLE] + rng.integers(0, 1000, n)
    out[:, 3] = rng.choice([0, 1, 1, 1, 3], n)
    out[:, 2] = out[:, 1] + rng.integers(20_000, 3_000_000, n)
    out[:, record.column("out_state")] = now_and_then(len(State))
    out[:, record.column("out_cause")] = now_and_then(len(Cause))
    out[:, record.column("out_soft")] = now_and_then(len(Cause))
    out[:, record.column("out_hard")] = now_and_then(3)
    out[:, record.column("out_degraded")] = now_and_then(len(Cause))
    out[:, record.column("out_sources")] = now_and_then(16)
    out[:, record.column("pair_used")] = now_and_then(4)
    out[:, record.column("path_distance")] = rng.random(n)
    out[:, record.column("event_new")] = (rng.random(n) < 0.03) * rng.integers(0, 1 << EVENTS, n)
    out[:, record.column("speed_asked")] = rng.choice([0.0, 0.3, 1.0], n)
    out[:, record.column("cut_m")] = np.cumsum(rng.random(n))
    out[:, record.column("wear_degrees")] = 7.0
    out[:, record.RESULTS : record.RESULTS + 3] = 1e-4 * rng.standard_normal((n, 3))
    return out


def without_times(figures: RunFigures) -> RunFigures:
    return replace(figures, reply=None, states={}, time_s=0.0)


@given(
    st.integers(0, 10_000),
    st.lists(st.integers(0, 700), max_size=5),
    st.lists(st.integers(1, 300), min_size=1, max_size=4),
    st.sets(st.integers(0, 5)),
)
def test_digests_of_stretches_join_to_the_figures_of_all_records(
    seed: int, cuts: list[int], pieces: list[int], read: set[int]
) -> None:
    rows = any_rows(seed, 700)
    whole, joined, all_incidents, found = RunRecord(), RunRecord(), IncidentFinder(), IncidentFinder()
    whole.add(rows)
    all_incidents.add(rows)
    for k, stretch in enumerate(np.split(rows, sorted(cuts))):
        if k in read:  # some segments have no digest: they are read
            joined.add(stretch)
            found.add(stretch)
            continue
        maker, at = DigestMaker(), 0
        while at < len(stretch):
            step = pieces[at % len(pieces)]
            maker.add(stretch[at : at + step])
            at += step
        digest = maker.digest()
        assert (digest is None) == (len(stretch) == 0)
        if digest is not None:
            again = read_digest(json.loads(json.dumps(digest.plain())))
            assert again is not None
            joined.join(again.sums, again.rows)
            found.add(again.rows)
    a, b = whole.figures(), joined.figures()
    assert without_times(a) == without_times(b)
    assert (found.incidents, found.total) == (all_incidents.incidents, all_incidents.total)
    assert a.time_s == pytest.approx(b.time_s)
    for state, (cycles, time_s) in a.states.items():
        assert b.states[state][0] == cycles
        assert b.states[state][1] == pytest.approx(time_s)
    assert (a.reply is None) == (b.reply is None)
    if a.reply is not None and b.reply is not None:
        for name in ("p50_s", "p99_s", "p999_s"):
            assert getattr(a.reply, name) * (1 - 1e-9) <= getattr(b.reply, name) <= 1.0101 * getattr(a.reply, name)
        assert b.reply.max_s == pytest.approx(a.reply.max_s)
        assert b.reply.n == a.reply.n


def test_a_stretch_of_changes_only_and_a_state_that_is_none_have_no_digest() -> None:
    rows = any_rows(1, MOST_KEPT + 500)
    rows[:, record.column("out_state")] = np.arange(len(rows)) % 2
    maker = DigestMaker()
    maker.add(rows)
    assert maker.digest() is None
    rows[:, record.column("out_state")] = 99.0
    maker = DigestMaker()
    maker.add(rows[:600])
    assert maker.digest() is None


def test_a_digest_of_other_columns_is_none() -> None:
    maker = DigestMaker()
    maker.add(any_rows(2, 50))
    digest = maker.digest()
    assert digest is not None
    table = digest.plain()
    assert read_digest({**table, "columns": table["columns"][:-1]}) is None
    assert read_digest({**table, "kept": table["kept"][:-9]}) is None
    assert read_digest({}) is None
