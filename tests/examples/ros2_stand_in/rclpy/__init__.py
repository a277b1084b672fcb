"""What the examples use of rclpy, as a node with rmw_zenoh_cpp: ROS 2 is not on PyPI. Shares no code with footsense."""

import json
import os
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import zenoh


def init() -> None:
    """Begin; nothing to do here."""


class Node:
    """A session with its subscribers and one timer."""

    def __init__(self) -> None:
        settings = {
            "mode": "peer",
            "scouting": {"multicast": {"enabled": False}},
            "listen": {"endpoints": ["tcp/127.0.0.1:0"]},
            "connect": {"endpoints": [os.environ["STAND_IN_ROUTER"]], "retry": {"period_init_ms": 100}},
        }
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
        self._taken: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._timer: tuple[float, Callable[[], None]] = (1.0, init)

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos: object
    ) -> None:
        key = f"{os.environ['ROS_DOMAIN_ID']}{topic}/geometry_msgs::msg::dds_::{kind.__name__}_/RIHS01_$*"
        self._session.declare_subscriber(
            key, lambda sample: self._taken.append((callback, kind.of_cdr(sample.payload.to_bytes())))
        )

    def create_publisher(self, kind: str, topic: str, depth: int) -> Any:
        """Return a publisher that says what it gets, for the first time."""
        told: list[bytes] = []

        def publish(data: bytes) -> None:
            if not told:
                told.append(data)
                print(f"{topic} {kind} {len(data)} bytes", flush=True)

        return SimpleNamespace(publish=publish)

    def create_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        self._timer = period_s, callback

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.time_ns()))

    def get_logger(self) -> Any:
        say = partial(print, flush=True)
        return SimpleNamespace(info=say, warning=say)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def spin_once(self) -> None:
        while self._taken:
            callback, message = self._taken.popleft()
            callback(message)
        self._timer[1]()
        time.sleep(self._timer[0])


def create_node(name: str) -> Node:
    """Return a node."""
    return Node()


def spin(node: Node) -> None:
    """Serve a node until it is interrupted."""
    try:
        while True:
            node.spin_once()
    finally:
        node.close()
