"""The EGM links on real sockets: what they take, how they answer, where they send the tool."""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import OutputError, ProtocolError
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.link.guidance_link import EgmGuidanceLink, GuidanceSettings, Phase
from counterflex.integrations.abb.link.link import FROZEN, EgmForce
from counterflex.integrations.abb.link.path_link import EgmPathLink, path_frame
from counterflex.integrations.abb.link.telegram import (
    MESSAGES,
    RobotState,
    read_guidance,
    read_path_correction,
    write_guidance,
)
from counterflex.integrations.abb.simulated import EgmContext, FakeEgm
from counterflex.path.path_speed import PoseStream
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.robot.model.controller_axes import from_geometry
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.commanded_motion import Report

DOWN = rotation.about_x(np.pi)  # z of the tool points down
Q = np.array([0.1, -1.2, 1.3, 0.2, 0.8, -0.4])
ZERO = np.zeros(6)


def robot(sequence: int, p: Any, *, period_ms: int = 24, **changes: Any) -> bytes:
    T = pose.make(DOWN, np.asarray(p, dtype=np.float64))
    state = RobotState(sequence, 50_000 + period_ms * sequence, Q, T, T, True, True, True, 0.2, None)
    return replace(state, **changes).telegram()


class Controller:
    """A socket that plays the controller."""

    def __init__(self, where: tuple[str, int]) -> None:
        self._where = where
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))

    def send(self, *messages: bytes) -> None:
        for message in messages:
            self._socket.sendto(message, self._where)

    def receive(self) -> bytes | None:
        self._socket.settimeout(0.0)
        try:
            return self._socket.recv(4096)
        except BlockingIOError:
            return None

    def close(self) -> None:
        self._socket.close()


@contextlib.contextmanager
def joined(link: Any) -> Iterator[Controller]:
    controller = Controller(link.address)
    try:
        yield controller
    finally:
        controller.close()
        link.close()


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_the_path_frame_is_right_handed_along_the_motion_and_square_to_the_tool(
    move: tuple[float, ...], turn: tuple[float, ...]
) -> None:
    step, z_tool = np.array(move), rotation.exp(np.array(turn))[:, 2]
    R = path_frame(step, z_tool)
    if R is None:
        along = abs(float(step @ z_tool)) > np.linalg.norm(step) * (1.0 - 1e-5)
        assert np.linalg.norm(step) <= 2e-6 or along
        return
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 0], step / np.linalg.norm(step), atol=1e-12)
    assert abs(float(R[:, 1] @ z_tool)) < 1e-9
    assert float(R[:, 2] @ z_tool) <= 0.0  # z of the path points back up the tool


