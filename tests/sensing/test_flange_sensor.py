"""Flange sensor: signs, Newton-Euler, the wrench at the tool, and the frame it measures in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import STANDARD_GRAVITY
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward, forward_elastic
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Segment
from counterflex.sensing.carrier import carrier_pose, carrier_to_tcp, hose_bodies, hose_rotation, mass_behind
from counterflex.sensing.flange_sensor import FlangeSensor, tensor
from flange_wrench import SensorMotion, idle_wrench, process_wrench, tcp_wrench

RNG = np.random.default_rng(5)


def sensor(**changes: object) -> FlangeSensor:
    plain = FlangeSensor("sensor", pose.make(p=np.array([0.0, 0.0, 0.03])), 75.0, np.array([0.12, 0.01, 0.07]))
    return replace(plain, **changes)  # type: ignore[arg-type]


def chain() -> ElasticChain:
    robot = catalog.load("kuka_kr300_r2500_ultra")
    soft = np.array([0.0, 0.0, 0.0, 3e-7, 3e-7, 2e-7])
    bodies = (
        Segment("sensor", pose.make(p=np.array([0.0, 0.0, 0.03])), compliance=soft, mass_kg=11.0),
        Segment(
            "spindle",
            pose.make(rotation.about_y(0.3), np.array([0.0, 0.0, 0.05])),
            compliance=10.0 * soft,
            mass_kg=60.0,
            p_seg_com=np.array([0.1, 0.0, 0.05]),
        ),
        Segment("clamp", pose.make(p=np.array([0.1, 0.02, 0.0])), mass_kg=15.0, p_seg_com=np.array([0.0, 0.0, 0.1])),
    )
    T = pose.make(rotation.about_y(np.pi / 2), np.array([0.15, 0.0, 0.07]))
    return ElasticChain.build(robot, EndEffector(bodies, T))


Q = np.radians([[0.0, -90.0, 90.0, 10.0, 40.0, 5.0], [30.0, -70.0, 100.0, 40.0, 50.0, -60.0]])


def test_a_hanging_tool_shows_a_force_along_gravity() -> None:
    w = idle_wrench(sensor(), np.eye(3))
    np.testing.assert_allclose(w[:3], [0.0, 0.0, -75.0 * STANDARD_GRAVITY])
    np.testing.assert_allclose(w[3:], np.cross([0.12, 0.01, 0.07], w[:3]))


def test_bias_drift_temperature_and_orientation_add_up() -> None:
    coefficients = RNG.standard_normal((9, 6))
    full = sensor(
        w_bias=np.arange(6.0),
        w_drift_per_s=np.full(6, 0.01),
        w_kelvin=np.full(6, 0.5),
        reference_c=22.0,
        w_offset=coefficients,
    )
    R = rotation.exp(np.array([0.3, -0.2, 0.9]))
    plain = idle_wrench(sensor(), R)
    w = idle_wrench(full, R, temperature_c=24.0, time_s=100.0)
    rest = np.sqrt(3.0) * R.reshape(-1) @ coefficients
    np.testing.assert_allclose(w, plain + np.arange(6.0) + 1.0 + 1.0 + rest)


def test_inertia_agrees_with_point_masses() -> None:
    """Newton's law summed over six points that move with the sensor."""
    m, r = np.array([3.0, 5, 2, 4, 1, 6]), RNG.uniform(-0.3, 0.3, (6, 3))
    com = m @ r / m.sum()
    d = r - com
    about = sum(mi * ((di @ di) * np.eye(3) - np.outer(di, di)) for mi, di in zip(m, d, strict=True))
    body = sensor(
        mass_kg=float(m.sum()),
        p_sensor_com=com,
        inertia_kg_m2=np.array([about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2]]),
    )
    np.testing.assert_allclose(tensor(body.inertia_kg_m2), about)
    R = rotation.exp(RNG.standard_normal(3))
    a, omega, alpha = RNG.standard_normal((3, 3))
    g = R.T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
    at = a + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
    force = m[:, None] * (g - at)
    expected = np.concatenate([force.sum(axis=0), np.cross(r, force).sum(axis=0)])
    np.testing.assert_allclose(idle_wrench(body, R, motion=SensorMotion(a, omega, alpha)), expected, atol=1e-12)


