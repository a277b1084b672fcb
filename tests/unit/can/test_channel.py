"""A channel that cannot be opened, is dead, or whose log cannot be written."""

import errno
import logging
import os
import shutil
import socket
import subprocess
import sys
import threading
from functools import partial
from logging.handlers import BufferingHandler
from pathlib import Path

import can
import pytest

from firmware_interface.can.codes import CommandKind
from firmware_interface.can.commands import encode_command
from firmware_interface.can.socketcan import pack_frame
from footsense.can.channel import CanChannel
from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.errors import CanError
from footsense.frames import CanStatistics
from footsense.sim.can.frame_log import CanFrameLog
from footsense.wires.address import CanAddress
from footsense.wires.opening import open_wire
from footsense.wires.python_can import keep_multicast_local
from tests.support.can_robot import MS, FakeClock, NarrowWire, Robot


def test_an_interface_that_cannot_be_opened_is_a_can_error(tmp_path: Path) -> None:
    """One line that names the channel; no log file is made."""
    no_group = Can(interface="udp_multicast", channel="127.0.0.1")
    log = CanFrameLog(tmp_path / "walk.log", "can0", partial(open_wire, no_group.address))
    with pytest.raises(CanError, match=r"CAN channel 127\.0\.0\.1 \(udp_multicast\) cannot be opened"):
        log.connect()
    log.close()
    assert list(tmp_path.iterdir()) == []


def test_a_channel_that_is_not_there_is_a_can_error_with_a_remedy() -> None:
    """Either the interface is missing or the kernel has no CAN at all; both say what to do."""
    with pytest.raises(
        CanError, match=r"CAN channel can98 \(socketcan\) (does not exist|needs a kernel with CAN)"
    ):
        CanSink(Can(interface="socketcan", channel="can98"), ("lf",), FakeClock())


def test_a_channel_that_is_down_is_named_with_the_command_that_brings_it_up() -> None:
    """The error says what to type."""
    wire = NarrowWire()
    wire.error = errno.ENETDOWN
    with pytest.raises(
        CanError, match=r"can0 \(socketcan\) is down; try: ip link set can0 up type can bitrate 500000"
    ):
        CanSink(Can(interface="socketcan"), ("lf",), FakeClock(), connect=lambda: wire)


def test_a_bus_on_which_nobody_listens_drops_everything_and_stops_nothing(
    request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture
) -> None:
    """No room from the first frame on: all is counted, nothing raised, and the interface is not opened again."""
    wire = NarrowWire()
    wire.room = 0
    robot = Robot(request.node.nodeid, wire=wire)
    robot.publish(1)
    assert robot.sink.commands() == []
    robot.close()
    assert (robot.sink.stats.sent, robot.sink.stats.dropped, len(wire.opened_ns)) == (0, 8, 1)
    (line,) = (record.getMessage() for record in caplog.records)
    assert "its queue is full, frames are dropped" in line


class SlowWire(NarrowWire):
    """An interface whose opening and closing wait for a lock of the kernel."""

    def __init__(self) -> None:
        super().__init__()
        self.lock = threading.Event()
        self.opened = threading.Event()

    def open_and_wait(self) -> "SlowWire":
        if self.opened_ns:
            self.lock.wait(10)
            self.opened.set()
        self.open(0)
        return self

    def close(self) -> None:
        self.lock.wait(10)


def channel_on(wire: SlowWire, monkeypatch: pytest.MonkeyPatch, stats: CanStatistics) -> CanChannel:
    """Open a channel as on a robot, but on this interface."""
    monkeypatch.setattr("footsense.can.channel.open_socket", lambda *_, **__: wire.open_and_wait())
    return CanChannel(Can(interface="socketcan"), (), (), stats)


def test_an_interface_that_is_gone_is_opened_again_beside_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the kernel's lock is held for seconds, sending goes on and drops; then the interface is back."""
    wire, stats = SlowWire(), CanStatistics()
    channel = channel_on(wire, monkeypatch, stats)
    frames = [pack_frame(0x109, bytes(8))]
    wire.gone = True
    for n in range(100):
        assert channel.send(frames, n * 10 * MS) == 0
    assert len(wire.opened_ns) == 1
    wire.gone = False
    wire.lock.set()
    assert wire.opened.wait(10)
    n = 100
    while not channel.send(frames, n * 10 * MS):
        n += 1
        assert n < 10_000
    assert (stats.reopened, stats.dropped) == (1, n)
    channel.close()


