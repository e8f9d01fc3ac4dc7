"""Single samples of a force sensor far off the others are left out; what lasts is used, a few samples late."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.records import records
from counterflex.protocols.session.spikes import GATE, LEAST_N, clean


def means(samples: Float, per_cycle: int) -> list[Float | None]:
    gates, found = records(GATE), []
    for part in samples.reshape(-1, per_cycle, 6):
        left_out = clean(part, per_cycle, gates)
        mean = part.mean(axis=0) if left_out == 0 else gates["w"][0].copy()
        found.append(None if left_out == per_cycle else mean)
    return found


def force(y_n: Float) -> Float:
    out = np.zeros((len(y_n), 6))
    out[:, 1] = y_n
    return out


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    level=st.floats(-800.0, 800.0),
    spike=st.floats(200.0, 5000.0),
    per_cycle=st.sampled_from([1, 2, 4, 8]),
)
def test_single_spikes_leave_nothing_behind_at_any_level(seed: int, level: float, spike: float, per_cycle: int) -> None:
    rng = np.random.default_rng(seed)
    y = level + rng.standard_normal(800)
    places = rng.choice(np.arange(40, 790, 3), 20, replace=False)
    y[places] += spike * rng.choice([-1.0, 1.0], 20)
    found = means(force(y), per_cycle)
    last = level
    for mean in found[40 // per_cycle :]:
        last = last if mean is None else float(mean[1])
        assert abs(last - level) < 5.0


@settings(max_examples=30, deadline=None)
@given(step=st.floats(LEAST_N, 3000.0), per_cycle=st.sampled_from([1, 4]))
def test_a_step_is_late_by_two_samples_at_most(step: float, per_cycle: int) -> None:
    y = np.r_[np.zeros(40), np.full(40, step)]
    found = means(force(y), per_cycle)
    late = 1 if per_cycle == 1 else 0
    first = 40 // per_cycle + late
    assert found[first] is not None
    assert np.allclose(np.array([mean[1] for mean in found[first:] if mean is not None]), step)
    assert all(mean is not None for mean in found[first:])


def test_what_is_not_far_off_is_left_in_and_counts_nothing() -> None:
    rng = np.random.default_rng(0)
    gates = records(GATE)
    for k in range(400):
        part = force(150.0 * np.sin(0.8 * (4 * k + np.arange(4))) + rng.standard_normal(4))  # a mill's tooth passing
        left_out = clean(part, 4, gates)
        assert k < 60 or left_out == 0
    before = int(gates["count"][0])
    clean(force(np.array([0.0, 4000.0, 0.0, 0.0])), 4, gates)
    assert gates["count"][0] == before + 1
