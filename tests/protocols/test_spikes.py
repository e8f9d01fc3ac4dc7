"""Single samples of a force sensor far off the others are left out; what lasts is used, a few samples late."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.protocols.session.senses import LEAST_N, SpikeGate


def means(samples: Float, per_cycle: int) -> list[Float | None]:
    gate = SpikeGate()
    parts = samples.reshape(-1, per_cycle, 6)
    return [gate.cleaned(part.mean(axis=0), part) for part in parts]


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


def test_what_is_not_far_off_is_the_mean_itself_and_counts_nothing() -> None:
    rng = np.random.default_rng(0)
    gate = SpikeGate()
    for k in range(400):
        part = force(150.0 * np.sin(0.8 * (4 * k + np.arange(4))) + rng.standard_normal(4))  # a mill's tooth passing
        w = part.mean(axis=0)
        clean = gate.cleaned(w, part)
        assert k < 60 or clean is w
    before = gate.count
    gate.cleaned(w, force(np.array([0.0, 4000.0, 0.0, 0.0])))
    assert gate.count == before + 1
