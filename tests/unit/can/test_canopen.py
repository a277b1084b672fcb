"""A bus shared with CANopen drives of all our node ids, and with their master, as the package canopen has them."""

from collections.abc import Iterator

import can
import canopen
import pytest
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable

from firmware_interface.can.codes import CommandKind, GaitEventKind, Result, State
from footsense.client import GAIT_EVENT_IDS, LINK_IDS, REPORT_IDS, Link, PendingCommands
from footsense.frames import ALL_LEGS, Command, CommandResult, GaitEvent
from tests.support.can_robot import MS, Robot
from tests.support.frames import gait_frame

NODES = range(1, 9)


def dictionary() -> ObjectDictionary:
    """Return the objects of four PDOs in each direction, as CiA 301 sets them up."""
    objects = ObjectDictionary()
    for n in range(4):
        for index in (0x1400 + n, 0x1600 + n, 0x1800 + n, 0x1A00 + n):
            record = ODRecord(str(index), index)
            for subindex in range(3):
                record.add_member(ODVariable(f"{index} {subindex}", index, subindex))
            objects.add_object(record)
    return objects


@pytest.fixture
def networks(request: pytest.FixtureRequest) -> Iterator[tuple[canopen.Network, canopen.Network]]:
    """Yield drives of nodes 1 to 8, and their master, each with a bus of its own on the test's channel."""
    made = [
        canopen.Network(can.Bus(interface="virtual", channel=request.node.nodeid, preserve_timestamps=True))
        for _ in range(2)
    ]
    drives, master = made
    for node in NODES:
        drive, remote = canopen.LocalNode(node, dictionary()), canopen.RemoteNode(node, dictionary())
        drives.add_node(drive)
        master.add_node(remote)
        for pdo in (*drive.rpdo.map.values(), *remote.tpdo.map.values()):
            pdo.cob_id, pdo.enabled = pdo.predefined_cob_id, True
            pdo.subscribe()
    yield drives, master
    for network in made:
        assert network.bus is not None
        network.bus.shutdown()


def pump(network: canopen.Network) -> set[int]:
    """Hand a network all frames that have arrived, and return the ids of those that it took for its own."""
    assert network.bus is not None
    taken = set()
    while (message := network.bus.recv(timeout=0)) is not None:
        if message.arbitration_id in network.subscribers:
            taken.add(message.arbitration_id)
        network.listeners[0].on_message_received(message)
    return taken


def send_every_kind(robot: Robot) -> None:
    """Send every kind of frame of every leg, and a command to each."""
    commands = PendingCommands()
    for n in range(240):
        gait = gait_frame(n * 5 * MS, len(ALL_LEGS))
        events = (GaitEvent(GaitEventKind.TOUCHDOWN, n, n * 5 * MS, 0.002),) if n < len(ALL_LEGS) else ()
        robot.publish(n * 5 * MS, State.VALID, gait=gait._replace(events=events))
    for row, node in enumerate(NODES):
        can_id, data = commands.encode(node, CommandKind.TARE, 0)
        robot.ask(data, can_id)
        robot.sink.commands()
        robot.sink.answer(CommandResult(Command(CommandKind.TARE, row), Result.DONE, ""))


def test_neither_drives_nor_master_take_a_frame_of_ours_for_theirs(
    request: pytest.FixtureRequest, networks: tuple[canopen.Network, canopen.Network]
) -> None:
    """No drive gets process data, a request or a command from us; the master sees no node, heartbeat or emergency."""
    drives, master = networks
    robot = Robot(request.node.nodeid, ALL_LEGS)
    send_every_kind(robot)
    sent = {message.arbitration_id for message in robot.heard()}
    assert len(sent) == 8 * 10
    assert [pump(drives), pump(master)] == [set(), set()]
    assert master.scanner.nodes == drives.scanner.nodes == []
    assert {master[node].nmt.state for node in NODES} == {"INITIALISING"}
    assert not any(master[node].emcy.log for node in NODES)
    assert robot.heard() == []  # no drive answers
    robot.close()


def test_frames_of_drives_are_no_commands_and_no_forces(
    request: pytest.FixtureRequest, networks: tuple[canopen.Network, canopen.Network]
) -> None:
    """Process data in both directions, heartbeats, emergencies and transfers; the master sees the drives alone."""
    drives, master = networks
    robot = Robot(request.node.nodeid, ALL_LEGS)
    for node in NODES:
        drive, remote = drives[node], master[node]
        for pdo in (*drive.tpdo.map.values(), *remote.rpdo.map.values()):
            pdo.cob_id = pdo.predefined_cob_id
            pdo.transmit()
        drive.emcy.send(0x1000)
        drive.nmt.send_command(1)
        drives.send_message(0x580 + node, bytes(8))
        drives.send_message(0x700 + node, b"\x05")
    master.scanner.search(8)
    heard = robot.heard()
    assert len(heard) > 8 * 11
    link = Link()
    known = {*LINK_IDS, *REPORT_IDS, *GAIT_EVENT_IDS}
    assert not any(m.arbitration_id in known or link.feed(m.arbitration_id, bytes(m.data), 0) for m in heard)
    assert robot.sink.commands() == []
    assert robot.sink.stats.received_commands == robot.sink.stats.rejected_commands == 0
    pump(master)
    assert sorted(master.scanner.nodes) == list(NODES)
    robot.close()
