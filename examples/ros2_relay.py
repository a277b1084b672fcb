"""A ROS 2 node passes on what `footsense ros2` sends over Zenoh, for nodes on any other middleware, such as Fast DDS.

    pip install eclipse-zenoh                        # all that it needs beside ROS 2; nothing of footsense
    python examples/ros2_relay.py                    # in a shell with ROS 2, whose RMW_IMPLEMENTATION is the nodes'
    footsense ros2 --config deploy/simulated.yaml    # the extra ros2; before or after

It is the Zenoh router that `footsense ros2` looks for, on port 7447 of this computer, or where its argument says.
"""

import json
import os
import sys

import rclpy
import zenoh
from rosidl_runtime_py.utilities import get_message

ENDPOINT = sys.argv[1] if len(sys.argv) > 1 else "tcp/[::]:7447"


class Relay:
    """Gives each message to a publisher of its topic, as the bytes that it is."""

    def __init__(self, session: zenoh.Session) -> None:
        self.node = rclpy.create_node("footsense_relay")
        self._publishers: dict[str, rclpy.publisher.Publisher | None] = {}
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        for topic in ("footsense", "diagnostics"):  # each message once: the other key is for Humble
            session.declare_subscriber(f"{domain}/{topic}/**/RIHS01_$*", self._pass_on)

    def _pass_on(self, sample: zenoh.Sample) -> None:
        _, *names, dds_type, _ = str(sample.key_expr).split("/")
        topic = "/" + "/".join(names)
        if topic not in self._publishers:
            package, _, _, name = dds_type.split("::")
            kind = f"{package}/msg/{name.removesuffix('_')}"
            try:
                self._publishers[topic] = self.node.create_publisher(get_message(kind), topic, 10)
            except (AttributeError, ImportError, ValueError):
                self._publishers[topic] = None
                self.node.get_logger().warning(f"{topic} is left out: this ROS has no {kind}")
        if publisher := self._publishers[topic]:
            publisher.publish(sample.payload.to_bytes())


if __name__ == "__main__":
    settings = {"mode": "router", "listen": {"endpoints": [ENDPOINT]}}
    settings["scouting"] = {"multicast": {"enabled": False}}
    rclpy.init()
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as router:
        rclpy.spin(Relay(router).node)
