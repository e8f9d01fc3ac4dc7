"""Conversion of the ROS 2 bridge, without ROS: plain objects with the fields of WrenchStamped and PoseStamped."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from counterflex.geometry import rotation
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, NO_ORIENTATION, read_pose
from counterflex.protocols.wrench.telegram import INVALID, SATURATED, Wrench, read_wrench

FILE = Path(__file__).resolve().parents[2] / "bridges" / "ros2_wrench" / "ros2_wrench_bridge" / "conversion.py"


@pytest.fixture(scope="module")
def conversion() -> ModuleType:
    spec = importlib.util.spec_from_file_location("ros2_wrench_conversion", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def message(*w: float, stamp: tuple[int, int] = (12, 345), frame: str = "ft_sensor") -> Any:
    values = w or (1.0, -2.0, 3.0, 0.1, -0.2, 0.3)
    three = [SimpleNamespace(x=values[k], y=values[k + 1], z=values[k + 2]) for k in (0, 3)]
    header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp[0], nanosec=stamp[1]), frame_id=frame)
    return SimpleNamespace(header=header, wrench=SimpleNamespace(force=three[0], torque=three[1]))


def test_a_message_is_read_as_the_datagram_that_counterflex_takes(conversion: ModuleType) -> None:
    bridge = conversion.Wrenches(source=9)
    first, second = (read_wrench(bridge.datagram(message(), 0)) for _ in range(2))
    assert first == Wrench(1, 12_000_000_345, 0, 9, (1.0, -2.0, 3.0, 0.1, -0.2, 0.3))
    assert second.sequence == 2


def test_range_and_numbers_that_are_none_go_into_the_status(conversion: ModuleType) -> None:
    bridge = conversion.Wrenches(range_n=330.0, range_nm=30.0)
    beyond = bridge.datagram(message(0.0, 0.0, -330.0, 0.0, 0.0, 0.0), 0)
    assert read_wrench(beyond).status == SATURATED
    assert read_wrench(bridge.datagram(message(0.0, 0.0, 0.0, 0.0, 31.0, 0.0), 0)).status == SATURATED
    assert read_wrench(bridge.datagram(message(0.0, math.nan, 0.0, 0.0, 0.0, 0.0), 0)).status == INVALID
    assert read_wrench(bridge.datagram(message(0.0, 329.0, 0.0, 0.0, 0.0, 29.0), 0)).status == 0


def test_without_a_stamp_the_arrival_counts_and_another_frame_is_left_out(conversion: ModuleType) -> None:
    bridge = conversion.Wrenches(frame="ft_sensor")
    assert read_wrench(bridge.datagram(message(stamp=(0, 0)), 777)).time_ns == 777
    assert bridge.datagram(message(frame="tool0"), 0) is None
    assert (bridge.sent, bridge.left_out) == (1, 1)


def pose(p: tuple[float, ...], wxyz: tuple[float, ...], frame: str = "tracker") -> Any:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=12, nanosec=345), frame_id=frame)
    place, turn = dict(zip("xyz", p, strict=True)), dict(zip("wxyz", wxyz, strict=True))
    return SimpleNamespace(
        header=header, pose=SimpleNamespace(position=SimpleNamespace(**place), orientation=SimpleNamespace(**turn))
    )


def test_a_pose_is_read_as_the_datagram_that_the_tracker_link_takes(conversion: ModuleType) -> None:
    bridge = conversion.Poses(source=3, sigma_mm=0.02)
    s = math.sin(math.pi / 6)  # 60 deg about y: x of the target points to (cos 60, 0, -sin 60) of the tracker
    read = read_pose(bridge.datagram(pose((1.5, -0.25, 0.75), (math.cos(math.pi / 6), 0.0, s, 0.0)), 0))
    assert (read.sequence, read.time_ns, read.status, read.frame_id) == (1, 12_000_000_345, 0, 3)
    assert read.T_tracker_target[:3, 3] == pytest.approx([1.5, -0.25, 0.75], abs=1e-12)
    assert read.T_tracker_target[:3, 0] == pytest.approx([0.5, 0.0, -math.sqrt(0.75)], abs=1e-12)
    assert read.sigma_m == pytest.approx(20e-6)
    assert rotation.quat_wxyz(read.T_tracker_target[:3, :3])[2] == pytest.approx(s)


def test_a_pose_that_is_none_is_a_broken_beam_at_the_last_place(conversion: ModuleType) -> None:
    bridge = conversion.Poses(frame="tracker")
    assert bridge.datagram(pose((math.nan, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)), 0) is None  # nothing to repeat
    assert bridge.datagram(pose((1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), frame="base"), 0) is None
    assert (bridge.sent, bridge.left_out) == (0, 2)
    assert read_pose(bridge.datagram(pose((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0)), 0)).status == 0
    for broken in (pose((1.0, 2.0, math.inf), (1.0, 0.0, 0.0, 0.0)), pose((1.0, 2.0, 4.0), (0.5, 0.0, 0.0, 0.0)),
                   pose((1.0, 2.0, 4.0), (math.nan, 0.0, 0.0, 0.0))):  # fmt: skip
        read = read_pose(bridge.datagram(broken, 0))
        assert read.status == BEAM_BROKEN
        assert read.T_tracker_target[:3, 3] == pytest.approx([1.0, 2.0, 3.0])
    assert read_pose(bridge.datagram(pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 0.0)), 0)).status == NO_ORIENTATION


@pytest.mark.parametrize("text", ["127.0.0.1", "127.0.0.1:", ":49300", "host:70000", "host:x"])
def test_bad_parameters_are_one_line(conversion: ModuleType, text: str) -> None:
    with pytest.raises(ValueError, match="is not HOST:PORT"):
        conversion.address(text)
    with pytest.raises(ValueError, match="source id"):
        conversion.Wrenches(source=-1)
    with pytest.raises(ValueError, match="mm is negative"):
        conversion.Poses(sigma_mm=math.inf)
    with pytest.raises(ValueError, match="negative"):
        conversion.Wrenches(range_n=-1.0)


def test_the_conversion_needs_no_ros(conversion: ModuleType) -> None:
    assert "rclpy" not in sys.modules
    assert conversion.address("robot:49300") == ("robot", 49300)