@pytest.mark.parametrize(("feed", "left"), [((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (-1, 0, 0)), ((-1, 0, 0), (0, -1, 0))])
def test_milling_with_the_tool_down_y_is_left_of_the_feed_and_z_is_up(
    feed: tuple[int, ...], left: tuple[int, ...]
) -> None:
    R = path_frame(np.array(feed) * 1e-3, np.array([0.0, 0.0, -1.0]))
    assert R is not None
    np.testing.assert_allclose(R[:, 1], left, atol=1e-12)
    np.testing.assert_allclose(R[:, 2], (0, 0, 1), atol=1e-12)


def test_a_correction_in_part_axes_goes_out_in_path_axes_without_its_part_along_the_path() -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        nominal, q = np.zeros(12), np.zeros(6)
        direction = np.array([0.6, 0.8, 0.0])
        sent = np.array([0.0, 0.0, 0.0])
        for k in range(4):
            controller.send(robot(k, 1e-3 * k * direction))
            assert link.wait(1.0)
            link.fill(nominal, q)
            np.testing.assert_allclose(nominal[9:], 1e-3 * k * direction, atol=1e-12)
            np.testing.assert_allclose(q, Q, atol=1e-12)
            correction = np.array([0.3e-3, -0.1e-3, 0.2e-3, 0.0, 0.0, 0.0])
            assert link.answer(correction)
            data = controller.receive()
            assert data is not None
            sequence, sent, age = read_path_correction(data)
            assert sequence == k
            assert age == 0.0
            if k == 0:
                np.testing.assert_array_equal(sent, 0.0)  # it has not moved: there is no path frame yet
        left = np.array([-0.8, 0.6, 0.0])
        np.testing.assert_allclose(sent, [0.0, correction[:3] @ left, correction[2]], atol=1e-12)
        back = sent[1] * left + sent[2] * np.array([0.0, 0.0, 1.0])
        np.testing.assert_allclose(back, correction[:3] - direction * (correction[:3] @ direction), atol=1e-12)


ALONG = np.array([0.6e-3, 0.0, 0.0])
"""Motion in a message: 25 mm/s and 24 ms."""
ACROSS = np.array([0.0, -0.9e-3, 0.05e-3, 0.0, 0.0, 0.0])


def answered(link: EgmPathLink, controller: Controller, message: bytes, state: State = State.ACTIVE) -> Float | None:
    """Offset (3,) of the answer to a message, path frame, or None."""
    controller.send(message)
    nominal, q = np.zeros(12), np.zeros(6)
    if link.wait(1e-3):
        link.fill(nominal, q)
        link.answer(ACROSS, state=state)
    data = controller.receive()
    return None if data is None else read_path_correction(data)[1]


TURNED_ROUND = pose.make(DOWN @ rotation.about_y(np.pi), 5 * ALONG)
"""Of a quaternion with a wrong sign in one of its numbers."""


@pytest.mark.parametrize(
    "wrong",
    [
        {"T_frame_tcp_planned": pose.make(DOWN, np.array([-6.2, 0.0, 11.0]))},
        {"T_frame_tcp_planned": pose.make(DOWN, np.array([1e38, 1e30, 3e38]))},
        {"T_frame_tcp_planned": pose.make(DOWN, 4 * ALONG - [0.8e-3, 0.0, 0.0])},
        {"T_frame_tcp_planned": pose.make(DOWN, 5 * ALONG + [0.0, 0.9e-3, 0.0])},
        {"T_frame_tcp_planned": TURNED_ROUND},
        {"T_frame_tcp_planned": None, "T_frame_tcp": pose.make(DOWN, 2 * ALONG)},
    ],
    ids=["far", "beyond all numbers", "back", "aside", "turned round", "no plan"],
)
def test_one_wrong_pose_does_not_turn_the_correction(wrong: dict[str, Any]) -> None:
    """Its answer and those behind it say what the one before said, or there is none: the robot keeps what it has."""
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        messages = [robot(k, k * ALONG, **(wrong if k == 5 else {})) for k in range(10)]
        sent = [answered(link, controller, message) for message in messages]
        assert sent[5] is not None or wrong["T_frame_tcp_planned"] is None
        for offset in (one for one in sent[2:] if one is not None):
            np.testing.assert_allclose(offset[1:], ACROSS[1:3], atol=1e-9)
        assert sum(one is None for one in sent) <= 1


def test_a_plan_is_needed_in_a_movement_alone() -> None:
    """Some controllers plan nothing before and after it: a fault at the end of each program."""
    link = EgmPathLink(port=0)
    none: dict[str, Any] = {"T_frame_tcp_planned": None}
    with joined(link) as controller:
        for k in range(12):
            moves = 4 <= k < 8
            sent = answered(link, controller, robot(k, k * ALONG, guided=moves, **({} if moves else none)))
            assert sent is not None or moves
        assert answered(link, controller, robot(12, 12 * ALONG, **none)) is None
        assert link.counters.malformed == 1


@pytest.mark.parametrize("planned", [True, False])
def test_a_corner_turns_the_correction_at_once_where_the_plan_has_it_else_with_the_next_message(planned: bool) -> None:
    link = EgmPathLink(port=0)
    corner = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    link.feeds = (lambda _way_m: corner) if planned else None
    with joined(link) as controller:
        points = [k * ALONG for k in range(6)] + [5 * ALONG + k * ALONG[[1, 0, 2]] for k in range(1, 4)]
        sent = [answered(link, controller, robot(k, p)) for k, p in enumerate(points)]
        y = [math.nan if one is None else one[1] for one in sent]
        turned = 0.0 if planned else -0.9e-3
        np.testing.assert_allclose(y[5:], [-0.9e-3, turned, 0.0, 0.0], atol=1e-12)  # behind it, it lies along the path


def test_between_the_two_directions_of_a_rounded_corner_the_frame_follows() -> None:
    link = EgmPathLink(port=0)
    link.feeds = lambda _way_m: np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turn = np.radians([0.0, 0.0, 0.0, 30.0, 60.0, 90.0])
    points = np.cumsum(0.6e-3 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1), axis=0)
    with joined(link) as controller:
        sent = [answered(link, controller, robot(k, p)) for k, p in enumerate(points)]
        y = [math.nan if one is None else one[1] for one in sent]
        np.testing.assert_allclose(y[2:], -0.9e-3 * np.cos(turn[2:]), atol=1e-12)


