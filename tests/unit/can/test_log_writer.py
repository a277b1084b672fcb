"""The process that writes the CAN log, called in this one: from the records of a pipe to a file that can be read."""

import fcntl
import os
from pathlib import Path

import can
import pytest

from firmware_interface.can.socketcan import pack_frame
from footsense.can.frame_log import RECORD_HEAD
from footsense.can.log_writer import main

MS = 1_000_000
#: More than is read at once, so that a record is cut.
MANY = 6500


def filled_pipe(records: list[bytes]) -> int:
    """Return a pipe from which these records can be read, and then its end."""
    read_end, write_end = os.pipe()
    fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, 1 << 20)
    data = b"".join(records)
    assert os.write(write_end, data) == len(data)
    os.close(write_end)
    return read_end


def record(n: int) -> bytes:
    """Return the record of a scan of two frames."""
    frames = pack_frame(0x181, n.to_bytes(8, "big")) + pack_frame(0x282, bytes(5))
    return RECORD_HEAD.pack(1_000_000 * MS + n * MS, len(frames)) + frames


@pytest.mark.parametrize(("suffix", "n_records"), [(".log", MANY), (".asc", 50), (".blf", 50)])
def test_every_frame_of_the_pipe_is_in_the_file(tmp_path: Path, suffix: str, n_records: int) -> None:
    """In order, sent and not received, with the time of its record, up to the last whole record."""
    path = tmp_path / f"walk{suffix}"
    pipe = filled_pipe([record(n) for n in range(n_records)] + [record(n_records)[:-1]])
    file = os.open(path, os.O_WRONLY | os.O_CREAT)
    assert main(suffix, "can7", pipe, file) == ""
    os.close(pipe)
    with can.LogReader(path, relative_timestamp=False) as reader:
        messages = list(reader)
    assert [bytes(m.data) for m in messages[::2]] == [n.to_bytes(8, "big") for n in range(n_records)]
    assert {(m.arbitration_id, bytes(m.data)) for m in messages[1::2]} == {(0x282, bytes(5))}
    assert not any(m.is_extended_id or m.is_rx for m in messages)
    first_s = messages[0].timestamp
    assert [m.timestamp - first_s for m in messages[::2]] == pytest.approx(
        [n / 1000 for n in range(n_records)], abs=1e-4
    )
    if suffix == ".log":
        assert path.read_text().startswith("(1000.000000) can7 181#")


def test_a_full_disk_is_told_and_nothing_is_raised() -> None:
    """The daemon says it in one line at the end."""
    pipe = filled_pipe([record(n) for n in range(10)])
    file = os.open("/dev/full", os.O_WRONLY)
    assert main(".log", "can0", pipe, file) == "the CAN log ended early: No space left on device"
    os.close(pipe)
