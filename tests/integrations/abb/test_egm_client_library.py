"""What the maker's open client library asks of every message, looked up in the bytes by a walker of its own.

The library (ros-industrial/abb_libegm) drops a message, whole, that lacks one of these fields.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.simulated import EgmContext, FakeEgm
from counterflex.twin.devices.commanded_motion import Report

Q = np.array([0.1, -1.2, 1.3, 0.2, 0.8, -0.4])
NUMBER, CLOCK, KIND = (1, 1), (1, 2), (1, 3)
FEEDBACK, PLANNED = 2, 3


def fields(data: bytes) -> dict[int, list[Any]]:
    """Fields of one protobuf message by number: integers, floats, bytes."""
    found: dict[int, list[Any]] = {}
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(data):
        key = varint()
        number, kind = key >> 3, key & 7
        item: Any
        if kind == 0:
            item = varint()
        elif kind == 1:
            (item,) = struct.unpack_from("<d", data, at)
            at += 8
        elif kind == 2:
            length = varint()
            item, at = data[at : at + length], at + length
        else:
            raise AssertionError(f"wire type {kind}")
        found.setdefault(number, []).append(item)
    return found


def one(message: dict[int, list[Any]], number: int) -> Any:
    assert len(message[number]) == 1
    return message[number][0]


def accepted(data: bytes) -> dict[str, Any]:
    """What the library takes from a message; fails where it would drop it."""
    robot = fields(data)
    head = fields(one(robot, 1))
    assert {1, 2, 3} <= set(head)  # number, clock, type
    assert one(head, 3) == 2  # data of a robot
    out: dict[str, Any] = {"number": one(head, 1), "clock_ms": one(head, 2)}
    for name, number in (("feedback", FEEDBACK), ("planned", PLANNED)):
        part = fields(one(robot, number))
        joints = fields(one(part, 1))[1]
        assert len(joints) == 6
        cartesian = fields(one(part, 2))
        position, quaternion = fields(one(cartesian, 1)), fields(one(cartesian, 2))
        assert {1, 2, 3} <= set(position)
        assert {1, 2, 3, 4} <= set(quaternion)
        time = fields(one(part, 4))
        assert {1, 2} <= set(time)
        out[f"{name}_deg"] = joints
        out[f"{name}_mm"] = [one(position, k) for k in (1, 2, 3)]
        out[f"{name}_s"] = one(time, 1) + 1e-6 * one(time, 2)
        assert sum(one(quaternion, k) ** 2 for k in (1, 2, 3, 4)) == pytest.approx(1.0)
    out["motors"] = one(fields(one(robot, 4)), 1)
    out["interface"] = one(fields(one(robot, 5)), 1)
    out["converged"] = one(robot, 6)
    out["program"] = one(fields(one(robot, 8)), 1)
    out["utilization"] = one(robot, 10)
    return out


@pytest.mark.parametrize("robotware", [6, 7])
@pytest.mark.parametrize(("mode", "cycle_s"), [("path", 24e-3), ("pose", 4e-3)])
def test_every_message_is_taken(robotware: int, mode: Any, cycle_s: float) -> None:
    fake = FakeEgm(EgmContext(mode=mode, cycle_s=cycle_s, robotware=robotware, first_ms=0))
    said = []
    for k in range(3):
        T = pose.make(rotation.about_x(np.pi), np.array([1e-3 * k, 0.0, 0.03]))
        report = Report(0.0, T, T @ pose.make(p=np.array([0.0, 1e-4, 0.0])), Q, Q + 1e-4, True, False)
        fake.enabled = k > 0
        said.append(accepted(fake.telegram(report)))
        np.testing.assert_allclose(said[-1]["planned_deg"], np.degrees(Q), atol=1e-9)
        np.testing.assert_allclose(said[-1]["feedback_deg"], np.degrees(Q + 1e-4), atol=1e-9)
    assert [item["number"] for item in said] == [0, 1, 2]
    assert [item["interface"] for item in said] == [2, 3, 3]  # stopped, running
    assert {(item["motors"], item["program"]) for item in said} == {(1, 2)}
    for name in ("feedback_s", "planned_s"):
        assert np.diff([item[name] for item in said]) == pytest.approx(cycle_s)