def _arc(radius_m: float, lap: int) -> Float:
    """(n, 3) m: a straight of eight messages, an arc of a given radius, the last straight, 0.6 mm a message."""
    turn = np.clip(np.arange(lap) - 7, 0, 12) * ALONG[0] / radius_m
    heading = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    out: Float = np.cumsum(ALONG[0] * heading, axis=0)
    return out


def _tangents(points: Float, plan: Float | None, odd: tuple[int, Float] | None = None) -> Float:
    """(n, 3) tangents that the link takes as it reads poses at points, one of them another one; `plan`: (m, 3)."""
    link, out = EgmPathLink(port=0), []
    link.feeds = None if plan is None else lambda _way_m: plan
    for k, p in enumerate(points):
        link._follow(odd[1] if odd is not None and odd[0] == k else pose.make(DOWN, p))
        out.append(np.full(3, np.nan) if link._R_part_path is None else link._R_part_path[:, 0].copy())
    link.close()
    return np.array(out)


def _off(a: Float, b: Float) -> Float:
    out: Float = np.degrees(np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0)))
    return out


NEAR = st.floats(-2e-3, 2e-3)


@given(st.floats(12e-3, 10.0), st.integers(3, 26), st.tuples(NEAR, NEAR, NEAR), st.floats(-0.1, 0.1), st.booleans())
def test_a_pose_that_is_wrong_turns_the_frame_by_three_degrees_at_most(
    radius: float, at: int, off: tuple[float, float, float], tilt: float, planned: bool
) -> None:
    """It was 15 deg: half a millimetre of a correction of 2 mm, there and back again in the next message."""
    points = _arc(radius, 30)
    right = np.diff(points, axis=0, prepend=np.nan) / ALONG[0]
    odd = pose.make(DOWN @ rotation.about_x(tilt), points[at] + off)
    behind = _off(_tangents(points, right[max(1, at - 3) : at + 4] if planned else None, (at, odd)), right)
    assert np.max(behind[2:]) < 3.0 + 4.0 * np.degrees(ALONG[0] / radius) + 1e-5
    assert np.max(behind[at + 3 :]) < 1e-5


@given(st.floats(2.4e-3, 10.0), st.booleans())
def test_the_frame_follows_any_arc(radius: float, planned: bool) -> None:
    """With the plan at once; without it with the second message that turns as far, one message behind until then."""
    points = _arc(radius, 30)
    right = np.diff(points, axis=0, prepend=np.nan) / ALONG[0]
    behind = _off(_tangents(points, right[1:] if planned else None), right)
    turns = np.degrees(ALONG[0] / radius)
    assert np.max(behind[[*range(2, 8), *range(9, 30)]]) < 1e-5
    assert behind[8] < (1e-5 if planned or turns <= 3.0 else turns + 1e-5)


@given(st.floats(0.0, 175.0), st.booleans())
def test_the_frame_turns_at_any_corner(angle: float, planned: bool) -> None:
    """With the plan at once, without it with the second message that shows it."""
    turn = np.radians(angle) * (np.arange(16) >= 8)
    heading = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    behind = _off(_tangents(np.cumsum(ALONG[0] * heading, axis=0), heading[[0, -1]] if planned else None), heading)
    assert np.max(behind[[*range(2, 8), *range(9, 16)]]) < 1e-5
    assert behind[8] < 1e-5 or not (planned or angle <= 3.0)


def test_a_correction_that_is_held_is_not_answered_with_zero_before_a_path_frame_is_known() -> None:
    """A loop that took it over from one that was killed, while the robot stands: silence, and CommTimeout stops it."""
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        assert answered(link, controller, robot(0, (0, 0, 0)), State.HOLD) is None
        assert answered(link, controller, robot(1, (0, 0, 0)), State.RAMP_OUT) is None
        begins = answered(link, controller, robot(2, (0, 0, 0)), State.ACTIVE)  # nothing was ever in force
        np.testing.assert_array_equal(begins, np.zeros(3))
        moves = answered(link, controller, robot(3, ALONG), State.HOLD)
        assert moves is not None
        np.testing.assert_allclose(moves, [0.0, *ACROSS[1:3]], atol=1e-9)


