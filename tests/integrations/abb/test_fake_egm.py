"""The simulated ABB controller: what it keeps, follows, limits and ends at."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.link.telegram import read_robot, write_guidance, write_path_correction
from counterflex.integrations.abb.simulated import CONVERGED, CORRECTING, FREE, LIMITED, TIMEOUT, EgmContext, FakeEgm
from counterflex.twin.devices.commanded_motion import Report

Q = np.array([0.1, -1.2, 1.3, 0.2, 0.8, -0.4])
DOWN = rotation.about_x(np.pi)


def report(x: float = 0.0, y: float = 0.0, z: float = 0.03) -> Report:
    T = pose.make(DOWN, np.array([x, y, z]))
    return Report(0.0, T, T @ pose.make(p=np.array([0.0, 1e-4, 0.0])), Q, Q + 1e-4, True, False)


def path(**context: Any) -> FakeEgm:
    fake = FakeEgm(EgmContext(**context))
    fake.enabled = True
    return fake


def posed(**context: Any) -> FakeEgm:
    fake = FakeEgm(EgmContext(mode="pose", **{"cycle_s": 4e-3, "low_pass_hz": 0.0, "ramp_in_s": 0.0, **context}))
    fake.telegram(report())
    fake.enabled = True
    return fake


def goal(sequence: int, x_m: float, v_m_s: float = 0.0) -> bytes:
    T = report(x_m).T_part_nominal
    return write_guidance(sequence, T, 0, np.array([v_m_s, 0.0, 0.0, 0.0, 0.0, 0.0]) if v_m_s else None)


@pytest.mark.parametrize("robotware", [6, 7])
def test_messages_say_where_the_robot_is_and_what_it_does(robotware: int) -> None:
    fake = path(robotware=robotware)
    fake.force = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    first, state = read_robot(fake.telegram(report(0.1))), read_robot(fake.telegram(report(0.2)))
    assert (first.sequence, state.sequence, state.time_ms - first.time_ms) == (0, 1, 24)
    assert state.T_frame_tcp_planned is not None
    assert state.T_frame_tcp is not None
    assert state.q is not None
    assert state.force is not None
    np.testing.assert_allclose(state.T_frame_tcp_planned, report(0.2).T_part_nominal, atol=1e-12)
    np.testing.assert_allclose(state.T_frame_tcp, report(0.2).T_part_actual, atol=1e-12)
    np.testing.assert_allclose(state.q, Q + 1e-4, atol=1e-12)
    np.testing.assert_allclose(state.force, fake.force)
    assert (state.motors_on, state.rapid_running, state.guided) == (True, True, True)
    fake.enabled = False
    assert not read_robot(fake.telegram(report(0.2))).guided


def test_a_path_is_moved_left_and_up_never_along() -> None:
    fake = path()
    for k in range(3):
        fake.telegram(report(1e-3 * k))
        fake.answer(write_path_correction(k, 0.2e-3, -0.1e-3, 0.0))
    np.testing.assert_allclose(fake.pose_correction(), [0.0, 0.2e-3, -0.1e-3, 0.0, 0.0, 0.0], atol=1e-15)
    assert fake.stat == CORRECTING
    fake.telegram(report(2e-3, 1e-3))  # a corner: the next side runs along y, left of it is -x
    np.testing.assert_allclose(fake.pose_correction(), [-0.2e-3, 0.0, -0.1e-3, 0.0, 0.0, 0.0], atol=1e-15)
    fake.answer(write_path_correction(3, 0.0, 0.0, 0.0))
    assert fake.stat == FREE


def test_a_lost_message_leaves_the_last_correction_in_force_until_the_timeout() -> None:
    fake = path(timeout_s=0.1)
    fake.telegram(report(0.0))
    fake.answer(write_path_correction(0, 0.2e-3, 0.0, 0.0))
    fake.telegram(report(1e-3))
    for k in range(4):
        fake.answer(None)
        assert fake.pose_correction()[1] == pytest.approx(0.2e-3)
        assert fake.late == k + 1
    assert fake.stopped == ""
    fake.answer(None)  # 5 x 24 ms
    assert fake.stopped == TIMEOUT
    np.testing.assert_array_equal(fake.pose_correction(), np.zeros(6))


def test_by_default_a_controller_would_wait_a_second() -> None:
    fake = path(timeout_s=1.0)
    fake.telegram(report())
    for _ in range(41):
        fake.answer(None)
    assert fake.stopped == ""
    fake.answer(None)
    assert fake.stopped == TIMEOUT


def test_outside_of_a_corrected_movement_nothing_is_applied_and_nothing_times_out() -> None:
    fake = path()
    fake.enabled = False
    for k in range(100):
        fake.telegram(report(1e-3 * k))
        fake.answer(None if k % 2 else write_path_correction(k, 1e-3, 0.0, 0.0))
    np.testing.assert_array_equal(fake.pose_correction(), np.zeros(6))
    assert (fake.stopped, fake.late) == ("", 0)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"\xff\xff", "unreadable"),
        (write_guidance(1, np.eye(4)), "unreadable"),
        (write_path_correction(0, 0.0, 0.0, 0.0), "repeated"),
        (None, "no message"),
    ],
)
def test_what_is_no_new_correction_is_refused(data: bytes | None, said: str) -> None:
    fake = path()
    fake.telegram(report())
    fake.answer(write_path_correction(0, 0.1e-3, 0.0, 0.0))
    fake.answer(data)
    assert fake.refused == said
    assert fake.correction[1] == pytest.approx(0.1e-3)


@pytest.mark.parametrize("gain", [5.0, 20.0])
def test_guidance_follows_with_its_gain(gain: float) -> None:
    fake = posed(gain_per_s=gain, dead_s=0.0)
    xs = []
    for k in range(100):
        fake.answer(goal(k, 1e-3))
        T = fake.guided_pose()
        assert T is not None
        xs.append(T[0, 3])
    expected = 1e-3 * (1.0 - (1.0 - gain * 4e-3) ** np.arange(1, 101))
    np.testing.assert_allclose(xs, expected, atol=1e-12)


def test_without_messages_a_position_holds_and_a_speed_goes_on() -> None:
    away = {}
    for v in (0.0, 10e-3):
        fake = posed(dead_s=0.0)
        for k in range(200):
            fake.answer(goal(k, 10e-3 * 4e-3 * k if v else 0.0, v))
        T = fake.guided_pose()
        assert T is not None
        before = T[0, 3]
        while not fake.stopped:
            fake.answer(None)
        after = fake.guided_pose()
        assert after is not None
        away[v] = after[0, 3] - before
    assert abs(away[0.0]) < 1e-12
    assert 0.35e-3 < away[10e-3] < 10e-3 * 0.1  # it went on with the last speed, until CommTimeout


def test_the_speed_is_limited_and_it_says_so() -> None:
    fake = posed(speed_m_s=10e-3, dead_s=0.0)
    steps = []
    for k in range(20):
        before = fake.guided_pose()
        fake.answer(goal(k, 5e-3))
        after = fake.guided_pose()
        assert before is not None
        assert after is not None
        steps.append(after[0, 3] - before[0, 3])
    assert max(steps) == pytest.approx(10e-3 * 4e-3)
    assert fake.stat == LIMITED
    assert fake.utilization > 1.0
    assert (read_robot(fake.telegram(report())).utilization or 0.0) > 1.0


def test_the_reference_comes_late_and_is_ramped_in_and_filtered() -> None:
    fake = posed(dead_s=12e-3, low_pass_hz=5.0, ramp_in_s=0.1)
    plain = posed(dead_s=0.0)
    shown = []
    for k in range(40):
        fake.answer(goal(k, 1e-3))
        plain.answer(goal(k, 1e-3))
        slow, quick = fake.guided_pose(), plain.guided_pose()
        assert slow is not None
        assert quick is not None
        shown.append((slow[0, 3], quick[0, 3]))
    assert [s for s, _ in shown[:3]] == [0.0, 0.0, 0.0]
    assert all(s < q for s, q in shown[1:])


def test_it_ends_when_it_has_stood_in_its_window_long_enough() -> None:
    fake = posed(condition_s=0.4, dead_s=0.0)
    k = 0
    while not fake.stopped and k < 1000:
        fake.answer(goal(k, 1e-3))
        k += 1
    assert fake.stopped == CONVERGED
    assert k * 4e-3 > 0.4


@pytest.mark.parametrize(
    "context",
    [
        {"cycle_s": 20e-3},
        {"mode": "pose", "cycle_s": 5e-3},
        {"gain_per_s": 21.0},
        {"robotware": 5},
        {"mode": "joint"},
        {"timeout_s": 0.0},
    ],
)
def test_settings_that_no_controller_takes_are_refused(context: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        EgmContext(**context)
