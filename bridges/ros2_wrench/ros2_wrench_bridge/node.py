"""The node: subscribes to WrenchStamped and sends each message as a datagram."""

from __future__ import annotations

import contextlib
import socket
import sys

from .conversion import Converter, address


def main() -> None:
    """Run until ROS ends; a parameter that cannot be used is one line and exit status 2."""
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from rclpy.node import Node
    from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

    rclpy.init()
    node = Node("wrench_bridge")
    defaults = {"topic": "/wrench", "to": "127.0.0.1:49300", "frame": "", "source": 0, "range_n": 0.0, "range_nm": 0.0}
    values = {name: node.declare_parameter(name, default).value for name, default in defaults.items()}
    try:
        peer = address(values["to"])
        converter = Converter(values["source"], values["frame"], values["range_n"], values["range_nm"])
    except ValueError as fault:
        print(f"error: {fault}", file=sys.stderr)
        raise SystemExit(2) from fault
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def forward(message: WrenchStamped) -> None:
        data = converter.datagram(message, node.get_clock().now().nanoseconds)
        if data is None:
            if converter.left_out == 1:
                node.get_logger().warning(f"a message of frame '{message.header.frame_id}' is left out")
            return
        with contextlib.suppress(ConnectionError, BlockingIOError):
            own.sendto(data, peer)

    qos = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(WrenchStamped, values["topic"], forward, qos)
    node.get_logger().info(f"{values['topic']} -> {peer[0]}:{peer[1]}")
    try:
        with contextlib.suppress(KeyboardInterrupt):
            rclpy.spin(node)
    finally:
        node.get_logger().info(f"{converter.sent} datagrams sent, {converter.left_out} messages of another frame")
        own.close()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
