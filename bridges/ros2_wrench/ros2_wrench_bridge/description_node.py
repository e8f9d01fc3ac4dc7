"""The node: waits for one robot_description, writes it as the robot of a cell file, and ends."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from .description import save

DEFAULTS: dict[str, Any] = {"topic": "/robot_description", "folder": ".", "tip": "", "wait_s": 10.0}


def main() -> None:
    """Exit status 0 with both files written, 2 with one line."""
    import rclpy
    from rclpy.node import Node
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String

    rclpy.init()
    node = Node("counterflex_robot_description")
    values = {name: node.declare_parameter(name, default).value for name, default in DEFAULTS.items()}
    came: list[str] = []
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # robot_state_publisher says it once
    node.create_subscription(String, values["topic"], lambda message: came.append(message.data), qos)
    waited = 0.0
    while not came and waited < values["wait_s"]:
        rclpy.spin_once(node, timeout_sec=0.1)
        waited += 0.1
    node.destroy_node()
    rclpy.try_shutdown()
    try:
        if not came:
            raise ValueError(f"no robot_description came on {values['topic']} within {values['wait_s']:g} s")
        files = save(came[0], Path(values["folder"]), values["tip"])
    except (ValueError, OSError) as fault:
        print(f"error: {fault}", file=sys.stderr)
        raise SystemExit(2) from fault
    print(f"wrote {files[0]}, {files[1]}")


if __name__ == "__main__":
    main()
