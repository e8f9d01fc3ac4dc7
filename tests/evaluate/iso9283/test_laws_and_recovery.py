"""What must hold of the figures of ISO 9283 whatever is measured, and what comes back from noisy logs."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.iso9283.intervals import largest_repeatability, mean_distance
from counterflex.evaluate.iso9283.path_cycles import path_cycles, path_of
from counterflex.evaluate.iso9283.path_figures import IsoPathFigures, corners
from counterflex.evaluate.iso9283.poses import PoseCycles, PoseFigures
from counterflex.evaluate.iso9283.standstills import assigned, fitted_frame, ordered_cycles, pose_cycles, standstills
from counterflex.geometry import pose, rotation

SQUARE = np.array([(0, 0, 0), (60, 0, 0), (60, 60, 0), (0, 60, 0), (0, 0, 0)]) * MM
numbers = st.floats(-1.0, 1.0)


def rigid(seed: int) -> Float:
    """A motion of a metre and any turn."""
    rng = np.random.default_rng(seed)
    return pose.make(rotation.exp(rng.standard_normal(3)), rng.uniform(-1.0, 1.0, 3))


def cluster(seed: int, n: int = 12) -> PoseCycles:
    rng = np.random.default_rng(seed)
    command = rigid(seed + 1)
    R = rotation.exp(1e-4 * rng.standard_normal((n, 3))) @ command[:3, :3]
    return PoseCycles(command, command[:3, 3] + 30.0 * UM * rng.standard_normal((n, 3)), R)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), offset=st.tuples(numbers, numbers, numbers))
def test_an_offset_changes_accuracy_alone(seed: int, offset: tuple[float, float, float]) -> None:
    one = cluster(seed)
    moved = PoseCycles(one.command, one.p + np.array(offset) * MM, one.R)
    before, after = PoseFigures.of(one), PoseFigures.of(moved)
    assert before.rp is not None
    assert after.rp is not None
    assert after.rp.value == pytest.approx(before.rp.value, rel=1e-7)
    assert [c.value - b.value for c, b in zip(after.ap_xyz, before.ap_xyz, strict=True)] == pytest.approx(
        (np.array(offset) * MM).tolist(), abs=1e-12
    )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), other=st.integers(0, 10_000))
def test_poses_do_not_depend_on_the_frame(seed: int, other: int) -> None:
    one, T = cluster(seed), rigid(other)
    assert one.R is not None
    seen = PoseCycles(T @ one.command, pose.transform(T, one.p), T[:3, :3] @ one.R)
    a, b = PoseFigures.of(one), PoseFigures.of(seen)
    assert a.rp is not None
    assert b.rp is not None
    assert [b.ap.value, b.rp.value] == pytest.approx([a.ap.value, a.rp.value], rel=1e-6)
    turned = [np.linalg.norm([f.value for f in figures]) for figures in (a.ap_abc, b.ap_abc)]
    assert turned[1] == pytest.approx(turned[0], rel=1e-6)


def run(points: Float, cycles: int, seed: int = 1, spread_m: float = 0.0, noise_m: float = 0.0) -> tuple[Float, Float]:
    """A log: a lead-in, the path, a lift and a return, again and again; 1 kHz, 100 mm/s."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(cycles):
        off = spread_m * rng.standard_normal(3)
        way = np.vstack(
            [[(-20, -20, 15), (-8, 0, 0)] * np.full((2, 3), MM), points + off, [(-20, -20, 15) * np.full(3, MM)]]
        )
        for a, b in itertools.pairwise(way):
            n = max(1, int(np.linalg.norm(b - a) / (0.1 * MM)))
            parts.append(a + (b - a) * (np.arange(n) / n)[:, None])
    p = np.concatenate(parts)
    return np.linspace(0.0, 1e-3 * (len(p) - 1), len(p)), p + noise_m * rng.standard_normal(p.shape)


