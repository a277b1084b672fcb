"""A bus on which other nodes send frames of CAN FD: the service sends and executes classic ones."""

import can
import pytest

from firmware_interface.can.codes import CommandKind
from firmware_interface.can.commands import encode_command
from footsense.frames import LEGS
from tests.support.can_robot import MS, Robot


def test_classic_frames_pass_and_those_of_fd_say_nothing(request: pytest.FixtureRequest) -> None:
    """A command in a frame of CAN FD is none, and the one behind it is executed."""
    robot = Robot(request.node.nodeid, LEGS)
    for counter, is_fd, kind in ((0, True, CommandKind.STOP), (1, False, CommandKind.TARE)):
        data = encode_command(1, counter, kind)
        robot.consumer.send(can.Message(arbitration_id=0x111, data=data, is_extended_id=False, is_fd=is_fd))
    commands = robot.sink.commands()
    assert [(command.kind, command.leg) for command in commands] == [(CommandKind.TARE, 0)]
    assert robot.sink.stats.received_commands == 1
    robot.publish(11 * MS)
    sent = robot.heard()
    assert len(sent) >= 2 * len(LEGS)
    assert not any(message.is_fd or len(message.data) > 8 for message in sent)
    robot.close()
