"""EGM messages: observed bytes, both force forms, round trips, garbage."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import ProtocolError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.link.telegram import (
    MESSAGES,
    RobotState,
    measured_force,
    read_guidance,
    read_path_correction,
    read_robot,
    write_guidance,
    write_path_correction,
)

VECTOR = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def test_path_correction_is_the_observed_bytes() -> None:
    wanted = "0a0408001804121f0a1b09" + struct.pack("<d", 0.0).hex() + "11" + struct.pack("<d", 0.5).hex()
    wanted += "19" + struct.pack("<d", -0.25).hex() + "1001"
    assert write_path_correction(0, 0.5e-3, -0.25e-3, 1e-3).hex() == wanted
    sequence, correction, age = read_path_correction(bytes.fromhex(wanted))
    assert sequence == 0
    assert age == pytest.approx(1e-3)
    assert correction == pytest.approx([0.0, 0.5e-3, -0.25e-3])


@given(VECTOR, VECTOR)
def test_guidance_round_trip(p: tuple[float, ...], turn: tuple[float, ...]) -> None:
    T = pose.make(rotation.exp(np.array(turn)), np.array(p))
    sequence, back, twist = read_guidance(write_guidance(9, T))
    assert sequence == 9
    np.testing.assert_array_equal(twist, np.zeros(6))
    np.testing.assert_allclose(back, T, atol=1e-12)


@pytest.mark.parametrize("robotware", [6, 7])
@given(VECTOR, VECTOR, st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_robot_round_trip(robotware: int, p: tuple[float, ...], turn: tuple[float, ...], q: list[float]) -> None:
    T = pose.make(rotation.exp(np.array(turn)), np.array(p))
    force = np.array([1.0, -2.0, 3.0, 0.1, 0.2, 0.3])
    state = RobotState(5, 123456, np.array(q), T, T, True, True, True, 0.5, force)
    back = read_robot(state.telegram(robotware=robotware))
    assert (back.sequence, back.time_ms, back.motors_on, back.guided, back.rapid_running) == (
        5,
        123456,
        True,
        True,
        True,
    )
    assert back.q is not None
    assert back.T_frame_tcp is not None
    assert back.force is not None
    np.testing.assert_allclose(back.q, q, atol=1e-12)
    np.testing.assert_allclose(back.T_frame_tcp, T, atol=1e-12)
    np.testing.assert_allclose(back.force, force)
    assert back.utilization == pytest.approx(0.5)


def test_force_of_an_inactive_sensor_is_none() -> None:
    assert measured_force(b"\x08\x00") is None
    assert measured_force(b"") is None
    with pytest.raises(ProtocolError, match="six numbers"):
        measured_force(b"\x09" + struct.pack("<d", 1.0))


@given(st.floats(), st.integers(0, 5), st.booleans())
def test_a_number_beyond_all_forces_makes_the_message_malformed(value: float, place: int, seven: bool) -> None:
    """It would stay in the loop's filters for minutes; a NaN is none either."""
    force = np.zeros(6)
    force[place] = value
    inside = MESSAGES["EgmForceSeven" if seven else "EgmForceSix"]()
    inside.force.extend(force.tolist())
    if abs(value) <= 1e6:
        assert np.array_equal(measured_force(inside.SerializeToString()), force)  # type: ignore[arg-type]
    else:
        with pytest.raises(ProtocolError, match="six numbers"):
            measured_force(inside.SerializeToString())


@given(st.binary(max_size=200))
def test_garbage_is_refused_or_harmless(data: bytes) -> None:
    for read in (read_robot, read_guidance, read_path_correction):
        try:
            read(data)
        except ProtocolError:
            continue


def test_numbers_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ProtocolError, match="not finite"):
        write_path_correction(0, float("nan"), 0.0, 0.0)
    data = write_guidance(1, np.eye(4)).replace(struct.pack("<d", 1.0), struct.pack("<d", float("inf")))
    with pytest.raises(ProtocolError, match="not finite"):
        read_guidance(data)


def varint(value: int) -> bytes:
    out = b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


def part(number: int, data: bytes) -> bytes:
    return varint(number << 3 | 2) + varint(len(data)) + data


def doubles(values: list[float], *, first: int = 1) -> bytes:
    return b"".join(varint(first + i << 3 | 1) + struct.pack("<d", v) for i, v in enumerate(values))


def repeated(number: int, values: list[float]) -> bytes:
    return b"".join(varint(number << 3 | 1) + struct.pack("<d", v) for v in values)