def test_axes_of_an_arm_with_a_parallel_rod_become_angles_of_the_model() -> None:
    rod = from_geometry("abb", (1,) * 6, (0.0, 0.0, -np.pi / 2, 0.0, 0.0, 0.0), 0.6, "horizontal")
    link = EgmPathLink(port=0, axes=rod)
    with joined(link) as controller:
        nominal, q = np.zeros(12), np.zeros(6)
        controller.send(robot(0, (0, 0, 0)))
        assert link.wait(1.0)
        link.fill(nominal, q)
        np.testing.assert_allclose(q, Q - np.array([0.0, 0.0, Q[1], 0.0, 0.0, 0.0]), atol=1e-12)
        np.testing.assert_allclose(FakeEgm(EgmContext(axes=rod)).context.axes.shown(q), Q, atol=1e-12)


def test_the_newest_message_is_answered_and_gaps_are_counted() -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        controller.send(robot(7, (0, 0, 0)))
        assert link.wait(1.0)
        assert (link.elapsed, link.counters.lost) == (1, 0)
        controller.send(robot(8, (0, 0, 0)), robot(10, (0, 0, 0)), robot(9, (0, 0, 0)), robot(10, (0, 0, 0)))
        assert link.wait(1.0)
        assert (link.elapsed, link.counters.lost, link.counters.drained, link.counters.old) == (3, 2, 1, 2)
        assert link.counter == 50_000 + 240
        assert link.answer(ZERO)
        assert controller.receive() is not None
        assert controller.receive() is None
        assert not link.wait(0.0)
        assert link.elapsed == 0


def test_another_session_is_noticed_and_not_passed_over_for_ever() -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        for k in range(100, 130):
            controller.send(robot(k, (0, 0, 0)))
            assert link.wait(1.0)
        taken = []
        for k in range(12):
            controller.send(robot(k, (0, 0, 0), time_ms=900_000 + 24 * k))
            taken.append(link.wait(0.05) and link.restarted)
        assert taken.count(True) == 1
        assert taken.index(True) <= 9


def test_wrong_messages_and_strangers_are_refused_and_counted() -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        controller.send(b"\x00garbage", write_guidance(0, np.eye(4)), robot(0, (0, 0, np.nan)))
        assert not link.wait(0.05)
        assert link.counters.malformed == 3
        controller.send(robot(0, (0, 0, 0)))
        assert link.wait(1.0)
        assert link.counters.malformed_in_a_row == 0
        stranger = Controller(link.address)
        stranger.send(robot(1, (0, 0, 0)))
        assert not link.wait(0.05)
        stranger.close()
        assert link.counters.foreign == 1
        controller.send(robot(1, (0, 0, 0), T_frame_tcp=None))  # it has said where it is before
        assert not link.wait(0.05)
        assert link.counters.malformed_in_a_row == 1
        assert not link.answer(np.array([np.nan, 0, 0, 0, 0, 0]))
        assert not link.answer(ZERO, stop=True)  # silence is how EGM is told to stop
        with pytest.raises(OutputError, match="port"):
            EgmPathLink(port=link.address[1])


def test_enable_is_a_movement_that_takes_corrections() -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        for k, (changes, enabled) in enumerate(
            [({}, True), ({"guided": False}, False), ({"rapid_running": False}, False), ({"motors_on": False}, False)]
        ):
            controller.send(robot(k, (0, 0, 0), **changes))
            assert link.wait(1.0)
            assert link.enable is enabled
        controller.send(robot(9, (0, 0, 0), utilization=1.2))
        assert link.wait(1.0)
        assert link.clamped


def cut(data: bytes, *names: str) -> bytes:
    """A message without some of its fields."""
    message = MESSAGES["EgmRobot"]()
    message.ParseFromString(data)
    for name in names:
        *way, last = name.split(".")
        part = message
        for word in way:
            part = getattr(part, word)
        part.ClearField(last)
    out: bytes = message.SerializeToString()
    return out


@pytest.mark.parametrize(
    "names",
    [
        ("motorState",),
        ("rapidExecState",),
        ("mciConvergenceMet", "utilizationRate"),
        ("planned",),
        ("planned.cartesian.orient",),
        ("feedBack.time", "planned.time", "planned.joints"),
        ("header.tm",),
    ],
)
def test_what_a_controller_may_leave_out_is_done_without(names: tuple[str, ...]) -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        for k in range(40):
            controller.send(cut(robot(k, (1e-3 * k, 0, 0)), *names))
            assert link.wait(1.0)
            assert not link.empty
            assert link.enable
        link.fill(nominal := np.zeros(12), np.zeros(6))
        np.testing.assert_allclose(nominal[9], 0.039, atol=1e-12)
        controller.send(cut(robot(40, (0.04, 0, 0), guided=False), *names))
        assert link.wait(1.0)
        assert not link.enable


