"""Recipe tracker-frame: closed forms, recovery on the simulated cell, honest intervals, drift, and bad data named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.hand_eye import of_points, of_poses
from counterflex.identify.geometry.hand_eye_robust import robust_of_points, robust_of_poses
from counterflex.identify.geometry.known_frames import KnownFrames, known_frames
from counterflex.identify.recipe import Identification
from counterflex.identify.tracker_frame import recipe as tracker_frame
from counterflex.identify.tracker_frame.considered import drifts
from counterflex.identify.tracker_frame.proposal import propose
from counterflex.twin.laboratory import fiducials as measure_fiducials, tracker_poses as measure_tracker_poses
from counterflex.twin.laboratory.laboratory import Laboratory, Measured, laboratory

FILE = read_cell("examples/cells/kr300_d10_ball.toml")
CELL = model_of(FILE)
RNG = np.random.default_rng(5)


def dataset(kind: str, measured: Measured) -> Dataset:
    arrays = {k: rotation.exp(v) if k.startswith("R_") else v for k, v in measured.channels.items()}
    return of_arrays(kind, kind, arrays, measured.sigma, group=measured.group, settings=measured.settings)


def _fiducials(lab: Laboratory, settings: Mapping[str, Any] | None = None, count: int = 8) -> Dataset:
    request = propose(CELL, count, {"measure": "fiducials"}).columns
    return dataset("fiducials", measure_fiducials.measure(truth_of(FILE, 0), lab, request, settings or {}, silent))


@cache
def _poses(seed: int, count: int = 24) -> Dataset:
    request = propose(CELL, count, {"seed": seed}).columns
    truth = truth_of(FILE, seed)
    return dataset("tracker_poses", measure_tracker_poses.measure(truth, laboratory(seed), request, {}, silent))


def _identify(*data: Dataset) -> Identification:
    return tracker_frame.RECIPE.identify(CELL, data, [], {}, silent)


def _frames(found: Identification) -> KnownFrames:
    change = found.changes[0]
    assert isinstance(change, TableValues)
    known = known_frames(replace(CELL, tables={"tracker": change.values}))
    assert known is not None
    return known


def _random_setup(m: int) -> tuple[Float, Float, Float, Float]:
    A = pose.make(rotation.exp(RNG.normal(size=(m, 3))), RNG.normal(size=(m, 3)))
    Z = pose.make(rotation.exp(np.array([1.0, 2.0, 0.5])), np.array([3.0, 1.0, 2.0]))
    X = pose.make(rotation.exp(np.array([-1.0, 2.0, 0.5])), np.array([0.1, 0.02, 0.3]))
    return A, Z, X, pose.inverse(Z) @ A @ X


def test_hand_eye_is_exact_without_noise_and_survives_a_fifth_of_gross_errors() -> None:
    A, Z, X, B = _random_setup(40)
    found = of_poses(A, B)
    np.testing.assert_allclose(found[0], Z, atol=1e-12)
    np.testing.assert_allclose(found[1], X, atol=1e-12)
    tracker, target = of_points(A, B[:, :3, 3])
    np.testing.assert_allclose(tracker, Z, atol=1e-6)
    np.testing.assert_allclose(target[:3, 3], X[:3, 3], atol=1e-6)
    B[::5, :3, 3] += 0.5
    for robust in (robust_of_poses(A, B), robust_of_points(A, B[:, :3, 3])):
        np.testing.assert_allclose(robust.T_base_tracker, Z, atol=1e-6)
        assert np.array_equal(np.flatnonzero(~robust.good), np.arange(0, 40, 5))


def test_poses_that_turn_about_one_axis_leave_the_target_open() -> None:
    A, Z, X, _ = _random_setup(12)
    A[:, :3, :3] = rotation.about_z(np.linspace(0.0, 2.0, 12))
    with pytest.raises(InputError, match="two different axes"):
        of_poses(A, pose.inverse(Z) @ A @ X)


@pytest.mark.parametrize("seed", [0, 1])
def test_fiducials_place_the_tracker_within_its_stated_intervals(seed: int) -> None:
    lab = laboratory(seed)
    found = _frames(_identify(_fiducials(lab)))
    off = pose.inverse(found.T_base_tracker) @ lab.T_base_tracker
    step = np.concatenate([off[:3, 3], rotation.log(off[:3, :3])])
    assert found.sigma is not None
    assert np.all(np.abs(step) < 4.0 * found.sigma)
    assert np.max(found.sigma[:3]) < 60e-6
    assert np.max(found.sigma[3:]) < 20e-6


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_poses_and_fiducials_give_target_and_tracker_with_honest_intervals(seed: int) -> None:
    lab = laboratory(seed)
    result = _identify(_fiducials(lab), _poses(seed))
    found = _frames(result)
    off = pose.inverse(_seen_from_axis6(None) @ found.T_tcp_target) @ _seen_from_axis6(seed) @ lab.T_tcp_target
    assert found.target_sigma is not None
    assert np.all(np.abs(np.concatenate([off[:3, 3], rotation.log(off[:3, :3])])) < 4.0 * found.target_sigma)
    assert np.linalg.norm(off[:3, 3]) < 1.0e-3
    assert np.linalg.norm(found.T_base_tracker[:3, 3] - lab.T_base_tracker[:3, 3]) < 0.1e-3
    assert result.headline[0].name == "holdout_mean_mm"
    assert result.headline[0].value < 0.1


def _seen_from_axis6(seed: int | None) -> Float:
    """Tool tip in the frame of axis 6, as the cell file has it or as it is: each link may be off by 0.15 mm."""
    truth = truth_of(FILE, seed)
    after = next(i for i, body in enumerate(truth.bodies) if body.joint == 5) + 1
    T = np.eye(4)
    for body in truth.bodies[after:]:
        T = T @ body.T_prev_seg
    out: Float = T @ truth.T_last_tcp
    return out


def test_a_fiducial_that_was_moved_is_named() -> None:
    data = _fiducials(laboratory(0))
    p = data.values("p_tracker_fiducial").copy()
    p[3] += np.array([0.0, 0.002, 0.0])
    result = _identify(_with(data, "p_tracker_fiducial", p))
    assert any("fiducial 4" in remark and "off by" in remark for remark in result.remarks)
    found = _frames(result)
    assert np.linalg.norm(found.T_base_tracker[:3, 3] - laboratory(0).T_base_tracker[:3, 3]) < 0.1e-3


def test_drift_shows_where_there_is_one_and_only_there() -> None:
    still = _identify(_fiducials(laboratory(0), {"rounds": 2}))
    assert any("No drift beyond noise" in remark for remark in still.remarks)
    moved = _identify(_fiducials(laboratory(0), {"rounds": 2, "drift_um": [80.0, 0.0, 0.0], "drift_urad": [0, 0, 60]}))
    assert any("Drift, round 1" in remark for remark in moved.remarks)


def test_drift_is_significant_by_chance_as_often_as_stated() -> None:
    p = RNG.uniform(-2.0, 2.0, (8, 3))
    group, sigma = np.tile(np.arange(8), 2), np.full((16, 3), 20e-6)
    chance = [drifts(group, np.tile(p, (2, 1)) + 20e-6 * RNG.standard_normal((16, 3)), sigma)[0] for _ in range(300)]
    assert sum(d.significant for d in chance) <= 10
    assert 0.4 < np.mean([d.probability for d in chance]) < 0.6


def _with(data: Dataset, channel: str, values: Float) -> Dataset:
    old = data.channel(channel)
    return replace(data, channels={**data.channels, channel: replace(old, values=values)})


def test_bad_fiducials_are_named() -> None:
    data = _fiducials(laboratory(0))
    p = data.values("p_tracker_fiducial")
    with pytest.raises(InputError, match="left-handed"):
        _identify(_with(data, "p_tracker_fiducial", p * np.array([1.0, -1.0, 1.0])))
    with pytest.raises(InputError, match="two columns are swapped"):
        _identify(_with(data, "p_tracker_fiducial", p[:, [1, 0, 2]]))
    with pytest.raises(InputError, match="mm were read as m"):
        _identify(_with(data, "p_tracker_fiducial", 1000.0 * p))
    line = np.linspace(0.0, 3.0, len(p))[:, None] * np.array([[1.0, 0.5, 0.1]])
    with pytest.raises(InputError, match="on one line"):
        _identify(_with(_with(data, "p_tracker_fiducial", line), "p_base_fiducial", line))
    with pytest.raises(InputError, match="too few fiducials"):
        _identify(data.rows(data.group <= 3))


@pytest.mark.by_turn
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: _with(d, "q", np.degrees(d.values("q"))), "deg"),
        (lambda d: _with(d, "p_tracker_target", 1000.0 * d.values("p_tracker_target")), "1000 times too large"),
        (lambda d: _with(d, "q", d.values("q")[:, [0, 2, 1, 3, 4, 5]]), "swapped"),
        (lambda d: _with(d, "R_tracker_target", np.swapaxes(d.values("R_tracker_target"), 1, 2)), "transposed"),
        (
            lambda d: _with(
                d,
                "R_tracker_target",
                rotation.from_zyx(-rotation.to_zyx(np.swapaxes(d.values("R_tracker_target"), 1, 2))),
            ),
            "numbers of 'R_tracker_target' are",
        ),
        (lambda d: d.rows(np.arange(len(d)) < 3), "too few different poses"),
    ],
)
def test_bad_poses_are_named(change: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        _identify(change(_poses(0)))


def test_hand_eye_set_of_the_ur10() -> None:
    cell = model_of(read_cell("examples/cells/ur10_ipa_tmac.toml"))
    data = read_dataset("examples/data/ur10_ipa_tmac/hand_eye.toml")
    result = tracker_frame.RECIPE.identify(cell, [data], [], {}, silent)
    assert result.headline[0].value < 1.5
    known = known_frames(replace(cell, tables={"tracker": result.changes[0].values}))  # type: ignore[union-attr]
    assert known is not None
    # The target's centre is 93 mm from the flange (the cell's tcp is there), its axes turned by quarter turns.
    assert np.linalg.norm(known.T_tcp_target[:3, 3] + np.array([0.0, 0.0, 0.093])) > 0.05
    on_flange = cell.nominal_chain.T_flange_tcp @ known.T_tcp_target
    assert 0.08 < np.linalg.norm(on_flange[:3, 3]) < 0.105
