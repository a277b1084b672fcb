"""Open CAN interfaces: a raw socket of Linux for `socketcan`, python-can for the interfaces of a simulation.

python-can neither checks its settings nor ignores files in the home directory, so it gets checked settings and no
files.
"""

import contextlib
import errno
import logging
import os
import select
import socket
import struct
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import Meta, Struct

from firmware_interface.can.socketcan import (
    ERROR,
    EXTENDED,
    FD_FRAME_BYTES,
    REMOTE,
    pack_fd_frame,
    pack_frame,
    unpack_frame,
)
from footsense.errors import CanError
from footsense.ports import CanWire

if TYPE_CHECKING:
    import can

#: Where Linux shows its network interfaces.
NETWORK_DEVICES_FOLDER = Path("/sys/class/net")

#: Error numbers of a full queue of the interface or of the socket.
_QUEUE_FULL_ERRNOS = frozenset({errno.ENOBUFS, errno.EAGAIN})

#: Most frames of one `receive`; a full bus of 1 Mbit/s carries fewer in a cycle.
_MAX_RECEIVED_PER_CALL = 1000

#: Option for the classes of error frames to receive, and every class.
#: Source: Linux, include/uapi/linux/can/raw.h and can/error.h.
_ERROR_FILTER_OPTION, _ALL_ERRORS = 2, 0x1FFF_FFFF
_CLASSIC_DATA_BYTES = 8


Interface = Literal["virtual", "socketcan", "udp_multicast"]


