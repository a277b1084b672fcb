"""A raw CAN socket of Linux."""

import contextlib
import errno
import select
import socket
import struct
from collections.abc import Collection, Sequence

from firmware_interface.can.socketcan import EXTENDED, FRAME_BYTES
from footsense.errors import CanError
from footsense.wires.address import CanAddress, error_text

#: Error numbers of a full queue of the interface or of the socket.
_QUEUE_FULL_ERRNOS = frozenset({errno.ENOBUFS, errno.EAGAIN})

#: Most frames of one `receive`; a full bus of 1 Mbit/s carries fewer in a cycle.
_MAX_RECEIVED_PER_CALL = 1000

#: Option for the classes of error frames to receive, and every class.
#: Source: Linux, include/uapi/linux/can/raw.h and can/error.h.
_ERROR_FILTER_OPTION, _ALL_ERRORS = 2, 0x1FFF_FFFF


def open_socket(address: CanAddress, accept: Collection[int]) -> "SocketWire":
    """Open a raw CAN socket that receives data frames with these 11-bit ids, and all error frames.

    Args:
        address: The interface; one in FD mode sends and delivers the same classic frames.
        accept: CAN ids that the kernel's filter accepts.

    Raises:
        CanError: There is no such interface.

    Source:
        Linux, Documentation/networking/can.rst, section 4.1.
    """
    filters = b"".join(struct.pack("=II", can_id, EXTENDED | 0x7FF) for can_id in accept)
    try:
        with contextlib.ExitStack() as opened:
            raw = opened.enter_context(socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW))
            raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
            raw.setsockopt(socket.SOL_CAN_RAW, _ERROR_FILTER_OPTION, _ALL_ERRORS)
            # Without CAN_RAW_FD_FRAMES an interface in FD mode, too, delivers and takes classic frames alone.
            raw.bind((address.channel,))
            opened.pop_all()
    except OSError as error:
        raise CanError(error_text(address, error)) from None
    return SocketWire(raw)


class SocketWire:
    """Open CAN socket, or another socket that preserves message boundaries.

    Timing:
        One system call for each frame; neither `send` nor `receive` waits.
    """

    def __init__(self, channel: socket.socket) -> None:
        self._socket = channel
        self.close = channel.close
        # To ask takes less than to receive nothing, which is an exception.
        self._arrivals = select.poll()
        self._arrivals.register(channel, select.POLLIN)

    def send(self, frames: Sequence[bytes], t_ns: int = 0) -> int:
        """Send frames up to the first for which there is no room; return the number accepted.

        Raises:
            OSError: The interface is down or gone.
        """
        del t_ns
        for n, frame in enumerate(frames):
            try:
                self._socket.send(frame, socket.MSG_DONTWAIT)
            except OSError as error:
                if error.errno in _QUEUE_FULL_ERRNOS:
                    return n
                raise
        return len(frames)

    def receive(self) -> list[bytes]:
        """Return the frames that have arrived, oldest first.

        Raises:
            OSError: The interface is down or gone.
        """
        arrived: list[bytes] = []
        if not self._arrivals.poll(0):
            return arrived
        with contextlib.suppress(BlockingIOError):
            while len(arrived) < _MAX_RECEIVED_PER_CALL:
                frame = self._socket.recv(FRAME_BYTES, socket.MSG_DONTWAIT)
                if not frame:  # the other end of a socket pair is closed
                    break
                arrived.append(frame)
        return arrived
