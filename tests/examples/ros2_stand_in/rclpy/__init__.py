"""What `examples/ros2_node.py` uses of rclpy, on the same DDS: ROS 2 is not on PyPI."""

import os
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


def init() -> None:
    """Begin; nothing to do here."""


class Node:
    """A participant with its readers and one timer."""

    def __init__(self) -> None:
        self._participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        self._readers: list[tuple[Any, Callable[[Any], None]]] = []
        self._timer: tuple[float, Callable[[], None]] = (1.0, init)

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos: object
    ) -> None:
        self._readers.append(
            (DataReader(self._participant, Topic(self._participant, f"rt{topic}", kind)), callback)
        )

    def create_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        self._timer = period_s, callback

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.time_ns()))

    def get_logger(self) -> Any:
        return SimpleNamespace(info=lambda text: print(text, flush=True))

    def spin_once(self) -> None:
        for reader, callback in self._readers:
            for message in reader.take(100):
                callback(message)
        self._timer[1]()
        time.sleep(self._timer[0])


def create_node(name: str) -> Node:
    """Return a node."""
    return Node()


def spin(node: Node) -> None:
    """Serve a node for ever."""
    while True:
        node.spin_once()
