"""Interfaces of python-can, on which a simulated robot sends: within the process, or on this computer alone."""

import contextlib
import errno
import logging
import os
import select
import socket
import struct
from collections.abc import Callable, Sequence

import can
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.virtual import VirtualBus

from firmware_interface.can.socketcan import ERROR, pack_frame, unpack_frame

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

    Raises:
        OSError: It cannot be restricted.
    """
    with socket.socket(fileno=os.dup(descriptor)) as local:
        local.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")
        local.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        membership = socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        try:
            local.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        except OSError as error:
            if (
                error.errno != errno.EADDRINUSE
            ):  # python-can joined on the loopback: the route of multicast is there
                raise


class PythonCanWire:
    """An interface of python-can; those of a simulation reach no other computer, and what they refuse is dropped.

    Args:
        interface: Its kind: `virtual` or `udp_multicast`.
        channel: Its name.

    Raises:
        OSError: There is no such interface.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self._bus: VirtualBus | UdpMulticastBus
        self._has_arrived: Callable[[], bool]
        try:
            if interface == "virtual":
                self._bus = within = VirtualBus(channel, preserve_timestamps=True)
                self._has_arrived = lambda: not within.queue.empty()
            else:
                self._bus = group = UdpMulticastBus(channel, hop_limit=0)
                keep_multicast_local(group.fileno(), channel)
                self._has_arrived = lambda: bool(select.select([group], (), (), 0)[0])
        except (can.CanError, ValueError) as error:
            reason = str(error)
            if isinstance(error.__cause__, OSError) and error.__cause__.errno == errno.ENODEV:
                reason = "this computer has no route of multicast; try: sudo ip route add 224.0.0.0/4 dev lo"
            raise OSError(None, reason) from error
        self.close = self._bus.shutdown

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        """Send frames up to the first that is refused, stamped with a time [ns]; return the number accepted."""
        for n, frame in enumerate(frames):
            try:
                self._bus.send(sent_message(frame, t_ns), timeout=0)
            except (can.CanError, OSError):
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
            except (can.CanError, OSError):
                continue  # a datagram that is no frame
            if message is None:
                break
            is_data = not (message.is_fd or message.is_extended_id or message.is_remote_frame)
            if not (is_data or message.is_error_frame):
                continue  # of another program
            # python-can checks the ranges of a message's fields, not their types: an id of 1.5 passes.
            with contextlib.suppress(TypeError, ValueError, struct.error):
                flag = ERROR if message.is_error_frame else 0
                arrived.append(pack_frame(message.arbitration_id | flag, bytes(message.data)))
        return arrived


def sent_message(frame: bytes, t_ns: int) -> can.Message:
    """Return a packed frame as python-can's message, sent at a time [ns]."""
    can_id, data = unpack_frame(frame)
    return can.Message(
        timestamp=t_ns / 1e9,
        arbitration_id=can_id,
        is_extended_id=False,
        data=data,
        is_rx=False,
    )
