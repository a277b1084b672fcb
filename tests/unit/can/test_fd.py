"""CAN FD: one frame for all legs, where the interface can send it."""

from pathlib import Path

import can
import pytest

from firmware_interface.can.all_legs import FORCES4_ID, FORCES_ID, decode_forces
from firmware_interface.can.codes import NODE_IDS, Flag
from footsense.can import channel
from footsense.can.interface import Can
from footsense.client import Link, LinkStatus
from footsense.daemon.can_output import open_wire
from footsense.errors import CanError
from footsense.frames import ALL_LEGS, LEGS
from tests.support.can_robot import MS, Robot
from tests.support.frames import gait_frame


def test_one_frame_has_the_forces_of_all_legs(request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """With the higher bit rate for its data; a client uses it as the single frames, and the log has it whole."""
    log = tmp_path / "walk.log"
    robot = Robot(request.node.nodeid, LEGS, log, fd=True)
    link = Link()
    for message in robot.boot:
        link.feed(message.arbitration_id, bytes(message.data), 0)
    for n in range(1, 5):
        robot.publish(n * 11 * MS, age_ns=12_300_000, flags=Flag.CONTACT, gait=gait_frame(n * 11 * MS, 6))
        messages = robot.heard()
        assert [m.is_fd and m.bitrate_switch for m in messages] == [
            m.arbitration_id == FORCES_ID for m in messages
        ]
        (all_legs,) = (bytes(m.data) for m in messages if m.arbitration_id == FORCES_ID)
        assert not any(
            m.arbitration_id - base in NODE_IDS.values() for m in messages for base in (0x108, 0x118)
        )
        forces = decode_forces(FORCES_ID, all_legs)
        assert not forces.all_in_air
        assert {force.counter for force, _ in forces.legs} == {n - 1}
        link.feed(FORCES_ID, all_legs, n * 11 * MS)
    leg = link.leg(6, 45 * MS)
    assert (leg.status, leg.usable, leg.flags) == (LinkStatus.OK, True, Flag.CONTACT)
    assert (leg.force_n, leg.sigma_n) == ((0.5, 0.5, 0.5), (0.012, 0.012, 0.012))
    assert leg.age_ns == 12_500_000 + MS
    robot.close()
    logged = [message for message in can.LogReader(log) if message.arbitration_id == FORCES_ID]
    assert [message.is_fd and len(message.data) == 64 for message in logged] == [True] * 4


def test_a_seventh_and_eighth_leg_have_a_frame_of_their_own(request: pytest.FixtureRequest) -> None:
    """With the counter of the first; a client uses both. Robots without such legs never send it."""
    robot = Robot(request.node.nodeid, ALL_LEGS, fd=True)
    link = Link()
    for message in robot.boot:
        link.feed(message.arbitration_id, bytes(message.data), 0)
    for n in range(1, 5):
        robot.publish(n * 11 * MS)
        sent = {m.arbitration_id: bytes(m.data) for m in robot.heard() if m.is_fd}
        assert {can_id: len(data) for can_id, data in sent.items()} == {FORCES_ID: 64, FORCES4_ID: 24}
        for can_id, data in sent.items():
            assert link.feed(can_id, data, n * 11 * MS)
    assert all(link.leg(node, 45 * MS).usable for node in range(1, 9))
    robot.close()


def test_a_classic_interface_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Said before it is opened, with both remedies."""
    monkeypatch.setattr(channel, "NETWORK_DEVICES_FOLDER", tmp_path)
    (tmp_path / "can0").mkdir()
    (tmp_path / "can0" / "mtu").write_text("16\n")
    with pytest.raises(CanError) as caught:
        open_wire(Can(interface="socketcan", fd=True), ())
    line = str(caught.value)
    assert line.startswith(
        "CAN channel can0 (socketcan) is a classic one and sends no frame of CAN FD; take can.fd away"
    )
    assert "dbitrate" in line
    assert "\n" not in line
