"""Plain faults of measured data are found before a fit, and named; ordinary data pass."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.identify.data.data_checks import (
    check_enough,
    check_finite,
    check_moves,
    check_repeats,
    check_spread,
    same_poses,
)
from counterflex.identify.data.dataset import Dataset, of_arrays


def _data(q: Float, p: Float, sigma: float = 1e-5) -> Dataset:
    return of_arrays("lab", "tracker_points", {"q": q, "p_tracker_target": p}, {"q": 1e-6, "p_tracker_target": sigma})


def _repeated(rng: np.random.Generator, spread: float, poses: int = 8, times: int = 4) -> Dataset:
    q = np.repeat(rng.uniform(-1.0, 1.0, (poses, 6)), times, axis=0)
    p = np.repeat(rng.uniform(-1.0, 1.0, (poses, 3)), times, axis=0)
    return _data(q, p + spread * rng.standard_normal(p.shape))


def test_gaps_are_named_with_their_line() -> None:
    rng = np.random.default_rng(0)
    p = rng.random((10, 3))
    p[6, 1] = np.nan
    data = _data(rng.random((10, 6)), p)
    check_finite(data, ["q"])
    with pytest.raises(InputError, match=r"lab.*7: channel 'p_tracker_target' has 1 rows"):
        check_finite(data, ["q", "p_tracker_target"])


def test_a_channel_that_stands_still() -> None:
    rng = np.random.default_rng(1)
    data = _data(np.tile(rng.random(6), (10, 1)), rng.random((10, 3)))
    check_moves(data, "p_tracker_target", 1e-3)
    with pytest.raises(InputError, match="'q' hardly changes"):
        check_moves(data, "q", 1e-3)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_honest_repeats_pass(factor: float) -> None:
    """Also where the stated standard deviation is three times too small: the fit widens it."""
    for seed in range(20):
        check_repeats(_repeated(np.random.default_rng(seed), factor * 1e-5), "p_tracker_target")


def test_a_gross_error_among_repeats_is_left_to_the_fit() -> None:
    data = _repeated(np.random.default_rng(2), 1e-5)
    data.values("p_tracker_target")[5] += 0.5
    check_repeats(data, "p_tracker_target")


def test_contradictions_are_named() -> None:
    rng = np.random.default_rng(3)
    data = _repeated(rng, 1e-5)
    data.values("p_tracker_target")[:] = rng.permutation(data.values("p_tracker_target"))
    with pytest.raises(InputError, match="contradict each other in channel 'p_tracker_target'"):
        check_repeats(data, "p_tracker_target")
    moved = _repeated(rng, 1e-5)
    moved.values("p_tracker_target")[::2] += 3e-4
    with pytest.raises(InputError, match="standard deviations apart"):
        check_repeats(moved, "p_tracker_target")


def test_one_pose_throughout() -> None:
    rng = np.random.default_rng(4)
    with pytest.raises(InputError, match="one and the same pose"):
        check_repeats(_repeated(rng, 1e-5, poses=1), "p_tracker_target")


def test_same_poses_by_joint_angles() -> None:
    q = np.array([[0.0] * 6, [1.0] * 6, [1e-6] * 6, [1.0] * 6, [2.0] * 6])
    assert same_poses(q).tolist() == [0, 1, 0, 1, 2]


def test_too_few_measurements(arm: Any) -> None:
    parameters = arm.parameters()
    points = arm.points(parameters.nominal, np.random.default_rng(5), count=4)
    check_enough(parameters, [points])  # eight numbers for eight that are looked for
    with pytest.raises(InputError, match=r"6 numbers in 3 different postures \(3 rows\); expected >= 8"):
        check_enough(parameters, [points.subset(np.arange(4) < 3)])
    with pytest.raises(InputError, match="counterflex identify proposes them"):
        check_enough(parameters, [])


def test_points_must_span_what_a_frame_needs() -> None:
    rng = np.random.default_rng(6)
    cloud = rng.uniform(-1.0, 1.0, (6, 3))
    check_spread(cloud, "fiducials")
    line = np.outer(np.linspace(-1.0, 1.0, 6), [1.0, 2.0, 0.5]) + 1e-4 * rng.standard_normal((6, 3))
    with pytest.raises(InputError, match="the fiducials are on one line"):
        check_spread(line, "fiducials")
    flat = cloud * [1.0, 1.0, 1e-4]
    check_spread(flat, "fiducials")
    with pytest.raises(InputError, match="in one place"):
        check_spread(1e-4 * cloud, "fiducials")
    with pytest.raises(InputError, match="too few fiducials; got 2; expected >= 3"):
        check_spread(cloud[:2], "fiducials")
