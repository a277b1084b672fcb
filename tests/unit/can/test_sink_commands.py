"""What the sink makes of commands: taken, refused, counted, answered."""

import can

from firmware_interface.can.codes import CommandKind, Result
from firmware_interface.can.commands import ANSWER, UNSOLICITED_COUNTER, encode_command
from firmware_interface.can.crc8 import protect
from footsense.frames import Command, CommandResult
from tests.support.can_robot import MS, Robot


def test_a_command_arrives_and_its_answer_names_its_counter(robot: Robot) -> None:
    """A tare is handed to the loop; what became of it goes to whoever asked."""
    robot.ask(encode_command(1, 7, CommandKind.TARE))
    (command,) = robot.sink.commands()
    assert command == Command(CommandKind.TARE, 0)
    robot.sink.answer(CommandResult(command, Result.LOADED, ""))
    robot.sink.answer(CommandResult(command, Result.DONE, "the service's own tare"))
    robot.publish(20 * MS)
    answers = [ANSWER.decode(m.arbitration_id, bytes(m.data)) for m in robot.heard(0x140)]
    assert answers == [
        (1, 0, Result.LOADED, CommandKind.TARE, 7),
        (1, 1, Result.DONE, CommandKind.TARE, UNSOLICITED_COUNTER),
    ]


def test_bad_and_repeated_commands_are_counted_and_ignored(robot: Robot) -> None:
    """A wrong crc, another leg's frame under this id, and the same counter again do nothing."""
    good = encode_command(1, 3, CommandKind.STOP)
    robot.ask(bytes([good[0] ^ 1]) + good[1:])
    robot.ask(encode_command(2, 3, CommandKind.STOP))
    robot.ask(good)
    robot.ask(good)
    assert robot.sink.commands() == [Command(CommandKind.STOP, 0)]
    assert (robot.sink.stats.received_commands, robot.sink.stats.rejected_commands) == (4, 3)
    assert robot.heard(0x140) == []


def test_a_flood_of_commands_is_cut_to_ten_a_second(robot: Robot) -> None:
    """Valid ones and unknown ones: the rest is counted, and no answer of it loads the bus."""
    for second in range(2):
        robot.clock.t_ns = second * 1_000_000_000
        for n in range(50):
            robot.ask(encode_command(1, n % 15, CommandKind.TARE if n % 2 else CommandKind.STOP))
        assert len(robot.sink.commands()) == 10
    assert robot.sink.stats.rejected_commands == 80


def test_a_counter_names_a_command_of_its_kind(robot: Robot) -> None:
    """Another kind with the same counter is another command, not a repetition."""
    for kind in (CommandKind.STOP, CommandKind.START):
        robot.ask(encode_command(1, 3, kind))
    assert [command.kind for command in robot.sink.commands()] == [CommandKind.STOP, CommandKind.START]
    assert robot.sink.stats.rejected_commands == 0


def test_whoever_asks_is_answered(robot: Robot) -> None:
    """Two tares that overlap end as one, and each gets the answer; two stops end one by one."""
    for counter, kind in ((1, CommandKind.TARE), (2, CommandKind.TARE), (3, CommandKind.STOP)):
        robot.ask(encode_command(1, counter, kind))
    robot.ask(encode_command(1, 4, CommandKind.STOP))
    assert len(robot.sink.commands()) == 4
    answers = []
    for kind in (CommandKind.STOP, CommandKind.STOP, CommandKind.TARE):
        robot.sink.answer(CommandResult(Command(kind, 0), Result.DONE, ""))
        heard = [ANSWER.decode(m.arbitration_id, bytes(m.data)) for m in robot.heard(0x140)]
        answers.append([(answer.command_kind, answer.command_counter) for answer in heard])
    assert answers == [
        [(CommandKind.STOP, 3)],
        [(CommandKind.STOP, 4)],
        [(CommandKind.TARE, 1), (CommandKind.TARE, 2)],
    ]


def test_a_restarted_consumer_may_begin_with_the_same_counter(robot: Robot) -> None:
    """A counter that was last seen a second ago is no repetition."""
    robot.ask(encode_command(1, 0, CommandKind.STOP))
    assert len(robot.sink.commands()) == 1
    robot.clock.t_ns = 1000 * MS
    robot.ask(encode_command(1, 0, CommandKind.START))
    assert robot.sink.commands() == [Command(CommandKind.START, 0)]


def test_an_unknown_command_is_refused_in_words(robot: Robot) -> None:
    """A whole frame that asks for nothing known gets the answer UNKNOWN."""
    robot.ask(protect(0x111, bytes([5, 9, 0]) + b"zero"))
    assert robot.sink.commands() == []
    answers = [ANSWER.decode(m.arbitration_id, bytes(m.data)) for m in robot.heard(0x140)]
    assert answers == [(1, 0, Result.UNKNOWN, 9, 5)]
    robot.ask(protect(0x111, bytes([6, 9, 0]) + b"zero"))
    assert robot.sink.commands() == []
    assert robot.sink.stats.rejected_commands == 2


def test_foreign_traffic_neither_hides_a_command_nor_piles_up(robot: Robot) -> None:
    """Frames of others are taken from the channel with the commands."""
    for can_id in (0x123, 0x112, 0x201, 0x7FF):
        robot.ask(b"foreign", can_id)
    tare = encode_command(1, 0, CommandKind.TARE)
    robot.consumer.send(can.Message(arbitration_id=0x111, data=tare, is_extended_id=True))
    robot.consumer.send(can.Message(arbitration_id=0x111, is_remote_frame=True, dlc=8, is_extended_id=False))
    robot.consumer.send(can.Message(is_error_frame=True))
    robot.ask(tare)
    assert len(robot.sink.commands()) == 1
    assert (robot.sink.stats.received_commands, robot.sink.stats.bus_errors) == (1, 1)
    assert robot.sink.commands() == []
    assert robot.sink.stats.received_commands == 1