def test_the_process_comes_back_at_the_tool() -> None:
    c, s = chain(), sensor(w_bias=np.array([20.0, -5, 3, 1, 2, -1]))
    T_base_seg = carrier_pose(c, "sensor", Q)
    R = T_base_seg[..., :3, :3] @ s.T_seg_sensor[:3, :3]
    T_seg_tcp = carrier_to_tcp(c, "sensor")
    w_tcp_base = np.array([[300.0, -200, 100, 5, -3, 2], [-50.0, 400, 30, -1, 6, 0]])
    T_tcp = T_base_seg @ T_seg_tcp
    about_sensor = pose.shift_wrench(w_tcp_base, T_tcp[:, :3, 3] - (T_base_seg @ s.T_seg_sensor)[:, :3, 3])
    reading = idle_wrench(s, R) + pose.rotate_wrench(np.swapaxes(R, -1, -2), about_sensor)
    np.testing.assert_allclose(tcp_wrench(s, reading, R, T_seg_tcp), w_tcp_base, atol=1e-10)
    np.testing.assert_allclose(process_wrench(s, idle_wrench(s, R), R), 0.0, atol=1e-12)


def test_the_carrier_bends_as_the_chain_does() -> None:
    c = chain()
    load = np.array([400.0, -300, 200, 10, 5, -5])
    last = carrier_pose(c, "clamp", Q, np.broadcast_to(load, (2, 6)))
    bent = forward_elastic(c, Q, load, gravity=True)
    rigid = forward(c, Q)
    moved = pose.difference(rigid, bent)
    ours = pose.difference(rigid, last @ c.T_last_tcp)
    assert np.max(np.abs(moved[:, :3])) > 1e-3
    np.testing.assert_allclose(ours[:, :3], moved[:, :3], atol=30e-6)
    np.testing.assert_allclose(ours[:, 3:], moved[:, 3:], atol=20e-6)
    np.testing.assert_allclose(carrier_pose(c, "clamp", Q, elastic=False) @ c.T_last_tcp, rigid, atol=1e-12)


def test_what_hangs_behind_a_body() -> None:
    c = chain()
    mass, com = mass_behind(c, "sensor")
    T_sensor_spindle = pose.make(rotation.about_y(0.3), np.array([0.0, 0.0, 0.05]))
    first = pose.transform(T_sensor_spindle, np.array([0.1, 0.0, 0.05]))
    second = pose.transform(T_sensor_spindle, np.array([0.1, 0.02, 0.1]))
    assert mass == 75.0
    np.testing.assert_allclose(com, (60.0 * first + 15.0 * second) / 75.0)
    assert mass_behind(c, "clamp")[0] == 0.0
    with pytest.raises(InputError, match="an axis lies between|an axis moves between"):
        mass_behind(c, c.names[0])
    with pytest.raises(InputError, match="no such body"):
        carrier_pose(c, "nothing", Q)


def test_its_record_holds_what_kernels_need() -> None:
    offset: Float = RNG.standard_normal((9, 6))
    s = sensor(w_offset=offset)
    one = s.record()[0]
    assert (one.mass, one.functions, one.reference_c) == (75.0, 9, s.reference_c)
    np.testing.assert_array_equal(one.offset[:9], offset)
    assert not one.offset[9:].any()


def test_bad_constants_are_named() -> None:
    with pytest.raises(InputError, match="mass_kg"):
        sensor(mass_kg=-1.0)
    with pytest.raises(InputError, match="w_bias"):
        sensor(w_bias=np.zeros(3))
    with pytest.raises(InputError, match="functions of the orientation"):
        sensor(w_offset=np.zeros((15, 6)))


def test_a_hose_goes_by_how_the_sensor_stands_in_the_arm() -> None:
    """Axes before the forearm turn both clamps of a hose alike; those behind it do not."""
    one = chain()
    R = hose_rotation(one, "axis4", "sensor", Q[0])
    T_base_arm, T_base_seg = (carrier_pose(one, body, Q[0], elastic=False) for body in ("axis4", "sensor"))
    np.testing.assert_allclose(T_base_arm[:3, :3] @ R, T_base_seg[:3, :3], atol=1e-12)
    for axis, moves in ((0, False), (2, False), (3, False), (4, True), (5, True)):
        q = Q[0].copy()
        q[axis] += 0.3
        assert np.allclose(hose_rotation(one, "axis4", "sensor", q), R, atol=1e-12) != moves


def test_a_rest_that_goes_by_the_arm_needs_its_rotation() -> None:
    full = sensor(w_offset=RNG.standard_normal((9, 6)), hose_from="axis4")
    with pytest.raises(InputError, match=r"R_hose_sensor"):
        idle_wrench(full, np.eye(3))
    for body in ("spindle", "axis6", "nowhere"):
        with pytest.raises(InputError, match=r"no such body|cannot come from there"):
            hose_rotation(chain(), body, "sensor", Q)
    assert hose_bodies(chain(), "sensor")[-1] == "axis5"
