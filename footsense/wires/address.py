"""Address of a CAN interface, and its errors in words with a remedy."""

import errno
from ipaddress import IPv4Address
from typing import Literal, NamedTuple

from footsense.errors import CanError

Interface = Literal["virtual", "socketcan", "udp_multicast"]
#: Those that other programs hear.
Heard = Literal["socketcan", "udp_multicast"]

#: Default channel of each; the address of a group is that of python-can.
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


def address_of(channel: str | None, interface: Heard | None = None) -> CanAddress:
    """Return what a text names: a multicast group, or a network interface with CAN.

    Args:
        channel: The text; None for the default of the interface, of `socketcan` if that is not given either.
        interface: Its kind; None for what the text is.

    Raises:
        CanError: It is neither, or not of that kind.
    """
    if interface is None:
        # No name of a network interface has a colon, and none of CAN begins with a number and a point.
        is_ip = channel is not None and (":" in channel or channel.partition(".")[0].isdecimal())
        interface = "udp_multicast" if is_ip else "socketcan"
    if interface not in DEFAULT_CHANNELS:
        raise CanError(f"interface {interface!r}: use one of {', '.join(DEFAULT_CHANNELS)}")
    name = channel or DEFAULT_CHANNELS[interface]
    if name in DEFAULT_CHANNELS:
        raise CanError(f"channel {name!r} is an interface: give it as one, without a channel")
    if interface == "udp_multicast" and not is_multicast(name):
        raise CanError(f"channel {name!r} is no IPv4 multicast address; try {DEFAULT_CHANNELS[interface]}")
    return CanAddress(interface, name)


def silence_text(what: str, channel: str) -> str:
    """Return the error of a channel on which something is not heard."""
    return (
        f"{what} on {channel}; is the service running, and is this its channel? "
        "(simulated: with --config deploy/simulated.yaml)"
    )


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
