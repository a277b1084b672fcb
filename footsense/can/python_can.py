"""Open CAN interfaces by python-can; send and receive on those that are not Linux CAN sockets.

The only file that knows python-can's buses. On `socketcan`, python-can opens the socket and sets its filters, and the
frames bypass it (`socketcan.py`). python-can neither checks its settings nor ignores files in the home directory, so it
gets checked settings and no files.
"""

import contextlib
import errno
import logging
import os
import socket
import struct
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_interface.can.socketcan import (
    ERROR,
    EXTENDED,
    FD_FRAME_BYTES,
    REMOTE,
    pack_fd_frame,
    pack_frame,
    split_frames,
)
from footsense.can.socketcan import MAX_RECEIVED_PER_CALL, SocketWire
from footsense.errors import CanError
from footsense.ports import CanWire

if TYPE_CHECKING:
    import can

#: Error numbers of an interface that is down or missing; a full or silent bus has others.
CHANNEL_MISSING_ERRNOS = frozenset(
    {errno.ENETDOWN, errno.ENXIO, errno.ENODEV, errno.EAFNOSUPPORT, errno.EBADF}
)


#: Where Linux shows its network interfaces.
NETWORK_DEVICES_FOLDER = Path("/sys/class/net")

#: Most bytes of data of a classic frame.
_CLASSIC_DATA_BYTES = 8


def open_wire(
    interface: str,
    channel: str,
    bitrate: int,
    accept: Collection[int],
    *,
    fd: bool = False,
    sends: bool = True,
) -> CanWire:
    """Open and return a CAN interface by python-can, as a raw socket where possible.

    Args:
        interface: Kind of channel, as python-can calls it: `virtual` or `socketcan`.
        channel: Its name, such as `can0`.
        bitrate: Bit rate of the bus [bit/s], for the remedy in an error message.
        accept: CAN ids that the kernel's filter accepts, on `socketcan`.
        fd: Whether it carries frames of CAN FD.
        sends: Whether such frames are sent; a classic interface can receive none, which is no error.

    Returns:
        The open interface.

    Raises:
        CanError: There is no such interface, or it is a classic one and is to send frames of CAN FD.
    """
    import can

    if interface == "socketcan" and fd and sends:
        _require_fd(channel, bitrate)

    try:
        bus = can.Bus(
            interface=interface, channel=channel, ignore_config=True, **_options(interface, accept, fd=fd)
        )
    # NotImplementedError is what python-can raises for an interface that it does not know.
    except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
        raise CanError(error_text(interface, channel, bitrate, error)) from error
    if interface == "udp_multicast":
        _keep_multicast_local(bus.fileno(), channel)
    if interface == "socketcan":
        return SocketWire(bus.socket, bus.shutdown)  # type: ignore[attr-defined]
    return _BusWire(bus)


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


def _keep_multicast_local(descriptor: int, group: str) -> None:
    """Restrict a multicast socket to the loopback interface, as python-can would receive from any network."""
    with socket.socket(fileno=os.dup(descriptor)) as local:
        local.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")
        membership = socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        local.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)


class _BusWire:
    """A python-can interface without a raw socket, used frame by frame."""

    def __init__(self, bus: "can.BusABC") -> None:
        import can

        self._bus = bus
        self._failures = (can.CanError, OSError)

    def send(self, frames: bytes, t_ns: int) -> int:
        """Send frames up to the first that is refused; return the number accepted.

        Args:
            frames: Whole frames behind each other.
            t_ns: Time stamp of all frames [ns], so that on the virtual channel a simulated minute lasts a minute.

        Returns:
            How many were accepted.

        Raises:
            OSError: The interface is down or gone.
        """
        taken = 0
        try:
            for message in data_messages(frames, t_ns):
                self._bus.send(message, timeout=0)
                taken += 1
        except self._failures as error:
            code = errno_of(error)
            if code in CHANNEL_MISSING_ERRNOS:
                raise OSError(code, str(error)) from error
        return taken

    def receive(self) -> list[bytes]:
        """Return all received frames; the virtual interface's queue would otherwise grow without limit.

        Raises:
            OSError: The interface is down or gone.
        """
        arrived = []
        for _ in range(MAX_RECEIVED_PER_CALL):
            try:
                # Its recv() measures even a zero timeout with the wall clock, and hangs if that is set back.
                message, _ = self._bus._recv_internal(timeout=0)  # noqa: SLF001
            except self._failures as error:
                if errno_of(error) in CHANNEL_MISSING_ERRNOS:
                    raise OSError(errno_of(error), str(error)) from error
                continue  # one message that is none
            if message is None:
                break
            pack = pack_fd_frame if message.is_fd else pack_frame
            # python-can checks the ranges of a message's fields, not their types: an id of 1.5 passes.
            with contextlib.suppress(TypeError, ValueError, struct.error):
                arrived.append(pack(_flagged_id(message), bytes(message.data)))
        return arrived

    def close(self) -> None:
        """Shut the python-can interface down."""
        self._bus.shutdown()


def data_messages(frames: bytes, t_ns: int) -> "list[can.Message]":
    """Return packed frames as python-can messages with the send time `t_ns` [ns]."""
    import can

    return [
        can.Message(
            timestamp=t_ns / 1e9,
            arbitration_id=can_id,
            is_extended_id=False,
            data=data,
            is_rx=False,
            is_fd=len(data) > _CLASSIC_DATA_BYTES,
            bitrate_switch=len(data) > _CLASSIC_DATA_BYTES,
        )
        for can_id, data in split_frames(frames)
    ]


def _flagged_id(message: "can.Message") -> int:
    """Return a message's CAN id with the flag bits of Linux."""
    return (
        message.arbitration_id
        | (EXTENDED if message.is_extended_id else 0)
        | (REMOTE if message.is_remote_frame else 0)
        | (ERROR if message.is_error_frame else 0)
    )


def _options(interface: str, accept: Collection[int], *, fd: bool) -> dict[str, Any]:
    """Return the python-can options for an interface type."""
    if interface == "virtual":
        return {"preserve_timestamps": True}
    if interface == "socketcan":
        return {
            "fd": fd,
            "can_filters": [{"can_id": can_id, "can_mask": 0x7FF, "extended": False} for can_id in accept],
        }
    if interface == "udp_multicast":
        return {"hop_limit": 0, "fd": fd}  # never leaves the computer
    return {}


def errno_of(error: BaseException) -> int | None:
    """Return the errno of an exception, for python-can's exceptions from `error_code`; None without one."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return number if isinstance(number, int) else None


def error_text(interface: str, channel: str, bitrate: int, error: BaseException) -> str:
    """Return an error of a CAN interface and its remedy as one line of text."""
    name = f"CAN channel {channel} ({interface})"
    match errno_of(error):
        case errno.ENETDOWN:
            kind = "" if channel.startswith("vcan") else f" type can bitrate {bitrate}"
            return f"{name} is down; try: ip link set {channel} up{kind}"
        case errno.ENODEV | errno.ENXIO:
            return f"{name} does not exist; those that do: ip -details link show type can"
        case errno.EAFNOSUPPORT:
            return f"{name} needs a kernel with CAN; try: modprobe can_raw"
        case _:
            return f"{name} cannot be opened: {error}"


# python-can logs what it also raises, at every attempt; ours is one line at the begin and one at the end.
logging.getLogger("can").propagate = False
logging.getLogger("can").addHandler(logging.NullHandler())
