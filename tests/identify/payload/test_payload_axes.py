"""Axes of the wrench are told by the plain weight; a rest is neither as large as the weight nor dear in its mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import silent
from counterflex.core.units import STANDARD_GRAVITY
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.geometry import rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.payload.data import readings, sensor_before
from counterflex.identify.payload.recipe import RECIPE
from counterflex.identify.payload.residuals import SensorReadings
from counterflex.identify.recipe import Identification
from counterflex.sensing.carrier import carrier_pose
from counterflex.sensing.flange_sensor import FlangeSensor

CELL = model_of(read_cell("examples/cells/kr300_d16_small.toml"))
SIGMA = np.r_[np.full(3, 0.1), np.full(3, 0.01)]
MASS_KG, COM = 1.24, np.array([0.004, -0.01, 0.05])


@cache
def _angles(count: int = 24) -> Float:
    columns = RECIPE.propose(CELL, count, {}).columns
    return np.stack([columns[f"q{i}_rad"] for i in range(1, 7)], axis=1)


def _rotations(q: Float) -> Float:
    return carrier_pose(CELL.chain, "sensor", q)[:, :3, :3]


def _shown(q: Float, zero: Float, mass_kg: float = MASS_KG) -> Float:
    """A weight on a string, by hand: force along gravity, moment of its lever, both in sensor axes."""
    down = np.swapaxes(_rotations(q), 1, 2) @ np.array([0.0, 0.0, -mass_kg * STANDARD_GRAVITY])
    w = np.concatenate([down, np.cross(COM, down)], axis=1) + zero
    return np.asarray(w + SIGMA * np.random.default_rng(3).standard_normal(w.shape))


def _turned(R: Float, w: Float) -> Float:
    return np.asarray((R[:, None] @ w.reshape(-1, 2, 3, 1)).reshape(-1, 6))


def _dataset(w: Float, **channels: Float) -> Dataset:
    return of_arrays("poses", "sensor_poses", {**(channels or {"q": _angles()}), "w_sensor": w}, {"w_sensor": SIGMA})


def _run(data: Dataset, **settings: object) -> Identification:
    return RECIPE.identify(CELL, [data], [], settings, silent)


def _mass(found: Identification) -> float:
    return float(found.fits["payload"].values[6])


ZERO = np.array([4.0, -3.0, 2.0, 0.2, 0.1, -0.1])
MISTAKES: list[tuple[str, Callable[[Float, Float], Float]]] = [
    ("'w_sensor' is in base axes", lambda R, w: _turned(R, w)),
    ("'w_sensor' is in base axes, not in those of the sensor, and its sign is reversed", lambda R, w: -_turned(R, w)),
    ("'w_sensor' was turned by the transposed rotation", lambda R, w: _turned(np.swapaxes(R, 1, 2), w)),
    ("the sign of 'w_sensor' is reversed", lambda _R, w: -w),
]


@pytest.mark.parametrize(("says", "change"), MISTAKES, ids=["base", "base, sign", "transposed", "sign"])
@pytest.mark.parametrize("zero", [0.0, 1.0], ids=["no zero", "zero"])
def test_axes_of_a_light_weight_are_told_before_a_rest_takes_them(
    says: str, change: Callable[[Float, Float], Float], zero: float
) -> None:
    w = change(_rotations(_angles()), _shown(_angles(), zero * ZERO))
    with pytest.raises(InputError) as fault:
        _run(_dataset(w))
    assert f"the data suggest that {says}" in str(fault.value)
    assert "1.24 kg" in str(fault.value)


def test_without_moments_of_its_own_a_weight_in_base_axes_is_told_by_finding_none() -> None:
    """A zero of nothing and a lever of nothing: the force is constant and any zero explains it."""
    down = np.tile([0.0, 0.0, -MASS_KG * STANDARD_GRAVITY, 0.0, 0.0, 0.0], (len(_angles()), 1))
    w = down + SIGMA * np.random.default_rng(1).standard_normal(down.shape)
    with pytest.raises(InputError, match="is in base axes"):
        _run(_dataset(w))


def test_right_data_pass_and_keep_no_rest_that_costs_the_mass() -> None:
    found = _run(_dataset(_shown(_angles(), ZERO)))
    assert _mass(found) == pytest.approx(MASS_KG, abs=0.02)
    assert found.fits["payload"].sigma_of("mass") < 0.01


def test_a_rest_that_makes_the_mass_60_times_less_sure_is_not_taken() -> None:
    """A ripple of the forces just above the noise, of the form of a rest in the base: it would help."""
    R = _rotations(_angles())
    w = _shown(_angles(), ZERO)
    w[:, :3] += 0.36 * R[:, 0, :] + 0.3 * R[:, 1, ::-1]
    found = _run(_dataset(w))
    assert any("were not used" in r and "times larger" in r for r in found.remarks)
    assert _mass(found) == pytest.approx(MASS_KG, abs=0.05)
    assert found.fits["payload"].sigma_of("mass") < 0.05


def test_a_rest_as_large_as_the_weight_is_refused() -> None:
    R = _rotations(_angles())
    w = _shown(_angles(), ZERO)
    w[:, :3] += 25.0 * R[:, 0, :] + 20.0 * R[:, 1, ::-1]
    with pytest.raises(InputError, match="hose terms reach"):
        _run(_dataset(w), hose="1", hose_from="base", offset_n=30.0)
    insisted = _run(_dataset(w), hose="1", hose_from="base", offset_n=30.0, as_stated=True)
    assert any("used, as requested" in r for r in insisted.remarks)


def _given(name: str) -> tuple[Dataset, Float]:
    """Orientation by the tool's rotation; its true rotations."""
    chain = CELL.chain
    R = carrier_pose(chain, chain.names[-1], _angles())[:, :3, :3] @ chain.T_last_tcp[:3, :3]
    return _dataset(_shown(_angles(), ZERO), **{name: R}), R


