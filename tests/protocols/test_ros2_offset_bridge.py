"""Offsets out and description in of the ROS 2 bridge, without ROS: plain objects with the fields of the messages."""

from __future__ import annotations

import importlib
import math
import sys
import tomllib
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from counterflex.geometry import rotation
from counterflex.protocols.processes.snapshot import SnapshotMemory, SnapshotReader, SnapshotSlots, check_of

FOLDER = Path(__file__).resolve().parents[2] / "bridges" / "ros2_wrench"
MS = 1_000_000


@pytest.fixture(scope="module")
def bridge() -> Iterator[Any]:
    sys.path.insert(0, str(FOLDER))
    names = ("offsets", "description", "offset_node", "description_node")
    try:
        yield SimpleNamespace(**{name: importlib.import_module(f"ros2_wrench_bridge.{name}") for name in names})
    finally:
        sys.path.remove(str(FOLDER))
        for name in [name for name in sys.modules if name.startswith("ros2_wrench_bridge")]:
            del sys.modules[name]


def message(kind: str) -> Any:
    """An empty message with the fields of geometry_msgs."""
    header = SimpleNamespace(frame_id="", stamp=SimpleNamespace(sec=0, nanosec=0))
    if kind == "pose":
        pose = SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace())
        return SimpleNamespace(header=header, pose=pose)
    return SimpleNamespace(header=header, twist=SimpleNamespace(linear=SimpleNamespace(), angular=SimpleNamespace()))


def shot(bridge: Any, number: int, time_ms: int, *correction: float, trouble: bool = False) -> Any:
    return bridge.offsets.Shot(number, time_ms * MS, correction or (1e-4, 0.0, 0.0, 0.0, 0.0, 0.0), trouble)


def test_pose_has_the_offset_the_frame_and_the_time_of_the_snapshot(bridge: Any) -> None:
    v = (1e-4, -2e-4, 3e-4, 0.001, -0.002, 0.0005)
    offset = bridge.offsets.Offsets().take(shot(bridge, 1, 1000, *v), 1004 * MS)
    said = bridge.offsets.fill_pose(message("pose"), offset, "part", 7_000_000_001 + 4 * MS)
    place, turn = said.pose.position, said.pose.orientation
    assert (place.x, place.y, place.z) == pytest.approx(v[:3])
    assert (said.header.frame_id, said.header.stamp.sec, said.header.stamp.nanosec) == ("part", 7, 1)
    R = rotation.exp(np.array(v[3:]))
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    assert R[0] == pytest.approx([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)])
    assert R[1] == pytest.approx([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)])


def test_vectors_are_turned_into_the_axes_of_the_frame(bridge: Any) -> None:
    """The part stands a quarter turn about z in the frame: its x is the frame's y."""
    half = math.sqrt(0.5)
    offsets = bridge.offsets.Offsets((0.0, 0.0, half, half))
    offset = offsets.take(shot(bridge, 1, 0, 1e-3, 0.0, 0.0, 0.0, 0.01, 0.0), 0)
    assert offset.position_m == pytest.approx((0.0, 1e-3, 0.0), abs=1e-18)
    assert bridge.offsets.rotation_vector(offset.orientation_xyzw) == pytest.approx((-0.01, 0.0, 0.0), abs=1e-15)


def test_twist_is_the_change_of_the_offset(bridge: Any) -> None:
    """0.1 mm in 4 ms are 25 mm/s; the turn between both by the logarithm of the rotation, large ones too."""
    offsets = bridge.offsets.Offsets()
    a, b = np.array([0.4, -0.3, 0.2]), np.array([0.1, 0.5, -0.6])
    first = offsets.take(shot(bridge, 5, 100, 0.0, 0.0, 0.0, *a), 100 * MS)
    assert bridge.offsets.fill_twist(message("twist"), first, "part", 0) is None
    second = offsets.take(shot(bridge, 6, 104, 1e-4, 0.0, 0.0, *b), 104 * MS)
    said = bridge.offsets.fill_twist(message("twist"), second, "part", 104 * MS)
    assert said.twist.linear.x == pytest.approx(0.025)
    expected = rotation.log(rotation.exp(b) @ rotation.exp(a).T) / 0.004
    assert [said.twist.angular.x, said.twist.angular.y, said.twist.angular.z] == pytest.approx(expected.tolist())
    assert bridge.offsets.quaternion(a.tolist())[3] > 0.0


def test_stale_values_are_never_published(bridge: Any) -> None:
    offsets = bridge.offsets.Offsets(max_age_s=0.1)
    assert offsets.take(shot(bridge, 1, 0), 100 * MS) is not None
    assert offsets.take(shot(bridge, 1, 0), 101 * MS) is None  # the same snapshot
    assert offsets.take(shot(bridge, 2, 1), 102 * MS) is None  # 101 ms old
    assert (offsets.published, offsets.stale) == (1, 1)
    behind = offsets.take(shot(bridge, 3, 104), 104 * MS)
    assert behind is not None
    assert behind.velocity_m_s is None  # no change over a gap


def test_a_lost_loop_stops_the_messages_and_a_new_run_begins_without_a_twist(bridge: Any) -> None:
    offsets = bridge.offsets.Offsets()
    assert offsets.take(shot(bridge, 900, 0), 0) is not None
    assert offsets.take(None, 4 * MS) is None
    again = offsets.take(shot(bridge, 901, 8), 8 * MS)
    assert again is not None
    assert again.velocity_m_s is None
    new = offsets.take(shot(bridge, 1, 12), 12 * MS)
    assert new is not None
    assert new.velocity_m_s is None


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_trouble_the_future_and_numbers_that_are_none_are_refused(bridge: Any, bad: float) -> None:
    offsets = bridge.offsets.Offsets()
    assert offsets.take(shot(bridge, 1, 0, bad, 0.0, 0.0, 0.0, 0.0, 0.0), 0) is None
    assert offsets.take(shot(bridge, 2, 4, trouble=True), 4 * MS) is None
    assert offsets.take(shot(bridge, 3, 9), 8 * MS) is None
    assert (offsets.published, offsets.refused) == (0, 3)


