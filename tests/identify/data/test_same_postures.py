"""Copies and repeats of a posture do not predict each other; whole regions can be held out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.identify.data.data_checks import ALIKE_RAD, check_enough, joined, leaders, regions
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.solver.holdout import Folds, cross_validate, fold_of_groups


def poses(q: np.ndarray, name: str = "poses", group: np.ndarray | None = None, kind: str = "tracker_poses") -> Dataset:
    return of_arrays(name, kind, {"q": q, "p_tracker_target": q[:, :3]}, group=group)


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 12), st.integers(1, 6), st.integers(0, 10_000))
def test_copies_with_a_little_noise_are_one_group_in_any_order(count: int, copies: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    apart = rng.permutation(40)[:count]
    q = np.repeat(np.outer(apart, np.full(6, 2.0 * DEG)), copies, axis=0)
    which = np.repeat(np.arange(count), copies)
    order = rng.permutation(len(q))
    noisy = (q + rng.uniform(-0.4, 0.4, q.shape) * ALIKE_RAD)[order]
    (found,) = joined([poses(noisy)])
    assert len(np.unique(found.group)) == count
    for k in range(count):
        assert len(np.unique(found.group[which[order] == k])) == 1


def test_a_posture_measured_in_two_files_is_one_group_and_groups_of_the_manifest_stay_whole() -> None:
    q = np.radians(np.arange(8))[:, None] * np.ones(6) * 5.0
    first = poses(q, "a", group=np.array([0, 0, 1, 1, 2, 2, 3, 3]))
    second = poses(q[::-1] + 0.3 * ALIKE_RAD, "b")
    a, b = joined([first, second])
    assert a.group[0] == a.group[1] != a.group[2]
    assert b.group[::-1].tolist() == a.group.tolist()
    fold_a, fold_b = fold_of_groups([a.group, b.group])
    assert fold_b[::-1].tolist() == fold_a.tolist()


def test_a_slow_path_is_not_one_group_and_rows_in_time_are_left_alone() -> None:
    q = np.linspace(0.0, 0.5, 2000)[:, None] * np.ones(6)
    (path,) = joined([poses(q)])
    assert len(np.unique(path.group)) > 100
    record = of_arrays("r", "record", {"q": q}, group=np.arange(2000) // 100)
    assert joined([record])[0] is record


def test_pulls_of_one_posture_under_other_loads_stay_apart_and_copies_do_not() -> None:
    q = np.zeros((6, 6))
    w = np.array([[500.0, 0, 0], [0, 500, 0], [0, 0, 500]] * 2)
    data = of_arrays("p", "pulls", {"q": q, "w_tcp_base": np.hstack([w, np.zeros((6, 3))])})
    assert joined([data])[0].group.tolist()[:3] == joined([data])[0].group.tolist()[3:]
    assert len(np.unique(joined([data])[0].group)) == 3


def test_rows_that_are_no_numbers_stand_for_themselves() -> None:
    assert leaders(np.array([[0.0], [np.nan], [0.1], [np.nan]])).tolist() == [0, 1, 0, 2]


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 60), st.integers(1, 8), st.integers(0, 1000))
def test_regions_are_whole_groups_none_empty_and_apart(count: int, wanted: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(count), 2)
    q = np.repeat(rng.uniform(-2.0, 2.0, (count, 6)), 2, axis=0)
    found = regions(q, group, wanted, seed)
    assert found.min() == 0
    assert set(np.unique(found)) == set(range(int(found.max()) + 1))
    assert found.max() < min(wanted, count)
    assert np.array_equal(found[::2], found[1::2])


def test_two_clusters_are_two_regions() -> None:
    rng = np.random.default_rng(0)
    q = np.concatenate([rng.normal(-1.0, 0.1, (20, 6)), rng.normal(1.0, 0.1, (20, 6))])
    found = regions(q, np.arange(40), 2)
    assert len(set(found[:20])) == len(set(found[20:])) == 1
    assert found[0] != found[-1]


def test_copied_poses_are_too_few_for_their_numbers(arm: object) -> None:
    """Six poses five times are six poses: thirty rows would do, six do not."""
    rng = np.random.default_rng(1)
    parameters = arm.parameters()  # type: ignore[attr-defined]
    truth = arm.truth(parameters, rng)  # type: ignore[attr-defined]
    free = len([p for p in parameters if p.free])
    few = max(1, free // 2 - 1)
    copied = arm.points(truth, rng, count=20 * few, repeats=20)  # type: ignore[attr-defined]
    assert copied.sigma.size > free
    with pytest.raises(InputError, match="repeats of a pose do not count"):
        check_enough(parameters, [copied])
    check_enough(parameters, [arm.points(truth, rng, count=free)])  # type: ignore[attr-defined]


def test_parts_are_held_out_as_given(arm: object) -> None:
    rng = np.random.default_rng(2)
    parameters = arm.parameters()  # type: ignore[attr-defined]
    points = arm.points(arm.truth(parameters, rng), rng, count=30)  # type: ignore[attr-defined]
    part = np.arange(30) // 10
    held = cross_validate(parameters, [points], folds=Folds(parts={0: part}), needed=("base.x", "base.y", "base.turn"))
    assert held.fold.tolist() == part.tolist()
    assert len(held.fits) == 3