@pytest.mark.parametrize(
    ("says", "change"),
    [
        ("the rotations 'R_base_tcp' are transposed", lambda R: np.swapaxes(R, 1, 2).copy()),
        (
            "the quaternions 'R_base_tcp' are in the order wxyz, not xyzw",
            lambda R: rotation.from_quat_wxyz(np.roll(rotation.quat_wxyz(R), 1, -1)),
        ),
        (
            "the quaternions 'R_base_tcp' are in the order xyzw, not wxyz",
            lambda R: rotation.from_quat_wxyz(np.roll(rotation.quat_wxyz(R), -1, -1)),
        ),
    ],
    ids=["transposed", "wxyz", "xyzw"],
)
def test_rotations_read_wrongly_are_told(says: str, change: Callable[[Float], Float]) -> None:
    data, R = _given("R_base_tcp")
    assert _mass(_run(data)) == pytest.approx(MASS_KG, abs=0.05)
    old = data.channel("R_base_tcp")
    wrong = replace(data, channels={**data.channels, "R_base_tcp": replace(old, values=change(R))})
    with pytest.raises(InputError) as fault:
        _run(wrong)
    assert says in str(fault.value)


MANIFEST = """
format = "counterflex-dataset"
version = 1
name = "in base axes"
kind = "{kind}"
[[files]]
path = "w.csv"
[channels.q]
columns = ["q1", "q2", "q3", "q4", "q5", "q6"]
unit = "rad"
[channels.w_sensor]
columns = ["fx", "fy", "fz", "mx", "my", "mz"]
unit = ["N", "N m"]
sigma = [0.1, 0.01]
axes = "{axes}"
"""


def _written(folder: Path, axes: str, kind: str = "sensor_poses") -> Path:
    w = _turned(_rotations(_angles()), _shown(_angles(), ZERO))
    rows = [",".join(f"{v:.9g}" for v in row) for row in np.concatenate([_angles(), w], axis=1)]
    (folder / "w.csv").write_text("q1,q2,q3,q4,q5,q6,fx,fy,fz,mx,my,mz\n" + "\n".join(rows) + "\n")
    (folder / "w.toml").write_text(MANIFEST.format(axes=axes, kind=kind))
    return folder / "w.toml"


def test_the_manifest_says_base_axes(tmp_path: Path) -> None:
    found = _run(read_dataset(_written(tmp_path, "base")))
    assert _mass(found) == pytest.approx(MASS_KG, abs=0.02)
    with pytest.raises(InputError, match='write axes = "base" under'):
        _run(read_dataset(_written(tmp_path, "sensor")))
    with pytest.raises(FileFormatError, match="axes of the sensor"):
        read_dataset(_written(tmp_path, "base", kind="record"))


def test_sensor_axes_called_base_are_told() -> None:
    data = replace(_dataset(_shown(_angles(), ZERO)), settings={"w_sensor_axes": "base"})
    with pytest.raises(InputError, match="is in sensor axes, not in those of the base"):
        _run(data)


def test_a_motion_without_angles_needs_an_accelerometer() -> None:
    """Rotations alone say nothing of the sensor's path: its acceleration was taken as zero, silently."""
    t: Float = 4e-3 * np.arange(400, dtype=np.float64)
    R = rotation.exp(np.stack([0.3 * np.sin(2.0 * t), 0.0 * t, 0.0 * t], axis=1))
    channels: dict[str, Float] = {"time_s": t, "R_base_flange": R, "w_sensor": np.zeros((400, 6))}
    sensor = sensor_before(CELL)
    with pytest.raises(FileFormatError, match="acceleration"):
        _readings(channels, sensor)
    still = np.tile([0.0, 0.0, STANDARD_GRAVITY], (400, 1))
    assert len(_readings({**channels, "accelerometer_sensor": still}, sensor).group) > 0


def _readings(channels: dict[str, Float], sensor: FlangeSensor) -> SensorReadings:
    data = of_arrays("motion", "sensor_motion", channels, {"w_sensor": SIGMA})
    return readings(data, CELL.chain, sensor, reference_c=20.0, start_s=0.0, window_s=0.1)