def test_guidance_with_a_speed_reference_is_written_field_by_field() -> None:
    T = pose.make(rotation.about_z(0.5), np.array([0.1, -0.2, 0.3]))
    twist = np.array([0.01, 0.0, -0.02, 0.1, 0.0, 0.0])
    header = varint(1 << 3) + varint(300) + varint(2 << 3) + varint(70_000) + varint(3 << 3) + varint(3)
    quat = rotation.quat_wxyz(T[:3, :3]).tolist()
    position = (T[:3, 3] / MM).tolist()
    speed = [*(twist[:3] / MM).tolist(), *(twist[3:] / DEG).tolist()]
    wanted = (
        part(1, header)
        + part(2, part(2, part(1, doubles(position)) + part(2, doubles(quat))))
        + part(3, part(2, repeated(1, speed)))
    )
    data = write_guidance(300, T, 70_000, twist)
    assert data == wanted
    sequence, back, seen = read_guidance(wanted)
    assert sequence == 300
    np.testing.assert_allclose(back, T, atol=1e-12)
    np.testing.assert_allclose(seen, twist, atol=1e-12)
    again = read_guidance(data)
    np.testing.assert_allclose(again[1], back, atol=1e-15)
    np.testing.assert_allclose(again[2], seen, atol=1e-15)


def test_a_robots_message_written_by_hand_is_read() -> None:
    joints = [1.0, -2.0, 3.0, -4.0, 5.0, -6.0]
    six, seven = repeated(1, [10.0] * 6), bytes([8, 1]) + repeated(2, [10.0] * 6)
    for force in (six, seven):
        data = (
            part(1, varint(8) + varint(9) + varint(16) + varint(1234) + varint(24) + varint(2))
            + part(
                2,
                part(1, repeated(1, joints))
                + part(2, part(1, doubles([1.0, 2.0, 3.0])) + part(2, doubles([1.0, 0.0, 0.0, 0.0]))),
            )
            + part(4, bytes([8, 1]))
            + part(5, bytes([8, 3]))
            + bytes([6 << 3, 1])
            + part(8, bytes([8, 2]))
            + part(9, force)
            + varint(10 << 3 | 1)
            + struct.pack("<d", 42.0)
            + bytes([11 << 3, 7])
            + part(13, repeated(1, [5.0]))  # RAPIDfromRobot of RobotWare 7: passed over
        )
        state = read_robot(data)
        assert (state.sequence, state.time_ms, state.move, state.converged) == (9, 1234, 7, True)
        assert (state.motors_on, state.guided, state.rapid_running) == (True, True, True)
        assert state.q is not None
        assert state.T_frame_tcp is not None
        assert state.force is not None
        np.testing.assert_allclose(state.q, np.radians(joints), atol=1e-12)
        np.testing.assert_allclose(state.T_frame_tcp[:3, 3], [1e-3, 2e-3, 3e-3], atol=1e-15)
        np.testing.assert_array_equal(state.force, 10.0)
        assert state.utilization == pytest.approx(0.42)


def test_a_pose_without_one_of_its_coordinates_is_no_pose_at_zero() -> None:
    """Fields that the protocol requires: a missing z was read as 0."""
    turned = part(2, doubles([1.0, 0.0, 0.0, 0.0]))
    head = part(1, varint(8) + varint(9) + varint(16) + varint(1234) + varint(24) + varint(2))
    joints = part(1, repeated(1, [0.0] * 6))
    for count in (1, 2):
        data = head + part(2, joints + part(2, part(1, doubles([1.0, 2.0][:count])) + turned)) + part(5, bytes([8, 3]))
        with pytest.raises(ProtocolError, match="feedBack.cartesian.pos.z"):
            read_robot(data)


def test_messages_of_the_other_side_are_refused() -> None:
    with pytest.raises(ProtocolError, match="not come from a robot"):
        read_robot(write_guidance(1, np.eye(4)))
    with pytest.raises(ProtocolError):
        read_guidance(write_path_correction(1, 0.0, 0.0, 0.0))
    with pytest.raises(ProtocolError):
        read_path_correction(write_guidance(1, np.eye(4)))


def test_a_plan_of_nothing_is_no_plan() -> None:
    """Before the movement a controller may send it empty or zero: each message was malformed, and nobody told why."""
    turned = part(2, doubles([1.0, 0.0, 0.0, 0.0]))
    back = part(1, repeated(1, [0.0] * 6)) + part(2, part(1, doubles([1.0, 2.0, 3.0])) + turned)
    head = part(1, varint(8) + varint(9) + varint(16) + varint(1234) + varint(24) + varint(2)) + part(5, bytes([8, 2]))
    zero = part(2, part(1, doubles([0.0] * 3)) + part(2, doubles([0.0] * 4)))
    for plan in (part(1, b"") + part(2, b""), zero, part(1, repeated(1, [0.0] * 7)) + zero):
        state = read_robot(head + part(2, back) + part(3, plan))
        assert state.missing == ()
        assert state.q_planned is None
        assert state.T_frame_tcp_planned is None
    with pytest.raises(ProtocolError, match="not finite"):
        read_robot(head + part(2, back) + part(3, part(1, repeated(1, [float("nan")] * 6))))
