"""The log of what a simulation sends: what it refuses, what it holds, and how it ends."""

import os
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from firmware_interface.can.codes import NmtState
from firmware_interface.can.reports import decode_heartbeat
from footsense.errors import ConfigError, FootsenseError, RecordingError
from footsense.sim.can.frame_log import CanFrameLog, check_log_target
from tests.support.can_robot import MS, NarrowWire, Robot
from tests.support.other_file import opens_instead


@pytest.mark.parametrize(
    ("name", "interface", "error", "says"),
    [
        ("a.csv", "virtual", ConfigError, r"a\.csv: the suffix must be one of \.log, \.asc, \.blf"),
        ("a.log", "socketcan", ConfigError, r"a\.log: the frames of a .* logged; try: candump -l can7"),
        ("none/a.log", "virtual", RecordingError, r"a\.log: there is no directory .*none"),
        ("old.log", "virtual", RecordingError, r"old\.log: exists and is not overwritten; choose another"),
    ],
)
def test_a_log_that_cannot_be_is_one_line_before_anything_is_opened(
    tmp_path: Path, name: str, interface: str, error: type[FootsenseError], says: str
) -> None:
    """On a robot the line names the program that writes it; nothing is made, also of a name that passes."""
    (tmp_path / "old.log").write_text("precious")
    with pytest.raises(error, match=says):
        check_log_target(tmp_path / name, interface, "can7")
    check_log_target(tmp_path / "new.blf", "virtual", "")
    assert [path.name for path in tmp_path.iterdir()] == ["old.log"]


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: Path(path).symlink_to("/dev/null"), Path.touch])
def test_a_log_is_written_through_nothing_that_appeared_after_the_check(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    """A pipe, a link or a file that another program made there meanwhile."""
    make(tmp_path / "walk.log")
    with pytest.raises(RecordingError, match=r"walk\.log: File exists"):
        CanFrameLog(tmp_path / "walk.log", "can0", NarrowWire).connect()


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_the_log_holds_what_was_sent_at_the_forces_time(
    request: pytest.FixtureRequest, tmp_path: Path, suffix: str
) -> None:
    """Every format reads back with the consumer's frames in order, stamped with virtual time."""
    log_file = tmp_path / f"walk{suffix}"
    robot = Robot(request.node.nodeid, log_file=log_file)
    for t_ms in (1000, 1020, 60_000):
        robot.publish(t_ms * MS)
    heard = robot.heard()
    robot.close()
    with can.LogReader(log_file, relative_timestamp=False) as reader:
        boot, _identity, *logged, last = reader
    assert [(m.arbitration_id, bytes(m.data)) for m in logged] == [
        (m.arbitration_id, bytes(m.data)) for m in heard
    ]
    assert not any(m.is_extended_id or m.is_rx for m in logged)
    elapsed_s = [m.timestamp - boot.timestamp for m in logged]
    assert elapsed_s == pytest.approx([m.timestamp - 1.0 for m in heard], abs=1e-5)
    assert bytes(boot.data + last.data) == bytes([NmtState.BOOT, NmtState.STOPPED])
    assert suffix != ".log" or log_file.read_text().startswith(f"(1.000000) {request.node.nodeid} 149#")


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
    robot.sink.close()
    assert robot.log is not None
    with pytest.raises(
        RecordingError, match=rf"{name} ended early: No space left on device; what was sent is not"
    ):
        robot.log.close()
    assert decode_heartbeat(0x149, bytes(robot.heard(0x148)[-1].data))[:2] == (1, NmtState.STOPPED)
    robot.consumer.shutdown()