@pytest.mark.parametrize(
    ("joints", "u0", "said"),
    [
        (5, 1.0, r"feedBack.joints of 6 axes \(they are 5\)"),
        (7, 1.0, r"feedBack.joints of 6 axes \(they are 7\)"),
        (6, 0.0, r"orient of length 1 \(it is 0\)"),
        (6, 0.5, r"orient of length 1 \(it is 0.5\)"),
    ],
)
def test_another_robot_or_a_quaternion_that_is_none_is_named(joints: int, u0: float, said: str) -> None:
    """They were counted as rubbish, and the run ended with "no telegram came"."""
    link = EgmPathLink(port=0)
    message = MESSAGES["EgmRobot"]()
    with joined(link) as controller, pytest.raises(ProtocolError, match=said):
        for k in range(100):
            message.ParseFromString(robot(k, (1e-3 * k, 0, 0)))
            message.feedBack.joints.ClearField("joints")
            message.feedBack.joints.joints.extend([0.0] * joints)
            message.feedBack.cartesian.orient.u0 = u0
            for name in ("u1", "u2", "u3"):
                setattr(message.feedBack.cartesian.orient, name, 0.0)
            controller.send(message.SerializeToString())
            link.wait(0.01)


@pytest.mark.parametrize("name", ["header.seqno", "feedBack.joints", "feedBack.cartesian", "mciState"])
def test_what_cannot_be_done_without_is_named(name: str) -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller, pytest.raises(ProtocolError, match=f"no {name};"):
        for k in range(100):
            controller.send(cut(robot(k, (1e-3 * k, 0, 0)), name))
            link.wait(0.01)
    link = EgmPathLink(port=0)
    with joined(link) as controller:  # once it has told everything, a shortened message is only passed over
        for k in range(100):
            data = robot(k, (1e-3 * k, 0, 0))
            controller.send(data if k < 3 else cut(data, name))
            link.wait(0.01)


@pytest.mark.parametrize("watch_only", [False, True])
def test_a_path_that_is_to_be_corrected_is_not_run_without_an_armed_loop(watch_only: bool) -> None:
    """Silence ends the movement on the controller; before the movement and once armed everything is answered."""
    link = EgmPathLink(port=0, watch_only=watch_only)
    with joined(link) as controller:
        sent = []
        for k, (guided, state) in enumerate(
            [(False, State.READY), (True, State.READY), (True, State.IDLE), (True, State.ARMED), (True, State.HOLD)]
        ):
            controller.send(robot(k, (1e-3 * k, 0, 0), guided=guided))
            assert link.wait(1.0)
            sent.append(link.answer(ZERO, state=state))
        assert sent == ([True] * 5 if watch_only else [True, False, False, True, True])


def test_a_controller_in_another_cycle_is_refused() -> None:
    link = EgmPathLink(port=0, period_s=24e-3)
    with joined(link) as controller, pytest.raises(ProtocolError, match="another cycle"):
        for k in range(40):
            controller.send(robot(k, (0, 0, 0), period_ms=4))
            link.wait(1.0)


@pytest.mark.parametrize("robotware", [6, 7])
def test_the_robots_own_force_is_a_force_sensor(robotware: int) -> None:
    link = EgmPathLink(port=0)
    with joined(link) as controller:
        force = EgmForce(link, range_n=1000.0)
        w = np.array([10.0, -20.0, 30.0, 1.0, 2.0, 3.0])
        T = np.eye(4)
        for k in range(FROZEN + 2):
            shown = w + (0.01 * k if k < 3 else 1.0)
            if k == FROZEN + 1:
                shown = w * 40.0
            state = RobotState(k, 24 * k + 1, Q, T, None, True, True, True, None, None if k == 1 else shown)
            controller.send(state.telegram(robotware=robotware))
            assert link.wait(1.0)
            assert force.drain() == (0 if k == 1 else 1)
            assert force.drain() == 0  # the same message is no second sample
            if k != 1:
                np.testing.assert_allclose(force.w_sensor, shown)
            assert force.frozen is False or k >= FROZEN
        assert force.saturated
        assert not force.frozen


