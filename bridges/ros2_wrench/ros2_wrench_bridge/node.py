"""The nodes that bring in: each subscribes to a topic and sends every message as a datagram to the loop."""

from __future__ import annotations

import contextlib
import socket
import sys
from typing import Any

from .conversion import Converter, Poses, Wrenches, address


def main() -> None:
    """Forward WrenchStamped to ``force_sensor.address`` of ``counterflex run``."""
    from geometry_msgs.msg import WrenchStamped

    parameters = {
        "topic": "/wrench",
        "to": "127.0.0.1:49300",
        "frame": "",
        "source": 0,
        "range_n": 0.0,
        "range_nm": 0.0,
    }
    _run("wrench_bridge", WrenchStamped, Wrenches, parameters)


def poses() -> None:
    """Forward PoseStamped of a tracker to ``tracker.address`` of ``counterflex run``."""
    from geometry_msgs.msg import PoseStamped

    parameters = {"topic": "/tracker/pose", "to": "127.0.0.1:49200", "frame": "", "source": 0, "sigma_mm": 0.0}
    _run("pose_bridge", PoseStamped, Poses, parameters)


def _run(name: str, message_type: Any, kind: type[Converter], parameters: dict[str, Any]) -> None:
    """Run until ROS ends; a parameter that cannot be used is one line and exit status 2."""
    import rclpy
    from rclpy.node import Node
    from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

    rclpy.init()
    node = Node(name)
    values = {name: node.declare_parameter(name, default).value for name, default in parameters.items()}
    topic, to = values.pop("topic"), values.pop("to")
    try:
        peer = address(to)
        converter = kind(**values)
    except ValueError as fault:
        print(f"error: {fault}", file=sys.stderr)
        raise SystemExit(2) from fault
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def forward(message: Any) -> None:
        data = converter.datagram(message, node.get_clock().now().nanoseconds)
        if data is None:
            if converter.left_out == 1:
                node.get_logger().warning(f"a message of frame '{message.header.frame_id}' is left out")
            return
        with contextlib.suppress(ConnectionError, BlockingIOError):
            own.sendto(data, peer)

    qos = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(message_type, topic, forward, qos)
    node.get_logger().info(f"{topic} -> {peer[0]}:{peer[1]}")
    try:
        with contextlib.suppress(KeyboardInterrupt):
            rclpy.spin(node)
    finally:
        node.get_logger().info(f"{converter.sent} datagrams sent, {converter.left_out} messages left out")
        own.close()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
