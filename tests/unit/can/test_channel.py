"""A channel that cannot be opened, is dead, or whose log cannot be written."""

import errno
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable
from logging.handlers import BufferingHandler
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import can
import numpy as np
import pytest

from firmware_interface.can.codes import CommandKind, NmtState
from firmware_interface.can.commands import encode_command
from firmware_interface.can.events import decode_heartbeat
from firmware_interface.can.socketcan import pack_frame
from footsense.can.channel import CanChannel, ChannelSettings
from footsense.can.frame_log import CanFrameLog, check_log_target
from footsense.can.python_can import _keep_multicast_local
from footsense.can.sink import CanSink
from footsense.errors import CanError, ConfigError, RecordingError
from footsense.frames import BaselineDrift, CanStatistics, ContactFrame
from tests.support.can_robot import MS, FakeClock, NarrowWire, Robot
from tests.support.other_file import opens_instead


def open_sink(interface: str, channel: str, log_file: Path | None = None) -> CanSink:
    """Open a sink of one leg."""
    settings = ChannelSettings(interface=interface, channel=channel, log_file=log_file)
    return CanSink(settings, ("lf",), FakeClock())


def test_an_unknown_log_suffix_is_refused_with_those_known(tmp_path: Path) -> None:
    """One line that names the file and what would be right; no file is made."""
    with pytest.raises(ConfigError, match=r"walk\.csv: the suffix must be one of \.log, \.asc, \.blf"):
        open_sink("virtual", "log", tmp_path / "walk.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_log_in_a_missing_folder_is_one_line(tmp_path: Path) -> None:
    """The error names the file and the reason, at the check as at the opening."""
    with pytest.raises(RecordingError, match=r"walk\.log: No such file or directory"):
        open_sink("virtual", "log", tmp_path / "missing" / "walk.log")
    with pytest.raises(RecordingError, match=r"walk\.log: there is no directory .*missing"):
        check_log_target(tmp_path / "missing" / "walk.log")


def test_an_existing_log_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    """A log is not overwritten, as a recording is not; a new name passes and nothing is made of it yet."""
    old = tmp_path / "walk.log"
    old.write_text("precious")
    with pytest.raises(RecordingError, match=r"walk\.log: exists and is not overwritten; choose another"):
        check_log_target(old)
    check_log_target(tmp_path / "new.blf")
    assert [path.name for path in tmp_path.iterdir()] == ["walk.log"]


def test_an_unknown_interface_is_a_can_error(tmp_path: Path) -> None:
    """One line that names the channel; no log file is made."""
    with pytest.raises(CanError, match=r"CAN channel can0 \(telepathy\) cannot be opened"):
        open_sink("telepathy", "can0", tmp_path / "walk.log")
    assert list(tmp_path.iterdir()) == []


# python-can leaves its socket to the garbage collector when it cannot bind it.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")
def test_a_channel_that_is_not_there_is_a_can_error_with_a_remedy() -> None:
    """Either the interface is missing or the kernel has no CAN at all; both say what to do."""
    with pytest.raises(
        CanError, match=r"CAN channel can98 \(socketcan\) (does not exist|needs a kernel with CAN)"
    ):
        open_sink("socketcan", "can98")


class DeadBus(can.BusABC):
    """A CAN interface that exists and fails each send, as Linux reports it."""

    error_code = errno.ENETDOWN

    def __init__(self, channel: str, **kwargs: Any) -> None:
        super().__init__(channel, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Failed to transmit", self.error_code)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        raise can.CanOperationError("Failed to receive", self.error_code)


class UnheardBus(DeadBus):
    """An interface whose queue is full because no node acknowledges."""

    error_code = errno.ENOBUFS


@pytest.fixture
def _fake_interfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the two buses known to python-can as it knows its own."""
    module = ModuleType("fake_interfaces")
    vars(module).update(DeadBus=DeadBus, UnheardBus=UnheardBus)
    monkeypatch.setitem(sys.modules, "fake_interfaces", module)
    for name, bus in (("dead", "DeadBus"), ("unheard", "UnheardBus")):
        monkeypatch.setitem(can.interfaces.BACKENDS, name, ("fake_interfaces", bus))


@pytest.mark.usefixtures("_fake_interfaces")
def test_a_channel_that_is_down_is_named_with_the_command_that_brings_it_up(tmp_path: Path) -> None:
    """The error says what to type; no log file is made."""
    with pytest.raises(
        CanError, match=r"can0 \(dead\) is down; try: ip link set can0 up type can bitrate 500000"
    ):
        open_sink("dead", "can0", tmp_path / "walk.log")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("_fake_interfaces")
def test_a_bus_on_which_nobody_listens_drops_everything_and_stops_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """ENOBUFS from the first frame on: all is counted, nothing raised, and the interface is not opened again."""
    sink = open_sink("unheard", "can0")
    nan = np.full((1, 3), np.nan)
    one = np.ones(1, np.int64)
    sink.publish(
        ContactFrame(
            sequence=0,
            t_sent_ns=1,
            t_ns=one,
            force_n=nan,
            sigma_n=nan,
            state=one.astype(np.uint8),
            fault_mask=one.astype(np.uint16),
            flags=one.astype(np.uint8),
            cause=np.zeros(1, np.uint8),
            baseline=BaselineDrift.none(1),
        )
    )
    assert sink.commands() == []
    sink.close()
    assert (sink.stats.sent, sink.stats.dropped) == (0, 7)
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == ["CAN can0"]
    assert "its queue is full, frames are dropped" in caplog.text


@pytest.mark.parametrize("name", ["walk.log", "walk.asc", "walk.blf"])
def test_a_full_disk_ends_the_log_and_not_the_forces(
    request: pytest.FixtureRequest, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The forces go on to the last heartbeat; why the log ended is told at the end, and once."""
    log_file = tmp_path / name
    opens_instead(monkeypatch, log_file, Path("/dev/full"))
    robot = Robot(request.node.nodeid, log_file=log_file)
    for scan in range(200):
        robot.publish(scan * 20 * MS)
    assert robot.sink.stats.dropped == 0
    with pytest.raises(RecordingError, match=rf"{name}: the CAN log ended early: No space left on device"):
        robot.sink.close()
    assert decode_heartbeat(0x701, bytes(robot.heard(0x700)[-1].data))[:2] == (1, NmtState.STOPPED)
    robot.close()


def test_a_log_that_takes_nothing_costs_its_own_frames_and_no_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that takes nothing: what finds no room on the way there is counted, and told at the end."""
    path = tmp_path / "walk.log"
    os.mkfifo(tmp_path / "full")
    reader = os.open(tmp_path / "full", os.O_RDONLY | os.O_NONBLOCK)
    opens_instead(monkeypatch, path, tmp_path / "full")
    stats = CanStatistics()
    log = CanFrameLog(path, "can0", stats, waits=False)
    scan = pack_frame(0x181, bytes(8)) * 12
    for t_ns in range(20_000):
        log.add(t_ns, scan)
    assert stats.unlogged % 12 == 0
    assert stats.unlogged > 0
    with pytest.raises(
        RecordingError, match=r"walk\.log: the file did not take what was written within 0\.1 s"
    ):
        log.close(timeout_s=0.1)
    os.close(reader)


def test_a_log_with_a_gap_is_said_to_have_one(tmp_path: Path) -> None:
    """Frames that found no room on the way to the file, and whoever owns the file may read it."""
    stats = CanStatistics(unlogged=24)
    log = CanFrameLog(tmp_path / "walk.log", "can0", stats, waits=True)
    log.add(0, pack_frame(0x181, bytes(8)))
    with pytest.raises(
        RecordingError, match=r"its writer was too slow: 24 frames are missing; what was sent"
    ):
        log.close()
    assert (tmp_path / "walk.log").read_text().count(" 181#") == 1
    assert (tmp_path / "walk.log").stat().st_mode & 0o600 == 0o600


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: Path(path).symlink_to("/dev/null"), Path.touch])
def test_a_log_is_written_through_nothing_that_appeared_after_the_check(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    """A pipe, a link or a file that another program made there meanwhile."""
    make(tmp_path / "walk.log")
    with pytest.raises(RecordingError, match=r"walk\.log: File exists"):
        open_sink("virtual", "log", tmp_path / "walk.log")


def test_the_writer_keeps_the_processors_of_the_unit(tmp_path: Path) -> None:
    """Those that this process may use, not the loop's one, and no others."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        log = CanFrameLog(tmp_path / "walk.log", "can0", CanStatistics(), waits=True)
        assert os.sched_getaffinity(log._writer.pid) == allowed
        assert os.sched_getaffinity(0) == {min(allowed)}
    finally:
        os.sched_setaffinity(0, allowed)
    log.close()


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
    monkeypatch.setattr("footsense.can.channel.open_wire", lambda *_, **__: wire.open_and_wait())
    return CanChannel(ChannelSettings(interface="socketcan", channel="can0"), (), {}, stats)


def test_an_interface_that_is_gone_is_opened_again_beside_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the kernel's lock is held for seconds, sending goes on and drops; then the interface is back."""
    wire, stats = SlowWire(), CanStatistics()
    channel = channel_on(wire, monkeypatch, stats)
    frame = pack_frame(0x181, bytes(8))
    wire.gone = True
    for n in range(100):
        assert channel.send(frame, n * 10 * MS) == 0
    assert len(wire.opened_ns) == 1
    wire.gone = False
    wire.lock.set()
    assert wire.opened.wait(10)
    n = 100
    while not channel.send(frame, n * 10 * MS):
        n += 1
        assert n < 10_000
    assert (stats.reopened, stats.dropped) == (1, n)
    channel.close()


def test_an_interface_that_is_down_keeps_its_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is opened or closed for it, so that nothing waits; it is tried again until it is up."""
    wire, stats = SlowWire(), CanStatistics()
    channel = channel_on(wire, monkeypatch, stats)
    frame = pack_frame(0x181, bytes(8))
    down = OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN))
    with monkeypatch.context() as patch:
        patch.setattr(wire, "send", mock.Mock(side_effect=down))
        for n in range(100):
            assert channel.send(frame, n * 10 * MS) == 0
    taken = [channel.send(frame, (100 + n) * 10 * MS) for n in range(30)]
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


def test_a_local_socket_commands_nothing_and_kills_nothing() -> None:
    """Packets that are no frame, an error frame without data and a command, as any program on this computer sends."""
    group, port = "239.74.163.77", 43113
    settings = ChannelSettings(interface="udp_multicast", channel=group, commands=False)
    sink = CanSink(settings, ("lf",), FakeClock())
    with can.Bus(interface="udp_multicast", channel=group, hop_limit=0, fd=False) as other:
        _keep_multicast_local(other.fileno(), group)
        raw = socket.socket(fileno=os.dup(other.fileno()))
        raw.sendto(b"no frame at all", (group, port))
        raw.close()
        other.send(can.Message(is_error_frame=True, arbitration_id=0x4, is_extended_id=True))
        other.send(
            can.Message(
                arbitration_id=0x201, data=encode_command(1, 0, CommandKind.TARE), is_extended_id=False
            )
        )
        for _ in range(100):
            assert sink.commands() == []
            if sink.stats.rejected_commands:
                break
            threading.Event().wait(0.01)
    assert (sink.stats.rejected_commands, sink.stats.bus_errors) == (1, 1)
    sink.close()


def test_a_killed_writer_ends_the_log_and_not_the_forces(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """What follows is counted, the journal has one line, and the end says that the log is not whole."""
    stats = CanStatistics()
    log = CanFrameLog(tmp_path / "walk.log", "can0", stats, waits=True)
    log._writer.kill()
    log._writer.wait()
    for t_ns in range(3):
        log.add(t_ns, pack_frame(0x181, bytes(8)))
    assert stats.unlogged == 3
    assert [record.getMessage().partition(": ")[2] for record in caplog.records] == [
        "its writer has ended; the run goes on without it"
    ]
    with pytest.raises(
        RecordingError, match=r"walk\.log: its writer was killed; what was sent is not affected"
    ):
        log.close()