def square(n: int = 41) -> tuple[Float, ToolPath]:
    """A corner of two sides of 20 mm at 20 mm/s, the tool tilting along the second one."""
    s = np.linspace(0.0, 0.04, n)
    p = np.stack([np.minimum(s, 0.02), np.maximum(s - 0.02, 0.0), np.full(n, 0.03)], axis=1)
    tilt = np.maximum(s - 0.02, 0.0) * 10.0
    Rs = rotation.about_x(np.pi + tilt)
    path = ToolPath(
        p_part_tcp=p,
        axis_part=-Rs[:, :, 2],
        kind=np.full(n, FEED),
        feed_m_s=np.full(n, 0.02),
        spindle_rad_s=np.zeros(n),
        time_s=s / 0.02,
        motion=np.arange(n),
        tool=np.ones(n, dtype=np.int64),
    )
    return pose.make(Rs, p), path


def stream() -> PoseStream:
    Ts, path = square()
    return PoseStream(Ts, path, period_s=4e-3, acceleration_m_s2=0.5, blending_m=0.0)


class Guided:
    """A fake controller after what the link sends, message by message, through the wire's bytes."""

    def __init__(self, link: EgmGuidanceLink, start: Float, **context: Any) -> None:
        self.link, self.controller = link, Controller(link.address)
        self.fake = FakeEgm(EgmContext(mode="pose", cycle_s=4e-3, **context))
        self.T = start
        self.sent: list[Float] = []
        self.pose, self.q = np.zeros(12), np.zeros(6)
        self.nominal: list[Float] = []
        self.trail: list[Float] = []

    def cycle(self, state: State, correction: Float = ZERO, **told: Any) -> bool:
        report = Report(0.0, self.T, self.T, Q, Q, True, False)
        self.controller.send(self.fake.telegram(report))
        assert self.link.wait(1.0)
        self.link.fill(self.pose, self.q)
        self.nominal.append(self.pose[9:].copy())
        answered = self.link.answer(correction, state=state, **told)
        data = self.controller.receive()
        assert (data is not None) is answered
        if data is not None:
            self.sent.append(read_guidance(data)[1])
        self.fake.answer(data)
        guided = self.fake.guided_pose()
        assert guided is not None
        self.T = guided
        self.trail.append(self.T[:3, 3].copy())
        return answered

    def close(self) -> None:
        self.controller.close()
        self.link.close()


def guided(start: Float | None = None, settings: GuidanceSettings | None = None, **context: Any) -> Guided:
    link = EgmGuidanceLink(stream(), settings or GuidanceSettings(lag_s=60e-3), port=0)
    return Guided(link, link.stream.pose(0.0) if start is None else start, **context)


def distance_from_corner(p: Float) -> Float:
    """Distance of points from the two sides of the corner."""
    first = np.hypot(p[:, 1], p[:, 0] - np.clip(p[:, 0], 0.0, 0.02))
    second = np.hypot(p[:, 0] - 0.02, p[:, 1] - np.clip(p[:, 1], 0.0, 0.02))
    return np.hypot(np.minimum(first, second), p[:, 2] - 0.03)


def run_through(run: Guided, correction: Float = ZERO, **told: Any) -> None:
    run.fake.enabled = True
    for k in range(1600):
        run.cycle(State.ARMED if k < 20 else State.ACTIVE, correction, **told)
        if run.link.stream.finished and k % 50 == 0 and np.linalg.norm(run.T[:3, 3] - run.sent[-1][:3, 3]) < 1e-7:
            return


def test_guidance_without_correction_reproduces_the_path_and_its_orientation() -> None:
    run = guided()
    run_through(run)
    wanted = np.array([T[:3, 3] for T in run.sent])
    assert distance_from_corner(wanted).max() < 1e-9
    trail = np.array(run.trail)
    corner = np.linalg.norm(trail - [0.02, 0.0, 0.03], axis=1) < 5e-3
    assert distance_from_corner(trail[~corner]).max() < 2e-6
    assert distance_from_corner(trail).max() < 0.3e-3  # the tool is late, so it cuts the corner where the path stops
    end = run.link.stream.pose(1e9)
    np.testing.assert_allclose(run.T, end, atol=1e-6)
    np.testing.assert_allclose(end[:3, 3], (0.02, 0.02, 0.03), atol=1e-12)
    np.testing.assert_allclose(end[:3, :3], square()[0][-1, :3, :3], atol=1e-9)
    run.close()