def test_cycles_are_found_by_the_order_of_the_path() -> None:
    path = path_of(SQUARE)
    time, p = run(SQUARE, 4, noise_m=15.0 * UM)
    cycles = path_cycles(path, p, time_s=time)
    assert len(cycles) == 4
    per = len(p) / 4
    assert [c.first // per for c in cycles] == [0, 1, 2, 3]
    assert all(np.all(np.diff(c.length_m) >= 0.0) for c in cycles)
    assert path_cycles(path, p[::-1].copy()) == []  # the same places in the other order are no cycle
    assert len(path_cycles(path, p[: int(3.6 * per)])) == 3  # a cycle that is not whole is none


def test_path_figures_do_not_depend_on_the_frame() -> None:
    path, T = path_of(SQUARE), rigid(5)
    _, p = run(SQUARE, 3, spread_m=40.0 * UM)
    moved = path_of(pose.transform(T, SQUARE))
    here, there = path_cycles(path, p), path_cycles(moved, pose.transform(T, p))
    a, b = IsoPathFigures.of(path, here), IsoPathFigures.of(moved, there)
    assert a.rt_p is not None
    assert b.rt_p is not None
    assert [b.at_p.value, b.rt_p.value] == pytest.approx([a.at_p.value, a.rt_p.value], rel=1e-6)
    assert np.stack([c.co_m for c in corners(moved, there)]) == pytest.approx(
        np.stack([c.co_m for c in corners(path, here)]), abs=1e-9
    )


@pytest.mark.parametrize(("n", "count", "least"), [(10, 150, 0.895), (30, 40, 0.84)])
def test_interval_of_repeatability_holds_the_true_one(n: int, count: int, least: float) -> None:
    """95 % of the intervals hold it, less three standard deviations of the count."""
    rng, root = np.random.default_rng(3), np.diag([10.0, 20.0, 5.0]) * UM
    mean = float(mean_distance((root @ root)[None])[0])
    sample = np.linalg.norm(rng.standard_normal((300_000, 3)) @ root, axis=1)
    assert mean == pytest.approx(float(sample.mean()), rel=3e-3)  # an independent way to the mean distance
    true = float(sample.mean() + 3.0 * sample.std())
    tests = [largest_repeatability((rng.standard_normal((n, 3)) @ root)[None]) for _ in range(count)]
    held = np.mean([f.low is not None and f.high is not None and f.low <= true <= f.high for f in tests])
    assert least <= held


def test_path_comes_back_from_noise() -> None:
    """Offset and scatter of the runs are found beside 15 um of noise; both intervals hold the true figure."""
    offset, spread, noise = np.array([0.0, 0.0, 0.2]) * MM, 40.0 * UM, 15.0 * UM
    path = path_of(SQUARE)
    _, p = run(SQUARE + offset, 10, seed=4, spread_m=spread, noise_m=noise)
    f = IsoPathFigures.of(path, path_cycles(path, p))
    assert f.rt_p is not None
    assert None not in (f.rt_p.low, f.rt_p.high, f.at_p.low, f.at_p.high)
    # Rayleigh: across the path two axes with s = sqrt(40^2 + 15^2): mean 1.2533 s, sigma 0.6551 s
    true = float(np.hypot(spread, noise)) * (1.25331 + 3.0 * 0.65514)
    assert f.rt_p.low <= true <= f.rt_p.high  # type: ignore[operator]
    assert f.at_p.low <= 0.2 * MM <= f.at_p.high  # type: ignore[operator]


def test_poses_come_back_from_a_log_in_another_frame() -> None:
    """Standstills, their order and the tracker's frame are found; RP is that of the scatter, AP nought by the fit."""
    commands = np.tile(np.eye(4), (4, 1, 1))
    commands[:, :3, 3] = np.array([(0, 0, 0), (120, 0, 10), (100, 90, 0), (10, 80, 40)]) * MM
    rng, T, scatter = np.random.default_rng(8), rigid(2), 30.0 * UM
    parts, at, truth = [np.tile([(-0.05, -0.05, 0.05)], (700, 1))], np.array([-0.05, -0.05, 0.05]), []
    for _ in range(10):
        for target in commands[:, :3, 3]:
            goal = target + scatter * rng.standard_normal(3)
            share = (1.0 - np.cos(np.pi * np.arange(400) / 400))[:, None] / 2.0
            parts += [at + (goal - at) * share, np.tile(goal, (700, 1))]
            at = goal
            truth.append(goal)
    p = np.concatenate(parts) + 15.0 * UM * rng.standard_normal((700 + 40 * 1100, 3))
    stands = standstills(np.linspace(0.0, 1e-3 * (len(p) - 1), len(p)), pose.transform(pose.inverse(T), p))
    assert len(stands) == 41
    T_command_log = fitted_frame(stands, commands)  # the first standstill is at home, before the first cycle
    places = pose.transform(pose.inverse(T), commands[:, :3, 3])
    off = pose.transform(T_command_log, places) - commands[:, :3, 3]
    assert np.abs(off).max() < 4.0 * scatter / 10.0**0.5
    moved = [replace(s, p=pose.transform(T_command_log, s.p)) for s in stands]
    cycles = ordered_cycles(assigned(moved, commands), 4)
    assert len(cycles) == 10
    found = pose_cycles(moved, cycles, commands)
    for k, one in enumerate(found):
        f = PoseFigures.of(one)
        assert f.rp is not None
        same = PoseFigures.of(PoseCycles(commands[k], np.array(truth[k::4])))
        assert same.rp is not None
        assert f.rp.value == pytest.approx(same.rp.value, rel=0.05)  # 15 um over 350 readings are 1 um of 30
        assert f.ap.value < 40.0 * UM  # 30 um over 10 cycles, three sigma


def test_an_empty_log_has_no_standstill() -> None:
    """It ended in an IndexError."""
    assert standstills(np.zeros(0), np.zeros((0, 3))) == []
