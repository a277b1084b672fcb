"""The process that writes the CAN log: `python -m footsense.can.log_writer SUFFIX CHANNEL`.

Its standard input is the loop's pipe, its standard output the open file, and its standard error one line if the
log is not whole. It ends when the pipe does: when the daemon stops or dies.
"""

import contextlib
import os
import select
import sys
from collections.abc import Iterator
from typing import IO, TYPE_CHECKING, Any

from firmware_interface.socketcan import split_frames
from footsense.can.frame_log import RECORD_HEAD
from footsense.child_process import drop_realtime

if TYPE_CHECKING:
    from can.io.generic import FileIOMessageWriter

__all__ = ["main"]

#: Longest time that frames wait in the pipe [ms]. To be woken by every scan would be work for the loop, whose
#: write has to do the waking.
_GATHER_MS = 200

_READ_BYTES = 1 << 18

#: So much at once comes only from a loop in virtual time, which waits for room.
_BUSY_BYTES = 1 << 16


def _records(pipe: int) -> Iterator[list[tuple[int, bytes]]]:
    """Yield the time and the frames of each record, as many as have gathered, up to the end of the pipe."""
    end = select.poll()
    end.register(pipe, 0)  # asked for no event, poll still tells the end of the pipe
    os.set_blocking(pipe, False)
    rest = b""
    n_read = -1
    while n_read:
        end.poll(0 if n_read >= _BUSY_BYTES else _GATHER_MS)
        try:
            data = os.read(pipe, _READ_BYTES)
        except BlockingIOError:  # the loop stands still
            n_read = -1
            continue
        n_read = len(data)
        rest += data
        records = []
        while len(rest) >= RECORD_HEAD.size:
            t_ns, length = RECORD_HEAD.unpack_from(rest)
            if len(rest) < RECORD_HEAD.size + length:
                break
            records.append((t_ns, rest[RECORD_HEAD.size : RECORD_HEAD.size + length]))
            rest = rest[RECORD_HEAD.size + length :]
        yield records


def _open(file: int, suffix: str, channel: str) -> "tuple[IO[Any], FileIOMessageWriter[Any]]":
    """Return an open file and a writer of the format that the suffix names."""
    import can

    if suffix == ".blf":
        binary = os.fdopen(file, "wb")
        return binary, can.BLFWriter(binary)
    text = os.fdopen(file, "w", encoding="utf-8")
    if suffix == ".asc":
        return text, can.ASCWriter(text)
    return text, can.CanutilsLogWriter(text, channel=channel)


def main(suffix: str, channel: str, pipe: int = 0, file: int = 1) -> str:
    """Write a log until the pipe ends.

    Args:
        suffix: Of the file's name: the format.
        channel: Name of the channel.
        pipe: Descriptor to read from.
        file: Descriptor of the open file.

    Returns:
        Why the log is not whole; empty if it is.
    """
    import can

    opened, writer = _open(file, suffix, channel)
    try:
        for records in _records(pipe):
            for t_ns, frames in records:
                for can_id, data in split_frames(frames):
                    writer.on_message_received(
                        can.Message(
                            timestamp=t_ns / 1e9,
                            arbitration_id=can_id,
                            is_extended_id=False,
                            data=data,
                            is_rx=False,
                        )
                    )
            opened.flush()
    except OSError as error:
        _abandon(opened)
        return f"the CAN log ended early: {error.strerror}"
    try:
        writer.stop()
    except OSError as error:
        _abandon(opened)
        return f"the CAN log is not whole: {error.strerror}"
    return ""


def _abandon(opened: IO[Any]) -> None:
    """Close a file whose last words do not fit."""
    with contextlib.suppress(OSError):
        opened.close()


if __name__ == "__main__":
    drop_realtime()
    failure = main(sys.argv[1], sys.argv[2])
    if failure:
        with contextlib.suppress(BrokenPipeError):  # nobody listens any more if the daemon was killed
            os.write(2, failure.encode())
        os._exit(1)  # what could not be flushed would be tried again
