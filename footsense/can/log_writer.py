"""Child process that writes the CAN log: `python -m footsense.can.log_writer SUFFIX CHANNEL`.

Its standard input is the loop's pipe, its standard output the open file, and its standard error one line if the log is
incomplete. It ends with the pipe: when the service stops or is killed.
"""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import IO, TYPE_CHECKING, Any

from footsense.can.frame_log import RECORD_HEAD
from footsense.can.python_can import data_messages
from footsense.child_process import drop_realtime, read_batches

if TYPE_CHECKING:
    from can.io.generic import FileIOMessageWriter


def _records(pipe: int) -> Iterator[list[tuple[int, bytes]]]:
    """Yield the log records (time [ns], frames) received in each batch, until the pipe ends."""
    rest = b""
    for data in read_batches(pipe):
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
    """Return a log file for an open descriptor, and python-can's writer for the format of `suffix`."""
    import can

    if suffix == ".blf":
        binary = os.fdopen(file, "wb")
        return binary, can.BLFWriter(binary)
    text = os.fdopen(file, "w", encoding="utf-8")
    if suffix == ".asc":
        return text, can.ASCWriter(text)
    return text, can.CanutilsLogWriter(text, channel=channel)


def main(suffix: str, channel: str, pipe: int = 0, file: int = 1) -> str:
    """Write the log until the pipe ends; return why it is incomplete, or an empty text.

    Args:
        suffix: Suffix of the file's name, which names the format.
        channel: Name of the channel.
        pipe: Descriptor to read from.
        file: Descriptor of the open file.

    Returns:
        The reason why the log is incomplete; empty if it is complete.
    """
    opened, writer = _open(file, suffix, channel)
    state = "ended early"
    try:
        for records in _records(pipe):
            for t_ns, frames in records:
                for message in data_messages(frames, t_ns):
                    writer.on_message_received(message)
            opened.flush()
        state = "is not whole"
        writer.stop()
    except OSError as error:
        with contextlib.suppress(OSError):  # its buffer cannot be written
            opened.close()
        return f"the CAN log {state}: {error.strerror}"
    return ""


if __name__ == "__main__":
    drop_realtime()
    failure = main(sys.argv[1], sys.argv[2])
    if failure:
        with contextlib.suppress(BrokenPipeError):  # without a reader if the service was killed
            os.write(2, failure.encode())
        os._exit(1)  # a normal exit would try to flush the buffer again
