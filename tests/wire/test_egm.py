"""EGM messages: observed bytes, both force forms, round trips, garbage."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from counterflex.core.errors import ProtocolError
from counterflex.geometry import pose, rotation
from counterflex.wire.egm import (
    RobotState,
    measured_force,
    read_guidance,
    read_path_correction,
    read_robot,
    write_guidance,
    write_path_correction,
    write_robot,
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
    back = read_robot(write_robot(state, robotware=robotware))
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
