"""Address of a CAN interface, and its errors in words with a remedy."""

import errno
from ipaddress import IPv4Address
from typing import Literal, NamedTuple

Interface = Literal["virtual", "socketcan", "udp_multicast"]

#: Default channel of each interface that other programs hear; the address of a group is that of python-can.
DEFAULT_CHANNELS = {"socketcan": "can0", "udp_multicast": "239.74.163.2"}


class CanAddress(NamedTuple):
    """Which CAN interface to open.

    Attributes:
        interface: Its kind.
        channel: Name of the network interface, or address of the multicast group.
        bitrate: Bit rate to set, where it has to be set up [bit/s].
    """

    interface: Interface
    channel: str
    bitrate: int = 500_000


def is_multicast(address: str) -> bool:
    """Return whether a text is an IPv4 multicast address."""
    try:
        return IPv4Address(address).is_multicast
    except ValueError:
        return False


def error_text(address: CanAddress, error: OSError) -> str:
    """Return an error of a CAN interface and its remedy as one line of text."""
    interface, channel, bitrate = address
    name = f"CAN channel {channel} ({interface})"
    match error.errno:
        case errno.ENETDOWN:
            kind = "" if channel.startswith("vcan") else f" type can bitrate {bitrate}"
            return f"{name} is down; try: ip link set {channel} up{kind}"
        case errno.ENODEV | errno.ENXIO:
            return f"{name} does not exist; those that do: ip -details link show type can"
        case errno.EAFNOSUPPORT:
            return f"{name} needs a kernel with CAN; try: modprobe can_raw"
        case _:
            return f"{name} cannot be opened: {error.strerror or error}"