def test_the_loop_is_told_where_the_robot_is_by_the_plan() -> None:
    run = guided(settings=GuidanceSettings(lag_s=70e-3), gain_per_s=20.0, low_pass_hz=20.0, dead_s=12e-3)
    run_through(run)
    told, reached = np.array(run.nominal[100:280]), np.array(run.trail[99:279])
    assert np.abs(told - reached).max() < 0.1e-3  # 20 mm/s and 70 ms are 1.4 mm
    run.close()


def test_a_correction_moves_the_tool_as_it_says() -> None:
    run = guided()
    run.fake.enabled = True
    correction = np.array([0.1e-3, -0.2e-3, 0.3e-3, 0.0, 1e-3, 0.0])
    for _ in range(300):
        run.cycle(State.ACTIVE, correction)
    nominal, sent = run.link.stream.pose(), run.sent[-1]
    np.testing.assert_allclose(sent[:3, 3] - nominal[:3, 3], correction[:3], atol=1e-12)
    np.testing.assert_allclose(rotation.log(sent[:3, :3] @ nominal[:3, :3].T), correction[3:], atol=1e-9)
    run.close()


def test_what_a_guided_robot_makes_of_a_correction_is_reported() -> None:
    """The measured pose less the planned one: all of it where the robot obeys, a tenth where it makes a tenth."""
    run, shown = guided(settings=GuidanceSettings(lag_s=70e-3)), np.zeros(12)
    run.fake.enabled = True
    up = np.array([0.0, 0.0, 0.4e-3, 0.0, 0.0, 0.0])
    for k in range(300):
        run.cycle(State.ARMED if k < 20 else State.ACTIVE, up)
        assert run.link.fill_reported(shown) is (k >= 125)  # the reference has gone over to the path
    assert shown[11] - run.pose[11] == pytest.approx(0.4e-3, abs=1e-6)
    run.T = run.T.copy()
    run.T[2, 3] -= 0.9 * 0.4e-3
    run.cycle(State.ACTIVE, up)
    assert run.link.fill_reported(shown)
    assert shown[11] - run.pose[11] == pytest.approx(0.04e-3, abs=1e-6)
    run.close()


def test_the_start_is_bumpless_from_where_the_robot_stands() -> None:
    start = stream().pose(0.0)
    start[:3, 3] += [0.3e-3, -0.4e-3, 0.2e-3]
    start[:3, :3] = rotation.exp(np.array([2e-3, 0.0, -1e-3])) @ start[:3, :3]
    run = guided(start)
    run.fake.enabled = True
    for k in range(260):
        run.cycle(State.READY if k < 6 else State.ACTIVE)  # the first message is not answered
    sent = np.array([T[:3, 3] for T in run.sent])
    np.testing.assert_allclose(run.sent[0], start, atol=1e-9)
    np.testing.assert_allclose(run.sent[4], start, atol=1e-9)
    steps = np.linalg.norm(np.diff(sent, axis=0), axis=1)
    assert steps[:6].max() < 2e-6
    assert steps.max() < 0.02 * 4e-3 + 20e-6
    assert distance_from_corner(sent[-1:]).max() < 1e-9
    run.close()


def test_it_waits_until_the_loop_is_armed_and_never_starts_elsewhere() -> None:
    run = guided()
    run.fake.enabled = True
    for _ in range(400):
        run.cycle(State.READY)
    assert run.link.phase == Phase.WAITING
    assert not run.link.enable
    run.close()
    away = stream().pose(0.0)
    away[2, 3] += 5e-3
    other = guided(away)
    other.fake.enabled = True
    with pytest.raises(ProtocolError, match=r"does not stand at the beginning.*5\.00 mm"):
        for _ in range(400):
            other.cycle(State.ARMED)
    assert other.link.phase == Phase.WAITING
    np.testing.assert_allclose(other.sent[-1], away, atol=1e-9)
    other.close()


@pytest.mark.parametrize("at", [0, 1, 5])
def test_a_robot_that_waits_is_not_sent_to_a_pose_that_one_message_shows(at: int) -> None:
    start = stream().pose(0.0)
    run = guided(start)
    run.fake.enabled = True
    for k in range(60):
        run.T = start.copy()
        run.T[2, 3] += 0.4 if k == at else 0.0
        run.cycle(State.READY)
    for T in run.sent:
        np.testing.assert_allclose(T, start, atol=1e-9)
    assert len(run.sent) >= 57
    run.close()


