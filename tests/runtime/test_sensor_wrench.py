"""The reading of the flange sensor on the bent arm, against the array form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.sensing.carrier import carrier_pose, carrier_to_tcp, hose_rotation
from counterflex.sensing.flange_sensor import FlangeSensor
from flange_wrench import tcp_wrench

DEMO = Path(counterflex.__file__).parent / "app" / "demo"


@pytest.mark.parametrize("hose_from", ["", "axis3", "axis4"])
@pytest.mark.parametrize("segment", ["sensor", "axis6"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_agrees_with_the_array_form(segment: str, seed: int, hose_from: str) -> None:
    cell = read_cell(DEMO / "cell.toml")
    rng = np.random.default_rng(seed)
    sensor = FlangeSensor(
        segment=segment,
        T_seg_sensor=pose.make(rotation.exp(0.3 * rng.normal(size=3)), 0.05 * rng.normal(size=3)),
        mass_kg=75.0,
        p_sensor_com=0.1 * rng.normal(size=3),
        w_bias=rng.normal(size=6),
        w_offset=rng.normal(size=(9, 6)),
        hose_from=hose_from,
    )
    q = np.array([0.2, -1.4, 1.7, 0.3, 0.6, -0.5]) + 0.1 * rng.normal(size=6)
    one = SensorWrench(cell.chain, sensor, cell.T_base_part)
    w_before = 200.0 * rng.normal(size=6) * [1, 1, 1, 0.1, 0.1, 0.1]
    one.w_base[:] = w_before
    w_sensor = 300.0 * rng.normal(size=6)
    found = one(q, w_sensor)
    R_base_sensor = carrier_pose(cell.chain, segment, q, w_before)[..., :3, :3] @ sensor.T_seg_sensor[:3, :3]
    np.testing.assert_allclose(one.R_base_sensor, R_base_sensor, atol=1e-12)
    R_hose_sensor = None
    if hose_from:
        R_hose_sensor = hose_rotation(cell.chain, hose_from, segment, q) @ sensor.T_seg_sensor[:3, :3]
    T_seg_tcp = carrier_to_tcp(cell.chain, segment)
    w_base = tcp_wrench(sensor, w_sensor, R_base_sensor, T_seg_tcp, R_hose_sensor=R_hose_sensor)
    np.testing.assert_allclose(found, pose.rotate_wrench(cell.T_base_part[:3, :3].T, w_base), rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(one.w_base, w_base, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("damaged", ["reading", "angles"])
def test_one_damaged_reading_does_not_stay(bad: float, damaged: str) -> None:
    """The last wrench bends the arm of the next sample: a NaN in it was in every one that came after it."""
    cell, q, w_sensor = read_cell(DEMO / "cell.toml"), np.array([0.2, -1.4, 1.7, 0.3, 0.6, -0.5]), np.arange(6.0)
    sensor = FlangeSensor("sensor", np.eye(4), 75.0, np.array([0.1, 0.0, 0.0]))
    one = SensorWrench(cell.chain, sensor, cell.T_base_part)
    first = one(q, w_sensor).copy()
    broken = np.full(6, bad)
    one(*((q, broken) if damaged == "reading" else (broken, w_sensor)))
    assert not np.all(np.isfinite(one.w_part))  # it is shown as what it is
    np.testing.assert_array_equal(one(q, w_sensor), first)
