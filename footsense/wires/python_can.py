"""Interfaces of python-can, on which a simulated robot sends: within the process, or on this computer alone.

python-can neither checks its settings nor ignores files in the home directory, so it gets checked settings and no
files.
"""

import contextlib
import logging
import os
import select
import socket
import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from firmware_interface.can.socketcan import ERROR, EXTENDED, REMOTE, pack_frame, unpack_frame

if TYPE_CHECKING:
    import can

#: Most frames of one `receive`.
_MAX_RECEIVED_PER_CALL = 1000
#: Whether a socket receives from groups that it has not joined. Source: Linux, ip(7) and include/uapi/linux/in.h.
_IP_MULTICAST_ALL = 49

# python-can logs what it also raises, at every attempt; ours is one line at the begin and one at the end.
logging.getLogger("can").propagate = False
logging.getLogger("can").addHandler(logging.NullHandler())


def keep_multicast_local(descriptor: int, group: str) -> None:
    """Restrict a multicast socket to its group and to the loopback interface.

    It would receive from any network, and from every group that any program on this computer has joined.
    """
    with socket.socket(fileno=os.dup(descriptor)) as local:
        local.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")
        local.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        membership = socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        local.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)


class PythonCanWire:
    """An interface of python-can; those of a simulation reach no other computer, and what they refuse is dropped.

    Args:
        interface: Its kind: `virtual` or `udp_multicast`.
        channel: Its name.

    Raises:
        OSError: There is no such interface.
    """

    def __init__(self, interface: str, channel: str) -> None:
        import can
        from can.interfaces.virtual import VirtualBus

        is_group = interface == "udp_multicast"
        options: dict[str, Any] = {"hop_limit": 0} if is_group else {"preserve_timestamps": True}
        try:
            bus = can.Bus(interface=interface, channel=channel, ignore_config=True, **options)
        # NotImplementedError is what python-can raises for an interface that it does not know.
        except (can.CanError, ValueError, ImportError, NotImplementedError) as error:
            raise OSError(None, str(error)) from error
        if is_group:
            keep_multicast_local(bus.fileno(), channel)
        self._bus = bus
        self._failures = (can.CanError, OSError)
        self.close = bus.shutdown
        self._has_arrived: Callable[[], bool]
        if isinstance(bus, VirtualBus):
            self._has_arrived = lambda: not bus.queue.empty()
        else:
            descriptor = bus.fileno()
            self._has_arrived = lambda: bool(select.select([descriptor], (), (), 0)[0])

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        """Send frames up to the first that is refused, stamped with a time [ns]; return the number accepted."""
        for n, frame in enumerate(frames):
            try:
                self._bus.send(sent_message(frame, t_ns), timeout=0)
            except self._failures:
                return n
        return len(frames)

    def receive(self) -> list[bytes]:
        """Return all received frames; the virtual interface's queue would otherwise grow without limit."""
        arrived = []
        for _ in range(_MAX_RECEIVED_PER_CALL):
            # Asked only for what is there: python-can waits by the wall clock, without end where that is set back.
            if not self._has_arrived():
                break
            try:
                message = self._bus.recv(timeout=0)
            except self._failures:
                continue  # a datagram that is no frame
            if message is None:
                break
            if message.is_fd:  # of another program; a classic socket of Linux does not deliver it either
                continue
            # python-can checks the ranges of a message's fields, not their types: an id of 1.5 passes.
            with contextlib.suppress(TypeError, ValueError, struct.error):
                arrived.append(pack_frame(_flagged_id(message), bytes(message.data)))
        return arrived


def sent_message(frame: bytes, t_ns: int) -> "can.Message":
    """Return a packed frame as python-can's message, sent at a time [ns]."""
    import can

    can_id, data = unpack_frame(frame)
    return can.Message(
        timestamp=t_ns / 1e9,
        arbitration_id=can_id,
        is_extended_id=False,
        data=data,
        is_rx=False,
    )


def _flagged_id(message: "can.Message") -> int:
    """Return a message's CAN id with the flag bits of Linux."""
    return (
        message.arbitration_id
        | (EXTENDED if message.is_extended_id else 0)
        | (REMOTE if message.is_remote_frame else 0)
        | (ERROR if message.is_error_frame else 0)
    )
