"""A sink on a virtual bus, with a consumer that listens."""

from collections.abc import Iterator

import pytest

from tests.support.can_robot import Robot


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    """A robot with one leg."""
    robot = Robot(request.node.nodeid)
    yield robot
    robot.close()
