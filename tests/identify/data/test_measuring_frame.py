"""Sensors of a measuring frame: closed forms, rays cast independently, what is not seen, wrong sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MRAD, UM
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.frame_checks import MOST_CONDITION, check_misfit, check_rows
from counterflex.identify.data.measuring_frame import (
    SensorFrame,
    condition,
    feet,
    meeting_point,
    motion,
    passing,
    shown,
)
from counterflex.twin.laboratory import distance_frame

DATA = of_arrays("pulls", "pulls", {"q": np.zeros((12, 6))})
HALF = 50.0 * MM


def frame_of(position: Float, direction: Float, normal: Float | None = None) -> SensorFrame:
    k = len(position)
    return SensorFrame(
        names=tuple(f"S{i + 1}" for i in range(k)),
        position=np.asarray(position, dtype=np.float64),
        direction=np.asarray(direction, dtype=np.float64),
        normal=-np.asarray(direction, dtype=np.float64) if normal is None else normal,
        point=np.full((k, 3), np.nan),
        axes="base",
        where="manifest",
    )


def cube_frame(count: int = 8) -> SensorFrame:
    """The first sensors of the order 1 on +x, 1 on +y, 1 on +z, then more on each."""
    stand, look, _ = distance_frame.beams()
    order = [2, 5, 6, 0, 3, 1, 7, 4][:count]
    if count < 6:
        stand = np.where(np.abs(look) > 0.5, stand, 0.0)  # at the middles of the faces
    return frame_of(stand[order], look[order])


def cast(frame: SensorFrame, s: Float, T_loaded: Float) -> Float:
    """Distances to faces that have moved with a body by ``x -> T x``, by taking each beam into the body's frame."""
    at, back = feet(frame, s[None])[0], pose.inverse(T_loaded)
    p = pose.transform(back, frame.position)
    u = frame.direction @ back[:3, :3].T
    out: Float = np.sum(frame.normal * (at - p), axis=1) / np.sum(frame.normal * u, axis=1)
    return out


def moved_about(reference: Float, d: Float) -> Float:
    """Pose of the body: shift d of the reference point, rotation vector about it."""
    R = rotation.exp(d[3:])
    return pose.make(R, reference + d[:3] - R @ reference)


