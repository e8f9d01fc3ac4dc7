"""Mean of the poses of a cycle: of known poses, with its time; and where it must not be taken."""

from __future__ import annotations

import socket

import numpy as np
import pytest

from counterflex.core.errors import InputError
from counterflex.core.units import MS
from counterflex.geometry import pose, rotation
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.protocols.tracker.telegram import TrackerPose
from counterflex.twin.devices.datagram_sender import TrackerSender

SHIFTS = np.array([[12.0, -3.0, 5.0], [-8.0, 9.0, 1.0], [20.0, -14.0, -11.0], [4.0, 2.0, -7.0]]) * 1e-6
TURNS = np.array([[30.0, -20.0, 10.0], [-25.0, 40.0, -5.0], [15.0, 10.0, 60.0], [-60.0, 5.0, -35.0]]) * 1e-6
PLACE = pose.make(rotation.exp(np.array([0.4, -1.1, 2.0])), np.array([3.0, -1.5, 0.7]))


def test_it_is_the_mean_of_position_rotation_and_time() -> None:
    link = TrackerLink(mean_of=8)
    sender = TrackerSender(link.address)
    for cycle in range(3):  # what came before does not count
        for k, (shift, turn) in enumerate(zip(SHIFTS, TURNS, strict=True)):
            move = pose.make(rotation.exp(turn) @ PLACE[:3, :3], PLACE[:3, 3] + shift + 1e-3 * cycle)
            sender.send(move, (4 * cycle + k + 1) * MS)
        assert link.drain()
        T = link.T_tracker_target
        np.testing.assert_allclose(T[:3, 3], PLACE[:3, 3] + SHIFTS.mean(axis=0) + 1e-3 * cycle, atol=1e-12)
        away = rotation.log(T[:3, :3] @ PLACE[:3, :3].T)
        np.testing.assert_allclose(away, TURNS.mean(axis=0), atol=5e-9)  # second order in 60 urad
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-14)
        assert link.time_ns == pytest.approx((4 * cycle + 2.5) * 1e6, abs=1)
    sender.close()
    link.close()


def test_poses_that_have_piled_up_are_left_and_the_newest_counts() -> None:
    link = TrackerLink(mean_of=3)
    sender = TrackerSender(link.address)
    for k, shift in enumerate(SHIFTS):
        sender.send(pose.make(p=shift), (k + 1) * MS)
    assert link.drain()
    np.testing.assert_allclose(link.T_tracker_target[:3, 3], SHIFTS[-1], atol=1e-12)
    assert link.time_ns == 4_000_000
    sender.send(pose.make(p=SHIFTS[0]), 5 * MS)
    assert link.drain()
    assert link.time_ns == 5_000_000
    sender.close()
    link.close()


def test_a_source_that_counts_anew_is_passed_over() -> None:
    """Older numbers were overtaken; a sender that starts again is heard once it has passed its former number."""
    link = TrackerLink()
    for count, heard in ((3, True), (2, False), (4, True)):
        sender = TrackerSender(link.address)
        fresh = False
        for k in range(count):
            sender.send(pose.make(p=SHIFTS[k]), (k + 1) * MS)
            fresh = link.drain()
        assert fresh == heard
        sender.close()
    link.close()


def test_another_sender_is_counted_and_not_used() -> None:
    link = TrackerLink()
    sender = TrackerSender(link.address)
    sender.send(pose.make(p=SHIFTS[0]), MS)
    assert link.drain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.2", 0))
        stranger.sendto(TrackerPose(9, 2_000_000, 0, 0, pose.make(p=SHIFTS[1]), 0.0).telegram(), link.address)
    assert not link.drain()
    assert link.foreign == 1
    np.testing.assert_allclose(link.T_tracker_target[:3, 3], SHIFTS[0], atol=1e-12)
    sender.close()
    link.close()


def test_a_mean_of_none_is_refused() -> None:
    with pytest.raises(InputError, match="of which the mean is taken"):
        TrackerLink(mean_of=0)


def test_a_single_pose_after_a_mean_is_itself() -> None:
    """Position, rotation and time of the mean before do not reach into the next cycle."""
    link = TrackerLink(mean_of=8)
    sender = TrackerSender(link.address)
    for k, (shift, turn) in enumerate(zip(SHIFTS, TURNS, strict=True)):
        sender.send(pose.make(rotation.exp(turn), shift), (k + 1) * MS)
    assert link.drain()
    assert link.time_ns == pytest.approx(2.5e6, abs=1)
    for k in range(2):
        alone = pose.make(rotation.exp(5.0 * TURNS[k]), 7.0 * SHIFTS[k])
        sender.send(alone, (9 + 4 * k) * MS)
        assert link.drain()
        np.testing.assert_allclose(link.T_tracker_target, alone, atol=1e-12)
        assert link.time_ns == (9 + 4 * k) * 1_000_000
    assert not link.drain()
    assert link.time_ns == 13_000_000
    sender.close()
    link.close()