class Can(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `can` of a configuration: CAN interface on which forces are published.

    Attributes:
        interface: `socketcan` on the robot; `virtual` stays within the process, `udp_multicast` on this computer.
        channel: Name of the network interface; with `udp_multicast` an address such as 239.74.163.2.
        bitrate: Bit rate [bit/s], to compute the bus load; the kernel sets it (deploy/README.md).
        commands: Whether commands are executed. None: those of a CAN bus, but not those of `udp_multicast`, which every
            program on this computer can send.
        fd: Whether the forces of all legs go out in one CAN FD frame; the interface has to be one of CAN FD.
    """

    interface: Annotated[
        Interface,
        Meta(description="a CAN device of Linux: interface: socketcan, channel: can0, or vcan0"),
    ]
    channel: Annotated[
        str, Meta(pattern=r"^[^\s/]{1,15}$", description="a network interface such as can0")
    ] = "can0"
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000, description="classic CAN ends at 1 Mbit/s")] = (
        500_000
    )
    commands: bool | None = None
    fd: bool = False

    @property
    def executes_commands(self) -> bool:
        """Whether commands received on CAN are executed."""
        return self.interface != "udp_multicast" if self.commands is None else self.commands


def open_wire(can: Can, accept: Collection[int]) -> CanWire:
    """Open and return a CAN interface.

    Args:
        can: The interface; frames of CAN FD are received in any case.
        accept: CAN ids that the kernel's filter accepts, on `socketcan`.

    Raises:
        CanError: There is no such interface, or it is a classic one and is to send frames of CAN FD.
    """
    try:
        if can.interface == "socketcan":
            if can.fd:
                _require_fd(can.channel, can.bitrate)
            return SocketWire(_open_socket(can.channel, accept))
        return _BusWire(_open_bus(can.interface, can.channel))
    except OSError as error:
        raise CanError(error_text(can, error)) from error


def _require_fd(channel: str, nominal_bitrate: int) -> None:
    """Raise an error if an existing interface cannot send CAN FD frames.

    Raises:
        CanError: It is a classic one.
    """
    try:
        mtu = int((NETWORK_DEVICES_FOLDER / channel / "mtu").read_text())
    except (OSError, ValueError):
        return
    if mtu < FD_FRAME_BYTES:
        raise CanError(
            f"CAN channel {channel} (socketcan) is a classic one and sends no frame of CAN FD; take can.fd away, or "
            f"try: ip link set {channel} down; ip link set {channel} up type can bitrate {nominal_bitrate} "
            "dbitrate 2000000 fd on"
        )


def _open_socket(channel: str, accept: Collection[int]) -> socket.socket:
    """Open a raw CAN socket that receives data frames with these 11-bit ids, and all error frames.

    Source:
        Linux, Documentation/networking/can.rst, section 4.1.
    """
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    try:
        filters = b"".join(struct.pack("=II", can_id, EXTENDED | 0x7FF) for can_id in accept)
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        raw.setsockopt(socket.SOL_CAN_RAW, _ERROR_FILTER_OPTION, _ALL_ERRORS)
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        raw.bind((channel,))
    except BaseException:
        raw.close()
        raise
    return raw


class SocketWire:
    """Open CAN socket, or another socket that preserves message boundaries.

    Timing:
        One system call for each frame; neither `send` nor `receive` waits.
    """

    def __init__(self, channel: socket.socket) -> None:
        self._socket = channel
        self.close = channel.close

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
        with contextlib.suppress(BlockingIOError):
            while len(arrived) < _MAX_RECEIVED_PER_CALL:
                frame = self._socket.recv(FD_FRAME_BYTES, socket.MSG_DONTWAIT)
                if not frame:  # the other end of a socket pair is closed
                    break
                arrived.append(frame)
        return arrived


def _open_bus(interface: str, channel: str) -> "can.BusABC":
    """Open an interface of python-can; those of a simulation reach no other computer.

    Raises:
        OSError: There is no such interface.
    """
    import can

    options: dict[str, dict[str, Any]] = {
        "virtual": {"preserve_timestamps": True},
        "udp_multicast": {"hop_limit": 0},
    }
    try:
        bus = can.Bus(interface=interface, channel=channel, ignore_config=True, **options.get(interface, {}))
    # NotImplementedError is what python-can raises for an interface that it does not know.
    except (can.CanError, ValueError, ImportError, NotImplementedError) as error:
        raise OSError(None, str(error)) from error
    if interface == "udp_multicast":
        keep_multicast_local(bus.fileno(), channel)
    return bus


def keep_multicast_local(descriptor: int, group: str) -> None:
    """Restrict a multicast socket to the loopback interface, as python-can would receive from any network."""
    with socket.socket(fileno=os.dup(descriptor)) as local:
        local.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")
        membership = socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        local.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)


class _BusWire:
    """An interface of python-can, on which a simulated robot sends; what it refuses is dropped."""

    def __init__(self, bus: "can.BusABC") -> None:
        import can
        from can.interfaces.virtual import VirtualBus

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
            pack = pack_fd_frame if message.is_fd else pack_frame
            # python-can checks the ranges of a message's fields, not their types: an id of 1.5 passes.
            with contextlib.suppress(TypeError, ValueError, struct.error):
                arrived.append(pack(_flagged_id(message), bytes(message.data)))
        return arrived


def sent_message(frame: bytes, t_ns: int) -> "can.Message":
    """Return a packed frame as python-can's message, sent at a time [ns]."""
    import can

    can_id, data = unpack_frame(frame)
    is_fd = len(data) > _CLASSIC_DATA_BYTES
    return can.Message(
        timestamp=t_ns / 1e9,
        arbitration_id=can_id,
        is_extended_id=False,
        data=data,
        is_rx=False,
        is_fd=is_fd,
        bitrate_switch=is_fd,
    )


def _flagged_id(message: "can.Message") -> int:
    """Return a message's CAN id with the flag bits of Linux."""
    return (
        message.arbitration_id
        | (EXTENDED if message.is_extended_id else 0)
        | (REMOTE if message.is_remote_frame else 0)
        | (ERROR if message.is_error_frame else 0)
    )


def error_text(can: Can, error: OSError) -> str:
    """Return an error of a CAN interface and its remedy as one line of text."""
    channel = can.channel
    name = f"CAN channel {channel} ({can.interface})"
    match error.errno:
        case errno.ENETDOWN:
            kind = "" if channel.startswith("vcan") else f" type can bitrate {can.bitrate}"
            return f"{name} is down; try: ip link set {channel} up{kind}"
        case errno.ENODEV | errno.ENXIO:
            return f"{name} does not exist; those that do: ip -details link show type can"
        case errno.EAFNOSUPPORT:
            return f"{name} needs a kernel with CAN; try: modprobe can_raw"
        case _:
            return f"{name} cannot be opened: {error.strerror or error}"


# python-can logs what it also raises, at every attempt; ours is one line at the begin and one at the end.
logging.getLogger("can").propagate = False
logging.getLogger("can").addHandler(logging.NullHandler())
