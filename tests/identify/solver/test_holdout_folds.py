"""Hold-out: rows are predicted by fits that have not seen their group, beside the same with nominal values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import InputError
from counterflex.identify.solver.holdout import Folds, cross_validate, fold_of_groups, score_separate
from counterflex.identify.solver.solve import solve

FRAME = ("base.x", "base.y", "base.turn")


@settings(max_examples=60, deadline=None)
@given(
    sizes=st.lists(st.integers(1, 4), min_size=2, max_size=40),
    folds=st.integers(2, 8),
    seed=st.integers(0, 5),
)
def test_groups_stay_whole_and_folds_are_balanced(sizes: list[int], folds: int, seed: int) -> None:
    group = np.repeat(np.arange(len(sizes)) * 7 + 3, sizes)
    (fold,) = fold_of_groups([group], folds, seed)
    for g in np.unique(group):
        assert len(np.unique(fold[group == g])) == 1
    filled = np.bincount(fold, minlength=min(folds, len(sizes)))
    assert filled.min() >= 1
    assert filled.max() - filled.min() <= max(sizes)


def test_each_block_is_dealt_evenly() -> None:
    many, few = np.arange(100), np.array([0, 10, 20, 30, 40, 200, 201, 202, 203, 204])
    both = fold_of_groups([many, few], 5, 3)
    assert np.bincount(both[0]).tolist() == [20] * 5
    assert np.bincount(both[1]).tolist() == [2] * 5
    again = fold_of_groups([many, few], 5, 3)
    assert all(np.array_equal(a, b) for a, b in zip(both, again, strict=True))
    assert not np.array_equal(both[0], fold_of_groups([many, few], 5, 4)[0])


def test_too_few_groups() -> None:
    with pytest.raises(InputError, match="--holdout"):
        fold_of_groups([np.zeros(20, dtype=np.int64)])


def test_a_row_is_predicted_without_its_group(arm: Any) -> None:
    rng = np.random.default_rng(1)
    parameters = arm.parameters()
    points = arm.points(arm.truth(parameters, rng), rng, count=40, repeats=2)
    held = cross_validate(parameters, [points], needed=FRAME, folds=Folds(seed=2))
    assert held.count == 40
    assert len(held.fits) == 5
    (fold,) = fold_of_groups([points.group], 5, 2)
    assert np.array_equal(held.fold, fold)
    own = fold == 3
    by_hand = solve(parameters, [points.subset(~own)])
    expected = np.linalg.norm(points.measured[own] - points.predict(by_hand.values)[own], axis=1)
    assert np.allclose(held.identified[own], expected, rtol=1e-6, atol=0.0)


def test_error_on_unused_data_exceeds_that_on_used_and_matches_noise(arm: Any) -> None:
    rng = np.random.default_rng(3)
    parameters = arm.parameters()
    truth = arm.truth(parameters, rng)
    points = arm.points(truth, rng, count=24)
    held = cross_validate(parameters, [points], needed=FRAME, folds=Folds(8))
    fit = solve(parameters, [points])
    used = np.sqrt(np.mean(np.sum((fit.residuals[0] * points.sigma) ** 2, axis=1)))
    assert held.rms()[0] > used
    assert held.rms()[0] == pytest.approx(np.sqrt(2.0) * 1e-4, rel=0.5)
    assert held.rms()[1] > 5.0 * held.rms()[0]
    separate = arm.points(truth, rng, count=200)
    score = score_separate(parameters, [points], [separate], needed=FRAME)
    assert score.rms()[0] == pytest.approx(held.rms()[0], rel=0.3)
    assert score.mean()[0] < score.quantile(0.95)[0] < score.largest()[0]


def test_a_moved_tracker_is_local_to_the_separate_file(arm: Any) -> None:
    rng = np.random.default_rng(4)
    parameters = arm.parameters()
    truth = arm.truth(parameters, rng)
    points = arm.points(truth, rng, count=60)
    moved = truth + np.array([0.3, -0.2, 0.1, 0, 0, 0, 0, 0, 0])
    later = arm.points(moved, rng, count=60)
    wrong = score_separate(parameters, [points], [later], needed=FRAME)
    assert wrong.mean()[0] > 0.05
    right = score_separate(parameters, [points], [later], needed=FRAME, local=FRAME)
    assert right.rms()[0] == pytest.approx(np.sqrt(2.0) * 1e-4, rel=0.3)
    assert right.rms()[1] > 5.0 * right.rms()[0]
    with pytest.raises(InputError, match="no such parameter"):
        score_separate(parameters, [points], [later], local=("nobody",))


def test_gross_errors_are_told_apart_and_left_out(arm: Any) -> None:
    rng = np.random.default_rng(5)
    parameters = arm.parameters()
    points = arm.points(arm.truth(parameters, rng), rng, count=60)
    bad = rng.choice(60, 3, replace=False)
    points.measured[bad] += 0.5
    held = cross_validate(parameters, [points], needed=FRAME)
    assert set(np.flatnonzero(held.gross)) == set(bad.tolist())
    assert held.count == 57
    assert held.largest()[0] < 1e-3


def test_folds_tell_what_is_done_of_them_too(arm: Any) -> None:
    rng = np.random.default_rng(1)
    parameters, told = arm.parameters(), []

    def progress(fraction: float, what: str = "") -> None:
        told.append((fraction, what))

    points = arm.points(arm.truth(parameters, rng), rng, count=24)
    cross_validate(parameters, [points], needed=FRAME, folds=Folds(3), progress=progress)
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    for fold in range(3):  # several reports within each, all with its name
        within = [what for fraction, what in told if fold / 3 < fraction < (fold + 0.99) / 3]
        assert len(within) >= 3
        assert set(within) == {f"held out {fold + 1} of 3"}
    told.clear()
    score_separate(parameters, [points], [points], needed=FRAME, progress=progress)
    assert len(told) >= 3
