"""A ROS 2 node takes the forces that `footsense ros2` publishes, and leaves out each leg whose force has become old.

    footsense run --config deploy/simulated.yaml                 # or the service of a robot
    footsense ros2 --config deploy/simulated.yaml                # the extra ros2
    export RMW_IMPLEMENTATION=rmw_zenoh_cpp; ros2 run rmw_zenoh_cpp rmw_zenohd &
    python examples/ros2_node.py                                 # in a shell with ROS 2, the same ROS_DOMAIN_ID

A leg without a usable force sends no wrench: only the age of its last stamp shows it.
"""

import sys

try:
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from rclpy.qos import qos_profile_sensor_data
except ImportError as error:
    sys.exit(f"ros2_node.py needs {error.name}: run it in a shell with ROS 2, after its setup.bash")

LEGS = ("lf", "lm", "lr", "rf", "rm", "rr")
MAX_AGE_S = 0.1


class Feet:
    """The latest force of each leg."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("feet")
        self._last: dict[str, WrenchStamped] = {}
        for leg in LEGS:
            topic = f"/footsense/{leg}/wrench"
            self.node.create_subscription(WrenchStamped, topic, self._take, qos_profile_sensor_data)
        self.node.create_timer(0.1, self._tell)

    def _take(self, message: WrenchStamped) -> None:
        self._last[message.header.frame_id.removesuffix("_foot")] = message

    def load_n(self, leg: str) -> float | None:
        """Return the load along a leg [N]; None if it is not known now."""
        if leg not in self._last:
            return None
        message, now_s = self._last[leg], 1e-9 * self.node.get_clock().now().nanoseconds
        age_s = now_s - (message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        return float(message.wrench.force.z) if abs(age_s) < MAX_AGE_S else None  # the future: clocks differ

    def _tell(self) -> None:
        loads_n = {leg: self.load_n(leg) for leg in LEGS}
        told = [f"{leg} unknown" if n is None else f"{leg} {n:.2f} N" for leg, n in loads_n.items()]
        self.node.get_logger().info(", ".join(told))


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(Feet().node)
