"""Raw SocketCAN socket that sends all frames of a cycle in one system call (sendmmsg).

python-can calls select, send and log for each frame, and `socket.send` costs a third more than one `sendmmsg` for all
(docs/adr/0015), whose arguments are prepared once.

Source:
    sendmmsg(2).
"""

import ctypes
import errno
import os
import socket
from collections.abc import Callable

from firmware_interface.can.socketcan import FD_FRAME, FD_FRAME_BYTES, FRAME_BYTES, frame_ends

#: Error numbers of a full queue of the interface or of the socket.
QUEUE_FULL_ERRNOS = frozenset({errno.ENOBUFS, errno.EAGAIN})

#: Most frames of one call; six legs send 30 at most.
MAX_SENT_PER_CALL = 64

#: Most frames of one `receive`; a full bus of 1 Mbit/s carries fewer in a cycle.
MAX_RECEIVED_PER_CALL = 1000


class _IoVec(ctypes.Structure):
    """`struct iovec` of Linux."""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _MsgHdr(ctypes.Structure):
    """`struct msghdr` of Linux."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("iov", ctypes.c_void_p),
        ("iov_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _MMsgHdr(ctypes.Structure):
    """`struct mmsghdr` of Linux."""

    _fields_ = (("header", _MsgHdr), ("length", ctypes.c_uint))


# PyDLL keeps the interpreter lock: the call does not wait, and regaining the lock from another thread can take longer.
_sendmmsg = ctypes.PyDLL(None, use_errno=True).sendmmsg
_sendmmsg.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int)
_sendmmsg.restype = ctypes.c_int


class SocketWire:
    """Open CAN socket, or another socket that preserves message boundaries.

    Args:
        channel: The socket.
        close: Releases it; by default its own `close`.

    Timing:
        `send` is one system call and a copy, `receive` one system call and one for each frame; neither waits.
    """

    def __init__(self, channel: socket.socket, close: Callable[[], None] | None = None) -> None:
        self._socket = channel
        self._close = close or channel.close
        self._fd = channel.fileno()
        self._frames = bytearray(MAX_SENT_PER_CALL * FD_FRAME_BYTES)
        self._pinned = ctypes.c_char.from_buffer(
            self._frames
        )  # keeps its address as long as this object exists
        address = ctypes.addressof(self._pinned)
        self._vectors = (_IoVec * MAX_SENT_PER_CALL)()
        self._headers = (_MMsgHdr * MAX_SENT_PER_CALL)()
        # Addresses instead of ctypes pointers, which form reference cycles: the loop runs without garbage collection.
        for n, (vector, header) in enumerate(zip(self._vectors, self._headers, strict=True)):
            vector.base, vector.length = address + n * FRAME_BYTES, FRAME_BYTES
            header.header.iov, header.header.iov_count = ctypes.addressof(vector), 1
        self._address, self._first = address, ctypes.addressof(self._headers)
        self._is_mixed = False  # the vectors are those of frames of both lengths

    def send(self, frames: bytes, t_ns: int = 0) -> int:
        """Send frames without waiting, and drop those that do not fit; return the number accepted.

        Args:
            frames: Whole frames behind each other.
            t_ns: Unused; the kernel needs no time.

        Returns:
            How many were accepted, from the first on.

        Raises:
            OSError: The interface is down or gone.
        """
        del t_ns
        n = self._copy_to_sendmmsg_buffers(frames)
        n_accepted: int = _sendmmsg(self._fd, self._first, n, socket.MSG_DONTWAIT)
        if n_accepted >= 0:
            return n_accepted
        code = ctypes.get_errno()
        if code in QUEUE_FULL_ERRNOS:
            return 0
        raise OSError(code, os.strerror(code))

    def _copy_to_sendmmsg_buffers(self, frames: bytes) -> int:
        """Copy frames into the buffers of sendmmsg; return their number."""
        ends = frame_ends(frames)[:MAX_SENT_PER_CALL]
        is_mixed = ends[-1:] != [len(ends) * FRAME_BYTES]
        if is_mixed or self._is_mixed:
            self._is_mixed = is_mixed
            starts = [0, *ends] if is_mixed else range(0, (MAX_SENT_PER_CALL + 1) * FRAME_BYTES, FRAME_BYTES)
            for vector, start, end in zip(self._vectors, starts, starts[1:], strict=False):
                vector.base, vector.length = self._address + start, end - start
        self._frames[: ends[-1]] = frames[: ends[-1]]
        return len(ends)

    def receive(self) -> list[bytes]:
        """Return the frames that have arrived, oldest first.

        Raises:
            OSError: The interface is down or gone.
        """
        arrived = []
        for _ in range(MAX_RECEIVED_PER_CALL):
            try:
                frame = self._socket.recv(FD_FRAME_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            if not frame:  # the other end of a socket pair is closed
                break
            # Older kernels do not set the flag, and in a classic frame the byte is whatever its sender left there.
            flags = frame[5] | FD_FRAME if len(frame) == FD_FRAME_BYTES else 0
            frame = frame[:5] + bytes([flags]) + frame[6:]
            arrived.append(frame)
        return arrived

    def close(self) -> None:
        """Close the socket."""
        self._close()
