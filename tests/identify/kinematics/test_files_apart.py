"""A file whose tracker or target stands elsewhere than those of the others is named; one orientation will do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ReachError
from counterflex.core.progress import silent
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.arm_geometry import ArmGeometry, ArmLayout
from counterflex.identify.kinematics.recipe import RECIPE
from counterflex.identify.recipe import Identification
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import inverse

CELL = model_of(read_cell("examples/cells/kr300_d10_ball.toml"))
TRACKER = pose.make(rotation.exp(np.array([0.3, -2.0, 1.0])), np.array([4.0, -2.0, 1.5]))
TARGET = pose.make(rotation.exp(np.array([1.0, 0.5, -2.0])), np.array([0.05, 0.02, -0.1]))
SIGMA_M, SIGMA_RAD = 30e-6, 50e-6
OPTIONS = {"periodic": "off", "sag": "off", "folds": 2}


def _angles(rng: np.random.Generator, m: int, *, turning: bool) -> Float:
    near = np.radians([0.0, -95.0, 110.0, 10.0, 60.0, 0.0])
    if turning:
        return np.asarray(near + np.radians([25.0, 12.0, 12.0, 60.0, 40.0, 90.0]) * rng.uniform(-1.0, 1.0, (m, 6)))
    out: list[Float] = []
    middle = forward(CELL.nominal_chain, near)
    while len(out) < m:
        try:
            T = pose.make(middle[:3, :3], middle[:3, 3] + rng.uniform(-0.3, 0.3, 3))
            out.append(inverse(CELL.nominal_chain, T, near).q)
        except ReachError:
            continue
    return np.array(out)


@cache
def _file(
    name: str, m: int = 30, seed: int = 0, turning: bool = True, move: tuple[float, ...] = (), way: str = "tracker"
) -> Dataset:
    """Poses of an arm off by the usual, seen with the tracker or the target displaced by ``move`` (m, rad)."""
    rng = np.random.default_rng(100 + seed)
    names = [CELL.nominal_chain.names[i] for i in np.flatnonzero(CELL.nominal_chain.joint >= 0)][:-1]
    true = np.random.default_rng(5)
    moves = {n: np.concatenate([4e-4 * true.normal(size=3), 4e-4 * true.normal(size=3)]) for n in names}
    q = _angles(rng, m, turning=turning)
    step = np.array(move or (0.0,) * 6)
    D = pose.make(rotation.exp(step[3:]), step[:3])
    Z, X = (TRACKER @ D, TARGET) if way == "tracker" else (TRACKER, TARGET @ D)
    T = pose.inverse(Z) @ ArmGeometry(CELL.nominal_chain, ArmLayout({}, moves, {}, {}), q).poses(np.zeros(0)) @ X
    noise = np.concatenate([SIGMA_M * rng.normal(size=(m, 3)), SIGMA_RAD * rng.normal(size=(m, 3))], axis=1)
    T = pose.displaced(T, noise)
    return of_arrays(
        name,
        "tracker_poses",
        {"q": q, "p_tracker_target": T[:, :3, 3], "R_tracker_target": T[:, :3, :3]},
        {"p_tracker_target": SIGMA_M, "R_tracker_target": SIGMA_RAD},
    )


def _found(data: Sequence[Dataset], holdout: Sequence[Dataset] = (), **options: object) -> Identification:
    return RECIPE.identify(CELL, list(data), list(holdout), {**OPTIONS, **options}, silent)


AWAY = (0.1, -0.05, 0.2, 0.5, -1.0, 2.0)
FAR = (2.0, -1.0, 0.5, 0.5, -1.0, 2.0)
NEAR = (1.5e-3, 0.0, 0.0, 0.0, 4e-4, 0.0)


@pytest.mark.long
@pytest.mark.parametrize(("way", "move"), [("tracker", FAR), ("tracker", NEAR), ("target", AWAY), ("target", NEAR)])
def test_a_fitted_file_that_stands_apart_is_named(way: str, move: tuple[float, ...]) -> None:
    data = [_file("May"), _file("June", seed=1), _file("July", seed=2, move=move, way=way)]
    with pytest.raises(InputError) as fault:
        _found(data)
    text = str(fault.value)
    assert "July differs from the other data by one constant pose" in text
    assert f"of the {way} (" in text
    assert f'{way} = "a name of its own"' in text
    named = _found([*data[:2], replace(data[2], settings={way: "July"})])
    assert named.headline[0].value < 0.12


@pytest.mark.long
def test_as_stated_turns_it_into_a_remark() -> None:
    found = _found([_file("May"), _file("June", seed=1, move=NEAR)], as_stated=True)
    assert any("June differs" in r and "as requested" in r for r in found.remarks)


@pytest.mark.parametrize("way", ["tracker", "target"])
def test_a_held_out_file_that_stands_apart_is_named(way: str) -> None:
    data = [_file("May"), _file("June", seed=1)]
    with pytest.raises(InputError, match=f"July differs .* of the {way}"):
        _found(data, [_file("July", seed=2, move=FAR if way == "tracker" else AWAY, way=way)])
    near = _found(data, [_file("July", seed=2, move=NEAR, way=way)])
    assert any(f"July differs from the other data by one constant pose of the {way}" in r for r in near.remarks)


def test_files_that_belong_together_are_not_suspected() -> None:
    found = _found([_file("May"), _file("June", seed=1)], [_file("July", seed=2)])
    assert not any("differs" in r for r in found.remarks)
    assert found.headline[0].value < 0.12


@pytest.mark.long
def test_poses_of_one_orientation_use_the_target_that_others_fix() -> None:
    """Alone they are refused; beside others, or held out with a tracker of their own, six numbers are found."""
    flat = _file("milling-like", turning=False, move=FAR)
    with pytest.raises(InputError, match="have one orientation"):
        _found([flat])
    moved = replace(flat, settings={"tracker": "second"})
    held = _found([_file("May"), _file("June", seed=1)], [moved])
    assert held.headline[0].value < 0.1
    assert held.headline[0].nominal is not None
    assert held.headline[0].nominal > 2.0 * held.headline[0].value
    assert any("hardly turns the tool" in r for r in held.remarks)
    beside = _found([_file("May"), moved])
    assert beside.headline[0].value < 0.12
    points = replace(moved, kind="tracker_points", channels={k: c for k, c in moved.channels.items() if k[0] != "R"})
    assert _found([_file("May"), _file("June", seed=1)], [points]).headline[0].value < 0.1
