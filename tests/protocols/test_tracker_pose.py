"""The neutral tracker datagram: round trips and refusals."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import ProtocolError
from counterflex.geometry import pose, rotation
from counterflex.protocols.tracker.telegram import DATAGRAM, NO_ORIENTATION, TrackerPose, read_pose, spherical_point

VECTOR = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def measurement(p: tuple[float, ...], turn: tuple[float, ...]) -> TrackerPose:
    return TrackerPose(7, 10**18, 0, 3, pose.make(rotation.exp(np.array(turn)), np.array(p)), 15e-6)


def test_88_bytes() -> None:
    assert DATAGRAM.size == 88
    assert measurement((1, 2, 3), (0, 0, 0)).telegram()[24:48] == struct.pack("<3d", 1000.0, 2000.0, 3000.0)


@given(VECTOR, VECTOR)
def test_round_trip(p: tuple[float, ...], turn: tuple[float, ...]) -> None:
    sent = measurement(p, turn)
    back = read_pose(sent.telegram())
    np.testing.assert_allclose(back.T_tracker_target, sent.T_tracker_target, atol=1e-12)
    assert (back.sequence, back.time_ns, back.status, back.frame_id) == (7, 10**18, 0, 3)
    assert back.sigma_m == pytest.approx(15e-6)


@given(st.binary(max_size=100))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        read_pose(data)


def damaged(at: int, layout: str, value: float) -> bytes:
    data = bytearray(measurement((1, 2, 3), (0.1, 0.2, 0.3)).telegram())
    struct.pack_into(layout, data, at, value)
    return bytes(data)


@pytest.mark.parametrize(
    ("at", "layout", "value", "said"),
    [
        (24, "<d", math.nan, "not finite"),
        (80, "<d", math.inf, "not finite"),
        (24, "<d", 1e9, "out of range"),
        (80, "<d", -1.0, "out of range"),
        (48, "<d", 0.5, "unit length"),
        (16, "<I", 64, "status bits"),
        (0, "<I", 1, "not a tracker datagram"),
    ],
)
def test_faults_are_named(at: int, layout: str, value: float, said: str) -> None:
    with pytest.raises(ProtocolError, match=said):
        read_pose(damaged(at, layout, value))


def test_a_reflector_alone_has_no_orientation() -> None:
    data = bytearray(damaged(48, "<d", 0.0))
    struct.pack_into("<I", data, 16, NO_ORIENTATION)
    assert np.array_equal(read_pose(bytes(data)).T_tracker_target[:3, :3], np.eye(3))


@given(st.floats(0.1, 50.0), st.floats(-3.1, 3.1), st.floats(0.01, 3.1))
def test_spherical_coordinates(distance: float, azimuth: float, zenith: float) -> None:
    p = spherical_point(distance, azimuth, zenith)
    assert float(np.linalg.norm(p)) == pytest.approx(distance)
    assert math.atan2(p[1], p[0]) == pytest.approx(azimuth)
    assert math.acos(p[2] / distance) == pytest.approx(zenith, abs=1e-6)