def test_watching_only_the_path_runs_uncorrected() -> None:
    run = guided(settings=GuidanceSettings(start=State.IDLE))
    run.fake.enabled = True
    for _ in range(260):
        run.cycle(State.IDLE)
    assert run.link.phase == Phase.RUNNING
    run.close()


def test_feed_hold_and_stop_bring_the_reference_to_rest_on_the_path() -> None:
    run = guided()
    run.fake.enabled = True
    for _ in range(200):
        run.cycle(State.ACTIVE)
    for _ in range(60):
        run.cycle(State.HOLD, feed_hold=True)
    held = run.link.stream.at
    run.cycle(State.HOLD, feed_hold=True)
    assert run.link.stream.at == held
    for _ in range(60):
        run.cycle(State.ACTIVE)
    assert run.link.stream.at > held + 5
    answered = [run.cycle(State.FAULT, stop=True, feed_hold=True) for _ in range(90)]
    assert answered[0]
    assert not answered[-1]
    sent = np.array([T[:3, 3] for T in run.sent])
    assert np.linalg.norm(sent[-1] - sent[-2]) < 2e-6
    assert np.linalg.norm(np.diff(sent, axis=0), axis=1).max() < 0.02 * 4e-3 + 1e-9
    assert run.fake.stopped == "ERR_UDPUC_COMM"
    run.close()


def test_a_movement_that_the_controller_ends_early_is_a_fault_with_its_place() -> None:
    run = guided()
    run.fake.enabled = True
    for _ in range(200):
        run.cycle(State.ACTIVE)
    assert run.link.enable
    run.fake.stopped = "motors off"
    with pytest.raises(ProtocolError, match="ended the guided movement"):
        run.cycle(State.ACTIVE)
    assert run.link.phase == Phase.ENDED
    run.close()


def test_a_controller_that_begins_another_session_on_the_path_is_not_sent_on() -> None:
    """It may guide at once, from another place: the pose on the path would be a jump for it."""
    run = guided()
    run.fake.enabled = True
    for _ in range(200):
        run.cycle(State.ACTIVE)
    last = len(run.sent)
    run.fake = FakeEgm(EgmContext(mode="pose", cycle_s=4e-3, first_ms=90_000))
    run.fake.enabled = True
    report = Report(0.0, run.T, run.T, Q, Q, True, False)
    with pytest.raises(ProtocolError, match="began another session"):
        for _ in range(20):
            run.controller.send(run.fake.telegram(report))
            if run.link.wait(0.1):
                run.link.answer(ZERO, state=State.ACTIVE)
                run.controller.receive()
    assert run.link.phase == Phase.ENDED
    assert len(run.sent) == last
    run.close()


def test_behind_the_end_a_correction_is_not_added_to_where_the_robot_stands() -> None:
    run = guided()
    run_through(run)
    run.fake.stopped = "RAPID goes on"
    run.controller.send(run.fake.telegram(Report(0.0, run.T, run.T, Q, Q, True, False)))
    assert run.link.wait(1.0)
    assert run.link.phase == Phase.ENDED
    run.fake.stopped = ""
    stands = run.T.copy()
    for _ in range(50):
        run.cycle(State.RAMP_OUT, np.array([0.0, 3e-4, -2e-4, 0.0, 0.0, 1e-3]))
    np.testing.assert_allclose(run.T, stands, atol=1e-9)
    run.close()


def test_a_robot_that_does_not_follow_is_limited() -> None:
    run = guided(settings=GuidanceSettings(lag_s=60e-3, follow_m=0.5e-3), speed_m_s=5e-3)
    run.fake.enabled = True
    seen = []
    for _ in range(500):
        run.cycle(State.ACTIVE)
        seen.append(run.link.clamped)
    assert any(seen)
    run.close()


def test_with_a_speed_reference_the_tool_is_where_it_should_be() -> None:
    lags = []
    for reference in (False, True):
        run = guided(settings=GuidanceSettings(lag_s=20e-3, speed_reference=reference, follow_m=0.1), low_pass_hz=0.0)
        run.fake.enabled = True
        for _ in range(200):
            run.cycle(State.ACTIVE)
        lags.append(float(np.linalg.norm(run.T[:3, 3] - run.sent[-1][:3, 3])))
        run.close()
    assert lags[0] == pytest.approx(0.02 * (1 / 20.0 + 12e-3 - 4e-3), rel=0.02)
    assert lags[1] < 0.4 * lags[0]