def test_a_rate_below_that_of_the_loop_takes_the_newest(bridge: Any) -> None:
    """A loop of 250 Hz read at 50 Hz: each message its own snapshot, the twist over five of them."""
    offsets = bridge.offsets.Offsets()
    came = [
        offsets.take(shot(bridge, 5 * k, 20 * k, 1e-5 * k, 0.0, 0.0, 0.0, 0.0, 0.0), 20 * k * MS) for k in range(1, 6)
    ]
    assert offsets.published == 5
    assert [offset.velocity_m_s[0] for offset in came[1:]] == pytest.approx([5e-4] * 4)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (((0.0, 0.0, 0.0, 2.0),), "length 1"),
        (((0.0, 0.0, 1.0),), "quaternion"),
        (((0.0, 0.0, 0.0, 1.0), 0.0), "max_age_s"),
        (((0.0, 0.0, 0.0, 1.0), 0.1, 60.0), "max_gap_s"),
    ],
)
def test_bad_parameters_are_one_line(bridge: Any, arguments: tuple[Any, ...], text: str) -> None:
    with pytest.raises(ValueError, match=text) as fault:
        bridge.offsets.Offsets(*arguments)
    assert "\n" not in str(fault.value)
    with pytest.raises(ValueError, match="rate_hz"):
        bridge.offset_node.checked_rate(1000.0)


def test_snapshots_of_a_loop_come_through(bridge: Any, tmp_path: Path) -> None:
    """Real shared memory, as a loop writes it; only a loop that lives counts."""

    class Seen(Enum):
        RUNNING = "running"
        SILENT = "silent"

    memory = SnapshotMemory(tmp_path / "words")
    slots = SnapshotSlots(memory.path, {})
    try:
        place = slots.begin()
        one = slots.slots[place]
        one["number"], one["time_ns"], one["correction"] = 1, 55, (1e-4, 0.0, 0.0, 0.0, 0.0, 2e-4)
        numbers = slots.slots[place : place + 1].view(np.int64).reshape(1, -1)
        one["check"] = check_of(numbers)[0]
        slots.commit()
        reader = SnapshotReader(memory.path)
        last = reader.take()[-1]
        run = SimpleNamespace(seen=Seen.RUNNING, last=last)
        assert bridge.offsets.shot_of(run) == bridge.offsets.Shot(1, 55, (1e-4, 0.0, 0.0, 0.0, 0.0, 2e-4), False)
        run.seen = Seen.SILENT
        assert bridge.offsets.shot_of(run) is None
        assert bridge.offsets.shot_of(SimpleNamespace(seen=Seen.RUNNING, last=None)) is None
        reader.close()
    finally:
        memory.close()


def urdf(tip: str = "tool0", joints: int = 6) -> str:
    """Six axes: z, y, y, x, y, x."""
    axes = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"][:joints]
    links = "".join(f'<link name="link{k}"/>' for k in range(joints + 1)) + f'<link name="{tip}"/>'
    turning = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>'
        f'<origin xyz="0.1 0 0.3"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="2" effort="1"/></joint>'
        for k, axis in enumerate(axes)
    )
    last = f'<joint name="end" type="fixed"><parent link="link{joints}"/><child link="{tip}"/></joint>'
    return f'<?xml version="1.0"?><robot name="arm">{links}{turning}{last}</robot>'


def test_a_description_becomes_the_robot_of_a_cell_file(bridge: Any, tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy", reason="the extra urdf is not installed")
    from counterflex.robot.model.urdf import load_urdf

    file, table = bridge.description.save(urdf(), tmp_path / "cell")
    robot = tomllib.loads(table.read_text())["robot"]
    assert robot == {"urdf": "robot.urdf", "urdf_tip": "tool0"}
    loaded = load_urdf(file, tip_link=robot["urdf_tip"])
    assert (loaded.name, len(loaded.segments)) == ("arm", 6)
    assert sorted(entry.name for entry in (tmp_path / "cell").iterdir()) == ["robot.toml", "robot.urdf"]


@pytest.mark.parametrize(
    ("text", "tip", "told"),
    [
        ("no xml", "", "well-formed"),
        ("<sdf/>", "", "no URDF"),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>', "", "expand it first"),
        (urdf(joints=5), "", "5 turning joints"),
        (urdf(), "wrist", "no link 'wrist'"),
    ],
)
def test_a_description_that_is_none_writes_nothing(bridge: Any, tmp_path: Path, text: str, tip: str, told: str) -> None:
    with pytest.raises(ValueError, match=told) as fault:
        bridge.description.save(text, tmp_path / "cell", tip)
    assert "\n" not in str(fault.value)
    assert not (tmp_path / "cell").exists()


def test_without_a_known_flange_counterflex_chooses(bridge: Any, tmp_path: Path) -> None:
    _, table = bridge.description.save(urdf(tip="gripper_mount"), tmp_path)
    assert tomllib.loads(table.read_text())["robot"] == {"urdf": "robot.urdf"}


def test_nothing_of_it_needs_ros(bridge: Any) -> None:
    assert isinstance(bridge.offset_node, ModuleType)
    assert "rclpy" not in sys.modules