def test_a_shift_shows_as_itself_and_a_turn_by_its_lever() -> None:
    frame = frame_of(np.array([[0.09, 0.0, 0.03], [0.0, 0.09, 0.0]]), np.array([[-1.0, 0, 0], [0, -1.0, 0]]))
    s, r = np.full((1, 2), 0.04), np.zeros((1, 3))
    shift = shown(frame, s, np.array([[1e-3, -2e-3, 5e-3]]), r)
    np.testing.assert_allclose(shift - s, [[-1e-3, 2e-3]], atol=1e-15)
    # A turn by w about y moves the face at x = 50 mm, 30 mm above the centre, by 30 mm * w towards the sensor.
    turn = shown(frame, s, np.array([[0, 0, 0, 0, 1e-6, 0.0]]), r)
    assert (turn - s)[0, 0] == pytest.approx(-0.03e-6, rel=1e-4)


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10_000), st.integers(6, 10))
def test_the_motion_comes_back_from_rays_of_any_sensors(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normal = -direction + 0.3 * rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    frame = frame_of(rng.uniform(-0.1, 0.1, (count, 3)) - 0.1 * direction, direction, normal)
    s, reference = rng.uniform(0.0, 0.05, count), rng.uniform(-0.1, 0.1, 3)
    if condition(frame, s, reference)[0] > MOST_CONDITION:
        return
    d = np.r_[rng.uniform(-3 * MM, 3 * MM, 3), rng.uniform(-5 * MRAD, 5 * MRAD, 3)]
    after = cast(frame, s, moved_about(reference, d))
    np.testing.assert_allclose(shown(frame, s[None], d[None], reference[None])[0], after, atol=1e-13)
    found = motion(frame, s[None], after[None], np.full((1, count), UM), reference[None])
    np.testing.assert_allclose(found.d[0], d, atol=1e-10)
    assert np.max(np.abs(found.residual)) < 1e-11
    # What is found does not hang on the axes that everything is written in.
    R = rotation.exp(rng.standard_normal(3))
    turned = replace(frame, position=frame.position @ R.T, direction=direction @ R.T, normal=normal @ R.T)
    again = motion(turned, s[None], after[None], np.full((1, count), UM), (R @ reference)[None])
    np.testing.assert_allclose(again.d[0], np.r_[R @ d[:3], R @ d[3:]], atol=1e-10)


@pytest.mark.parametrize("count", [6, 7, 8])
def test_the_stated_covariance_is_that_of_the_scatter(count: int) -> None:
    rng, n = np.random.default_rng(count), 4000
    frame, reference = cube_frame(count), np.tile([0.01, -0.02, 0.03], (n, 1))
    sigma = np.tile(rng.uniform(1.0, 3.0, count) * UM, (n, 1))
    s = np.full((n, count), 40.0 * MM)
    d = np.tile([1e-3, -0.5e-3, 0.7e-3, 1e-3, 0.5e-3, -1e-3], (n, 1))
    after = shown(frame, s, d, reference) + sigma * rng.standard_normal((n, count))
    found = motion(frame, s, after, sigma, reference)
    scatter = np.cov((found.d - d).T)
    size = np.sqrt(np.diag(found.covariance[0]))
    np.testing.assert_allclose(scatter / np.outer(size, size), found.covariance[0] / np.outer(size, size), atol=0.1)
    if count > 6:
        assert np.sqrt(np.mean(found.misfit() ** 2)) == pytest.approx(1.0, abs=0.05)
    else:
        assert np.all(np.isnan(found.misfit()))


@pytest.mark.parametrize("count", [3, 4, 5])
def test_fewer_than_six_give_the_displacement_where_their_normals_meet(count: int) -> None:
    frame, r = cube_frame(count), np.zeros((1, 3))
    s = np.full((1, count), 40.0 * MM)
    d = np.array([[1e-3, -0.5e-3, 0.7e-3, 1e-3, 0.5e-3, -1e-3]])
    after = cast(frame, s[0], moved_about(r[0], d[0]))[None]
    found = motion(frame, s, after, np.full((1, count), UM), r)
    assert found.d.shape == (1, 3)
    # Only the second order of a turn is left, 0.5 |w| |d|.
    np.testing.assert_allclose(found.d[0], d[0, :3], atol=2.0 * UM)
    assert np.max(passing(frame, s, r)) < 1e-15
    np.testing.assert_allclose(meeting_point(frame, s), r, atol=1e-12)
    beside = np.array([[0.0, 0.0, 0.2]])
    with pytest.raises(InputError, match=r"give a displacement only of a point .* 0?200 um|200 um"):
        check_rows(DATA, frame, s, after, beside)


def looking(*beams: tuple[str, float, float]) -> tuple[Float, Float]:
    """Places and directions of beams onto faces of a cube: axis of the face, and where on it in mm."""
    position, direction = np.zeros((2, len(beams), 3))
    for i, (axis, a, b) in enumerate(beams):
        k = "xyz".index(axis)
        position[i, [k, (k + 1) % 3, (k + 2) % 3]] = 90.0 * MM, a * MM, b * MM
        direction[i, k] = -1.0
    return position, direction


@pytest.mark.parametrize(
    ("beams", "words"),
    [
        ([("x", 10.0 * i, 4.0 * i * i) for i in range(6)], ""),
        (
            [*(("x", a, b) for a, b in [(-30, -30), (30, -30), (0, 30)]), *(("y", a, a * a) for a in (-5, 0, 5))],
            "the displacement along the z axis",
        ),
        ([("x", 0, 0), ("x", 1, 0), ("y", 0, 0), ("y", 1, 0), ("z", 0, 0), ("z", 1, 0)], "turn about"),
        ([("x", 0, 0), ("x", 30, 0), ("y", 0, 0)], "the displacement along the z axis"),
    ],
    ids=["all on one face", "two faces", "too close together", "three on two faces"],
)
def test_what_the_sensors_do_not_see_is_named_with_its_condition(
    beams: list[tuple[str, float, float]], words: str
) -> None:
    frame = frame_of(*looking(*beams))
    s = np.full((1, len(beams)), 40.0 * MM)
    with pytest.raises(InputError, match="do not determine") as fault:
        check_rows(DATA, frame, s, s, np.zeros((1, 3)))
    assert words in fault.value.what
    assert "condition" in str(fault.value)
    assert condition(frame, s[0], np.zeros(3))[0] > MOST_CONDITION


def wrong(frame: SensorFrame, before: Float, after: Float) -> tuple[str, ...]:
    reference = np.zeros((len(before), 3))
    found = motion(frame, before, after, np.full(before.shape, 2.0 * UM), reference)
    return check_misfit(frame, before, after, found, reference)


def experiment(count: int, seed: int) -> tuple[SensorFrame, Float, Float]:
    rng, n = np.random.default_rng(seed), 12
    frame, r = cube_frame(count), np.zeros((n, 3))
    before = 40.0 * MM + rng.uniform(-1.0, 1.0, (n, count)) * MM
    d = np.hstack([rng.uniform(-1, 1, (n, 3)) * 1e-3, rng.uniform(-1, 1, (n, 3)) * 2e-3])
    after = shown(frame, before, d, r) + 1.4 * UM * rng.standard_normal((n, count))
    return frame, before, after


@pytest.mark.parametrize("which", range(8))
def test_a_sensor_that_counts_the_other_way_is_named(which: int) -> None:
    frame, before, after = experiment(8, which)
    assert wrong(frame, before, after) == ()
    after[:, which] = 2.0 * before[:, which] - after[:, which]
    said = " ".join(wrong(frame, before, after))
    assert f"sensor '{frame.names[which]}' counts the other way" in said


@pytest.mark.parametrize(("i", "j"), [(0, 1), (2, 4), (3, 7), (1, 6)])
def test_exchanged_sensors_are_named(i: int, j: int) -> None:
    frame, before, after = experiment(8, 10 * i + j)
    order = np.arange(8)
    order[[i, j]] = j, i
    said = " ".join(wrong(frame, before[:, order], after[:, order]))
    assert f"sensors '{frame.names[i]}' and '{frame.names[j]}' are exchanged" in said


@pytest.mark.parametrize("which", [0, 4, 7])
def test_a_sensor_that_drifts_is_named_and_without_spare_ones_nothing_is_said(which: int) -> None:
    rng = np.random.default_rng(1)
    frame, before, after = experiment(8, 3)
    after[:, which] += rng.uniform(-1.0, 1.0, len(after)) * MM
    assert f"sensor '{frame.names[which]}' is left out" in " ".join(wrong(frame, before, after))
    frame, before, after = experiment(6, 3)
    after[:, 2] = 2.0 * before[:, 2] - after[:, 2]
    assert wrong(frame, before, after) == ()


def test_units_and_beams_that_miss_are_named() -> None:
    frame, before, after = experiment(8, 5)
    with pytest.raises(InputError, match=r"sensor 'S\d' changes by more than"):
        check_rows(DATA, frame, before, before + 1e3 * (after - before), np.zeros((12, 3)))
    placed = replace(frame, point=frame.position + 40.0 * MM * frame.direction)
    check_rows(DATA, placed, before, after, np.zeros((12, 3)))
    moved = replace(placed, position=placed.position - 0.06 * placed.direction * (np.arange(8) == 3)[:, None])
    with pytest.raises(InputError, match=r"beam of sensor 'S4' does not hit its stated plane"):
        check_rows(DATA, moved, before, after, np.zeros((12, 3)))


def test_the_simulated_frame_shows_what_the_tool_does() -> None:
    """The twin casts its beams into the cube; found again are the motions of the cube, within their noise."""
    rng, n = np.random.default_rng(4), 200
    first = pose.make(rotation.exp(rng.standard_normal((n, 3))), rng.uniform(-2.0, 2.0, (n, 3)))
    d = np.hstack([rng.uniform(-1, 1, (n, 3)) * 1.5e-3, rng.uniform(-1, 1, (n, 3)) * 2e-3])
    ends = np.stack([first, first @ pose.make(rotation.exp(d[:, 3:]), d[:, :3])], axis=1)
    s, sigma_m = distance_frame.read(ends, rng, 25)
    sensors = distance_frame.described()
    frame = frame_of(np.array([one["position_m"] for one in sensors]), np.array([one["direction"] for one in sensors]))
    found = motion(frame, s[:, 0], s[:, 1], np.full((n, 8), np.sqrt(2.0) * sigma_m), np.zeros((n, 3)))
    off = (found.d - d)[:, :3]
    # The frame stands turned by 0.05 deg: that share of the displacement goes along other axes.
    assert np.sqrt(np.mean(off**2)) < 1.5e-3 * 0.05 * DEG + 2.0 * sigma_m
    assert np.sqrt(np.mean((found.d - d)[:, 3:] ** 2)) < 20e-6