def test_an_interface_that_is_down_keeps_its_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is opened or closed for it, so that nothing waits; it is tried again until it is up."""
    wire, stats = SlowWire(), CanStatistics()
    channel = channel_on(wire, monkeypatch, stats)
    frames = [pack_frame(0x109, bytes(8))]
    wire.error = errno.ENETDOWN
    for n in range(100):
        assert channel.send(frames, n * 10 * MS) == 0
    wire.error = 0
    taken = [channel.send(frames, (100 + n) * 10 * MS) for n in range(30)]
    assert sum(taken) >= 5
    assert (len(wire.opened_ns), stats.reopened) == (1, 1)
    wire.lock.set()
    channel.close()


def test_python_can_s_own_log_is_not_ours() -> None:
    """It logs what it raises, at every attempt: four lines a second while an interface is away."""
    heard = BufferingHandler(10)
    logging.getLogger().addHandler(heard)
    logging.getLogger("can.socketcan").error("could not bind")
    logging.getLogger().removeHandler(heard)
    assert heard.buffer == []


def test_two_groups_on_one_computer_do_not_hear_each_other() -> None:
    """Neither what footsense sends on the other channel nor what another program does; each hears its own."""
    here, there, same = (open_wire(CanAddress("udp_multicast", f"239.74.163.{n}")) for n in (81, 82, 81))
    frames = [pack_frame(0x109, bytes([n])) for n in (1, 2)]
    there.send(frames[1:], 0)  # handed over before the next is sent: loopback has no queue
    here.send(frames[:1], 0)
    heard = [[frame for frame in wire.receive() if frame in frames] for wire in (same, there)]
    assert heard == [frames[:1], frames[1:]]
    for wire in (here, there, same):
        wire.close()


def test_a_computer_without_a_route_of_multicast_is_told_the_one_that_it_needs() -> None:
    """And that route is enough: python-can has joined the group on the loopback then."""
    opened = (
        "from footsense.wires.opening import open_wire; from footsense.wires.address import CanAddress; "
        "open_wire(CanAddress('udp_multicast', '239.74.163.82'))"
    )
    script = 'ip link set lo up; "$0" -c "$1"; ip route add 224.0.0.0/4 dev lo; "$0" -c "$1" && echo opened'
    alone = ("unshare", "--net", "--map-root-user", "sh", "-c")
    if shutil.which("ip") is None or subprocess.run([*alone, "ip link set lo up"], check=False).returncode:
        pytest.skip("no network namespace can be made here")
    done = subprocess.run(
        [*alone, script, sys.executable, opened], capture_output=True, text=True, timeout=60, check=False
    )
    assert "no route of multicast; try: sudo ip route add 224.0.0.0/4 dev lo" in done.stderr
    assert done.stdout == "opened\n"


def test_a_local_socket_commands_nothing_and_kills_nothing() -> None:
    """Packets that are no frame, an error frame without data and a command, as any program on this computer sends."""
    group, port = "239.74.163.79", 43113
    settings = Can(interface="udp_multicast", channel=group, commands=False)
    sink = CanSink(settings, ("lf",), FakeClock(), connect=partial(open_wire, settings.address))
    with can.Bus(interface="udp_multicast", channel=group, hop_limit=0, fd=False) as other:
        keep_multicast_local(other.fileno(), group)
        raw = socket.socket(fileno=os.dup(other.fileno()))
        raw.sendto(b"no frame at all", (group, port))
        raw.close()
        other.send(can.Message(is_error_frame=True, arbitration_id=0x4, is_extended_id=True))
        other.send(
            can.Message(
                arbitration_id=0x111, data=encode_command(1, 0, CommandKind.TARE), is_extended_id=False
            )
        )
        for _ in range(100):
            assert sink.commands() == []
            if sink.stats.rejected_commands:
                break
            threading.Event().wait(0.01)
    assert (sink.stats.rejected_commands, sink.stats.bus_errors) == (1, 1)
    sink.close()
