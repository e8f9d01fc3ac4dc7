"""The node: publishes the correction of a counterflex loop as PoseStamped and TwistStamped. It only reads."""

from __future__ import annotations

import contextlib
import sys
import time
from pathlib import Path
from typing import Any

from .offsets import Offsets, fill_pose, fill_twist, shot_of

DEFAULTS: dict[str, Any] = {
    "log": "log", "pose_topic": "~/offset", "twist_topic": "~/offset_rate", "frame": "part",
    "part_in_frame_xyzw": [0.0, 0.0, 0.0, 1.0], "rate_hz": 50.0, "max_age_s": 0.1,
}  # fmt: skip
FASTEST_HZ = 250.0


def checked_rate(rate_hz: float) -> float:
    """The rate, Hz.

    Raises:
        ValueError: It is out of range.
    """
    if not 0.1 <= rate_hz <= FASTEST_HZ:
        raise ValueError(f"rate_hz {rate_hz} is not within 0.1 .. {FASTEST_HZ:g} Hz")
    return rate_hz


def main() -> None:
    """Run until ROS ends; a parameter that cannot be used is one line and exit status 2."""
    import rclpy
    from geometry_msgs.msg import PoseStamped, TwistStamped
    from rclpy.node import Node

    from counterflex.app.opcua.server import ObservedRun

    rclpy.init()
    node = Node("counterflex_offsets")
    values = {name: node.declare_parameter(name, default).value for name, default in DEFAULTS.items()}
    try:
        rate = checked_rate(values["rate_hz"])
        offsets = Offsets(values["part_in_frame_xyzw"], values["max_age_s"], max(0.1, 3.0 / rate))
    except ValueError as fault:
        print(f"error: {fault}", file=sys.stderr)
        raise SystemExit(2) from fault
    run = ObservedRun(Path(values["log"]))
    poses = node.create_publisher(PoseStamped, values["pose_topic"], 10)
    twists = node.create_publisher(TwistStamped, values["twist_topic"], 10)

    def tick() -> None:
        run.poll()
        offset = offsets.take(shot_of(run), time.monotonic_ns())
        if offset is None:
            return
        now_ns = node.get_clock().now().nanoseconds
        poses.publish(fill_pose(PoseStamped(), offset, values["frame"], now_ns))
        twist = fill_twist(TwistStamped(), offset, values["frame"], now_ns)
        if twist is not None:
            twists.publish(twist)

    node.create_timer(1.0 / rate, tick)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            rclpy.spin(node)
    finally:
        run.close()
        counts = f"{offsets.published} offsets published, {offsets.stale} too old, {offsets.refused} refused"
        node.get_logger().info(counts)
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
