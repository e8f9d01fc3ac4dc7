"""Mistakes in a file are suspected from the data and named; right data, bad models and gross errors are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.identify.data.alternative_readings import (
    AlternativeReading,
    inverted_pose,
    left_handed,
    other_axes,
    row_mistakes,
    sign_mistakes,
    swapped_columns,
    transposed,
    unit_mistakes,
)
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.data.manifest_checks import Misfit, Score, check_reading, misfit_of, suspect
from counterflex.identify.solver.solve import Stop, solve

SIGMA = 1e-4


def _dataset(arm: Any, seed: int, count: int = 50, load_n: float = 500.0) -> Dataset:
    rng = np.random.default_rng(seed)
    points = arm.points(arm.truth(arm.parameters(), rng), rng, count=count, sigma=SIGMA, load_n=load_n)
    flat = np.hstack([points.measured, np.zeros((count, 1))])
    return of_arrays(
        "arm",
        "tracker_points",
        {"q": points.q, "p_tracker_target": flat, "f_tcp_base": np.hstack([points.force, np.zeros((count, 1))])},
        {"q": 1e-5, "p_tracker_target": SIGMA, "f_tcp_base": 1.0},
    )


def _score(arm: Any) -> Score:
    parameters = arm.parameters()

    def score(data: Dataset) -> Misfit:
        rng = np.random.default_rng(0)
        empty = arm.points(parameters.nominal, rng, count=len(data))
        q, force = data.values("q"), data.values("f_tcp_base")[:, :2]
        arm2 = 0.9 * np.stack([np.cos(q.sum(axis=1)), np.sin(q.sum(axis=1))], axis=1)
        arm1 = 1.2 * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1) + arm2
        lever = np.stack([a[:, 0] * force[:, 1] - a[:, 1] * force[:, 0] for a in (arm1, arm2)], axis=1)
        block = replace(
            empty,
            q=q,
            force=force,
            measured=data.values("p_tracker_target")[:, :2],
            sigma=data.channel("p_tracker_target").need_sigma()[:, :2],
            lever=lever,
            group=data.group,
        )
        return misfit_of(solve(parameters, [block], stop=Stop(1e-6, 30)))

    return score


def _readings(data: Dataset) -> tuple[AlternativeReading, ...]:
    return (
        *unit_mistakes(data, "q"),
        *unit_mistakes(data, "p_tracker_target"),
        *unit_mistakes(data, "f_tcp_base"),
        *sign_mistakes(data, "q"),
        *sign_mistakes(data, "f_tcp_base", single=False),
        *swapped_columns(data, "q"),
        *left_handed(("p_tracker_target",)),
        *row_mistakes("p_tracker_target"),
    )


def _changed(data: Dataset, channel: str, change: Callable[[Float], Float]) -> Dataset:
    old = data.channel(channel)
    return replace(data, channels={**data.channels, channel: replace(old, values=change(old.values))})


MISTAKES: list[tuple[str, Callable[[Float], Float], str]] = [
    ("p_tracker_target", lambda v: 1000.0 * v, "'p_tracker_target' is 1000 times too large (mm read as m)"),
    ("p_tracker_target", lambda v: 1e-3 * v, "'p_tracker_target' is 1000 times too small (m read as mm)"),
    ("q", np.rad2deg, "'q' is 57.3 times too large (deg read as rad)"),
    ("q", np.deg2rad, "'q' is 57.3 times too small (rad read as deg)"),
    ("q", lambda v: v * [1.0, -1.0], "the sign of 'q' (2) is reversed"),
    ("q", lambda v: v[:, ::-1], "columns 1 and 2 of 'q' are swapped"),
    ("p_tracker_target", lambda v: v * [1.0, -1.0, 1.0], "left-handed frame"),
    ("f_tcp_base", lambda v: -v, "the sign of 'f_tcp_base' is reversed"),
    ("f_tcp_base", lambda v: 1e-3 * v, "'f_tcp_base' is 1000 times too small (kN read as N)"),
    ("f_tcp_base", lambda v: 1e3 * v, "'f_tcp_base' is 1000 times too large (N read as kN)"),
    ("p_tracker_target", lambda v: v[::-1], "the rows of 'p_tracker_target' are in reversed order"),
    ("p_tracker_target", lambda v: np.roll(v, 1, axis=0), "'p_tracker_target' comes one row late"),
]


@pytest.mark.by_turn
@pytest.mark.parametrize(("channel", "change", "says"), MISTAKES, ids=[m[2] for m in MISTAKES])
def test_each_mistake_is_named(arm: Any, channel: str, change: Callable[[Float], Float], says: str) -> None:
    data = _changed(_dataset(arm, 1, load_n=3000.0), channel, change)
    with pytest.raises(InputError) as fault:
        check_reading(data, _readings(data), _score(arm))
    text = str(fault.value)
    assert says in text
    assert "If so, " in text
    assert "as_stated=true" in text
    remark = check_reading(data, _readings(data), _score(arm), as_stated=True)
    assert len(remark) == 1
    assert says in remark[0]


@pytest.mark.parametrize("seed", range(3))
def test_right_data_are_not_suspected(arm: Any, seed: int) -> None:
    data = _dataset(arm, seed, load_n=3000.0)
    assert suspect(data, _readings(data), _score(arm)) is None


def test_bad_noise_and_gross_errors_are_not_suspected(arm: Any) -> None:
    rng = np.random.default_rng(9)
    data = _dataset(arm, 2, load_n=3000.0)
    noisy = _changed(data, "p_tracker_target", lambda v: v + 20.0 * SIGMA * rng.standard_normal(v.shape))
    assert suspect(noisy, _readings(data), _score(arm)) is None
    jumps = np.where(rng.random((50, 1)) < 0.06, 0.5, 0.0)
    gross = _changed(data, "p_tracker_target", lambda v: v + jumps)
    assert suspect(gross, _readings(data), _score(arm)) is None


def test_a_mistake_is_seen_through_gross_errors(arm: Any) -> None:
    rng = np.random.default_rng(10)
    data = _dataset(arm, 3, load_n=3000.0)
    jumps = np.where(rng.random((50, 1)) < 0.06, 0.5, 0.0)
    data = _changed(data, "p_tracker_target", lambda v: v + jumps)
    data = _changed(data, "f_tcp_base", lambda v: -v)
    found = suspect(data, _readings(data), _score(arm))
    assert found is not None
    assert found.reading.channel == "f_tcp_base"


def _rotations(rng: np.random.Generator, n: int) -> Float:
    Q, _ = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    out: Float = Q * np.sign(np.linalg.det(Q))[:, None, None]
    return out


def test_readings_of_poses_undo_themselves() -> None:
    rng = np.random.default_rng(11)
    R = _rotations(rng, 5)
    data = of_arrays("poses", "tracker_poses", {"p": rng.standard_normal((5, 3)), "R": R, "w": rng.random((5, 6))})
    for reading in (inverted_pose("p", "R"), transposed("R"), *left_handed(("p",), ("R",), free_frame=False)):
        once = reading.change(data)
        twice = reading.change(once)
        assert not np.allclose(once.values("R"), R)
        assert np.allclose(np.linalg.det(once.values("R")), 1.0)
        assert np.allclose(twice.values("R"), R)
        assert np.allclose(twice.values("p"), data.values("p"))
    turned = other_axes("w", lambda d: d.values("R"), "sensor axes", "").change(data)
    assert np.allclose(turned.values("w")[2, 3:], R[2] @ data.values("w")[2, 3:])
