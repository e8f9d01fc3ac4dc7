"""The twin's force sensors: frame of beams against closed forms, sensor against statics, faults of the instruments."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.errors import InputError, ModelError
from counterflex.core.progress import silent
from counterflex.geometry import pose, rotation
from counterflex.geometry.rotation import skew
from counterflex.twin.laboratory import holder_loads as measure_holder_loads, sensor_poses as measure_sensor_poses
from counterflex.twin.laboratory.holder_loads import SideCut, cut_record
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.plant.force_sensor import force_sensor, sensor_place
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_changes import Hose
from counterflex.twin.plant.strain_holder import (
    HYSTERESIS_AT,
    HYSTERESIS_SHARE,
    PAPER_GAUGES,
    PAPER_TCP_M,
    HolderShape,
    hysteresis,
    instrumented_holder,
)
from counterflex.twin.truth.file import from_dict, to_dict
from counterflex.twin.truth.truth import SensorPlace, Truth

PLAIN = HolderShape(
    thickness_m=(0.015, 0.015),
    width_m=(0.12, 0.12),
    notch_z_m=(),
    base_m=2.0,
    ring_m=2.0,
    e_pa=210e9,
    poisson_ratio=0.3,
)


def test_frame_of_prismatic_cheeks_bends_as_beams_do() -> None:
    frame = PLAIN.strain_frame()
    area, inertia = 0.015 * 0.12, 2.0 * 0.015 * 0.12**3 / 12.0
    axial = frame.strain(np.array([0.0875, 0.0, 0.07]), 0.0)
    assert axial[2] == pytest.approx(1.0 / (2.0 * area * 210e9), rel=1e-3)
    across = frame.strain(np.array([0.0875, 0.0, 0.07]), 0.5 * np.pi)
    assert across[2] == pytest.approx(-0.3 * axial[2], rel=1e-6)
    h, z, y = 0.42, 0.05, 0.03
    load = np.array([0.0, 1.0, 0.0, -h, 0.0, 0.0])
    assert frame.strain(np.array([0.0875, y, z]), 0.0) @ load == pytest.approx(
        -(h - z) * y / (210e9 * inertia), rel=2e-3
    )


def test_shear_strain_turns_with_twice_the_angle() -> None:
    frame = HolderShape().strain_frame()
    p = np.array([0.0725, 0.01, 0.1])
    e0, e45, e90, e135 = (frame.strain(p, a) for a in np.radians([0.0, 45.0, 90.0, 135.0]))
    np.testing.assert_allclose(e0 + e90, e45 + e135, rtol=1e-9, atol=1e-18)


def test_more_elements_change_nothing() -> None:
    coarse, fine = (HolderShape().strain_frame(n) for n in (40, 120))
    p = np.array([0.0875, 0.03, 0.061])
    np.testing.assert_allclose(coarse.strain(p, 0.3), fine.strain(p, 0.3), rtol=0.02, atol=1e-12)


_PRINTED = """
import hashlib
from counterflex.twin.plant.strain_holder import HolderShape
frame = HolderShape().strain_frame()
print(hashlib.sha256(frame.end_forces.tobytes() + frame.compliance.tobytes()).hexdigest())
"""


def test_the_frame_is_the_same_bit_for_bit_on_any_number_of_threads() -> None:
    """Solved all at once, its last bits, and all that a simulated holder shows, depended on the machine's cores."""
    printed = {
        subprocess.run(
            [sys.executable, "-c", _PRINTED],
            env=os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2", "4")
    }
    assert len(printed) == 1


def test_work_is_the_same_both_ways() -> None:
    C = HolderShape().strain_frame().compliance
    G = np.eye(6)
    G[3:, :3] = [[0.0, -0.18, 0.0], [0.18, 0.0, 0.0], [0.0, 0.0, 0.0]]
    about_ring = C @ G  # displacement of the ring per load at the ring
    np.testing.assert_allclose(about_ring, about_ring.T, rtol=1e-6, atol=1e-16)


def test_holder_is_stiffest_along_the_cheeks() -> None:
    frame, p = HolderShape().strain_frame(), np.array(PAPER_TCP_M)
    arm = p - np.array([0.0, 0.0, frame.shape.length_m])
    at_tip = np.concatenate([np.eye(3), -skew(arm)], axis=1) @ frame.compliance @ np.concatenate([np.eye(3), skew(p)])
    x, y, z = np.diag(at_tip)
    assert 0.02e-6 < x < 0.2e-6
    assert 0.02e-6 < y < 0.2e-6
    assert z < 0.5 * min(x, y)


def test_hysteresis_opens_a_loop_of_its_size() -> None:
    top = 20e-6
    load = np.concatenate([np.linspace(0, top, 100), np.linspace(top, -top, 200), np.linspace(-top, top, 200)])[:, None]
    extra = hysteresis(load)
    up, down = extra[400, 0], extra[200, 0]
    assert up - down == pytest.approx(2.0 * HYSTERESIS_SHARE * sum(HYSTERESIS_AT), rel=1e-6)
    np.testing.assert_allclose(extra[99], extra[-1])


def test_gauges_of_two_laboratories_differ_and_repeat() -> None:
    a, b, c = (instrumented_holder(PAPER_GAUGES, seed).sensitivity for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert 0.005 < np.linalg.norm(a - c) / np.linalg.norm(a) < 0.3


def test_the_cut_has_the_force_of_its_chip() -> None:
    """Mean over a revolution: work per volume, u = kc h^-m, times removal rate, is force along the cutting speed."""
    cut = SideCut(exponent=0.0, radial_share=0.0, axial_share=0.0, runout_m=0.0)
    t = np.linspace(0.0, 2.0 * np.pi / cut.speed_rad_s, 3000, endpoint=False)
    fine = cut.force(t, np.ones(len(t)))
    start = np.pi - np.arccos(1.0 - cut.width_m / (0.5 * cut.diameter_m))
    f_z = cut.feed_m_s * 2.0 * np.pi / cut.speed_rad_s / cut.flutes
    phi = np.linspace(start, np.pi, 4001)
    h = f_z * np.sin(phi)
    weight = cut.kc_pa * cut.depth_m * cut.flutes / (2.0 * np.pi)
    expected = weight * np.array([np.trapezoid(-h * np.cos(phi), phi), np.trapezoid(h * np.sin(phi), phi)])
    np.testing.assert_allclose(fine.mean(axis=0)[:2], expected, rtol=0.02)
    assert np.all(cut.force(t, np.zeros(len(t))) == 0.0)


def test_a_cut_record_has_air_before_and_after() -> None:
    holder = instrumented_holder(PAPER_GAUGES, 0)
    t, force, strain, warm = cut_record(holder, np.array(PAPER_TCP_M), np.random.default_rng(0), length_s=0.6)
    assert strain.shape == (600, 6)
    assert np.all(force[t < 0.14] == 0.0)
    assert np.all(force[t > 0.55] == 0.0)
    assert force[(t > 0.28) & (t < 0.4)].mean(axis=0)[0] > 30.0
    assert warm[-1] > warm[0]


def test_loads_need_columns_and_gauges(truth: Truth) -> None:
    request = {name: np.array([100.0]) for name in measure_holder_loads.COLUMNS}
    with pytest.raises(InputError, match="gauges"):
        measure_holder_loads.measure(truth, laboratory(0), request, {}, silent)
    del request["fy_n"]
    with pytest.raises(InputError, match="fy_n"):
        measure_holder_loads.measure(truth, laboratory(0), request, {"gauges": PAPER_GAUGES}, silent)


def test_sensor_without_faults_shows_the_weight(truth: Truth) -> None:
    sensor = force_sensor(truth, 0, hose_share=0.0)
    plant = Plant(truth)
    plant.reset(np.radians([0.0, -90.0, 90.0, 0.0, 40.0, 0.0]))
    w = sensor.true_wrench(plant, truth.gravity_base)
    behind = truth.bodies[[b.name for b in truth.bodies].index(sensor.segment) + 1 :]
    T_base_sensor = plant.body_pose(sensor.segment) @ sensor.T_seg_sensor
    weight = sum(b.mass_kg * truth.gravity_base for b in behind)
    np.testing.assert_allclose(T_base_sensor[:3, :3] @ w[:3], weight, atol=1e-6)
    about = sum(
        np.cross(
            pose.transform(plant.body_pose(b.name), b.p_seg_com) - T_base_sensor[:3, 3], b.mass_kg * truth.gravity_base
        )
        for b in behind
    )
    np.testing.assert_allclose(T_base_sensor[:3, :3] @ w[3:], about, atol=1e-5)


def test_hose_hangs_pulls_and_bends() -> None:
    hose = Hose(
        np.zeros(3), np.zeros(3), np.array([1.0, 0, 0]), mass_kg=2.0, slack_m=0.5, pull_n_m=40.0, bending_nm=3.0
    )
    g = np.array([0.0, 0.0, -9.80665])
    slack = hose.on_tool(pose.make(p=np.array([0.4, 0, 0])), np.eye(4), g)[1]
    np.testing.assert_allclose(slack, [0, 0, -9.80665, 0, 0, 0], atol=1e-12)
    tight = hose.on_tool(pose.make(p=np.array([0.0, 0.7, 0])), np.eye(4), g)[1]
    np.testing.assert_allclose(tight, [0, 8.0, -9.80665, 0, 0, 3.0], atol=1e-12)


def test_readings_repeat_and_sessions_differ_only_by_noise(truth: Truth) -> None:
    q = np.radians([[0.0, -90.0, 90.0, 0.0, 40.0, 0.0], [10.0, -80.0, 95.0, 60.0, 70.0, 30.0]])
    request = {f"q{i + 1}_rad": q[:, i] for i in range(6)}
    a, b = (measure_sensor_poses.measure(truth, laboratory(4), request, {}, silent) for _ in range(2))
    np.testing.assert_array_equal(a.channels["w_sensor"], b.channels["w_sensor"])
    other = measure_sensor_poses.measure(truth, laboratory(5), request, {}, silent)
    assert np.max(np.abs(other.channels["w_sensor"] - a.channels["w_sensor"])) > 1.0


def test_a_sensor_needs_something_behind_it(truth: Truth) -> None:
    with pytest.raises(InputError, match="no force sensor can sit there"):
        sensor_place(truth, truth.bodies[-1].name)


def test_the_truth_says_where_its_sensor_sits(truth: Truth) -> None:
    """A cell file that has learnt how the sensor is turned does not turn the true one once more."""
    turn = pose.make(rotation.about_z(0.5), np.array([0.0, 0.0, 0.01]))
    placed = replace(truth, sensor=SensorPlace("haehn2020_sensor", turn))
    for one in (placed, from_dict(to_dict(placed))):
        found = force_sensor(one, 4)
        expected = turn @ force_sensor(truth, 4).T_seg_sensor
        np.testing.assert_allclose(found.T_seg_sensor, expected, atol=1e-12)
    with pytest.raises(InputError, match="sits elsewhere"):
        force_sensor(placed, 4, "axis6")
    with pytest.raises(ModelError, match="body of the truth's sensor"):
        replace(truth, sensor=SensorPlace("nothing", turn))
