"""A program that comes back to the same spot: the progress of the machine tells its passes apart."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.evaluate.path_deviation import PathFigures, path_deviation
from counterflex.path import FEED, ToolPath


def _path(p: Float) -> ToolPath:
    n = len(p)
    time = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))]) / 0.025
    whole = np.ones(n, dtype=np.int64)
    return ToolPath(
        p, np.tile([0.0, 0.0, 1.0], (n, 1)), whole * FEED, np.full(n, 0.025), np.ones(n), time, whole * 0, whole
    )


def test_the_second_of_two_equal_passes_is_known_by_progress() -> None:
    x = np.linspace(0.0, 0.05, 501)
    there = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    nominal = _path(np.concatenate([there, there[::-1], there]))
    time = nominal.time_s[1002:]
    actual = there + np.array([0.0, 1e-4, 0.0])  # only the third pass was recorded
    engaged, share = np.ones(501, dtype=bool), np.linspace(2.0 / 3.0, 1.0, 501)
    blind = path_deviation(nominal, time, actual, engaged, 1e-3)
    told = path_deviation(nominal, time, actual, engaged, 1e-3, progress=share)
    assert np.max(blind.length_m) < 0.051
    np.testing.assert_allclose(told.length_m, 0.1 + told.p_part_actual[:, 0], atol=1e-9)


def test_progress_leaves_a_simple_path_as_it_was() -> None:
    x = np.linspace(0.0, 0.05, 501)
    line = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    nominal = _path(line)
    actual = line + np.array([0.0, 2e-4, 0.0])
    plain = PathFigures.of(path_deviation(nominal, nominal.time_s, actual, np.ones(501, dtype=bool), 1e-3))
    told = PathFigures.of(
        path_deviation(
            nominal, nominal.time_s, actual, np.ones(501, dtype=bool), 1e-3, progress=np.linspace(0.0, 1.0, 501)
        )
    )
    assert told.path.max_m == plain.path.max_m
    assert abs(told.path.p997_m - 2e-4) < 1e-9
